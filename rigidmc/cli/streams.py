"""Standard streams that are closed, whose reader has gone or whose disk is full: no file and no exit code depends on them, but that which says so."""

import contextlib
import os
import sys


class Stream:
    """A standard stream that takes everything. fault : the OSError that kept it from being written; none where only the reader has gone."""

    def __init__(self, stream):
        self._stream, self._gone = stream, False
        self.fault: OSError | None = None
        with contextlib.suppress(AttributeError):
            stream.reconfigure(errors="backslashreplace")  # what has no letters for |L|² is no reason to fail

    def write(self, text):
        self._tried(self._stream.write, text)
        return len(text)

    def flush(self):
        self._tried(self._stream.flush)

    def _tried(self, work, *given):
        if not self._gone:
            try:
                work(*given)
            except OSError as error:
                self._gone, self.fault = True, None if isinstance(error, BrokenPipeError) else error
                with contextlib.suppress(OSError):  # what waits in its buffer, and what libraries print
                    os.dup2(os.open(os.devnull, os.O_WRONLY), self._stream.fileno())

    def __getattr__(self, name):
        return getattr(self._stream, name)


def guard():
    """Give this process standard streams that take everything; that of its output."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:  # else the next file that is opened has this number, and what is printed goes there
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)
    sys.stdin = sys.stdin or os.fdopen(0, closefd=False)
    out = sys.stdout = Stream(sys.stdout or os.fdopen(1, "w", closefd=False))
    sys.stderr = Stream(sys.stderr or os.fdopen(2, "w", closefd=False))
    return out
