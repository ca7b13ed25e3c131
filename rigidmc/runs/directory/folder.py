"""Run directories: run.json and scene.toml define the run, the shards are its finished part.

    run.json       constants: hash of the scene, seed, members of a shard and of a block, versions,
                   type of CPU; and the number of members. For a run of chosen members, `chosen` is
                   the hash of their indices, and `growing` is the level of the last ones while
                   their results may call for more members, else 0
    scene.toml     the resolved scene; columns.nc holds its quantities with one row per member
    members.i64    the indices of chosen members, in the order of the shards
    shards/        one netCDF4 file for each range of members; its bytes depend only on scene and
                   seed; its name contains the number of flagged members and the hash of the file
    unfinished/    states of blocks in progress, and results of incomplete shards: a resumed run
                   continues from there; see `rigidmc.runs.directory.checkpoints`
    journal.jsonl  events: when, where, how fast; nothing depends on it
    lock           held by the writing process

A shard is written as a temporary file, closed, synced (fsync) and renamed, so a file with the name
of a shard is complete. The list of shards is the state of the run.

A run directory can be a URL of a store, see `rigidmc.files.stores`. It has neither `unfinished` nor
`lock`; a shard is written here, then put whole.
"""

import contextlib
import errno
import hashlib
import json
import math
import os
import platform
import re
import shutil
import tempfile
import time
import warnings
import weakref
from collections.abc import Callable, Iterator, Sized
from functools import cached_property
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from rigidmc.errors import FileError, OutputExists, SceneWarning
from rigidmc.files.locks import lock, sign, taken_over, unlock
from rigidmc.files.opening import data_bytes, open_below, open_plain, open_regular, refuse_unnamed
from rigidmc.files.outputs import Path, clear, is_part
from rigidmc.files.reading import bytes_of, json_of
from rigidmc.files.stores import Store, is_url, join
from rigidmc.inputs.arrays import Ints
from rigidmc.runs.directory.facts import Count, read_facts, selection_facts

_SHARD = re.compile(r"([0-9]{8})-([0-9]{1,12})-([0-9a-f]{16})\.nc")
_OLD = 3600.0  # s, after which an unfinished file of another computer counts as abandoned
CHOSEN = "members.i64"
FILES = ("run.json", "scene.toml", "columns.nc", CHOSEN)  # all that defines a run
_JOURNAL = 2**20  # bytes read from the end of a journal; each resume adds two lines of 300 bytes


class _Line(BaseModel):
    """The keys of a line of the journal that the code uses; the others are for people."""

    model_config = ConfigDict(strict=True)

    time: Annotated[float, Field(ge=0.0, le=1e11)]
    event: str = ""
    members: Count | None = None
    seconds: Annotated[float, Field(ge=0.0, le=1e11)] | None = None


def _line(text: bytes) -> dict[str, Any] | None:
    """Read a line of the journal; None if it is damaged."""
    try:
        line = json_of(text.decode("utf-8"))
        checked = _Line.model_validate(line).model_dump()
    except ValueError:  # includes errors of pydantic
        return None
    return {**line, **checked}


class RunDirectory:
    """An existing run directory.

    path : of the directory, or its URL;  facts : of its run.json
    store : of a URL, else None
    folder : of its FILES here: the directory itself, or copies of those in a store
    written : path of the last shard that this object has written
    """

    def __init__(self, path: Path) -> None:
        self.path = os.fspath(path)
        refuse_unnamed(self.path)
        self.store, self.folder = None, self.path
        if is_url(self.path):
            self.path = self.path.rstrip("/")
            self.store = Store(self.path)
            self.folder = tempfile.mkdtemp(prefix="rigidmc-")
            weakref.finalize(self, shutil.rmtree, self.folder, True)
            os.mkdir(self._folder)
            for name in FILES:
                self.store.download(name, os.path.join(self.folder, name))
        self.facts = self._read_facts()
        self.written = ""
        for folder in (self._folder, self.unfinished):
            if os.path.islink(folder):
                rule = "is a link; a run must stay in its folder"
                raise FileError(rule, at=os.path.basename(folder), file=self.path)

    @property
    def _folder(self) -> str:
        return os.path.join(self.folder, "shards")

    @property
    def unfinished(self) -> str:
        """The folder for incomplete shards."""
        return os.path.join(self.folder, "unfinished")

    def _read_facts(self) -> dict[str, Any]:
        name = os.path.join(self.folder, "run.json")
        if not os.path.lexists(self.folder):
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), self.path)
        if not os.path.isfile(name):
            if self.store is not None:
                self.store.refuse_no_bucket()
            raise FileError("is not a run directory: no run.json", at="run", value=self.path)
        return read_facts(name)

    @property
    def mark(self) -> str:
        """The hash of scene, rows and code in each shard: it distinguishes shards of different
        runs."""
        facts = self.facts
        words = [facts["scene"], facts["columns"], sorted(facts["code"].values())]
        return hashlib.sha256(json.dumps(words).encode()).hexdigest()

    @property
    def count(self) -> int:
        """Number of shards of the complete run."""
        return -(-int(self.facts["members"]) // int(self.facts["shard"]))

    @cached_property
    def chosen(self) -> Ints | None:
        """The indices of the members; None if they are a range. FileError if they were changed.

        If a run was killed while growing, the disk may have more indices than run.json states.
        """
        if not self.facts.get("chosen"):
            return None
        name = os.path.join(self.folder, CHOSEN)
        if not os.path.isfile(name):
            raise FileError("is missing", at=CHOSEN, file=self.path)
        with open(name, "rb", opener=open_plain) as file:
            count = min(int(self.facts["members"]), data_bytes(file.fileno()) // 8)
            members = np.fromfile(file, "<i8", count)
        if selection_facts(members)["chosen"] != self.facts["chosen"]:
            raise FileError("was changed: its checksum differs", at=CHOSEN, file=self.path)
        return members.astype(np.int64)

    def places(self, i: int) -> range:
        """Return the range of places of the members of shard i."""
        first, end = self.facts["first"], self.facts["first"] + self.facts["members"]
        low = first + i * self.facts["shard"]
        return range(low, min(low + self.facts["shard"], end))

    def members(self, i: int) -> range | Ints:
        """Return the indices of the members of shard i: their places, unless members are chosen."""
        places = self.places(i)
        return places if self.chosen is None else self.chosen[places.start : places.stop]

    def members_of(self, shards: Sized) -> int:
        """Return the total number of members in shards, given by their numbers."""
        size = int(self.facts["shard"])
        short = self.count * size - int(self.facts["members"])  # members that the last shard lacks
        return len(shards) * size - short * bool(np.any(np.asarray(shards) == self.count - 1))

    def listed(self) -> tuple[dict[int, str], list[str]]:
        """Return ({i: path} of the existing shards, paths of strays). Strays are files that are not
        shards of this run, because of their names or numbers, or because their number is taken."""
        shards: dict[int, str] = {}
        strays = list[str]()
        for file, path, regular in self._files():
            name = _SHARD.fullmatch(file)
            if name and regular and int(name[1]) < self.count and int(name[1]) not in shards:
                shards[int(name[1])] = path
            elif not is_part(file):
                strays.append(path)
        return shards, strays

    def _files(self) -> list[tuple[str, str, bool]]:
        """Return (name, path, whether it is a regular file) of all in the folder of shards."""
        if self.store is not None:
            return [(name, self.final(name), True) for name in sorted(self.store.listed("shards"))]
        try:
            with os.scandir(self._folder) as entries:
                return sorted(
                    (file.name, file.path, file.is_file(follow_symlinks=False)) for file in entries
                )
        except FileNotFoundError:
            return []

    def final(self, name: str) -> str:
        """Return the path or URL of a shard with this name."""
        return join(join(self.path, "shards"), name)

    def times(self, shards: dict[int, str]) -> dict[int, float]:
        """Return {i: time at which it appeared} of shards that are still there."""
        times = dict[int, float]()
        there = None if self.store is None else self.store.listed("shards")
        for i, path in shards.items():
            with contextlib.suppress(FileNotFoundError, KeyError):
                name = os.path.basename(path)
                times[i] = os.stat(path).st_mtime if there is None else there[name]
        return times

    def shards(self) -> dict[int, str]:
        """Return {i: path} of the existing shards."""
        return self.listed()[0]

    def refuse_strays(self, strays: list[str] | None = None) -> None:
        """Raise FileError if there are strays among the shards. strays : from `listed`"""
        if strays := self.listed()[1] if strays is None else strays:
            rule = (
                f"{', '.join(strays)}: not a shard of this run; "
                "remove it first, or see `rigidmc verify`"
            )
            raise FileError(rule, at="run", value=self.path)

    def temporary(self, i: int) -> str:
        """Return the temporary path of shard i until it is complete."""
        return os.path.join(self._folder, f"{i:08d}")

    def shard_path(self, i: int, flagged: int, file: str) -> str:
        """Return the final path of a finished file as shard i with `flagged` flagged members."""
        return os.path.join(self._folder, f"{i:08d}-{flagged}-{hash_of_file(file)[:16]}.nc")

    def publish(self, path: str) -> None:
        """Record a shard that has been written under its final path here; move it to the store."""
        name = os.path.basename(path)
        if self.store is not None:
            self.store.upload(path, f"shards/{name}")
            os.unlink(path)
        self.written = self.final(name)

    def delete(self, path: str) -> None:
        """Delete a shard or stray."""
        if self.store is None:
            os.unlink(path)
        else:
            self.store.delete(f"shards/{os.path.basename(path)}")

    def refuse_store(self, what: str) -> None:
        """Raise FileError for a run in a store, where `what` would need a lock."""
        if self.store is not None:
            cure = f"make a directory of it with `rigidmc merge RUN/ {self.path}`"
            rule = f"{what} needs a lock, and stores have none: {cure}"
            raise FileError(rule, at="run", value=self.path)

    def missing(self) -> Ints:
        """Return the numbers of the missing shards, 8 bytes each."""
        gone = np.ones(self.count, bool)
        gone[list(self.shards())] = False
        return np.flatnonzero(gone)

    def missing_in(self, only: range) -> Ints:
        """Return the numbers of the missing shards of a range."""
        missing = self.missing()
        return missing[(missing >= only.start) & (missing < only.stop)]

    def note(self, **facts: Any) -> None:
        """Add a line to the journal, ignoring failures: nothing depends on it."""
        about = {"time": round(time.time(), 3), "host": platform.node(), "pid": os.getpid()}
        line = json.dumps({**about, **facts})
        if self.store is not None:  # lines of a process that writes at the same time may be lost
            with contextlib.suppress(FileError):
                old = self.store.get("journal.jsonl") or b""
                self.store.put("journal.jsonl", old[-_JOURNAL:] + line.encode() + b"\n")
            return
        name = os.path.join(self.path, "journal.jsonl")
        with (
            contextlib.suppress(OSError, FileError),
            open(name, "a", encoding="utf-8", opener=open_plain) as file,
        ):
            file.write(line + "\n")

    def journal(self) -> list[dict[str, Any]]:
        """Read the last lines of the journal. Nothing depends on it, so torn or impossible lines
        are ignored with a SceneWarning."""
        name = join(self.path, "journal.jsonl")
        try:
            if self.store is None:
                text = bytes_of(name, _JOURNAL, last=True, links=False)
            else:
                text = (self.store.get("journal.jsonl") or b"")[-_JOURNAL:]
        except (OSError, FileError):
            return []
        # the first line of a partial read is incomplete
        texts = text.splitlines()[1 if len(text) == _JOURNAL else 0 :]
        read = [_line(entry) for entry in texts]
        lines = [line for line in read if line is not None]
        if damaged := len(read) - len(lines):
            rule = f"{damaged:,} damaged lines are ignored; nothing depends on them"
            warnings.warn(f"{name}: {rule}", SceneWarning, stacklevel=2)
        return lines

    @contextlib.contextmanager
    def locked(self) -> Iterator[None]:
        """Hold the lock of the writing process.

        A store has no locks. Two processes may compute the same shard there, and put the same
        object, because the name and the bytes of a shard are a function of the run and its number.
        What changes other objects is refused, see `refuse_store`.

        Raises OutputExists if another process holds the lock, or has written since this process
        read run.json. The lock ends with the process, however that ends.
        """
        os.makedirs(self._folder, exist_ok=True)
        if self.store is not None:
            yield
            return
        name = os.path.join(self.path, "lock")
        with taken_over(name) or open(name, "ab+", buffering=0, opener=open_plain) as file:
            try:
                lock(file, name)
            except BlockingIOError:
                file.seek(0)
                holder = file.read(200).decode(errors="replace").strip() or "another process"
                raise OutputExists(f"{self.path}: {holder} is writing to it") from None
            # after the lock: `extend` or `add_members` may have run since this object read run.json
            if self._read_facts() != self.facts:
                rule = "was changed by another process meanwhile; open it again"
                raise OutputExists(f"{self.path}: {rule}")
            sign(file)
            # only with the lock: a live writer on another computer may pause for longer than _OLD
            self.clear()
            try:
                yield
            finally:
                unlock(file)

    def clear(self) -> None:
        """Delete the unfinished files of killed writers."""
        for folder in (self.folder, self._folder, self.unfinished):
            clear(folder, _OLD)


def flagged_count(path: str) -> int:
    """Return the number of flagged members of a shard, from its name."""
    name = _SHARD.fullmatch(os.path.basename(path))
    return int(name[2]) if name else 0


def hash_of_file(path: Path, opener: Callable[[str, int], int] = open_regular) -> str:
    """Return the sha256 of a file. opener : decides which links to follow, see
    `rigidmc.files.opening`"""
    with open(path, "rb", opener=opener) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def is_damaged(path: str) -> bool:
    """Whether the content of a shard contradicts its name."""
    name = _SHARD.fullmatch(os.path.basename(path))
    return not name or hash_of_file(path, open_below)[:16] != name[3]


def status(path: Path) -> dict[str, Any]:
    """Return the progress of a run, from the names of its shards alone: {"shards", "done",
    "members", "members_done", "flagged", "strays", "growing", "rate", "seconds_left", "machine",
    "versions"}.

    strays : number of strays, see `RunDirectory.listed`
    growing : whether the run may need more members when all exist
    rate : members per second since the last start [1/s], from the journal if that part has ended,
        else from the times of the new shards
    """
    directory = RunDirectory(path)
    (shards, strays), journal = directory.listed(), directory.journal()
    members = sum(len(directory.places(i)) for i in shards)
    begun = max((line["time"] for line in journal if line["event"] == "begun"), default=math.inf)
    times = directory.times(shards)
    appeared = [(at, len(directory.places(i))) for i, at in times.items()]
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
