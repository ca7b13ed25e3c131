"""netCDF files: opening and reading them, and the one thread that calls the C library."""

import contextlib
import ctypes
import os
import shutil
import threading
from collections.abc import Callable, Iterator, Mapping
from typing import Any, TypeVar

import netCDF4
import numpy as np
import xarray as xr
from numpy.typing import NDArray
from xarray.backends.netCDF4_ import NETCDF4_PYTHON_LOCK

from rigidmc.errors import FileError
from rigidmc.files.opening import is_zarr
from rigidmc.files.outputs import Path
from rigidmc.files.processes import unlock
from rigidmc.files.trial import refuse_unreadable
from rigidmc.files.zarr_store import refuse_hostile
from rigidmc.threads import Task, threads_of

T = TypeVar("T")
_opening = threading.Lock()


def alone(function: Callable[..., T], *arguments: Any) -> T:
    """Call a function that uses the C library while no other thread does: it is not thread-safe.

    xarray holds its lock while it reads values, and when it closes a dropped Dataset, which happens
    in any thread at any time. It holds no lock while it opens a file, so `open_undecoded` and
    `open_trusted` hold another one. Without them a run crashed within a second if results were
    dropped or opened beside it.

    The main thread hands the call to another thread: a signal then only makes it stop waiting, and
    the next call waits for this one to end, see `rigidmc.threads`.
    """

    def call() -> T:
        with _opening, NETCDF4_PYTHON_LOCK:
            return function(*arguments)

    if threading.current_thread() is threading.main_thread():
        task = Task(call)  # not dropped: a call of the library goes on to its end
        threads_of("netCDF", 1).begin(task)
        value: T = task.wait()
        return value
    return call()


def close_once(file: netCDF4.Dataset) -> None:
    """Close a file once. If that fails, the C library keeps a number for what it has freed, and
    crashes when the file is closed again. Its lock ends, also if a fork has the file open."""
    try:
        unlock(file.filepath())
        file.close()
    except BaseException:
        ctypes.pythonapi.Py_IncRef(ctypes.py_object(file))  # the collector would close it again
        raise


@contextlib.contextmanager
def naming_failures(path: Path) -> Iterator[None]:
    """Name the file and the free space if writing fails: the C library tells no file or reason."""
    try:
        yield
    except RuntimeError as error:
        free = shutil.disk_usage(os.path.dirname(os.path.abspath(path))).free
        raise OSError(
            f"{path}: could not be written, with {free / 1e9:.2f} GB free there: {error}"
        ) from None


def open_trusted(path: Path) -> xr.Dataset:
    """A file that this process has just written, as a lazily read Dataset, without checks."""
    with _opening:
        return xr.open_dataset(path, engine="netcdf4")


def open_undecoded(path: str) -> xr.Dataset:
    """A netCDF file or a zarr store from outside as a Dataset that is read lazily. Its attributes
    are not trusted, so nothing is decoded. Raises FileError for any other folder or file, and for
    a damaged one."""
    if is_zarr(path):
        return _open_zarr(path)
    if os.path.isdir(path):
        raise FileError("is a folder, and no result of rigidmc", at="file", file=path)
    if path.lower().endswith((".csv", ".parquet")):
        rule = "is a table, which pandas reads; a result that rigidmc reads ends in .nc or .zarr"
        raise FileError(rule, at="file", file=path)
    refuse_unreadable(path)
    try:
        with _opening:
            return xr.open_dataset(path, engine="netcdf4", decode_cf=False)
    except (ValueError, TypeError, RuntimeError, KeyError, IndexError) as error:
        rule = f"is damaged, or no result of rigidmc: {error}"
        raise FileError(rule, at="file", file=path) from None


def _open_zarr(path: str) -> xr.Dataset:
    try:
        import zarr  # noqa: F401
    except ImportError as error:
        rule = f"is read with zarr: pip install 'rigidmc[zarr]' ({error})"
        raise FileError(rule, at="file", file=path) from None
    refuse_hostile(path)
    try:
        # consolidated metadata may be missing, and listing a folder is quick
        return xr.open_dataset(
            path, engine="zarr", chunks=None, decode_cf=False, consolidated=False
        )
    except Exception as error:  # zarr, its codecs and its parsers raise many kinds
        rule = f"is damaged, or no result of rigidmc: {error}"
        raise FileError(rule, at="file", file=path) from None


def read(
    path: str, *names: str, mark: str | None = None, newer: Mapping[str, Any] | None = None
) -> dict[str, NDArray[Any]]:
    """{name: array} of variables of a file as they were written; of all if none are named.

    newer : {name: value} of numbers by member that files of earlier versions lack, and the value
        that stands for these
    Raises FileError for a shard of another `mark`, a damaged file and a missing variable.
    """

    def values_of(file: netCDF4.Dataset, name: str) -> NDArray[Any]:
        if newer and name in newer and name not in file.variables:
            return np.full(file["member"].shape, newer[name])
        return np.asarray(file[name][:])

    def values() -> dict[str, NDArray[Any]]:
        with netCDF4.Dataset(path) as file:
            if mark is not None and str(getattr(file, "run", None)) != mark:
                rule = "is of another run: another scene, seed, rows or code"
                raise FileError(rule, at="shard", file=path)
            file.set_auto_mask(False)
            file.set_auto_scale(False)
            file.set_auto_chartostring(False)
            return {name: values_of(file, name) for name in names or file.variables}

    refuse_unreadable(path)
    try:
        return alone(values)
    except (OSError, RuntimeError, IndexError) as error:
        # the system's own errors have positive numbers, those of the library negative ones
        if isinstance(error, OSError) and (error.errno or 0) > 0:
            raise
        rule = f"is damaged, or is not what it should be: {error}"
        raise FileError(rule, at="file", file=path) from None
