"""The functions of `math` that a user's effects may call.

For vectors most are the straight code of `rigidmc.dynamics.functions`, with the same bits on every
machine; the rest take one member at a time.
"""

import math
import operator
from collections.abc import Callable
from typing import Any

from numba.core import types
from numba.extending import overload

from rigidmc.dynamics import functions
from rigidmc.dynamics.so3 import arctan2, expm1
from rigidmc.engine.compose import inline, inline_all
from rigidmc.engine.intrinsics import like, plain
from rigidmc.engine.numbers import Vec
from rigidmc.engine.pipeline import INLINE

_OF_ONE: dict[Any, Any] = {
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
_OF_TWO: dict[Any, Any] = {
    math.atan2: arctan2,
    math.pow: functions.power,
    math.hypot: functions.hypotenuse,
}
_ONE_AT_A_TIME = (
    math.gamma, math.lgamma, math.erf, math.erfc, math.log10, math.log2, math.log1p, math.asinh,
    math.acosh, math.atanh, math.degrees, math.radians,
)  # fmt: skip


def _for_one(known: Callable[..., Any]) -> None:
    """Let compiled code call a function of `math` for a vector of one number."""

    @overload(known, jit_options=INLINE)
    def one(x):
        return (lambda x: like(known(plain(x)), x)) if isinstance(x, Vec) and x.count == 1 else None


def _for_vectors(known: Callable[..., Any], straight: Callable[..., Any], count: int) -> None:
    """Let compiled code call `straight` for a function of `math` of so many arguments.

    One of the arguments is a vector.
    """
    inline(straight)
    if count == 1:

        @overload(known, jit_options=INLINE)
        def one(x):
            return (lambda x: straight(x)) if isinstance(x, Vec) else None

    else:

        @overload(known, jit_options=INLINE)
        def two(x, y):
            vector = isinstance(x, Vec) or isinstance(y, Vec)
            return (lambda x, y: straight(x, y)) if vector else None


inline_all(functions)
for _known, _straight in _OF_ONE.items():
    _for_vectors(_known, _straight, 1)
for _known, _straight in _OF_TWO.items():
    _for_vectors(_known, _straight, 2)
for _known in _ONE_AT_A_TIME:
    _for_one(_known)


@overload(operator.pow, jit_options=INLINE)
def _compiled_power(x, y):
    if isinstance(x, Vec) and isinstance(y, types.Integer):
        return lambda x, y: functions.whole_power(x, y)
    if isinstance(x, Vec) and isinstance(y, (Vec, types.Float)):
        return lambda x, y: functions.power(x, y)
    return None
