"""Columns of CSV and netCDF files, with one row per member, to which a scene file refers."""

import os
import warnings
from collections import Counter
from typing import Any

import numpy as np

from rigidmc.errors import RigidmcError, SceneError, SceneWarning, unknown
from rigidmc.files.tables import TextColumn, read_number_table
from rigidmc.files.trial import refuse_unreadable
from rigidmc.inputs.arrays import Array

SUFFIXES = (".csv", ".nc")
_MOST = 6  # components of a variable


def read_column(folder: str, file: str, name: str, at: str) -> Array:
    """Return a column of a file as an array, see `read_columns`."""
    return read_columns(folder, file, [name], at)[0]


def read_columns(folder: str, file: str, names: list[str], at: str) -> tuple[Array, ...]:
    """Return columns of a file as arrays; SceneError that names the file and its columns.

    CSV : separated by commas or semicolons, with the names of the columns in the first line, see
        `rigidmc.files.tables`
    netCDF : a variable with one dimension, or `name[i]` of a variable with the dimensions axis or
        quat and member; without these names, the last dimension is the member, of length > 6
    """
    path = os.path.join(folder or "", file)
    if not file.lower().endswith(SUFFIXES):
        raise SceneError(f"expected a file that ends in {' or '.join(SUFFIXES)}", at=at, value=file)
    if not os.path.exists(path):
        where = os.path.abspath(folder or os.curdir)
        raise SceneError(f"no such file in {where}", at=at, value=file)
    is_text = file.lower().endswith(".csv")
    try:
        columns = read_text_columns(path, file) if is_text else _netcdf(path)
    except ValueError as error:
        raise SceneError(getattr(error, "rule", str(error)), at=at, value=file) from None
    for name in names:
        if name not in columns:
            wrong = unknown(f"column of {file}", columns, at=at, value=name)
            wrong.rule += (
                "; columns are separated by commas or semicolons"
                if is_text
                else "; columns are variables with one number per member, and NAME[1], NAME[2], ..."
                " for variables with the dimensions (axis, member)"
            )
            raise wrong
    return tuple(_finite(columns[name], file, name, at) for name in names)


def _finite(column: Any, file: str, name: str, at: str) -> Array:
    """Return a column of finite numbers; SceneError that names its first bad row."""
    if isinstance(column, str):
        raise SceneError(column, at=at, value=f"{file}: {name}")
    values = np.ascontiguousarray(column, float)
    bad = np.flatnonzero(~np.isfinite(values))
    if bad.size:
        rule = f"row {bad[0] + 1} is not finite ({bad.size} of {values.size} rows are not)"
        raise SceneError(rule, at=at, value=f"{file}: {name}")
    return values


def read_text_columns(path: str, file: str, is_measured: bool = False) -> dict[str, Any]:
    """Return {name: numbers, or the rule that forbids the column} of a text file; ValueError.

    is_measured : see `rigidmc.files.tables.read_number_table`
    """
    try:
        table = read_number_table(path, is_measured)
    except UnicodeDecodeError:
        raise ValueError("is not UTF-8 text: unpack it, or export CSV") from None
    except RigidmcError:
        raise
    except ValueError as error:
        raise ValueError(f"not a table of numbers: {error}") from None
    if not table.rows:
        raise ValueError("has no rows below its first line, the names of the columns")
    if table.notes:
        warnings.warn(f"{file}: {'; '.join(table.notes)}", SceneWarning, stacklevel=2)
    counts = Counter(table.names)
    return {
        name: f"several columns have the name {name}: give each its own name"
        if counts[name] > 1
        else _rule_of_column(column)
        for name, column in zip(table.names, table.columns, strict=True)
    }


def _rule_of_column(column: Array | TextColumn | None) -> Any:
    """Return the numbers of a column, or why it has none."""
    if column is None:
        return (
            "has decimal points, but other columns have decimal commas: write all numbers with one"
            " kind"
        )
    if not isinstance(column, TextColumn):
        return column
    if not column.cell.strip():
        return f"row {column.row} is empty: give its number, or delete the row"
    more = ""
    if "," in column.cell and "." in column.cell:
        more = ": write it without marks between thousands"
    elif "," in column.cell:
        more = "; a comma is the decimal point only if semicolons separate the columns"
    return f"row {column.row} is text, '{column.cell}', not a number{more}"


def _netcdf(path: str) -> dict[str, Any]:
    """Return {name: values} of the columns of a netCDF file; ValueError."""
    import xarray as xr

    refuse_unreadable(path)
    columns: dict[str, Any] = {}
    try:
        with xr.open_dataset(
            path, engine="netcdf4", decode_times=False, decode_coords=False
        ) as file:
            numeric = {str(k): v for k, v in file.data_vars.items() if v.dtype.kind in "fiu"}
            columns |= {name: v.values for name, v in numeric.items() if v.ndim == 1}
            for name, v in numeric.items():
                rows = _components(v)
                columns |= {f"{name}[{i + 1}]": row for i, row in enumerate(rows)}
    except (OSError, ValueError, TypeError, RuntimeError, KeyError, IndexError) as error:
        raise ValueError(f"cannot be read: {error}") from None
    return columns


def _components(variable: Any) -> Any:
    """Return the rows of a two-dimensional variable, one per component; () if it has no components,
    or if their dimension is ambiguous."""
    if variable.ndim != 2:
        return ()
    first, last = (name in ("axis", "quat") for name in variable.dims)
    first, last = first or variable.dims[1] == "member", last or variable.dims[0] == "member"
    rows = variable.values.T if last and not first else variable.values
    named = first != last
    # without names, the members are last; ambiguous if both dimensions are short
    short = len(rows) <= _MOST and (named or rows.shape[1] > _MOST)
    return rows if short else ()
