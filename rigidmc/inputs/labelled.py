"""Arrays with labels: pandas Series and DataFrames, and xarray DataArrays, read by their labels.

Labels say which component and which member a number belongs to; a position says neither. Each
object is put in the order of arrays, members first and components last, or refused with a cure in
one line. pandas and xarray are recognised without importing them.
"""

import re
import sys
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigidmc.errors import SceneError
from rigidmc.inputs.units import ARGUMENTS, unit_of


class Wanted(NamedTuple):
    """Axes that the caller expects of an array.

    sizes : possible numbers of components; () for numbers without components
    by_member : whether the other axis is the member, and no further one is allowed
    is_matrix : whether components come in pairs, as in a tensor or a covariance
    """

    sizes: tuple[int, ...] = ()
    by_member: bool = True
    is_matrix: bool = False


COLUMN = Wanted()
COMPONENT_DIMS = {"axis": 3, "quat": 4}  # {dimension of results: number of components}
# names of components in the order of arrays; an attitude of three components is Euler angles
_EULER = ("phi", "theta", "psi")
_NAMES = {
    3: (("x", "y", "z"), ("1", "2", "3")),
    4: (("w", "x", "y", "z"), ("0", "1", "2", "3")),
    6: (("xx", "yy", "zz", "yz", "zx", "xy"),),
}
_MOMENTS = ("xx", "yy", "zz")
_WORDS = {  # {quantity: beginnings of names of its components}
    "omega": ("omega", "start_omega", "w", "rate"),
    "momentum": ("momentum", "start_momentum", "l", "h"),
    "moments": ("moment", "i", "j"),
    "attitude": ("attitude", "start_attitude", "start_euler", "q", "quat", "euler"),
    "centre": ("centre", "center", "com", "cg", "c", "r"),
}


def is_labelled(value: Any) -> bool:
    """Return whether a value is an object of pandas or xarray that has labels."""
    if type(value) in (np.ndarray, float, int, tuple, list):
        return False  # quickly: a scene asks this of every number
    return _is(value, "pandas", "Series", "DataFrame", "Index") or _is(
        value, "xarray", "DataArray", "Variable"
    )


def has_dims(value: Any) -> bool:
    """Return whether a value has named dimensions, as a DataArray has."""
    return _is(value, "xarray", "DataArray", "Variable")


def read_labelled(value: Any, at: str, wanted: Wanted = COLUMN) -> NDArray[Any]:
    """Return the numbers of a labelled object, members first and components last; SceneError for
    labels that do not say where a number belongs, for other units, and for missing numbers."""
    if has_dims(value):
        numbers = _of_dims(value, at, wanted)
    elif _is(value, "pandas", "DataFrame"):
        numbers = _of_frame(value, at, wanted)
    elif _is(value, "pandas", "Series"):
        numbers = _of_series(value, at, wanted)
    else:  # an Index has positions alone
        numbers = _numbers(value, at)
    return numbers


def _is(value: Any, package: str, *kinds: str) -> bool:
    """Return whether a value belongs to one of the classes of a package, if it is imported."""
    module = sys.modules.get(package)
    classes = (getattr(module, kind, None) for kind in kinds)
    return module is not None and isinstance(value, tuple(k for k in classes if k is not None))


def _numbers(column: Any, at: str) -> NDArray[Any]:
    """Return the numbers of a Series or an Index; SceneError for a missing one, and for dtypes that
    are not numbers."""
    missing = np.flatnonzero(np.asarray(column.isna()))
    if missing.size:
        many = f" ({missing.size:,} of {len(column):,} are)" if len(column) > 1 else ""
        rule = f"row {missing[0]} is missing{many}: omit it, x.dropna(), or give its number"
        raise SceneError(rule, at=at)
    if getattr(column.dtype, "kind", "O") not in "fiu":
        plain = column.to_numpy()
        if plain.dtype.kind in "mM":
            raise SceneError(f"has the dtype {column.dtype}, which is not a number", at=at)
        if not all(type(x) in (int, float) or isinstance(x, np.floating) for x in plain):
            raise SceneError(f"has the dtype {column.dtype}: expected numbers", at=at)
    return np.asarray(column.to_numpy(dtype=float))


# --- xarray


def _of_dims(array: Any, at: str, wanted: Wanted) -> NDArray[Any]:
    _check_words(str(array.name) if getattr(array, "name", None) is not None else "", at)
    _check_unit(array.attrs.get("units", array.attrs.get("unit")), at)
    if wanted.is_matrix:
        return _matrix_of_dims(array, at, wanted)
    dim, order = _component_dim(array, at, wanted)
    others = [d for d in array.dims if d != dim]
    if wanted.by_member:
        _check_members(array, others, at, wanted)
    if dim is None:
        return np.asarray(array.values)
    return np.asarray(array.transpose(*others, dim).values)[..., order]


def _component_dim(array: Any, at: str, wanted: Wanted) -> tuple[Any, list[int]]:
    """Return (dimension of the components, their positions along it); None for none."""
    named = [d for d in array.dims if d in COMPONENT_DIMS or _names_of(_texts(array, d), wanted)]
    if len(named) > 1:
        rule = f"has the dimensions {_listed(named)}, which both name components: select one"
        raise SceneError(rule, at=at)
    if not wanted.sizes:
        if named and wanted.by_member:
            rule = f"expected one number for each member: select a component, x.isel({named[0]}=0)"
            raise SceneError(rule, at=at)
        return (named[0], [*range(array.sizes[named[0]])]) if named else (None, [])
    if not named:
        rule = (
            f"none of its dimensions ({_listed(array.dims) or 'none'}) says which numbers are"
            f" components: name it, x.rename({_first(array.dims)}='{_dim_of(wanted)}')"
        )
        raise SceneError(rule, at=at)
    (dim,) = named
    size, labels = array.sizes[dim], _labels(array, dim)
    if size not in wanted.sizes or (dim in COMPONENT_DIMS and size != COMPONENT_DIMS[dim]):
        rule = f"has {size} components along '{dim}', expected {_either(wanted.sizes)}"
        raise SceneError(rule, at=at)
    if labels is None:
        if dim == "axis" and 4 in wanted.sizes:
            rule = "an attitude has the dimension 'quat'; label Euler angles phi, theta, psi"
            raise SceneError(rule, at=at)
        return dim, list(range(size))
    return dim, _order(labels, at, wanted)[0]


def _check_members(array: Any, others: Sequence[Any], at: str, wanted: Wanted) -> None:
    """Raise SceneError unless the other dimension is the member, numbered 0, 1, 2, ..."""
    for dim in others:
        if dim != "member":
            dims = " and ".join(["'member'", *[f"'{_dim_of(wanted)}'"] * bool(wanted.sizes)])
            rule = (
                f"has the dimension '{dim}', expected {dims}: select one place, x.isel({dim}=0),"
                f" or rename it, x.rename({dim}='member')"
            )
            raise SceneError(rule, at=at)
    labels = array.coords["member"].values if "member" in getattr(array, "coords", ()) else None
    if others and labels is not None and not np.array_equal(labels, np.arange(labels.size)):
        rule = (
            f"its members are {_listed(labels[:3])}{', ...' * (labels.size > 3)}, not 0, 1, 2, ...:"
            " number them by x.drop_vars('member')"
        )
        raise SceneError(rule, at=at)


def _matrix_of_dims(array: Any, at: str, wanted: Wanted) -> NDArray[Any]:
    """Return matrices (..., k, k); as they are symmetric, their two dimensions need no order."""
    several = [d for d in array.dims if d != "member"]
    sizes = {array.sizes[d] for d in several}
    if len(several) != 2 or len(sizes) != 1 or not sizes <= {*wanted.sizes}:
        rule = (
            f"has the dimensions {_listed(array.dims) or 'none'}: expected two of equal length, and"
            " perhaps 'member'"
        )
        raise SceneError(rule, at=at)
    _check_members(array, [d for d in array.dims if d == "member"], at, wanted)
    front = [d for d in array.dims if d == "member"]
    matrices = np.asarray(array.transpose(*front, *several).values)
    for axis, dim in ((-2, several[0]), (-1, several[1])):
        if (labels := _labels(array, dim)) is not None:
            matrices = np.take(matrices, _order(labels, at, wanted)[0], axis)
    return matrices


def _labels(array: Any, dim: Any) -> list[Any] | None:
    """Return the labels along a dimension; None without labels."""
    coords = getattr(array, "coords", {})
    return coords[dim].values.tolist() if dim in coords else None


def _texts(array: Any, dim: Any) -> list[Any]:
    """Return the labels of a short dimension if they are texts; [] otherwise."""
    labels = (_labels(array, dim) or []) if array.sizes[dim] <= 6 else []
    return labels if labels and all(isinstance(x, str) for x in labels) else []


# --- pandas


def _of_frame(frame: Any, at: str, wanted: Wanted) -> NDArray[Any]:
    labels, count = list(frame.columns), len(frame)
    if not wanted.sizes:
        cure = f": give one column, x[{str(labels[0])[:20]!r}]" if labels else ""
        raise SceneError(f"is a table with {_columns_text(labels)}{cure}", at=at)
    if len(labels) not in wanted.sizes:
        rule = (
            f"has {_columns_text(labels)}, expected {_either(wanted.sizes)}, one for each"
            f" component: x[[{', '.join(map(repr, _example(wanted)))}]]"
        )
        raise SceneError(rule, at=at)
    units = getattr(frame, "attrs", {}).get("units")
    for label in labels:
        _check_unit(units.get(label) if isinstance(units, dict) else None, at)
    order, is_sure = _order(labels, at, wanted)
    columns = np.stack([_numbers(frame.iloc[:, i], at) for i in order], axis=-1)
    if wanted.is_matrix:
        if {*frame.index} != {*labels}:
            rule = "expected rows and columns with the same labels, as x.cov() has"
            raise SceneError(rule, at=at)
        return columns[_order([*frame.index], at, wanted)[0]]
    _check_index(frame.index, at)
    if wanted.by_member and count in wanted.sizes and not is_sure:
        raise two_ways(frame.shape, at, _dim_of(wanted))
    return columns


def _of_series(series: Any, at: str, wanted: Wanted) -> NDArray[Any]:
    _check_words(str(series.name) if isinstance(series.name, str) else "", at)
    if wanted.sizes and len(series) in wanted.sizes and not _is_default(series.index):
        return _numbers(series.iloc[_order([*series.index], at, wanted)[0]], at)
    _check_index(series.index, at)
    return _numbers(series, at)


def _is_default(index: Any) -> bool:
    """Return whether labels are 0, 1, 2, ..., and so only positions."""
    count = len(index)
    if getattr(index.dtype, "kind", "O") not in "iu":
        return not count
    return bool((index.to_numpy() == np.arange(count)).all())


def _check_index(index: Any, at: str) -> None:
    if not _is_default(index):
        shown = f"{_listed([*index[:3]])}{', ...' * (len(index) > 3)}"
        rule = (
            f"its rows are labelled {shown}, not 0, 1, 2, ...: number them as members by"
            " x.reset_index(drop=True)"
        )
        raise SceneError(rule, at=at)


# --- names of components


def two_ways(shape: tuple[int, ...], at: str, dim: str = "axis") -> SceneError:
    """Return the error for an array whose shape allows members first and components first."""
    rule = (
        f"has the shape {shape}, which reads two ways, members first or components first: name the"
        f" dimensions, xarray.DataArray(x, dims=('member', '{dim}'))"
    )
    return SceneError(rule, at=at)


def _order(labels: Sequence[Any], at: str, wanted: Wanted) -> tuple[list[int], bool]:
    """Return (position of each component among labels, whether the labels name components of this
    quantity and could not be numbers of members); SceneError for other labels."""
    if [*labels] == [*range(len(labels))]:
        return [*range(len(labels))], False
    for label in labels:
        if unit := re.fullmatch(r".*[\[(]([^\])]*[A-Za-z][^\])]*)[\])]\s*", str(label)[:100]):
            _check_unit(unit[1].strip(), at)
    names_found = _names_of(labels, wanted, at)
    if names_found is None:
        rule = (
            f"its labels {_listed(labels)} do not say which component is which: name them"
            f" {', '.join(_example(wanted))}"
        )
        raise SceneError(rule, at=at)
    stem, names, order = names_found
    _check_words(stem, at)
    key, word = _key(at), stem.rstrip("_.-").removesuffix("_final")
    return order, not names[0].isdecimal() or word in (key, *_WORDS.get(key, ()))


def _names_of(
    labels: Sequence[Any], wanted: Wanted, at: str = ""
) -> tuple[str, tuple[str, ...], list[int]] | None:
    """Return (beginning, names, position of each component) of labels such as wx, wy, wz or
    omega_1, omega_2, omega_3, which begin alike; None if they are not names of components."""
    size = len(labels)
    if size not in _NAMES or (wanted.sizes and size not in wanted.sizes):
        return None
    texts = [_plain_label(label) for label in labels]
    name_sets = (_EULER,) if 4 in wanted.sizes and size == 3 else _NAMES[size]
    if size == 3 and at.endswith("moments"):
        name_sets = (_MOMENTS, *name_sets)
    for names in name_sets:
        order = [i for name in names for i, text in enumerate(texts) if text.endswith(name)]
        if len(order) != size or len({*order}) != size:
            continue
        stems = {texts[i].removesuffix(name) for i, name in zip(order, names, strict=True)}
        if len(stems) == 1:
            return stems.pop(), names, order
    return None


def _plain_label(label: Any) -> str:
    """Return a label in lower case, without its unit and without brackets: omega[1] is omega1."""
    text = re.sub(r"\s*[\[(][^\])]*[A-Za-z][^\])]*[\])]\s*$", "", str(label)[:100])
    return re.sub(r"[\s\[\]().]", "", text).lower()


def _check_words(stem: str, at: str) -> None:
    """Raise SceneError for names of another quantity, such as momentum_1 for omega."""
    key, stem = _key(at), stem.lower().rstrip("_.-")
    if key not in _WORDS or not stem:
        return
    plain = stem.removesuffix("_final")
    for other in _WORDS:
        if other != key and plain in (other, f"start_{other}"):
            rule = f"its name is {plain}: rename it if its numbers are {key}"
            raise SceneError(rule, at=at)


def _check_unit(unit: Any, at: str) -> None:
    """Raise SceneError for a unit other than the SI unit of the quantity."""
    if not isinstance(unit, str) or not unit.strip():
        return
    powers, wanted = _exponents(unit), {**ARGUMENTS, "attitude": "1"}.get(_key(at))
    if powers is None or (wanted is not None and powers != _exponents(wanted)):
        rule = (
            f"its unit is '{unit[:40]}': give numbers in SI units (rad, kg, m, s), and correct or"
            " delete this unit"
        )
        raise SceneError(rule, at=at)


def _exponents(unit: str) -> tuple[int, ...] | None:
    """Return the exponents of kg, m, s, A in a unit such as "kg m2 s-1" or "rad/s"; None for
    other units."""
    text = re.sub(r"(?<=\w)\.(?=[A-Za-z])", " ", unit)  # kg.m2, as in SI brochures
    try:
        parsed = unit_of(text)
    except SceneError:
        return None
    # the angle is a pure number here: torques and energies of labelled columns may name it or not
    return parsed.powers[:4] if parsed.factor == 1.0 else None


def _key(at: str) -> str:
    """Return the last word of a path that is not the number of a component."""
    return next((word for word in reversed(at.split(".")) if not word.isdecimal()), "")


def _dim_of(wanted: Wanted) -> str:
    return {3: "axis", 4: "quat"}.get(wanted.sizes[0] if wanted.sizes else 0, "component")


def _example(wanted: Wanted) -> tuple[str, ...]:
    size = wanted.sizes[0] if wanted.sizes else 3
    return _NAMES[size][0] if size in _NAMES else tuple(str(i + 1) for i in range(size))


def _either(sizes: Sequence[int]) -> str:
    return " or ".join(map(str, sizes))


def _first(dims: Sequence[Any]) -> str:
    return str(dims[-1])[:40] if dims else "dim"


def _columns_text(labels: Sequence[Any]) -> str:
    return f"{len(labels)} column{'s' * (len(labels) != 1)} ({_listed(labels)})"


def _listed(words: Sequence[Any]) -> str:
    """Return a short list of labels, whatever they are."""
    shown = [str(word)[:20] for word in words[:6]]
    return ", ".join(shown) + ", ..." * (len(words) > 6)
