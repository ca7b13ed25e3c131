"""A trial of netCDF files in a helper process. The C library never finishes reading some damaged files (5 of 7,500 with flipped
bits), and some claim more data than any machine holds. A file is refused if the helper crashes on it or needs more than a second of
computing."""

import atexit
import contextlib
import fcntl
import json
import math
import os
import resource
import signal
import subprocess
import sys
import threading

from rigidmc.errors import SceneError
from rigidmc.files.outputs import lock
from rigidmc.files.reading import refuse_irregular

SECONDS = 1.0  # of computing, not of waiting for a disk; a file of ours takes 0.01
MEMORY = 2**30
PACKED = 1100  # zlib expands a byte to 1032 at most: no file holds more than PACKED times its size
MOST = 10_000  # variables
_lock = threading.Lock()
_helpers: list[subprocess.Popen] = []


def refuse_unreadable(path):
    """SceneError if a file is not netCDF, is damaged, or claims more data than it can hold. Only the helper opens it as netCDF."""
    path = os.path.abspath(path)
    refuse_irregular(path)
    with open(
        path, "rb"
    ) as file:  # errors of the system, such as missing rights, are raised as they are
        with _lock:
            complaint = _told(path)
        if complaint:
            with contextlib.suppress(BlockingIOError):
                lock(
                    file, path, fcntl.LOCK_SH
                )  # without locks the library only says that something is wrong
    if complaint:
        raise SceneError("", "file", None, complaint, file=path)


def _told(path):
    """The helper's complaint about a file, "" for none."""
    if not _helpers or _helpers[0].poll() is not None:
        _end()
        words = [sys.executable, "-c", "from rigidmc.files.trial import main; main()"]
        _helpers.append(
            subprocess.Popen(
                words,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                text=True,
            )
        )
        atexit.register(_end)
    helper = _helpers[0]
    assert helper.stdin is not None and helper.stdout is not None
    with contextlib.suppress(BrokenPipeError, ValueError):
        helper.stdin.write(json.dumps(path) + "\n")
        helper.stdin.flush()
        return json.loads(helper.stdout.readline())
    _end()
    return "is damaged: the netCDF library does not survive it"


def _end():
    """Let the helper go."""
    while _helpers:
        helper = _helpers.pop()
        helper.kill()
        for pipe in (helper.stdin, helper.stdout):
            with contextlib.suppress(OSError):
                pipe.close()  # type: ignore[union-attr]
        helper.wait()


def main():
    """The helper: paths in, complaints out, a line each. The clock of its computing ends it where a file takes too long."""
    import netCDF4  # noqa: F401  (before memory is counted)

    with contextlib.suppress(OSError, ValueError), open("/proc/self/statm") as file:
        pages = int(file.read().split()[0])
        resource.setrlimit(
            resource.RLIMIT_AS,
            (pages * os.sysconf("SC_PAGE_SIZE") + MEMORY, resource.RLIM_INFINITY),
        )
    signal.signal(signal.SIGPROF, signal.SIG_DFL)
    for line in sys.stdin:
        signal.setitimer(signal.ITIMER_PROF, SECONDS)
        found = complaint(json.loads(line))
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        print(json.dumps(found), flush=True)


def complaint(path):
    """Why a file must not be opened, in words; "" if it may be. Only header and attributes are read, no values."""
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
                    return f"{name} claims to be {' x '.join(f'{n:,}' for n in variable.shape)}, more than the file can hold"
    except Exception as error:  # the library raises whatever it likes
        return f"is damaged, or no netCDF file: {error}"
    return ""
