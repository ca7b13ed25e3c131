"""Starts from files: columns of a CSV or a netCDF file, one row per member."""

import os

import numpy as np

from rigidmc.errors import RigidmcError, SceneError, unknown
from rigidmc.files.reading import refuse_irregular
from rigidmc.files.trial import refuse_unreadable

SUFFIXES = (".csv", ".nc")


def column(folder, file, name, table, key):
    """A column of a table as an array; SceneError that names file and columns for what it has not.

    CSV : comma-separated, the names of the columns in its first line;  netCDF : a variable with one dimension, or `name[i]` of one with members last
    """
    path = os.path.join(folder or "", file)
    if not file.endswith(SUFFIXES):
        raise SceneError(table, key, file, f"expected a file that ends in {' or '.join(SUFFIXES)}")
    if not os.path.exists(path):
        raise SceneError(
            table, key, file, f"no such file in {os.path.abspath(folder or os.curdir)}"
        )
    try:
        columns = _csv(path, table, key, file) if file.endswith(".csv") else _netcdf(path)
    except RigidmcError as why:
        raise why if why.table else SceneError(table, key, file, why.rule) from None
    if name not in columns:
        error = unknown(table, key, name, f"column of {file}", columns)
        error.rule += (
            "; columns are separated by commas"
            if file.endswith(".csv")
            else "; numbers of one row per member are columns"
        )
        raise error
    values = np.ascontiguousarray(columns[name], float)
    bad = np.flatnonzero(~np.isfinite(values))
    if bad.size:
        raise SceneError(
            table,
            key,
            f"{file}: {name}",
            f"row {bad[0] + 1} is no finite number (of {values.size} rows {bad.size} are none)",
        )
    return values


def _csv(path, table, key, file):
    refuse_irregular(path)
    with open(path, encoding="utf-8") as lines:
        try:
            names = [
                word.strip().strip('"')
                for word in lines.readline().strip().lstrip("\ufeff").split(",")
            ]
            text = [line for line in lines if line.strip()]
            rows = np.genfromtxt(text, delimiter=",", ndmin=2) if text else np.empty((0, 0))
        except UnicodeDecodeError:
            raise SceneError(table, key, file, "is no text in UTF-8") from None
        except ValueError as error:
            raise SceneError(
                table,
                key,
                file,
                f"not a table of {len(names)} columns: {str(error).splitlines()[-1].strip()}",
            ) from None
    if not rows.size:
        raise SceneError(
            table, key, file, "has no rows below its first line, which names the columns"
        )
    if rows.shape[1] != len(names):
        rule = f"its first line names {len(names)} columns ({', '.join(names)}), its rows have {rows.shape[1]}; columns are separated by commas"
        raise SceneError(table, key, file, rule)
    return dict(zip(names, rows.T, strict=True))


def _netcdf(path):
    refuse_unreadable(path)
    try:
        return _columns(path)
    except (OSError, ValueError, TypeError, RuntimeError, KeyError, IndexError) as error:
        raise SceneError("", "file", None, f"cannot be read: {error}") from None


def _columns(path):
    import xarray as xr

    with xr.open_dataset(path, engine="netcdf4", decode_times=False, decode_coords=False) as file:
        found = {
            str(name): v.values
            for name, v in file.data_vars.items()
            if v.ndim == 1 and v.dtype.kind in "fiu"
        }
        for name, v in file.data_vars.items():
            if v.ndim == 2 and v.dtype.kind in "fiu" and v.shape[0] <= 6:
                found |= {f"{name}[{i + 1}]": v.values[i] for i in range(v.shape[0])}
        return found
