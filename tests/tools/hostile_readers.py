"""Hostile zarr stores, meshes, maps, tables of bounds, parquet files, options and expressions; the
other readers are in `tests.tools.hostile`."""

import json
import os
import re
import shutil

import numcodecs
import numpy as np
import typer

import rigidmc as rm
from rigidmc.cli import app
from tests.tools.hostile import (
    BOUNDS,
    CUBE,
    NUMBERS,
    bytes_of,
    hostile_json,
    hostile_kind,
    hostile_netcdf,
    hostile_toml,
    odd,
    text_of,
    word_of,
)

FACES = ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3))
CORNERS = ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1))
MESHES = {
    ".stl": CUBE,
    ".obj": "mtllib a.mtl\n" + "".join(f"v {x} {y} {z}\n" for x, y, z in CORNERS)
    + "".join(f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in FACES),
    ".off": "OFF\n4 4 6\n" + "".join(f"{x} {y} {z}\n" for x, y, z in CORNERS)
    + "".join(f"3 {a} {b} {c}\n" for a, b, c in FACES),
    ".ply": "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n"
    "property float z\nelement face 4\nproperty list uchar int vertex_indices\nend_header\n"
    + "".join(f"{x} {y} {z}\n" for x, y, z in CORNERS)
    + "".join(f"3 {a} {b} {c}\n" for a, b, c in FACES),
}  # fmt: skip
EXPRESSIONS = (
    "p(flips >= 1)", "mean(flip_wait | flips >= 3)", "quantile(energy_drift_max, 0.9)",
    "correlation(start_omega[1], flips)", "median(l2_drift_max)", "omega[1] = 0", "every 0.5",
    "every orbit", "mean(flips) +- 0.1", "p(flips >= 1) +- 5%", "omega_last[2]", "0:4", "3h",
    "body.moments.1=0.5:2", "start.omega.2", "local:2", "run.dt=0.1", "start.omega.9=1",
)  # fmt: skip
PIECES = (
    "(", ")", "[", "]", "1e999", "-1e308", "5e-324", "|", ">=", "=", "\x00", "\x1b[2J", "9" * 400,
    "a" * 5000, "((" * 500, "nan", "+-", "%", " ", ":", ".", "é\u202e", "every", "p(", "[0]",
    "[999]",
)  # fmt: skip
NUMBERS_OF_OTHERS = [f"{x!r}" for x in NUMBERS] + ["1e999", "-1", "1e400", "0x10", "1_0", ""]
LONG = {"stress", "warm", "doctor", "view", "new", "animate"}  # commands that take long, or write
OUTPUTS = {"--output", "--plot", "--cluster", "--device", "--threads", "--write-bounds"}
ASKED = ("section", "rare", "sensitivity", "basins", "frequencies", "map")


def written(path, data):
    with open(path, "wb") as file:
        file.write(data)
    return path


def hostile_zarr(some, good, folder):
    """A hostile zarr store; its path."""
    path = os.path.join(folder, "hostile.zarr")
    shutil.copytree(good.at("scene.zarr"), path)
    arrays = [name for name in sorted(os.listdir(path)) if not name.startswith(".")]
    array = os.path.join(path, some.choice(arrays))
    files = sorted(os.listdir(array))
    what = word_of(some, "metadata metadata metadata scene chunk chunk kind name")
    if what == "metadata":
        name = word_of(some, ".zarray .zarray .zarray .zattrs")
        file = os.path.join(array, name)
        with open(file, encoding="utf-8") as text:
            told = text.read()
        data = json.loads(told)
        if name == ".zarray" and some.random() < 0.7:
            key = some.choice(sorted(data))
            data[key] = some.choice((
                odd(some), [some.choice((0, 1, 2**40, 10**9, -1)) for _ in data["shape"]],
                {"id": some.choice(("pickle", "json2", "zstd", "vlen-utf8", "lzma", 7))},
                "|O", "<U9999999", "<M8[ns]", "<f4",
            ))  # fmt: skip
            told = json.dumps(data, default=str)
            written(file, told.encode("utf-8", "surrogatepass"))
        else:
            written(file, hostile_json(some, told))
    elif what == "scene":
        file = os.path.join(path, ".zattrs")
        with open(file, encoding="utf-8") as text:
            data = json.load(text)
        data["scene"] = hostile_toml(some, data["scene"]).decode("utf-8", "replace")
        written(file, json.dumps(data).encode())
    elif what == "chunk":
        file = os.path.join(array, some.choice([x for x in files if x[0] != "."] or ["0"]))
        data = b""
        if os.path.exists(file):
            with open(file, "rb") as chunk:
                data = chunk.read()
        bomb = numcodecs.Blosc().encode(np.zeros(2**22))
        written(file, some.choice((bytes_of(some, data), bomb, b"", some.randbytes(50))))
    elif what == "kind":
        where = some.choice(
            (array, os.path.join(array, some.choice(files)), os.path.join(path, ".zgroup"))
        )
        hostile_kind(some, where)
    else:
        os.rename(array, os.path.join(path, some.choice(("x", "time_", "member2", "x" * 200))))
    return path


def hostile_mesh(some, good, folder):
    """A hostile mesh; its path."""
    ending = some.choice(sorted(MESHES))
    path = os.path.join(folder, f"hostile{ending}")
    text = MESHES[ending]
    what = word_of(some, "bytes text number number binary kind other")
    if what == "number":
        words = re.split(r"([ \n])", text)
        for _ in range(some.choice((1, 2))):
            words[2 * some.randrange(len(words) // 2)] = str(some.choice((*NUMBERS, 10**30, -1)))
        data = "".join(words).encode()
    elif what == "binary":
        data = bytes(80) + some.choice((0, 1, 2**31, 2**32 - 1)).to_bytes(4, "little")
        data += some.randbytes(some.choice((0, 50, 5000)))
    elif what == "other":
        data = MESHES[some.choice(sorted(MESHES))].encode()
    elif what == "text":
        data = text_of(some, text).encode("utf-8", "surrogatepass")
    else:
        data = bytes_of(some, text.encode())
    written(path, data)
    os.mkfifo(os.path.join(folder, "a.mtl"))
    if what == "kind":
        hostile_kind(some, path)
    return path


def hostile_map(some, good, folder):
    """A hostile map in a file; its path."""
    path = os.path.join(folder, "hostile.nc")
    if some.random() < 0.7:
        hostile_netcdf(some, good.stored["map.nc"], path)
    else:
        with open(good.at("map.nc"), "rb") as file:
            written(path, bytes_of(some, file.read()))
    return path


def hostile_table(some, good, folder):
    """A hostile list of bounds, or a table that nothing reads; its path."""
    if some.random() < 0.6:
        path = os.path.join(folder, "hostile.csv")
        change = some.choice((text_of, text_of, lambda some, text: bytes_of(some, text.encode())))
        data = change(some, BOUNDS)
        data = data.encode("utf-8", "surrogatepass") if isinstance(data, str) else data
    else:
        path = os.path.join(folder, "hostile.parquet")
        data = b"PAR1" + some.randbytes(100) + b"PAR1"
    written(path, data)
    if some.random() < 0.1:
        hostile_kind(some, path)
    return path


def expression(some):
    """An expression that is asked for, with some of its pieces replaced."""
    text = some.choice(EXPRESSIONS)
    for _ in range(some.choice((0, 1, 1, 2, 4))):
        at = some.randrange(len(text) + 1)
        text = text[:at] + some.choice(PIECES) + text[at + some.choice((0, 0, 1, 3)) :]
    return text


def hostile_words(some, good):
    """The words of a command on good files, with odd values of its options."""
    commands = typer.main.get_command(app).commands
    name = some.choice(sorted(set(commands) - LONG))
    options = [
        one for one in commands[name].params
        if one.param_type_name == "option" and not one.is_flag and not one.is_eager
        and not OUTPUTS & {*one.opts}
    ]  # fmt: skip
    files = [good.at(file) for file in ("scene.toml", "scene.nc", "scene-run")]
    given = [some.choice((*files, "dzhanibekov"))]
    for option in some.sample(options, min(len(options), some.choice((1, 1, 2, 3)))):
        number = some.choice(NUMBERS_OF_OTHERS)
        word = some.choice((expression(some), number, number))
        given += [max(option.opts, key=len), word.replace("\x00", "")]
    if name in ASKED and some.random() < 0.8:
        given += ["--at" if name == "section" else "--of", expression(some).replace("\x00", "")]
    return name, given


def add_to(good, stored):
    """The further good files: a zarr store and a map.  stored : the class `hostile.Stored`"""
    with rm.open(good.at("scene.nc")) as ds:
        ds.load().rigid.export(good.at("scene.zarr"))
    sides = ("start.omega.1", 0.5, 1.5), ("start.omega.3", 1.0, 5.0)
    scene = rm.Scene.load(good.at("scene.toml"))
    rm.stability_map(scene, *sides, "mean(l2_drift_max)", (3, 2), members=1).to_netcdf(
        good.at("map.nc")
    )
    good.stored["map.nc"] = stored(good.at("map.nc"))
