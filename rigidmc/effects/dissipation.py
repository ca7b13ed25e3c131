"""Energy lost inside the body."""

import math
from typing import NamedTuple

from rigidmc.dynamics.euler import angular_velocity
from rigidmc.dynamics.so3 import cross, dot, scale, select
from rigidmc.effects.flows import turned_vector


class EnergyDissipation(NamedTuple):
    """Internal dissipation: energy falls, |L| stays, and the spin ends about the axis of the largest moment.

        tau = loss L x (L x omega)/|L|,   dE/dt = -loss |L x omega|^2/|L|

    The double bracket of Bloch, Krishnaprasad, Marsden & Ratiu, Commun. Math. Phys. 175 (1996) 1, section 4. It leaves the size of L alone; its
    direction in space wanders by about `loss` rad in each turn, where that of a body with parts that move inside stays.
    In splittings its flow is a rule of order 2 that turns L and keeps |L| to rounding.

    loss : share of the free rate of L by which it drifts to the major axis
    """

    loss: float

    units = {"loss": "1"}
    keeps_l2 = True
    isotropic = True
    damps = True
    limits = {"loss": (-math.inf, math.inf)}
    example = (0.05,)
    kick_order = 2

    def torque(self, body, l):
        square = dot(l, l)
        size = math.sqrt(select(square > 0.0, square, 1.0))
        return scale(self.loss / size, cross(l, cross(l, angular_velocity(body, l))))

    def kick(self, body, h, l):
        square = dot(l, l)
        by = -h * self.loss / math.sqrt(select(square > 0.0, square, 1.0))
        half = turned_vector(scale(0.5 * by, cross(l, angular_velocity(body, l))), l)
        return turned_vector(scale(by, cross(half, angular_velocity(body, half))), l)
