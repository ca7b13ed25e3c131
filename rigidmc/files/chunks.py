"""Read one variable of many netCDF4 files of the same kind, with plain reads of their chunks.

The shards of a run differ in values, not in metadata: the metadata of the first one say where the
chunks are in all others with the same bytes of metadata. A read costs 0.05 ms a shard, opening it
in the C library 3 ms (python -m bench reading).

Whatever is unexpected in a file, such as a wrong checksum, is left to the C library, whose errors
say what it is.
"""

import math
import os
import threading
import zlib
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigidmc.files.hdf5 import (
    DEFLATE,
    FLETCHER32,
    HEAD,
    SHUFFLE,
    Chunk,
    Metadata,
    Stored,
    Unfamiliar,
    chunks_of,
    read_metadata,
)
from rigidmc.files.opening import open_plain

LARGEST = 2**28  # bytes of a variable in a file; the C library reads larger ones no slower
_BATCH = 2**19  # bytes of chunks whose checksums are computed together: they stay in the cache
_ROW = 512  # words of eight bytes in a row of a checksum
_KINDS = 64  # kinds of metadata to remember
_RECENT = 4096  # files to remember: several variables of a group of them are read one by one


class Part(NamedTuple):
    """The values of a variable that one file has.

    path : of the file;  first, members : index of its first member, and how many it has
    out : array for the values
    """

    path: str
    first: int
    members: int
    out: NDArray[Any]


def read_parts(parts: Sequence[Part], name: str, mark: str) -> list[Part]:
    """Fill the arrays of parts with variable `name` of their files; return the parts for which the
    C library is needed.

    mark : attribute `run` of each file
    Raises FileError for a path that is a link, a pipe or a folder.
    """
    left, batch = list[Part](), _Batch()
    for part in parts:
        try:
            _read_part(part, name, mark, batch)
        except (OSError, Unfamiliar, zlib.error):
            left.append(part)
    return left + batch.finish()


def _read_part(part: Part, name: str, mark: str, batch: "_Batch") -> None:
    """Read the values of a part, or put them into a batch whose checksum is still unknown."""
    out = part.out
    if out.nbytes > LARGEST:
        raise Unfamiliar("large")
    file = open_plain(part.path, os.O_RDONLY)
    try:
        metadata, first = _opened(part.path, file)
        stored, member = metadata.variables.get(name), metadata.variables["member"]
        if stored is None or metadata.texts.get("run") != mark:
            raise Unfamiliar("another run, or a file of an earlier version")
        if (stored.shape, np.dtype(stored.dtype)) != (out.shape, out.dtype):
            raise Unfamiliar("shape")
        if (member.shape, first) != ((part.members,), part.first):
            raise Unfamiliar("members of another shard")
        if stored.filters == (-1,):
            out[...] = np.frombuffer(_bytes(file, stored.at, out.nbytes), out.dtype).reshape(
                out.shape
            )
            return
        chunks = chunks_of(stored, lambda at, size: _bytes(file, at, size))
        if len(chunks) == 1 and stored.filters == (FLETCHER32,) and stored.chunk == out.shape:
            batch.add(part, file, chunks[0])
            return
        for chunk in chunks:
            _place(out, chunk, batch.unpacked(file, chunk, stored))
    finally:
        os.close(file)


def _bytes(file: int, at: int, size: int) -> bytes:
    """Return `size` bytes of an open file from place `at` on; Unfamiliar if it is shorter."""
    try:
        data = os.pread(file, size, at)
    except OverflowError:
        raise Unfamiliar("place") from None
    if len(data) < size:
        raise Unfamiliar("beyond the end")
    return data


_files: dict[str, tuple[tuple[int, ...], Metadata, int]] = {}  # by path


def _opened(path: str, file: int) -> tuple[Metadata, int]:
    """Return (metadata, first member) of an open file; Unfamiliar."""
    facts = os.fstat(file)
    state = (facts.st_dev, facts.st_ino, facts.st_size, facts.st_mtime_ns)
    recent = _files.get(path)
    if recent is not None and recent[0] == state:
        return recent[1:]
    metadata = _metadata(file)
    member = metadata.variables.get("member")
    if member is None or member.filters != (-1,) or member.dtype != "<i8":
        raise Unfamiliar("members")
    first = int.from_bytes(_bytes(file, member.at, 8), "little", signed=True)
    if len(_files) >= _RECENT:
        _files.clear()
    _files[path] = state, metadata, first
    return metadata, first


_known: dict[tuple[tuple[int, int], ...], dict[bytes, Metadata]] = {}  # by spans, by their bytes


def _metadata(file: int) -> Metadata:
    """Return the metadata of an open file."""
    head = os.pread(file, max((spans[-1][1] for spans in _known), default=HEAD), 0)
    for spans, kinds in list(_known.items()):
        stored = kinds.get(_taken(head, spans))
        if stored is not None:
            return stored
    head = os.pread(file, HEAD, 0)
    made = read_metadata(head)
    if sum(map(len, list(_known.values()))) >= _KINDS:
        _known.clear()
    _known.setdefault(made.spans, {})[_taken(head, made.spans)] = made
    return made


def _taken(head: bytes, spans: tuple[tuple[int, int], ...]) -> bytes:
    return b"".join([head[low:high] for low, high in spans])


class _Batch:
    """Chunks of one size whose checksums are computed together, and the last packed chunk:
    all chunks of a variable that all members share are equal."""

    def __init__(self) -> None:
        self._last: tuple[bytes, NDArray[Any]] = b"", np.empty(0)
        self._parts = list[Part]()
        self._failed = list[Part]()
        self._rows = np.empty((0, 0), np.uint8)

    def add(self, part: Part, file: int, chunk: Chunk) -> None:
        """Read a chunk with the checksum that follows its values."""
        size = part.out.nbytes + 4
        if chunk.size != size:
            raise Unfamiliar("size of a chunk")
        width = -(-size // (8 * _ROW)) * 8 * _ROW
        if self._parts and (
            len(self._parts) == len(self._rows) or self._parts[0].out.nbytes != part.out.nbytes
        ):
            self._check()
        if not self._parts and self._rows.shape[1] != width:
            self._rows = np.zeros((max(1, _BATCH // width), width), np.uint8)
        row = self._rows[len(self._parts)]
        if os.preadv(file, [row[:size].data], chunk.at) < size:
            raise Unfamiliar("beyond the end")
        self._parts.append(part)

    def unpacked(self, file: int, chunk: Chunk, stored: Stored) -> NDArray[Any]:
        """Return the values of a packed chunk."""
        size = np.dtype(stored.dtype).itemsize * math.prod(stored.chunk)
        size_with_sums = size + 4 * stored.filters.count(FLETCHER32)
        if size > LARGEST or chunk.size > size_with_sums + size_with_sums // 1000 + 1024:
            raise Unfamiliar("size of a chunk")
        data = _bytes(file, chunk.at, chunk.size)
        if data != self._last[0]:
            self._last = data, _unpacked(data, stored, size_with_sums)
        return self._last[1]

    def _check(self) -> None:
        """Compare the checksums; copy the values that have theirs."""
        parts, self._parts = self._parts, []
        size, rows = parts[0].out.nbytes, self._rows[: len(parts)]
        stored = rows[:, size : size + 4].copy().view("<u4")[:, 0]
        rows[:, size:] = 0
        for part, row, right in zip(parts, rows, _is_right(rows, size, stored), strict=True):
            if right:
                out = part.out
                out[...] = row[:size].view(out.dtype).reshape(out.shape)
            else:
                self._failed.append(part)

    def finish(self) -> list[Part]:
        """Check the last chunks; return the parts whose checksums are wrong."""
        if self._parts:
            self._check()
        return self._failed


def _is_right(rows: NDArray[np.uint8], size: int, stored: NDArray[Any]) -> NDArray[np.bool_]:
    """Whether rows (k, n) of `size` bytes and zeros have these checksums; Fletcher's are equal
    modulo 65535."""
    first, second = fletcher32(rows, size)
    is_right: NDArray[np.bool_] = ((stored & 0xFFFF) % 65535 == first) & (
        (stored >> 16) % 65535 == second
    )
    return is_right


def fletcher32(rows: NDArray[np.uint8], size: int) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return both sums, modulo 65535, of Fletcher's checksum of each row.

        sum w_i,  sum (N - i) w_i   over the N big-endian words w_i of 16 bits

    rows : (k, n) with n a multiple of 4096, zeros after the first `size` bytes; at most 64 MB each

    Words are summed two by two, in the halves of words of 64 bits. Swapping the bytes of a word
    multiplies it by 256, modulo 65535, and so does swapping the bytes of a sum.
    """
    lanes, low, half = np.uint64(0x0000FFFF0000FFFF), np.uint64(0xFFFFFFFF), np.uint64(32)
    words = rows.view("<u8").reshape(len(rows), -1, _ROW)
    # new arrays would take three times as long: their pages are cleared each time
    even, odd = _scratch(words.shape)
    np.bitwise_and(words, lanes, even)
    np.bitwise_and(np.right_shift(words, np.uint64(16), odd), lanes, odd)
    by_even, by_odd = even.sum(2), odd.sum(2)
    by_column = np.add(even, odd, even).sum(1)
    # within four words of 16 bits, the places 1, 2 and 3
    within = (by_odd & low) + 2 * (by_even >> half) + 3 * (by_odd >> half)
    by_row, by_column = ((x & low) + (x >> half) for x in (by_even + by_odd, by_column))
    row, column = (np.arange(n, dtype=np.uint64) for n in (by_row.shape[1], _ROW))
    first = by_row.sum(1) % 65535
    places = _ROW * ((by_row * row).sum(1) % 65535) + (by_column * column).sum(1)
    weighted = (4 * (places % 65535) + within.sum(1)) % 65535
    two = (-(-size // 2) % 65535 * first + 65535 - weighted) % 65535
    return first * 256 % 65535, two * 256 % 65535


_local = threading.local()


def _scratch(shape: tuple[int, ...]) -> NDArray[np.uint64]:
    """Return two arrays of a shape, which the next call in this thread overwrites."""
    size = 2 * math.prod(shape)
    if getattr(_local, "words", np.empty(0)).size < size:
        _local.words = np.empty(size, np.uint64)
    words: NDArray[np.uint64] = _local.words[:size].reshape(2, *shape)
    return words


def _unpacked(data: bytes, stored: Stored, size: int) -> NDArray[Any]:
    """Return the values of a chunk, with its filters undone; Unfamiliar.

    size : its bytes without filters, with its checksums
    """
    dtype = np.dtype(stored.dtype)
    for kind in reversed(stored.filters):
        if kind == DEFLATE:
            stream = zlib.decompressobj()
            data = stream.decompress(data, size)
            if not stream.eof:
                raise Unfamiliar("packed data")
        elif kind == SHUFFLE:
            end = len(data) // dtype.itemsize * dtype.itemsize  # a checksum follows, as it is
            rows = np.frombuffer(data[:end], np.uint8).reshape(dtype.itemsize, -1)
            data = rows.T.tobytes() + data[end:]
        else:
            data, check = data[:-4], data[-4:]
            if len(data) > LARGEST // 4 or not _holds(data, check):
                raise Unfamiliar("checksum")
    if len(data) != dtype.itemsize * math.prod(stored.chunk):
        raise Unfamiliar("size of a chunk")
    return np.frombuffer(data, dtype).reshape(stored.chunk)


def _holds(data: bytes, check: bytes) -> bool:
    """Whether a checksum is that of some bytes."""
    width = -(-len(data) // (8 * _ROW)) * 8 * _ROW
    row = np.zeros((1, width), np.uint8)
    row[0, : len(data)] = np.frombuffer(data, np.uint8)
    return bool(_is_right(row, len(data), np.frombuffer(check, "<u4"))[0])


def _place(out: NDArray[Any], chunk: Chunk, values: NDArray[Any]) -> None:
    """Copy the values of a chunk to their place; those beyond the end are padding."""
    place = tuple(
        slice(low, min(low + n, end))
        for low, n, end in zip(chunk.offset, values.shape, out.shape, strict=True)
    )
    out[place] = values[tuple(slice(0, part.stop - part.start) for part in place)]
