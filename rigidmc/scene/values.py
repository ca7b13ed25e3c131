"""Values of scene files as quantities, and back: numbers, lists, distributions, grids, and columns of tables."""

from typing import Any, NamedTuple

import numpy as np

from rigidmc.errors import SceneError, nearest, unknown
from rigidmc.scene.columns import column
from rigidmc.scene.laws import VECTORS, of_table, word_of
from rigidmc.scene.quantities import Distribution, Grid, distribution, grid, is_distribution


class Columns(NamedTuple):
    """Sources of the columns that a file refers to.

    of_result : a function that gives the rows of a name in a result, or None;  folder : that of tables
    """

    of_result: Any
    folder: str


def numbers(value, table, key):
    """Numbers, or lists of numbers, as they stand."""
    try:
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        raise SceneError(table, key, value, "expected numbers") from None
    if isinstance(value, str) or not np.isfinite(array).all():
        raise SceneError(table, key, value, "expected finite numbers")
    return value


def only(table, allowed, name):
    """SceneError for what is no table, or one with another key than those allowed."""
    if not isinstance(table, dict):
        raise SceneError("", name, table, f"expected a table with the keys {', '.join(allowed)}")
    for key in table:
        if key not in allowed:
            raise unknown(name, key, None, "key", allowed)


def parse(value, table, key, stored):
    """Numbers, lists, {distribution = parameters} and {stored = name, axis = i} of a scene file as quantities."""
    if isinstance(value, list):
        return [parse(v, table, key, stored) for v in value]
    if not isinstance(value, dict):
        return value
    if "stored" in value:
        return _rows_of(value, table, key, stored.of_result)
    if "table" in value:
        one = "column" in value
        only(value, ("table", "column" if one else "columns"), f"{table}.{key}")
        names = [value["column"]] if one else value.get("columns")
        if not isinstance(names, list) or not all(
            isinstance(name, str) for name in (*names, value["table"])
        ):
            raise SceneError(
                table,
                key,
                value,
                'expected { table = "file.csv", columns = ["w1", "w2", "w3"] }, or column = "w1"',
            )
        found = [column(stored.folder, value["table"], name, table, key) for name in names]
        if not one and len(found) not in (3, 4):
            raise SceneError(
                table,
                key,
                value,
                f"{len(found)} columns: a vector has 3 components, a quaternion 4",
            )
        return found[0] if one else found
    if "grid" in value:
        only(value, ("grid", "stride", "log"), f"{table}.{key}")
        if not isinstance(value["grid"], list) or len(value["grid"]) != 3:
            raise SceneError(table, key, value, "expected grid = [low, high, count]")
        return _named(
            table,
            key,
            value,
            grid,
            *value["grid"],
            **{k: v for k, v in value.items() if k != "grid"},
        )
    if len(value) != 1:
        raise SceneError(
            table,
            key,
            value,
            "expected a number or one distribution, e.g. { normal = [0.0, 0.001] }",
        )
    ((name, parameters),) = value.items()
    whole = of_table(name, parameters, key, lambda part: parse(part, table, key, stored))
    if whole is not None:
        return whole
    if key in VECTORS and not is_distribution(name):
        elsewhere = [other for other, kinds in VECTORS.items() if name in kinds]
        rule = (
            f"'{name}' is of {' and '.join(elsewhere)}"
            if elsewhere
            else f"no vector or distribution '{name}'"
        )
        rule += f"; vectors of {key}: {', '.join(VECTORS[key])}; distributions: normal, uniform and the continuous ones of scipy.stats"
        raise SceneError(
            table, key, value, rule, nearest(name, [*VECTORS[key], "normal", "uniform"])
        )
    if isinstance(parameters, dict):
        return _named(table, key, value, distribution, name, **parameters)
    return _named(
        table,
        key,
        value,
        distribution,
        name,
        *(parameters if isinstance(parameters, list) else [parameters]),
    )


def _rows_of(value, table, key, of_result):
    """The rows that { stored = name, axis = i } of a result refers to; SceneError where there are no such rows."""
    if of_result is None:
        raise SceneError(
            table, key, value, "refers to the rows of a result file; load that file instead"
        )
    only(value, ("stored", "axis"), f"{table}.{key}")
    name, axis = value["stored"], value.get("axis")
    rows = of_result(name) if isinstance(name, str) else None
    if rows is None or rows.dtype.kind != "f" or rows.ndim != (1 if axis is None else 2):
        raise SceneError(table, key, value, "refers to rows that the result does not have")
    if axis is None:
        return rows
    if type(axis) is not int or not 1 <= axis <= len(rows):
        raise SceneError(table, key, value, f"expected an axis between 1 and {len(rows)}")
    return rows[axis - 1]


def _named(table, key, value, make, /, *arguments, **words):
    """make(...), its error told of a key of a table."""
    try:
        return make(*arguments, **words)
    except SceneError as error:
        raise SceneError(table, key, value, error.rule, error.nearest) from None


def plain(value, name, axis=None):
    """A quantity or a tuple of them as it stands in TOML."""
    if hasattr(value, "_fields"):
        return {
            word_of(value): {k: plain(v, name) for k, v in value._asdict().items() if v is not None}
        }
    if isinstance(value, tuple):
        return [plain(v, name, i + 1) for i, v in enumerate(value)]
    if isinstance(value, (Distribution, Grid)):
        return value.as_table()
    if isinstance(value, np.ndarray):
        return {"stored": name} if axis is None else {"stored": name, "axis": axis}
    return value
