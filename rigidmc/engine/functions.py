"""The functions of `math` for vectors of numbers, which effects of a user's own may call: straight code, with the same bits on every machine.

Errors in units of 1e-16, relative where not said otherwise: sin, cos 1.6 of 1, for |x| < 1e6; exp 3; log 1.2; atan2, atan 3; tanh 9. Powers are those of
whole numbers, by products; any other is exp(y log x), which is off by |y log x| times as much. The rest of `math` takes one member at a time.
"""

import math
import operator
from typing import Any

import numpy as np
from numba.core import types
from numba.extending import overload

from rigidmc.dynamics.so3 import arctan2, expm1, rounded, select, sincos
from rigidmc.engine.compose import inline
from rigidmc.engine.fused import INLINE
from rigidmc.engine.noise import logarithm
from rigidmc.engine.numbers import Vec, as_float, as_word, double, like, plain

_LN2_HIGH, _LN2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10
_SHIFT = np.uint64(52)


def sine(x):
    """sin x."""
    return sincos(x)[0]


def cosine(x):
    """cos x."""
    return sincos(x)[1]


def tangent(x):
    """tan x."""
    s, c = sincos(x)
    return s / c


def arctangent(x):
    """atan x."""
    return arctan2(x, 1.0 + 0.0 * x)


def power_of_two(n):
    """2^n of a whole number -1022 <= n <= 1023, which goes to the place of the exponent from the low end of 2^52 + ..."""
    return as_float(as_word(n + (4503599627370496.0 + 1023.0)) << _SHIFT)


def exponential_of(x):
    """exp x; inf above 709.78 and 0 below -745.2."""
    wide = min(max(double(x), -746.0), 710.0)
    n = rounded(wide * 1.4426950408889634)
    r = (wide - n * _LN2_HIGH) - n * _LN2_LOW
    # |r| <= 0.347: the series of degree 13 leaves 4e-18
    p = 1 / 479001600 + r * (1 / 6227020800)
    p = 1 / 3628800 + r * (1 / 39916800 + r * p)
    p = 1 / 40320 + r * (1 / 362880 + r * p)
    p = 1 / 720 + r * (1 / 5040 + r * p)
    p = 1 / 24 + r * (1 / 120 + r * p)
    e = 1.0 + (r + r * r * (0.5 + r * (1 / 6 + r * p)))
    half = rounded(0.5 * n)  # in two factors: neither 2^1024 nor 2^-1074 is a number with an exponent
    found = e * power_of_two(half) * power_of_two(n - half)
    return like(select(double(x) != double(x), double(x), found), x)


def logarithm_of(x):
    """ln x; -inf of 0, nan below it."""
    wide = double(x)
    small = wide < 2.2250738585072014e-308  # what is not normal has no exponent of its own
    found = logarithm(select(small, wide * 18014398509481984.0, wide)) - select(small, 37.42994775023705, 0.0)
    found = select(wide == math.inf, wide, select(wide == 0.0, -math.inf, found))
    return like(select((wide < 0.0) | (wide != wide), math.nan, found), x)


def hyperbolic_tangent(x):
    """tanh x."""
    e = expm1(-2.0 * min(abs(x), 20.0))
    return math.copysign(-e / (e + 2.0), x)


def hyperbolic_sine(x):
    """sinh x."""
    e, less = exponential_of(abs(x)), expm1(min(abs(x), 1.0))
    found = select(abs(x) < 1.0, less + less / (1.0 + less), e - 1.0 / e)
    return math.copysign(0.5 * found, x)


def hyperbolic_cosine(x):
    """cosh x."""
    e = exponential_of(abs(x))
    return 0.5 * (e + 1.0 / e)


def arcsine(x):
    """asin x."""
    return arctan2(x, math.sqrt((1.0 - x) * (1.0 + x)))


def arccosine(x):
    """acos x."""
    return arctan2(math.sqrt((1.0 - x) * (1.0 + x)), x)


def power(x, y):
    """x^y of x > 0; 0 of x = 0 and y > 0, nan of x < 0."""
    return select(x == 0.0, select(y > 0.0, 0.0 * x, math.inf), exponential_of(y * logarithm_of(x)))


def hypotenuse(x, y):
    """sqrt(x^2 + y^2), without leaving the range of numbers on the way."""
    large = max(abs(x), abs(y))
    small = min(abs(x), abs(y)) / select(large == 0.0, 1.0, large)
    return large * math.sqrt(1.0 + small * small)


_ONE: dict[Any, Any] = {
    math.sin: sine,
    math.cos: cosine,
    math.tan: tangent,
    math.atan: arctangent,
    math.asin: arcsine,
    math.acos: arccosine,
    math.exp: exponential_of,
    math.expm1: expm1,
    math.log: logarithm_of,
    math.tanh: hyperbolic_tangent,
    math.sinh: hyperbolic_sine,
    math.cosh: hyperbolic_cosine,
}
_TWO: dict[Any, Any] = {math.atan2: arctan2, math.pow: power, math.hypot: hypotenuse}


_OTHERS = (
    math.gamma,
    math.lgamma,
    math.erf,
    math.erfc,
    math.log10,
    math.log2,
    math.log1p,
    math.asinh,
    math.acosh,
    math.atanh,
    math.degrees,
    math.radians,
)


def _for_one(known):
    """Let compiled code call a function of the library for a vector of one number."""

    @overload(known, jit_options=INLINE)
    def one(x):
        return (lambda x: like(known(plain(x)), x)) if isinstance(x, Vec) and x.count == 1 else None


def _for_vectors(known, own, count):
    """Let compiled code call `own` for a function of the library where an argument is a vector."""
    inline(own)
    if count == 1:

        @overload(known, jit_options=INLINE)
        def one(x):
            return (lambda x: own(x)) if isinstance(x, Vec) else None

    else:

        @overload(known, jit_options=INLINE)
        def two(x, y):
            return (lambda x, y: own(x, y)) if isinstance(x, Vec) or isinstance(y, Vec) else None


def whole_power(x, n):
    """x^n of a whole number n, by products."""
    made, base, left = 1.0 + 0.0 * x, x, abs(n)
    while left > 0:
        if left % 2 == 1:
            made = made * base
        base = base * base
        left = left // 2
    return made if n >= 0 else 1.0 / made


for _known, _own in _ONE.items():
    _for_vectors(_known, _own, 1)
for _known, _own in _TWO.items():
    _for_vectors(_known, _own, 2)
for _known in _OTHERS:
    _for_one(_known)
for _function in (power_of_two, whole_power):
    inline(_function)


@overload(operator.pow, jit_options=INLINE)
def _compiled_power(x, y):
    if isinstance(x, Vec) and isinstance(y, types.Integer):
        return lambda x, y: whole_power(x, y)
    if isinstance(x, Vec) and isinstance(y, (Vec, types.Float)):
        return lambda x, y: power(x, y)
    return None
