"""A shaken pivot."""

import math
from typing import NamedTuple

from rigidmc.physics.dynamics.so3 import cross, into_body, root, scale, sincos
from rigidmc.physics.effects.protocol import Number, Vector, effect

_ANY = (-math.inf, math.inf)


@effect(
    units={"swing": "m", "frequency": "rad s-1", "phase": "rad"},
    shapes={"swing": 3},
    limits={"swing": _ANY, "frequency": _ANY, "phase": _ANY},
    example=((0.1, -0.05, 0.2), 3.0, 0.4),
)
class MovingPivot(NamedTuple):
    """A shaken fixed point, at swing cos(frequency t + phase) in space, with the body in its frame.

    Torque::

        tau = frequency^2 cos(frequency t + phase) m r x A^T swing

    A pendulum stands upside down if it is shaken vertically and fast enough: (swing frequency)^2 >
    2 g l for a point mass at the distance l.
    Source: Kapitza, Usp. Fiz. Nauk 44 (1951) 7; Landau & Lifshitz, Mechanics, section 30,
    problem 1.

    Parameters
    ----------
    swing : quantities (3,) [m]
        amplitude in space
    frequency : quantity [rad/s]
        angular frequency
    phase : quantity, optional [rad]
        at t = 0

    Examples
    --------
    >>> shaken = rm.MovingPivot(swing=(0.0, 0.0, 0.01), frequency=300.0)
    >>> body = rm.Body.from_moments((0.01, 0.01, 1e-4), mass=1.0, centre=(0.0, 0.0, 0.1))
    >>> scene = rm.Scene(body, (rm.Gravity(9.81), shaken))
    """

    swing: Vector
    frequency: Number
    phase: Number = 0.0

    def torque(self, body, t, q):
        push = self.frequency * self.frequency * sincos(self.frequency * t + self.phase)[1]
        return cross((body.p1, body.p2, body.p3), into_body(q, scale(push, self.swing)))

    def torque_rate(self, body, t, q, w):
        push = self.frequency * self.frequency * sincos(self.frequency * t + self.phase)[1]
        return cross((body.p1, body.p2, body.p3), cross(into_body(q, scale(push, self.swing)), w))

    def energy_scale(self, body):
        s = self.swing
        # No potential: use the largest torque times 1 rad.
        size = root(s[0] * s[0] + s[1] * s[1] + s[2] * s[2])
        return self.frequency * self.frequency * size * (abs(body.p1) + abs(body.p2) + abs(body.p3))
