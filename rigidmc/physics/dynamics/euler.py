"""Euler's equations of a rigid body with a fixed point, for body angular momentum L and attitude q.

dL/dt = L x omega + tau,   dq/dt = 1/2 q (0, omega),   omega_i = L_i / I_i          (TdC (3.35),
(3.7))
"""

from typing import Any, NamedTuple

from rigidmc.physics.dynamics.vectors import first_three

BODY_NUMBERS = 9  # the fields of MassProperties that every body has


class MassProperties(NamedTuple):
    """The constants of a body in its principal axes.

    i1, i2, i3 : reciprocal principal moments 1/I [1/(kg m^2)]
    a1, a2, a3 : (I2 - I3)/(I2 I3) and cyclic [1/(kg m^2)], from differences of moments, because
        1/I3 - 1/I2 would cancel
    p1, p2, p3 : mass times centre of mass, the static moment [kg m]
    axes : for observables, the BodyAxes of a body that is described in other axes, see
        `rigidmc.physics.dynamics.body_axes`; else ()
    """

    i1: float
    i2: float
    i3: float
    a1: float
    a2: float
    a3: float
    p1: float
    p2: float
    p3: float
    axes: Any = ()

    @staticmethod
    def of(moments, static_moment):
        """Return the constants for principal moments (I1, I2, I3) and a static moment.

        Numbers, or arrays with one entry per ensemble member.
        """
        return mass_properties(moments, static_moment)


def mass_properties(moments, static_moment):
    """Return the MassProperties for principal moments (I1, I2, I3) and a static moment."""
    (one, two, three), (x, y, z) = moments, static_moment
    # two divisions each: the product I2 I3 would underflow for a body of nanometres
    a1, a2, a3 = (two - three) / two / three, (three - one) / three / one, (one - two) / one / two
    return MassProperties(1.0 / one, 1.0 / two, 1.0 / three, a1, a2, a3, x, y, z, ())


def angular_velocity(body, l):
    """Return omega_i = L_i/I_i [rad/s]."""
    return body.i1 * l[0], body.i2 * l[1], body.i3 * l[2]


def kinetic_energy(body, l):
    """Return T = 1/2 sum L_i^2/I_i [J], TdC (3.16)."""
    return 0.5 * (body.i1 * l[0] * l[0] + body.i2 * l[1] * l[1] + body.i3 * l[2] * l[2])


def free_rate(body, l):
    """Return dL/dt = L x omega for a free body, TdC (3.35)."""
    # Coefficients a_i = (I_j - I_k)/(I_j I_k): differences of omega_i L_j would cancel for nearly
    # equal moments.
    return body.a1 * l[1] * l[2], body.a2 * l[2] * l[0], body.a3 * l[0] * l[1]


class Rates(NamedTuple):
    """The coefficients of a body over a time h.

    w1, w2, w3 : h/(2 I_i), for the attitude
    a1, a2, a3 : h a_i, for the momentum
    """

    w1: float
    w2: float
    w3: float
    a1: float
    a2: float
    a3: float


def scaled(body, h):
    """Return the Rates of a body over h."""
    w1, w2, w3 = 0.5 * h * body.i1, 0.5 * h * body.i2, 0.5 * h * body.i3
    return Rates(w1, w2, w3, h * body.a1, h * body.a2, h * body.a3)


def half_rotation(rates, l):
    """Return h omega/2, half the rotation vector over a time h."""
    return rates.w1 * l[0], rates.w2 * l[1], rates.w3 * l[2]


def add_free_change(rates, onto, l):
    """Return onto + h L x omega: `onto` plus the free change of the momentum at l.

    Numbers after the three components of `onto` do not change.
    """
    if len(onto) > 3:
        return add_free_change(rates, first_three(onto), l) + onto[3:]
    return (
        onto[0] + rates.a1 * (l[1] * l[2]),
        onto[1] + rates.a2 * (l[2] * l[0]),
        onto[2] + rates.a3 * (l[0] * l[1]),
    )
