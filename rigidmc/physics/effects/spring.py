"""A spring between a point of the body and a point of space."""

import math
from typing import NamedTuple

from rigidmc.physics.dynamics.so3 import cross, difference, dot, into_body, root, scale
from rigidmc.physics.effects.protocol import Number, Vector, effect

_ANY = (-math.inf, math.inf)


@effect(
    units={"stiffness": "N m-1", "at": "m", "to": "m", "length": "m"},
    shapes={"at": 3, "to": 3},
    in_body=("at",),
    limits={"stiffness": (0.0, math.inf), "at": _ANY, "to": _ANY, "length": (0.0, math.inf)},
    example=(3.0, (0.4, -0.2, 0.3), (0.5, 0.6, -1.0), 0.2),
)
class Spring(NamedTuple):
    """A linear spring from a point of the body to a point of space.

    Potential energy and torque (Hooke's law)::

        E = 1/2 stiffness (d - length)^2,   d = |at - A^T to|
        tau = stiffness (1 - length/d) at x A^T to

    Parameters
    ----------
    stiffness : quantity [N/m]
        of the spring
    at : quantities (3,) [m]
        point of attachment on the body, body axes
    to : quantities (3,) [m]
        point of attachment in space, from the fixed point
    length : quantity, optional [m]
        length of the relaxed spring

    Examples
    --------
    >>> spring = rm.Spring(stiffness=10.0, at=(0.5, 0.0, 0.0), to=(0.0, 2.0, 0.0))
    >>> print(*spring.torque((1.0, 0.0, 0.0, 0.0)))
    0.0 0.0 10.0
    """

    stiffness: Number
    at: Vector
    to: Vector
    length: Number = 0.0

    def torque(self, q):
        end = into_body(q, self.to)
        d = difference(self.at, end)
        # 1e-300 m2: where d is 0 the direction is arbitrary, and `cross` vanishes
        pull = self.stiffness * (1.0 - self.length / root(dot(d, d) + 1e-300))
        return scale(pull, cross(self.at, end))

    def torque_rate(self, q, w):
        end = into_body(q, self.to)
        d, moves = difference(self.at, end), cross(end, w)
        square = dot(d, d) + 1e-300  # m2, as in `torque`
        slack = self.length / root(square)
        pull, change = (
            self.stiffness * (1.0 - slack),
            self.stiffness * slack * (-dot(d, moves)) / square,
        )
        one, two = cross(self.at, moves), cross(self.at, end)
        return (
            pull * one[0] + change * two[0],
            pull * one[1] + change * two[1],
            pull * one[2] + change * two[2],
        )

    def energy(self, q):
        d = difference(self.at, into_body(q, self.to))
        stretch = root(dot(d, d)) - self.length
        return 0.5 * self.stiffness * stretch * stretch

    def energy_scale(self):
        longest = root(dot(self.at, self.at)) + root(dot(self.to, self.to)) + self.length
        return 0.5 * self.stiffness * longest * longest
