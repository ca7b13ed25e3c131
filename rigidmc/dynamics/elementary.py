"""Sine, cosine, arctangent and exp(x) - 1 in straight code: no branch, no library call.

They work in the precision of their argument. `rigidmc.dynamics.functions` builds the other
functions of analysis on them.
"""

import math

from rigidmc.dynamics.scalars import by_precision, larger, rounded, select, smaller

# pi/2 in three parts of 33, 33 and 53 bits (Cody & Waite; the parts of fdlibm's e_rem_pio2): n*part
# is exact for n < 2^20; beyond that the error is the rounding error of the argument itself.
_HALF_PI = 1.57079632673412561417e00, 6.07710050630396597660e-11, 2.02226624879595063154e-21
# the same in parts of 8, 11 and 24 bits for float32 (Cephes, sinf)
_HALF_PI_SINGLE = 1.5703125, 4.837512969970703e-04, 7.54978995489188e-08
_TWO_OVER_PI = 0.63661977236758134308
_EIGHTH = 0.41421356237309503  # tan(pi/8)


def sincos_small(r):
    """(sin r, cos r) for |r| <= pi/4, by the polynomials of fdlibm's k_sin and k_cos."""
    z = r * r
    p = -2.50507602534068634195e-08 + z * 1.58969099521155010221e-10
    p = 2.75573137070700676789e-06 + z * p
    p = -1.98412698298579493134e-04 + z * p
    p = 8.33333333332248946124e-03 + z * p
    p = -1.66666666666666324348e-01 + z * p
    s = r + r * z * p
    p = 2.08757232129817482790e-09 - z * 1.13596475577881948265e-11
    p = -2.75573143513906633035e-07 + z * p
    p = 2.48015872894767294178e-05 + z * p
    p = -1.38888888888741095749e-03 + z * p
    p = 4.16666666666666019037e-02 + z * p
    c = 1.0 - (0.5 * z - z * z * p)
    return s, c


def sincos(x):
    """(sin x, cos x), |error| <= 1.8e-16 for |x| < 1e6 (tests/dynamics/test_functions.py).

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


def expm1(x):
    """exp(x) - 1, relative error <= 1e-15 for x < 0, and 1.4e-14 for x < 20.

    Series of degree 9 at x/256, then e <- e (2 + e) eight times. The next term of the series is
    (x/256)^9/10! of x, and exp(x) is below rounding for x < -44. Errors: see
    tests/dynamics/test_functions.py.
    """
    y = larger(x, -44.0) * 0.00390625
    p = 1 / 5040 + y * (1 / 40320 + y / 362880)
    p = 1 / 120 + y * (1 / 720 + y * p)
    p = 1 / 6 + y * (1 / 24 + y * p)
    e = y * (1.0 + y * (1 / 2 + y * p))
    e = e * (2.0 + e)
    e = e * (2.0 + e)
    e = e * (2.0 + e)
    e = e * (2.0 + e)
    e = e * (2.0 + e)
    e = e * (2.0 + e)
    e = e * (2.0 + e)
    return e * (2.0 + e)


def arctan2(y, x):
    """atan2(y, x), |relative error| <= 3.1e-16 (tests/dynamics/test_functions.py); 0 for (0, 0)."""
    a, b = abs(y), abs(x)
    low, high = smaller(a, b), larger(a, b)
    # of (0, 0): 0 by anything is 0, in any unit
    high = select(high > 0.0, high, 1.0)
    far = low > _EIGHTH * high
    z = select(far, low - high, low) / select(far, high + low, high)
    w = z * z
    # atan z = z + z^3 P(z^2) for |z| <= tan(pi/8), P by interpolation at the Chebyshev nodes:
    # relative error 7e-18
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
