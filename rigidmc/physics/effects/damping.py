"""Damping: isotropic, per axis, by a matrix, quadratic; and dry friction."""

import math
from typing import Any, NamedTuple

from rigidmc.physics.dynamics.euler import angular_velocity
from rigidmc.physics.dynamics.so3 import axpy, cross, dot, expm1, root, scale, symmetric_times
from rigidmc.physics.effects.protocol import Number, Vector, effect


@effect(
    units={"rate": "s-1"},
    limits={"rate": (-math.inf, math.inf)},
    example=(0.3,),
    is_damping=True,
    isotropic=True,
)
class ViscousDamping(NamedTuple):
    """Isotropic viscous damping of the angular momentum.

    Torque::

        tau = -rate L,   alone: L(t) = exp(-rate t) L(0)

    A damped free body follows its undamped motion, at the time (1 - exp(-rate t))/rate.

    Parameters
    ----------
    rate : quantity [1/s]
        damping rate

    Examples
    --------
    >>> rm.ViscousDamping(0.5).torque((1.0, 2.0, 4.0))
    (-0.5, -1.0, -2.0)
    """

    rate: Number

    def torque(self, l):
        return scale(-self.rate, l)

    def kick(self, h, l):
        # l + (exp(-x) - 1) l, not exp(-x) l: for small x the factor 1 - x would lose digits.
        return axpy(l, expm1(-self.rate * h), l)


@effect(
    units={"rates": "s-1"},
    shapes={"rates": 3},
    limits={"rates": (-math.inf, math.inf)},
    along_axes=("rates",),
    example=((0.3, 0.1, 0.6),),
    is_damping=True,
)
class AxialDamping(NamedTuple):
    """Viscous damping with one rate per principal axis, as in a viscous fluid.

    Torque::

        tau_i = -rate_i L_i,   alone: L_i(t) = exp(-rate_i t) L_i(0)

    Parameters
    ----------
    rates : quantities (3,) [1/s]
        damping rates about the principal axes; for a body described in other axes, use
        `MatrixDamping`

    Examples
    --------
    >>> rm.AxialDamping((0.5, 0.25, 1.0)).torque((1.0, 2.0, 4.0))
    (-0.5, -0.5, -4.0)
    """

    rates: Vector

    def torque(self, l):
        return -self.rates[0] * l[0], -self.rates[1] * l[1], -self.rates[2] * l[2]

    def kick(self, h, l):
        return (
            l[0] + expm1(-self.rates[0] * h) * l[0],
            l[1] + expm1(-self.rates[1] * h) * l[1],
            l[2] + expm1(-self.rates[2] * h) * l[2],
        )


@effect(
    units={"matrix": "kg m2 s-1"},
    shapes={"matrix": 6},
    in_body=("matrix",),
    limits={"matrix": (-math.inf, math.inf)},
    example=((0.5, 0.4, 0.6, 0.1, -0.05, 0.15),),
    kick_order=2,
)
class MatrixDamping(NamedTuple):
    """Viscous damping by a full matrix; its axes may differ from the body axes.

    Torque::

        tau = -C omega

    Its kick is the trapezoidal rule, of order 2.

    Parameters
    ----------
    matrix : quantities (6,) [N m s]
        xx, yy, zz, yz, zx, xy of the symmetric C, in body axes

    Examples
    --------
    >>> oil = rm.MatrixDamping((0.02, 0.03, 0.02, 0.0, 0.0, 0.01))
    >>> scene = rm.Scene(rm.Body.from_moments((1.0, 2.0, 2.5)), oil)
    """

    matrix: Vector

    def is_driving(self) -> Any:
        """Return whether the damping drives some spin: a principal minor of C is negative.

        Minors of C in units of its trace count as negative beyond rounding. Arrays of matrices are
        allowed.
        """
        # Rounding of the minors is 1e-16 in units of the trace; 1e-14 accepts a matrix that is
        # singular by construction.
        size = abs(self.matrix[0]) + abs(self.matrix[1]) + abs(self.matrix[2])
        # with no diagonal, any unit works: the other elements decide
        x, y, z, yz, zx, xy = (m / (size + (size == 0)) for m in self.matrix)
        pairs = (x * y - xy * xy < -1e-14) | (y * z - yz * yz < -1e-14) | (z * x - zx * zx < -1e-14)
        whole = x * y * z + 2 * xy * yz * zx - x * yz * yz - y * zx * zx - z * xy * xy
        return (x < 0) | (y < 0) | (z < 0) | pairs | (whole < -1e-14)

    def torque(self, body, l):
        return scale(-1.0, symmetric_times(self.matrix, angular_velocity(body, l)))

    def kick(self, body, h, l):
        x, y, z = 0.5 * h * body.i1, 0.5 * h * body.i2, 0.5 * h * body.i3
        m = self.matrix
        right_side = axpy(l, -1.0, symmetric_times(m, (x * l[0], y * l[1], z * l[2])))
        return _solved(
            (1.0 + m[0] * x, m[5] * x, m[4] * x),
            (m[5] * y, 1.0 + m[1] * y, m[3] * y),
            (m[4] * z, m[3] * z, 1.0 + m[2] * z),
            right_side,
        )


@effect(
    units={"drag": "kg m2"},
    limits={"drag": (-math.inf, math.inf)},
    example=(0.3,),
    is_damping=True,
    isotropic=True,
    kick_order=2,
)
class QuadraticDrag(NamedTuple):
    """Drag proportional to the square of the spin, as in air.

    Torque::

        tau = -drag |omega| omega

    Alone, about a principal axis, omega(t) = omega(0)/(1 + drag omega(0) t/I).
    Its kick is a rule of order 2.

    Parameters
    ----------
    drag : quantity [N m s^2]
        coefficient

    Examples
    --------
    >>> scene = rm.Scene(rm.Body.from_moments((1.0, 2.0, 2.5)), rm.QuadraticDrag(0.01))
    >>> scene.effects
    (QuadraticDrag(drag=0.01),)
    """

    drag: Number

    def torque(self, body, l):
        w = angular_velocity(body, l)
        return scale(-self.drag * root(dot(w, w)), w)

    def kick(self, body, h, l):
        w = angular_velocity(body, l)
        w = angular_velocity(body, _damped(body, 0.5 * h * self.drag * root(dot(w, w)), l))
        return _damped(body, h * self.drag * root(dot(w, w)), l)


@effect(
    units={"friction": "N m", "rest": "rad s-1"},
    limits={"friction": (-math.inf, math.inf), "rest": (1e-300, math.inf)},  # rest: any above 0
    example=(0.4, 0.1),
    is_damping=True,
    isotropic=True,
    kick_order=2,
)
class DryFriction(NamedTuple):
    """Coulomb friction of the pivot, smoothed at rest.

    Torque::

        tau = -friction omega / sqrt(|omega|^2 + rest^2)

    Its size is constant while `|omega|` is well above `rest`; below it is viscous, friction/rest
    times omega. Real dry friction would hold a body against a small torque; here the body creeps,
    at `rest` or slower under a torque of 0.7 of the friction. Its kick is a rule of order 2.

    Parameters
    ----------
    friction : quantity [N m]
        torque of the sliding pivot
    rest : quantity [rad/s]
        spin below which the friction is smoothed

    Examples
    --------
    >>> pivot = rm.DryFriction(friction=1e-3, rest=0.01)
    >>> scene = rm.Scene(rm.Body.from_moments((1.0, 1.0, 0.5)), pivot)
    """

    friction: Number
    rest: Number

    def torque(self, body, l):
        w = angular_velocity(body, l)
        return scale(-self.friction / root(dot(w, w) + self.rest * self.rest), w)

    def kick(self, body, h, l):
        w = angular_velocity(body, l)
        # A half step gives the rate in the middle, which makes the rule order 2.
        half = 0.5 * h * self.friction / root(dot(w, w) + self.rest * self.rest)
        w = angular_velocity(body, _damped(body, half, l))
        return _damped(body, h * self.friction / root(dot(w, w) + self.rest * self.rest), l)


def _damped(body, c, l):
    """Return L after dL/dt = -c omega over unit time, by the trapezoidal rule, of order 2.

    Each component is multiplied by (1 - c/2I)/(1 + c/2I), which lies between -1 and 1 if c > 0.
    """
    # Each component shrinks for any c > 0; with the explicit rule it would grow for c > 2I.
    x, y, z = 0.5 * c * body.i1, 0.5 * c * body.i2, 0.5 * c * body.i3
    return (1.0 - x) / (1.0 + x) * l[0], (1.0 - y) / (1.0 + y) * l[1], (1.0 - z) / (1.0 + z) * l[2]


def _solved(a, b, c, v):
    """Solve (a b c) x = v by Cramer's rule; a, b, c are the columns of the matrix."""
    # Cramer's rule has no branch. The matrix is 1 + C/2I, well conditioned for damping.
    n = cross(b, c)
    r = 1.0 / dot(a, n)
    return scale(r, (dot(v, n), dot(v, cross(c, a)), dot(v, cross(a, b))))
