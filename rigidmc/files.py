"""Files that appear whole or not at all."""

import contextlib
import errno
import fcntl
import os
import platform
import tempfile

from rigidmc.errors import OutputExists

_LOCKLESS = (errno.ENOLCK, errno.ENOSYS, errno.ENOTSUP, errno.EOPNOTSUPP)
WITHOUT_LOCKS = (
    "With HDF5_USE_FILE_LOCKING=FALSE in the environment it goes on without; see to it yourself that only one process writes there"
)


def refuse_existing(path, force):
    """Raise OutputExists where a result would overwrite a file."""
    if os.path.lexists(path) and not force:
        raise OutputExists(f"{path} exists; nothing was written (use --force, or force=True, to replace it)")
    if os.path.isdir(path) or not os.path.basename(path):
        raise IsADirectoryError(f"{path}: names a folder, not a file; nothing was written")
    refuse_unwritable(os.path.dirname(path) or os.curdir)


def refuse_unwritable(folder):
    """Raise where no file can be made in a folder."""
    if not os.path.isdir(folder):
        raise FileNotFoundError(f"{folder}: no such folder; nothing was written")
    try:
        with tempfile.TemporaryFile(dir=folder):  # what os.access says of a folder is not what happens there
            pass
    except OSError as error:
        raise PermissionError(f"{folder}: not writable ({error.strerror}); nothing was written") from None


def lock(file, name, kind=fcntl.LOCK_EX):
    """Hold the lock of an open file until it is closed; BlockingIOError where another process does. OSError where the file system has no locks, and
    the user has not said to go without."""
    try:
        with naming(name):
            fcntl.flock(file, kind | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno not in _LOCKLESS:
            raise
        if os.environ.get("HDF5_USE_FILE_LOCKING", "").upper() not in ("FALSE", "0"):
            raise OSError(
                f"{name}: the file system has no locks ({error.strerror}); nothing was written. {WITHOUT_LOCKS}"
            ) from None


def refuse_lockless(folder):
    """OSError where the files of a folder cannot be locked, and the user has not said to go without."""
    with tempfile.TemporaryFile(dir=folder) as file:
        lock(file, folder)


@contextlib.contextmanager
def naming(path):
    """Errors of the system that name no file, as those of write and fsync do not, name this one."""
    try:
        yield
    except OSError as error:
        if error.errno is None or error.filename is not None:
            raise
        raise OSError(error.errno, error.strerror, path) from None


def put_in_place(temporary, path, force):
    """Make a finished file durable and give it its name; OutputExists, and no file, where one appeared there meanwhile."""
    with open(temporary, "rb") as file, naming(path):
        os.fsync(file.fileno())
    if force:
        os.replace(temporary, path)
    else:
        _rename_to_nothing(temporary, path)
    make_durable(os.path.dirname(os.path.abspath(path)))


def make_durable(folder):
    """Let the names in a folder outlive a loss of power, where the file system can."""
    with contextlib.suppress(OSError):
        file = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(file)
        finally:
            os.close(file)


def _rename_to_nothing(temporary, path):
    """Rename a file; OutputExists, and no file, where there is one of that name."""
    try:
        os.link(temporary, path)  # looks and names in one; not all file systems have it
    except OSError:
        if os.path.lexists(path):
            os.unlink(temporary)
            raise OutputExists(f"{path} appeared meanwhile; nothing was overwritten") from None
        os.replace(temporary, path)
    else:
        with contextlib.suppress(OSError):  # a second name of what is whole, which the next writer takes away
            os.unlink(temporary)


def part_of(path):
    """Where this process writes what is to be a file, before it is whole."""
    return f"{path}.part-{platform.node()}-{os.getpid()}"


def write_bytes(path, data, force=False, before=None):
    """Write a file whole or not at all; `before` : what is done when it is written, before it has its name."""
    temporary = part_of(path)
    try:
        with naming(path), open(temporary, "wb") as file:
            file.write(data)
        if before is not None:
            before()
        put_in_place(temporary, path, force)
    except BaseException:
        drop(temporary)
        raise


def drop(path):
    """Take a file away that is not whole, and what it takes of the disk, also where a library keeps it open."""
    with contextlib.suppress(OSError):
        if os.stat(path).st_nlink == 1:  # else it has its name already
            os.truncate(path, 0)
    with contextlib.suppress(OSError):
        os.unlink(path)


def text_of(folder, name):
    """The bytes of a file of a folder, b"" where there is none."""
    path = os.path.join(folder, name)
    if not os.path.isfile(path):
        return b""
    with open(path, "rb") as file:
        return file.read()
