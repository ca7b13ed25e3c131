"""Prescribed torques: constant in the body, constant in space, or periodic."""

import math
from typing import NamedTuple

from rigidmc.physics.dynamics.so3 import cross, into_body, scale, sincos
from rigidmc.physics.effects.protocol import Number, Vector, effect

_ANY = (-math.inf, math.inf)


@effect(
    units={"size": "N m"},
    shapes={"size": 3},
    in_body=("size",),
    limits={"size": _ANY},
    example=((0.1, -0.2, 0.3),),
)
class BodyTorque(NamedTuple):
    """A torque that is constant in the body, for example from a thruster.

    The torque::

        tau = size

    Parameters
    ----------
    size : quantities (3,) [N m]
        torque in body axes

    Examples
    --------
    A thruster whose thrust differs from member to member by 1 %:

    >>> thruster = rm.BodyTorque((0.0, 0.0, rm.normal(0.2, 0.002)))
    >>> scene = rm.Scene(rm.Body.from_moments((1.0, 2.0, 2.5)), thruster)
    """

    size: Vector

    def torque(self):
        return self.size

    def torque_rate(self):
        return 0.0, 0.0, 0.0


@effect(
    units={"size": "N m"}, shapes={"size": 3}, limits={"size": _ANY}, example=((0.1, -0.2, 0.3),)
)
class SpaceTorque(NamedTuple):
    """A torque that is constant in space.

    The torque::

        tau = A^T size

    For any body L_z(t) = L_z(0) + size_z t.

    Parameters
    ----------
    size : quantities (3,) [N m]
        torque in space

    Examples
    --------
    >>> rm.SpaceTorque((0.0, 0.0, 0.5)).torque((1.0, 0.0, 0.0, 0.0))
    (0.0, 0.0, 0.5)
    """

    size: Vector

    def torque(self, q):
        return into_body(q, self.size)

    def torque_rate(self, q, w):
        return cross(into_body(q, self.size), w)


@effect(
    units={"size": "N m", "frequency": "rad s-1", "phase": "rad"},
    shapes={"size": 3},
    in_body=("size",),
    limits={"size": _ANY, "frequency": _ANY, "phase": _ANY},
    example=((0.1, -0.2, 0.3), 2.0, 0.7),
)
class PeriodicTorque(NamedTuple):
    """A torque along a fixed direction of the body that oscillates in time.

    The torque::

        tau = size cos(frequency t + phase)

    Parameters
    ----------
    size : quantities (3,) [N m]
        amplitude of the torque, body axes
    frequency : quantity [rad/s]
        angular frequency
    phase : quantity, optional [rad]
        at t = 0

    Examples
    --------
    >>> rm.PeriodicTorque((0.0, 0.0, 0.5), frequency=2.0).torque(0.0)
    (0.0, 0.0, 0.5)
    """

    size: Vector
    frequency: Number
    phase: Number = 0.0

    def torque(self, t):
        return scale(sincos(self.frequency * t + self.phase)[1], self.size)

    def torque_rate(self):
        return 0.0, 0.0, 0.0
