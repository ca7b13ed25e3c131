"""Compute the shards of a run directory from its scene; one thread writes each in the order of its
members."""

import math
import os
import time
from collections.abc import Sequence
from queue import SimpleQueue

import numpy as np

from rigidmc.engine.cuda.devices import is_gpu
from rigidmc.engine.kernel.layout import BLOCK, LANES
from rigidmc.errors import FileError, RigidmcError
from rigidmc.files.netcdf import read
from rigidmc.files.stores import local_copy
from rigidmc.inputs.arrays import Ints
from rigidmc.processes.progress import say
from rigidmc.processes.threads import Task, Threads, drop, ending, is_late
from rigidmc.results.sinks import Arrays, MemorySink, Sink
from rigidmc.results.writer import Writer
from rigidmc.runs.blocks import BlockJob, compute
from rigidmc.runs.directory.checkpoints import Checkpoints
from rigidmc.runs.directory.folder import RunDirectory, flagged_count, is_damaged
from rigidmc.runs.prepare import PreparedRun
from rigidmc.runs.price import cost_per_step
from rigidmc.runs.resources import SLAB, WAVE, members_within
from rigidmc.runs.settled import Machine

SHARD = 64 * 2**20  # bytes of a shard: a thousand of them are 67 GB
TIME = 120.0  # seconds of one thread for a shard
SLOW = 1e-6  # seconds of a slow member-step; few shipped methods take as long
MANY = 10**5  # largest number of shards that TIME may cause

Numbers = Sequence[int] | Ints  # of shards


def shard_members(run: PreparedRun, size: float = SHARD) -> tuple[int, int]:
    """Return (members of a block, members of a shard) of a run, for shards of about `size` bytes;
    neither depends on the number of threads or on the machine."""
    block = min(BLOCK, members_within(run.layout, SLAB))
    return block, block * max(1, int(size / sum(run.layout.bytes_of_a_member()) / block))


def shorten_shards(
    run: PreparedRun, block: int, shard: int, limit: float = TIME, device: str = "cpu"
) -> tuple[int, int]:
    """Return (members of a block, members of a shard), so that one thread needs at most `limit`
    seconds for a shard at the rate measured here.

    A shard has a power of 2 times the members of a block, or of LANES, so that small changes of the
    rate do not change it. Short runs are not measured.
    """
    plan, members = run.plan, run.members.size
    if plan.scheme is None or min(shard, members) * plan.mean_steps * SLOW < limit:
        return block, shard
    each = 1e-9 * cost_per_step(run, device) * plan.mean_steps
    most = max(limit / each, members / MANY)
    if is_gpu(device):  # a GPU needs as long for one member as for a wave of them
        most = max(most, WAVE)
    if most >= min(shard, members):
        return block, shard
    unit = block if most >= block else LANES
    few = unit * 2 ** int(math.log2(max(1.0, most / unit)))
    return min(block, few), few


def memory_of_shards(run: PreparedRun, shard: int, block: int, threads: int) -> int:
    """Return the bytes of shards in memory at once: shards being filled (one may be on its way to a
    checkpoint), one queued, and one being written, which is held twice.

    shard : members of a shard
    """
    filled = math.ceil((threads + 2) * block / shard)
    return (5 + filled) * shard * sum(run.layout.bytes_of_a_member())


def fault_of(directory: RunDirectory, i: int, path: str) -> str:
    """Describe the fault of shard i in its checksum, run, members, or number of flagged members;
    "" if there is none."""
    with local_copy(path) as file:
        return _fault_in(directory, i, file).replace(file, path)


def _fault_in(directory: RunDirectory, i: int, path: str) -> str:
    """Describe the fault of shard i in a file here; see `fault_of`."""
    if is_damaged(path):
        return f"{path}: was changed: its checksum differs from the one in its name"
    members = directory.members(i)
    try:
        shard = read(path, "member", "status", mark=directory.mark)
    except RigidmcError as error:
        return str(error)
    shape = (len(members),)
    if (
        shard["member"].shape != shape
        or shard["status"].shape != shape
        or not np.array_equal(shard["member"], np.asarray(members))
    ):
        return f"{path}: is not shard {i} of this run: it has other members"
    count = np.count_nonzero(shard["status"])
    if count != flagged_count(path):
        return (
            f"{path}: its name says {flagged_count(path):,} flagged members, its content {count:,}"
        )
    return ""


def compute_shards(
    directory: RunDirectory,
    run: PreparedRun,
    numbers: Numbers,
    machine: Machine,
    stop: float | None = None,
) -> dict[str, int]:
    """Compute the shards with these numbers, from where they were left; return {status: members} of
    shards finished now.

    stop : time limit on the clock of time.monotonic(); work unfinished by then is stored
    """
    block = machine.block
    size = directory.facts["shard"] // block  # blocks of a shard
    count = math.ceil(run.members.size / block)
    sink = ShardSink(directory, run, block)
    blocks = (b for i in map(int, numbers) for b in range(i * size, min((i + 1) * size, count)))
    members = directory.members_of(numbers)
    try:
        with ending(stop):
            if is_late():
                say("the time limit ended before the first step")
            flagged = compute(run, sink, machine, blocks, members)
        sink.finish()
    except BaseException:
        sink.discard()
        raise
    return flagged


class ShardSink(Sink):
    """A sink that collects blocks to shards of a run directory; one thread writes them.

    The files do not depend on threads, blocks or their order. Only the saved values of a block wait
    for the disk; its memory serves the next block at once.

    directory : RunDirectory, whose lock this process holds
    """

    keeper: Checkpoints

    def __init__(self, directory: RunDirectory, run: PreparedRun, block: int) -> None:
        self.directory, self.layout = directory, run.layout
        self.members = run.members._replace(block=block)
        # one place: if the disk is slow, the computing threads wait and memory stays bounded
        self._queue = SimpleQueue[tuple[int, MemorySink] | None]()
        self._open: dict[int, MemorySink] = {}  # shards that are being filled
        self._there: dict[int, set[int]] = {}  # the places of their finished blocks
        self.keeper = Checkpoints(directory, run.layout, block)
        self.keeper.drop_written()
        self._dropped = False
        self._thread, self._writing = Threads(1), Task(self._work)
        self._thread.begin(self._writing)

    def has(self, place: int) -> bool:
        """Return whether the results of the block at a place exist, perhaps in a checkpoint."""
        return place in self._opened(self._shard_of(place))

    def resumed(self, job: BlockJob) -> BlockJob:
        """Return a block continued from its checkpoint."""
        return self.keeper.resumed(job)

    def take(self, gathered: tuple[BlockJob, Arrays]) -> None:
        """Add a finished block to its shard; a complete shard goes to the writing thread."""
        job, results = gathered
        i = self._shard_of(job.first)
        there, places = self._opened(i), self.directory.places(i)
        shard = self._open[i]
        shard.take(shard.gather(job, results))
        there.add(job.first)
        if len(there) == -(-len(places) // self.members.block):
            del self._there[i]
            self._put((i, self._open.pop(i)))
        else:
            self.keeper.keep_shard(i, self._open[i], there, False)

    def _shard_of(self, place: int) -> int:
        facts = self.directory.facts
        return int((place - facts["first"]) // facts["shard"])

    def _opened(self, i: int) -> set[int]:
        """Return the places of the finished blocks of shard i."""
        if i not in self._open:
            places, block = self.directory.places(i), self.directory.facts["block"]
            members = self.members._replace(first=places.start, size=len(places), block=block)
            self._open[i] = MemorySink(self.layout, members, direct=False)
            self._there[i] = self.keeper.fill(i, self._open[i])
        return self._there[i]

    def _keep(self) -> None:
        """Store the finished blocks of incomplete shards."""
        for i, there in self._there.items():
            self.keeper.keep_shard(i, self._open[i], there, True)

    def _put(self, item: tuple[int, MemorySink] | None) -> None:
        """Hand a shard to the writing thread. An error of that thread is raised here, because the
        queue would stay full forever."""
        while not self._writing.done:
            if self._queue.empty():
                self._queue.put(item)
                return
            time.sleep(0.005)
        self._writing.result()

    def finish(self) -> None:
        """Wait until all complete shards are written; store the finished blocks of others."""
        self._keep()
        self._put(None)
        self._writing.wait()
        self._thread.end()
        self.keeper.end()

    def discard(self) -> None:
        """Drop complete shards that are not yet written; store the finished blocks of others."""
        self._dropped = True
        self._queue.put(None)
        drop([self._writing])
        self._thread.end()
        self._keep()
        self._open.clear()

    def _work(self) -> None:
        while (item := self._queue.get()) is not None and not self._dropped:
            self._write(*item)
            del item  # frees the memory of this shard before waiting for the next

    def _write(self, i: int, shard: MemorySink) -> None:
        """Write a shard in one pass and a fixed order: its bytes do not depend on the order of
        blocks, and writing takes half the time."""
        values, flagged = shard.values(), int(np.count_nonzero(shard.arrays["status"]))

        def named(file: str) -> str:
            path = self.directory.shard_path(i, flagged, file)
            if os.path.isdir(path) and not os.path.islink(path):
                raise FileError("a folder has its name; remove it", at="shard", value=i, file=path)
            return path

        path, attrs = self.directory.temporary(i), {"run": self.directory.mark}
        writer = Writer(path, shard.layout, shard.members, attrs, force=True, named=named)
        try:
            by_member = [name for name, v in writer.variables.items() if "member" in v.dims]
            first, count = shard.members.first, shard.members.size
            writer.write(first, count, {name: values[name] for name in by_member})
            writer.write_all({name: v for name, v in values.items() if name not in by_member})
            # The checkpoint goes last: a kill before that leaves both, and `drop_written` removes
            # it; a kill after an earlier deletion would lose the shard.
            self.directory.publish(writer.finish())
            self.keeper.drop([i])
        except BaseException:
            writer.discard()
            raise
