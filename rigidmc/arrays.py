"""The one door through which numbers and arrays of a user come in.

Numbers are taken by their place alone: components last, and in scenes one row per member. What
carries more than places (labels, a unit, a mask, no order) would lose it on the way in, so it is
refused, with what to write in its place.
"""

import math
from array import array as machine_array
from collections import deque
from collections.abc import Mapping, Set
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigidmc.errors import SceneError

_SEQUENCES = (list, tuple, range, deque, machine_array)
_PLAIN_ARRAYS = (np.memmap, np.matrix, np.recarray)  # they add nothing to the numbers of an ndarray
_ELEMENTS = {
    "b": "are truth values, not numbers",
    "c": "are complex: give real numbers, such as x.real",
    "m": "are time differences: divide them by np.timedelta64(1, 's')",
    "M": "are dates, not numbers",
    "S": "are text, not numbers",
    "U": "are text, not numbers",
    "V": "have names: give the columns in their order, e.g. np.column_stack([x['a'], x['b']])",
}


def is_number(value: Any) -> bool:
    """Whether a value is a finite real number; truth values and time differences are not."""
    known = isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(
        value, (bool, np.timedelta64)
    )
    try:
        return known and math.isfinite(value)
    except OverflowError:  # whole numbers of Python may be larger than floats
        return False


def as_plain_arrays(value: Any, at: str = "input", kinds: str = "fiu") -> Any:
    """A value whose arrays are plain ones; SceneError for what has a meaning beyond its places.

    Numbers, text and objects that hold no numbers in places stay as they are, and so do lists and
    tuples of those. Inside of them the same is refused as outside.

    kinds : of numpy's dtypes that arrays may have
    """
    if isinstance(value, np.ndarray):
        return _plain(value, at, kinds)
    if isinstance(value, np.timedelta64):
        raise SceneError(f"its elements {_ELEMENTS['m']}", at=at, value=value)
    if isinstance(value, (str, np.generic, Real)) or value is None:
        return value
    if isinstance(value, (list, tuple)):
        if all(type(one) in (float, int) for one in value):
            return value
        inside = [as_plain_arrays(one, at, kinds) for one in value]
        same = all(one is other for one, other in zip(inside, value, strict=True))
        return value if same else inside
    if isinstance(value, _SEQUENCES):
        return as_plain_arrays(list(value), at, kinds)
    if cure := _cure(value):
        shown = f"{type(value).__module__}.{type(value).__name__}"
        raise SceneError(f"is a {shown.removeprefix('builtins.')}, which {cure}", at=at)
    return value


def floats(
    value: Any,
    at: str = "input",
    last: int = 0,
    kinds: str = "fiu",
    rule: str = "expected numbers",
) -> NDArray[Any]:
    """An array of a user as float64; SceneError for anything but numbers in places.

    last : length that its last axis, that of the components, must have; 0 for any
    kinds : with "c" also complex numbers, which stay complex
    rule : what is expected
    """
    plain = type(value) is np.ndarray and value.dtype == np.float64
    array: NDArray[Any] = value if plain else _converted(value, at, kinds, rule)
    if last and array.shape[-1:] != (last,):
        turned = " (give its transpose?)" if array.shape[:1] == (last,) else ""
        rule = f"has shape {array.shape}; its last axis must have {last} components{turned}"
        raise SceneError(rule, at=at)
    return array


def _converted(value: Any, at: str, kinds: str, rule: str) -> NDArray[Any]:
    """The numbers of an object that is not an array of float64 yet; SceneError."""
    value = as_plain_arrays(value, at, kinds)
    try:
        found = np.asarray(value)
    except ValueError:  # rows of different lengths
        raise SceneError(f"{rule}; its rows differ in length", at=at, value=value) from None
    if found.dtype.kind == "O":  # also whole numbers beyond 64 bits
        real = [isinstance(one, Real) and not isinstance(one, bool) for one in found.ravel()]
        if not all(real):
            raise SceneError(rule, at=at, value=value)
    elif found.dtype.kind not in kinds:
        raise SceneError(f"{rule}; its elements {_why(found)}", at=at, value=value)
    if found.dtype.kind == "c":
        return found
    try:
        return np.asarray(found, dtype=float)
    except OverflowError:
        raise SceneError("is too large for a floating-point number", at=at, value=value) from None


def _plain(value: NDArray[Any], at: str, kinds: str) -> Any:
    """An array without its mask, if nothing is masked; SceneError."""
    if isinstance(value, np.ma.MaskedArray):
        masked: Any = np.argwhere(np.ma.getmaskarray(value)) if value.dtype.names is None else ()
        if count := len(masked):
            where = f"row {masked[0][0]}" if value.ndim else "it"
            many = f" ({count} of {value.size} elements are)" if value.size > 1 else ""
            rule = f"{where} is masked{many}: leave such members out, or give numbers for them"
            raise SceneError(rule, at=at)
        value = np.asarray(value)
    if type(value) is not np.ndarray:
        if not isinstance(value, _PLAIN_ARRAYS):
            name = f"{type(value).__module__}.{type(value).__name__}"
            rule = f"is a {name}, which {_cure(value) or 'may mean more than its numbers'}"
            raise SceneError(rule, at=at)
        value = np.asarray(value)
    if value.dtype.kind == "O":
        return as_plain_arrays(value.tolist(), at, kinds)
    if value.dtype.kind not in kinds + "SU":  # what is text is for others to refuse, or to take
        raise SceneError(f"its elements {_why(value)}", at=at)
    return value if value.ndim else value[()]


def _why(array: NDArray[Any]) -> str:
    return _ELEMENTS.get(array.dtype.kind, "are no numbers")


def _cure(value: Any) -> str:
    """Why an object is not taken and what to write in its place; "" for one without numbers."""
    if isinstance(value, Mapping):
        return "has keys: give its values in their order, [x[key] for key in (...)]"
    if isinstance(value, Set):
        return "has no order: give a list"
    if isinstance(value, (bytes, bytearray, memoryview)):
        return "is of bytes: give numbers"
    if hasattr(value, "magnitude") or hasattr(value, "unit"):
        return (
            "has a unit: give its numbers in SI units, such as x.to('rad/s').magnitude of pint or"
            " x.to_value('rad/s') of astropy"
        )
    if hasattr(value, "dims") and hasattr(value, "transpose"):
        return (
            "has named dimensions: give its values with the components last,"
            " x.transpose('member', 'axis').values"
        )
    if hasattr(value, "columns"):
        return (
            "has labels: give its columns in their order, x[['a', 'b', 'c']].to_numpy(), one row"
            " per member"
        )
    if hasattr(value, "to_numpy"):
        return "has labels: give its numbers, x.to_numpy()"
    if hasattr(value, "__array__") or hasattr(value, "__dlpack__"):
        return "is not a NumPy array: give np.asarray(x)"
    if hasattr(value, "__iter__"):
        return "is no list: give list(x)"
    return ""
