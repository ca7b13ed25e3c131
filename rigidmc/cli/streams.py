"""Standard streams that may be closed, without a reader, or on a full disk. Files do not depend on them, nor do exit codes, except
the one that reports a failed write."""

import contextlib
import os
import sys


class Stream:
    """A standard stream that never fails. fault : the OSError that ended its output; None if only its reader has gone."""

    def __init__(self, stream):
        self._stream, self._gone = stream, False
        self.fault: OSError | None = None
        with contextlib.suppress(AttributeError):
            stream.reconfigure(
                errors="backslashreplace"
            )  # an encoding without a character, as in |L|², is no reason to fail

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
                with contextlib.suppress(
                    OSError
                ):  # its buffer, and what libraries print, goes nowhere
                    os.dup2(os.open(os.devnull, os.O_WRONLY), self._stream.fileno())

    def __getattr__(self, name):
        return getattr(self._stream, name)


def guard():
    """Give this process standard streams that never fail; returns the one of its output."""
    for number in range(3):
        try:
            os.fstat(number)
        except (
            OSError
        ):  # otherwise the next file opened gets this number, and receives what is printed
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)
    sys.stdin = sys.stdin or os.fdopen(0, closefd=False)
    out = sys.stdout = Stream(sys.stdout or os.fdopen(1, "w", closefd=False))
    sys.stderr = Stream(sys.stderr or os.fdopen(2, "w", closefd=False))
    return out
