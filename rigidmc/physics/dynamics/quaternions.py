"""Quaternions, the rotations of unit quaternions, and sums that lose no digits.

Conventions as in `rigidmc.physics.dynamics.so3`.

Over many short steps each change of a state is small, and rounding it to the digits of the state
loses most of it. A compensated state is therefore a pair (value, remainder), whose exact sum is the
state. `add_compensated`, `add_compensated4` and `apply_rotation` accept such a pair, or a plain
3-vector or quaternion, for which they round as usual.
"""

import math

from rigidmc.physics.dynamics.functions import sincos
from rigidmc.physics.dynamics.vectors import add, cross, dot, scale, select


def add4(a, b):
    """Return a + b for quaternions."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3]


def difference4(a, b):
    """Return a - b for quaternions."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2], a[3] - b[3]


def scale4(s, a):
    """Return s*a for a number and a quaternion."""
    return s * a[0], s * a[1], s * a[2], s * a[3]


def axpy4(a, s, b):
    """Return a + s*b for quaternions."""
    return a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2], a[3] + s * b[3]


def multiply(p, q):
    """Return the Hamilton product p q."""
    return (
        p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3],
        p[0] * q[1] + p[1] * q[0] + p[2] * q[3] - p[3] * q[2],
        p[0] * q[2] + p[2] * q[0] + p[3] * q[1] - p[1] * q[3],
        p[0] * q[3] + p[3] * q[0] + p[1] * q[2] - p[2] * q[1],
    )


def conjugate(q):
    """Return the inverse of a unit quaternion."""
    return q[0], -q[1], -q[2], -q[3]


def exponential(u):
    """Return exp(u/2) as a unit quaternion: the rotation by |u| about u.

    Accurate to rounding for |u| < 1e6, including 0.
    """
    angle = math.sqrt(dot(u, u))
    s, c = sincos(0.5 * angle)
    # The limit for angle 0 is 1/2; the quotient is then unused, and the divisor 1 keeps it finite.
    r = select(angle > 0.0, s / select(angle > 0.0, angle, 1.0), 0.5)
    return c, r * u[0], r * u[1], r * u[2]


def spin(p, w):
    """Return p (0, w): the change of attitude over a time h if w = h omega/2."""
    return (
        -p[1] * w[0] - p[2] * w[1] - p[3] * w[2],
        p[0] * w[0] + p[2] * w[2] - p[3] * w[1],
        p[0] * w[1] + p[3] * w[0] - p[1] * w[2],
        p[0] * w[2] + p[1] * w[1] - p[2] * w[0],
    )


def advance_attitude(q, p, w):
    """Return q + p (0, w), by fused multiply-adds.

    With w = h omega/2 this is q + h dq/dt, with the rate at the attitude p: dq/dt = 1/2 p (0,
    omega).
    """
    return (
        q[0] - p[1] * w[0] - p[2] * w[1] - p[3] * w[2],
        q[1] + p[0] * w[0] + p[2] * w[2] - p[3] * w[1],
        q[2] + p[0] * w[1] + p[3] * w[0] - p[1] * w[2],
        q[3] + p[0] * w[2] + p[1] * w[1] - p[2] * w[0],
    )


def vertical(q):
    """Return the space z axis in body components: the third row of A.

    (2 (xz - wy), 2 (yz + wx), w^2 - x^2 - y^2 + z^2)
    """
    return (
        2.0 * (q[1] * q[3] - q[0] * q[2]),
        2.0 * (q[2] * q[3] + q[0] * q[1]),
        q[0] * q[0] - q[1] * q[1] - q[2] * q[2] + q[3] * q[3],
    )


def into_body(q, v):
    """Return the body components A^T v of a vector v in space components."""
    r, w = (q[1], q[2], q[3]), 2.0 * q[0]
    s = cross(r, v)
    t = cross(r, s)
    return v[0] - w * s[0] + 2.0 * t[0], v[1] - w * s[1] + 2.0 * t[1], v[2] - w * s[2] + 2.0 * t[2]


def rotated(u, l):
    """Rotate L by |u| about u: the flow of dL/dt = u x L over unit time."""
    return into_body(conjugate(exponential(u)), l)


def normalised(q):
    """Return q/|q|."""
    r = 1.0 / math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    return r * q[0], r * q[1], r * q[2], r * q[3]


def touch_up(q):
    """Return q (3 - |q|^2)/2: a Newton step to |q| = 1.

    Exact to rounding if |q|^2 is within 1e-8 of 1 (tests/physics/dynamics/test_series.py).
    """
    r = 1.5 - 0.5 * (q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    return r * q[0], r * q[1], r * q[2], r * q[3]


def renormalise(q):
    """Return q/|q| by two Newton steps, without root or division.

    Exact to rounding if |q| is within 1e-4 of 1; the error is 3.4e-12 at 1e-3
    (tests/physics/dynamics/test_series.py).
    """
    n = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]
    r = 1.5 - 0.5 * n
    r = r * (1.5 - 0.5 * (n * r) * r)
    return r * q[0], r * q[1], r * q[2], r * q[3]


def inverse_near_three(q):
    """Return 1/|q| for a quaternion of norm about 3, by two Newton steps, with no root or division.

    Exact to rounding if | |q|/3 - 1 | < 1e-4 (tests/physics/dynamics/test_series.py).
    """
    s = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]
    r = 1.5 - (1.0 / 18.0) * s
    return r * (0.5 - ((1.0 / 54.0) * s) * (r * r))


def divide_by_three(q):
    """Return q/|q| for a quaternion of norm about 3; see `inverse_near_three`."""
    return scale4(inverse_near_three(q), q)


def value_of(x):
    """Return the value of a state: of a pair (value, remainder), its value."""
    if len(x) == 2:
        return x[0]
    return x


def two_sum(a, b):
    """Return (s, e): s is the rounded sum, and s + e = a + b exactly.

    Source: Knuth, The Art of Computer Programming 2, 4.2.2.
    """
    s = a + b
    # Six additions; the fast variant branches on which operand is larger.
    c = s - a
    return s, (a - (s - c)) + (b - c)


def add_compensated(l, dl):
    """Return l + dl for 3-vectors.

    For a pair (value, remainder), return the pair of the sum, which loses nothing of dl.
    """
    if len(l) == 2:
        value, remainder = l
        x, dx = two_sum(value[0], dl[0] + remainder[0])
        y, dy = two_sum(value[1], dl[1] + remainder[1])
        z, dz = two_sum(value[2], dl[2] + remainder[2])
        return (x, y, z), (dx, dy, dz)
    return add(l, dl)


def add_compensated4(q, dq):
    """Return q + dq normalised; for a pair (value, remainder), the pair of the sum."""
    if len(q) == 2:
        value, remainder = q
        a, da = two_sum(value[0], dq[0] + remainder[0])
        b, db = two_sum(value[1], dq[1] + remainder[1])
        c, dc = two_sum(value[2], dq[2] + remainder[2])
        d, dd = two_sum(value[3], dq[3] + remainder[3])
        # a change along q restores the norm and keeps the attitude
        r = 0.5 - 0.5 * (a * a + b * b + c * c + d * d)
        # 1/|q| - 1 to the second order in 1 - |q|^2.
        r = r + 1.5 * r * r
        a, da = two_sum(a, r * a + da)
        b, db = two_sum(b, r * b + db)
        c, dc = two_sum(c, r * c + dc)
        d, dd = two_sum(d, r * d + dd)
        return (a, b, c, d), (da, db, dc, dd)
    return renormalise(add4(q, dq))


def apply_rotation(q, rotation):
    """Return q rotation for unit quaternions, the rotation in body axes.

    For a pair (value, remainder), return the pair.
    """
    if len(q) == 2:
        value, rest = q
        # rotation - 1 without cancellation; -rotation is the same turn, so the scalar can be >= 0
        sign = select(rotation[0] < 0.0, -1.0, 1.0)
        x, y, z = scale(sign, rotation[1:])
        # cos - 1 as -sin^2/(1 + cos): the divisor is 1 or more, and nothing cancels
        change = -(x * x + y * y + z * z) / (1.0 + abs(rotation[0])), x, y, z
        return add_compensated4(q, add4(multiply(value, change), multiply(rest, change)))
    return touch_up(multiply(q, rotation))
