"""MEGNO and the largest Lyapunov exponent: how fast a neighbour runs away."""

from typing import NamedTuple

import numpy as np

OFTEN = 8  # steps between two looks at the neighbour, which is then brought back to NEAR
NEAR = 1e-8  # distance of the neighbour, of the size of the motion: what it leaves out is 1e-8, what rounding does to it too


class Megno(NamedTuple):
    """The mean exponential growth factor of nearby orbits, and the largest Lyapunov exponent, by a neighbour that makes the same steps.

    Y(t) = 2/t int_0^t (d'/d) s ds of the distance d(s) to the neighbour, and megno its mean over time: 2 for regular motion, lambda t/2
    for chaotic; lyapunov = ln(d(t)/d(0))/t. The neighbour stands for the solution of the variational equations: its distance is kept at 1e-8 of the
    motion, so that it has the same tangent to eight digits, whatever the effects and the integrator.
    Source: Cincotta & Simo, Astron. Astrophys. Suppl. 147 (2000) 205; Benettin, Galgani & Strelcyn, Phys. Rev. A 14 (1976) 2338.
    """

    shadow = True
    outputs = {
        "megno": (
            "1",
            "mean exponential growth factor of nearby orbits: 2 for regular motion, lambda t/2 for chaotic",
            (),
        ),
        "lyapunov": ("s-1", "largest Lyapunov exponent up to the end", ()),
    }

    def results(self, kept, looks, h):
        """Outputs from what is kept, (3, n): sum of ln of growth, of the same times its time, and of Y; `looks` so far, `h` the step."""
        with np.errstate(all="ignore"):
            return {"megno": kept[2] / looks, "lyapunov": kept[0] / (looks * OFTEN * h)}
