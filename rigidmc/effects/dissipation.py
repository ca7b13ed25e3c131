"""Energy lost inside the body."""

import math
from typing import NamedTuple

from rigidmc.dynamics.euler import angular_velocity
from rigidmc.dynamics.so3 import cross, dot, scale, select
from rigidmc.effects.flows import turned_vector
from rigidmc.effects.protocol import Number, effect


@effect(
    units={"loss": "1"},
    limits={"loss": (-math.inf, math.inf)},
    example=(0.05,),
    damps=True,
    keeps_l2=True,
    isotropic=True,
    kick_order=2,
)
class EnergyDissipation(NamedTuple):
    """Internal dissipation: the energy falls, L keeps its size, the spin ends about the major axis.

    Torque and power::

        tau = loss L x (L x omega)/|L|,   dE/dt = -loss |L x omega|^2/|L|

    The direction of L in space wanders by about `loss` rad in each turn; that of a real body with
    moving parts inside stays. Its kick is a rule of order 2 that rotates L: `|L|` stays to
    rounding.

    A wobble about the axis of the largest moment I_3 dies away as exp(-t/T)::

        1/T = (loss |L|/2) (1/I_1 + 1/I_2 - 2/I_3)

    so a symmetric body with a quality factor Q of its wobble has loss = 1/(2 Q).
    Source: the double bracket of Bloch, Krishnaprasad, Marsden & Ratiu, Commun. Math. Phys. 175
    (1996) 1, section 4.

    Parameters
    ----------
    loss : quantity
        speed at which L drifts to the major axis, as a share of its free rate

    Examples
    --------
    >>> sloshing = rm.EnergyDissipation(loss=0.01)
    >>> scene = rm.Scene(rm.Body.from_moments((1.0, 2.0, 2.5)), sloshing)
    """

    loss: Number

    def torque(self, body, l):
        square = dot(l, l)
        size = math.sqrt(select(square > 0.0, square, 1.0))
        return scale(self.loss / size, cross(l, cross(l, angular_velocity(body, l))))

    def kick(self, body, h, l):
        square = dot(l, l)
        by = -h * self.loss / math.sqrt(select(square > 0.0, square, 1.0))
        half = turned_vector(scale(0.5 * by, cross(l, angular_velocity(body, l))), l)
        return turned_vector(scale(by, cross(half, angular_velocity(body, half))), l)
