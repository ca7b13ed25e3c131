"""Prescribed torques: constant in the body, constant in space, or periodic."""

import math
from typing import NamedTuple

from rigidmc.dynamics.so3 import cross, into_body, scale, sincos
from rigidmc.effects.protocol import Number, Vector, effect

_ANY = (-math.inf, math.inf)


@effect(
    units={"size": "N m"},
    shapes={"size": 3},
    limits={"size": _ANY},
    example=((0.1, -0.2, 0.3),),
)
class BodyTorque(NamedTuple):
    """A torque that is constant in the body, for example of a thruster.

    size : torque in the principal axes [N m]
    """

    size: Vector

    def torque(self):
        return self.size

    def torque_rate(self):
        return 0.0, 0.0, 0.0


@effect(
    units={"size": "N m"},
    shapes={"size": 3},
    limits={"size": _ANY},
    example=((0.1, -0.2, 0.3),),
)
class SpaceTorque(NamedTuple):
    """A torque that is constant in space.

        tau = A^T size

    For any body L_z(t) = L_z(0) + size_z t.

    size : torque in space [N m]
    """

    size: Vector

    def torque(self, q):
        return into_body(q, self.size)

    def torque_rate(self, q, w):
        return cross(into_body(q, self.size), w)


@effect(
    units={"size": "N m", "frequency": "rad s-1", "phase": "rad"},
    shapes={"size": 3},
    limits={"size": _ANY, "frequency": _ANY, "phase": _ANY},
    example=((0.1, -0.2, 0.3), 2.0, 0.7),
)
class PeriodicTorque(NamedTuple):
    """A torque along a fixed direction of the body that oscillates in time.

        tau = size cos(frequency t + phase)

    size : amplitude of the torque, principal axes [N m]
    frequency : angular frequency [rad/s]
    phase : at t = 0 [rad]
    """

    size: Vector
    frequency: Number
    phase: Number = 0.0

    def torque(self, t):
        return scale(sincos(self.frequency * t + self.phase)[1], self.size)

    def torque_rate(self):
        return 0.0, 0.0, 0.0
