"""Locks of open files, released when the holding process ends, whatever ends it."""

import contextlib
import errno
import os
import platform
import sys
import tempfile
import weakref
from collections.abc import Callable
from typing import IO, Any

from rigidmc.files.opening import open_plain
from rigidmc.files.outputs import naming_the_path
from rigidmc.processes.helpers import let_go

if sys.platform == "win32":
    import msvcrt
else:
    import fcntl

_LOCKLESS = (errno.ENOLCK, errno.ENOSYS, errno.ENOTSUP, errno.EOPNOTSUPP)
WITHOUT_LOCKS = (
    "To work without locks, set HDF5_USE_FILE_LOCKING=FALSE in the environment; "
    "then make sure that only one process writes there"
)
_held: weakref.WeakSet[IO[Any]] = weakref.WeakSet()


def _forked() -> None:
    """In a fork: give up the locks, which belong to the parent process and end with it."""
    let_go([file.fileno() for file in _held if not file.closed])
    _held.clear()
    _made.clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forked)


def lock(file: IO[Any], name: str, shared: bool = False) -> None:
    """Lock an open file until `unlock` or the end of the process.

    Raises BlockingIOError if another process holds the lock, and OSError if the file system has no
    locks, unless HDF5_USE_FILE_LOCKING=FALSE is in the environment.

    shared : several processes may hold a shared lock at once
    """
    try:
        with naming_the_path(name):
            _held.add(file)  # before locking: a fork may happen in between
            _lock(file, shared)
    except OSError as error:
        if error.errno not in _LOCKLESS:
            raise
        if os.environ.get("HDF5_USE_FILE_LOCKING", "").upper() not in ("FALSE", "0"):
            raise OSError(
                f"{name}: the file system has no locks ({error.strerror}); nothing was written. "
                f"{WITHOUT_LOCKS}"
            ) from None


def unlock(file: IO[Any]) -> None:
    """Release the lock of an open file, even if a fork has the file open."""
    _held.discard(file)
    with contextlib.suppress(OSError):
        _unlock(file)


if sys.platform == "win32":

    def _lock(file: IO[Any], shared: bool) -> None:
        """Lock one byte far beyond the end of the file, so that the content stays readable."""
        place = file.tell()
        try:
            file.seek(2**31 - 2)
            msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
        except PermissionError as error:  # another process holds it
            raise BlockingIOError(errno.EAGAIN, error.strerror) from None
        finally:
            file.seek(place)

    def _unlock(file: IO[Any]) -> None:
        """Do nothing: Windows has no forks, and closing the file unlocks it."""

else:

    def _lock(file: IO[Any], shared: bool) -> None:
        fcntl.flock(file, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)

    def _unlock(file: IO[Any]) -> None:
        fcntl.flock(file, fcntl.LOCK_UN)


_made: dict[str, IO[Any]] = {}  # locked files of new folders, by the paths that they will have


def lock_new(folder: str, final: str) -> Callable[[], None]:
    """Lock the file `lock` of a new folder before this folder gets its final name; return what
    releases it.

    `taken_over` goes on with it: between the two, another process could take the folder for
    abandoned. Windows moves no folder with an open file.
    """
    if os.name == "nt":
        return lambda: None
    name, key = os.path.join(folder, "lock"), os.path.join(os.path.abspath(final), "lock")
    file = open(name, "ab+", buffering=0, opener=open_plain)  # noqa: SIM115
    _made[key] = file
    lock(file, name)
    sign(file)

    def release() -> None:
        if _made.get(key) is file:
            _made.pop(key).close()

    return release


def taken_over(name: str) -> IO[Any] | None:
    """Return the file that `lock_new` has locked here; None without one, or if it was replaced."""
    file = _made.pop(os.path.abspath(name), None)
    with contextlib.suppress(OSError):
        if file is not None and os.path.samestat(os.fstat(file.fileno()), os.lstat(name)):
            return file
    return None


def sign(file: IO[Any]) -> None:
    """Write the name of this process into its lock; it is only for people."""
    with contextlib.suppress(OSError):
        file.truncate(0)
        file.write(f"process {os.getpid()} of {platform.node()}\n".encode())


def refuse_lockless(folder: str) -> None:
    """Raise OSError if the files of a folder cannot be locked, see `lock`."""
    with tempfile.TemporaryFile(dir=folder) as file:
        lock(file, folder)
        unlock(file)
