"""A run as a directory: run.json and scene.toml say what it is, the shards that are there what of it is done.

    run.json       what never changes: scene's hash, seed, members of a shard and of a block, versions, type of processor; and how many members
    scene.toml     the scene, resolved; columns.nc what it has of one row per member
    shards/        one netCDF4 file for each range of members; its bytes depend on scene and seed alone, and its name tells how many members are
                   flagged and the file's hash
    journal.jsonl  what came to pass: when, where, how fast; nothing depends on it
    lock           held by the process that writes

A shard appears by a temporary file, close, fsync and rename: what has its name is whole. So the list of shards is the state of the run.
"""

import contextlib
import fcntl
import hashlib
import json
import os
import platform
import re
import time
from importlib.metadata import version
from typing import Any

from rigidmc.engine.machine import vector_bits
from rigidmc.errors import OutputExists, SceneError
from rigidmc.storage.netcdf import part_of, put_in_place

FORMAT = 1
_SHARD = re.compile(r"(\d{8})-(\d{1,12})-([0-9a-f]{16})\.nc")
_FACTS = {
    "format": int,
    "scene": str,
    "columns": str,
    "seed": int,
    "first": int,
    "members": int,
    "shard": int,
    "block": int,
    "versions": dict,
    "machine": str,
}


def this_machine():
    """What the last bits of results may depend on: versions of what computes and writes, and the type of processor."""
    import llvmlite.binding

    versions = {name: version(name) for name in ("rigidmc", "numpy", "numba", "llvmlite", "netCDF4")}
    return versions, f"{platform.machine()} {llvmlite.binding.get_host_cpu_name()}, {vector_bits()} bit"


def hash_of(scene):
    """The hash of what decides a member's numbers: the scene, less how many members there are."""
    return hashlib.sha256(scene.with_run(members=1, first=0).dumps().encode()).hexdigest()


class RunDirectory:
    """A run directory that exists. path : of it;  facts : of its run.json"""

    def __init__(self, path):
        self.path = os.fspath(path)
        self.facts = self._read_facts()

    def _read_facts(self):
        name = os.path.join(self.path, "run.json")
        if not os.path.isfile(name):
            raise SceneError("", "run", self.path, "is no run directory: it has no run.json")
        try:
            with open(name, encoding="utf-8") as file:
                text = file.read()
            facts = json.loads(text)
        except (ValueError, RecursionError) as error:
            raise SceneError("", "run.json", None, f"is damaged: {error}", file=name) from None
        for key, kind in _FACTS.items():
            if not isinstance(facts, dict) or type(facts.get(key)) is not kind:
                raise SceneError("", key, None, f"is damaged: expected {kind.__name__}", file=name)
        facts.pop("check", None)
        if rendered(facts) != text:
            raise SceneError("", "run.json", None, "is damaged, or was changed by hand: its sum is another", file=name)
        if facts["format"] != FORMAT:
            raise SceneError("", "format", facts["format"], f"this version reads format {FORMAT}", file=name)
        if min(facts["members"], facts["shard"], facts["block"]) < 1 or facts["first"] < 0 or facts["shard"] % facts["block"]:
            raise SceneError("", "members", None, "is damaged: counts have to be positive, and a shard whole blocks", file=name)
        return facts

    @property
    def count(self):
        """How many shards the whole run has."""
        return -(-self.facts["members"] // self.facts["shard"])

    def members(self, i):
        """The range of members of shard i."""
        first, end = self.facts["first"], self.facts["first"] + self.facts["members"]
        low = first + i * self.facts["shard"]
        return range(low, min(low + self.facts["shard"], end))

    def shards(self):
        """{i: path} of the shards that are there."""
        folder = os.path.join(self.path, "shards")
        names = sorted(os.listdir(folder)) if os.path.isdir(folder) else []
        found = {int(m[1]): os.path.join(folder, name) for name in names if (m := _SHARD.fullmatch(name))}
        return {i: path for i, path in found.items() if i < self.count}

    def temporary(self, i):
        """Where shard i is before it is whole."""
        return os.path.join(self.path, "shards", f"{i:08d}")

    def named(self, i, flagged, file):
        """The path that a finished file has to have as shard i, so many of whose members are flagged."""
        return os.path.join(self.path, "shards", f"{i:08d}-{flagged}-{hash_of_file(file)[:16]}.nc")

    def flagged(self):
        """{i: how many members of shard i are flagged} of the shards that are there."""
        return {i: int(os.path.basename(path).split("-")[1]) for i, path in self.shards().items()}

    def done(self):
        """Which shards are there."""
        return sorted(self.shards())

    def missing(self):
        """The shards that are not."""
        return sorted(set(range(self.count)) - set(self.done()))

    def note(self, **facts):
        """Add a line to the journal, if that can be: nothing depends on it."""
        line = json.dumps({"time": round(time.time(), 3), "host": platform.node(), "pid": os.getpid(), **facts})
        with contextlib.suppress(OSError), open(os.path.join(self.path, "journal.jsonl"), "a", encoding="utf-8") as file:
            file.write(line + "\n")

    def journal(self):
        """The lines of the journal; one that is torn is left out."""
        found: list[dict[str, Any]] = []
        with (
            contextlib.suppress(FileNotFoundError),
            open(os.path.join(self.path, "journal.jsonl"), encoding="utf-8", errors="replace") as file,
        ):
            for line in file:
                with contextlib.suppress(ValueError):
                    made = json.loads(line)
                    found += [made] if isinstance(made, dict) else []
        return found

    @contextlib.contextmanager
    def locked(self):
        """Hold the lock of the one that writes; OutputExists where another process does. It goes with the process, whatever ends that."""
        with open(os.path.join(self.path, "lock"), "a+", encoding="utf-8") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                file.seek(0)
                raise OutputExists(f"{self.path}: is being written by {file.read().strip() or 'another process'}") from None
            file.truncate(0)
            file.write(f"process {os.getpid()} of {platform.node()}\n")
            file.flush()
            self.clear()
            yield

    def clear(self):
        """Take away what writers left that were killed: temporary files, which no shard is."""
        for folder in (self.path, os.path.join(self.path, "shards")):
            for name in os.listdir(folder):
                if ".part-" in name:
                    os.unlink(os.path.join(folder, name))

    def differs(self):
        """In words, what of this machine is not that of the run; bits may differ then."""
        versions, machine = this_machine()
        found = [
            f"{name} {self.facts['versions'].get(name)} there, {here} here"
            for name, here in versions.items()
            if self.facts["versions"].get(name) != here
        ]
        return [*found, *([f"processor {self.facts['machine']} there, {machine} here"] if machine != self.facts["machine"] else [])]


def rendered(facts):
    """The text of run.json, with its sum."""
    check = hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()
    return json.dumps({**facts, "check": check}, indent=1) + "\n"


def hash_of_file(path):
    """The sha256 of a file."""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def damaged(path):
    """Whether a shard is not what its name tells."""
    found = _SHARD.fullmatch(os.path.basename(path))
    return not found or hash_of_file(path)[:16] != found[3]


def write_text(path, text, force=False):
    """Write a small file whole or not at all."""
    temporary = part_of(path)
    with open(temporary, "w", encoding="utf-8") as file:
        file.write(text)
    put_in_place(temporary, path, force)
