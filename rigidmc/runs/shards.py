"""The shards of a run directory: computed from its scene, and written in the order of their members by a thread of its own."""

import contextlib
import math
import os
import queue
import threading
import time
from typing import Any

import numpy as np

from rigidmc.engine.layout import LANES
from rigidmc.engine.machine import this_machine
from rigidmc.errors import FileError, RigidmcError, SceneError
from rigidmc.files.netcdf import read
from rigidmc.files.reading import text_of
from rigidmc.observables import rows_of
from rigidmc.planning.plan import BLOCK, SLAB
from rigidmc.planning.settle import settled
from rigidmc.planning.units import told
from rigidmc.runs.blocks import compute
from rigidmc.scene.file import loads
from rigidmc.storage.run_directory import damaged, flagged_of, hash_of, hash_of_file
from rigidmc.storage.schema import bytes_of_a_member
from rigidmc.storage.sinks import Memory, buffer
from rigidmc.storage.writer import Writer

SHARD = 64 * 2**20  # bytes of a shard: a thousand of them are 67 GB


def members_of(scene, plan, size=SHARD):
    """(members of a block, members of a shard) of a run whose shards are to have about `size` bytes; neither depends on threads."""
    values = 8 * max(1, rows_of(scene.effects, *scene.recorded())) * plan.times.size
    block = min(BLOCK, max(LANES, SLAB // values // LANES * LANES))
    return block, block * max(1, int(size / sum(bytes_of_a_member(scene, plan)) / block))


def scene_in(folder, facts, allow_code):
    """The scene that lies in a folder, with its columns."""
    stored: Any = None
    name = os.path.join(folder, "scene.toml")
    if facts["columns"]:
        file = os.path.join(folder, "columns.nc")
        if not os.path.isfile(file) or hash_of_file(file) != facts["columns"]:
            raise FileError(
                "",
                "columns.nc",
                None,
                "is not what was written: the rows of the members are gone",
                file=folder,
            )
        kept = read(file)

        stored = kept.get
    return loads(text_of(name), name, stored=stored, allow_code=allow_code)


def scene_of_run(directory, allow_code=False):
    """The scene of a run; FileError where scene.toml is no longer the one that it was started with."""
    facts = directory.facts
    if allow_code and (
        other := [
            name
            for name, known in facts["code"].items()
            if not os.path.isfile(name) or hash_of_file(name) != known
        ]
    ):
        raise FileError(
            "",
            "code",
            ", ".join(other),
            "is not the file that the run was started with",
            file=directory.path,
        )
    scene = scene_in(directory.path, facts, allow_code)
    if hash_of(scene) != facts["scene"]:
        rule = (
            "is not the scene that the run was started with; what is there was computed with that"
        )
        raise FileError("", "scene.toml", None, rule, file=directory.path)
    return scene.with_run(members=facts["members"], first=facts["first"])


def planned(directory, allow_code=False, threads=1, block=None):
    """(scene, plan, units, and scene and plan in the units of the user) of a run."""
    scene, plan, units, _ = settled(
        scene_of_run(directory, allow_code), threads, True, block or directory.facts["block"]
    )
    if directory.facts["shard"] % plan.block:
        raise SceneError(
            "run",
            "block",
            plan.block,
            f"has to divide the {directory.facts['shard']:,} members of a shard",
        )
    return scene, plan, units, *told(scene, plan, units)


def memory_of_shards(scene, plan, shard, threads):
    """Bytes of the shards that are there at once: those that blocks on their way are of, one that waits and one that is written, twice."""
    return (
        (4 + math.ceil((threads + 2) * plan.block / shard))
        * shard
        * sum(bytes_of_a_member(scene, plan))
    )


def fault_of(directory, i, path):
    """In words, what is wrong with a shard as such, "" for nothing: its sum, its run, its members, how many of them are flagged."""
    if damaged(path):
        return f"{path}: is not what was written: its sum is not that of its name"
    try:
        found, members = read(path, "member", "status", mark=directory.mark), directory.members(i)
    except RigidmcError as error:
        return str(error)
    if (
        found["member"].shape != (len(members),)
        or found["status"].shape != (len(members),)
        or found["member"][0] != members[0]
    ):
        return f"{path}: is no shard {i} of this run: its members are others"
    count = np.count_nonzero(found["status"])
    if count != flagged_of(path):
        return f"{path}: its name says {flagged_of(path):,} flagged members, its content {count:,}"
    return ""


def refuse_others(directory, accept):
    """FileError where this machine is another than that of the run."""
    known = directory.facts["versions"]
    versions, _ = this_machine(*["scipy"] * ("scipy" in known))
    other = [
        f"{name} {known.get(name)} there, {here} here"
        for name, here in versions.items()
        if known.get(name) != here
    ]
    if other and not accept:
        rule = f"was started with others: {'; '.join(other)}. Bits of new members may differ from those of old ones; --accept takes that"
        raise FileError("", "run", directory.path, rule)


def compute_shards(directory, parts, program, which, threads, progress=False, stop=None):
    """Compute some shards of a run that is `planned`, none that would not be done by `stop`; {status: members}."""
    scene, plan, units, *shown = parts
    started, begun = time.monotonic(), 0
    each, count = directory.facts["shard"] // plan.block, math.ceil(plan.members / plan.block)

    def blocks():
        nonlocal begun
        for i in map(int, which):
            took = (time.monotonic() - started) / sink.written if sink.written else 0.0
            if stop is not None and time.monotonic() + took * (begun - sink.written + 1) > stop:
                return
            begun += 1
            yield from range(i * each, min((i + 1) * each, count))

    sink = Shards(directory, *shown)
    try:
        flagged = compute(
            scene,
            plan,
            program,
            threads,
            sink,
            progress,
            units,
            blocks(),
            directory.members_of(which),
        )
        sink.finish()
    except BaseException:
        sink.discard()
        raise
    return flagged


class Shards:
    """Collects blocks to shards of a run directory, which a thread of its own writes; what is written depends on no order, thread or block that
    came first. Of a block only what is kept waits for the disk: its memory is at once that of the next.

    directory : RunDirectory, whose lock this process holds;  plan : of the whole run
    """

    def __init__(self, directory, scene, plan):
        self.directory, self.scene, self.plan = directory, scene, plan
        self._queue: queue.Queue = queue.Queue(
            1
        )  # where a disk is slower than that, those that compute wait: memory does not grow
        self._open: dict[int, tuple] = {}  # shard -> (what of it is there, [how many members])
        self._error: BaseException | None = None
        self.written = 0
        self._dropped = False
        self._thread = threading.Thread(target=self._work, name="rigidmc-writer", daemon=True)
        self._thread.start()

    def room(self, low, count):
        return buffer(self.scene, self.plan, count)

    def take(self, job, results):
        facts = self.directory.facts
        i = (job.first - facts["first"]) // facts["shard"]
        members = self.directory.members(i)
        if i not in self._open:
            part = self.plan._replace(
                first=members.start, members=len(members), block=facts["block"]
            )
            self._open[i] = Memory(self.scene, part, {}, False), [0]
        part, done = self._open[i]
        part.take(job, results)
        done[0] += job.size
        if done[0] == len(members):
            del self._open[i]
            self._put((i, part))

    def _put(self, item):
        """Hand something to the thread that writes; what went wrong there is raised here, where else one might wait for it forever."""
        while self._error is None:
            with contextlib.suppress(queue.Full):
                return self._queue.put(item, timeout=0.2)
        raise self._error

    def finish(self):
        self._put(None)
        self._thread.join()
        if self._error is not None:
            raise self._error

    def discard(self):
        """Drop what is not whole; shards that are stay."""
        self._dropped = True
        while self._thread.is_alive():
            with contextlib.suppress(queue.Full):
                self._queue.put_nowait(None)
            self._thread.join(0.05)
        self._open.clear()

    def _work(self):
        try:
            while (item := self._queue.get()) is not None and not self._dropped:
                self._write(*item)
                del item  # it waits for the next with the memory of none
        except BaseException as error:  # told by the thread that computes
            self._error = error

    def _write(self, i, part):
        """All at once and in one order: no byte depends on which block came first, and it takes half the time."""
        values, bad = part.values(), int(np.count_nonzero(part.arrays["status"]))
        path, named = self.directory.temporary(i), lambda file: self.directory.named(i, bad, file)
        writer = Writer(
            path, self.scene, part.plan, force=True, attrs={"run": self.directory.mark}, named=named
        )
        try:
            by_member = [name for name, v in writer.variables.items() if "member" in v.dims]
            writer.write(
                part.plan.first, part.plan.members, {name: values[name] for name in by_member}
            )
            writer.write_all({name: v for name, v in values.items() if name not in by_member})
            writer.finish()
            self.written += 1
        except BaseException:
            writer.discard()
            raise
