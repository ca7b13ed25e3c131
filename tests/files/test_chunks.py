"""Plain reads of chunks against the C library, and files that lie."""

import os
import struct
import zlib

import netCDF4
import numpy as np
import pytest

from rigidmc.errors import FileError
from rigidmc.files import chunks, hdf5
from rigidmc.files.netcdf import read

MARK = "a" * 64
RANDOM = np.random.default_rng(3)
MANY = 40  # variables: their names need a tree and several blocks


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """A file like a shard, with every kind of chunk that a shard may have."""
    path, made = str(tmp_path_factory.mktemp("chunks") / "shard.nc"), {}
    with netCDF4.Dataset(path, "w") as file:
        file.set_fill_off()
        file.run = MARK
        for name, size in {"member": 1000, "axis": 3, "time": 5, "flagged": None}.items():
            file.createDimension(name, size)
        made[file.createVariable("member", "i8", ("member",))] = np.arange(7000, 8000)

        def add(name, dims, values, pieces=None, **more):
            pieces = pieces or values.shape
            more = {"chunksizes": pieces, "fletcher32": True, **more}
            variable = file.createVariable(name, values.dtype, dims, **more)
            made[variable] = values

        add("one", ("member",), RANDOM.normal(size=1000))
        add("bytes", ("member",), RANDOM.integers(-9, 9, 1000).astype("i1"))
        add("whole", ("member",), RANDOM.integers(-9, 9, 1000))
        add("single", ("member",), RANDOM.normal(size=1000).astype("f4"))
        add("vector", ("axis", "member"), RANDOM.normal(size=(3, 1000)))
        add("saves", ("time", "axis", "member"), RANDOM.normal(size=(5, 3, 1000)), (2, 2, 300))
        packed = {"compression": "zlib", "complevel": 1}
        add("equal", ("axis", "member"), np.full((3, 1000), 0.1), shuffle=False, **packed)
        add("packed", ("axis", "member"), RANDOM.normal(size=(3, 1000)), shuffle=True, **packed)
        special = np.array([np.nan, np.inf, -0.0, 5e-324] * 250)
        add("special", ("member",), special, (64,), shuffle=True, **packed)
        for i in range(MANY):
            add(f"more_{i}_{'x' * i}", ("member",), np.full(1000, float(i)))
        for variable, values in made.items():  # as a shard: after all are defined
            variable[:] = values
    return path


def part(path, like, first=7000, members=1000):
    return chunks.Part(path, first, members, np.empty(like.shape, like.dtype))


def test_every_variable_is_read_as_by_the_library(written):
    values = read(written)
    assert len(values) == MANY + 10
    for name, expected in values.items():
        one = part(written, expected)
        assert chunks.read_parts([one], name, MARK) == [], name
        assert one.out.tobytes() == expected.tobytes(), name


def test_fletcher_by_its_definition():
    for size in (1, 2, 3, 4096, 4099, 50_001):
        data = RANDOM.integers(0, 256, size, np.uint8)
        rows = np.zeros((1, -(-size // 4096) * 4096), np.uint8)
        rows[0, :size] = data
        one = two = 0
        for word in np.append(data, [0] * (size % 2)).reshape(-1, 2).astype(int):
            one = (one + 256 * word[0] + word[1]) % 65535
            two = (two + one) % 65535
        assert [int(x[0]) for x in chunks.fletcher32(rows, size)] == [one, two]


def test_what_is_unexpected_is_left_to_the_library(written, tmp_path):
    one = read(written, "one")["one"]
    for given, mark in (
        (part(written, one, first=6999), MARK),
        (part(written, one, members=999), MARK),
        (part(written, one), "b" * 64),
        (part(written, one[:999]), MARK),
        (part(written, one.astype("f4")), MARK),
        (part(str(tmp_path / "missing.nc"), one), MARK),
    ):
        assert chunks.read_parts([given], "one", mark) == [given]
    assert len(chunks.read_parts([part(written, one)], "none", MARK)) == 1
    os.symlink(written, tmp_path / "link.nc")
    with pytest.raises(FileError, match="is a link"):
        chunks.read_parts([part(str(tmp_path / "link.nc"), one)], "one", MARK)


def test_no_flipped_bit_changes_a_value(written, tmp_path):
    """Each bit flipped somewhere in a file: values are right, or left to the library."""
    with open(written, "rb") as file:
        data = file.read()
    names = ["one", "saves", "packed", "more_9_xxxxxxxxx"]
    known, left, path = read(written, *names), 0, str(tmp_path / "flipped.nc")
    places = [*range(0, 1500, 50), *RANDOM.integers(0, len(data), 40).tolist()]
    for at in places:
        wrong = bytearray(data)
        wrong[at] ^= 1 << (at % 8)
        with open(path, "wb") as file:
            file.write(wrong)
        for name in names:
            one = part(path, known[name])
            refused = chunks.read_parts([one], name, MARK)
            left += len(refused)
            assert refused or one.out.tobytes() == known[name].tobytes(), (at, name)
    assert left > 20  # measured 48: some flips are noticed


def test_places_that_lie_are_refused(written, tmp_path):
    """A tree that names places beyond the file, itself, or too many chunks."""
    with open(written, "rb") as file:
        data = file.read()
    stored = hdf5.read_metadata(data[: hdf5.HEAD]).variables["saves"]

    def chunks_with(place, value):
        wrong = bytearray(data)
        struct.pack_into("<Q", wrong, place, value)
        return hdf5.chunks_of(stored, lambda at, size: bytes(wrong[at : at + size]))

    entry = stored.at + 24
    assert len(hdf5.chunks_of(stored, lambda at, size: data[at : at + size])) == 3 * 2 * 4
    with pytest.raises(hdf5.Unfamiliar):
        chunks_with(entry + 8, 2)  # another order of chunks
    with pytest.raises(hdf5.Unfamiliar):  # a level, whose children are the node itself
        wrong = bytearray(data)
        wrong[stored.at + 5] = 1
        for i in range(24):
            struct.pack_into("<Q", wrong, entry + 48 * i + 40, stored.at)
        hdf5.chunks_of(stored, lambda at, size: bytes(wrong[at : at + size]))
    huge = stored._replace(shape=(2**60, 3, 1000))
    with pytest.raises(hdf5.Unfamiliar):
        hdf5.chunks_of(huge, lambda at, size: data[at : at + size])


def test_a_chunk_unpacks_to_no_more_than_it_claims():
    bomb = zlib.compress(bytes(10**7), 1)
    stored = hdf5.Stored((10,), "<f8", (10,), (hdf5.DEFLATE,), 0, 0)
    with pytest.raises(hdf5.Unfamiliar):
        chunks._unpacked(bomb, stored, 80)
