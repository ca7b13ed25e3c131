"""What a free top conserves: energy and |L|^2, and how far they have drifted."""

from typing import NamedTuple

from rigidmc.dynamics.euler import kinetic_energy
from rigidmc.dynamics.so3 import dot
from rigidmc.effects.sums import total_energy
from rigidmc.observables.protocol import observable


@observable(units="J", long_name="energy", dims=(), conserved="energy")
class Energy(NamedTuple):
    """E = 1/2 L . I^-1 L + potential energy of the effects, TdC (3.16), (3.33)."""

    def value(self, body, effects, q, l):
        return (kinetic_energy(body, l) + total_energy(effects, body, q),)


@observable(units="kg2 m4 s-2", long_name="squared angular momentum", dims=(), conserved="l2")
class L2(NamedTuple):
    """|L|^2."""

    def value(self, l):
        return (dot(l, l),)


@observable(
    units="1",
    long_name="relative drift of energy, less work where it is booked",
    dims=(),
    conserved="energy_drift",
)
class EnergyDrift(NamedTuple):
    """(E - E(0))/|E(0)|; if |E(0)| is under 1e-3 of the energies in play, relative to that part
    (tests/observables/test_observables.py).

    Where work is booked, E(0) and the scale grow by it, and the scale is no less than the kinetic
    energy of now and of every 64th step before; nor is that of a body that starts with no energy in
    play, at rest under torques. `energy_drift_max` knows the kinetic energies at all saves.
    """

    def value(self, body, effects, q, l, start):
        return ((kinetic_energy(body, l) + total_energy(effects, body, q) - start[0]) * start[1],)


@observable(units="1", long_name="relative drift of |L|^2", dims=(), conserved="l2")
class L2Drift(NamedTuple):
    """(|L|^2 - |L(0)|^2)/|L(0)|^2; relative to |L|^2, and so 1, for a body that starts at rest."""

    def value(self, l, start):
        return ((dot(l, l) - start[2]) * start[3],)
