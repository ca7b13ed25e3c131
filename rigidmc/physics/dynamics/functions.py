"""Elementary functions in straight-line code, with the same bits on every machine.

+, -, *, /, roots and bit operations are the same everywhere; library functions differ in the last
digit. So these functions have no branch and no library call. Sine, cosine, arctangent and
exp(x) - 1 work in the precision of their argument; the others build on them and compute in float64.

Arguments are numbers or arrays, in compiled code also vectors of numbers. Errors in units of 1e-16,
relative unless stated otherwise: sin, cos 1.8 (absolute) for |x| < 1e6; exp, log 1.5; atan, asin,
acos 4; sinh 13; cosh 2.2; tanh 11; normal quantiles 9 (tests/physics/dynamics/test_functions.py).
Integer powers are products. Other powers are exp(y log x), with an error larger by the factor |y
log x|.

Sources: the logarithm is fdlibm's e_log; sine and cosine are its k_sin and k_cos; the quantiles are
AS 241, PPND16 (Wichura, Appl. Stat. 37 (1988) 477).
"""

import math
import struct

import numpy as np

from rigidmc.physics.dynamics.vectors import (
    by_precision,
    maximum,
    minimum,
    nearest_integer,
    root,
    select,
)

# ln 2 in two parts; the low 21 bits of the high part are 0, so its product with e is exact.
_LN2_HIGH, _LN2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10
_MANTISSA, _EXPONENT = np.uint64(0x000FFFFFFFFFFFFF), np.uint64(0x3FF0000000000000)
_SHIFT = np.uint64(52)


def as_float(word):
    """Return the float with the bits of a word."""
    if isinstance(word, np.ndarray):
        return word.view(np.float64)
    return struct.unpack("<d", struct.pack("<Q", int(word)))[0]


def as_word(number):
    """Return the bits of a float as a word."""
    if isinstance(number, np.ndarray):
        return np.ascontiguousarray(number, np.float64).view(np.uint64)
    return np.uint64(struct.unpack("<Q", struct.pack("<d", float(number)))[0])


def double(x):
    """Return x in float64."""
    return x


def as_given(result, x):
    """Return a float64 result in the precision of x."""
    return result


def logarithm(x):
    """Compute ln x for a finite x > 0 that is not subnormal."""
    word = as_word(x)
    m = as_float((word & _MANTISSA) | _EXPONENT)
    # the bits of the exponent as the low bits of the float 2^52 + exponent
    e = as_float((word >> np.uint64(52)) | np.uint64(0x4330000000000000)) - 4503599627370496.0
    e = e - 1023.0
    # m in (1/sqrt 2, sqrt 2]: s = f/(2 + f) is then at most 0.172, and 7 terms are enough.
    large = m > 1.4142135623730951
    m, e = select(large, 0.5 * m, m), select(large, e + 1.0, e)
    f = m - 1.0
    s = f / (2.0 + f)
    z = s * s
    w = z * z
    even = 2.222219843214978396e-01 + w * 1.531383769920937332e-01
    even = 3.999999999940941908e-01 + w * even
    odd = 1.818357216161805012e-01 + w * 1.479819860511658591e-01
    odd = 2.857142874366239149e-01 + w * odd
    odd = 6.666666666666735130e-01 + w * odd
    r = w * even + z * odd
    half = 0.5 * f * f
    # fdlibm's order of sums: e ln 2 is exact in its high part, and the rest is small.
    return e * _LN2_HIGH - ((half - (s * (half + r) + e * _LN2_LOW)) - f)


def sine(x):
    """Compute sin x."""
    return sincos(x)[0]


def cosine(x):
    """Compute cos x."""
    return sincos(x)[1]


def tangent(x):
    """Compute tan x."""
    s, c = sincos(x)
    return s / c


def arctangent(x):
    """Compute atan x."""
    # 1 in the type of x: a vector, an array or float32
    return arctan2(x, 1.0 + 0.0 * x)


def power_of_two(n):
    """Compute 2^n for an integer from -1022 to 1023, the exponents of normal numbers (IEEE 754).

    The low bits of the float 2^52 + 1023 + n are shifted to the position of the exponent.
    """
    return as_float(as_word(n + (4503599627370496.0 + 1023.0)) << _SHIFT)


def exponential_of(x):
    """Compute exp x; inf above 709.79 and 0 below -745.2.

    Tested in tests/physics/dynamics/test_functions.py.
    """
    # without the limits the bits of the exponent wrap: exp(1500) would be 0, and exp(-1500) inf
    wide = minimum(maximum(double(x), -746.0), 710.0)
    n = nearest_integer(wide * 1.4426950408889634)
    r = (wide - n * _LN2_HIGH) - n * _LN2_LOW
    # |r| <= 0.347: the series of degree 13 leaves 4e-18
    p = 1 / 479001600 + r * (1 / 6227020800)
    p = 1 / 3628800 + r * (1 / 39916800 + r * p)
    p = 1 / 40320 + r * (1 / 362880 + r * p)
    p = 1 / 720 + r * (1 / 5040 + r * p)
    p = 1 / 24 + r * (1 / 120 + r * p)
    e = 1.0 + (r + r * r * (0.5 + r * (1 / 6 + r * p)))
    # 2^n in two factors, because 2^1024 and 2^-1074 are not normal numbers
    half = nearest_integer(0.5 * n)
    result = e * power_of_two(half) * power_of_two(n - half)
    return as_given(select(double(x) != double(x), double(x), result), x)


def logarithm_of(x):
    """Compute ln x; -inf at 0, nan below."""
    wide = double(x)
    small = wide < 2.2250738585072014e-308  # subnormal: x 2^54 has an exponent that can be read
    result = logarithm(select(small, wide * 18014398509481984.0, wide))
    # 54 ln 2: undoes the factor 2^54.
    result = result - select(small, 37.42994775023705, 0.0)
    result = select(wide == math.inf, wide, select(wide == 0.0, -math.inf, result))
    return as_given(select((wide < 0.0) | (wide != wide), math.nan, result), x)


def logarithm_of_one_and(x):
    """Compute ln(1 + x) for x > -1.

    It is x ln(y)/(y - 1) with the rounded y = 1 + x: rounding changes numerator and denominator in
    the same way.
    """
    y = 1.0 + x
    return select(y == 1.0, x, x * (logarithm_of(y) / select(y == 1.0, 1.0, y - 1.0)))


def hyperbolic_tangent(x):
    """Compute tanh x."""
    # tanh 20 is 1 - 8e-18, which rounds to 1; expm1 underflows nowhere below
    e = expm1(-2.0 * minimum(abs(x), 20.0))
    return select(x < 0.0, e / (e + 2.0), -e / (e + 2.0))


def hyperbolic_sine(x):
    """Compute sinh x."""
    e, small = exponential_of(abs(x)), expm1(minimum(abs(x), 1.0))
    # From 1 on, e^x - e^-x cancels by less than a digit; below, both parts come from exp(x) - 1.
    twice = select(abs(x) < 1.0, small + small / (1.0 + small), e - 1.0 / e)
    return select(x < 0.0, -0.5 * twice, 0.5 * twice)


def hyperbolic_cosine(x):
    """Compute cosh x."""
    e = exponential_of(abs(x))
    return 0.5 * (e + 1.0 / e)


def arcsine(x):
    """Compute asin x."""
    return arctan2(x, root((1.0 - x) * (1.0 + x)))


def arccosine(x):
    """Compute acos x."""
    return arctan2(root((1.0 - x) * (1.0 + x)), x)


def power(x, y):
    """Compute x^y for x > 0; 0 for x = 0 and y > 0, nan for x < 0."""
    return select(x == 0.0, select(y > 0.0, 0.0 * x, math.inf), exponential_of(y * logarithm_of(x)))


def hypotenuse(x, y):
    """Compute sqrt(x^2 + y^2) without overflow or underflow."""
    large = maximum(abs(x), abs(y))
    # for (0, 0): the quotient is 0 whatever the divisor
    small = minimum(abs(x), abs(y)) / select(large == 0.0, 1.0, large)
    return large * root(1.0 + small * small)


def whole_power(x, n):
    """Compute x^n for an integer n, by products."""
    result, base, left = 1.0 + 0.0 * x, x, abs(n)
    # The exponent belongs to the program, not to a member: a loop is allowed.
    while left > 0:
        if left % 2 == 1:
            result = result * base
        base = base * base
        left = left // 2
    return result if n >= 0 else 1.0 / result


# coefficients of numerator and denominator of a normal quantile: near the middle, and in sqrt(-ln
# u) up to 5 and beyond
_MIDDLE = (
    (2.5090809287301226727e+3, 3.3430575583588128105e+4, 6.7265770927008700853e+4,
     4.5921953931549871457e+4, 1.3731693765509461125e+4, 1.9715909503065514427e+3,
     1.3314166789178437745e+2, 3.3871328727963666080e0),
    (5.2264952788528545610e+3, 2.8729085735721942674e+4, 3.9307895800092710610e+4,
     2.1213794301586595867e+4, 5.3941960214247511077e+3, 6.8718700749205790830e+2,
     4.2313330701600911252e+1, 1.0),
)  # fmt: skip
_TAIL = (
    (7.74545014278341407640e-4, 2.27238449892691845833e-2, 2.41780725177450611770e-1,
     1.27045825245236838258e0, 3.64784832476320460504e0, 5.76949722146069140550e0,
     4.63033784615654529590e0, 1.42343711074968357734e0),
    (1.05075007164441684324e-9, 5.47593808499534494600e-4, 1.51986665636164571966e-2,
     1.48103976427480074590e-1, 6.89767334985100004550e-1, 1.67638483018380384940e0,
     2.05319162663775882187e0, 1.0),
)  # fmt: skip
_FAR = (
    (2.01033439929228813265e-7, 2.71155556874348757815e-5, 1.24266094738807843860e-3,
     2.65321895265761230930e-2, 2.96560571828504891230e-1, 1.78482653991729133580e0,
     5.46378491116411436990e0, 6.65790464350110377720e0),
    (2.04426310338993978564e-15, 1.42151175831644588870e-7, 1.84631831751005468180e-5,
     7.86869131145613259100e-4, 1.48753612908506148525e-2, 1.36929880922735805310e-1,
     5.99832206555887937690e-1, 1.0),
)  # fmt: skip


def _ratio(coefficients, x):
    """Return numerator over denominator, by Horner's rule, highest power first."""
    above, below = 0.0, 0.0
    for a, b in zip(*coefficients, strict=True):
        above, below = above * x + a, below * x + b
    return above / below


def normal_quantile(u):
    """Return x with probability u that a standard normal deviate is below x, 0 < u < 1.

    u : an array; compiled code needs no quantiles
    """
    # AS 241: three ratios, which meet at |u - 1/2| = 0.425 and at sqrt(-ln u) = 5. The logarithms
    # and two ratios of the tails are computed only in the tails, for 15 % of the numbers: 3.4 times
    # as fast for 65,536.
    q = np.subtract(u, 0.5)
    quantiles = np.asarray(q * _ratio(_MIDDLE, 0.180625 - q * q))
    is_far = np.abs(q) > 0.425
    far, u = q[is_far], np.asarray(u)[is_far]
    r = root(-logarithm(minimum(u, 1.0 - u)))
    tail = select(r <= 5.0, _ratio(_TAIL, r - 1.6), _ratio(_FAR, r - 5.0))
    quantiles[is_far] = select(far < 0.0, -tail, tail)
    return quantiles


# pi/2 in three parts of 33, 33 and 53 bits (Cody & Waite; the parts of fdlibm's e_rem_pio2): n*part
# is exact for n < 2^20; beyond that the error is the rounding error of the argument itself.
_HALF_PI = 1.57079632673412561417e00, 6.07710050630396597660e-11, 2.02226624879595063154e-21
# the same in parts of 8, 11 and 24 bits for float32 (Cephes, sinf)
_HALF_PI_SINGLE = 1.5703125, 4.837512969970703e-04, 7.54978995489188e-08
_TWO_OVER_PI = 0.63661977236758134308
_EIGHTH = 0.41421356237309503  # tan(pi/8)


def sincos_small(r):
    """Return (sin r, cos r) for |r| <= pi/4, by the polynomials of fdlibm's k_sin and k_cos."""
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
    """Return (sin x, cos x), with an error of at most 1.8e-16 for |x| < 1e6
    (tests/physics/dynamics/test_functions.py).

    Cody-Waite reduction to [-pi/4, pi/4], then `sincos_small`.
    """
    n = nearest_integer(x * _TWO_OVER_PI)
    one, two, three = by_precision(x, _HALF_PI, _HALF_PI_SINGLE)
    s, c = sincos_small(((x - n * one) - n * two) - n * three)
    quarter = n - 4.0 * nearest_integer(n * 0.25)  # n mod 4 as -2, -1, 0, 1, 2
    odd = abs(quarter) == 1.0
    half = abs(quarter) == 2.0
    sine = select(odd, c, s)
    cosine = select(odd, s, c)
    sine = select((quarter == -1.0) | half, -sine, sine)
    cosine = select((quarter == 1.0) | half, -cosine, cosine)
    return sine, cosine


def expm1(x):
    """Compute exp(x) - 1, relative error <= 1e-15 for x < 0, and 1.4e-14 for x < 20.

    Series of degree 9 at x/256, then e <- e (2 + e) eight times. The next term of the series is
    (x/256)^9/10! of x, and exp(x) is below rounding for x < -44. Errors: see
    tests/physics/dynamics/test_functions.py.
    """
    # 1/256 is a power of 2: the argument keeps all its digits, and eight doublings undo the factor.
    y = maximum(x, -44.0) * 0.00390625
    # the series, because exp(x) - 1 itself is 4e-14 off at x = 1e-3
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
    """Compute atan2(y, x), with a relative error of at most 3.1e-16
    (tests/physics/dynamics/test_functions.py); 0 for (0, 0)."""
    a, b = abs(y), abs(x)
    # The octant: the series needs arguments only up to tan(pi/8) = 0.414.
    low, high = minimum(a, b), maximum(a, b)
    # for (0, 0): the quotient is 0 whatever the divisor
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
