"""State of a body: angular velocity, momentum, attitude, energy, and the work done on it.

The drifts of energy and |L|^2 are relative to the start. They are corrected for the work of effects
where it is saved.
"""

from typing import NamedTuple

from rigidmc.physics.dynamics.euler import angular_velocity, kinetic_energy
from rigidmc.physics.dynamics.so3 import dot
from rigidmc.physics.effects.sums import total_energy
from rigidmc.physics.observables.protocol import observable


@observable(units="rad s-1", long_name="angular velocity, body axes", dims=("axis",))
class Omega(NamedTuple):
    """Angular velocity along the axes of the body, omega = I^-1 L."""

    def value(self, body, l):
        return angular_velocity(body, l)


@observable(units="kg m2 s-1", long_name="angular momentum, body axes", dims=("axis",))
class Momentum(NamedTuple):
    """Angular momentum along the axes of the body."""

    def value(self, l):
        return l


@observable(units="rad s-1", long_name="angular velocity, principal axes", dims=("principal_axis",))
class PrincipalOmega(NamedTuple):
    """Angular velocity along the principal axes, omega_i = L_i/I_i; differs from `omega` for a body
    described in other axes."""

    def value(self, body, l):
        return angular_velocity(body, l)


@observable(
    units="kg m2 s-1", long_name="angular momentum, principal axes", dims=("principal_axis",)
)
class PrincipalMomentum(NamedTuple):
    """Angular momentum along the principal axes; differs from `momentum` for a body described in
    other axes."""

    def value(self, l):
        return l


@observable(units="1", long_name="attitude quaternion, body to space", dims=("quat",))
class Attitude(NamedTuple):
    """Unit quaternion (w, x, y, z), from body to space components; q and -q are one attitude."""

    def value(self, q):
        return q


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
    long_name="relative drift of energy, less booked work",
    dims=(),
    conserved="energy_drift",
)
class EnergyDrift(NamedTuple):
    """(E - E(0))/scale with scale |E(0)|, or 1e-3 of the energies in play if that is more
    (tests/physics/observables/test_observables.py).

    Energies in play are the kinetic energy at the start and the largest potential energies. Where
    work is booked, E(0) and the scale grow by it, and the scale is at least the kinetic energy now
    and at every 64th step before. The same minimum applies to a body that starts at rest under
    torques, with no energies in play. `energy_drift_max` uses the kinetic energies at all saves.
    """

    def value(self, body, effects, q, l, start):
        return ((kinetic_energy(body, l) + total_energy(effects, body, q) - start[0]) * start[1],)


@observable(units="1", long_name="relative drift of |L|^2", dims=(), conserved="l2")
class L2Drift(NamedTuple):
    """(|L|^2 - |L(0)|^2)/|L(0)|^2; relative to |L|^2, and so 1, for a body that starts at rest."""

    def value(self, l, start):
        return ((dot(l, l) - start[2]) * start[3],)


@observable(units="J", long_name="work of an effect since t = 0", dims=("effect",))
class Work(NamedTuple):
    """The work of each effect since t = 0, W = integral of torque . omega dt, TdC (3.16), (3.34).

    Effects without an energy change E by their power, dE/dt. If the work is saved, the kernel
    integrates it along with L, to the order of the integrator (4 by srkn11), and books it: E - E(0)
    less the work of the effects without an energy is then a drift like any other. The attribute
    `booked` of the variable names those effects.
    """

    def value(self, works):
        return works
