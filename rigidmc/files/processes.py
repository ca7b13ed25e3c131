"""Other processes: helpers, which this package starts, and forks of a process that has files open.

`start_helper` is the one way in which this package starts another Python. A helper imports nothing
from the working directory, which may hold a downloaded result beside a file netCDF4.py: it is
isolated (`python -I`), its folders of modules are those of this process without the working
directory, and it works in the folder of the package, because libraries look for settings where they
are (Numba for .numba_config.yaml, matplotlib for matplotlibrc).

A fork has the open files of its origin. A lock of the kind that the C library of netCDF takes
belongs to the open file: it stays while any process has that open, and nobody, not even the process
that wrote the file, opens it again. A fork that ends in the ordinary way also writes what the
library still held, into the file of its origin. So a process takes its locks off itself
(`unlock_in_fork`), and a fork lets go of the files that its origin was writing (`let_go`).
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
    """Whether there is a Python to start: programs that embed or freeze one may have none."""
    name = os.path.basename(sys.executable or "").lower()
    return "python" in name and not hasattr(sys, "frozen")


def start_helper(module: str, answers: bool = True) -> "subprocess.Popen[str]":
    """A process that runs `main` of a module of this package; it is written to through its stdin.

    answers : whether its stdout is read
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
    """The folders that this process imports from, without the working directory.

    The folder that holds the package comes last if it is the working directory: what is installed
    there is found, and shadows nothing.
    """
    here, home = _place(os.curdir), os.path.dirname(PACKAGE)
    known = [path for path in sys.path if os.path.isabs(path) and _place(path) != here]
    return known if home in known else [*known, home]


def environment() -> dict[str, str]:
    """The environment of a helper: this one, without the variables that steer Python, and with
    places that do not depend on where the helper works. netCDF reads no .ncrc there."""
    known = {name: text for name, text in os.environ.items() if not name.startswith("PYTHON")}
    places = {name: os.path.abspath(known[name]) for name in _PLACES if known.get(name)}
    return {**known, **places, "NCRCENV_IGNORE": "1"}


def _place(path: str) -> str:
    try:
        return os.path.realpath(path)
    except OSError:  # the working directory was deleted
        return path


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


def unlock_in_fork(path: str) -> None:
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
