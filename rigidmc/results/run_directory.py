"""A run as a directory: run.json and scene.toml say what the run is, its shards say what is done.

    run.json       what never changes: hash of the scene, seed, members of a shard and of a block,
                   versions, type of processor; and how many members the run has. A run of chosen
                   members has the hash of their indices in `chosen`, and in `growing` the level of
                   the last ones while what they say may call for more, else 0
    scene.toml     the scene, resolved; columns.nc holds those of its quantities that have one row
                   per member
    members.i64    the indices of the members of a run that has chosen ones, in the order of its
                   shards
    shards/        one netCDF4 file for each range of members; its bytes depend on scene and seed
                   alone, and its name has how many members are flagged and the hash of the file
    unfinished/    states of blocks that are on their way, and results of shards that are not whole:
                   a resumed run goes on from there; see `rigidmc.runs.directory.checkpoints`
    journal.jsonl  what happened: when, where, how fast; nothing depends on it
    lock           held by the process that writes

A shard appears by a temporary file, close, fsync and rename, so a file with the name of a shard is
whole. The list of shards is the state of the run.
"""

import contextlib
import errno
import hashlib
import json
import math
import os
import platform
import re
import time
import warnings
from collections.abc import Callable, Iterator, Sized
from functools import cached_property
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from rigidmc.errors import FileError, OutputExists, SceneWarning, in_file
from rigidmc.files.locks import lock, unlock
from rigidmc.files.opening import data_bytes, open_below, open_plain, open_regular, refuse_unnamed
from rigidmc.files.outputs import Path, clear, is_part
from rigidmc.files.reading import bytes_of, json_of, text_of
from rigidmc.scene.scene import Scene

FORMAT = 1
MOST = 10**7  # shards, each a file; their names have eight digits
Count = Annotated[int, Field(ge=0, le=2**53)]
_Hash = Annotated[str, Field(pattern="^[0-9a-f]{64}$")]


class _Facts(BaseModel):
    """The keys of run.json, which may have no others, with their types and ranges."""

    model_config = ConfigDict(extra="forbid", strict=True)

    format: int
    scene: _Hash
    columns: Annotated[str, Field(pattern="^([0-9a-f]{64})?$")]
    code: dict[str, str]
    attributes: dict[str, str | int | float]
    seed: Annotated[int, Field(ge=0, lt=2**63)]
    first: Count
    members: Annotated[int, Field(ge=1, le=2**53)]
    shard: Annotated[int, Field(ge=1, le=2**53)]
    block: Annotated[int, Field(ge=1, le=2**20)]
    versions: dict[str, str]
    machine: str
    chosen: Annotated[str, Field(pattern="^([0-9a-f]{64})?$")] = ""
    growing: Count = 0


def read_facts(path: str) -> dict[str, Any]:
    """The facts of a run.json; FileError if it is damaged or of another format."""
    with in_file(path):
        return _facts_of(text_of(path, links=False))


def _facts_of(text: str) -> dict[str, Any]:
    try:
        facts = json_of(text)
        if isinstance(facts, dict):
            facts.pop("check", None)
        _Facts.model_validate(facts)
    except ValidationError as error:
        first = error.errors()[0]
        key = str(first["loc"][0]) if first["loc"] else "run.json"
        rule = f"is damaged: {first['msg'][0].lower()}{first['msg'][1:]}"
        raise FileError(rule, at=key) from None
    except ValueError as error:
        raise FileError(f"is damaged: {error}", at="run.json") from None
    if facts_text(facts) != text:
        rule = "is damaged, or was changed by hand: its checksum does not match"
        raise FileError(rule, at="run.json")
    if facts["format"] != FORMAT:
        rule = f"this version reads format {FORMAT}"
        raise FileError(rule, at="format", value=facts["format"])
    if facts["first"] + facts["members"] > 2**53 or facts["shard"] % facts["block"]:
        rule = "is damaged: a shard must be whole blocks, and members below 2^53"
        raise FileError(rule, at="members")
    if facts["members"] > MOST * facts["shard"]:
        rule = f"is damaged: a run has at most {MOST:,} shards"
        raise FileError(rule, at="shard", value=facts["shard"])
    return dict(facts)


def facts_text(facts: dict[str, Any]) -> str:
    """The text of run.json, with its checksum."""
    check = hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()
    return json.dumps({**facts, "check": check}, indent=1) + "\n"


_SHARD = re.compile(r"([0-9]{8})-([0-9]{1,12})-([0-9a-f]{16})\.nc")
_OLD = 3600.0  # seconds after which an unfinished file of another computer counts as abandoned
CHOSEN = "members.i64"
_JOURNAL = 2**20  # bytes read from the end of a journal; each resume adds two lines of 300 bytes


class _Line(BaseModel):
    """The keys of a line of the journal that are used in computing; the others are for people."""

    model_config = ConfigDict(strict=True)

    time: Annotated[float, Field(ge=0.0, le=1e11)]
    event: str = ""
    members: Count | None = None
    seconds: Annotated[float, Field(ge=0.0, le=1e11)] | None = None


def _line(text: bytes) -> dict[str, Any] | None:
    """The facts of a line of the journal; None if it is damaged."""
    try:
        line = json_of(text.decode("utf-8"))
        known = _Line.model_validate(line).model_dump()
    except ValueError:  # also of pydantic
        return None
    return {**line, **known}


def hash_of(scene: Scene) -> str:
    """The hash of what decides a member's numbers: the scene without its member range."""
    return hashlib.sha256(scene.with_run(members=1, first=0).dumps().encode()).hexdigest()


class RunDirectory:
    """A run directory that exists. path : of the directory;  facts : of its run.json"""

    def __init__(self, path: Path) -> None:
        self.path = os.fspath(path)
        refuse_unnamed(self.path)
        self.facts = self._read_facts()
        for folder in (self._folder, self.unfinished):
            if os.path.islink(folder):
                rule = "is a link, and a run keeps to its folder"
                raise FileError(rule, at=os.path.basename(folder), file=self.path)

    @property
    def _folder(self) -> str:
        return os.path.join(self.path, "shards")

    @property
    def unfinished(self) -> str:
        """The folder of what there is of shards that are not whole."""
        return os.path.join(self.path, "unfinished")

    def _read_facts(self) -> dict[str, Any]:
        name = os.path.join(self.path, "run.json")
        if not os.path.lexists(self.path):
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), self.path)
        if not os.path.isfile(name):
            raise FileError("is no run directory: it has no run.json", at="run", value=self.path)
        return read_facts(name)

    @property
    def mark(self) -> str:
        """The hash of scene, rows and code, which each shard carries: it tells the shards of
        different runs apart."""
        facts = self.facts
        words = [facts["scene"], facts["columns"], sorted(facts["code"].values())]
        return hashlib.sha256(json.dumps(words).encode()).hexdigest()

    @property
    def count(self) -> int:
        """How many shards the whole run has."""
        return -(-int(self.facts["members"]) // int(self.facts["shard"]))

    @cached_property
    def chosen(self) -> NDArray[np.int64] | None:
        """The indices of the members; None if they are a range. FileError if they were changed.

        A run that was killed while it grew may have more of them on disk than run.json tells.
        """
        if not self.facts.get("chosen"):
            return None
        name = os.path.join(self.path, CHOSEN)
        if not os.path.isfile(name):
            raise FileError("is missing", at=CHOSEN, file=self.path)
        with open(name, "rb", opener=open_plain) as file:
            count = min(int(self.facts["members"]), data_bytes(file.fileno()) // 8)
            members = np.fromfile(file, "<i8", count)
        if selection_facts(members)["chosen"] != self.facts["chosen"]:
            raise FileError("was changed: its sum is another", at=CHOSEN, file=self.path)
        return members.astype(np.int64)

    def places(self, i: int) -> range:
        """The range of places of the members of shard i."""
        first, end = self.facts["first"], self.facts["first"] + self.facts["members"]
        low = first + i * self.facts["shard"]
        return range(low, min(low + self.facts["shard"], end))

    def members(self, i: int) -> range | NDArray[np.int64]:
        """The indices of the members of shard i: their places, unless the run has chosen ones."""
        places = self.places(i)
        return places if self.chosen is None else self.chosen[places.start : places.stop]

    def members_of(self, shards: Sized) -> int:
        """How many members some shards have together, given by their numbers."""
        size = int(self.facts["shard"])
        short = self.count * size - int(self.facts["members"])  # members that the last shard lacks
        return len(shards) * size - short * bool(np.any(np.asarray(shards) == self.count - 1))

    def listed(self) -> tuple[dict[int, str], list[str]]:
        """({i: path} of the shards that exist, paths of strays: files that are not shards of this
        run, because of their names or numbers, or because their number is taken)."""
        shards: dict[int, str] = {}
        strays = list[str]()
        with contextlib.suppress(FileNotFoundError), os.scandir(self._folder) as entries:
            for entry in sorted(entries, key=lambda entry: entry.name):
                name = _SHARD.fullmatch(entry.name)
                if (
                    name
                    and int(name[1]) < self.count
                    and int(name[1]) not in shards
                    and entry.is_file(follow_symlinks=False)
                ):
                    shards[int(name[1])] = entry.path
                elif not is_part(entry.name):
                    strays.append(entry.path)
        return shards, strays

    def shards(self) -> dict[int, str]:
        """{i: path} of the shards that exist."""
        return self.listed()[0]

    def refuse_strays(self) -> None:
        """Raise FileError if there are strays among the shards."""
        if strays := self.listed()[1]:
            rule = (
                f"{', '.join(strays)}: no shard of this run; "
                "take it away first, or see `rigidmc verify`"
            )
            raise FileError(rule, at="run", value=self.path)

    def temporary(self, i: int) -> str:
        """Where shard i is written until it is whole."""
        return os.path.join(self._folder, f"{i:08d}")

    def shard_path(self, i: int, flagged: int, file: str) -> str:
        """The path that a finished file must have as shard i, with so many flagged members."""
        return os.path.join(self._folder, f"{i:08d}-{flagged}-{hash_of_file(file)[:16]}.nc")

    def missing(self) -> NDArray[np.int64]:
        """The numbers of the missing shards, 8 bytes each."""
        gone = np.ones(self.count, bool)
        gone[list(self.shards())] = False
        return np.flatnonzero(gone)

    def missing_in(self, only: range) -> NDArray[np.int64]:
        """The numbers of the missing shards of a range."""
        missing = self.missing()
        return missing[(missing >= only.start) & (missing < only.stop)]

    def note(self, **facts: Any) -> None:
        """Add a line to the journal if it can be written: nothing depends on it."""
        about = {"time": round(time.time(), 3), "host": platform.node(), "pid": os.getpid()}
        line = json.dumps({**about, **facts})
        name = os.path.join(self.path, "journal.jsonl")
        with (
            contextlib.suppress(OSError, FileError),
            open(name, "a", encoding="utf-8", opener=open_plain) as file,
        ):
            file.write(line + "\n")

    def journal(self) -> list[dict[str, Any]]:
        """The last lines of the journal. Nothing depends on it, so a line that is torn or says what
        cannot be is left out, with a SceneWarning."""
        name = os.path.join(self.path, "journal.jsonl")
        try:
            text = bytes_of(name, _JOURNAL, last=True, links=False)
        except (OSError, FileError):
            return []
        # the first line of a part is no whole line
        texts = text.splitlines()[1 if len(text) == _JOURNAL else 0 :]
        found = [_line(one) for one in texts]
        lines = [line for line in found if line is not None]
        if damaged := len(found) - len(lines):
            rule = f"{damaged:,} damaged lines are left out; nothing depends on them"
            warnings.warn(f"{name}: {rule}", SceneWarning, stacklevel=2)
        return lines

    @contextlib.contextmanager
    def locked(self) -> Iterator[None]:
        """Hold the lock of the process that writes.

        Raises OutputExists if another process holds it, or has written since this one looked. The
        lock ends with the process, whatever ends that.
        """
        os.makedirs(self._folder, exist_ok=True)
        name = os.path.join(self.path, "lock")
        with open(name, "ab+", buffering=0, opener=open_plain) as file:
            try:
                lock(file, name)
            except BlockingIOError:
                file.seek(0)
                holder = file.read(200).decode(errors="replace").strip() or "another process"
                raise OutputExists(f"{self.path}: is being written by {holder}") from None
            if self._read_facts() != self.facts:
                rule = "was changed by another process meanwhile; look at it again"
                raise OutputExists(f"{self.path}: {rule}")
            with contextlib.suppress(OSError):  # the name of the holder helps people only
                file.truncate(0)
                file.write(f"process {os.getpid()} of {platform.node()}\n".encode())
            self.clear()
            try:
                yield
            finally:
                unlock(file)

    def clear(self) -> None:
        """Delete the unfinished files of writers that were killed."""
        for folder in (self.path, self._folder, self.unfinished):
            clear(folder, _OLD)


def selection_facts(members: NDArray[np.int64]) -> dict[str, Any]:
    """What run.json tells of chosen members, which CHOSEN holds as eight bytes each."""
    data = members.astype("<i8").tobytes()
    return {"members": members.size, "chosen": hashlib.sha256(data).hexdigest()}


def flagged_count(path: str) -> int:
    """How many members of a shard are flagged, by its name."""
    name = _SHARD.fullmatch(os.path.basename(path))
    return int(name[2]) if name else 0


def hash_of_file(path: Path, opener: Callable[[str, int], int] = open_regular) -> str:
    """The sha256 of a file. opener : whose links it follows, see `rigidmc.files.opening`"""
    with open(path, "rb", opener=opener) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def is_damaged(path: str) -> bool:
    """Whether the content of a shard contradicts its name."""
    name = _SHARD.fullmatch(os.path.basename(path))
    return not name or hash_of_file(path, open_below)[:16] != name[3]


def status(path: Path) -> dict[str, Any]:
    """What of a run is done, by the names of its shards alone: {"shards", "done", "members",
    "members_done", "flagged", "strays", "growing", "rate", "seconds_left", "machine", "versions"}.

    The strays are counted, see `RunDirectory.listed`. A run that is growing may ask for more
    members when all are there. The rate [1/s] is that of the last time that the run was begun: from
    the journal if that has ended, else from the times of the shards that appeared.
    """
    directory = RunDirectory(path)
    (shards, strays), journal = directory.listed(), directory.journal()
    members = sum(len(directory.places(i)) for i in shards)
    begun = max((line["time"] for line in journal if line["event"] == "begun"), default=math.inf)
    appeared = list[tuple[float, int]]()
    for i, shard in shards.items():
        with contextlib.suppress(FileNotFoundError):  # deleted meanwhile
            appeared.append((os.stat(shard).st_mtime, len(directory.places(i))))
    new = sum(count for at, count in appeared if at > begun)
    seconds = max((at for at, _ in appeared), default=0.0) - begun
    for line in journal:
        if line["event"] == "ended" and line["time"] >= begun:
            new, seconds = line["members"] or 0, line["seconds"] or 0.0
    # the journal rounds its times to a millisecond
    rate = new / seconds if new > 0 and seconds >= 1e-3 else None
    left = directory.facts["members"] - members
    return {
        "shards": directory.count,
        "done": len(shards),
        "members": directory.facts["members"],
        "members_done": members,
        "flagged": sum(map(flagged_count, shards.values())),
        "strays": len(strays),
        "growing": bool(directory.facts.get("growing")),
        "rate": rate,
        "seconds_left": left / rate if rate else None,
        "machine": directory.facts["machine"],
        "versions": directory.facts["versions"],
    }
