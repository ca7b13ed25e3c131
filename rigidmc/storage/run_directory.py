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
import hashlib
import json
import math
import os
import platform
import re
import time
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from rigidmc.errors import OutputExists, SceneError
from rigidmc.files.outputs import clear, is_part, lock
from rigidmc.files.reading import bytes_of, json_of, text_of

FORMAT = 1
MOST = 10**7  # shards, each a file; their names have eight digits
_SHARD = re.compile(r"([0-9]{8})-([0-9]{1,12})-([0-9a-f]{16})\.nc")
_OLD = (
    3600.0  # seconds after which a file of another computer that is not whole is one that was left
)
_JOURNAL = 2**20  # bytes read from the end of a journal; each resume adds two lines of 300 bytes
_Count = Annotated[int, Field(ge=0, le=2**53)]
_Some = Annotated[int, Field(ge=1, le=2**53)]


class _Facts(BaseModel):
    """The keys of run.json, which may have no others, with their types and ranges."""

    model_config = ConfigDict(extra="forbid", strict=True)

    format: int
    scene: Annotated[str, Field(pattern="^[0-9a-f]{64}$")]
    columns: Annotated[str, Field(pattern="^([0-9a-f]{64})?$")]
    code: dict[str, str]
    attributes: dict[str, str | int | float]
    seed: Annotated[int, Field(ge=0, lt=2**63)]
    first: _Count
    members: _Some
    shard: _Some
    block: Annotated[int, Field(ge=1, le=2**20)]
    versions: dict[str, str]
    machine: str


class _Line(BaseModel):
    """The keys of a line of the journal that are used in computing; the others are for people."""

    model_config = ConfigDict(strict=True)

    time: Annotated[float, Field(ge=0.0, le=1e11)]
    event: str = ""
    members: _Count | None = None
    seconds: Annotated[float, Field(ge=0.0, le=1e11)] | None = None


def hash_of(scene):
    """The hash of what decides a member's numbers: the scene, less how many members there are."""
    return hashlib.sha256(scene.with_run(members=1, first=0).dumps().encode()).hexdigest()


class RunDirectory:
    """A run directory that exists. path : of it;  facts : of its run.json"""

    def __init__(self, path):
        self.path = os.fspath(path)
        self.facts = self._read_facts()
        if os.path.islink(self._folder):
            raise SceneError(
                "", "shards", None, "is a link, and a run keeps to its folder", file=self.path
            )

    @property
    def _folder(self):
        return os.path.join(self.path, "shards")

    def _read_facts(self):
        name = os.path.join(self.path, "run.json")
        if not os.path.isfile(name):
            raise SceneError("", "run", self.path, "is no run directory: it has no run.json")
        text = text_of(name)
        try:
            facts = json_of(text)
            if isinstance(facts, dict):
                facts.pop("check", None)
            _Facts.model_validate(facts)
        except ValidationError as error:
            first = error.errors()[0]
            key = str(first["loc"][0]) if first["loc"] else "run.json"
            raise SceneError(
                "", key, None, f"is damaged: {first['msg'][0].lower()}{first['msg'][1:]}", file=name
            ) from None
        except ValueError as error:
            raise SceneError("", "run.json", None, f"is damaged: {error}", file=name) from None
        if rendered(facts) != text:
            raise SceneError(
                "",
                "run.json",
                None,
                "is damaged, or was changed by hand: its checksum does not match",
                file=name,
            )
        if facts["format"] != FORMAT:
            raise SceneError(
                "", "format", facts["format"], f"this version reads format {FORMAT}", file=name
            )
        if facts["first"] + facts["members"] > 2**53 or facts["shard"] % facts["block"]:
            raise SceneError(
                "",
                "members",
                None,
                "is damaged: a shard must be whole blocks, and members below 2^53",
                file=name,
            )
        if facts["members"] > MOST * facts["shard"]:
            raise SceneError(
                "",
                "shard",
                facts["shard"],
                f"is damaged: a run has at most {MOST:,} shards",
                file=name,
            )
        return facts

    @property
    def mark(self):
        """What each shard carries, so that none of another run passes for one of this: the hash of its scene, rows and code."""
        facts = self.facts
        return hashlib.sha256(
            json.dumps([facts["scene"], facts["columns"], sorted(facts["code"].values())]).encode()
        ).hexdigest()

    @property
    def count(self):
        """How many shards the whole run has."""
        return -(-self.facts["members"] // self.facts["shard"])

    def members(self, i):
        """The range of members of shard i."""
        first, end = self.facts["first"], self.facts["first"] + self.facts["members"]
        low = first + i * self.facts["shard"]
        return range(low, min(low + self.facts["shard"], end))

    def members_of(self, shards):
        """How many members some shards have, given by their numbers."""
        short = self.count * self.facts["shard"] - self.facts["members"]  # what the last one lacks
        return len(shards) * self.facts["shard"] - short * bool(
            np.any(np.asarray(shards) == self.count - 1)
        )

    def listed(self):
        """({i: path} of the shards that are there, paths of files among them that none is: of other numbers, names, or a number that is there twice)."""
        shards: dict[int, str] = {}
        strays = list[str]()
        with contextlib.suppress(FileNotFoundError), os.scandir(self._folder) as entries:
            for entry in sorted(entries, key=lambda entry: entry.name):
                found = _SHARD.fullmatch(entry.name)
                if (
                    found
                    and int(found[1]) < self.count
                    and int(found[1]) not in shards
                    and entry.is_file(follow_symlinks=False)
                ):
                    shards[int(found[1])] = entry.path
                elif not is_part(entry.name):
                    strays.append(entry.path)
        return shards, strays

    def shards(self):
        """{i: path} of the shards that are there."""
        return self.listed()[0]

    def refuse_strays(self):
        """SceneError where there are files among the shards that none is."""
        if strays := self.listed()[1]:
            rule = f"{', '.join(strays)}: no shard of this run; take it away first, or see `rigidmc verify`"
            raise SceneError("", "run", self.path, rule)

    def temporary(self, i):
        """Where shard i is before it is whole."""
        return os.path.join(self._folder, f"{i:08d}")

    def named(self, i, flagged, file):
        """The path that a finished file has to have as shard i, so many of whose members are flagged."""
        return os.path.join(self._folder, f"{i:08d}-{flagged}-{hash_of_file(file)[:16]}.nc")

    def missing(self):
        """The numbers of the shards that are not there, as an array (80 MB if all of MOST shards are missing)."""
        gone = np.ones(self.count, bool)
        gone[list(self.shards())] = False
        return np.flatnonzero(gone)

    def note(self, **facts):
        """Add a line to the journal, if that can be: nothing depends on it."""
        line = json.dumps(
            {"time": round(time.time(), 3), "host": platform.node(), "pid": os.getpid(), **facts}
        )
        with (
            contextlib.suppress(OSError),
            open(
                os.path.join(self.path, "journal.jsonl"), "a", encoding="utf-8", opener=_opener
            ) as file,
        ):
            file.write(line + "\n")

    def journal(self):
        """The last lines of the journal, without torn lines and lines of impossible values."""
        found: list[dict[str, Any]] = []
        with contextlib.suppress(OSError, SceneError):
            for line in bytes_of(
                os.path.join(self.path, "journal.jsonl"), _JOURNAL, last=True
            ).splitlines():
                with contextlib.suppress(ValueError):  # also of pydantic
                    told = json_of(line.decode("utf-8"))
                    found.append({**told, **_Line.model_validate(told).model_dump()})
        return found

    @contextlib.contextmanager
    def locked(self):
        """Hold the lock of the one that writes; OutputExists where another process does, or did since this looked. It goes with the process,
        whatever ends that."""
        os.makedirs(self._folder, exist_ok=True)
        name = os.path.join(self.path, "lock")
        with open(name, "ab+", buffering=0, opener=_opener) as file:
            try:
                lock(file, name)
            except BlockingIOError:
                file.seek(0)
                raise OutputExists(
                    f"{self.path}: is being written by {file.read(200).decode(errors='replace').strip() or 'another process'}"
                ) from None
            if self._read_facts() != self.facts:
                raise OutputExists(
                    f"{self.path}: was changed by another process meanwhile; look at it again"
                )
            with contextlib.suppress(OSError):  # whose it is helps people only
                file.truncate(0)
                file.write(f"process {os.getpid()} of {platform.node()}\n".encode())
            self.clear()
            yield

    def clear(self):
        """Take away what writers left that were killed: temporary files, which no shard is, and which no process writes any more."""
        for folder in (self.path, self._folder):
            clear(folder, _OLD)


def _opener(path, flags):
    """Open a file of a run for writing. A link, which may lead out of the run, is refused; a pipe does not block."""
    return os.open(path, flags | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0), 0o666)


def flagged_of(path):
    """How many members of a shard are flagged, by its name."""
    found = _SHARD.fullmatch(os.path.basename(path))
    return int(found[2]) if found else 0


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


def status(path):
    """What of a run is done, by the names of its shards alone: {"shards", "done", "members", "members_done", "flagged", "strays", "rate",
    "seconds_left", "machine", "versions"}; the strays are files that are no shards of the run.

    The rate [1/s] is that since it was last begun: of the journal where that has ended, else from the times of the shards that appeared.
    """
    directory = RunDirectory(path)
    (shards, strays), journal = directory.listed(), directory.journal()
    members = sum(len(directory.members(i)) for i in shards)
    begun = max((line["time"] for line in journal if line["event"] == "begun"), default=math.inf)
    made = list[tuple[float, int]]()
    for i, shard in shards.items():
        with contextlib.suppress(FileNotFoundError):  # taken away meanwhile
            made.append((os.stat(shard).st_mtime, len(directory.members(i))))
    new, seconds = (
        sum(count for at, count in made if at > begun),
        max((at for at, _ in made), default=0.0) - begun,
    )
    for line in journal:
        if line["event"] == "ended" and line["time"] >= begun:
            new, seconds = line["members"] or 0, line["seconds"] or 0.0
    rate = (
        new / seconds if new > 0 and seconds >= 1e-3 else None
    )  # the journal's are rounded to that
    left = directory.facts["members"] - members
    return {
        "shards": directory.count, "done": len(shards), "members": directory.facts["members"], "members_done": members,
        "flagged": sum(map(flagged_of, shards.values())), "strays": len(strays), "rate": rate, "seconds_left": left / rate if rate else None,
        "machine": directory.facts["machine"], "versions": directory.facts["versions"],
    }  # fmt: skip
