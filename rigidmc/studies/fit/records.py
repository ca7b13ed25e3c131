"""Records: measured samples of observables, read from tables.

A table is a text file, a result, a mapping of columns, a DataFrame, or a Dataset. It holds one
record, or several: one for each value of a column, or for each interval of time. `columns` names
the columns of an observable and their unit, as in ``omega=gx,gy,-gz:deg/s``; without it, columns
named as in results, and gyroscopes in exports of phyphox and Sensor Logger, are found.
"""

import os
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from rigidmc.errors import OptionError, SceneError, in_file, unknown
from rigidmc.inputs.units import converter, unit_of
from rigidmc.results.reader import open_result
from rigidmc.scene.toml.columns import read_text_columns
from rigidmc.studies.fit.streams import Array

SHIPPED = ("toss",)  # records beside this file, by name: a racket tossed with a phone, simulated
WHEEL = "wheel"  # name of the momentum of a rotor among observables: a known input, not fitted
TIMES = ("t", "seconds_elapsed", "time", "timestamp", "date", "utc", "datetime")  # by rank
MOST_BYTES, MOST_ROWS = 2**27, 1_000_000  # of a text file, and of all records: 2 GB of derivatives
EPOCH = 1e11  # a time since 1970 in seconds is below this until the year 5138
RATES = 1.02  # ratio of rates, stated and of the times, that may be rounding
# units that a name states: "Time (s)" and "w [deg/s]", but not "omega[1]"; "t_ms", "wx_rad_s"
_IN_BRACKETS = re.compile(r"\s*[\[(]([^\])]*[A-Za-z][^\])]*)[\])]\s*$")
_SUFFIX = re.compile(r"_((?:[mu]?rad|deg|rev)_(?:s|min|h|d|day)|[mun]?s|min|h|d|rpm)$")
# names of rates about x, y or z without their units, the surest first: "Gyroscope x", "wx", "x"
_RATES = (
    re.compile(r"(?:gyro(?:scope)?|gyr|rotation ?rate|angular ?(?:rate|velocity)|omega)([xyz])"),
    re.compile(r"[gw]([xyz123])"),
    re.compile(r"([xyz])"),
)
_FACTOR = re.compile(r"(-?)(?:(\d[\d.]*(?:[eE][-+]?\d+)?)(?:\*|$))?(.*)")
_OTHER = re.compile(r"(total)?(accel|gravity|magnet|orient|baro|location)", re.IGNORECASE)


Columns = tuple[tuple[str, ...], str]  # of an observable, and their unit: "" if names state it


class Record(NamedTuple):
    """The samples of a record.

    name : in messages and results
    times : of each observable [s], as measured;  values : (samples, components) in SI units
    wheel : its times and momenta (samples, 3), if one is measured
    notes : about its table, in sentences;  numbers : channels that the user gives, as omega[1]
    """

    name: str
    times: Mapping[str, Array]
    values: Mapping[str, Array]
    wheel: Mapping[str, Array] = {}
    notes: tuple[str, ...] = ()
    numbers: tuple[str, ...] = ()

    @property
    def span(self) -> tuple[float, float]:
        """The times of the first and the last sample."""
        return min(t[0] for t in self.times.values()), max(t[-1] for t in self.times.values())


def read_columns_option(value: Any, at: str) -> dict[str, Columns]:
    """Return {observable: its columns} of texts NAME=A,B,C[:UNIT], or of a mapping of names, or of
    (names, unit); OptionError."""
    texts = (value,) if isinstance(value, str) else value or {}
    if not isinstance(texts, Mapping):
        texts = dict(str(text).partition("=")[::2] for text in texts)
    found = dict[str, Columns]()
    for name, words in texts.items():
        names, unit = words, ""
        if isinstance(words, str):
            words, _, unit = words.partition(":")
            names = [word.strip() for word in words.split(",")]
        elif len(words) == 2 and not isinstance(words[0], str):
            names, unit = words
        if not name.strip() or not any(names) or not all(isinstance(x, str) for x in names):
            rule = "expected OBSERVABLE=COLUMN,...[:UNIT], e.g. omega=gx,gy,gz:deg/s"
            raise OptionError(rule, at=at, value=words or name)
        if unit:
            unit_of(unit, at)
        found[name.strip()] = tuple(names), unit
    return found


def read_records(
    data: Any,
    columns: Mapping[str, Columns],
    units: Mapping[str, str],
    sizes: Mapping[str, int],
    time: str | None = None,
    split: str | None = None,
    between: Sequence[tuple[float, float]] = (),
    rate: float | None = None,
) -> list[Record]:
    """Return the records of a table, or of several tables.

    columns : of each observable; {} to find them by their names
    units, sizes : SI unit and number of components of each observable that a table may have
    time : column of the times, NAME or NAME:UNIT;  split : column whose values are records
    between : intervals of time, a record each
    rate : of the samples [1/s], for a table without times

    Raises OptionError or SceneError for a table without these columns, for times that do not rise,
    and for records without samples.
    """
    tables = data if isinstance(data, (list, tuple)) else (data,)
    records = []
    for table in tables:
        name = os.path.basename(table) if isinstance(table, (str, os.PathLike)) else "data"
        with in_file(str(name)):
            made = _table(table)
            wanted = columns
            if not columns.keys() - {WHEEL}:
                wanted = {**_found(made, sizes, str(name)), **columns}
            t, notes = _times(made, time, rate)
            some = _records(made, t, wanted, units, sizes, split, between, str(name))
            each = [(f"{of}[{i}]", x) for of in wanted for i, x in enumerate(wanted[of][0], 1)]
            numbers = tuple(of for of, x in each if x not in made and _FACTOR.sub(r"\3", x) == "")
            records += [record._replace(notes=notes, numbers=numbers) for record in some]
    if (rows := sum(len(x) for record in records for x in record.values.values())) > MOST_ROWS:
        rule = f"has {rows:,} rows, at most {MOST_ROWS:,} are fitted: shorten it by --between"
        raise OptionError(rule, at="data")
    if len(tables) > 1 or len(records) > 1:
        return records
    return [records[0]._replace(name="data")]


def _table(data: Any) -> dict[str, Any]:
    """Return {name: column, or the rule that forbids it} of a file or an object; OptionError."""
    if isinstance(data, (str, os.PathLike)):
        path = os.fspath(data)
        if not os.path.exists(path) and path in SHIPPED:
            path = os.path.join(os.path.dirname(__file__), f"{path}.csv")
        if not os.path.exists(path):
            raise OptionError("no such file", at="data", value=path)
        if path.lower().endswith((".nc", ".zarr")):
            return _of_dataset(open_result(path))
        if (size := os.path.getsize(path)) > MOST_BYTES:
            rule = f"has {size / 2**20:,.0f} MiB, at most {MOST_BYTES / 2**20:.0f} are read: cut it"
            raise OptionError(rule, at="data", value=path)
        try:
            columns = read_text_columns(path, os.path.basename(path), is_measured=True)
        except ValueError as error:
            raise OptionError(getattr(error, "rule", str(error)), at="data", value=path) from None
        return {name.removeprefix("#").strip(): column for name, column in columns.items()}
    if hasattr(data, "data_vars"):
        return _of_dataset(data)
    if hasattr(data, "reset_index") and data.index.name is not None:
        data = data.reset_index()
    if not hasattr(data, "keys"):
        rule = "expected the path of a table, a mapping of columns, a DataFrame or a Dataset"
        raise OptionError(rule, at="data", value=type(data).__name__)
    if len(set(data.keys())) < len(data.keys()):
        rule = f"several columns have the name {Counter(data.keys()).most_common(1)[0][0]}"
        raise OptionError(rule, at="data")
    return _vectors({str(name): np.asarray(data[name]) for name in data.keys()})  # noqa: SIM118


def _of_dataset(data: Any) -> dict[str, Any]:
    """Return the columns of a Dataset with the dimension time."""
    data, columns = data.squeeze(), {}
    for name, variable in data.variables.items():
        if "time" in variable.dims:
            for other in set(variable.dims) - {"time", "axis", "quat"}:
                rule = f"{name} has {data.sizes[other]} values of {other}: select one"
                raise OptionError(rule, at="data", value=str(name))
            columns[str(name)] = variable.transpose("time", ...).values
    return _vectors(columns)


def _vectors(columns: Mapping[str, Any]) -> dict[str, Any]:
    """Return columns of numbers, or why they are none, of the same length: NAME[1], ... of vectors;
    OptionError."""
    lengths = {name: np.size(x) if np.ndim(x) < 2 else len(x) for name, x in columns.items()}
    if len(set(lengths.values())) > 1:
        each = ", ".join(f"{name} {length}" for name, length in lengths.items())
        raise OptionError(f"columns differ in length: {each}", at="data")
    made = dict[str, Any]()
    for name, x in columns.items():
        if x.dtype.kind in "mM":  # a time, or a time since 1970
            x = np.where(np.isnat(x), np.nan, x.astype(f"{x.dtype.kind}8[ns]").astype(float) * 1e-9)
        try:
            parts = x.astype(float).reshape(lengths[name], -1).T
        except (TypeError, ValueError):
            made[name] = "has text, not numbers"
            continue
        several = len(parts) > 1
        made |= {f"{name}[{i + 1}]" if several else name: part for i, part in enumerate(parts)}
    return made


def _bare(name: str) -> str:
    """Return a name without its unit, spaces and marks, in lower case."""
    return re.sub(r"[\s_.\-]", "", _SUFFIX.sub("", _IN_BRACKETS.sub("", name))).lower()


def _found(table: Mapping[str, Any], sizes: Mapping[str, int], file: str) -> dict[str, Columns]:
    """Return the columns of the observables that a table names; OptionError without any."""
    found = {}
    for name, size in sizes.items():
        names = (name,) if size == 1 else tuple(f"{name}[{i + 1}]" for i in range(size))
        if set(names) <= table.keys():
            found[name] = names, ""
    for pattern in _RATES:
        matches = [(match[1], name) for name in table if (match := pattern.fullmatch(_bare(name)))]
        names = tuple(name for _, name in sorted(matches))
        is_other = pattern is _RATES[-1] and _OTHER.match(file)  # Accelerometer.csv has x, y and z
        if not found and len(names) == 3 == len(dict(matches)) and not is_other:
            found["omega"] = names, ""
    if not found:
        rule = (
            f"no column has the name of an observable; columns: {', '.join(list(table)[:12])}."
            " Say which they are: --columns omega=A,B,C:rad/s"
        )
        raise OptionError(rule, at="columns")
    return found


def _column(table: Mapping[str, Any], name: str, at: str) -> Array:
    if name not in table:
        raise unknown("column", table, at=at, value=name, error=OptionError)
    if isinstance(table[name], str):
        raise OptionError(table[name], at=at, value=name)
    return np.asarray(table[name], float)


def _times(
    table: Mapping[str, Any], time: str | None, rate: float | None
) -> tuple[Array, tuple[str, ...]]:
    """Return (times [s], notes) of a table; OptionError without times and rate."""
    name, unit = time or "", ""
    if time is None:
        name = next((key for word in TIMES for key in table if _bare(key) == _bare(word)), "")
        if not name and rate is not None:
            return np.arange(len(next(iter(table.values())))) / rate, ()
        if not name:
            rule = f"no column of times among {', '.join(list(table)[:12])}: name it, or give rate"
            raise OptionError(rule, at="time")
    elif name not in table and ":" in name:
        name, _, unit = name.rpartition(":")
    t = _column(table, name, "time") * _factor(name, unit, "s")
    known = t[np.isfinite(t)]
    if known.size and np.abs(known).max() > EPOCH:
        rule = f"starts at {known[0]:.4g} s, too late for seconds since 1970: state its unit"
        raise OptionError(f"{rule}, e.g. --time {name}:ns", at="time", value=name)
    notes = list[str]()
    if known.size < t.size:
        notes.append(f"{t.size - known.size:,} rows have no time and are left out")
    if rate is not None and known.size > 1:
        seen = 1.0 / float(np.median(np.diff(known)))
        if not 1.0 / RATES < seen / rate < RATES:
            notes.append(
                f"the times of {name} have {seen:.4g} samples a second, not the rate {rate:g} that"
                " is stated: the times are taken"
            )
    return t, tuple(notes)


def _product(table: Mapping[str, Any], word: str, unit: str, wanted: str) -> Array:
    """Return a column in SI units, also with a sign or a factor before it, as ``-gx`` and
    ``1.7e-6*wheel_rpm``; of a number alone, a column of it; of "", no readings."""
    match = None if word in table else _FACTOR.fullmatch(word)
    sign, number, name = match.groups() if match else ("", "", word)
    factor = float(f"{sign}{number or 1}")
    if not name:
        return np.full(len(next(iter(table.values()))), factor if number else np.nan)
    with np.errstate(over="ignore"):  # a factor may have a unit of its own
        x = _column(table, name, "columns") * factor
        x = x * _factor(name, unit, "" if number else wanted)
    if np.isinf(x).any():
        rule = f"row {np.isinf(x).argmax() + 1} is infinite: leave the cell of a gap empty"
        raise OptionError(rule, at="columns", value=name)
    return x


def _records(
    table: Mapping[str, Any], t: Array, columns: Mapping[str, Columns], units: Mapping[str, str],
    sizes: Mapping[str, int], split: str | None, between: Sequence[tuple[float, float]], name: str,
) -> Iterator[Record]:  # fmt: skip
    """Yield the records of a table with the times t."""
    values = {}
    for observable, (names, unit) in columns.items():
        if observable not in sizes:
            raise unknown("observable", sizes, at="columns", value=observable, error=OptionError)
        if len(names) != sizes[observable]:
            rule = f"{observable} has {sizes[observable]} components, but {len(names)} columns"
            raise OptionError(rule, at="columns", value=",".join(names))
        parts = [_product(table, word, unit, units[observable]) for word in names]
        values[observable] = np.stack(parts, axis=1)
    groups = [(name, np.isfinite(t))]
    if split is not None:
        which = _column(table, split, "split")
        groups = [(f"{split} {x:g}", (which == x) & np.isfinite(t)) for x in np.unique(which)]
    for label, some in groups:
        for low, high in between or ((-np.inf, np.inf),):
            inside = np.flatnonzero(some & (t >= low) & (t <= high))
            if some.any() and not inside.size:
                rule = f"{label} has times from {t[some].min():g} to {t[some].max():g} s"
                raise OptionError(rule, at="between", value=f"{low:g}:{high:g}")
            more = f"{label} {low:g} to {high:g} s" if between else label
            yield _record(more, inside + 1, t[inside], {k: x[inside] for k, x in values.items()})


def _record(name: str, rows: Any, t: Array, values: Mapping[str, Array]) -> Record:
    """Return a record, each observable with the samples that it has; OptionError.

    rows : of the samples in the table, from 1
    """
    rises = np.diff(t) > 0.0
    if not rises.all():
        i = int(np.argmin(rises))
        rule = (
            f"times do not rise in {name}: row {rows[i]} has {t[i]:.9g} s, row {rows[i + 1]}"
            f" {t[i + 1]:.9g} s ({np.count_nonzero(~rises):,} such rows)"
        )
        raise OptionError(rule, at="time")
    times, samples = {}, {}
    for observable, x in values.items():
        is_there = np.isfinite(x).all(1) if observable == WHEEL else np.isfinite(x).any(1)
        if not is_there.any():
            raise OptionError(f"{name} has no samples of {observable}", at="data")
        times[observable], samples[observable] = t[is_there], x[is_there]
    wheel = {"t": times.pop(WHEEL), "momenta": samples.pop(WHEEL)} if WHEEL in times else {}
    return Record(name, times, samples, wheel)


def _factor(name: str, unit: str, wanted: str) -> float:
    """Return the factor to SI of a column: of its unit, or of one that its name states.

    wanted : units that are right; "" for any
    """
    match = _IN_BRACKETS.search(name)
    stated = match[1].replace("day", "d") if match else ""
    if match is None and (suffix := _SUFFIX.search(name)):
        at = unit_of(suffix[1].replace("_", "/").replace("day", "d"), "columns")
        # else a name that ends like a unit
        stated = at.text if not wanted or at.is_for(unit_of(wanted, "columns")) else ""
    given = [text for text in (unit, stated) if text]
    try:
        units = [
            converter(x, wanted, "columns") if wanted else unit_of(x, "columns") for x in given
        ]
    except SceneError as error:
        raise OptionError(f"{name}: {error.rule}", at="columns", nearest=error.nearest) from None
    factors = [float(one.convert(1.0)) for one in units] or [1.0]
    if factors[0] != factors[-1]:
        rule = f"the name of {name} states {stated}, but its unit is given as {unit}"
        raise OptionError(f"{rule}: rename the column if that is right", at="columns", value=unit)
    return factors[0]
