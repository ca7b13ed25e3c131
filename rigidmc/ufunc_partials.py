"""Partial derivatives of NumPy's elementwise functions by their operands."""

from collections.abc import Callable
from typing import Any

import numpy as np

# functions whose results have no tangents: answers, and numbers that change only in jumps
OF_VALUES = {
    np.equal, np.not_equal, np.less, np.less_equal, np.greater, np.greater_equal,
    np.isnan, np.isfinite, np.sign,
}  # fmt: skip


def _power_partials(y: Any, a: Any, b: Any) -> tuple[Any, Any]:
    """Return (b a^(b - 1), a^b ln a); a power of 0 has no tangent by its exponent."""
    # 0^b is 0 for every b: its logarithm is unused
    return b * a ** (b - 1.0), y * np.log(np.where(a == 0.0, 1.0, a))


def _arctan2_partials(y: Any, a: Any, b: Any) -> tuple[Any, Any]:
    square = a * a + b * b
    square = np.where(square == 0.0, np.inf, square)  # at (0, 0) the angle has no tangent
    return b / square, -a / square


def _hypot_partials(y: Any, a: Any, b: Any) -> tuple[Any, Any]:
    size = np.where(y == 0.0, np.inf, y)  # the kink at (0, 0)
    return a / size, b / size


# {ufunc: partials(y, *operands)}, the derivatives of y by each operand
PARTIALS: dict[Any, Callable[..., tuple[Any, ...]]] = {
    np.add: lambda y, a, b: (1.0, 1.0),
    np.subtract: lambda y, a, b: (1.0, -1.0),
    np.multiply: lambda y, a, b: (b, a),
    np.divide: lambda y, a, b: (1.0 / np.asarray(b), -y / b),
    np.power: _power_partials,
    np.negative: lambda y, a: (-1.0,),
    np.positive: lambda y, a: (1.0,),
    np.absolute: lambda y, a: (np.sign(a),),
    np.square: lambda y, a: (2.0 * a,),
    np.sqrt: lambda y, a: (0.5 / y,),
    np.sin: lambda y, a: (np.cos(a),),
    np.cos: lambda y, a: (-np.sin(a),),
    np.tan: lambda y, a: (1.0 + y * y,),
    np.arcsin: lambda y, a: (1.0 / np.sqrt((1.0 - a) * (1.0 + a)),),
    np.arccos: lambda y, a: (-1.0 / np.sqrt((1.0 - a) * (1.0 + a)),),
    np.arctan: lambda y, a: (1.0 / (1.0 + a * a),),
    np.arctan2: _arctan2_partials,
    np.hypot: _hypot_partials,
    np.exp: lambda y, a: (y,),
    np.expm1: lambda y, a: (y + 1.0,),
    np.log: lambda y, a: (1.0 / a,),
    np.log1p: lambda y, a: (1.0 / (1.0 + a),),
    np.minimum: lambda y, a, b: (np.where(a <= b, 1.0, 0.0), np.where(a <= b, 0.0, 1.0)),
    np.maximum: lambda y, a, b: (np.where(a >= b, 1.0, 0.0), np.where(a >= b, 0.0, 1.0)),
}
