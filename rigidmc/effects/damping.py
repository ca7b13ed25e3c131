"""Viscous damping."""

import math
from typing import NamedTuple

from rigidmc.dynamics.so3 import axpy, expm1, scale


class ViscousDamping(NamedTuple):
    """Isotropic viscous damping of the angular momentum.

        tau = -rate L,   alone: L(t) = exp(-rate t) L(0)

    A free body damped so runs through its undamped motion at the time (1 - exp(-rate t))/rate.

    rate : damping rate [1/s]
    """

    rate: float

    units = {"rate": "s-1"}
    isotropic = True
    limits = {"rate": (0.0, math.inf)}

    def torque(self, l):
        return scale(-self.rate, l)

    def kick(self, h, l):
        return axpy(l, expm1(-self.rate * h), l)
