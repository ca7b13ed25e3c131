"""Records: measured samples of observables, read from tables.

A table is a CSV file, a mapping of columns, a DataFrame, or a Dataset. It holds one record, or
several: one for each value of a column, or for each interval of time. `columns` names the columns
of an observable and their unit, as in ``omega=gx,gy,gz:deg/s``; without it, columns named as in
results and in known exports are found.
"""

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from rigidmc.errors import OptionError, SceneError, in_file, unknown
from rigidmc.files.tables import TextColumn, read_number_table
from rigidmc.inputs.units import converter, unit_of
from rigidmc.studies.fit.streams import Array

SHIPPED = ("toss",)  # records beside this file, by name: a racket tossed with a phone, simulated
TIMES = ("t", "time", "t_s", "Time (s)", "seconds_elapsed")  # names of a column of times, by rank
# columns of known exports, x, y and z of the rates: phyphox, Sensor Logger
EXPORTS = (tuple(f"Gyroscope {axis} (rad/s)" for axis in "xyz"), ("x", "y", "z"))
_UNIT = re.compile(
    r"[\[(]([^\])]*[A-Za-z][^\])]*)[\])]\s*$"
)  # of a name: "Time (s)", not "omega[1]"


class ColumnsOf(NamedTuple):
    """The columns of an observable.

    names : of its components, in order;  unit : of all, "" if their names state it
    """

    names: tuple[str, ...]
    unit: str


class Record(NamedTuple):
    """The samples of a record.

    name : in messages and results
    times : of each observable [s], as measured;  values : (samples, components) in SI units
    """

    name: str
    times: Mapping[str, Array]
    values: Mapping[str, Array]


def read_columns_option(value: Any, at: str) -> dict[str, ColumnsOf]:
    """Return {observable: its columns} of texts NAME=A,B,C[:UNIT], or of a mapping of names, or of
    (names, unit); OptionError."""
    if value is None:
        return {}
    if isinstance(value, str):
        value = (value,)
    if not isinstance(value, Mapping):
        pairs = [str(text).partition("=")[::2] for text in value]
        value = {name.strip(): words for name, words in pairs}
    return {name: _columns_of(name, words, at) for name, words in value.items()}


def _columns_of(observable: str, words: Any, at: str) -> ColumnsOf:
    unit = ""
    if isinstance(words, str):
        words, _, unit = words.partition(":")
        words = [word.strip() for word in words.split(",")]
    elif len(words) == 2 and not isinstance(words[0], str):
        words, unit = words
    if not observable or not all(isinstance(word, str) and word for word in words):
        rule = "expected OBSERVABLE=COLUMN,...[:UNIT], e.g. omega=gx,gy,gz:deg/s"
        raise OptionError(rule, at=at, value=words)
    if unit:
        unit_of(unit, at)
    return ColumnsOf(tuple(words), unit)


def read_records(
    data: Any,
    columns: Mapping[str, ColumnsOf],
    units: Mapping[str, str],
    sizes: Mapping[str, int],
    time: str | None = None,
    split: str | None = None,
    between: Sequence[tuple[float, float]] = (),
) -> list[Record]:
    """Return the records of a table, or of several tables.

    columns : of each observable; {} to find them by their names
    units, sizes : SI unit and number of components of each observable that a table may have
    time : column of the times;  split : column whose values are records
    between : intervals of time, a record each

    Raises OptionError or SceneError for a table without these columns, for times that do not rise,
    and for records without samples.
    """
    tables = data if isinstance(data, (list, tuple)) else (data,)
    records = []
    for table in tables:
        name = os.path.basename(table) if isinstance(table, (str, os.PathLike)) else "data"
        with in_file(str(name)):
            made = _table(table)
            wanted = columns or _found(made, sizes)
            records += list(_records(made, wanted, units, sizes, time, split, between, str(name)))
    if len(tables) > 1 or len(records) > 1:
        return records
    return [records[0]._replace(name="data")]


def _table(data: Any) -> dict[str, Array]:
    """Return {name: column} of a file or an object; OptionError."""
    if isinstance(data, (str, os.PathLike)):
        if not os.path.exists(data) and str(data) in SHIPPED:
            data = os.path.join(os.path.dirname(__file__), f"{data}.csv")
        if not os.path.exists(data):
            raise OptionError("no such file", at="data", value=str(data))
        try:
            table = read_number_table(data)
        except ValueError as error:
            raise OptionError(
                getattr(error, "rule", str(error)), at="data", value=str(data)
            ) from None
        pairs = zip(table.names, table.columns, strict=True)
        return {
            name: np.full(table.rows, np.nan)
            if isinstance(column, TextColumn) or column is None
            else column
            for name, column in pairs
        }
    if hasattr(data, "data_vars"):
        return _of_dataset(data)
    if not hasattr(data, "keys"):
        rule = "expected the path of a CSV file, a mapping of columns, a DataFrame or a Dataset"
        raise OptionError(rule, at="data", value=type(data).__name__)
    return {str(name): np.asarray(data[name], float) for name in data.keys()}  # noqa: SIM118


def _of_dataset(data: Any) -> dict[str, Array]:
    """Return the columns of a Dataset with the dimension time: NAME, or NAME[1], ... of vectors."""
    columns = {}
    for name, variable in data.variables.items():
        if "time" not in variable.dims:
            continue
        values = np.squeeze(variable.transpose("time", ...).values)
        if values.ndim == 1:
            columns[str(name)] = values.astype(float)
        elif values.ndim == 2:
            columns |= {f"{name}[{i + 1}]": values[:, i] for i in range(values.shape[1])}
        else:
            rule = f"{name} has the dimensions {variable.dims}: select one member"
            raise OptionError(rule, at="data")
    return columns


def _found(table: Mapping[str, Array], sizes: Mapping[str, int]) -> dict[str, ColumnsOf]:
    """Return the columns of the observables that a table names; OptionError without any."""
    found = {}
    for name, size in sizes.items():
        names = (name,) if size == 1 else tuple(f"{name}[{i + 1}]" for i in range(size))
        if set(names) <= table.keys():
            found[name] = ColumnsOf(names, "")
    for names in EXPORTS:
        if not found and set(names) <= table.keys():
            found["omega"] = ColumnsOf(names, "")
    if not found:
        rule = (
            f"no column has the name of an observable; columns: {', '.join(list(table)[:12])}."
            " Say which they are: --columns omega=A,B,C:rad/s"
        )
        raise OptionError(rule, at="columns")
    return found


def _column(table: Mapping[str, Array], name: str, at: str) -> Array:
    if name not in table:
        raise unknown("column", table, at=at, value=name, error=OptionError)
    return table[name]


def _records(
    table: Mapping[str, Array], columns: Mapping[str, ColumnsOf], units: Mapping[str, str],
    sizes: Mapping[str, int], time: str | None, split: str | None,
    between: Sequence[tuple[float, float]], name: str,
) -> Iterator[Record]:  # fmt: skip
    """Yield the records of a table."""
    if time is None:
        time = next((word for word in TIMES if word in table), "")
        if not time:
            rule = f"no column of times among {', '.join(list(table)[:12])}: name it"
            raise OptionError(rule, at="time")
    t = _column(table, time, "time") * _factor(time, "", "s")
    values = {}
    for observable, (names, unit) in columns.items():
        if observable not in sizes:
            raise unknown("observable", sizes, at="columns", value=observable, error=OptionError)
        if len(names) != sizes[observable]:
            rule = f"{observable} has {sizes[observable]} components, but {len(names)} columns"
            raise OptionError(rule, at="columns", value=",".join(names))
        parts = [
            _column(table, word, "columns") * _factor(word, unit, units[observable])
            for word in names
        ]
        values[observable] = np.stack(parts, axis=1)
    groups = [(name, np.isfinite(t))]
    if split is not None:
        which = _column(table, split, "split")
        groups = [(f"{split} {x:g}", (which == x) & np.isfinite(t)) for x in np.unique(which)]
    for label, some in groups:
        for low, high in between or ((-np.inf, np.inf),):
            inside = some & (t >= low) & (t <= high)
            more = f"{label} {low:g} to {high:g} s" if between else label
            yield _record(more, t[inside], {k: x[inside] for k, x in values.items()})


def _record(name: str, t: Array, values: Mapping[str, Array]) -> Record:
    """Return a record, each observable with the samples that it has; OptionError."""
    rises = np.diff(t) > 0.0
    if not rises.all():
        row = int(np.argmin(rises)) + 1
        rule = f"times do not rise: {t[row - 1]:.9g} s is followed by {t[row]:.9g} s in {name}"
        raise OptionError(rule, at="time")
    times, samples = {}, {}
    for observable, x in values.items():
        has_one = np.isfinite(x).any(1)
        if np.count_nonzero(has_one) < 2:
            rule = f"{name} has {np.count_nonzero(has_one)} samples of {observable}: needs two"
            raise OptionError(rule, at="data")
        times[observable], samples[observable] = t[has_one], x[has_one]
    return Record(name, times, samples)


def _factor(name: str, unit: str, wanted: str) -> float:
    """Return the factor to SI of a column: of its unit, or of one that its name states."""
    if not unit and (match := _UNIT.search(name)):
        unit = match[1]
    if not unit:
        return 1.0
    try:
        return float(converter(unit, wanted, "columns").convert(1.0))
    except SceneError as error:
        raise OptionError(f"{name}: {error.rule}", at="columns", nearest=error.nearest) from None
