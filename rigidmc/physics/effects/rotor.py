"""A flywheel in the body: the gyrostat."""

import math
from typing import NamedTuple

from rigidmc.physics.dynamics.euler import angular_velocity
from rigidmc.physics.dynamics.so3 import (
    axpy,
    cross,
    exponential,
    into_body,
    root,
    rotated,
    scale,
    select,
)
from rigidmc.physics.effects.protocol import Vector, effect

PIECES = 48  # of a measured wheel, with ends where its momentum bends most


@effect(
    units={"momentum": "kg m2 s-1", "motor": "N m"},
    shapes={"momentum": 3, "motor": 3},
    in_body=("momentum", "motor"),
    limits={"momentum": (-math.inf, math.inf), "motor": (-math.inf, math.inf)},
    example=((0.5, -0.3, 0.8), (0.05, 0.02, -0.04)),
    kick_order=2,  # exact without a motor
)
class Rotor(NamedTuple):
    """A flywheel that spins in the body: the gyrostat of Zhukovskii and Volterra.

    Torque::

        tau = H x omega - motor,   H = momentum + motor t

    L = I omega is the momentum of the body with the flywheel locked; L + H is the momentum of the
    whole. With motor = 0 the energy of the body is conserved. The kick is a rotation in the
    coordinates L_i/sqrt(I_i), exact for constant H, between two halves of the motor's kick.
    Source: Wittenburg, Dynamics of Systems of Rigid Bodies (1977), 4.6; Hughes, Spacecraft Attitude
    Dynamics (1986), 6.

    Parameters
    ----------
    momentum : quantities (3,) [kg m^2/s]
        of the flywheel relative to the body, body axes
    motor : quantities (3,), optional [N m]
        torque of the motor on the flywheel, body axes

    Examples
    --------
    >>> wheel = rm.Rotor(momentum=(0.0, 0.0, 0.3))
    >>> wheel.motor
    (0.0, 0.0, 0.0)
    >>> satellite = rm.Scene(rm.Body.from_moments((1.0, 2.0, 2.5)), wheel)
    """

    momentum: Vector
    motor: Vector = (0.0, 0.0, 0.0)

    @property
    def conservative(self) -> bool:
        # An array or a distribution may include a running motor in some member.
        return all(isinstance(m, float) and m == 0.0 for m in self.motor)

    def torque(self, body, t, l):
        return axpy(
            cross(axpy(self.momentum, t, self.motor), angular_velocity(body, l)), -1.0, self.motor
        )

    def kick(self, body, t, h, l):
        wheel = axpy(self.momentum, t, self.motor)
        # Half of the motor's kick before and half after the rotation: symmetric, hence order 2.
        turned = carried_round(body, h, wheel, axpy(l, -0.5 * h, self.motor))
        return axpy(turned, -0.5 * h, self.motor)


def carried_round(body, h, wheel, l):
    """Return L after the torque H x omega of a constant momentum H over h.

    A rotation of y_i = L_i sqrt(1/I_i):  dy/dt = g x y,  g_i = H_i / sqrt(I_j I_k)
    """
    one, two, three = root(body.i1), root(body.i2), root(body.i3)
    x, y, z = rotated(
        (h * two * three * wheel[0], h * three * one * wheel[1], h * one * two * wheel[2]),
        (one * l[0], two * l[1], three * l[2]),
    )
    # where 1/I1 is 0, x is 0 and the quotient is 0 whatever the divisor
    return x / select(one > 0.0, one, 1.0), y / two, z / three


@effect(
    units={"momenta": "kg m2 s-1", "turn": "rad"},
    shapes={"momenta": 2 * PIECES, "times": PIECES, "axis": 3, "turn": 3},
    limits=dict.fromkeys(("momenta", "times", "axis", "turn"), (-math.inf, math.inf)),
    switches=("times",),
    in_body=(),
)
class MeasuredWheel(NamedTuple):
    """A rotor with a momentum H(t) of straight pieces, along an axis of a sensor::

        tau = h x omega - dh/dt,   h = H(t) R^T axis

    momenta : that the line of each piece has at t = 0, and the rates;  times : begins of the pieces
    turn : rotation vector of R, from body axes to axes of the sensor
    """

    momenta: Vector
    times: Vector
    axis: Vector
    turn: Vector = (0.0, 0.0, 0.0)

    def torque(self, body, t, l):
        first, rate = 0.0, 0.0
        for i in range(48):  # PIECES: loops of compiled code count to a number
            is_later = t >= self.times[i]
            first = select(is_later, self.momenta[i], first)
            rate = select(is_later, self.momenta[48 + i], rate)
        axis = into_body(exponential(self.turn), self.axis)
        wheel = scale(first + rate * t, axis)
        return axpy(cross(wheel, angular_velocity(body, l)), -rate, axis)
