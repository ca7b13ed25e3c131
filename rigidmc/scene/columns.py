"""Starts from files: columns of a CSV or a netCDF file, one row per member."""

import os
from collections import Counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigidmc.errors import RigidmcError, SceneError, unknown
from rigidmc.files.csv import numbers_of
from rigidmc.files.trial import refuse_unreadable

SUFFIXES = (".csv", ".nc")
_MOST = 6  # components of a variable


def column(folder: str, file: str, name: str, table: str, key: str) -> NDArray[np.float64]:
    """A column of a file as an array; SceneError that names the file and its columns.

    CSV : comma-separated, with the names of the columns in the first line
    netCDF : a variable with one dimension, or `name[i]` of a variable with the dimensions axis or
        quat and member; without these names the members are last, and more than 6
    """
    path = os.path.join(folder or "", file)
    if not file.endswith(SUFFIXES):
        raise SceneError(table, key, file, f"expected a file that ends in {' or '.join(SUFFIXES)}")
    if not os.path.exists(path):
        where = os.path.abspath(folder or os.curdir)
        raise SceneError(table, key, file, f"no such file in {where}")
    try:
        columns = _csv(path, table, key, file) if file.endswith(".csv") else _netcdf(path)
    except RigidmcError as why:
        raise why if why.table else SceneError(table, key, file, why.rule) from None
    if name not in columns:
        error = unknown(table, key, name, f"column of {file}", columns)
        error.rule += (
            "; columns are separated by commas"
            if file.endswith(".csv")
            else "; columns are variables with one number per member, and NAME[1], NAME[2], ... of"
            " variables with the dimensions (axis, member)"
        )
        raise error
    if columns[name] is None:
        rule = f"{name} is the name of several columns: give each of them a name of its own"
        raise SceneError(table, key, file, rule)
    values = np.ascontiguousarray(columns[name], float)
    bad = np.flatnonzero(~np.isfinite(values))
    if bad.size:
        rule = f"row {bad[0] + 1} is not finite ({bad.size} of {values.size} rows are not)"
        raise SceneError(table, key, f"{file}: {name}", rule)
    return values


def _csv(path: str, table: str, key: str, file: str) -> dict[str, Any]:
    """{name: values} of the columns of a CSV file, None for a name of several; SceneError."""
    try:
        names, rows = numbers_of(path)
    except UnicodeDecodeError:
        raise SceneError(table, key, file, "is not text in UTF-8") from None
    except RigidmcError:
        raise
    except ValueError as error:
        why = str(error).splitlines()[-1].strip()
        raise SceneError(table, key, file, f"not a table of numbers: {why}") from None
    if not rows.size:
        rule = "has no rows below its first line, which names the columns"
        raise SceneError(table, key, file, rule)
    if rows.shape[1] != len(names):
        rule = (
            f"its first line names {len(names)} columns ({', '.join(names[:20])}), its rows have"
            f" {rows.shape[1]}; columns are separated by commas"
        )
        raise SceneError(table, key, file, rule)
    counts, pairs = Counter(names), zip(names, rows.T, strict=True)
    return {name: None if counts[name] > 1 else values for name, values in pairs}


def _netcdf(path: str) -> dict[str, Any]:
    """{name: values} of the columns of a netCDF file; SceneError."""
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
        raise SceneError("", "file", None, f"cannot be read: {error}") from None
    return columns


def _components(variable: Any) -> Any:
    """The rows of a variable of two dimensions, one for each component; none if it has no
    components, or does not say which dimension they are along."""
    if variable.ndim != 2:
        return ()
    first, last = (name in ("axis", "quat") for name in variable.dims)
    first, last = first or variable.dims[1] == "member", last or variable.dims[0] == "member"
    rows = variable.values.T if last and not first else variable.values
    named = first != last
    # without names the members are last, unless both dimensions are short enough for components
    short = len(rows) <= _MOST and (named or rows.shape[1] > _MOST)
    return rows if short else ()
