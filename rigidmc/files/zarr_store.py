"""A look at a zarr store before zarr opens it: what is in its folder, and what its arrays claim.

A store of some kB may claim gigabytes, since chunks that are missing are filled in; a chunk may
unpack to more than its array claims, or name a codec that runs code (numcodecs had a `pickle`).
"""

import contextlib
import math
import os
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from rigidmc.errors import FileError
from rigidmc.files.opening import plain, refuse_irregular
from rigidmc.files.reading import bytes_of, json_of

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
    with open(path, "rb", opener=plain) as file:
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
