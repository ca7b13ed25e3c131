"""Files that appear completely or not at all. Each is written in its final folder as a
`PartialFile`, made durable, then renamed; an existing file is replaced only on request.

A partial file is called .part-COMPUTER-PROCESS-NUMBER. If a process is killed, the next process
that writes to the folder deletes its partial files.
"""

import atexit
import contextlib
import errno
import functools
import itertools
import os
import platform
import re
import shutil
import time
from collections.abc import Callable, Iterator

from rigidmc.errors import FileError, NoRoom, OutputExists
from rigidmc.files.opening import check_suffix, is_zarr, open_plain, refuse_unnamed
from rigidmc.processes.helpers import descriptors, let_go

Path = str | os.PathLike[str]

_PART = re.compile(r"\.part-(.+)-([0-9]+)-([0-9]+)(\.[A-Za-z0-9]{1,8})?")
_numbers = itertools.count()
_parts: set[str] = set()  # partial files of this process


def _forked() -> None:
    """In a fork: give up the partial files, which belong to the parent process."""
    if _parts:
        let_go(list(descriptors(_parts)))
    _parts.clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forked)


def refuse_existing(path: Path, force: bool, kind: str = "results", size: float = 100_000) -> None:
    """Raise before the computation if its result could not be written.

    Raises OutputExists if it would overwrite a file, OptionError if its name lacks a suffix of its
    kind, and NoRoom if fewer than `size` bytes of the disk are free.
    """
    try:
        exists = os.lstat(path) is not None
    except (FileNotFoundError, NotADirectoryError):
        exists = False
    except OSError as error:  # a name that is too long
        raise _not_writable(error, path) from None
    if exists and not force:
        raise OutputExists(
            f"{path} exists; nothing was written (use --force, or force=True, to replace it)"
        )
    store = os.fspath(path).lower().endswith(".zarr") and is_zarr(path)
    if (os.path.isdir(path) and not store) or not os.path.basename(path):
        raise IsADirectoryError(f"{path}: names a folder, not a file; nothing was written")
    if os.path.exists(path) and not (os.path.isfile(path) or store):
        raise OutputExists(f"{path}: is not a file that can be replaced; nothing was written")
    check_suffix(path, kind)
    if kind in ("results", "netCDF files"):
        refuse_unnamed(path)
    refuse_unwritable(os.path.dirname(path) or os.curdir, size)


def refuse_unwritable(folder: str, size: float = 100_000) -> None:
    """Raise if a file of `size` bytes cannot be written to a folder, or must not be because the
    folder is a run directory: `resume --repair` deletes files there that are not the run's own.

    Partial files left there by ended processes are deleted first.
    """
    if not os.path.isdir(folder):
        raise FileNotFoundError(f"{folder}: no such folder; nothing was written")
    if (run := _run_around(folder)) is not None:
        rule = "may contain only its own files: choose a place outside; nothing was written"
        raise OutputExists(f"{folder}: the run directory {run} {rule}")
    clear(folder)
    try:
        # os.access may be wrong about a folder: only a trial write is reliable
        probe = PartialFile(os.path.join(folder, "probe"))
        try:
            with open(probe.path, "wb", opener=open_plain) as file:
                file.write(bytes(4096))
        finally:
            probe.discard()
    except OSError as error:
        raise _not_writable(error, folder) from None
    if (free := shutil.disk_usage(folder).free) < size:
        raise NoRoom(
            f"{folder}: {size / 1e6:.1f} MB are needed, but only {free / 1e6:.1f} MB are free"
        )


def _run_around(folder: str) -> str | None:
    """Return the run directory that contains a folder or is the folder itself; None if neither.
    A folder in one of its partial files does not count: the run's own process writes there."""
    at, above = "", os.path.realpath(folder)
    while at != above and not is_part(os.path.basename(above)):
        at, above = above, os.path.dirname(above)
        if all(os.path.isfile(os.path.join(at, name)) for name in ("run.json", "scene.toml")):
            return at
    return None


def _not_writable(error: OSError, path: Path) -> OSError:
    """Return the same kind of error with a readable message."""
    return type(error)(f"{path}: not writable: {error.strerror}; nothing was written")


class PartialFile:
    """An unfinished file or folder. The caller writes its content to `path`, which exists and is
    empty; `finish` renames it to its final name, and `discard` deletes it.

    As a context manager it yields `path`, finishes at the end, and discards after an exception.
    """

    def __init__(
        self,
        final: Path,
        force: bool = False,
        before: Callable[[], None] | None = None,
        folder: bool = False,
    ) -> None:
        """before : called when the file is durable and does not yet have its final name

        folder : whether it is a folder
        """
        self.final, self.force, self.before = os.fspath(final), force, before
        place, name = os.path.split(os.path.abspath(self.final))
        suffix = os.path.splitext(name)[1]  # writers of animations choose the format from it
        while True:
            # short, because the final name may use all 255 allowed characters
            name = f".part-{_computer()}-{os.getpid()}-{next(_numbers)}"
            self.path = os.path.join(place, name + suffix * bool(_PART.fullmatch(name + suffix)))
            _parts.add(self.path)
            try:
                with naming_the_path(self.final, self.path):
                    _create(self.path, folder)
                break
            except BaseException as error:
                _parts.discard(self.path)
                if not isinstance(error, FileExistsError):  # another process has used this name
                    raise

    def __enter__(self) -> str:
        return self.path

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is None:
            self.finish()
        else:
            self.discard()

    def finish(self, final: str | None = None) -> None:
        """Make the file durable and rename it to its final name, or to `final`.

        If x.nc has appeared meanwhile, this file becomes x.2.nc, and OutputExists reports it.
        """
        final = self.final if final is None else final
        try:
            with naming_the_path(final, self.path):
                # Files whose writer was killed without this opened cleanly and were empty, 65 of
                # 65; of 1,368 shards that got their names after it, none was bad after 40 kills.
                for file in _files_of(self.path):
                    with open(
                        file, "rb+", opener=open_plain
                    ) as stream:  # Windows makes only writable files durable
                        os.fsync(stream.fileno())
                if self.before is not None:
                    self.before()
                self._rename(final)
            # the name, too: a power failure may forget a rename whose folder was not synced
            make_durable(os.path.dirname(os.path.abspath(final)))
        finally:
            self.discard()

    def _rename(self, final: str) -> None:
        try:
            if self.force and os.path.isdir(self.path) and os.path.lexists(final):
                self._replace_by_folder(final)
            elif self.force:
                os.replace(self.path, final)
            else:
                _rename_to_free(self.path, final)
        except (FileExistsError, IsADirectoryError):
            for other in _other_names(final):
                with contextlib.suppress(FileExistsError):
                    _rename_to_free(self.path, other)
                    break
            raise OutputExists(
                f"{final} appeared meanwhile and was not overwritten: the result is in {other}"
            ) from None

    def _replace_by_folder(self, final: str) -> None:
        """Move an existing folder aside first: systems do not replace a folder that has files."""
        old = PartialFile(final, folder=os.path.isdir(final) and not os.path.islink(final))
        if os.name == "nt":  # Windows does not replace a folder by another
            os.rmdir(old.path)
        os.replace(final, old.path)
        try:
            os.replace(self.path, final)
        except BaseException:
            os.replace(old.path, final)
            raise
        old.discard()

    def discard(self) -> None:
        """Delete an unfinished file and free its space, even if a library still has it open."""
        _drop(self.path)
        # if a signal arrives before this line, `drop_parts` deletes the partial file
        _parts.discard(self.path)


@contextlib.contextmanager
def folder_beside(path: Path) -> Iterator[str]:
    """Yield a new folder in the same folder as `path`; delete it at the end unless renamed."""
    part = PartialFile(path, folder=True)
    try:
        yield part.path
    finally:
        part.discard()


def write_bytes(
    path: Path, data: bytes, force: bool = False, before: Callable[[], None] | None = None
) -> None:
    """Write a file completely or not at all; `before` as for `PartialFile`."""
    with (
        PartialFile(path, force, before) as part,
        naming_the_path(path, part),
        open(part, "wb", opener=open_plain) as file,
    ):
        file.write(data)


def _create(path: str, folder: bool) -> None:
    """Make an empty file or folder; FileExistsError if anything, even a link, has this name."""
    if folder:
        os.mkdir(path)
    else:
        os.close(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666))


@contextlib.contextmanager
def naming_the_path(path: Path, part: str | None = None) -> Iterator[None]:
    """Name `path` in system errors that name its partial file or no file, as fsync does."""
    try:
        yield
    except OSError as error:
        if error.errno is None or error.filename not in (None, part):
            raise
        raise OSError(error.errno, error.strerror, path) from None


def make_durable(folder: str) -> None:
    """Make the names in a folder survive a power failure, if the file system can."""
    with contextlib.suppress(OSError):
        file = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(file)
        finally:
            os.close(file)


def _files_of(path: str) -> Iterator[str]:
    """Yield the file itself, or all files of a folder."""
    if not os.path.isdir(path):
        yield path
    for folder, _, names in os.walk(path):
        yield from (os.path.join(folder, name) for name in names)


def _rename_to_free(part: str, path: str) -> None:
    """Rename a file; FileExistsError if the name is taken."""
    try:
        os.link(part, path)  # checks and names in one step; some file systems lack it
    except OSError:
        if os.path.lexists(path):
            raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), path) from None
        os.replace(part, path)
    else:
        with contextlib.suppress(OSError):  # if it stays, it is a second name of a complete file
            os.unlink(part)


def _other_names(path: str) -> Iterator[str]:
    """Yield x.2.nc, x.3.nc, ... for x.nc, each at most 255 bytes long."""
    folder, name = os.path.split(path)
    stem, suffix = os.path.splitext(name)
    for i in itertools.count(2):
        end = f".{i}{suffix}"
        short = os.fsencode(stem)[: max(1, 255 - len(os.fsencode(end)))]
        yield os.path.join(folder, os.fsdecode(short) + end)


def is_part(name: str) -> bool:
    """Return whether a name is the name of a partial file."""
    return _PART.fullmatch(name) is not None


def clear(folder: str, age: float | None = None) -> None:
    """Delete the abandoned partial files in a folder.

    These belong to ended processes of this computer or, if `age` is given, to other computers and
    have not changed for `age` seconds.
    """
    with contextlib.suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            with contextlib.suppress(OSError):
                if (name := _PART.fullmatch(entry.name)) and _is_abandoned(
                    entry, name[1], int(name[2]), age
                ):
                    _drop(entry.path)


def _is_abandoned(entry: os.DirEntry[str], computer: str, process: int, age: float | None) -> bool:
    if computer != _computer():
        return age is not None and time.time() - entry.stat(follow_symlinks=False).st_mtime > age
    if process == os.getpid():
        return os.path.abspath(entry.path) not in _parts
    import psutil  # takes 20 ms, and few folders have partial files

    try:
        return not psutil.pid_exists(process)
    except OverflowError:  # not a valid process number
        return True


@functools.cache
def _computer() -> str:
    """Return the name of this computer and its PID namespace: each container has its own."""
    try:
        return f"{platform.node()[:64]}-{os.stat('/proc/self/ns/pid').st_ino}"
    except OSError:  # not Linux
        return platform.node()[:64]


@atexit.register
def drop_parts() -> None:
    """Delete partial files of this process whose deletion a second signal interrupted."""
    for part in list(_parts):
        _drop(part)


def _drop(part: str) -> None:
    with contextlib.suppress(OSError):
        if os.path.isdir(part) and not os.path.islink(part):
            shutil.rmtree(part, ignore_errors=True)
        else:
            _free(part)
            os.unlink(part)


def _free(part: str) -> None:
    """Free the space of a file, even if a library still has it open. Leave alone the target of a
    link, a file that already has its final name, and another user's file."""
    with (
        contextlib.suppress(OSError, FileError),
        open(part, "rb+", buffering=0, opener=open_plain) as file,
    ):
        facts = os.fstat(file.fileno())
        mine = not hasattr(os, "getuid") or facts.st_uid == os.getuid()
        if facts.st_nlink == 1 and mine:
            file.truncate(0)


def disk_bytes(path: Path) -> int:
    """Return the bytes of a file, or of all files of a folder."""
    return sum(map(os.path.getsize, _files_of(os.fspath(path))))


def content_of(folder: Path, name: str) -> bytes:
    """Return the bytes of a file in a folder, b"" if it does not exist; FileError for a link."""
    with (
        contextlib.suppress(FileNotFoundError),
        open(os.path.join(folder, name), "rb", opener=open_plain) as file,
    ):
        return file.read()
    return b""
