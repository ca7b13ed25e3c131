"""Calls of the system and of the C library that fail, one at a time: what `torture` attacks with."""

import contextlib
import os
import time
import unittest.mock


def places():
    """(name, module, attribute, what may happen there) of what a command asks of the system, and of the C library, which tells only that it failed."""
    import builtins
    import errno

    from rigidmc.storage import writer

    system = [failing(OSError, code, os.strerror(code)) for code in (errno.ENOSPC, errno.EIO)]
    half = [torn(OSError, code, os.strerror(code)) for code in (errno.ENOSPC, errno.EIO)]
    library = [failing(RuntimeError, "NetCDF: HDF error")]
    asked = [(name, os, name, system) for name in ("fsync", "replace", "unlink", "link", "mkdir")]
    return [("open", builtins, "open", system), ("write", builtins, "open", half), *asked,
            ("open of a shard", writer.netCDF4, "Dataset", system), ("write to a shard", writer.Writer, "_rounded", library)]  # fmt: skip


@contextlib.contextmanager
def at_call(folder, module, attribute, number=None, act=None):
    """Let act(what is called, its arguments) take the place of one of the calls that concern a folder; [how many there were]."""
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
    """Whether a call is one of files of a folder: by name, by number, or of its writer."""
    if given and isinstance(given[0], int):
        with contextlib.suppress(OSError):
            return os.readlink(f"/proc/self/fd/{given[0]}").startswith(folder)
    return folder in str(given) or "Writer" in str(given)


def failing(kind, *words):
    """A call that fails; the system names files, but not those it has numbers for."""

    def act(real, given, named):
        error = kind(*words)
        if isinstance(error, OSError) and given and isinstance(given[0], str):
            error.filename = given[0]
        raise error

    return act


def torn(*error):
    """An open of a file that takes half of what is written to it, and then fails."""

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
    time.sleep(0.2)
    return real(*given, **named)


@contextlib.contextmanager
def limited(size):
    """Let files grow to so many bytes only; what writes more is told EFBIG, in the middle of its write."""
    import resource  # Windows has none

    known = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, known[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, known)
