"""The memory and disk that a run needs, against what is free: a run without room is refused before
its first step, not killed in its last hour."""

import contextlib
import os
import shutil

from rigidmc.engine.kernel import layout
from rigidmc.errors import NoRoom
from rigidmc.files.outputs import Path
from rigidmc.planning.plan import Plan
from rigidmc.results.schema import bytes_of_a_member
from rigidmc.scene.scene import Scene

LITTLE = 2**26  # bytes; for less, asking for the free memory is not worth half a millisecond
BASE = 0.25e9  # interpreter, libraries and kernels [bytes]


def sizes(scene: Scene, plan: Plan, threads: int) -> tuple[int, int, int]:
    """Bytes that a run needs: (memory with its result in memory, memory with its result in a file,
    that file)."""
    _, each = bytes_of_a_member(scene, plan)
    block = _bytes_of_a_block(plan)
    scratch = block * (min(threads, -(-plan.members // plan.block)) + 2)
    return (
        int(BASE + scratch + each * plan.members),
        int(BASE + scratch),
        int((each + 8) * plan.members + 20_000),
    )


def _bytes_of_a_block(plan: Plan) -> int:
    saves = plan.times.size * plan.values
    return 8 * plan.block * (layout.EFFECTS + 20 + plan.watch.rows + saves)


def refuse_hopeless(
    scene: Scene, plan: Plan, threads: int, path: Path | None = None, more: int = 0
) -> None:
    """Raise NoRoom if a run needs more memory than is free or, with its result in `path`, more of
    that disk.

    more : further bytes of memory, for shards
    """
    memory, lean, file = sizes(scene, plan, threads)
    needed = (memory if path is None else lean) - BASE + more
    if (free := short_of(needed)) is not None:
        cure = "keep less of what is saved (--keep final), save less, or run fewer members"
        if threads > 2 * (os.cpu_count() or 1):
            cure = f"take fewer than {threads:,} threads, {cure}"
        if path is None and lean - BASE < free:
            room = f"{in_words(lean)} of memory and {in_words(file)} of disk"
            cure = f"write it to a file (-o FILE), which needs {room}, or {cure}"
        raise NoRoom(
            f"{plan.members:,} members need {in_words(needed)} of memory,"
            f" of which {in_words(free)} are free: {cure}"
        )
    if path is not None:
        _refuse_full_disk(plan, os.path.dirname(os.path.abspath(path)), file)


def _refuse_full_disk(plan: Plan, folder: str, size: int) -> None:
    free = shutil.disk_usage(folder).free
    if size > free:
        raise NoRoom(
            f"{plan.members:,} members need {in_words(size)} of disk in {folder},"
            f" of which {in_words(free)} are free: keep less of what is saved (--keep final),"
            " fewer digits (--set run.digits=6), or run fewer members"
        )


def refuse_count(count: int, what: str, each: float, cure: str = "take fewer") -> None:
    """Raise NoRoom if so many of something need more memory than is free: what every study asks of
    its counts before it begins.

    what : in words, such as "families";  each : bytes that one of them keeps until the end
    """
    needed = count * each
    if (free := short_of(needed)) is not None:
        raise NoRoom(
            f"{count:,} {what} need {in_words(needed)} of memory, of which {in_words(free)} are"
            f" free: {cure}"
        )


def short_of(needed: float) -> int | None:
    """The free memory if fewer than `needed` bytes are free, else None."""
    free = None if needed < LITTLE else free_memory()
    return free if free is not None and needed > free else None


def free_memory() -> int | None:
    """Bytes of memory that this process may still take: the least of what the system has and what
    its control groups allow; None if neither is known."""
    import psutil  # 7 ms, and small runs do not ask

    free = []
    with contextlib.suppress(OSError):  # Linux without /proc
        free.append(int(psutil.virtual_memory().available))
    return min([*free, *_free_in_groups()], default=None)


def _free_in_groups() -> list[int]:
    """What the control groups of this process still allow [bytes]; [] if there are none.

    psutil tells the memory of the whole machine. In a container or a batch job the control group is
    narrower, and Linux kills a process that goes beyond it.
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
    """What a control group and the groups above it still allow [bytes]; cached files make way."""
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
    """A number of bytes for people."""
    return f"{size / 1e9:.2f} GB" if size > 5e8 else f"{size / 1e6:.1f} MB"
