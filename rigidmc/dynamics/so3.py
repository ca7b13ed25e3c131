"""Rotations for kernels: vectors, unit quaternions (scalar first, body -> space), sine and cosine without branches.

Conventions: A = R(q) maps body to space components, columns of A are the body axes (TdC (3.1)-(3.5));
q and -q are one attitude; a product `multiply(p, q)` turns by q first, then by p.
"""

import math

import numpy as np

# pi/2 in three parts of 33, 33 and 53 bits (Cody & Waite; the parts of fdlibm's e_rem_pio2): n*part is exact for n < 2^20,
# beyond it the error is that of the rounded argument itself.
_HALF_PI = 1.57079632673412561417e00, 6.07710050630396597660e-11, 2.02226624879595063154e-21
_TWO_OVER_PI = 0.63661977236758134308
_EIGHTH = 0.41421356237309503  # tan(pi/8)
_HALF_PI_SINGLE = (
    1.5703125,
    4.837512969970703e-04,
    7.54978995489188e-08,
)  # in parts of 8, 11 and 24 bits (Cephes, sinf)


def select(condition, a, b):
    """`a if condition else b`, both evaluated: a blend where many members are worked on, never a branch; of arrays, element by element."""
    if isinstance(condition, np.ndarray):
        return np.where(condition, a, b)
    return a if condition else b


def opposite(condition):
    """`not condition`, of a mask too."""
    return not condition


def by_precision(x, double, single):
    """One of two constants: the first, or where x is a number of float32 the second."""
    return double


def rounded(x):
    """The integer next to x, |x| < 2^51 (2^22 in float32), with no call of a library: large enough a number has no digits after its point."""
    large = by_precision(x, 6755399441055744.0, 12582912.0)
    return (x + large) - large


def root(x):
    """The square root of a number, or of the numbers of an array."""
    return np.sqrt(x)


def larger(a, b):
    """The larger of two numbers, or of those of arrays."""
    return select(b > a, b, a)


def smaller(a, b):
    """The smaller of two numbers, or of those of arrays."""
    return select(b < a, b, a)


def select_each(condition, a, b):
    """`select` of each number of two tuples."""
    return tuple(select(condition, x, y) for x, y in zip(a, b, strict=True))


def dot(a, b):
    """Scalar product of two 3-vectors."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a, b):
    """Vector product of two 3-vectors."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def first_three(a):
    """A 3-vector without what follows it."""
    if len(a) == 3:
        return a
    return a[0], a[1], a[2]


def joined(a, more):
    """A tuple and what is to follow it."""
    if len(more) == 0:
        return a
    return a + more


# What follows a momentum is the work that effects have done (`rigidmc.effects.ledger`): the sums below keep it, what is missing is 0.


def rest_scaled(s, a):
    """s times each number of a tuple."""
    if len(a) == 0:
        return ()
    return (s * a[0],) + rest_scaled(s, a[1:])


def rest_axpy(a, s, b):
    """a + s*b of tuples of any lengths."""
    if len(b) == 0:
        return a
    if len(a) == 0:
        return rest_scaled(s, b)
    return (a[0] + s * b[0],) + rest_axpy(a[1:], s, b[1:])


def add(a, b):
    """Sum of two 3-vectors and of what follows them."""
    if len(a) > 3:
        return (a[0] + b[0], a[1] + b[1], a[2] + b[2]) + rest_axpy(a[3:], 1.0, b[3:])
    if len(b) > 3:
        return (a[0] + b[0], a[1] + b[1], a[2] + b[2]) + b[3:]
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def add4(a, b):
    """Sum of two quaternions."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3]


def difference(a, b):
    """a - b of two 3-vectors and of what follows them."""
    if len(a) > 3:
        return (a[0] - b[0], a[1] - b[1], a[2] - b[2]) + rest_axpy(a[3:], -1.0, b[3:])
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def difference4(a, b):
    """a - b of two quaternions."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2], a[3] - b[3]


def scale(s, a):
    """s*a of a number and a 3-vector with what follows it."""
    if len(a) > 3:
        return (s * a[0], s * a[1], s * a[2]) + rest_scaled(s, a[3:])
    return s * a[0], s * a[1], s * a[2]


def scale4(s, a):
    """s*a of a number and a quaternion."""
    return s * a[0], s * a[1], s * a[2], s * a[3]


def axpy(a, s, b):
    """a + s*b of two 3-vectors and of what follows them."""
    if len(b) > 3:
        return (a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]) + rest_axpy(a[3:], s, b[3:])
    if len(a) > 3:
        return (a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]) + a[3:]
    return a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]


def axpy4(a, s, b):
    """a + s*b of two quaternions."""
    return a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2], a[3] + s * b[3]


def multiply(p, q):
    """Hamilton product p q."""
    return (
        p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3],
        p[0] * q[1] + p[1] * q[0] + p[2] * q[3] - p[3] * q[2],
        p[0] * q[2] + p[2] * q[0] + p[3] * q[1] - p[1] * q[3],
        p[0] * q[3] + p[3] * q[0] + p[1] * q[2] - p[2] * q[1],
    )


def conjugate(q):
    """The inverse of a unit quaternion."""
    return q[0], -q[1], -q[2], -q[3]


def normalised(q):
    """q/|q|."""
    r = 1.0 / math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    return r * q[0], r * q[1], r * q[2], r * q[3]


def spin(p, w):
    """p (0, w): with w = h omega/2 the change of attitude over h."""
    return (
        -p[1] * w[0] - p[2] * w[1] - p[3] * w[2],
        p[0] * w[0] + p[2] * w[2] - p[3] * w[1],
        p[0] * w[1] + p[3] * w[0] - p[1] * w[2],
        p[0] * w[2] + p[1] * w[1] - p[2] * w[0],
    )


def turned(q, p, w):
    """q + p (0, w), in fused multiply-adds: with w = h omega/2 the change of attitude over h at the rate of p, dq/dt = 1/2 q (0, omega)."""
    return (
        q[0] - p[1] * w[0] - p[2] * w[1] - p[3] * w[2],
        q[1] + p[0] * w[0] + p[2] * w[2] - p[3] * w[1],
        q[2] + p[0] * w[1] + p[3] * w[0] - p[1] * w[2],
        q[3] + p[0] * w[2] + p[1] * w[1] - p[2] * w[0],
    )


def up(q):
    """The space z axis in body components, third row of A: (2(xz - wy), 2(yz + wx), w^2 - x^2 - y^2 + z^2)."""
    return (
        2.0 * (q[1] * q[3] - q[0] * q[2]),
        2.0 * (q[2] * q[3] + q[0] * q[1]),
        q[0] * q[0] - q[1] * q[1] - q[2] * q[2] + q[3] * q[3],
    )


def into_body(q, v):
    """The body components of a vector of space, A^T v."""
    r, w = (q[1], q[2], q[3]), 2.0 * q[0]
    s = cross(r, v)
    t = cross(r, s)
    return v[0] - w * s[0] + 2.0 * t[0], v[1] - w * s[1] + 2.0 * t[1], v[2] - w * s[2] + 2.0 * t[2]


def third_of(q):
    """1/|q| for a quaternion of norm about 3: two Newton steps, exact to rounding when | |q|/3 - 1 | < 1e-4; no root, no division."""
    s = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]
    r = 1.5 - (1.0 / 18.0) * s
    return r * (0.5 - ((1.0 / 54.0) * s) * (r * r))


def third(q):
    """q/|q| for a quaternion of norm about 3."""
    return scale4(third_of(q), q)


def touch_up(q):
    """q (3 - |q|^2)/2: one Newton step to |q| = 1, exact to rounding when |q|^2 is within 1e-8 of 1."""
    r = 1.5 - 0.5 * (q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    return r * q[0], r * q[1], r * q[2], r * q[3]


def renewed(q):
    """q/|q| by two Newton steps: exact to rounding when |q| is within 1e-4 of 1, off by 4e-6 at 1e-3; no root, no division."""
    n = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]
    r = 1.5 - 0.5 * n
    r = r * (1.5 - 0.5 * (n * r) * r)
    return r * q[0], r * q[1], r * q[2], r * q[3]


def whole(x):
    """The value of a state: of a pair (value, remainder) the value."""
    if len(x) == 2:
        return x[0]
    return x


def two_sum(a, b):
    """(s, e) with s + e = a + b exactly, s the rounded sum (Knuth, The Art of Computer Programming 2, 4.2.2)."""
    s = a + b
    c = s - a
    return s, (a - (s - c)) + (b - c)


def gain(l, dl):
    """l + dl of 3-vectors; of a pair (value, remainder) the pair of the sum, so that nothing of dl is lost."""
    if len(l) == 2:
        value, rest = l
        x, dx = two_sum(value[0], dl[0] + rest[0])
        y, dy = two_sum(value[1], dl[1] + rest[1])
        z, dz = two_sum(value[2], dl[2] + rest[2])
        return (x, y, z), (dx, dy, dz)
    return add(l, dl)


def gain4(q, dq):
    """q + dq of quaternions, brought back to |q| = 1; of a pair (value, remainder) the pair of the sum."""
    if len(q) == 2:
        value, rest = q
        a, da = two_sum(value[0], dq[0] + rest[0])
        b, db = two_sum(value[1], dq[1] + rest[1])
        c, dc = two_sum(value[2], dq[2] + rest[2])
        d, dd = two_sum(value[3], dq[3] + rest[3])
        r = 0.5 - 0.5 * (
            a * a + b * b + c * c + d * d
        )  # a change along q: the norm returns, the attitude stays
        r = r + 1.5 * r * r
        a, da = two_sum(a, r * a + da)
        b, db = two_sum(b, r * b + db)
        c, dc = two_sum(c, r * c + dc)
        d, dd = two_sum(d, r * d + dd)
        return (a, b, c, d), (da, db, dc, dd)
    return renewed(add4(q, dq))


def moved(q, turn):
    """q turn, for a unit quaternion `turn` in the body; of a pair (value, remainder) the pair of the product."""
    if len(q) == 2:
        value, rest = q
        # turn - 1 without cancellation; -turn is the same turn and never near -1
        sign = select(turn[0] < 0.0, -1.0, 1.0)
        x, y, z = scale(sign, turn[1:])
        less = -(x * x + y * y + z * z) / (1.0 + abs(turn[0])), x, y, z
        return gain4(q, add4(multiply(value, less), multiply(rest, less)))
    return touch_up(multiply(q, turn))


def sincos_small(r):
    """(sin r, cos r) for |r| <= pi/4 by the polynomials of fdlibm's k_sin and k_cos."""
    z = r * r
    s = r + r * z * (
        -1.66666666666666324348e-01
        + z
        * (
            8.33333333332248946124e-03
            + z
            * (
                -1.98412698298579493134e-04
                + z
                * (
                    2.75573137070700676789e-06
                    + z * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10)
                )
            )
        )
    )
    c = 1.0 - (
        0.5 * z
        - z
        * z
        * (
            4.16666666666666019037e-02
            + z
            * (
                -1.38888888888741095749e-03
                + z
                * (
                    2.48015872894767294178e-05
                    + z
                    * (
                        -2.75573143513906633035e-07
                        + z * (2.08757232129817482790e-09 - z * 1.13596475577881948265e-11)
                    )
                )
            )
        )
    )
    return s, c


def sincos(x):
    """(sin x, cos x) without branch or libm call, |error| <= 1.6e-16 for |x| < 1e6.

    Cody-Waite reduction to [-pi/4, pi/4], then `sincos_small`.
    """
    n = rounded(x * _TWO_OVER_PI)
    one, two, three = by_precision(x, _HALF_PI, _HALF_PI_SINGLE)
    s, c = sincos_small(((x - n * one) - n * two) - n * three)
    quarter = n - 4.0 * rounded(n * 0.25)  # n mod 4 as -2, -1, 0, 1, 2
    odd = abs(quarter) == 1.0
    half = abs(quarter) == 2.0
    sine = select(odd, c, s)
    cosine = select(odd, s, c)
    sine = select((quarter == -1.0) | half, -sine, sine)
    cosine = select((quarter == 1.0) | half, -cosine, cosine)
    return sine, cosine


def exponential(u):
    """exp(u/2) as a unit quaternion: the turn by |u| about u. Accurate to rounding for every |u| < 1e6, 0 included."""
    angle = math.sqrt(dot(u, u))
    s, c = sincos(0.5 * angle)
    r = select(angle > 0.0, s / select(angle > 0.0, angle, 1.0), 0.5)
    return c, r * u[0], r * u[1], r * u[2]


def expm1(x):
    """exp(x) - 1 without branch or libm call, relative error <= 7e-16 for -44 < x < 0 (below, it is -1 to rounding), 9e-15 at 20.

    Series of degree 9 at x/256, then e <- e (2 + e) eight times. The next term is 3e-22 of x at |x| = 1 and 3e-14 at 44, where
    nothing of it is left for x < 0.
    """
    y = larger(x, -44.0) * 0.00390625
    e = y * (
        1.0
        + y
        * (
            1 / 2
            + y
            * (
                1 / 6
                + y
                * (
                    1 / 24
                    + y * (1 / 120 + y * (1 / 720 + y * (1 / 5040 + y * (1 / 40320 + y / 362880))))
                )
            )
        )
    )
    e = e * (2.0 + e)
    e = e * (2.0 + e)
    e = e * (2.0 + e)
    e = e * (2.0 + e)
    e = e * (2.0 + e)
    e = e * (2.0 + e)
    e = e * (2.0 + e)
    return e * (2.0 + e)


def arctan2(y, x):
    """atan2(y, x) without branch or libm call; |relative error| <= 3e-16; 0 for (0, 0)."""
    a, b = abs(y), abs(x)
    low, high = smaller(a, b), larger(a, b)
    high = select(high > 0.0, high, 1.0)
    far = low > _EIGHTH * high
    z = select(far, low - high, low) / select(far, high + low, high)
    w = z * z
    # atan z = z + z^3 P(z^2) on |z| <= tan(pi/8): interpolation at the Chebyshev nodes, relative error 7e-18
    p = 0.03923165829558719 + w * -0.01917688706911062
    p = -0.0508544973794026 + w * p
    p = 0.0585814891280221 + w * p
    p = -0.06664511447381948 + w * p
    p = 0.07692183190826087 + w * p
    p = -0.09090904578123903 + w * p
    p = 0.11111111015256361 + w * p
    p = -0.14285714284666542 + w * p
    p = 0.1999999999999552 + w * p
    p = -0.3333333333333333 + w * p
    angle = z + z * w * p + select(far, 0.25 * math.pi, 0.0)
    angle = select(a > b, 0.5 * math.pi - angle, angle)
    angle = select(x < 0.0, math.pi - angle, angle)
    return select(y < 0.0, -angle, angle)
