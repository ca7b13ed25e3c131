"""Find the chunks of the variables of a netCDF4 file, by reading its HDF5 metadata.

The C library needs 3 ms to open a file, in one thread. This module reads the metadata that
`rigidmc.results.writer` makes, and nothing else: for any other content it raises Unfamiliar, and
the caller reads the file with the C library.

A file may be of others. Its metadata are read from at most HEAD bytes and the nodes of the trees
that belong to known variables; all places and sizes are checked against the file, and nothing is
followed twice.

Source: HDF5 File Format Specification, version 3.0, sections II.A to IV.A.
"""

import math
import struct
from collections.abc import Callable, Iterator
from typing import NamedTuple

HEAD = 2**18  # bytes of the metadata of a shard; 20 kB for 17 variables
MOST = 2**14  # messages of an object, links of a group, and chunks of a variable
DEEP = 8  # levels of a tree
NOWHERE = 2**64 - 1  # address of what has not been written
DEFLATE, SHUFFLE, FLETCHER32 = 1, 2, 3  # filters

# messages of an object
SPACE, LINKS, TYPE, LAYOUT, FILTERS, ATTRIBUTE, CONTINUED = 0x01, 0x02, 0x03, 0x08, 0x0B, 0x0C, 0x10
LINK = 0x06

Read = Callable[[int, int], bytes]  # (place, size) -> bytes of a file


class Unfamiliar(Exception):
    """The content of a file is not of the kind that this module reads."""


class Stored(NamedTuple):
    """Where a variable is in a file.

    shape, dtype : of its values;  chunk : shape of a chunk
    filters : ids of the filters of a chunk, in the order of writing; -1 for a contiguous variable
    at : place of the tree of its chunks, or of its values if contiguous;  size : of the latter
    """

    shape: tuple[int, ...]
    dtype: str
    chunk: tuple[int, ...]
    filters: tuple[int, ...]
    at: int
    size: int


class Chunk(NamedTuple):
    """A chunk in a file. offset : of its first value in the variable;  at, size : place, bytes"""

    offset: tuple[int, ...]
    at: int
    size: int


class Metadata(NamedTuple):
    """The metadata of a file, without the trees of its chunks.

    variables : {name: Stored};  texts : {name: text} of attributes of the file
    spans : (begin, end) of the bytes that were read; a file with the same bytes there has the same
        metadata
    """

    variables: dict[str, Stored]
    texts: dict[str, str]
    spans: tuple[tuple[int, int], ...]


def read_metadata(head: bytes) -> Metadata:
    """Read the metadata of a file from its first bytes, at most HEAD of them; Unfamiliar."""
    reader = _Reader(head)
    try:
        # base address 0; the address of the end of the file follows, which depends on packed values
        if reader.take(0, 20) != b"\x89HDF\r\n\x1a\n\x02\x08\x08\x00" + bytes(8):
            raise Unfamiliar("superblock")
        (root,) = struct.unpack("<Q", reader.take(36, 8))
        messages = list(reader.messages(root))
        texts = dict(_text(data) for kind, data in messages if kind == ATTRIBUTE)
        variables = {}
        for name, at in reader.links(messages):
            stored = _stored(list(reader.messages(at)))
            if stored is not None:
                variables[name] = stored
    except (struct.error, IndexError, UnicodeDecodeError, ValueError) as error:
        raise Unfamiliar(str(error)) from None
    return Metadata(variables, texts, reader.spans())


def chunks_of(stored: Stored, read: Read) -> list[Chunk]:
    """Read the tree of a chunked variable; Unfamiliar if it is not complete and in order."""
    grid = [-(-n // c) for n, c in zip(stored.shape, stored.chunk, strict=True)]
    count = math.prod(grid)
    if not 0 < count <= MOST or stored.at == NOWHERE:
        raise Unfamiliar("chunks")
    chunks: list[Chunk] = []
    try:
        _walk(stored.at, len(stored.shape), read, count, None, chunks)
    except struct.error as error:
        raise Unfamiliar(str(error)) from None
    expected = _offsets(grid, stored.chunk)
    if len(chunks) != count or any(c.offset != o for c, o in zip(chunks, expected, strict=True)):
        raise Unfamiliar("order of chunks")
    return chunks


def _offsets(grid: list[int], chunk: tuple[int, ...]) -> Iterator[tuple[int, ...]]:
    """Yield the offsets of all chunks, the last axis first."""
    if not grid:
        yield ()
        return
    for i in range(grid[0]):
        for rest in _offsets(grid[1:], chunk[1:]):
            yield (i * chunk[0], *rest)


def _walk(
    at: int, rank: int, read: Read, most: int, level: int | None, chunks: list[Chunk]
) -> None:
    """Append the chunks below a node of a tree (version 1, type 1) to `chunks`."""
    each = 8 + 8 * (rank + 1) + 8
    data = read(at, 24 + each)
    signature, kind, mine, used = struct.unpack_from("<4sBBH", data)
    if signature != b"TREE" or kind != 1 or mine > DEEP or level not in (None, mine):
        raise Unfamiliar("tree")
    if not 0 < used <= most - len(chunks):
        raise Unfamiliar("entries of a tree")
    if used > 1:
        data = read(at, 24 + used * each)
    for i in range(used):
        size, mask, *offset, child = struct.unpack_from(f"<II{rank + 2}Q", data, 24 + i * each)
        if mine:
            _walk(child, rank, read, most, mine - 1, chunks)
        else:
            if mask or offset[-1]:
                raise Unfamiliar("a chunk without its filters")
            chunks.append(Chunk(tuple(offset[:-1]), child, size))


class _Reader:
    """Reads objects from the first bytes of a file."""

    def __init__(self, head: bytes) -> None:
        self._head, self._taken = head[:HEAD], list[tuple[int, int]]()
        self._left = 8 * HEAD  # bytes that may be read in all: loops end here

    def take(self, at: int, size: int) -> bytes:
        """Return `size` bytes from place `at` on; Unfamiliar if they are not there."""
        self._left -= size + 1
        if size < 0 or at + size > len(self._head) or self._left < 0:
            raise Unfamiliar("metadata beyond the head")
        self._taken.append((at, at + size))
        return self._head[at : at + size]

    def spans(self) -> tuple[tuple[int, int], ...]:
        """Return the (begin, end) of the bytes that were taken, in order and joined."""
        joined: list[tuple[int, int]] = []
        for low, high in sorted(self._taken):
            if joined and low <= joined[-1][1]:
                joined[-1] = joined[-1][0], max(high, joined[-1][1])
            else:
                joined.append((low, high))
        return tuple(joined)

    def messages(self, at: int) -> Iterator[tuple[int, bytes]]:
        """Yield (kind, data) of the messages of an object header, version 2."""
        signature, version, flags = struct.unpack("<4sBB", self.take(at, 6))
        if signature != b"OHDR" or version != 2 or flags & 0x20:
            raise Unfamiliar("object header")
        at += 6 + 4 * bool(flags & 0x10)
        width = 1 << (flags & 3)
        size = int.from_bytes(self.take(at, width), "little")
        parts = [(at + width, size)]
        ordered = 2 * bool(flags & 4)
        for at, size in parts:
            place, end = at, at + size
            self.take(at, size + 4)  # with the checksum
            while place + 4 + ordered <= end:
                kind, length, how = struct.unpack("<BHB", self.take(place, 4))
                data = self.take(place + 4 + ordered, length)
                place += 4 + ordered + length
                if kind == CONTINUED:
                    more, count = struct.unpack("<QQ", data)
                    if self.take(more, 4) != b"OCHK":
                        raise Unfamiliar("continuation")
                    parts.append((more + 4, count - 8))
                elif how & 2:
                    if kind in (SPACE, TYPE, LAYOUT, FILTERS):
                        raise Unfamiliar("shared message")
                else:
                    yield kind, data

    def links(self, messages: list[tuple[int, bytes]]) -> Iterator[tuple[str, int]]:
        """Yield (name, place of the object) of the links of a group."""
        yield from (_link(data) for kind, data in messages if kind == LINK)
        for data in (data for kind, data in messages if kind == LINKS):
            flags = data[1]
            heap, names = struct.unpack_from("<QQ", data, 2 + 8 * (flags & 1))
            if heap != NOWHERE:
                yield from self._dense(heap, names)

    def _dense(self, heap: int, names: int) -> Iterator[tuple[str, int]]:
        """Yield the links in a fractal heap, in the order of the tree of their names."""
        blocks, id_size = self._blocks(heap)
        for record in self._records(names):
            if len(record) != 4 + id_size or record[4] & 0x30 or record[4] >> 6:
                raise Unfamiliar("heap id")
            offset = int.from_bytes(record[5:9], "little")
            length = int.from_bytes(record[9 : 5 + id_size - 1], "little")
            for low, size, at in blocks:
                if low <= offset and offset + length <= low + size:
                    yield _link(self.take(at + offset - low, length))
                    break
            else:
                raise Unfamiliar("heap")

    def _blocks(self, at: int) -> tuple[list[tuple[int, int, int]], int]:
        """Return ([(offset, size, place) of the direct blocks of a fractal heap], bytes of an
        id)."""
        data = self.take(at, 146)
        signature, version, id_size, filters = struct.unpack_from("<4sBHH", data)
        width, first, largest, bits = struct.unpack_from("<HQQH", data, 110)
        root, rows = struct.unpack_from("<QH", data, 132)
        if signature != b"FRHP" or version or filters or (id_size, bits) != (7, 32):
            raise Unfamiliar("heap")
        if not rows:
            self._signed(root, b"FHDB")
            return [(0, first, root)], id_size
        self._signed(root, b"FHIB")
        blocks, offset, place = [], 0, root + 5 + 8 + bits // 8
        for row in range(rows):
            size = first << max(0, row - 1)
            if size > largest:
                raise Unfamiliar("indirect blocks")
            for _ in range(width):
                (block,) = struct.unpack("<Q", self.take(place, 8))
                if block != NOWHERE:
                    self._signed(block, b"FHDB")
                    blocks.append((offset, size, block))
                place, offset = place + 8, offset + size
        return blocks, id_size

    def _records(self, at: int) -> Iterator[bytes]:
        """Yield the records of a tree of version 2 with at most one level."""
        self._signed(at, b"BTHD")
        node, each, depth = struct.unpack("<IHH", self.take(at + 6, 8))
        root, used = struct.unpack("<QH", self.take(at + 16, 10))
        if root == NOWHERE:
            return
        if depth > 1 or not 0 < each <= 64 or node > HEAD:
            raise Unfamiliar("tree of names")
        self._signed(root, b"BTIN" if depth else b"BTLF")
        data = self.take(root + 6, used * each)
        records = [data[i * each : (i + 1) * each] for i in range(used)]
        if depth:
            most = (node - 10) // each
            width = 1 if most < 256 else 2
            place = root + 6 + used * each
            for _ in range(used + 1):
                (leaf,) = struct.unpack("<Q", self.take(place, 8))
                count = int.from_bytes(self.take(place + 8, width), "little")
                self._signed(leaf, b"BTLF")
                data = self.take(leaf + 6, count * each)
                records += [data[i * each : (i + 1) * each] for i in range(count)]
                place += 8 + width
        yield from records

    def _signed(self, at: int, signature: bytes) -> None:
        if self.take(at, 4) != signature:
            raise Unfamiliar(signature.decode())


def _link(data: bytes) -> tuple[str, int]:
    """Return (name, place) of a hard link."""
    version, flags = data[:2]
    if version != 1:
        raise Unfamiliar("link")
    at = 2
    if flags & 8:
        if data[at]:
            raise Unfamiliar("soft link")
        at += 1
    at += 8 * bool(flags & 4) + bool(flags & 16)
    width = 1 << (flags & 3)
    size = int.from_bytes(data[at : at + width], "little")
    name = data[at + width : at + width + size].decode("utf-8")
    (place,) = struct.unpack_from("<Q", data, at + width + size)
    return name, place


# complete messages of the types that results have, little endian
_TYPES = {
    bytes.fromhex(text): dtype
    for text, dtype in {
        "11203f000800000000004000340b0034ff030000": "<f8",
        "11201f000400000000002000170800177f000000": "<f4",
        "100800000800000000004000": "<i8",
        "100800000400000000002000": "<i4",
        "100800000100000000000800": "<i1",
    }.items()
}


def _stored(messages: list[tuple[int, bytes]]) -> Stored | None:
    """Return where a variable is; None for an object that is none, or of another type."""
    content = dict(messages)
    if not {SPACE, TYPE, LAYOUT} <= content.keys():
        return None
    dtype = next((t for m, t in _TYPES.items() if content[TYPE].startswith(m)), None)
    if dtype is None:
        return None
    each = int(dtype[2:])
    version, rank, _, plain = struct.unpack_from("<BBBB", content[SPACE])
    if version != 2 or plain != 1 or not rank:
        return None
    shape = struct.unpack_from(f"<{rank}Q", content[SPACE], 4)
    layout, kind = content[LAYOUT][:2]
    if layout != 3:
        raise Unfamiliar("layout")
    if kind == 1:
        at, size = struct.unpack_from("<QQ", content[LAYOUT], 2)
        return Stored(shape, dtype, shape, (-1,), at, size)
    if kind != 2 or content[LAYOUT][2] != rank + 1:
        return None
    at, *chunk, last = struct.unpack_from(f"<Q{rank + 1}I", content[LAYOUT], 3)
    if last != each or not all(chunk):
        raise Unfamiliar("chunks")
    filters = _filters(content[FILTERS], each) if FILTERS in content else ()
    return Stored(shape, dtype, tuple(chunk), filters, at, 0)


def _filters(data: bytes, each: int) -> tuple[int, ...]:
    """Return the ids of the filters of a variable."""
    version, count = data[:2]
    at, ids = (8 if version == 1 else 2), []
    for _ in range(count):
        kind, *_ = struct.unpack_from("<H", data, at)
        at += 2
        size = 0
        if version == 1 or kind >= 256:
            (size,) = struct.unpack_from("<H", data, at)
            at += 2
        _, values = struct.unpack_from("<HH", data, at)
        at += 4 + (-(-size // 8) * 8 if version == 1 else size)
        values_of = struct.unpack_from(f"<{values}I", data, at)
        at += 4 * values + 4 * (version == 1 and values % 2)
        if kind not in (DEFLATE, SHUFFLE, FLETCHER32) or (kind == SHUFFLE and values_of != (each,)):
            raise Unfamiliar("filter")
        ids.append(kind)
    return tuple(ids)


def _text(data: bytes) -> tuple[str, str]:
    """Return (name, text) of an attribute of fixed length; the text is "" for any other."""
    version, shared, names, types, spaces = struct.unpack_from("<BBHHH", data)
    if version != 3 or shared:
        raise Unfamiliar("attribute")
    at = 9  # after the encoding of the name
    name = data[at : at + names].rstrip(b"\0").decode("utf-8")
    kind = data[at + names]
    if kind & 15 != 3:  # not a string of fixed length
        return name, ""
    return name, data[at + names + types + spaces :].rstrip(b"\0").decode("utf-8")
