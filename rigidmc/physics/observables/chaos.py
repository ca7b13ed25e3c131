"""MEGNO and the largest Lyapunov exponent: how fast nearby trajectories diverge."""

from typing import NamedTuple

import numpy as np

from rigidmc.physics.observables.protocol import Array, growth

# Steps between two records of the growth of a tangent. One record takes as long as 3 steps of rk4.
RECORD_EVERY = 8
# Number of times in the run at which the torque on the body in its initial state is evaluated, to
# find the size of the motion.
TORQUE_TRIALS = 32


@growth(
    growth_method="tangent",
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

    d(s) is the length of a tangent (dq, dL), the derivative of attitude and momentum by a change of
    the start along one direction:

        d^2 = 4 |dq|^2 + |dL|^2/(2 I E)

    I is the largest moment. E is the energy scale: the kinetic energy at the start plus the largest
    potential energies, or the largest torque times 1 rad if that is more. megno is 2 for regular
    motion and lambda t/2 for chaotic motion. The tangent is the exact derivative of the steps that
    the member makes, whatever the effects, the integrator and the precision; with noise, both have
    the same noise.

    The integrals are sums over every step at first, then over every 8 steps, and over the remaining
    steps at the end. For six heavy tops after 1 to 100 steps of 0.1 s, megno is off by at most
    0.007 (tests/physics/observables/test_chaos.py).
    Source: Cincotta & Simo, Astron. Astrophys. Suppl. 147 (2000) 205; Benettin, Galgani & Strelcyn,
    Phys. Rev. A 14 (1976) 2338.
    """

    def results(self, sums: Array, time: Array) -> dict[str, Array]:
        """Return the outputs from three sums: ln of growth, and over time of (d'/d) s and of Y."""
        with np.errstate(all="ignore"):
            return {"megno": sums[2] / time, "lyapunov": sums[0] / time}
