"""NumPy arrays with derivatives by P parameters: forward differentiation of array code.

A `DualArray` has a value (*shape) and its tangents (P, *shape), its derivatives by each parameter.
Operators and the functions of NumPy below follow the chain rule (Griewank & Walther,
Evaluating Derivatives, 2nd ed., SIAM 2008, chapter 3):

    y = f(a, b):   y.value = f(a.value, b.value),   dy = f_a da + f_b db

The value is computed by the same operation as without tangents, so it has the same bits.
Comparisons and tests for nan return plain arrays of their values.

Two rules apply at places where a formula has no derivative:

- A product with a tangent of 0 is 0, even if the other factor is infinite or nan. The tangent of
  sqrt(x^2 + y^2) at (0, 0) is 0, as is that of abs(x) at 0: the mean of both sides of the kink.
- A choice (`where`, `minimum`, `maximum`, `clip`) has the tangent of the chosen side.

No tangent is lost silently: a function of NumPy without a rule here, `float`, `bool`, `np.asarray`
and assignment into a plain array raise TangentsLost, a TypeError.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin
from numpy.typing import NDArray

Array = NDArray[Any]
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


# The first half of `rigidmc.physics.dynamics.vectors.nearest_integer` adds this number: the sum has
# no digits after the point, and the derivative of a rounded number is 0.
_ROUNDING = 6755399441055744.0


class TangentsLost(TypeError):
    """An operation that has no rule for tangents."""


class DualArray(NDArrayOperatorsMixin):
    """An array with derivatives.

    value : (*shape);  tangents : (P, *shape), derivatives of the value by the P parameters
    """

    __slots__ = ("tangents", "value")

    def __init__(self, value: Any, tangents: Any) -> None:
        self.value: Array = np.asarray(value, dtype=float)
        self.tangents: Array = np.asarray(tangents, dtype=float)

    @property
    def shape(self) -> tuple[int, ...]:
        """The shape of the value."""
        return self.value.shape

    @property
    def T(self) -> "DualArray":
        """The array with its axes reversed."""
        return DualArray(self.value.T, np.moveaxis(self.tangents.T, -1, 0))

    def __len__(self) -> int:
        return len(self.value)

    def __iter__(self) -> Iterator["DualArray"]:
        return (self[i] for i in range(len(self)))

    def __getitem__(self, index: Any) -> "DualArray":
        """Return elements, as views if NumPy returns views."""
        return DualArray(self.value[index], self.tangents[_behind(index)])

    def __setitem__(self, index: Any, value: Any) -> None:
        value, at = as_array(value), _behind(index)
        self.value[index] = plain(value)
        shape = self.tangents[at].shape[1:]
        self.tangents[at] = _full(value, shape, len(self.tangents))

    def __repr__(self) -> str:
        return f"DualArray({self.value!r}, {len(self.tangents)} tangents)"

    def __array__(self, *args: Any, **named: Any) -> Array:
        raise TangentsLost("a DualArray as a plain array would lose its tangents: use its value")

    def __float__(self) -> float:
        raise TangentsLost("a DualArray as a float would lose its tangents: use its value")

    def __bool__(self) -> bool:
        raise TangentsLost("a DualArray has no truth value: compare it")

    def tolist(self) -> list[Any]:
        """Return nested lists of numbers with tangents."""
        return [row.tolist() if row.shape else row for row in self]

    def copy(self) -> "DualArray":
        """Return a copy."""
        return DualArray(self.value.copy(), self.tangents.copy())

    def sum(self, axis: int | None = None) -> "DualArray":
        """Return the sum over an axis, or over all elements."""
        if axis is None:
            return DualArray(self.value.sum(), self.ravel().tangents.sum(1))
        return DualArray(self.value.sum(axis), self.tangents.sum(axis + 1 if axis >= 0 else axis))

    def ravel(self) -> "DualArray":
        """Return the array with one axis."""
        return DualArray(self.value.ravel(), self.tangents.reshape(len(self.tangents), -1))

    def reshape(self, *shape: int) -> "DualArray":
        """Return the array with other axes."""
        return DualArray(
            self.value.reshape(*shape), self.tangents.reshape(len(self.tangents), *shape)
        )

    def argmax(self, axis: int | None = None) -> Any:
        """Return the indices of the largest values, without tangents."""
        return self.value.argmax(axis)

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **named: Any) -> Any:
        if method != "__call__" or named:
            raise TangentsLost(f"np.{ufunc.__name__} of a DualArray has no {method}, out or where")
        values = [x.value if isinstance(x, DualArray) else x for x in inputs]
        if ufunc in OF_VALUES:
            return ufunc(*values)
        if ufunc is np.add and any(type(x) is float and x == _ROUNDING for x in inputs):
            return ufunc(*values)
        if ufunc not in PARTIALS:
            raise TangentsLost(f"np.{ufunc.__name__} has no rule for a DualArray")
        # the operator: arrays have a faster power, with other bits than the ufunc
        y = values[0] ** values[1] if ufunc is np.power else ufunc(*values)
        with np.errstate(all="ignore"):
            partials = PARTIALS[ufunc](y, *values)
        return with_partials(y, zip(inputs, partials, strict=True))

    def __array_function__(self, function: Any, kinds: Any, inputs: Any, named: Any) -> Any:
        if function not in _FUNCTIONS:
            raise TangentsLost(f"np.{function.__name__} has no rule for a DualArray")
        return _FUNCTIONS[function](*inputs, **named)


def plain(x: Any) -> Any:
    """Return the value of a DualArray, anything else unchanged."""
    return x.value if isinstance(x, DualArray) else x


def as_array(x: Any) -> Any:
    """Return `np.asarray(x, dtype=float)`, which keeps the tangents of a DualArray, also of those
    in nested lists and tuples."""
    if isinstance(x, (list, tuple)):
        parts = [as_array(one) if isinstance(one, (list, tuple)) else one for one in x]
        if any(isinstance(one, DualArray) for one in parts):
            return np.stack(parts)
    return x if isinstance(x, DualArray) else np.asarray(x, dtype=float)


def has_tangents(x: Any) -> bool:
    """Return whether a number, or one in nested tuples and lists, is a DualArray."""
    return any(map(has_tangents, x)) if isinstance(x, (list, tuple)) else isinstance(x, DualArray)


def plain_numbers(x: Any) -> Any:
    """Return numbers, in nested tuples and lists, without tangents."""
    if isinstance(x, (list, tuple)):
        return type(x)(map(plain_numbers, x))
    return float(x.value) if isinstance(x, DualArray) else x


def with_values(x: Any, values: Any) -> Any:
    """Return numbers, in nested tuples and lists, with the tangents of x and other values."""
    if isinstance(x, (list, tuple)):
        return type(x)(with_values(*pair) for pair in zip(x, values, strict=True))
    return DualArray(values, x.tangents) if isinstance(x, DualArray) else values


def square_root(x: Any) -> Any:
    """Return `math.sqrt(x)`, or the root of a DualArray."""
    return np.sqrt(x) if isinstance(x, DualArray) else math.sqrt(x)


def zeros(shape: Sequence[int], count: int) -> DualArray:
    """Return zeros with `count` tangents."""
    return DualArray(np.zeros(tuple(shape)), np.zeros((count, *shape)))


def with_partials(value: Any, terms: Any) -> DualArray:
    """Return a value with the tangents sum partial * da.

    terms : pairs (a, partial), the derivative of the value by a; an a without tangents is ignored
    """
    value, total = np.asarray(value), None
    with np.errstate(all="ignore"):
        for a, partial in terms:
            if isinstance(a, DualArray):
                term = _times(partial, _spread(a.tangents, value.shape))
                total = term if total is None else total + term
    assert total is not None
    shape = (len(total), *value.shape)
    return DualArray(value, total if total.shape == shape else np.broadcast_to(total, shape))


def _times(partial: Any, tangents: Array) -> Array:
    """Return partial * tangents, 0 where a tangent is 0."""
    product: Array = partial * tangents
    # a sum is not finite if a number is not; the rare sum that overflows takes the longer way, too
    if math.isfinite(partial if type(partial) is float else np.add.reduce(partial, axis=None)):
        return product
    return np.where(tangents == 0.0, 0.0, product)


def _spread(tangents: Array, shape: Sequence[int]) -> Array:
    """Return tangents (P, *s) with axes of length 1 behind P, to broadcast with `shape`."""
    missing = len(shape) + 1 - tangents.ndim
    if missing <= 0:
        return tangents
    return tangents.reshape(len(tangents), *(1,) * missing, *tangents.shape[1:])


def _behind(index: Any) -> tuple[Any, ...]:
    """Return the index of the tangents at an index of the value."""
    return (slice(None), *(index if isinstance(index, tuple) else (index,)))


def _count(parts: Any) -> int:
    """Return the number of parameters of the DualArrays among some values."""
    return next(len(x.tangents) for x in parts if isinstance(x, DualArray))


def _full(x: Any, shape: Sequence[int], count: int) -> Array:
    """Return the tangents of a value broadcast to a shape; 0 without tangents."""
    if not isinstance(x, DualArray):
        return np.broadcast_to(0.0, (count, *shape))
    return np.broadcast_to(_spread(x.tangents, shape), (count, *shape))


def _where(condition: Any, a: Any, b: Any) -> DualArray:
    value = np.where(condition, plain(a), plain(b))
    count = _count((a, b))
    tangents = np.where(condition, _full(a, value.shape, count), _full(b, value.shape, count))
    return DualArray(value, tangents)


def _joined(join: Callable[..., Any], parts: Any, axis: int = 0) -> DualArray:
    """Return np.stack or np.concatenate of some values."""
    parts = list(parts)
    values, count = [plain(x) for x in parts], _count(parts)
    tangents = [_full(x, np.shape(v), count) for x, v in zip(parts, values, strict=True)]
    return DualArray(join(values, axis), join(tangents, axis + 1 if axis >= 0 else axis))


def _broadcast_to(x: Any, shape: Any) -> DualArray:
    shape = (shape,) if isinstance(shape, int) else tuple(shape)
    return DualArray(np.broadcast_to(x.value, shape), _full(x, shape, len(x.tangents)))


def _broadcast_arrays(*parts: Any) -> list[Any]:
    shape = np.broadcast_shapes(*(np.shape(plain(x)) for x in parts))
    return [np.broadcast_to(x, shape) for x in parts]


def _clip(x: Any, low: Any, high: Any) -> DualArray:
    value = np.clip(plain(x), low, high)
    return with_partials(value, [(x, np.where(value == plain(x), 1.0, 0.0))])


_FUNCTIONS: dict[Any, Callable[..., Any]] = {
    np.where: _where,
    np.stack: partial(_joined, np.stack),
    np.concatenate: partial(_joined, np.concatenate),
    np.sum: DualArray.sum,
    np.broadcast_to: _broadcast_to,
    np.broadcast_arrays: _broadcast_arrays,
    np.clip: _clip,
    np.diag: lambda x: DualArray(np.diag(x.value), np.stack(list(map(np.diag, x.tangents)))),
    np.shape: lambda x: x.shape,
    np.zeros_like: lambda x: np.zeros_like(x.value),
}
