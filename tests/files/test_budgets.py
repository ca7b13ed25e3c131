"""What a file asks for is in proportion to its size: none of these took less than 2 GB or 30 s."""

import contextlib
import json
import os
import pickle
import random
import re
import signal
import tomllib

import numcodecs
import numpy as np
import pytest
import zarr

import rigidmc as rm
from rigidmc.errors import FileError, RigidmcError, SceneError, nearest, path_of
from rigidmc.files import reading
from rigidmc.files.netcdf import refuse_hostile
from rigidmc.mechanics import mesh
from rigidmc.scene.toml.columns import read_column
from tests.tools.faulty import LINUX

pytestmark = LINUX


@contextlib.contextmanager
def bounded(seconds=5.0, size=3e8):
    """At most so many seconds of computing, and so much more memory."""

    def late(*_):
        raise AssertionError("it takes too long")

    def resident():
        with open("/proc/self/status") as file:
            return 1024 * int(re.search(r"VmHWM:\s*(\d+)", file.read())[1])

    with contextlib.suppress(OSError), open("/proc/self/clear_refs", "w") as file:
        file.write("5")
    began = resident()
    before = signal.signal(signal.SIGPROF, late)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)
    assert resident() - began < size


@pytest.mark.parametrize(
    "text",
    ['a = "' + '\\"' * 10**6, '"""\\' * 500_000, "'''" * 500_001,
     '"' * 1_999_999, '"""' + "\\" * 10**6,
     '""" ' * 500_001, "a=[" + "[]," * 600_000, "[a]\n" * 500_000, "9" * 2_000_000],
)  # fmt: skip
def test_a_text_takes_time_in_proportion_to_its_length(text):
    """Before: an unclosed string of 100 kB took 45 s. Measured 0.02 to 1.5 s for 2 MB."""
    with bounded(), pytest.raises(SceneError):
        reading.toml(text)


def test_strings_of_toml_are_found_as_toml_has_them():
    """The truth: a text without its strings and comments has the brackets of its values."""
    some, found = random.Random(1), 0
    words = ['"', '\\"', "\\\\", '"""', "'", "'''", "#", "\n", "[", "]", "x", " ", ","]
    while found < 500:
        inner = "".join(some.choices(words, k=some.randint(1, 10)))
        text = f"a = [{inner}]"
        with contextlib.suppress(tomllib.TOMLDecodeError):

            def depth(value):
                return 1 + max(map(depth, value), default=0) if isinstance(value, list) else 0

            wanted = depth(tomllib.loads(text)["a"])
            plain = reading._STRINGS.sub("", text)
            level = most = 0
            for letter in plain:
                level += (letter == "[") - (letter == "]")
                most = max(most, level)
            assert (most, level) == (wanted, 0), text
            found += 1


def test_messages_are_no_longer_than_a_screen():
    long = "x" * 10**6
    for error in (
        RigidmcError(long, at=path_of(long, long), value=long, nearest=long, file=long),
        SceneError(f"known: {long}", at="key", value=10**5000),
    ):
        assert len(str(error)) < 2 * 80 * 24
    assert nearest(long, [long, long + "y"]) is None
    assert nearest("abcd", (f"abc{i}" for i in range(10**6))) in [f"abc{i}" for i in range(10)]
    assert len(str(rm.errors.unknown("key", [long] * 1000, key="a"))) < 2 * 80 * 24


def table(folder, text, name="a"):
    (folder / "t.csv").write_text(text)
    return read_column(str(folder), "t.csv", name, "start.omega")


def test_csv_files_are_read_in_pieces(tmp_path):
    values = np.random.default_rng(1).normal(size=50_000)
    text = "a,b\n" + "".join(f"{x!r},1\n" for x in values.tolist())
    assert (table(tmp_path, text) == values).all()
    for bad, words in (
        ("a\n1\n2,3\n", "not a table"), ("a,b\n1,2\n3\n", "not a table"), ("a\n", "no rows"),
        ("ab," * 700_000 + "\n1\n", "more than 1,048,576 characters"),
        ("a\n1\n" + "," * 2**21, "characters"),
        ("a,b\n1\n" * 2, "columns"), ("\x00" * 100 + "\n1\n", "no such column"), ("", "no rows"),
    ):  # fmt: skip
        with bounded(), pytest.raises(SceneError, match=words) as told:
            table(tmp_path, bad)
        assert len(str(told.value)) < 2000
    with open(tmp_path / "t.csv", "wb") as file:
        file.truncate(2**33)
    with bounded(), pytest.raises(SceneError, match="characters"):
        read_column(str(tmp_path), "t.csv", "a", "start.omega")


@pytest.fixture
def store(tmp_path):
    path = tmp_path / "a.zarr"
    rm.simulate(rm.Scene.load("nasa_brick"), members=4, t_end=0.1, output=path).close()
    return path


def test_a_zarr_store_of_ours_opens(store, tmp_path):
    with rm.open(store) as ds:
        ds.load().drop_encoding().to_zarr(tmp_path / "b.zarr", zarr_format=2)
    with rm.open(tmp_path / "b.zarr") as again:
        assert again.identical(ds) or (again.omega.values == ds.omega.values).all()


@pytest.mark.parametrize(
    ("what", "words"),
    [("shape", "claims to hold"), ("chunks", "claims to hold"), ("tiny", "claims to hold"),
     ("pickle", "codec"), ("filter", "codec"), ("object", "type"), ("bomb", "unpacks to"),
     ("unknown size", "unpacks to"), ("text", "not the zarr metadata"), ("link", "a link"),
     ("pipe", "a pipe"), ("linked", "a link")],
)  # fmt: skip
def test_a_zarr_store_that_asks_for_too_much_is_refused(store, tmp_path, what, words):
    file, folder = store / "omega" / ".zarray", store / "omega"
    data, chunk = json.loads(file.read_text()), folder / "0.0.0"
    count = 10**9
    if what in ("shape", "chunks"):
        data["shape"][-1] = data["chunks"][-1] = count
        if what == "shape":
            data["chunks"][-1] = 4
    elif what == "tiny":
        data["shape"], data["chunks"] = [1, 1, 3 * 10**7], [1, 1, 1]
    elif what == "pickle":
        data["compressor"] = {"id": "pickle"}
        chunk.write_bytes(pickle.dumps(np.zeros(12)))
    elif what == "filter":
        data["filters"] = [{"id": "json2"}]
    elif what == "object":
        data["dtype"] = "|O"
    elif what == "bomb":
        data["compressor"] = {"id": "zstd", "level": 1}
        chunk.write_bytes(numcodecs.Zstd(1).encode(bytes(2**28)))
    elif what == "unknown size":  # without a size zstd unpacks as much as there is
        data["compressor"] = {"id": "zstd", "level": 1}
        chunk.write_bytes(bytes.fromhex("28b52ffd0058") + b"\x00" * 40)
    elif what == "linked":
        folder.rename(tmp_path / "omega")
        folder.symlink_to(tmp_path / "omega")
    else:
        chunk.unlink()
        if what == "pipe":
            os.mkfifo(chunk)
        elif what == "link":
            chunk.symlink_to("/dev/zero")
    if what != "linked":
        file.write_text(json.dumps(data) if what != "text" else "[" * 10**6)
    with bounded(), pytest.raises(FileError, match=words):
        rm.open(store)


def test_copies_of_a_store_with_other_packers_are_looked_at(tmp_path):
    """Sizes that chunks announce, for each packer that is known."""
    for name, made in (
        ("blosc", numcodecs.Blosc()), ("zstd", numcodecs.Zstd()), ("lz4", numcodecs.LZ4()),
        ("zlib", numcodecs.Zlib()), ("gzip", numcodecs.GZip()), ("none", None),
    ):  # fmt: skip
        for count in (10, 300, 70_000, 10**6):
            path = str(tmp_path / f"{name}-{count}.zarr")
            array = zarr.create_array(
                path, shape=(count,), chunks=(count,), dtype="f8", zarr_format=2, compressors=made
            )
            array[:] = np.arange(count)
            refuse_hostile(path)
    for data in ({"zarr_format": 3}, {"zarr_format": 2, "shape": [-1]}, {"a": 1}, [], 7, None):
        (tmp_path / "zlib-10.zarr" / ".zarray").write_text(json.dumps(data))
        with pytest.raises(FileError, match="not the zarr metadata"):
            refuse_hostile(str(tmp_path / "zlib-10.zarr"))


@pytest.mark.parametrize("text", [
    "ply\nformat binary_little_endian 1.0\nelement vertex 2000000000\nproperty double x\n"
    "property double y\nproperty double z\nelement face 900000000\n"
    "property list uchar int vertex_indices\nend_header\n",
    "OFF\n2000000000 2000000000 0\n",
    "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 9\n",
    "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
    "property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
    "0 0 0\n1 0 0\n0 1 nan\n3 0 1 -9\n",
    "v 0 0 0\nv 1 0 0\nv 0 1\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n",
    "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 999999999\nmtllib pipe.mtl\n" * 1000,
])  # fmt: skip
@pytest.mark.parametrize("ending", [".ply", ".off", ".obj", ".stl"])
def test_a_mesh_is_one_message(text, ending, tmp_path):
    pytest.importorskip("trimesh")
    os.mkfifo(tmp_path / "pipe.mtl")
    path = tmp_path / f"part{ending}"
    path.write_text(text)
    with bounded(), pytest.raises(SceneError) as told:
        mesh.load(path)
    if "pipe.mtl" in text and ending == ".obj":  # the pipe was not opened
        assert "index 999999998" in str(told.value)
    path.write_bytes(bytes(80) + (2**31).to_bytes(4, "little"))  # an STL file's number of triangles
    with bounded(), pytest.raises(SceneError):
        mesh.load(path)


@pytest.mark.parametrize(("count", "words"), [(4 * 10**6, "is sparse"), (10**7, "than 256 MB")])
def test_a_mesh_of_holes_is_refused(count, words, tmp_path):
    """It occupies 4 kB, and took 3.9 GB and a minute."""
    pytest.importorskip("trimesh")
    with open(tmp_path / "part.stl", "wb") as file:
        file.write(bytes(80) + count.to_bytes(4, "little"))
        file.truncate(84 + 50 * count)
    with bounded(), pytest.raises(SceneError, match=words):
        mesh.load(tmp_path / "part.stl")
    with pytest.raises(FileError, match=words):
        reading.sha256_of(tmp_path / "part.stl")


@pytest.mark.parametrize("key", ["run.t_end", "run.every", "body.mass", "effects.gravity.g"])
@pytest.mark.parametrize("text", ["9" * 10**6, "\t " * 10**6 + "x", "1 /" + " " * 10**6 + "/"])
def test_a_long_value_is_refused_at_once(key, text):
    """A time of 100,000 nines took minutes: the search for its unit took the square of its length.
    Measured 0.2 s at most."""
    with bounded(), pytest.raises(RigidmcError) as told:
        rm.Scene.load("heavy_top", {key: text})
    assert len(str(told.value)) < 2000
