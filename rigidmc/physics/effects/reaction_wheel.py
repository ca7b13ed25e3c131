"""A reaction wheel: a flywheel on a motor, whose momentum is a state."""

import math
from typing import NamedTuple

from rigidmc.physics.dynamics.euler import angular_velocity
from rigidmc.physics.dynamics.so3 import axpy, cross, dot, expm1, maximum, minimum, scale, select
from rigidmc.physics.effects.protocol import Number, Vector, effect
from rigidmc.physics.effects.rotor import carried_round

_POSITIVE = (0.0, math.inf)


@effect(
    units={
        "axis": "1", "inertia": "kg m2", "command": "N m", "friction": "N m s",
        "max_torque": "N m", "max_momentum": "kg m2 s-1", "momentum": "kg m2 s-1",
    },
    shapes={"axis": 3},
    in_body=("axis",),
    limits={
        "axis": (-1.0, 1.0), "inertia": _POSITIVE, "command": (-math.inf, math.inf),
        "friction": _POSITIVE, "max_torque": _POSITIVE, "max_momentum": _POSITIVE,
        "momentum": (-math.inf, math.inf),
    },
    state=("momentum",),
    example=((0.6, 0.0, 0.8), 0.1, 0.02, 0.01, 1.0, 2.0, 0.5),
    kick_order=2,
)  # fmt: skip
class ReactionWheel(NamedTuple):
    """A wheel that spins about an axis of the body, driven by a motor and braked by its bearing.

    With the momentum H of the wheel along the unit vector a::

        dH/dt = u - friction s,   s = H/inertia - a . omega,   |u| <= max_torque
        tau = H a x omega - dH/dt a

    The tensor of the body holds everything but the inertia of the wheel about its own axis: of a
    satellite with locked wheels, subtract inertia a a^T for each. L + H a, over all wheels, is then
    the momentum of the whole, which no wheel changes in space. s is the speed of the wheel relative
    to the body. The motor follows `command` up to `max_torque`, and stops where it would drive H
    beyond `max_momentum`, in either sense.

    The kick of a splitting is a rotation between two halves of the exact flow of motor and
    bearing: order 2.
    Source: Hughes, Spacecraft Attitude Dynamics (1986), 6.

    Parameters
    ----------
    axis : floats (3,)
        unit vector, body axes
    inertia : quantity [kg m^2]
        of the wheel about its axis
    command : quantity, optional [N m]
        torque of the motor on the wheel
    friction : quantity, optional [N m s]
        torque of the bearing per relative speed
    max_torque : quantity, optional [N m]
        of the motor
    max_momentum : quantity, optional [kg m^2/s]
        at which the wheel is saturated
    momentum : quantity, optional [kg m^2/s]
        of the wheel along its axis, in space, at the start

    Examples
    --------
    >>> wheel = rm.ReactionWheel((0.0, 0.0, 1.0), inertia=1e-3, momentum=0.2)
    >>> satellite = rm.Scene(rm.Body.from_moments((1.0, 2.0, 2.5)), wheel)
    """

    axis: Vector
    inertia: Number
    command: Number = 0.0
    friction: Number = 0.0
    max_torque: Number = 1e300
    max_momentum: Number = 1e300
    momentum: Number = 0.0

    def state_rate(self, body, l):
        return (wheel_torque(self, body, l),)

    def torque(self, body, l):
        turning = scale(self.momentum, cross(self.axis, angular_velocity(body, l)))
        return axpy(turning, -wheel_torque(self, body, l), self.axis)

    def kick(self, body, h, l):
        first = driven(self, body, 0.5 * h, l, self.momentum)
        turned = carried_round(body, h, scale(first[1], self.axis), first[0])
        last = driven(self, body, 0.5 * h, turned, first[1])
        return last[0] + (last[1],)


def motor(wheel, momentum):
    """Return the torque of the motor of a wheel with this momentum [N m]."""
    u = maximum(minimum(wheel.command, wheel.max_torque), -wheel.max_torque)
    # a motor that brakes the wheel works at any speed
    return select(u * momentum >= abs(u) * wheel.max_momentum, 0.0 * u, u)


def relative_speed(wheel, body, l, momentum):
    """Return the speed of a wheel relative to the body [rad/s]."""
    return momentum / wheel.inertia - dot(wheel.axis, angular_velocity(body, l))


def wheel_torque(wheel, body, l):
    """Return dH/dt [N m]."""
    speed = relative_speed(wheel, body, l, wheel.momentum)
    return motor(wheel, wheel.momentum) - wheel.friction * speed


def driven(wheel, body, h, l, momentum):
    """Return (L, H) after motor and bearing alone have acted over h.

    With k = 1/inertia + a . I^-1 a:  ds/dt = k (u - friction s)
    """
    rate = motor(wheel, momentum) - wheel.friction * relative_speed(wheel, body, l, momentum)
    k = 1.0 / wheel.inertia + dot(wheel.axis, angular_velocity(body, wheel.axis))
    x = -k * wheel.friction * h
    # (exp(x) - 1)/x by its series below 1e-5, where the next term is 1e-16
    is_small = abs(x) < 1e-5
    mean = select(is_small, 1.0 + x * (0.5 + x * (1.0 / 6.0)), expm1(x) / select(is_small, 1.0, x))
    change = h * rate * mean
    return axpy(l, -change, wheel.axis), momentum + change
