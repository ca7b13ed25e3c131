"""Checkpoints of unfinished shards in a run directory: the states of blocks in progress, and the
results of finished blocks; each a file of arrays.

Both are written every EVERY seconds, and when a run is stopped, so that a kill loses half a minute
of each thread. Results do not depend on them: a block continues from a state to the same bits.
Checkpoints that are damaged, or of another run or version, are ignored. A shard's checkpoints are
deleted when the shard is written.
"""

import contextlib
import hashlib
import json
import math
import os
import re
import time
from collections.abc import Collection, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigidmc.engine.machine import this_machine
from rigidmc.errors import FileError
from rigidmc.files.outputs import Path, write_bytes
from rigidmc.files.reading import bytes_of, json_of
from rigidmc.results.layout import ResultLayout
from rigidmc.results.sinks import MemorySink
from rigidmc.runs.blocks import BlockJob
from rigidmc.runs.directory.folder import RunDirectory

EVERY = 20.0  # seconds between two checkpoints of a block or of a shard
# so checkpoints take at most 5 % of the time, however slow the disk is
COSTS = 20.0  # least time of the run between checkpoints, in units of a checkpoint's own time
_NAMES = re.compile(r"([0-9]{8})(-[0-9]{1,16})?")  # a shard, and the place of a block in it


class Checkpoints:
    """The checkpoints of a run, a Keeper of `rigidmc.engine.threads` for its blocks.

    directory : whose lock this process holds;  layout : of the whole run
    """

    def __init__(self, directory: RunDirectory, layout: ResultLayout, block: int) -> None:
        self.directory, self._folder = directory, directory.unfinished
        # another version may have other rows in a block
        versions, _ = this_machine("scipy")
        about = [directory.mark, versions, block, layout.facts, layout.axes.times.size]
        self._key = hashlib.sha256(json.dumps(about).encode()).hexdigest()
        self._due, self._size = dict[str, float](), block

    def is_due(self, job: BlockJob) -> bool:
        """Return whether the state of a block is due to be stored again."""
        return self._is_due(self._block(job))

    def keep(self, job: BlockJob) -> None:
        """Store the state of a block after the steps that it has made, and its values saved so
        far."""
        done = job.steps.first
        out = job.out[: _saved(job, done)]
        state = {"done": np.array(done), "block": job.block, "out": out}
        self._write(self._block(job), self._key_of(job), state)

    def resumed(self, job: BlockJob) -> BlockJob:
        """Return a block continued from its checkpoint, or the block itself if there is none."""
        name = self._block(job)
        self._due.setdefault(name, time.monotonic() + EVERY)
        most = job.block.nbytes + job.out.nbytes
        state = read_checkpoint(os.path.join(self._folder, name), self._key_of(job), most)
        if state is None or not _fits(job, state):
            return job
        job.block[...], out = state["block"], state["out"]
        job.out[: out.size] = out
        return job.after(int(state["done"]))

    def _key_of(self, job: BlockJob) -> str:
        run = job.steps
        steps = run.h, run.slots, run.stride, run.total, run.head, run.last_h
        return f"{self._key} {job.first} {job.size} {job.block.shape} {job.out.size} {steps}"

    def keep_shard(
        self, i: int, shard: MemorySink, there: Collection[int], called_off: bool
    ) -> None:
        """Store the results of a shard's finished blocks, if that is due.

        there : places of the first members of these blocks
        """
        name = f"{i:08d}"
        if there and (called_off or self._is_due(name)):
            blocks = np.array(sorted(there), np.int64)
            self._write(name, self._key_of_shard(shard), {"blocks": blocks, **shard.part()})

    def fill(self, i: int, shard: MemorySink) -> set[int]:
        """Load the results of finished blocks into a shard; return the places of these blocks."""
        name = f"{i:08d}"
        self._due.setdefault(name, time.monotonic() + EVERY)
        path = os.path.join(self._folder, name)
        part = read_checkpoint(path, self._key_of_shard(shard), shard.largest())
        first, count = shard.members.first, shard.members.size
        places = range(first, first + count, self._size)
        blocks = [] if part is None else part.get("blocks", np.empty(0)).tolist()
        some = 0 < len(blocks) < len(places) and all(place in places for place in blocks)
        if part is None or not some or not shard.fill(part):
            return set()
        return set(blocks)

    def _key_of_shard(self, shard: MemorySink) -> str:
        return f"{self._key} {shard.members.first} {shard.members.size}"

    def drop_written(self) -> None:
        """Delete the checkpoints of shards that were written before a kill. Without checkpoints the
        shards are not listed, because each task of a cluster would list all of them."""
        with contextlib.suppress(OSError):
            if os.listdir(self._folder):
                self.drop(self.directory.shards().keys())

    def drop(self, shards: Collection[int]) -> None:
        """Delete the checkpoints of shards that are written."""
        with contextlib.suppress(OSError), os.scandir(self._folder) as entries:
            for entry in entries:
                name = _NAMES.fullmatch(entry.name)
                if name and int(name[1]) in shards:
                    with contextlib.suppress(OSError):
                        os.unlink(entry.path)

    def end(self) -> None:
        """Delete the folder if it is empty."""
        with contextlib.suppress(OSError):
            os.rmdir(self._folder)

    def _block(self, job: BlockJob) -> str:
        facts = self.directory.facts
        return f"{(job.first - facts['first']) // facts['shard']:08d}-{job.first}"

    def _is_due(self, name: str) -> bool:
        return time.monotonic() >= self._due.setdefault(name, time.monotonic() + EVERY)

    def _write(self, name: str, key: str, arrays: dict[str, NDArray[Any]]) -> None:
        if self.directory.store is not None:  # nobody would find it: the folder here is temporary
            self._due[name] = math.inf
            return
        began = time.monotonic()
        write_checkpoint(os.path.join(self._folder, name), key, arrays)
        now = time.monotonic()
        self._due[name] = now + max(EVERY, COSTS * (now - began))


def _saved(job: BlockJob, done: int) -> int:
    """Return how many values a block has saved after `done` steps."""
    return job.steps.saves_until(done) * (job.out.size // job.steps.saves_until(job.steps.total))


def _fits(job: BlockJob, state: Mapping[str, NDArray[Any]]) -> bool:
    """Return whether arrays are a valid state of a block, because compiled code trusts them."""
    done = state.get("done", np.array(0))
    if state.keys() != {"done", "block", "out"} or done.shape != () or done.dtype.kind != "i":
        return False
    shapes = job.block.shape, (_saved(job, int(done)),)
    numbers = {job.block.dtype, job.out.dtype} == {state["block"].dtype, state["out"].dtype}
    there = state["block"].shape, state["out"].shape
    return 0 < int(done) < job.steps.total and numbers and shapes == there


Arrays = Mapping[str, NDArray[Any]]
_MAGIC = b"rigidmc checkpoint 1\n"
_SUM = 32  # bytes of a sha256
_KINDS = "biuf"


def write_checkpoint(path: Path, key: str, arrays: Arrays) -> bool:
    """Write {name: array}, replacing an existing file; False on failure: a run continues without.

    key : identifies the run and the state in the arrays
    """
    about = [[name, array.dtype.str, array.shape] for name, array in arrays.items()]
    header = json.dumps({"key": key, "arrays": about}).encode() + b"\n"
    parts = [_MAGIC, header, *(np.ascontiguousarray(array).tobytes() for array in arrays.values())]
    data = b"".join(parts)
    with contextlib.suppress(OSError):
        os.makedirs(os.path.dirname(path), exist_ok=True)
        write_bytes(path, data + hashlib.sha256(data).digest(), force=True)
        return True
    return False


def read_checkpoint(path: Path, key: str, most: int) -> dict[str, NDArray[Any]] | None:
    """Read the arrays of a checkpoint; None unless it exists, is complete and has this key.

    most : largest number of bytes of the arrays; a larger file is not read
    """
    try:
        data = memoryview(bytes_of(path, most + 10_000))
    except (OSError, FileError):
        return None
    # a kill may leave half a file: without the checksum, compiled code would go on from any numbers
    body, told = data[: -_SUM or None], bytes(data[-_SUM:])
    if hashlib.sha256(body).digest() != told or bytes(body[: len(_MAGIC)]) != _MAGIC:
        return None
    at = bytes(body).find(b"\n", len(_MAGIC)) + 1
    try:
        about = json_of(bytes(body[len(_MAGIC) : at]).decode())
        if about["key"] != key:
            return None
        return _arrays(body[at:], about["arrays"])
    except (ValueError, TypeError, KeyError, OverflowError):  # a checksum proves no author
        return None


def _arrays(data: memoryview, about: list[Any]) -> dict[str, NDArray[Any]]:
    """Read consecutive arrays from memory; ValueError if they do not fit."""
    arrays, at = dict[str, NDArray[Any]](), 0
    for name, kind, shape in about:
        dtype, sizes = np.dtype(str(kind)), [int(size) for size in shape]
        if dtype.kind not in _KINDS or min(sizes, default=0) < 0:
            raise ValueError(kind)
        count = math.prod(sizes)
        if at + count * dtype.itemsize > len(data):
            raise ValueError(name)
        arrays[str(name)] = np.frombuffer(data, dtype, count, at).reshape(sizes)
        at += count * dtype.itemsize
    return arrays
