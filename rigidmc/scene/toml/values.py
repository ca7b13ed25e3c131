"""Conversion of values in scene files to quantities, and back: numbers, lists, distributions,
grids, vector distributions, and references to columns of files.
"""

from collections.abc import Callable, Iterable
from typing import Any, NamedTuple, TypeVar

import numpy as np

from rigidmc.errors import PartError, RigidmcError, SceneError, nearest, unknown
from rigidmc.files.user_code import source_of
from rigidmc.inputs.measured import Measured
from rigidmc.inputs.units import unit_named, unit_of
from rigidmc.physics.dynamics.methods import word_of
from rigidmc.scene.distributions import Distribution, distribution, is_distribution
from rigidmc.scene.mixtures import mixture
from rigidmc.scene.quantities import Grid, grid
from rigidmc.scene.toml.columns import read_columns
from rigidmc.scene.units import in_si
from rigidmc.scene.user_parts.registry import (
    Code,
    load_user_class,
    make_distribution_stand_in,
    module_of,
)
from rigidmc.scene.vector_distributions import (
    VECTOR_DISTRIBUTIONS,
    distributions_of,
    make_distribution,
)
from rigidmc.scene.vector_distributions.protocol import VectorDistribution
from rigidmc.scene.vector_distributions.vectors import whole_of


class DataSources(NamedTuple):
    """Sources of the columns to which a scene file refers.

    of_result : function that returns the rows of a name in a result; None without a result
    folder : folder of the data files
    code : Python files that may be run, see `rigidmc.scene.user_parts.registry`
    is_recorded : whether the scene is that of a result or of a run directory
    """

    of_result: Callable[[str], np.ndarray | None] | None
    folder: str
    code: Code = False
    is_recorded: bool = False


def check_plain(value: Any, at: str) -> Any:
    """Return a number or lists of numbers unchanged; SceneError for anything else."""
    try:
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        raise SceneError("expected numbers", at=at, value=value) from None
    if isinstance(value, str) or not np.isfinite(array).all():
        raise SceneError("expected finite numbers", at=at, value=value)
    return value


def check_keys(table: Any, allowed: Iterable[str], at: str, required: Iterable[str] = ()) -> None:
    """Raise SceneError for a value that is not a table, a key that is not allowed, and a missing
    required key."""
    if not isinstance(table, dict):
        rule = f"expected a table with the keys {', '.join(allowed)}"
        raise SceneError(rule, at=at, table="", value=table)
    for key in table:
        if key not in allowed:
            raise unknown("key", allowed, at=at, key=key)
    for key in required:
        if key not in table:
            raise SceneError("is missing", at=f"{at}.{key}")


def read_quantity(value: Any, at: str, stored: DataSources) -> Any:
    """Return a value of a scene file as a quantity.

    Accepts numbers, lists, { distribution = parameters }, the same with between = [low, high],
    { mixture = [{ weight = w, distribution = parameters }, ...] }, { grid = [low, high, count] },
    { distribution = table }, { table = file, columns = names } and { stored = name, axis = i };
    any of these but the last with unit = "deg/s" beside it, and { value = number, unit = "deg/s" },
    become Measured
    """
    if isinstance(value, list):
        parts = [read_quantity(v, at, stored) for v in value]
        # columns with names are components, even if a column is as long as a vector
        return tuple(parts) if any(isinstance(part, np.ndarray) for part in parts) else parts
    if not isinstance(value, dict):
        return value
    for key, read in _READERS.items():
        if key in value:
            return read(value, at, stored)
    if len(value) != 1:
        rule = "expected a number or one distribution, e.g. { normal = [0.0, 0.001] }"
        words = [nearest(word, ["between", "mixture", "grid", "unit"]) for word in value]
        raise SceneError(rule, at=at, value=value, nearest=next(filter(None, words), None))
    ((name, parameters),) = value.items()
    law = make_distribution(name, parameters, at, lambda part: read_quantity(part, at, stored))
    if law is not None:
        return law
    if not is_distribution(name) and (unit := unit_named(name)):
        rule = f'a unit stands beside the number: {{ value = 10.0, unit = "{unit}" }}'
        raise SceneError(rule, at=at, value=value)
    if distributions_of(at) and not is_distribution(name):
        raise _no_such_law(name, value, at)
    if isinstance(parameters, dict):
        return _named(at, value, distribution, name, **parameters)
    several = parameters if isinstance(parameters, list) else [parameters]
    return _named(at, value, distribution, name, *several)


def _measured(value: dict[str, Any], at: str, stored: DataSources) -> Any:
    return read_measured(value, at, lambda inner: read_quantity(inner, at, stored))


def _grid(value: dict[str, Any], at: str, stored: DataSources) -> Grid:
    """Return a grid; SceneError."""
    check_keys(value, ("grid", "stride", "log"), at)
    if not isinstance(value["grid"], list) or len(value["grid"]) != 3:
        raise SceneError("expected grid = [low, high, count]", at=at, value=value)
    more = {k: v for k, v in value.items() if k != "grid"}
    return _named(at, value, grid, *value["grid"], **more)


def read_measured(value: Any, at: str, read: Callable[[Any], Any]) -> Any:
    """Return { value = ..., unit = "mm" }, or another table with a unit beside its keys, as
    Measured; anything else unchanged. SceneError.

    read : function that reads what stands beside the unit
    """
    if not isinstance(value, dict) or not {"unit", "value"} & value.keys():
        return value
    if "unit" not in value:
        rule = 'expected a unit beside the value, { value = 10.0, unit = "deg/s" }, or a number'
        close = [nearest(word, ["unit"]) for word in value]
        raise SceneError(rule, at=at, value=value, nearest=next(filter(None, close), None))
    inner = {key: part for key, part in value.items() if key != "unit"}
    if "value" in inner:
        check_keys(value, ("value", "unit"), at)
        inner = inner["value"]
    elif not inner or "stored" in inner:
        rule = 'expected { value = 10.0, unit = "deg/s" }, or a distribution with its unit'
        raise SceneError(rule, at=at, value=value)
    unit_of(value["unit"], at, value)
    return Measured(read(inner), value["unit"])


def read_plain(value: Any, units: str, at: str) -> Any:
    """Return a number or lists of numbers, converted to SI if they have a unit; SceneError for
    anything else."""
    return check_plain(in_si(read_measured(value, at, lambda inner: inner), units, at), at)


def _own_law(value: dict[str, Any], at: str, stored: DataSources) -> VectorDistribution:
    """Return a custom distribution, { my_law = { ... }, module = "file.py" }; SceneError."""
    names = [name for name in value if name != "module"]
    if len(names) != 1:
        rule = 'expected one custom distribution, { my_law = { ... }, module = "file.py" }'
        raise SceneError(rule, at=at, value=value)
    name, parameters = names[0], value[names[0]]
    kind = load_user_class(name, value["module"], at, stored.code)
    if kind is None:
        kind = make_distribution_stand_in(name, parameters, at)
    if not issubclass(kind, VectorDistribution):
        rule = f"{kind.__name__} must be a frozen dataclass and a subclass of VectorDistribution"
        raise PartError(rule, at=at, source=source_of(kind))
    law = make_distribution(name, parameters, at, lambda x: read_quantity(x, at, stored), kind)
    assert law is not None
    return law


def _truncated(value: dict[str, Any], at: str, stored: DataSources) -> Distribution | Measured:
    """Return a truncated distribution; SceneError."""
    bounds, inner = value["between"], {k: v for k, v in value.items() if k != "between"}
    law: Any = read_quantity(inner, at, stored) if inner else None
    is_law = isinstance(law, Distribution) or (
        isinstance(law, Measured) and isinstance(law.value, Distribution)
    )
    if not is_law or not isinstance(bounds, list) or len(bounds) != 2:
        rule = "expected one distribution with bounds, { normal = [1, 0.1], between = [0.5, 1.5] }"
        raise SceneError(rule, at=at, value=value)
    cut: Distribution | Measured = _named(at, value, law.between, *bounds)
    return cut


def _mixture(value: dict[str, Any], at: str, stored: DataSources) -> Distribution:
    """Return a mixture of distributions; SceneError."""
    check_keys(value, ("mixture",), at)
    parts = value["mixture"]
    if not isinstance(parts, list) or not all(isinstance(p, dict) and "weight" in p for p in parts):
        rule = "expected mixture = [{ weight = 9, normal = [0, 1] }, { weight = 1, ... }]"
        raise SceneError(rule, at=at, value=value)
    pairs = []
    for part in parts:
        law = read_quantity({k: v for k, v in part.items() if k != "weight"}, at, stored)
        pairs.append((part["weight"], law))
    return _named(at, value, mixture, *pairs)


def _no_such_law(name: str, value: Any, at: str) -> SceneError:
    """Return the error for an unknown distribution of this key."""
    allowed, key = distributions_of(at), at.rpartition(".")[2]
    elsewhere = next((kind.variables for kind in VECTOR_DISTRIBUTIONS if kind.name == name), None)
    rule = f"no distribution '{name}'"
    if elsewhere is not None:
        rule = f"'{name}' is a distribution of {' and '.join(elsewhere)}"
    rule += (
        f"; distributions of {key}: {', '.join(allowed)}; of one number: normal, uniform and the"
        ' continuous ones of scipy.stats; a custom distribution needs module = "file.py"'
    )
    return SceneError(
        rule, at=at, value=value, nearest=nearest(name, [*allowed, "normal", "uniform"])
    )


def _columns_of(value: dict[str, Any], at: str, stored: DataSources) -> Any:
    """Return the column or columns of a file to which a value refers; SceneError."""
    single = "column" in value
    check_keys(value, ("table", "column" if single else "columns"), at)
    names = [value["column"]] if single else value.get("columns")
    words = isinstance(names, list) and all(isinstance(x, str) for x in (*names, value["table"]))
    if not isinstance(names, list) or not words:
        rule = 'expected { table = "file.csv", columns = ["w1", "w2", "w3"] }, or column = "w1"'
        raise SceneError(rule, at=at, value=value)
    columns = read_columns(stored.folder, value["table"], names, at)
    if not single and len(columns) not in ((6,) if at == "body.tensor" else (3, 4)):
        rule = f"{len(columns)} columns: a vector has 3 components, a quaternion 4"
        rule += ", a tensor 6, xx, yy, zz, yz, zx, xy" if at == "body.tensor" else ""
        raise SceneError(rule, at=at, value=value)
    if at == "start.attitude" and len(columns) == 4:
        # pure: components of a quaternion
        zero = np.flatnonzero(sum(column**2 for column in columns) < 1e-200)
        if zero.size:
            rule = f"row {zero[0] + 1} is zero: a quaternion must be nonzero"
            raise SceneError(rule, at=at, value=value["table"])
    return columns[0] if single else columns


def _rows_of(value: dict[str, Any], at: str, stored: DataSources) -> np.ndarray:
    """Return the rows of a result to which { stored = name, axis = i } refers; SceneError."""
    if stored.of_result is None:
        rule = "refers to the rows of a result file; load that file instead"
        raise SceneError(rule, at=at, value=value)
    check_keys(value, ("stored", "axis"), at)
    name, axis = value["stored"], value.get("axis")
    rows = stored.of_result(name) if isinstance(name, str) else None
    if rows is None or rows.dtype.kind != "f" or rows.ndim != (1 if axis is None else 2):
        raise SceneError("refers to rows that the result does not have", at=at, value=value)
    if axis is None:
        return rows
    if type(axis) is not int or not 1 <= axis <= len(rows):
        raise SceneError(f"expected an axis between 1 and {len(rows)}", at=at, value=value)
    column: np.ndarray = rows[axis - 1]
    return column


Quantity = TypeVar("Quantity")


def _named(
    at: str, value: Any, make: Callable[..., Quantity], /, *arguments: Any, **words: Any
) -> Quantity:
    """Call make(...); its error names the key."""
    try:
        return make(*arguments, **words)
    except RigidmcError as error:
        raise SceneError(error.rule, at=at, value=value, nearest=error.nearest) from None


# {key of a table: its reader}, in this order; other tables are a distribution by its name
_READERS: dict[str, Callable[[dict[str, Any], str, DataSources], Any]] = {
    "unit": _measured,
    "value": _measured,
    "stored": _rows_of,
    "table": _columns_of,
    "grid": _grid,
    "between": _truncated,
    "mixture": _mixture,
    "module": _own_law,
}


def as_toml(value: Any, name: str, axis: int | None = None) -> Any:
    """Return a quantity, a distribution, or a tuple of quantities as written in a scene file.

    name, axis : of the rows in a result; an array becomes a reference to them
    """
    if isinstance(value, VectorDistribution):
        fields = {k: as_toml(v, name) for k, v in value.as_dict().items() if v is not None}
        if type(value) in VECTOR_DISTRIBUTIONS:
            return {value.name: fields}
        return {word_of(type(value)): fields, **module_of(value)}
    if (vector := whole_of(value)) is not None:
        return as_toml(vector, name)
    if isinstance(value, tuple):
        return [as_toml(v, name, i + 1) for i, v in enumerate(value)]
    if isinstance(value, (Distribution, Grid)):
        return value.as_table()
    if isinstance(value, np.ndarray):
        return {"stored": name} if axis is None else {"stored": name, "axis": axis}
    return value
