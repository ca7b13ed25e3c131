"""The functions of `math` that custom code may call, for the compiler.

For vectors most are the straight-line code of `rigidmc.physics.dynamics.functions`, with the same
bits on every machine; the others run on one member at a time.
"""

import math
import operator
from collections.abc import Callable
from typing import Any

from numba.core import types
from numba.extending import overload

from rigidmc.engine.compiler.compose import inline, inline_all
from rigidmc.engine.compiler.dual_types import DualType
from rigidmc.engine.compiler.intrinsics import cast_like, first_number
from rigidmc.engine.compiler.pipeline import INLINE
from rigidmc.engine.compiler.vector_types import VectorType
from rigidmc.physics.dynamics import functions
from rigidmc.physics.dynamics.so3 import arctan2, expm1

_OF_ONE_ARGUMENT: dict[Any, Any] = {
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
_OF_TWO_ARGUMENTS: dict[Any, Any] = {
    math.atan2: arctan2,
    math.pow: functions.power,
    math.hypot: functions.hypotenuse,
}
_NUMBERS = (VectorType, DualType)
_SCALAR_ONLY = (
    math.gamma, math.lgamma, math.erf, math.erfc, math.log10, math.log2, math.log1p, math.asinh,
    math.acosh, math.atanh, math.degrees, math.radians,
)  # fmt: skip


def _overload_scalar(of_math: Callable[..., Any]) -> None:
    """Register a function of `math` for a vector of one number."""

    @overload(of_math, jit_options=INLINE)
    def one(x):
        return (
            (lambda x: cast_like(of_math(first_number(x)), x))
            if isinstance(x, VectorType) and x.count == 1
            else None
        )


def _overload_vector(of_math: Callable[..., Any], straight: Callable[..., Any], count: int) -> None:
    """Register `straight` for a function of `math` of `count` arguments.

    One of the arguments is a vector.
    """
    inline(straight)
    if count == 1:

        @overload(of_math, jit_options=INLINE)
        def one(x):
            return (lambda x: straight(x)) if isinstance(x, _NUMBERS) else None

    else:

        @overload(of_math, jit_options=INLINE)
        def two(x, y):
            vector = isinstance(x, _NUMBERS) or isinstance(y, _NUMBERS)
            return (lambda x, y: straight(x, y)) if vector else None


inline_all(functions)
for _known, _straight in _OF_ONE_ARGUMENT.items():
    _overload_vector(_known, _straight, 1)
for _known, _straight in _OF_TWO_ARGUMENTS.items():
    _overload_vector(_known, _straight, 2)
for _known in _SCALAR_ONLY:
    _overload_scalar(_known)


@overload(operator.pow, jit_options=INLINE)
def _compiled_power(x, y):
    if isinstance(x, _NUMBERS) and isinstance(y, types.Integer):
        # by products, which round once each: exp(y log x) errs by |y log x| roundings
        return lambda x, y: functions.whole_power(x, y)
    if isinstance(x, _NUMBERS) and isinstance(y, (*_NUMBERS, types.Float)):
        return lambda x, y: functions.power(x, y)
    return None
