"""Good files, and hostile files made from them: bytes, text, structure, netCDF metadata."""

import copy
import datetime
import hashlib
import json
import math
import os
import random
import shutil
import socket
import tomllib

import netCDF4
import numpy as np
import tomli_w

import rigidmc as rm
from rigidmc.runs.directory import resume
from rigidmc.runs.directory.create import create
from rigidmc.runs.directory.facts import facts_text
from rigidmc.runs.directory.folder import _SHARD, RunDirectory, hash_of_file
from rigidmc.runs.directory.load import scene_in

SCENE = """
title = "good"
[body]
moments = [1.0, { uniform = [1.9, 2.1] }, 2.5]
mass = 0.5
centre = [0.0, 0.0, 0.1]
[effects.gravity]
g = 9.81
[effects.viscous_damping]
rate = { uniform = [0.01, 0.02] }
[observables.histogram]
of = "energy"
low = -10.0
high = 10.0
bins = 8
[start]
omega = [0.1, { normal = [1.0, 0.1] }, 0.0]
attitude = [1.0, 0.0, 0.0, 0.0]
[run]
integrator = "rk4"
dt = 0.05
t_end = 0.5
every = 0.1
members = 40
save = ["omega", "attitude", "work", "flips", "histogram"]
keep = { attitude = "thinned", work = "final" }
thin = 2
"""
TABLE = """
[body]
moments = [1.0, 2.0, { table = "rows.csv", column = "third" }]
[start]
omega = [{ table = "rows.nc", column = "spin" }, 1.0, 0.0]
[run]
integrator = "rk4"
dt = 0.05
t_end = 0.5
members = 40
save = ["omega"]
"""
CUBE = """solid cube
""" + "".join(
    "facet normal 0 0 0\nouter loop\n" + "".join(f"vertex {x} {y} {z}\n" for x, y,
    z in triangle) + "endloop\nendfacet\n"
    for triangle in (((0, 0, 0), (0, 1, 0), (1, 0, 0)), ((0, 0, 0), (1, 0, 0), (0, 0, 1)),
    ((0, 0, 0), (0, 0, 1), (0, 1, 0)), ((1, 0, 0), (0, 1, 0), (0, 0, 1)))
) + "endsolid cube\n"  # fmt: skip
BOUNDS = "group,case,integrator,bound,measured\nH1,axis spin,rk4,1e-3,1e-4\n"
WORDS = (
    "days since 2000-01-01", "seconds", "klingon", "", "\x00", "$\\frac{", "x" * 100_000, "[[[[",
    "1e400", "nan", "K", "ü\u202e",
)  # fmt: skip
NUMBERS = (
    0, -1, 1, 99, 2**31, 2**53, 2**62, -(2**63), 1e-320, 1e308, -1e308, math.nan, math.inf, 0.5,
    1e-9,
)  # fmt: skip
ATTRIBUTES = (
    "units", "_FillValue", "missing_value", "scale_factor", "add_offset", "calendar", "_Encoding",
    "coordinates", "_Unsigned", "dtype", "significant_digits", "conserved", "flag_values", "bounds",
    "grid_mapping", "long_name", "valid_range",
)  # fmt: skip


def word_of(some, text):
    """A random word of a text."""
    return some.choice(text.split())


def odd(some):
    """A value that is expected nowhere."""
    return some.choice((
        *NUMBERS, 10**400, True, *WORDS, [], {}, [[[]]], [1.0] * 5, list(range(300)),
        {"normal": [0.0, 1.0]}, {"uniform": [2, 1]}, {"stored": "omega", "axis": 99},
        {"stored": "x"}, {"stored": ["x"], "axis": {}}, {"grid": [0.0, 1.0, 2**53]},
        {"table": "rows.csv", "column": "third"}, {"table": "/dev/zero.nc", "column": "a"},
        {"gamma": {"a": 1e308}}, {"cone": [1, 2]}, datetime.date(2000, 1, 1),
        datetime.datetime(2000, 1, 1), datetime.time(1), ["omega"] * 50, {"a": {"b": {"c": [{}]}}},
    ))  # fmt: skip


def places(data, path=()):
    """The paths of all keys and list entries."""
    for key, value in data.items() if isinstance(data, dict) else enumerate(data):
        yield (*path, key)
        if isinstance(value, (dict, list)) and len(path) < 6:
            yield from places(value, (*path, key))


def restructured(some, data):
    """A copy with one to three values replaced, deleted, renamed, duplicated or nested."""
    data = copy.deepcopy(data)
    for _ in range(some.choice((1, 1, 1, 2, 3))):
        found = list(places(data))
        if not found:
            break
        *path, key = some.choice(found)
        table = data
        for word in path:
            table = table[word]
        what = word_of(some, "value value value number gone renamed nested many added")
        old = table.pop(key) if what in ("gone", "renamed") else table[key]
        if what == "value":
            table[key] = odd(some)
        elif what == "number" and isinstance(old, (int, float)):
            is_like = some.random() < 0.7
            table[key] = (
                type(old)(old * some.choice((-1, 0, 2, 3))) if is_like else some.choice(NUMBERS)
            )
        elif what == "renamed" and isinstance(table, dict):
            table[f"{key}_"] = old
        elif what == "nested":
            for _ in range(some.choice((1, 3, 90, 200))):
                old = [old] if some.random() < 0.5 else {"a": old}
            table[key] = old
        elif what == "many" and isinstance(old, dict):
            table[key] = [old] * some.choice((2, 500))
        elif what == "added" and isinstance(table, dict):
            known = "extra members first points strata digits keep seed tolerance turn module"
            table[some.choice((*known.split(), "x" * 500))] = odd(some)
    return data


def bytes_of(some, data):
    """A copy with bits flipped, bytes replaced or inserted, or truncated."""
    data = bytearray(data)
    for _ in range(some.choice((1, 1, 2, 5, 30))):
        at = some.randrange(len(data) + 1)
        what = word_of(some, "flip flip byte cut insert twice")
        if what == "flip" and data:
            data[at % len(data)] ^= 1 << some.randrange(8)
        elif what == "byte" and data:
            data[at % len(data)] = some.randrange(256)
        elif what == "insert":
            data[at:at] = some.randbytes(some.choice((1, 3, 64)))
        elif what == "twice":
            data[at:at] = data[: some.randrange(1, 300)]
        elif what == "cut" and some.random() < 0.3:
            del data[at:]
    return bytes(data)


def text_of(some, text):
    """A copy with some tokens replaced."""
    words = ("[" * 50_000, "{a=" * 20_000, "a" + ".a" * 50_000 + " = 1", "9" * 5000, "1979-05-27",
        "1e999", "-1e-999", "inf", "nan", '"""', "'", "=", "\n[body]\n", "\n[run]\n",
             "0x" + "f" * 40, '"\\u0000"', '"\\ud800"', "\x00", "true", "[]", "2" * 25,
             "members = 9007199254740992\n")  # fmt: skip
    for _ in range(some.choice((1, 1, 2, 4))):
        at = some.randrange(len(text) + 1)
        end = at + some.choice((0, 0, 1, 5, 40))
        text = text[:at] + some.choice(words) + text[end:]
    return text


def hostile_text(some, text, load, dump):
    """The bytes of a hostile copy of a structured text."""
    what = word_of(some, "bytes text structure structure")
    if what == "bytes":
        return bytes_of(some, text.encode())
    if what == "text":
        return text_of(some, text).encode("utf-8", "surrogatepass")
    try:
        return dump(restructured(some, load(text))).encode("utf-8", "surrogatepass")
    except (TypeError, ValueError, RecursionError):  # that cannot be written
        return text_of(some, text).encode("utf-8", "surrogatepass")


def hostile_toml(some, text):
    return hostile_text(some, text, tomllib.loads, tomli_w.dumps)


def hostile_json(some, text):
    return hostile_text(some, text, json.loads, lambda data: json.dumps(data, default=str))


class Stored:
    """The contents of a netCDF file, to be changed and written again."""

    def __init__(self, path):
        with netCDF4.Dataset(path) as file:
            file.set_auto_maskandscale(False)
            file.set_auto_chartostring(False)
            self.attrs = {k: file.getncattr(k) for k in file.ncattrs()}
            self.dims = {k: None if d.isunlimited() else len(d) for k, d in file.dimensions.items()}
            self.variables = {
                k: [v.dimensions, v.dtype, {a: v.getncattr(a) for a in v.ncattrs()}, np.array(v[:])]
                for k, v in file.variables.items()
            }

    def write(self, path):
        """Write it in a separate process, because some contents crash the C library."""
        child = os.fork()
        if child == 0:
            done = 1
            try:
                self._write(path)
                done = 0
            finally:
                os._exit(done)
        if os.waitpid(child, 0)[1]:
            raise OSError(f"{path}: the netCDF library does not write it")

    def _write(self, path):
        with (
            np.errstate(all="ignore"),
            netCDF4.Dataset(path, "w") as file,
        ):  # fill values that the type does not have
            file.set_fill_off()
            for name, size in self.dims.items():
                file.createDimension(name, size)
            for name, (dims, dtype, attrs, values) in self.variables.items():
                sizes = [self.dims[d] for d in dims]
                big = math.prod(s or 1 for s in sizes) > 10**6
                chunks = [min(s or 8, 64) for s in sizes] if big else None
                fill = attrs.get("_FillValue")
                made = file.createVariable(name, dtype, dims, chunksizes=chunks, fill_value=fill)
                made.set_auto_maskandscale(False)
                made.set_auto_chartostring(False)
                for word, value in attrs.items():
                    if word != "_FillValue":
                        made.setncattr(word, value)
                if not big and values.size:
                    least = values.ndim - 1
                    of = values.shape
                    shape = [of[min(i, least)] if s is None else s for i, s in enumerate(sizes)]
                    whole = np.resize(values, shape)
                    with np.errstate(all="ignore"):
                        made[:] = whole if dtype is str else whole.astype(dtype)
            for name, value in self.attrs.items():
                file.setncattr(name, value)


UNWRITABLE = KeyError, AttributeError, IndexError, OverflowError


def hostile_netcdf(some, stored, path):
    """Write a hostile copy of a netCDF file."""
    for _ in range(20):
        made = copy.deepcopy(stored)
        try:
            for _ in range(some.choice((1, 1, 1, 2, 4))):
                _change(some, made)
            made.write(path)
            return
        except (*UNWRITABLE, OSError, RuntimeError, TypeError, ValueError):
            if os.path.exists(path):
                os.unlink(path)
    made = copy.deepcopy(stored)
    made.variables.pop(some.choice(sorted(made.variables)))
    made.write(path)


def _attribute(some):
    return some.choice(
        (*WORDS, 1.5, np.int8(3), 2**40, np.arange(9.0), np.float32("nan"), -1, "f" * 10)
    )


def _change(some, made):
    name = some.choice(sorted(made.variables))
    variable = made.variables[name]
    rare = "global gone rename long dims type extra huge member"
    what = word_of(some, f"scene scene attribute attribute values values {rare}")
    if what == "scene" and "scene" in made.attrs:
        made.attrs["scene"] = hostile_toml(some, made.attrs["scene"]).decode("utf-8", "replace")
    elif what == "global":
        made.attrs[some.choice((*made.attrs, "scene", "steps", "dt"))] = _attribute(some)
    elif what == "attribute":
        variable[2][some.choice(ATTRIBUTES)] = _attribute(some)
    elif what == "gone":
        del made.variables[name]
    elif what == "rename":
        old = some.choice(sorted(made.dims))
        made.dims = {f"{k}_" if k == old else k: v for k, v in made.dims.items()}
        for one in made.variables.values():
            one[0] = tuple(f"{d}_" if d == old else d for d in one[0])
    elif what == "long":
        made.dims[some.choice(sorted(made.dims))] = some.choice(
            (0, 1, 99, 2**40, 2**53, 1000, None)
        )
    elif what == "dims":
        dims = variable[0]
        others = ("axis",), ("time", "member"), ("member",)
        variable[0] = tuple(some.choice((dims[::-1], dims[1:], (*dims, dims[-1]), *others)))
    elif what == "type":
        variable[1] = some.choice((str, "S1", "i1", "i8", "u2", "f4", "f8"))
    elif what == "values":
        number = some.choice((np.nan, np.inf, -1, 0, 1e308, 77, 2**53, 1e-320, -1e308))
        variable[3] = np.asarray(number + np.zeros(variable[3].shape))
        if some.random() < 0.5:
            variable[3] = variable[3] + np.arange(variable[3].size).reshape(variable[3].shape)
    elif what == "extra":
        name, values = some.choice(("extra", "omega_mean", "mass2", "x" * 200)), variable[3]
        zeros = np.zeros(values.shape)
        made.variables[name] = [variable[0], some.choice((str, "f8", "S1")), {}, zeros]
    elif what == "huge":
        made.dims["huge"] = some.choice((2**40, 2**31, 10**7))
        whole = [("huge", *variable[0]), "f8", {}, np.zeros(1)]
        made.variables[some.choice(("huge", name))] = whole
    elif what == "member" and "member" in made.variables:
        first = np.array([some.choice((0, -5, 2**53 - 1, 10**9, 39))] * 40)
        made.variables["member"][3] = first + np.arange(40) * some.choice((0, 1, 1))


def hostile_kind(some, path):
    """Something other than a regular file in its place."""
    if os.path.isdir(path) and not os.path.islink(path):
        shutil.rmtree(path)
    elif os.path.lexists(path):
        os.unlink(path)
    what = word_of(some, "pipe folder zero loop nothing empty socket tty")
    if what == "pipe":
        os.mkfifo(path)
    elif what == "folder":
        os.mkdir(path)
    elif what in ("zero", "loop", "tty"):
        ends = {"zero": "/dev/zero", "loop": os.path.basename(path), "tty": "/dev/full"}
        os.symlink(ends[what], path)
    elif what == "empty":
        open(path, "wb").close()
    elif what == "socket" and len(path) < 100:
        with socket.socket(socket.AF_UNIX) as made:
            made.bind(path)


class Good:
    """Good files in a folder.

    scene.toml, table.toml, result.nc, rows.nc of a table, a complete run, an incomplete run with
    journal.
    """

    def __init__(self, folder):
        self.folder = os.fspath(folder)
        some = random.Random(3)
        files = {"scene.toml": SCENE, "table.toml": TABLE, "tetra.stl": CUBE, "bounds.csv": BOUNDS}
        for name, text in files.items():
            self.at(name, text)
        self.at(
            "rows.csv",
            "third,spin\n"
            + "".join(f"{some.uniform(2.2, 2.8)},{some.gauss(1.0, 0.2)}\n" for _ in range(40)),
        )
        with netCDF4.Dataset(self.at("rows.nc"), "w") as file:
            file.createDimension("row", 40)
            file.createVariable("spin", "f8", ("row",))[:] = np.linspace(0.1, 0.2, 40)
        for name in ("scene", "table"):
            rm.simulate(
                rm.Scene.load(self.at(f"{name}.toml")), output=self.at(f"{name}.nc")
            ).close()
            self.run(f"{name}-run", rm.Scene.load(self.at(f"{name}.toml")))
        self.run(
            "part-run", rm.Scene.load(self.at("scene.toml")).with_run(members=100), range(1, 3)
        )
        self.stored = {name: Stored(self.at(name)) for name in ("scene.nc", "table.nc", "rows.nc")}
        shard = next(iter(RunDirectory(self.at("scene-run")).shards().values()))
        self.stored["shard"] = Stored(shard)

    def run(self, name, scene, only=None):
        """A run in shards of 32 members."""
        create(scene, self.at(name), 1.0)
        with open(self.at(f"{name}/run.json")) as file:
            facts = json.load(file)
        del facts["check"]
        self.at(f"{name}/run.json", facts_text({**facts, "block": 32, "shard": 32}))
        resume.resume(self.at(name), only=only)

    def at(self, name, text=None):
        path = os.path.join(self.folder, name)
        if text is not None:
            with open(path, "w", encoding="utf-8") as file:
                file.write(text)
        return path


def hostile_result(some, good, folder):
    """A hostile result in a folder; its path."""
    name, path = some.choice(("scene.nc", "table.nc")), os.path.join(folder, "hostile.nc")
    what = some.choice(("structure",) * 6 + ("bytes", "bytes", "kind"))
    if what == "structure":
        hostile_netcdf(some, good.stored[name], path)
    else:
        shutil.copy(good.at(name), path)
        if what == "kind":
            hostile_kind(some, path)
        else:
            with open(good.at(name), "rb") as file:
                data = bytes_of(some, file.read())
            with open(path, "wb") as file:
                file.write(data)
    return path


def hostile_scene(some, good, folder):
    """A hostile scene, or a table beside a good one; the path of the scene."""
    name = word_of(some, "scene.toml scene.toml table.toml")
    for other in ("rows.csv", "rows.nc"):
        shutil.copy(good.at(other), folder)
    path = os.path.join(folder, "hostile.toml")
    with open(good.at(name), encoding="utf-8") as file:
        text = file.read()
    others = (path, path, path, "rows.csv", "rows.nc")
    target = some.choice(others) if name == "table.toml" else path
    with open(path, "wb") as file:
        file.write(hostile_toml(some, text) if target == path else text.encode())
    if some.random() < 0.05:
        hostile_kind(some, os.path.join(folder, target))
    elif target == "rows.nc":
        hostile_netcdf(some, good.stored["rows.nc"], os.path.join(folder, target))
    elif target == "rows.csv":
        with open(good.at(target), "rb") as file:
            data = bytes_of(some, file.read())
        with open(os.path.join(folder, target), "wb") as file:
            file.write(data)
    return path


def hostile_run(some, good, folder):
    """A hostile run directory; its path."""
    path = os.path.join(folder, "hostile-run")
    shutil.copytree(good.at(word_of(some, "scene-run part-run table-run")), path)
    shards = sorted(os.listdir(os.path.join(path, "shards")))
    names = [*["run.json"] * 3, "scene.toml", *["journal.jsonl"] * 2, "columns.nc", "lock"]
    name = some.choice([*names, f"shards/{some.choice(shards)}", "shards", "left"])
    target = os.path.join(path, name)
    if name == "left":  # by writers that were killed, according to the names
        number = some.choice(("9" * 20, "0", "-1", "99999999999", str(os.getpid()), "1" * 200, "x"))
        host = some.choice((os.uname().nodename, "elsewhere", "", "a-b-c"))
        with open(
            os.path.join(
                path,
                some.choice(("", "shards")),
                f"{word_of(some, 'run.json 00000000 scene.toml')}.part-{host}-{number}",
            ),
            "w",
        ) as file:
            file.write("x")
    elif some.random() < 0.15:
        hostile_kind(some, target)
    elif name in ("run.json", "journal.jsonl", "scene.toml"):
        with open(target, encoding="utf-8") as file:
            text = file.read()
        change = {"journal.jsonl": _lines, "scene.toml": hostile_toml}.get(name, hostile_json)
        with open(target, "wb") as file:
            file.write(change(some, text))
        if some.random() < 0.8:
            summed(path, name == "scene.toml")
    elif name.startswith("shards/"):
        if some.random() < 0.6:
            hostile_netcdf(some, good.stored["shard"], target)
        else:
            with open(target, "rb") as file:
                data = bytes_of(some, file.read())
            with open(target, "wb") as file:
                file.write(data)
        if some.random() < 0.7:  # with the sum that its name states
            found = _SHARD.fullmatch(os.path.basename(target))
            right = f"{found[1]}-{found[2]}-{hash_of_file(target)[:16]}.nc"
            os.rename(target, os.path.join(path, "shards", right))
    elif os.path.isfile(target) or name == "columns.nc":
        with open(target, "wb") as file:
            file.write(some.randbytes(some.choice((0, 1, 5000))))
    return path


def _lines(some, text):
    lines = text.splitlines() or ["{}"]
    at = some.randrange(len(lines))
    lines[at] = hostile_json(some, lines[at]).decode("utf-8", "replace")
    more = ('{"time": 1e308, "event": "begun"}',
        '{"time": 1.0, "event": "ended", "members": ' + "9" * 400 + ', "seconds": 5e-324}',
        "[" * 100_000, '{"time": NaN}',
            '{"time": 1.5, "event": "ended", "members": 5, "seconds": 1e-300}', "9" * 5000,
            '{"a":' * 50_000, '{"time": 9e10, "event": "begun"}', "x" * 2_000_000)  # fmt: skip
    lines += some.choices(more, k=some.choice((0, 1, 3)))
    return "\n".join(lines).encode("utf-8", "surrogatepass")


def summed(path, scene):
    """Give run.json correct sums, so that the sums alone do not refuse it."""
    try:
        with open(os.path.join(path, "run.json"), encoding="utf-8") as file:
            facts = json.load(file)
        facts.pop("check", None)
        if scene:
            from rigidmc.runs.directory.facts import hash_of

            facts["scene"] = hash_of(scene_in(path, facts, False))
        text = facts_text(facts)
    except Exception:  # it cannot be read at all
        return
    with open(os.path.join(path, "run.json"), "w", encoding="utf-8") as file:
        file.write(text)


def sha(path):
    with open(path, "rb") as file:
        return hashlib.sha256(file.read()).hexdigest()
