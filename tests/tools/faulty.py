"""Calls of the system and of the C library that fail, one at a time: the attacks of `torture`."""

import contextlib
import os
import signal
import sys
import time
import unittest.mock

import pytest

LINUX = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="needs /proc")


def places():
    """(name, module, attribute, possible faults) of a command's calls of the system and of the C
    library.

    The C library only says that it failed.
    """
    import builtins
    import errno

    from rigidmc.results import writer

    system = [failing(OSError, code, os.strerror(code)) for code in (errno.ENOSPC, errno.EIO)]
    half = [torn(OSError, code, os.strerror(code)) for code in (errno.ENOSPC, errno.EIO)]
    library = [failing(RuntimeError, "NetCDF: HDF error")]
    asked = [(name, os, name, system) for name in ("fsync", "replace", "unlink", "link", "mkdir")]
    return [("open", builtins, "open", system), ("write", builtins, "open", half), *asked,
            ("open of a shard", writer.netCDF4, "Dataset", system),
            ("write to a shard", writer.Writer, "_rounded", library)]  # fmt: skip


@contextlib.contextmanager
def within(seconds):
    """Fail if it takes longer, even waiting for a pipe; no command reports this error."""

    def late(*_):
        raise AssertionError("it blocks")

    previous = signal.signal(signal.SIGALRM, late)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, previous)


@contextlib.contextmanager
def at_call(folder, module, attribute, number=None, act=None):
    """Replace one of the calls that concern a folder by act(the function, its arguments); yields
    [the number of calls].
    """
    real, seen = getattr(module, attribute), [0]

    def called(*given, **named):
        if not concerns(folder, given):
            return real(*given, **named)
        seen[0] += 1
        if seen[0] - 1 != number:
            return real(*given, **named)
        return act(real, given, named)

    with unittest.mock.patch.object(module, attribute, called):
        yield seen


def concerns(folder, given):
    """Whether a call concerns files of a folder: by name, by number, or through its writer."""
    if given and isinstance(given[0], int):
        with contextlib.suppress(OSError):
            return os.readlink(f"/proc/self/fd/{given[0]}").startswith(folder)
    return folder in str(given) or "Writer" in str(given)


def failing(kind, *words):
    """A call that fails; like the system, it names files except those given by number."""

    def act(real, given, named):
        error = kind(*words)
        if isinstance(error, OSError) and given and isinstance(given[0], str):
            error.filename = given[0]
        raise error

    return act


def torn(*error):
    """An open of a file that takes half of what is written to it and then fails."""

    class Torn:
        def __init__(self, file):
            self.file = file

        def write(self, data):
            self.file.write(data[: len(data) // 2])
            failing(*error)(None, (), {})

        def __getattr__(self, name):
            return getattr(self.file, name)

        def __iter__(self):
            return iter(self.file)

        def __enter__(self):
            return self

        def __exit__(self, *_):
            self.file.close()

    return lambda real, given, named: Torn(real(*given, **named))


def delay(real, given, named):
    time.sleep(0.05)
    return real(*given, **named)


@contextlib.contextmanager
def limited(size):
    """Let files grow to that many bytes only; a larger write gets EFBIG halfway."""
    import resource  # Windows has none

    known = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, known[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, known)
