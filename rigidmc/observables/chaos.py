"""MEGNO and the largest Lyapunov exponent: how fast a neighbouring orbit moves away."""

from typing import NamedTuple

import numpy as np

from rigidmc.observables.protocol import Array, neighbour

OFTEN = 8  # steps between two looks at the neighbour, which is then brought back to NEAR
# Distance of the neighbour, relative to the size of the motion: the terms of second order are 1e-8,
# and so is rounding.
NEAR = 1e-8


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

    d(s) is the distance to a neighbour that makes the same steps. megno is 2 for regular motion and
    lambda t/2 for chaotic motion. The neighbour stands for the solution of the variational
    equations: its distance is kept at 1e-8 of the motion, so that its direction is the tangent to
    eight digits, whatever the effects and the integrator.
    Source: Cincotta & Simo, Astron. Astrophys. Suppl. 147 (2000) 205; Benettin, Galgani & Strelcyn,
    Phys. Rev. A 14 (1976) 2338.
    """

    def results(self, kept: Array, looks: int, h: Array) -> dict[str, Array]:
        """The outputs from three sums over the looks: ln of growth, the same times its time, Y."""
        with np.errstate(all="ignore"):
            return {"megno": kept[2] / looks, "lyapunov": kept[0] / (looks * OFTEN * h)}
