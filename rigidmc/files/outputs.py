"""Files that appear whole or not at all. Each is written beside its place as a `Part`, made durable, then renamed; an existing file
is replaced only on request.

A part is called .part-COMPUTER-PROCESS-NUMBER. If a process is killed, the next one that writes to the folder deletes its parts.
"""

import atexit
import contextlib
import errno
import fcntl
import functools
import itertools
import os
import platform
import re
import shutil
import tempfile
import time

from rigidmc.errors import NoRoom, OutputExists, SceneError

KINDS = {  # of what is written, with their endings
    "results": (".nc",),
    "pictures": (".png", ".pdf", ".svg"),
    "animations": (".gif", ".mp4", ".webm"),
    "tables of bounds": (".csv",),
}
_PART = re.compile(r"\.part-(.+)-([0-9]+)-([0-9]+)(\.[A-Za-z0-9]{1,8})?")
_numbers = itertools.count()
_parts: set[str] = set()  # those that this process writes
os.register_at_fork(after_in_child=_parts.clear)

_LOCKLESS = (errno.ENOLCK, errno.ENOSYS, errno.ENOTSUP, errno.EOPNOTSUPP)
WITHOUT_LOCKS = "With HDF5_USE_FILE_LOCKING=FALSE in the environment it works without locks; then make sure that only one process writes there"


def check_suffix(path, kind):
    """SceneError if a file name does not have an ending of its kind, because the ending would belie the content."""
    suffix, endings = os.path.splitext(path)[1], KINDS[kind]
    if suffix.lower() not in endings:
        more = "; `rigidmc run SCENE -o RUN/` makes a run directory" if kind == "results" else ""
        raise SceneError(
            "",
            "output",
            os.fspath(path),
            f"a name for {kind} ends in {', '.join(endings)}, not in '{suffix}'{more}",
        )


def refuse_existing(path, force, kind="results", size=100_000):
    """Raise, before the work, if a result could not be written after it: OutputExists if it would overwrite a file, SceneError if
    its name does not have an ending of its kind, NoRoom if fewer than `size` bytes of the disk are free."""
    try:
        there = os.lstat(path) is not None
    except (FileNotFoundError, NotADirectoryError):
        there = False
    except OSError as error:  # a name that is too long
        raise _said(error, path) from None
    if there and not force:
        raise OutputExists(
            f"{path} exists; nothing was written (use --force, or force=True, to replace it)"
        )
    if os.path.isdir(path) or not os.path.basename(path):
        raise IsADirectoryError(f"{path}: names a folder, not a file; nothing was written")
    if os.path.exists(path) and not os.path.isfile(path):
        raise OutputExists(f"{path}: is no file that could be replaced; nothing was written")
    check_suffix(path, kind)
    refuse_unwritable(os.path.dirname(path) or os.curdir, size)


def refuse_unwritable(folder, size=100_000):
    """Raise if no file of `size` bytes can be made in a folder. Parts that ended processes left there are deleted first."""
    if not os.path.isdir(folder):
        raise FileNotFoundError(f"{folder}: no such folder; nothing was written")
    clear(folder)
    probe = Part(os.path.join(folder, "probe"))
    try:
        with open(
            probe.path, "wb"
        ) as file:  # os.access may be wrong about a folder: only writing tells
            file.write(bytes(4096))
    except OSError as error:
        raise _said(error, folder) from None
    finally:
        probe.discard()
    if (free := shutil.disk_usage(folder).free) < size:
        raise NoRoom(
            f"{folder}: {size / 1e6:.1f} MB are needed, of which {free / 1e6:.1f} MB are free"
        )


def _said(error, path):
    """An error of the system in words, of its own kind."""
    return type(error)(f"{path}: not writable: {error.strerror}; nothing was written")


class Part:
    """An unfinished file or folder. Its content is written to `path`; `finish` gives it its name, `discard` deletes it.

    As a context manager it gives `path`, finishes at the end, and discards if anything is raised.
    """

    def __init__(self, final, force=False, before=None):
        """before : called when the file is durable and does not have its name yet"""
        self.final, self.force, self.before = os.fspath(final), force, before
        folder, name = os.path.split(os.path.abspath(self.final))
        suffix = os.path.splitext(name)[1]  # writers of animations choose the format by it
        name = f".part-{_computer()}-{os.getpid()}-{next(_numbers)}"  # short, where the name itself may have all 255 letters
        self.path = os.path.join(folder, name + suffix * bool(_PART.fullmatch(name + suffix)))
        _parts.add(self.path)

    def __enter__(self):
        return self.path

    def __exit__(self, kind, *_):
        if kind is None:
            self.finish()
        else:
            self.discard()

    def finish(self, final=None):
        """Make the file durable and give it its name, or `final`. If the name x.nc is taken meanwhile, this file becomes x.2.nc,
        and OutputExists says so."""
        final = self.final if final is None else final
        try:
            with naming(final, self.path):
                with open(self.path, "rb") as file:
                    os.fsync(file.fileno())
                if self.before is not None:
                    self.before()
                self._rename(final)
            make_durable(os.path.dirname(os.path.abspath(final)))
        finally:
            self.discard()

    def _rename(self, final):
        try:
            if self.force:
                os.replace(self.path, final)
            else:
                _rename_to_nothing(self.path, final)
        except (FileExistsError, IsADirectoryError):
            for other in _others(final):
                with contextlib.suppress(FileExistsError):
                    _rename_to_nothing(self.path, other)
                    break
            raise OutputExists(
                f"{final} appeared meanwhile and was not overwritten: the result is {other}"
            ) from None

    def discard(self):
        """Delete an unfinished file and free its space, even if a library still has it open."""
        _drop(self.path)
        _parts.discard(
            self.path
        )  # if a signal interrupts before this, `drop_parts` deletes the part


def lock(file, name, kind=fcntl.LOCK_EX):
    """Hold the lock of an open file until it is closed. BlockingIOError if another process holds it; OSError if the file system has
    no locks, unless the environment has HDF5_USE_FILE_LOCKING=FALSE."""
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
    """OSError if the files of a folder cannot be locked, see `lock`."""
    with tempfile.TemporaryFile(dir=folder) as file:
        lock(file, folder)


@contextlib.contextmanager
def folder_beside(path):
    """A folder beside a place, deleted in the end unless it was renamed."""
    part = Part(path)
    try:
        os.mkdir(part.path)
        yield part.path
    finally:
        part.discard()


def write_bytes(path, data, force=False, before=None):
    """Write a file whole or not at all; `before` : as of `Part`."""
    with Part(path, force, before) as part, naming(path, part), open(part, "wb") as file:
        file.write(data)


@contextlib.contextmanager
def naming(path, part=None):
    """Let errors of the system name `path` if they name no file, as those of write and fsync, or only its part."""
    try:
        yield
    except OSError as error:
        if error.errno is None or error.filename not in (None, part):
            raise
        raise OSError(error.errno, error.strerror, path) from None


def make_durable(folder):
    """Let the names in a folder outlive a loss of power, where the file system can."""
    with contextlib.suppress(OSError):
        file = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(file)
        finally:
            os.close(file)


def _rename_to_nothing(part, path):
    """Rename a file; FileExistsError where there is one of that name."""
    try:
        os.link(part, path)  # looks and names in one; not all file systems have it
    except OSError:
        if os.path.lexists(path):
            raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), path) from None
        os.replace(part, path)
    else:
        with contextlib.suppress(OSError):  # a second name of what is whole
            os.unlink(part)


def _others(path):
    """x.2.nc, x.3.nc, ... for x.nc, in 255 bytes."""
    folder, name = os.path.split(path)
    stem, suffix = os.path.splitext(name)
    for i in itertools.count(2):
        end = f".{i}{suffix}"
        yield os.path.join(
            folder, os.fsdecode(os.fsencode(stem)[: max(1, 255 - len(os.fsencode(end)))]) + end
        )


def is_part(name):
    """Whether a name is that of a part."""
    return _PART.fullmatch(name) is not None


def clear(folder, age=None):
    """Delete the parts in a folder that no process writes any more: those of ended processes of this computer and, if `age` is
    given, those of other computers that have not changed for `age` seconds."""
    with contextlib.suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            with contextlib.suppress(OSError):
                if (found := _PART.fullmatch(entry.name)) and _is_left(
                    entry, found[1], int(found[2]), age
                ):
                    _drop(entry.path)


def _is_left(entry, computer, process, age):
    if computer != _computer():
        return age is not None and time.time() - entry.stat(follow_symlinks=False).st_mtime > age
    if process == os.getpid():
        return os.path.abspath(entry.path) not in _parts
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):  # OverflowError: a number that no process has
        return True
    except OSError:
        return False
    return False


@functools.cache
def _computer():
    """The name of this computer, with the namespace of its process numbers: every container counts its own."""
    try:
        return f"{platform.node()[:64]}-{os.stat('/proc/self/ns/pid').st_ino}"
    except OSError:
        return platform.node()[:64]


@atexit.register
def drop_parts():
    """Delete what this process has begun and not finished, where a second signal interrupted the clean-up."""
    for part in list(_parts):
        _drop(part)


def _drop(part):
    with contextlib.suppress(OSError):
        if os.path.isdir(part) and not os.path.islink(part):
            shutil.rmtree(part, ignore_errors=True)
        else:
            if os.lstat(part).st_nlink == 1:  # else it has its name already
                with contextlib.suppress(OSError):
                    os.truncate(part, 0)
            os.unlink(part)


def content_of(folder, name):
    """The bytes of a file of a folder, b"" where there is none."""
    path = os.path.join(folder, name)
    if not os.path.isfile(path):
        return b""
    with open(path, "rb") as file:
        return file.read()
