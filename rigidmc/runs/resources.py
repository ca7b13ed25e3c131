"""Resources that a run needs: threads, devices, blocks, memory and disk. A run that lacks memory or
disk is refused before its first step, instead of being killed in its last hour."""

import contextlib
import math
import os
import shutil
from typing import NamedTuple

from rigidmc.engine.cuda.devices import device_number, is_gpu, select_devices
from rigidmc.engine.kernel import layout
from rigidmc.engine.kernel.layout import BLOCK, LANES, whole_lanes
from rigidmc.errors import NoRoom
from rigidmc.files.outputs import Path
from rigidmc.inputs.amounts import count_text
from rigidmc.physics.integrators.rk4 import RK4
from rigidmc.results.layout import ResultLayout
from rigidmc.runs.settled import SettledRun

SLAB = 32 * 2**20  # bytes of saved values that a block may hold before they go to a file
# The same on GPUs. A GPU moves 50,000 members at once, limited by registers: a block is ten such
# waves, of which the last may be short.
DEVICE_BLOCK, DEVICE_SLAB = 2**19, 2**27
LEAST = 2**17  # member-steps by rk4 of a block: 1 ms at 130 M/s, plus 0.3 ms of overhead
PAGE = 512  # members whose row is a whole number of pages: rows compete for a cache set, see BLOCK
WAVE = 2**16  # members that take as long on a GPU as a single member
LITTLE = 2**26  # bytes; a smaller need does not justify 0.5 ms to query the free memory
BASE = 0.25e9  # interpreter, libraries and kernels [bytes]


def movers(threads: int, device: str) -> int:
    """Return how many threads or GPUs move members at once."""
    return len(select_devices(device_number(device))) if is_gpu(device) else threads


def moved_at_once(members: int, threads: int, device: str) -> float:
    """Return the number of members whose time a thread or GPU needs for its part of the run."""
    each = members / movers(threads, device)
    return max(WAVE, each) if is_gpu(device) else each


def block_of(run: SettledRun, threads: int, device: str, streaming: bool) -> int:
    """Choose the members of a block: few enough to occupy all threads, and fewer for a file.

    In memory, blocks are large enough for their steps to outlast their overhead. The blocks of a
    file are its chunks, whose bytes depend on the number of threads alone.
    """
    plan, members = run.plan, run.members.size
    blocks = (1 if plan.has_member_steps else 4) * threads
    if is_gpu(device):
        blocks = max(movers(threads, device), min(blocks, members // WAVE))
        block = min(DEVICE_BLOCK, whole_lanes(math.ceil(members / blocks)))
        # in memory, most saves are written directly to their final place
        slab = DEVICE_SLAB if streaming else 16 * DEVICE_SLAB
        return min(block, members_within(run.layout, slab))
    if streaming:
        block = min(BLOCK, whole_lanes(math.ceil(members / blocks)))
        return min(block, members_within(run.layout, SLAB))
    steps = plan.mean_steps * max(1.0, plan.kind.evaluations / RK4.evaluations)
    blocks = min(blocks, max(1, math.ceil(members * steps / LEAST)))
    most = BLOCK + 2 * LANES  # 4,096 members fit
    blocks = max(blocks, math.ceil(members / most))
    if blocks > threads:  # as many for each thread, so that none waits for the last block
        blocks = threads * math.ceil(blocks / threads)
    block = whole_lanes(math.ceil(members / blocks))
    return block + LANES if block % PAGE == 0 else block


def members_within(result: ResultLayout, slab: int) -> int:
    """Return how many members have saved values of about `slab` bytes."""
    values = 8 * max(result.numbers, result.axes.times.size * (1 + result.columns))
    return max(LANES, slab // values // LANES * LANES)


def block_of_shard(result: ResultLayout, shard: int) -> int:
    """Choose the members of a GPU block so that blocks divide a shard: all of it if they fit."""
    most = min(2 * DEVICE_BLOCK, members_within(result, DEVICE_SLAB))
    return shard if shard <= most else block_in(shard, most)


def block_in(shard: int, most: int) -> int:
    """Return the largest block of at most `most` members that divides a shard."""
    return LANES * max(n for n in range(1, most // LANES + 1) if shard % (LANES * n) == 0)


class Needs(NamedTuple):
    """Bytes that a run needs: memory with its result in memory, memory with its result in a file,
    and that file."""

    memory: int
    lean: int
    file: int


def needs(run: SettledRun, members: int, block: int, threads: int) -> Needs:
    """Compute the Needs of a run with a given number of members."""
    _, each = run.layout.bytes_of_a_member()
    rows = (layout.EFFECTS + 20 + run.plan.monitors.rows) * (1 + run.plan.columns)
    of_block = 8 * block * (rows + run.layout.numbers)
    scratch = of_block * (min(threads, -(-members // block)) + 2)
    return Needs(
        int(BASE + scratch + each * members),
        int(BASE + scratch),
        int((each + 8) * members + 20_000),
    )


def check_resources(
    run: SettledRun, members: int, block: int, threads: int, path: Path | None = None, more: int = 0
) -> None:
    """Raise NoRoom if a run with a given number of members needs more than the free memory or, with
    its result in `path`, more than the free disk there.

    more : additional bytes of memory, for shards
    """
    needed = needs(run, members, block, threads)
    asked = (needed.memory if path is None else needed.lean) - BASE + more
    if (free := short_of(asked)) is not None:
        cure = "keep fewer values (--keep final), save fewer observables, or run fewer members"
        if threads > 2 * (os.cpu_count() or 1):
            cure = f"use fewer than {threads:,} threads, {cure}"
        if path is None and needed.lean - BASE < free:
            room = f"{in_words(needed.lean)} of memory and {in_words(needed.file)} of disk"
            cure = f"write it to a file (-o FILE), which needs {room}, or {cure}"
        raise NoRoom(
            f"{count_text(members, 'member needs', 'members need')} {in_words(asked)} of memory,"
            f" of which {in_words(free)} are free: {cure}"
        )
    if path is not None:
        _refuse_full_disk(members, os.path.dirname(os.path.abspath(path)), needed.file)


def _refuse_full_disk(members: int, folder: str, size: int) -> None:
    free = shutil.disk_usage(folder).free
    if size > free:
        raise NoRoom(
            f"{count_text(members, 'member needs', 'members need')} {in_words(size)} of disk"
            f" in {folder},"
            f" of which {in_words(free)} are free: keep fewer values (--keep final),"
            " fewer digits (--set run.digits=6), or run fewer members"
        )


def refuse_count(count: int, what: str, each: float, cure: str = "use fewer") -> None:
    """Raise NoRoom if a number of things needs more memory than is free. Every study checks its
    counts with this before it starts.

    what : in words, such as "families";  each : bytes that one of them occupies until the end
    """
    needed = count * each
    if (free := short_of(needed)) is not None:
        raise NoRoom(
            f"{count:,} {what} need {in_words(needed)} of memory, of which {in_words(free)} are"
            f" free: {cure}"
        )


def short_of(needed: float) -> int | None:
    """Return the free memory if fewer than `needed` bytes are free, else None."""
    free = None if needed < LITTLE else free_memory()
    return free if free is not None and needed > free else None


def free_memory() -> int | None:
    """Return the memory that this process may still use [bytes]: the minimum of the free memory of
    the system and the allowance of its control groups; None if neither is known."""
    import psutil  # takes 7 ms, and small runs do not need it

    free = []
    with contextlib.suppress(OSError):  # Linux without /proc
        free.append(int(psutil.virtual_memory().available))
    return min([*free, *_free_in_groups()], default=None)


def _free_in_groups() -> list[int]:
    """Return the remaining allowance of each control group of this process [bytes], or [].

    psutil reports the memory of the whole machine. In a container or a batch job the control group
    has a lower limit, and Linux kills a process that exceeds it.
    """
    free = []
    with contextlib.suppress(OSError), open("/proc/self/cgroup") as file:
        for line in file:
            _, controllers, path = line.rstrip("\n").split(":", 2)
            if controllers == "":  # version 2
                cached = ("inactive_file", "active_file")
                free += _allowed("/sys/fs/cgroup", path, "memory.max", "memory.current", cached)
            elif "memory" in controllers.split(","):  # version 1
                root, limit = "/sys/fs/cgroup/memory", "memory.limit_in_bytes"
                cached = ("total_inactive_file", "total_active_file")
                free += _allowed(root, path, limit, "memory.usage_in_bytes", cached)
    return free


def _allowed(root: str, path: str, limit: str, used: str, cached: tuple[str, ...]) -> list[int]:
    """Return the remaining allowance of a control group and its parents [bytes]; cached files count
    as free."""
    free = []
    while True:
        folder = os.path.join(root, path.strip("/"))
        with contextlib.suppress(OSError, ValueError):  # int("max"): no limit
            most = int(_text(os.path.join(folder, limit)))
            now = int(_text(os.path.join(folder, used)))
            lines = _text(os.path.join(folder, "memory.stat")).splitlines()
            stat = dict(line.split() for line in lines)
            free.append(max(0, most - now + sum(int(stat.get(name, 0)) for name in cached)))
        if not path.strip("/"):
            return free
        path = os.path.dirname(path.rstrip("/"))


def _text(path: str) -> str:
    with open(path) as file:
        return file.read()


def in_words(size: float) -> str:
    """Write a number of bytes in GB or MB."""
    return f"{size / 1e9:.2f} GB" if size > 5e8 else f"{size / 1e6:.1f} MB"
