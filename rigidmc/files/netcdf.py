"""Results on disk: netCDF files, zarr stores, and the one thread that calls the C library.

The package checks a zarr store before zarr opens it. A store of a few kB may claim gigabytes,
because zarr fills in missing chunks; a chunk may unpack to more than its array claims, or name a
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
from rigidmc.files.reading import bytes_of, json_of
from rigidmc.files.stores import local_copy
from rigidmc.files.trial import refuse_unreadable
from rigidmc.processes.helpers import unlock_in_fork
from rigidmc.processes.threads import Task, threads_of

T = TypeVar("T")
_opening = threading.Lock()


def in_netcdf_thread(function: Callable[..., T], *arguments: Any) -> T:
    """Call a function of the C library while no other thread uses it: it is not thread-safe.

    xarray holds its lock while it reads values and while it closes a dropped Dataset, which happens
    in any thread at any time. It holds no lock while it opens a file, so `open_undecoded` and
    `open_trusted` hold another one. Without these locks, a run crashed within a second when results
    were dropped or opened during the run.

    The main thread hands the call to another thread: a signal then only ends the wait, and the
    next call waits until this one ends, see `rigidmc.processes.threads`.
    """

    def call() -> T:
        with _opening, NETCDF4_PYTHON_LOCK:
            return function(*arguments)

    if threading.current_thread() is threading.main_thread():
        task = Task(call)  # never dropped: a call of the library always completes
        threads_of("netCDF", 1).begin(task)
        value: T = task.wait()
        return value
    return call()


def close_once(file: netCDF4.Dataset) -> None:
    """Close a file once and release its lock, even if a fork has the file open. If closing fails,
    the C library keeps a handle of freed memory, and a second close would crash."""
    try:
        unlock_in_fork(file.filepath())
        file.close()
    except BaseException:
        ctypes.pythonapi.Py_IncRef(ctypes.py_object(file))  # else the collector closes it again
        raise


@contextlib.contextmanager
def naming_failures(path: Path) -> Iterator[None]:
    """Name the file and the free space if writing fails: the C library reports neither file nor
    reason."""
    try:
        yield
    except RuntimeError as error:
        free = shutil.disk_usage(os.path.dirname(os.path.abspath(path))).free
        raise OSError(
            f"{path}: could not be written; {free / 1e9:.2f} GB are free there: {error}"
        ) from None


def open_trusted(path: Path) -> xr.Dataset:
    """Open a file that this process has just written as a lazily read Dataset, without checks."""
    with _opening:
        return xr.open_dataset(path, engine="netcdf4")


def open_undecoded(path: str) -> xr.Dataset:
    """Open an untrusted netCDF file or zarr store as a lazily read Dataset. Nothing is decoded,
    because its attributes are not trusted. Raises FileError for a damaged file and for any other
    folder or file."""
    if is_zarr(path):
        return _open_zarr(path)
    if os.path.isdir(path):
        raise FileError("is a folder, not a result of rigidmc", at="file", file=path)
    if path.lower().endswith((".csv", ".parquet")):
        rule = "is a table; read it with pandas. rigidmc reads results that end in .nc or .zarr"
        raise FileError(rule, at="file", file=path)
    refuse_unreadable(path)
    try:
        with _opening:
            return xr.open_dataset(path, engine="netcdf4", decode_cf=False)
    except (ValueError, TypeError, RuntimeError, KeyError, IndexError) as error:
        rule = f"is damaged, or not a result of rigidmc: {error}"
        raise FileError(rule, at="file", file=path) from None


def _open_zarr(path: str) -> xr.Dataset:
    try:
        import zarr  # noqa: F401
    except ImportError as error:
        rule = f"needs the package zarr: pip install 'rigidmc[zarr]' ({error})"
        raise FileError(rule, at="file", file=path) from None
    refuse_hostile(path)
    try:
        # consolidated metadata may be missing, and listing a folder is quick
        return xr.open_dataset(
            path, engine="zarr", chunks=None, decode_cf=False, consolidated=False
        )
    except Exception as error:  # zarr, its codecs and its parsers raise many kinds
        rule = f"is damaged, or not a result of rigidmc: {error}"
        raise FileError(rule, at="file", file=path) from None


def read(
    path: str, *names: str, mark: str | None = None, newer: Mapping[str, Any] | None = None
) -> dict[str, NDArray[Any]]:
    """Return {name: array} of a file's variables as written; all variables if no name is given.

    newer : {name: value} of per-member variables that files of earlier versions lack, with the
        value that replaces them
    Raises FileError for a shard with another `mark`, a damaged file, or a missing variable.
    """
    with local_copy(path) as file:
        return _read(file, names, mark, newer or {})


def _read(
    path: str, names: tuple[str, ...], mark: str | None, newer: Mapping[str, Any]
) -> dict[str, NDArray[Any]]:
    """Read variables of a file here; see `read`."""

    def values_of(file: netCDF4.Dataset, name: str) -> NDArray[Any]:
        if name in newer and name not in file.variables:
            return np.full(file["member"].shape, newer[name])
        return np.asarray(file[name][:])

    def values() -> dict[str, NDArray[Any]]:
        with netCDF4.Dataset(path) as file:
            if mark is not None and str(getattr(file, "run", None)) != mark:
                rule = "belongs to another run: its scene, seed, rows or code differs"
                raise FileError(rule, at="shard", file=path)
            file.set_auto_mask(False)
            file.set_auto_scale(False)
            file.set_auto_chartostring(False)
            return {name: values_of(file, name) for name in names or file.variables}

    refuse_unreadable(path)
    try:
        return in_netcdf_thread(values)
    except (OSError, RuntimeError, IndexError) as error:
        # system errors have positive numbers, library errors negative ones
        if isinstance(error, OSError) and (error.errno or 0) > 0:
            raise
        rule = f"is damaged, or has unexpected content: {error}"
        raise FileError(rule, at="file", file=path) from None


PACKED = 1100  # largest ratio of unpacked to stored bytes, as in `rigidmc.files.trial`
FREE = 2**28  # bytes that any store may claim: zeros and constants occupy almost nothing
MOST = 10**6  # files of a store, and chunks of its arrays
_METADATA = (".zarray", ".zgroup", ".zattrs", ".zmetadata", "zarr.json")
# codecs that unpack no more than they announce, or at most PACKED times their input
_PACKERS = ("blosc", "zlib", "gzip", "zstd", "lz4")
_CODECS = (*_PACKERS, "bytes", "crc32c", "crc32", "transpose")


class _Array(NamedTuple):
    """Claims of an array's metadata: bytes of all values and of a chunk, number of chunks, and
    codec that packs them."""

    size: int
    chunk: int
    chunks: int
    packer: str


def refuse_hostile(path: str) -> None:
    """Raise FileError for a store that contains links or pipes, claims more data than it can hold,
    or needs codecs that results and their copies do not use."""
    files = list(_files(path))
    stored = sum(entry.stat(follow_symlinks=False).st_size for entry in files)
    budget = FREE + PACKED * stored
    arrays: dict[str, _Array] = {}
    for entry in files:
        if entry.name in (".zarray", "zarr.json"):
            with _damaged(entry.path):
                array = _described(json_of(bytes_of(entry.path, links=False).decode("utf-8")))
                if array is not None:
                    arrays[os.path.dirname(entry.path)] = array
    claimed = sum(max(array.size, array.chunk) for array in arrays.values())
    if claimed > budget or sum(array.chunks for array in arrays.values()) > MOST:
        rule = f"claims to hold {claimed / 1e6:,.0f} MB in a store of {stored / 1e6:,.3f} MB"
        raise FileError(rule, at="file", file=path)
    for entry in files:
        if entry.name not in _METADATA:
            _refuse_swollen(entry.path, arrays)


def _files(path: str) -> Iterator[os.DirEntry[str]]:
    """Yield all files of a store; FileError for an entry that is neither a file nor a folder, and
    for too many files."""
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
    """Convert errors from malformed metadata to FileError."""
    try:
        yield
    except FileError:
        raise
    except Exception as error:  # they may contain anything, and NumPy parses their type names
        rule = f"is not the zarr metadata of a result: {error}"
        raise FileError(rule, at="file", file=path) from None


def _described(data: dict[str, Any]) -> _Array | None:
    """Return the claims of an array's metadata, None for a group; raises ValueError and others."""
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
    """Raise FileError for a chunk that announces more bytes than its array's chunks have."""
    folder = os.path.dirname(path)
    while folder not in arrays:
        folder, before = os.path.dirname(folder), folder
        if folder == before:
            return
    with open(path, "rb", opener=open_plain) as file:
        announced = _announced(arrays[folder].packer, file.read(18))
    if announced > arrays[folder].chunk:
        rule = f"unpacks to {announced:,} bytes, but a chunk has {arrays[folder].chunk:,}"
        raise FileError(rule, at="chunk", file=path)


def _announced(packer: str, head: bytes) -> int:
    """Return the unpacked size that a chunk's first bytes announce; 0 for a codec without such a
    field, whose output the file size limits. The codec itself refuses a chunk that is too short."""
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
        return 2**63  # no size given, or not a zstd frame
    return int.from_bytes(head[at : at + width], "little") + 256 * (flag == 1)
