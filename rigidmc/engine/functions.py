"""What effects of a user's own may call of `math`: for vectors of numbers the straight code of `rigidmc.dynamics.functions`, with the same bits on every
machine; the rest takes one member at a time.
"""

import math
import operator
from typing import Any

from numba.core import types
from numba.extending import overload

from rigidmc.dynamics import functions
from rigidmc.dynamics.so3 import arctan2, expm1
from rigidmc.engine.compose import inline, inline_all
from rigidmc.engine.intrinsics import like, plain
from rigidmc.engine.numbers import Vec
from rigidmc.engine.pipeline import INLINE

_ONE: dict[Any, Any] = {
    math.sin: functions.sine,
    math.cos: functions.cosine,
    math.tan: functions.tangent,
    math.atan: functions.arctangent,
    math.asin: functions.arcsine,
    math.acos: functions.arccosine,
    math.exp: functions.exponential_of,
    math.expm1: expm1,
    math.log: functions.logarithm_of,
    math.tanh: functions.hyperbolic_tangent,
    math.sinh: functions.hyperbolic_sine,
    math.cosh: functions.hyperbolic_cosine,
}
_TWO: dict[Any, Any] = {
    math.atan2: arctan2,
    math.pow: functions.power,
    math.hypot: functions.hypotenuse,
}
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


inline_all(functions)
for _known, _own in _ONE.items():
    _for_vectors(_known, _own, 1)
for _known, _own in _TWO.items():
    _for_vectors(_known, _own, 2)
for _known in _OTHERS:
    _for_one(_known)


@overload(operator.pow, jit_options=INLINE)
def _compiled_power(x, y):
    if isinstance(x, Vec) and isinstance(y, types.Integer):
        return lambda x, y: functions.whole_power(x, y)
    if isinstance(x, Vec) and isinstance(y, (Vec, types.Float)):
        return lambda x, y: functions.power(x, y)
    return None
