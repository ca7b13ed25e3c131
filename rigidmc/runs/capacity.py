"""What a run needs of memory and disk, against what is free: it is refused before the first step, not killed in the last hour."""

import contextlib
import os
import shutil

from rigidmc.engine import layout
from rigidmc.errors import NoRoom
from rigidmc.observables import rows_of
from rigidmc.storage.schema import bytes_of_a_member

LITTLE = 2**26  # bytes that are not worth half a millisecond of asking
BASE = 0.25e9  # interpreter, libraries and kernels [bytes]


def sizes(scene, plan, threads):
    """Bytes that a run needs: (of memory with its result there, of memory with its result in files, of a file of it)."""
    _, each = bytes_of_a_member(scene, plan)
    block = _bytes_of_a_block(scene, plan)
    scratch = block * (min(threads, -(-plan.members // plan.block)) + 2)
    return (
        int(BASE + scratch + each * plan.members),
        int(BASE + scratch),
        int((each + 8) * plan.members + 20_000),
    )


def _bytes_of_a_block(scene, plan):
    saves = plan.times.size * rows_of(scene.effects, *scene.recorded())
    return 8 * plan.block * (layout.EFFECTS + 20 + plan.watch.rows + saves)


def refuse_hopeless(scene, plan, threads, path=None, more=0):
    """Raise NoRoom where a run needs more memory than is free or, with its result in `path`, more of that disk.

    more : bytes of memory that it needs besides, for its shards
    """
    memory, lean, file = sizes(scene, plan, threads)
    needed = (memory if path is None else lean) - BASE + more
    free = None if needed < LITTLE else free_memory()
    if free is not None and needed > free:
        ways = "keep less of what is saved (--keep final), save less, or run fewer members"
        ways = (
            f"take fewer than {threads:,} threads, {ways}"
            if threads > 2 * (os.cpu_count() or 1)
            else ways
        )
        ways = (
            f"write it to a file (-o FILE), which needs {in_words(lean)} of memory and {in_words(file)} of disk, or {ways}"
            if path is None and lean - BASE < free
            else ways
        )
        raise NoRoom(
            f"{plan.members:,} members need {in_words(needed)} of memory, of which {in_words(free)} are free: {ways}"
        )
    if path is not None:
        folder = os.path.dirname(os.path.abspath(path))
        free = shutil.disk_usage(folder).free
        if file > free:
            ways = "keep less of what is saved (--keep final), fewer digits (--set run.digits=6), or run fewer members"
            raise NoRoom(
                f"{plan.members:,} members need {in_words(file)} of disk in {folder}, of which {in_words(free)} are free: {ways}"
            )


def free_memory():
    """Bytes of memory that this process may still take: the least of what the system has and of what its control groups allow; None where
    that is not told."""
    found = []
    with contextlib.suppress(OSError, ValueError, IndexError), open("/proc/meminfo") as file:
        found += [1024 * int(line.split()[1]) for line in file if line.startswith("MemAvailable:")]
    with contextlib.suppress(OSError), open("/proc/self/cgroup") as file:
        for line in file:
            _, kinds, path = line.rstrip("\n").split(":", 2)
            if kinds == "":
                found += _allowed(
                    "/sys/fs/cgroup",
                    path,
                    "memory.max",
                    "memory.current",
                    ("inactive_file", "active_file"),
                )
            elif "memory" in kinds.split(","):
                found += _allowed(
                    "/sys/fs/cgroup/memory",
                    path,
                    "memory.limit_in_bytes",
                    "memory.usage_in_bytes",
                    ("total_inactive_file", "total_active_file"),
                )
    return min(found, default=None)


def _allowed(root, path, limit, used, cached):
    """What a control group and those above it still allow [bytes]; files that are cached make way."""
    found = []
    while True:
        folder = os.path.join(root, path.strip("/"))
        with contextlib.suppress(OSError, ValueError):
            most, now = (
                int(_text(os.path.join(folder, name))) for name in (limit, used)
            )  # "max" is no number: no limit
            stat = dict(
                line.split() for line in _text(os.path.join(folder, "memory.stat")).splitlines()
            )
            found.append(max(0, most - now + sum(int(stat.get(name, 0)) for name in cached)))
        if not path.strip("/"):
            return found
        path = os.path.dirname(path.rstrip("/"))


def _text(path):
    with open(path) as file:
        return file.read()


def in_words(size):
    """A number of bytes for people."""
    return f"{size / 1e9:.2f} GB" if size > 5e8 else f"{size / 1e6:.1f} MB"
