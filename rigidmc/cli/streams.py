"""Standard streams that may be closed, without a reader, or on a full disk. Files and exit codes do
not depend on them, except the exit code that reports a failed write."""

import contextlib
import os
import sys
from collections.abc import Callable
from typing import Any, TextIO, cast

from rigidmc.errors import shown


class Stream:
    """A standard stream that never fails.

    fault : the OSError that ended its output; None if only its reader has gone
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream, self._gone = stream, False
        self.fault: OSError | None = None
        with contextlib.suppress(AttributeError):
            # an encoding that lacks a character, such as that of |L|², is no reason to fail
            # (a stream without `reconfigure` is left as it is)
            stream.reconfigure(errors="backslashreplace")  # type: ignore[attr-defined]

    def write(self, text: str) -> int:
        """Write a text without what controls a terminal, unless rich writes: that draws help and
        progress, of words that are our own."""
        rich = sys._getframe(1).f_globals.get("__name__", "").startswith("rich.")
        return self.draw(text if rich else shown(text))

    def draw(self, text: str) -> int:
        """Write a text as it is."""
        self._tried(self._stream.write, text)
        return len(text)

    def flush(self) -> None:
        self._tried(self._stream.flush)

    def _tried(self, work: Callable[..., object], *given: str) -> None:
        if not self._gone:
            try:
                work(*given)
            except OSError as error:
                self._gone, self.fault = True, None if isinstance(error, BrokenPipeError) else error
                with contextlib.suppress(OSError):  # its buffer and what libraries print is dropped
                    os.dup2(os.open(os.devnull, os.O_WRONLY), self._stream.fileno())

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


def guard() -> Stream:
    """Give this process standard streams that never fail; return its standard output."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:  # a closed one: the next file opened would receive what is printed
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)
    sys.stdin = sys.stdin or os.fdopen(0, closefd=False)
    out = Stream(sys.stdout or os.fdopen(1, "w", closefd=False))
    error = Stream(sys.stderr or os.fdopen(2, "w", closefd=False))
    sys.stdout, sys.stderr = cast(TextIO, out), cast(TextIO, error)
    return out
