"""Forked processes: what they must not share with the process that they were forked from.

A fork has the open files of its origin. A lock of the kind that the C library of netCDF takes
belongs to the open file: it stays while any process has that open, and nobody, not even the process
that wrote the file, opens it again. A fork that ends in the ordinary way also writes what the
library still held, into the file of its origin. So a process takes its locks off itself, and a fork
lets go of the files that its origin was writing.
"""

import contextlib
import os
import sys
from collections.abc import Iterable, Iterator

if sys.platform != "win32":
    import fcntl

_DESCRIPTORS = "/dev/fd"  # of this process, on Linux and macOS


def descriptors(paths: Iterable[str]) -> Iterator[int]:
    """The descriptors by which this process has files open; none where no process is forked."""
    wanted = set[tuple[int, int]]()
    for path in paths:
        with contextlib.suppress(OSError):
            wanted.add(_identity(os.stat(path)))
    if not wanted:
        return
    with contextlib.suppress(OSError):
        for name in os.listdir(_DESCRIPTORS):
            with contextlib.suppress(OSError):  # that of the listing is closed again
                if _identity(os.fstat(int(name))) in wanted:
                    yield int(name)


def unlock(path: str) -> None:
    """Take the lock off a file that this process has open, for the forks that have it open too."""
    if sys.platform != "win32":
        for file in descriptors([path]):
            with contextlib.suppress(OSError):
                fcntl.flock(file, fcntl.LOCK_UN)


def let_go(files: Iterable[int]) -> None:
    """In a fork: put nothing in the place of open files, by their descriptors. They are not closed:
    another file would take their number, and the library of netCDF would write to that."""
    nothing = os.open(os.devnull, os.O_RDWR)
    for file in files:
        os.dup2(nothing, file, inheritable=False)
    os.close(nothing)


def _identity(found: os.stat_result) -> tuple[int, int]:
    return found.st_dev, found.st_ino
