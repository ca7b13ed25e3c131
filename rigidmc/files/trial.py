"""A trial of netCDF files in a helper process.

The C library never finishes reading some damaged files (5 of 7,500 with flipped bits), and some
files claim more data than any machine holds. A file is refused if the helper crashes on it or needs
more than a second of computing.
"""

import atexit
import contextlib
import json
import math
import os
import signal
import subprocess
import sys
import threading

from rigidmc.errors import FileError
from rigidmc.files.helpers import start
from rigidmc.files.locks import lock
from rigidmc.files.opening import regular
from rigidmc.files.outputs import Path

if sys.platform != "win32":
    import resource

SECONDS = 1.0  # of computing, not of waiting for a disk; a file of ours takes 0.01
PATIENCE = 20.0  # seconds, waiting included: a link within a file may lead to a pipe
MEMORY = 2**30
PACKED = 1100  # zlib expands a byte to 1032 at most: no file holds more than PACKED times its size
MOST = 10_000  # variables
_lock = threading.Lock()
_helpers: list[subprocess.Popen[str]] = []


def refuse_unreadable(path: Path) -> None:
    """Raise FileError if a file is not netCDF, is damaged, or claims more data than it can hold.

    Only the helper opens it as netCDF. Errors of the system, such as missing rights, are raised as
    they are.
    """
    path = os.path.abspath(path)
    with open(path, "rb", opener=regular) as file:
        file.read(1)  # as long as it takes: an archive may bring the file from a tape
        with _lock:
            complaint = _verdict(path)
        if complaint:
            # without locks the library only says that something is wrong
            with contextlib.suppress(BlockingIOError):
                lock(file, path, shared=True)
    if complaint:
        raise FileError("", "file", None, complaint, file=path)


def _verdict(path: str) -> str:
    """The helper's complaint about a file, "" for none."""
    if not _helpers or _helpers[0].poll() is not None:
        _end()
        _helpers.append(start(__name__))
        atexit.register(_end)
        if _helpers[0].stdout is None or not _helpers[0].stdout.readline():
            _end()
            raise OSError(f"{path}: not opened, as the process that tries files does not start")
    helper = _helpers[0]
    assert helper.stdin is not None and helper.stdout is not None
    clock = threading.Timer(PATIENCE, helper.kill)
    clock.start()
    try:
        with contextlib.suppress(BrokenPipeError, ValueError):
            helper.stdin.write(json.dumps(path) + "\n")
            helper.stdin.flush()
            return str(json.loads(helper.stdout.readline()))
    finally:
        clock.cancel()
    _end()
    return "is damaged: the netCDF library does not survive it"


def _end() -> None:
    """End the helper."""
    while _helpers:
        helper = _helpers.pop()
        helper.kill()
        for pipe in (helper.stdin, helper.stdout):
            if pipe is not None:
                with contextlib.suppress(OSError):
                    pipe.close()
        helper.wait()


def main() -> None:
    """The helper: paths in, complaints out, one a line. A signal of the clock ends it if a file
    takes too long."""
    import netCDF4  # noqa: F401  (before memory is counted)

    _limit_memory()
    print(flush=True)  # it has started
    for line in sys.stdin:
        _limit_computing(SECONDS)
        words = complaint(json.loads(line))
        _limit_computing(0.0)
        print(json.dumps(words), flush=True)


def _limit_memory() -> None:
    """Let this process take MEMORY bytes more than it has; no limit if the system does not tell
    what it has."""
    if sys.platform != "win32":
        with contextlib.suppress(OSError, ValueError), open("/proc/self/statm") as file:
            pages = int(file.read().split()[0])
            most = pages * os.sysconf("SC_PAGE_SIZE") + MEMORY
            resource.setrlimit(resource.RLIMIT_AS, (most, resource.RLIM_INFINITY))


def _limit_computing(seconds: float) -> None:
    """Let this process end after so many seconds of computing; 0 for no limit."""
    if sys.platform != "win32":
        signal.signal(signal.SIGPROF, signal.SIG_DFL)
        signal.setitimer(signal.ITIMER_PROF, seconds)


def complaint(path: str) -> str:
    """Why a file must not be opened, in words; "" if it may be. Only header and attributes are
    read, no values."""
    import netCDF4
    import numpy as np

    try:
        with netCDF4.Dataset(path) as file:
            holds = PACKED * os.stat(path).st_size
            if len(file.variables) > MOST or len(file.dimensions) > MOST:
                return f"has more than {MOST:,} variables or dimensions"
            for name in file.ncattrs():
                file.getncattr(name)
            for name, variable in file.variables.items():
                for attribute in variable.ncattrs():
                    variable.getncattr(attribute)
                if len(set(variable.dimensions)) < len(variable.dimensions):
                    return f"{name} has a dimension twice"
                kind = variable.dtype
                if kind is not str and not (
                    isinstance(variable.datatype, np.dtype) and kind.kind in "iufS"
                ):
                    return f"{name} has a type of its own"
                each = 16 if kind is str else kind.itemsize
                pieces = variable.chunking()
                chunk = math.prod(pieces) if isinstance(pieces, list) else 0
                if each * max(math.prod(map(int, variable.shape)), chunk) > holds:
                    size = " x ".join(f"{n:,}" for n in variable.shape)
                    return f"{name} claims to be {size}, more than the file can hold"
    except Exception as error:  # the library raises whatever it likes
        return f"is damaged, or no netCDF file: {error}"
    return ""
