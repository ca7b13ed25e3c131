"""Blocks of members on GPUs, one thread per member, see `rigidmc.engine.cuda.ptx`.

A block stays on the GPU from the first step of a run to the last. Launches are short, so progress
is shown and a run can be stopped between them. Each worker thread has its own stream: while one
copies saves or prepares the next block, another's members move.
"""

import itertools
import math
import os
import threading
import time
from collections.abc import Generator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigidmc.engine.compiler.kernels import config
from rigidmc.engine.cuda.devices import (
    TARGETS,
    CudaStream,
    Device,
    Module,
    call_driver,
    select_devices,
)
from rigidmc.engine.cuda.ptx import THREAD, ptx_of
from rigidmc.engine.kernel.arguments import NoiseKeys, SaveTarget, StepRange
from rigidmc.engine.linked import KERNEL, LinkedProgram
from rigidmc.engine.program import NO_NOISE, NO_SAVES, fill_record
from rigidmc.errors import NoDevice, NoRoom

Array = NDArray[Any]
# Seconds per launch: heavy rk4 makes 74.1 G steps/s on an H200; 71.6 with 0.01 s, 74.7 with 0.2 s
LAUNCH = 0.05
# Steps of the first launch of a block, and the largest ratio of steps from one launch to the next.
# The time of each launch decides the length of the next.
FIRST, GROWTH = 16, 8.0
SAVED = 64 * 2**20  # most bytes of saved values of a block on the GPU


class CudaProgram(LinkedProgram):
    """A LinkedProgram whose members move on GPUs; `advance` and `through` as in Program.

    number : of the GPU; None for all of them, which take blocks in turn
    """

    def __init__(self, *arguments: Any, number: int | None = None, **named: Any) -> None:
        if config.DISABLE_JIT:
            raise NoDevice("cuda: requires compiled code, but NUMBA_DISABLE_JIT is set")
        self.devices = select_devices(number)
        first = os.getpid() % len(self.devices)  # concurrent processes begin with different GPUs
        self._turn = itertools.cycle(self.devices[first:] + self.devices[:first])
        self._streams = threading.local()
        self._loading, self._modules = threading.Lock(), dict[Device, Module]()
        least = min(device.capability for device in self.devices)
        self.target = "{}.{}".format(*max(version for version in TARGETS if version <= least))
        super().__init__(*arguments, **{**named, "lanes": 1})

    def make_code(self, target: str) -> str:
        """Return the PTX for GPUs of a compute capability or a later one."""
        major, minor = map(int, target.split("."))
        return ptx_of(self.linked(THREAD), (major, minor))

    def places(self, threads: int) -> tuple[str, str]:
        """Return words for one GPU, and for all of them with their resident threads."""
        stream, (first, *others) = self._stream(), self.devices
        each = f"{first.name} x {1 + len(others)}" if others else first.name
        resident = f"{stream.module.resident} resident per multiprocessor"
        words = f"{each}, blocks of {stream.module.threads} threads, {resident}"
        return "one GPU", words

    def workers(self, threads: int, blocks: int, members: int, saves: int) -> int:
        """Do the same as `Program.workers`; return at least one thread per GPU."""
        threads = max(threads, len(self.devices))
        blocks = min(threads, blocks)  # at once
        count = self.saved_values * members
        rows = self.rows * self.copies
        each = 8 * (rows * members + count + min(count * saves, max(count, SAVED // 8)))
        need = each * -(-blocks // len(self.devices))
        with self._stream().module.entered():
            free, _ = call_driver("cuMemGetInfo")
        if need > free:
            rule = f"need {need / 1e9:.3g} GB, but {free / 1e9:.3g} GB are free"
            ways = "use smaller blocks or fewer threads"
            raise NoRoom(f"cuda: {blocks} blocks of {members:,} members at once {rule}; {ways}")
        return threads

    def _stream(self) -> CudaStream:
        """Return the stream of this thread."""
        if not hasattr(self._streams, "mine"):
            with self._loading:
                device = next(self._turn)
                if device not in self._modules:
                    self._modules[device] = self._load(device)
            self._streams.mine = CudaStream(self._modules[device])
        stream: CudaStream = self._streams.mine
        return stream

    def _load(self, device: Device) -> Module:
        """Load the code and the numbers of the kernels and substeps on a GPU."""
        return Module(device, self.code, KERNEL, [*self.kernel_numbers(), self.substeps])

    def advance(
        self,
        block: Array,
        steps: StepRange,
        noise: NoiseKeys | None = None,
        saves: SaveTarget | None = None,
    ) -> None:
        """Do the same as `Program.advance`."""
        noise = noise or NO_NOISE._replace(members=np.arange(block.shape[1]))
        for _ in self.through(block, steps, noise, saves or NO_SAVES):
            pass

    def through(
        self, block: Array, steps: StepRange, noise: NoiseKeys, saves: SaveTarget
    ) -> Generator[int, bool | None, None]:
        """Do the same as `Program.through`."""
        stream = self._stream()
        with stream.module.entered():
            try:
                yield from self._through(stream, block, steps, noise, saves)
            finally:
                stream.free()

    def _through(
        self,
        stream: CudaStream,
        block: Array,
        steps: StepRange,
        noise: NoiseKeys,
        saves: SaveTarget,
    ) -> Generator[int, bool | None, None]:
        members = block.shape[1]
        count = self.saved_values * members if saves.columns else 0  # numbers of a save
        max_saves = min(steps.saves_until(steps.total) - 1, max(1, SAVED // (8 * count or 1)))
        *kernels, substeps = stream.module.numbers
        frame, block_at = self.frame_for(stream.put, block, noise, kernels, substeps)
        order, frame_at = stream.put(saves.order), stream.room(frame.nbytes)
        listed = stream.put(steps.save_steps) if steps.save_count else 0
        cuts = stream.put(steps.cuts)
        values = stream.room(8 * count * (max_saves + 1))  # the start is an extra save
        first, length = steps.first, FIRST
        while first < steps.last:
            next_full = steps.step_of_save(steps.saves_until(first) - 1 + max_saves)
            last = min(steps.last, steps.whole(first + length), next_full)
            slots = range(steps.saves_until(first) if first else 0, steps.saves_until(last))
            # Kernels count saves from the start of the run; the memory begins with the first save
            # of this launch.
            out = SaveTarget(values - 8 * count * slots.start, members if count else 0, 0, order)
            part = steps._replace(first=first, last=last, save_steps=listed, cuts=cuts)
            stream.write(frame_at, fill_record(frame, part, out))
            started = time.perf_counter()
            stream.launch(frame_at, members)
            stream.wait()
            elapsed = time.perf_counter() - started
            if count and slots:
                self._keep(stream, values, slots, saves, members)
            while (yield last):
                stream.read(block, block_at)
            length = int(max(1.0, (last - first) * min(GROWTH, LAUNCH / max(elapsed, 1e-6))))
            first = last
        stream.read(block, block_at)

    def _keep(
        self, stream: CudaStream, values: int, slots: range, saves: SaveTarget, members: int
    ) -> None:
        """Copy the saves of a launch from the GPU to their destination."""
        shape = len(slots), self.saved_values, members
        got = stream.pinned(math.prod(shape))
        stream.read(got, values)
        size = self.saved_values * saves.columns
        out = saves.out.reshape(-1)[size * slots.start : size * slots.stop]
        wide = out.reshape(*shape[:2], saves.columns)
        wide[:, :, saves.column : saves.column + members] = got.reshape(shape)
