"""Results that are opened: netCDF files from outside, checked against the scene that they carry."""

import os
import warnings

import xarray as xr

from rigidmc.errors import FileError, SceneWarning
from rigidmc.files.netcdf import open_undecoded
from rigidmc.scene.stored import scene_text
from rigidmc.storage.border import as_result


def open_result(path: str | os.PathLike[str]) -> xr.Dataset:
    """A result as a Dataset that is read lazily; FileError if the file is no result of rigidmc, see
    `rigidmc.storage.border`. Variables that a user added are kept."""
    path = os.fspath(path)
    dataset = open_undecoded(path)
    try:
        scene_text(dataset)
        if "status" not in dataset:
            rule = (
                "a map or a study, not a result with members; xarray.open_dataset reads it, and"
                " `rigidmc map FILE` a map"
            )
            raise FileError("", "file", None, rule, file=path)
        result, strange = as_result(dataset, path)
    except BaseException:
        dataset.close()
        raise
    left = []
    for name in strange:
        try:
            result = result.assign({name: _added(dataset, name)})
        except Exception:  # attributes of a file from outside may be anything
            left.append(name)
    if left:
        more = f" and {len(left) - 5:,} more" if len(left) > 5 else ""
        names = ", ".join(left[:5]) + more
        warnings.warn(
            f"{path}: left out variables whose attributes cannot be decoded: {names}",
            SceneWarning,
            stacklevel=3,
        )
    result.set_close(dataset.close)
    result.encoding["source"] = dataset.encoding.get("source", os.path.abspath(path))
    return result


def _added(dataset: xr.Dataset, name: str) -> xr.Variable:
    """A variable that a user added to a result, as xarray reads it."""
    whole = xr.Dataset({name: dataset.variables[name]})
    decoded = xr.decode_cf(whole, decode_timedelta=False)
    variable: xr.Variable = decoded.variables[name]
    return variable
