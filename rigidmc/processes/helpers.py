"""Other processes: helpers, which this package starts, and forks of a process with open files.

This package starts another Python only through `start_helper`. A helper imports nothing from the
working directory, which may hold a downloaded result next to a file netCDF4.py: it is isolated
(`python -I`), it imports from the folders of this process without the working directory, and it
runs in the folder of the package, because libraries read settings from their working directory
(Numba .numba_config.yaml, matplotlib matplotlibrc).

A fork shares the open files of its parent. The netCDF C library uses a kind of lock that belongs to
the open file: while any process has the file open, the lock stays and nobody, not even the
process that wrote it, can open the file again. A fork that exits normally also writes the library's
unwritten buffers into its parent's file. So a process removes its locks itself (`unlock_in_fork`),
and a fork gives up the files that its parent was writing (`let_go`).
"""

import contextlib
import os
import subprocess
import sys
from collections.abc import Iterable, Iterator
from typing import Any

PACKAGE = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
_PLACES = ("RIGIDMC_CACHE_DIR", "MPLCONFIGDIR", "MATPLOTLIBRC", "NUMBA_CACHE_DIR", "TMPDIR")


def can_start() -> bool:
    """Return whether a Python can start: programs that embed or freeze Python may have none."""
    name = os.path.basename(sys.executable or "").lower()
    return "python" in name and not hasattr(sys, "frozen")


def start_helper(module: str, answers: bool = True) -> "subprocess.Popen[str]":
    """Start a process that runs `main` of a module of this package and reads its stdin.

    answers : whether the caller reads its stdout
    """
    words = [sys.executable, "-I", "-B"] if sys.dont_write_bytecode else [sys.executable, "-I"]
    more: dict[str, Any] = {}
    if sys.platform == "win32":
        more["creationflags"] = subprocess.CREATE_NO_WINDOW
    return subprocess.Popen(
        [*words, os.path.join(PACKAGE, "files", "helper_main.py"), module, *folders()],
        cwd=PACKAGE,
        env=environment(),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE if answers else subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        text=True,
        **more,
    )


def folders() -> list[str]:
    """Return the folders that this process imports from, without the working directory.

    If the working directory holds the package, it comes last: modules installed there are found but
    shadow nothing.
    """
    here, home = _place(os.curdir), os.path.dirname(PACKAGE)
    outside = [path for path in sys.path if os.path.isabs(path) and _place(path) != here]
    return outside if home in outside else [*outside, home]


def environment() -> dict[str, str]:
    """Return the environment of a helper: the current one, without the variables that control
    Python, with absolute paths, and with a variable that keeps netCDF from reading .ncrc."""
    kept = {name: text for name, text in os.environ.items() if not name.startswith("PYTHON")}
    places = {name: os.path.abspath(kept[name]) for name in _PLACES if kept.get(name)}
    return {**kept, **places, "NCRCENV_IGNORE": "1"}


def _place(path: str) -> str:
    try:
        return os.path.realpath(path)
    except OSError:  # the working directory was deleted
        return path


if sys.platform != "win32":
    import fcntl

_DESCRIPTORS = "/dev/fd"  # lists this process's descriptors on Linux and macOS


def descriptors(paths: Iterable[str]) -> Iterator[int]:
    """Yield this process's descriptors of some files; none on systems without forks."""
    wanted = set[tuple[int, int]]()
    for path in paths:
        with contextlib.suppress(OSError):
            wanted.add(_identity(os.stat(path)))
    if not wanted:
        return
    with contextlib.suppress(OSError):
        for name in os.listdir(_DESCRIPTORS):
            with contextlib.suppress(OSError):  # the descriptor of the listing is already closed
                if _identity(os.fstat(int(name))) in wanted:
                    yield int(name)


def unlock_in_fork(path: str) -> None:
    """Unlock a file that this process has open, also for forks that have it open."""
    if sys.platform != "win32":
        for file in descriptors([path]):
            with contextlib.suppress(OSError):
                fcntl.flock(file, fcntl.LOCK_UN)


def let_go(files: Iterable[int]) -> None:
    """In a fork: redirect the descriptors of open files to the null device. Closing them would let
    another file take their numbers, and the netCDF library would write to that file."""
    nothing = os.open(os.devnull, os.O_RDWR)
    for file in files:
        os.dup2(nothing, file, inheritable=False)
    os.close(nothing)


def _identity(status: os.stat_result) -> tuple[int, int]:
    return status.st_dev, status.st_ino
