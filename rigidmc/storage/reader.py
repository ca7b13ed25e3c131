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
    `rigidmc.storage.border`."""
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
    if strange:
        more = f" and {len(strange) - 5:,} more" if len(strange) > 5 else ""
        names = ", ".join(strange[:5]) + more
        warnings.warn(
            f"{path}: left out variables that no result of its scene has: {names}",
            SceneWarning,
            stacklevel=3,
        )
    result.set_close(dataset.close)
    result.encoding["source"] = dataset.encoding.get("source", os.path.abspath(path))
    return result
