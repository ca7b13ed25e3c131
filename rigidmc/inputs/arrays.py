"""Validation of users' numbers and arrays: the one place where they enter.

The position of a number gives its meaning: components come last, and in scenes each row is a
member. Where a shape allows both, such as (3, 3), the array is refused: its dimensions need names.
Labels of pandas and xarray give the meaning themselves (`rigidmc.inputs.labelled`). Objects with
more than positions (a unit, a mask, no order) would lose it here, so they are refused with a
suggested replacement.
"""

import math
from array import array as machine_array
from collections import deque
from collections.abc import Mapping, Set
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rigidmc.errors import SceneError, warn
from rigidmc.inputs.labelled import COLUMN, Wanted, has_dims, is_labelled, read_labelled, two_ways
from rigidmc.inputs.measured import from_foreign, is_foreign, numbers_in
from rigidmc.inputs.units import ARGUMENTS

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
_SEQUENCES = (list, tuple, range, deque, machine_array)
_PLAIN_ARRAYS = (np.memmap, np.matrix, np.recarray)  # carry no more than the numbers of an ndarray
_ELEMENTS = {
    "b": "are booleans, not numbers",
    "c": "are complex: give real numbers, such as x.real",
    "m": "are time differences: divide them by np.timedelta64(1, 's')",
    "M": "are dates, not numbers",
    "S": "are text, not numbers",
    "U": "are text, not numbers",
    "V": "have names: give the columns in their order, e.g. np.column_stack([x['a'], x['b']])",
}


def is_number(value: Any) -> bool:
    """Return whether a value is a finite real number; booleans and time differences are not."""
    is_real = isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(
        value, (bool, np.timedelta64)
    )
    try:
        return is_real and math.isfinite(value)
    except OverflowError:  # Python's integers may exceed floats
        return False


def as_plain_arrays(
    value: Any, at: str = "input", kinds: str = "fiu", wanted: Wanted = COLUMN
) -> Any:
    """Convert arrays in a value to plain ones; SceneError if neither positions nor labels give
    their meaning.

    Numbers, text, objects without arrays, and lists and tuples of these stay as they are. The
    elements of lists and tuples obey the same rules.

    kinds : allowed kinds of NumPy dtypes
    wanted : axes that labels have to name
    """
    if type(value) is not np.ndarray and is_foreign(value):
        units = ARGUMENTS.get(at.rpartition(".")[2])
        if units is not None:
            return as_plain_arrays(from_foreign(value, units, at), at, kinds)
    if isinstance(value, np.ndarray):
        return _plain(value, at, kinds)
    if isinstance(value, np.timedelta64):
        raise SceneError(f"its elements {_ELEMENTS['m']}", at=at, value=value)
    if isinstance(value, (str, np.generic, Real)) or value is None:
        return value
    if is_labelled(value):
        return _plain(read_labelled(value, at, wanted), at, kinds)
    if isinstance(value, (list, tuple)):
        if all(type(part) in (float, int) for part in value):
            return value
        inside = [as_plain_arrays(part, at, kinds, wanted._replace(sizes=())) for part in value]
        same = all(part is other for part, other in zip(inside, value, strict=True))
        return value if same else inside
    if isinstance(value, _SEQUENCES):
        return as_plain_arrays(list(value), at, kinds, wanted)
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
    wanted: Wanted | None = None,
) -> NDArray[Any]:
    """Convert a user's array to float64; SceneError for anything but numbers in positions, or with
    labels that name components.

    last : required length of the last axis, the components; 0 for any
    kinds : allowed kinds of dtypes; with "c" complex numbers are allowed and stay complex
    rule : start of the error message, which states the expectation
    wanted : axes that labels have to name; by default `last` components, and any others
    """
    plain = type(value) is np.ndarray and value.dtype == np.float64
    wanted = wanted or Wanted((last,) * bool(last), by_member=False)
    array: NDArray[Any] = value if plain else _converted(value, at, kinds, rule, wanted)
    if last and array.shape[-1:] != (last,):
        turned = " (give its transpose?)" if array.shape[:1] == (last,) else ""
        rule = f"has shape {array.shape}; its last axis must have {last} components{turned}"
        raise SceneError(rule, at=at)
    return array


def member_vectors(value: Any, at: str, size: int) -> Array:
    """Return vectors (..., size), perhaps one for each member; SceneError for anything else, and
    for an array (size, size) without labels, which reads two ways."""
    array = floats(value, at, size)
    if array.shape == (size, size) and not is_labelled(value):
        raise two_ways(array.shape, at)
    return array


def check_quaternion_rows(array: NDArray[Any], at: str) -> None:
    """Raise SceneError for three or four attitudes (n, k) whose rows may be components: unless
    only the rows, not the columns, are unit quaternions."""
    if array.shape not in ((4, 4), (3, 4), (4, 3)):
        return
    rows, columns = (np.abs((array**2).sum(axis) - 1.0).max() < 1e-6 for axis in (1, 0))
    rows, columns = rows and array.shape[1] == 4, columns and array.shape[0] == 4
    if columns and not rows:
        rule = (
            f"has the shape {array.shape}, and its columns are quaternions: an array must have one"
            " row per member; give its transpose"
        )
        raise SceneError(rule, at=at)
    if not rows or columns:
        raise two_ways(array.shape, at, "quat")


def as_tuples(values: Any) -> Any:
    """Return an array, or nested lists, as a number or nested tuples of numbers."""
    values = values.tolist() if isinstance(values, np.ndarray) else values
    return tuple(map(as_tuples, values)) if isinstance(values, list) else values


def check_rows(bad: ArrayLike, rule: str, at: str = "input") -> None:
    """Raise SceneError if all elements are bad; warn with their count if some are, because the
    result has nan for them."""
    count, size = int(np.count_nonzero(bad)), np.size(bad)
    if count and count == size:
        every = f"{rule} (all of {count:,} are bad)" if count > 1 else rule
        raise SceneError(every, at=at)
    warn_of_rows(bad, rule)


def warn_of_rows(bad: ArrayLike, rule: str) -> None:
    """Warn with the count of bad elements, for which the result has nan."""
    count, size = int(np.count_nonzero(bad)), np.size(bad)
    if count:
        some = f"{count:,} of {size:,} elements are nan in the result: " if size > 1 else ""
        warn(some + rule)


Shape = tuple[int, ...]


def broadcast_arguments(
    *arguments: tuple[str, ArrayLike, int],
) -> tuple[Shape, list[Array], NDArray[np.bool_]]:
    """Return (leading shape, arrays (components, n), mask of bad rows (n,)) of the arguments of a
    closed form, with the components first, as `rigidmc.engine.formulas` requires.

    Moments must be positive, and all numbers finite. Bad rows are nan; SceneError if all are bad,
    else a SceneWarning with their count; each names the first bad argument and its value. An
    attitude that is nan has had its warning (`rigidmc.mechanics.rotation.quaternion`).

    arguments : (name, value (..., components), number of components) each

    With 0 components the value is a scalar (...) and its array (1, n). SceneError for values that
    are not numbers, have a different number of components, or do not broadcast.
    """
    arrays = []
    for name, value, size in arguments:
        array = floats(value, name, size)
        arrays.append(array if size else array[..., None])
    try:
        shape = np.broadcast_shapes(*(a.shape[:-1] for a in arrays))
    except ValueError:
        shapes = ", ".join(
            f"{name} {a.shape[:-1]}" for (name, _, _), a in zip(arguments, arrays, strict=True)
        )
        rule = (
            f"leading shapes do not broadcast: {shapes}; "
            "give an axis of length 1 where they differ, e.g. (bodies, 1) and (times,)"
        )
        raise SceneError(rule, at=arguments[0][0]) from None
    columns = {
        name: np.moveaxis(np.broadcast_to(a, shape + a.shape[-1:]), -1, 0).reshape(a.shape[-1], -1)
        for (name, _, _), a in zip(arguments, arrays, strict=True)
    }
    bad = _bad_rows(columns)
    good = [np.where(bad, np.nan, array) for array in columns.values()]
    return shape, good, bad


def _bad_rows(columns: Mapping[str, Array]) -> NDArray[np.bool_]:
    """Return the mask of bad rows of {name: (components, n)}, see `broadcast_arguments`."""
    wrong = {
        name: ~(np.isfinite(x) & ((x > 0.0) if name == "moments" else True)).all(0)
        for name, x in columns.items()
    }
    bad: NDArray[np.bool_] = np.any(list(wrong.values()), axis=0)
    untold = bad & ~wrong.get("attitude", np.zeros_like(bad))
    name = next((name for name, rows in wrong.items() if (rows & untold).any()), None)
    if name is None:
        return bad
    first = columns[name][:, np.argmax(wrong[name] & untold)]
    value = first.tolist() if first.size > 1 else float(first[0])
    rule = "must be positive and finite" if name == "moments" else "must be finite"
    if untold.all():
        many = f" (all of {bad.size:,} are bad)" if bad.size > 1 else ""
        raise SceneError(rule + many, at=name, value=value)
    warn_of_rows(untold, f"{name} = {value} {rule}")
    return bad


def split_components(value: Any, at: str, size: int) -> Any:
    """Return a vector of `size` quantities as a sequence of them, each a number, a column with one
    number per member, or whatever was given; SceneError.

    An array has the shape (size,) or (members, size), as have lists of lists and lists of rows. A
    tuple consists of components. What reads two ways is refused: (size, size) without labels, and a
    list of `size` arrays of this length.
    """
    rule = f"expected {size} components, or an array of shape (members, {size})"
    if is_labelled(value):
        return _columns(as_plain_arrays(value, at, wanted=Wanted((size,))), at, size)
    settled = isinstance(value, tuple) or (isinstance(value, list) and any(map(has_dims, value)))
    plain = as_plain_arrays(value, at)
    if isinstance(plain, (list, tuple)):
        plain = _stacked(plain, at, size, settled)
    if isinstance(plain, np.ndarray) and plain.ndim == 2 and plain.shape == (size, size):
        raise two_ways(plain.shape, at, "quat" if size == 4 else "axis")
    if isinstance(plain, np.ndarray):
        plain = _columns(plain, at, size)
    if isinstance(plain, str) or not hasattr(plain, "__len__") or len(plain) != size:
        raise SceneError(rule, at=at, value=value)
    return plain


def _stacked(parts: Any, at: str, size: int, settled: bool) -> Any:
    """Return rows, given as lists or arrays, as one array; other sequences unchanged."""
    arrays = [np.shape(part) if isinstance(part, np.ndarray) else None for part in parts]
    if arrays and all(shape == (size,) for shape in arrays):
        if len(parts) != size:
            return np.stack(parts)
        if not settled:
            raise two_ways((size, size), at, "quat" if size == 4 else "axis")
    if not parts or not all(isinstance(part, (list, tuple)) for part in parts):
        return parts
    if not all(is_number(x) for part in parts for x in part) or len({*map(len, parts)}) > 1:
        return parts
    return np.array(parts, dtype=float)


def _columns(array: NDArray[Any], at: str, size: int) -> Any:
    """Return the components of an array (size,) or (members, size); SceneError."""
    if array.ndim == 1:
        return array if array.size == size else ()
    if array.ndim != 2 or array.shape[1] != size:
        turned = "; give its transpose" if array.shape == (size, *array.shape[1:2]) else ""
        rule = f"expected {size} components, or an array of shape (members, {size})"
        raise SceneError(f"has the shape {array.shape}: {rule}{turned}", at=at)
    return tuple(np.ascontiguousarray(array[:, i]) for i in range(size))


def _converted(value: Any, at: str, kinds: str, rule: str, wanted: Wanted) -> NDArray[Any]:
    """Convert an object that is not yet a float64 array; SceneError."""
    units = ARGUMENTS.get(at.rpartition(".")[2])
    value = value if units is None else numbers_in(units, value, at)
    value = as_plain_arrays(value, at, kinds, wanted)
    try:
        array = np.asarray(value)
    except ValueError:  # rows of different lengths
        raise SceneError(f"{rule}; its rows differ in length", at=at, value=value) from None
    if array.dtype.kind == "O":  # includes integers beyond 64 bits
        real = [isinstance(x, Real) and not isinstance(x, bool) for x in array.ravel()]
        if not all(real):
            raise SceneError(rule, at=at, value=value)
    elif array.dtype.kind not in kinds:
        raise SceneError(f"{rule}; its elements {_why(array)}", at=at, value=value)
    if array.dtype.kind == "c":
        return array
    try:
        return np.asarray(array, dtype=float)
    except OverflowError:
        raise SceneError("is too large for a floating-point number", at=at, value=value) from None


def _plain(value: NDArray[Any], at: str, kinds: str) -> Any:
    """Return an array as a plain one; SceneError if an element is masked or has no number."""
    if isinstance(value, np.ma.MaskedArray):
        masked: Any = np.argwhere(np.ma.getmaskarray(value)) if value.dtype.names is None else ()
        if count := len(masked):
            where = f"row {masked[0][0]}" if value.ndim else "it"
            many = f" ({count} of {value.size} elements are)" if value.size > 1 else ""
            rule = f"{where} is masked{many}: omit masked members, or give their numbers"
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
    if value.dtype.kind not in kinds + "SU":  # the caller accepts or refuses text
        raise SceneError(f"its elements {_why(value)}", at=at)
    return value if value.ndim else value[()]


def _why(array: NDArray[Any]) -> str:
    return _ELEMENTS.get(array.dtype.kind, "are not numbers")


def _cure(value: Any) -> str:
    """Return why an object is refused and its replacement; "" for an object without numbers."""
    if hasattr(value, "data_vars"):
        return "has several variables: give one of them, x['omega']"
    if hasattr(value, "as_quat"):
        return "is an attitude: give it as the attitude, or numbers here"
    if isinstance(value, Mapping):
        return "has keys: give its values in their order, [x[key] for key in (...)]"
    if isinstance(value, Set):
        return "has no order: give a list"
    if isinstance(value, (bytes, bytearray, memoryview)):
        return "consists of bytes: give numbers"
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
        return "is not a list: give list(x)"
    return ""
