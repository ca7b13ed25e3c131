"""Trial reading of netCDF files and meshes in a helper process.

The C library never finishes reading some files with flipped bits, and some files claim more data
than any machine holds. A file is refused if the helper crashes on it or needs more than a second of
CPU time.
"""

import atexit
import contextlib
import faulthandler
import gc
import itertools
import json
import math
import os
import signal
import subprocess
import sys
import threading

from rigidmc.errors import FileError
from rigidmc.files.locks import lock
from rigidmc.files.opening import data_bytes_at, open_regular, refuse_unnamed
from rigidmc.files.outputs import Path
from rigidmc.files.reading import load_mesh
from rigidmc.processes.helpers import start_helper

if sys.platform != "win32":
    import resource

MESH_BYTES = 30  # memory per byte of a mesh; measured 8 for OBJ, 20 for OFF
MESH_SPEED = 1e6  # bytes/s required, of 5e6 measured
SECONDS = 1.0  # of CPU time, without waiting for a disk; our own files take 0.01
PATIENCE = 20.0  # seconds, including waiting: a link within a file may lead to a pipe
MEMORY = 3 * 2**28
PACKED = 1100  # zlib expands a byte to at most 1032: no file holds more than PACKED times its size
MOST = 10_000  # variables
_KEPT = 10_000  # accepted files to remember: shards are read several times
Helper = subprocess.Popen[str]
_sound: dict[tuple[str | int, ...], None] = {}
_lock = threading.Lock()
_idle: list[Helper] = []  # at most one
_of_parents: list[Helper] = []
_numbers = itertools.count()


def refuse_unreadable(path: Path, kind: str = "netCDF") -> None:
    """Raise FileError if a file is not of its kind, netCDF or mesh, is damaged, or claims more data
    than it can hold.

    Only the helper parses the file. System errors, such as missing permissions, pass unchanged.
    """
    path = os.path.abspath(path)
    refuse_unnamed(path)
    with open(path, "rb", opener=open_regular) as file:
        facts = os.fstat(file.fileno())
        state = (kind, path, facts.st_dev, facts.st_ino, facts.st_size, facts.st_mtime_ns)
        if state in _sound:
            return
        file.read(1)  # without a time limit: an archive may load the file from tape
        with _lock:
            complaint = _verdict(kind, path)
        if not complaint:
            _sound[state] = None
            while len(_sound) > _KEPT:
                _sound.pop(next(iter(_sound)), None)
        if complaint:
            # without locks the library reports only an unspecific error
            with contextlib.suppress(BlockingIOError):
                lock(file, path, shared=True)
    if complaint:
        raise FileError(complaint, at="file", file=path)


def _verdict(kind: str, path: str) -> str:
    """Return the helper's complaint about a file, "" if it has none.

    A helper is idle only after it has answered its question. Whatever interrupts the wait, the next
    file goes to another helper: the answer in the pipe belongs to the previous file.
    """
    while _idle and _idle[0].poll() is not None:
        _end(_idle.pop())
    is_new, words = not _idle, None
    helper = start_helper(__name__) if is_new else _idle.pop()
    try:
        if is_new and not _line(helper):
            rule = "not opened: the helper process that tests files does not start"
            raise OSError(f"{path}: {rule}")
        words = _answer(helper, kind, path)
    finally:
        if words is None:
            _end(helper)
    if words is None:
        return f"is damaged: the reader of {kind} files crashes on it or takes too long"
    _idle.append(helper)
    return words


def _line(helper: Helper) -> str:
    """Return the next line of a helper, "" if it ends without one."""
    assert helper.stdout is not None
    return helper.stdout.readline()


def _answer(helper: Helper, kind: str, path: str) -> str | None:
    """Return a helper's complaint about a file, None if the helper ends without an answer."""
    assert helper.stdin is not None
    question = [next(_numbers), kind, path]
    with contextlib.suppress(BrokenPipeError):
        helper.stdin.write(json.dumps(question) + "\n")
        helper.stdin.flush()
    line = _line(helper)
    if not line.endswith("\n"):
        return None
    answered, words = json.loads(line)
    if answered != question:
        raise OSError(f"{path}: not opened: the helper process that tests files is out of step")
    return str(words)


def _end(helper: Helper) -> None:
    """End a helper."""
    helper.kill()
    for pipe in (helper.stdin, helper.stdout):
        if pipe is not None:
            with contextlib.suppress(OSError):
                pipe.close()
    helper.wait()


@atexit.register
def _end_all() -> None:
    while _idle:
        _end(_idle.pop())


def _forked() -> None:
    """In a fork: leave the helpers, and a lock that another thread holds, to the parent process."""
    global _lock
    _lock = threading.Lock()
    _of_parents.extend(_idle)  # dropping one would warn that it still runs
    _idle.clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forked)


def main() -> None:
    """Run the helper: read questions, write them with complaints, one per line. Timers end it if a
    file takes too long."""
    import netCDF4  # noqa: F401  (before memory is counted)

    print(flush=True)  # report the start
    for line in sys.stdin:
        question = json.loads(line)
        _, kind, path = question
        size = os.stat(path).st_size
        if kind == "mesh":
            import trimesh.exchange.load  # noqa: F401  (before memory and time are counted)
        _limit_memory(MEMORY + (MESH_BYTES * size if kind == "mesh" else 0))
        more = size / MESH_SPEED if kind == "mesh" else 0.0
        _limit_computing(SECONDS + more)
        # here, not in the process that waits: a signal that interrupts its start leaves a
        # threading.Timer that keeps Python from ending
        faulthandler.dump_traceback_later(PATIENCE + more, exit=True)
        words = complaint(path) if kind == "netCDF" else _mesh_complaint(path)
        _limit_computing(0.0)
        faulthandler.cancel_dump_traceback_later()
        print(json.dumps([question, words]), flush=True)


def _limit_memory(more: int) -> None:
    """Limit this process to `more` bytes beyond its present memory; no limit if the system does not
    report its present memory."""
    if sys.platform != "win32":
        with contextlib.suppress(OSError, ValueError), open("/proc/self/statm") as file:
            pages = int(file.read().split()[0])
            most = pages * os.sysconf("SC_PAGE_SIZE") + more
            resource.setrlimit(resource.RLIMIT_AS, (most, resource.RLIM_INFINITY))


def _limit_computing(seconds: float) -> None:
    """End this process after `seconds` of CPU time; 0 for no limit."""
    if sys.platform != "win32":
        signal.signal(signal.SIGPROF, signal.SIG_DFL)
        signal.setitimer(signal.ITIMER_PROF, seconds)


def complaint(path: str) -> str:
    """Return why a file must not be opened; "" if it may be. Only the header and attributes are
    read, not the values."""
    import netCDF4
    import numpy as np

    try:
        with netCDF4.Dataset(path) as file:
            holds = PACKED * data_bytes_at(path)
            claims = 0
            if len(file.variables) > MOST or len(file.dimensions) > MOST:
                return f"has more than {MOST:,} variables or dimensions"
            for name in file.ncattrs():
                file.getncattr(name)
            for name, variable in file.variables.items():
                for attribute in variable.ncattrs():
                    variable.getncattr(attribute)
                if len(set(variable.dimensions)) < len(variable.dimensions):
                    return f"{name} has the same dimension twice"
                kind = variable.dtype
                if kind is not str and not (
                    isinstance(variable.datatype, np.dtype) and kind.kind in "iufS"
                ):
                    return f"{name} has a user-defined type"
                each = 16 if kind is str else kind.itemsize
                pieces = variable.chunking()
                chunk = math.prod(pieces) if isinstance(pieces, list) else 0
                size = each * math.prod(map(int, variable.shape))
                claims += size
                if claims > holds or max(size, each * chunk) > holds:
                    shape = " x ".join(f"{n:,}" for n in variable.shape)
                    return f"{name} claims to be {shape}, more than the file can hold"
    except Exception as error:  # the library raises all kinds of exceptions
        if os.path.getsize(path) == 0:
            return "is empty"
        # without the number and the path of the library
        return f"is damaged, or not a netCDF file: {getattr(error, 'strerror', None) or error}"
    return ""


def _mesh_complaint(path: str) -> str:
    """Return why a mesh must not be loaded; "" if it may be."""
    try:
        load_mesh(path)
    except Exception as error:  # the readers of trimesh raise all kinds of exceptions
        return f"is not a mesh that trimesh can read: {error}"
    finally:
        gc.collect()  # the mesh has cycles: its memory would stay while the other process reads it
    return ""
