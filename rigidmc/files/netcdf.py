"""Results on disk: netCDF files, zarr stores, and the one thread that calls the C library.

A zarr store is looked through before zarr opens it. A store of some kB may claim gigabytes, since
chunks that are missing are filled in; a chunk may unpack to more than its array claims, or name a
codec that runs code (numcodecs had a `pickle`).
"""

import contextlib
import ctypes
import math
import os
import shutil
import threading
from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple, TypeVar

import netCDF4
import numpy as np
import xarray as xr
from numpy.typing import NDArray
from xarray.backends.netCDF4_ import NETCDF4_PYTHON_LOCK

from rigidmc.errors import FileError
from rigidmc.files.opening import is_zarr, open_plain, refuse_irregular
from rigidmc.files.outputs import Path
from rigidmc.files.processes import unlock_in_fork
from rigidmc.files.reading import bytes_of, json_of
from rigidmc.files.trial import refuse_unreadable
from rigidmc.threads import Task, threads_of

T = TypeVar("T")
_opening = threading.Lock()


def in_netcdf_thread(function: Callable[..., T], *arguments: Any) -> T:
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
        unlock_in_fork(file.filepath())
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
        return in_netcdf_thread(values)
    except (OSError, RuntimeError, IndexError) as error:
        # the system's own errors have positive numbers, those of the library negative ones
        if isinstance(error, OSError) and (error.errno or 0) > 0:
            raise
        rule = f"is damaged, or is not what it should be: {error}"
        raise FileError(rule, at="file", file=path) from None


PACKED = 1100  # as of `rigidmc.files.trial`: what is stored unpacks to so many times its bytes
FREE = 2**28  # bytes that a store may claim in any case: zeros and constants take next to nothing
MOST = 10**6  # files of a store, and chunks of its arrays
_METADATA = (".zarray", ".zgroup", ".zattrs", ".zmetadata", "zarr.json")
# codecs that unpack no more than they announce, or PACKED times of what they are given at most
_PACKERS = ("blosc", "zlib", "gzip", "zstd", "lz4")
_CODECS = (*_PACKERS, "bytes", "crc32c", "crc32", "transpose")


class _Array(NamedTuple):
    """What the metadata of an array say: bytes of all its values and of a chunk, the number of its
    chunks, and how they are packed."""

    size: int
    chunk: int
    chunks: int
    packer: str


def refuse_hostile(path: str) -> None:
    """Raise FileError for a store that has links or pipes, claims more data than it can hold, or
    needs codecs beyond those that results and their copies have."""
    found = list(_files(path))
    stored = sum(entry.stat(follow_symlinks=False).st_size for entry in found)
    budget = FREE + PACKED * stored
    arrays: dict[str, _Array] = {}
    for entry in found:
        if entry.name in (".zarray", "zarr.json"):
            with _damaged(entry.path):
                array = _described(json_of(bytes_of(entry.path, links=False).decode("utf-8")))
                if array is not None:
                    arrays[os.path.dirname(entry.path)] = array
    claimed = sum(max(array.size, array.chunk) for array in arrays.values())
    if claimed > budget or sum(array.chunks for array in arrays.values()) > MOST:
        rule = f"claims to hold {claimed / 1e6:,.0f} MB in a store of {stored / 1e6:,.3f} MB"
        raise FileError(rule, at="file", file=path)
    for entry in found:
        if entry.name not in _METADATA:
            _refuse_swollen(entry.path, arrays)


def _files(path: str) -> Iterator[os.DirEntry[str]]:
    """All files of a store; FileError for what is neither a file nor a folder, and for too many."""
    folders, count = [path], 0
    while folders:
        with os.scandir(folders.pop()) as entries:
            for entry in entries:
                count += 1
                if count > MOST:
                    rule = f"has more than {MOST:,} files"
                    raise FileError(rule, at="file", file=path)
                if entry.is_dir(follow_symlinks=False):
                    folders.append(entry.path)
                else:
                    refuse_irregular(entry.path, entry.stat(follow_symlinks=False).st_mode)
                    yield entry


@contextlib.contextmanager
def _damaged(path: str) -> Iterator[None]:
    """Errors of what is not laid out as metadata are, as FileError."""
    try:
        yield
    except FileError:
        raise
    except Exception as error:  # anything may stand in them, and NumPy reads names of types
        rule = f"is no metadata of zarr that results have: {error}"
        raise FileError(rule, at="file", file=path) from None


def _described(data: dict[str, Any]) -> _Array | None:
    """What the metadata of an array claim, None for those of a group; ValueError and others."""
    if data["zarr_format"] == 2:
        chunks, word = data["chunks"], data["dtype"]
        codecs = [data.get("compressor"), *(data.get("filters") or [])]
        names = [codec["id"] for codec in codecs if codec is not None]
    elif data["node_type"] == "group":
        return None
    else:
        chunks, word = data["chunk_grid"]["configuration"]["chunk_shape"], data["data_type"]
        names = [codec["name"] for codec in data["codecs"]]
        if data["chunk_grid"]["name"] != "regular" or data.get("storage_transformers"):
            raise ValueError("its chunks are not regular")
    packers = [name for name in names if name in _PACKERS]
    if (unknown := [name for name in names if name not in _CODECS]) or len(packers) > 1:
        raise ValueError(f"it needs the codecs {', '.join(map(str, unknown or packers))}")
    if isinstance(word, dict):  # text of fixed length
        word = f"S{int(word['configuration']['length_bytes'])}"
    dtype = np.dtype(word)
    if dtype.kind not in "biufSU":
        raise ValueError(f"its type is {word!r}")
    shape = data["shape"]
    if not all(type(n) is int and n >= 0 for n in (*shape, *chunks)) or len(shape) != len(chunks):
        raise ValueError(f"its shape is {shape!r}, in chunks of {chunks!r}")
    each = max(1, dtype.itemsize)
    count = math.prod(-(-n // max(1, chunk)) for n, chunk in zip(shape, chunks, strict=True))
    return _Array(each * math.prod(shape), each * math.prod(chunks), count, "".join(packers))


def _refuse_swollen(path: str, arrays: dict[str, _Array]) -> None:
    """Raise FileError for a chunk that announces more bytes than a chunk of its array has."""
    folder = os.path.dirname(path)
    while folder not in arrays:
        folder, before = os.path.dirname(folder), folder
        if folder == before:
            return
    with open(path, "rb", opener=open_plain) as file:
        announced = _announced(arrays[folder].packer, file.read(18))
    if announced > arrays[folder].chunk:
        rule = f"unpacks to {announced:,} bytes, a chunk has {arrays[folder].chunk:,}"
        raise FileError(rule, at="chunk", file=path)


def _announced(packer: str, head: bytes) -> int:
    """How many bytes a chunk unpacks to, by its first bytes; 0 for a packer that cannot tell, whose
    size is limited by that of the file. What is too short is an error of the codec's own."""
    head = head.ljust(18, b"\0")
    if packer == "blosc":
        return int.from_bytes(head[4:8], "little")
    if packer == "lz4":
        return int.from_bytes(head[:4], "little")
    if packer != "zstd":
        return 0
    # RFC 8878, 3.1.1.1: magic, descriptor, window, dictionary, size
    flag, single, dictionary = head[4] >> 6, head[4] >> 5 & 1, head[4] & 3
    at = 6 - single + (0, 1, 2, 4)[dictionary]
    width = (single, 2, 4, 8)[flag]
    if not width or head[:4] != b"\x28\xb5\x2f\xfd":
        return 2**63  # of no size, or no such frame
    return int.from_bytes(head[at : at + width], "little") + 256 * (flag == 1)
