"""MEGNO and the largest Lyapunov exponent: how fast a nearby trajectory diverges."""

from typing import NamedTuple

import numpy as np

from rigidmc.physics.observables.protocol import Array, neighbour

# Steps between two renormalisations, which bring the shadow trajectory back to SHADOW_DISTANCE. One
# renormalisation takes as long as 3 steps of rk4.
RENORMALISE_EVERY = 8
# Distance of the shadow trajectory, relative to the size of the motion: second-order terms are 1e-8
# and so is rounding.
SHADOW_DISTANCE = 1e-8
# Number of times in the run at which the torque on the body in its initial state is evaluated, to
# find the size of the motion.
TORQUE_TRIALS = 32


@neighbour(
    shadow=True,
    outputs={
        "megno": (
            "1",
            "mean exponential growth factor of nearby orbits: "
            "2 for regular motion, lambda t/2 for chaotic",
            (),
        ),
        "lyapunov": ("s-1", "largest Lyapunov exponent up to the end", ()),
    },
)
class Megno(NamedTuple):
    """The mean exponential growth factor of nearby orbits, and the largest Lyapunov exponent.

        Y(t) = 2/t int_0^t (d'/d) s ds    megno = 1/t int_0^t Y ds    lyapunov = ln(d(t)/d(0))/t

    d(s) is the distance in attitude and momentum to a shadow trajectory, which makes the same
    steps:

        d^2 = 4 |dq|^2 + |dL|^2/(2 I E)

    I is the largest moment. E is the energy scale: the kinetic energy at the start plus the largest
    potential energies, or the largest torque times 1 rad if that is more. megno is 2 for regular
    motion and lambda t/2 for chaotic motion. The shadow trajectory replaces the solution of the
    variational equations: its distance is kept at 1e-8 of the motion, so its direction is the
    tangent to eight digits, whatever the effects and the integrator.

    The integrals are sums over every step at first, then over every 8 steps, and over the remaining
    steps at the end. For six heavy tops after 1 to 100 steps of 0.1 s, megno is off by at most
    0.007 (tests/physics/observables/test_chaos.py).
    Source: Cincotta & Simo, Astron. Astrophys. Suppl. 147 (2000) 205; Benettin, Galgani & Strelcyn,
    Phys. Rev. A 14 (1976) 2338.
    """

    def results(self, sums: Array, steps: float, h: Array) -> dict[str, Array]:
        """Return the outputs from three sums: ln of growth; over steps, of (d'/d) s and of Y."""
        with np.errstate(all="ignore"):
            return {"megno": sums[2] / steps, "lyapunov": sums[0] / (steps * h)}
