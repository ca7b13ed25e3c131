"""Safe opening of files in untrusted folders, and the kinds of output files.

A folder may be a download, or writable by several people: functions here follow no link, read and
write only regular files, and wait for no pipe. The suffix of a file name gives its kind.
"""

import errno
import importlib.util
import os
import shutil
import stat

from rigidmc.errors import FileError, OptionError

_WAITLESS = sum(getattr(os, name, 0) for name in ("O_NONBLOCK", "O_CLOEXEC", "O_BINARY"))
_FLAGS = _WAITLESS | getattr(os, "O_NOFOLLOW", 0)
_FOLDER = sum(getattr(os, name, 0) for name in ("O_DIRECTORY", "O_NOFOLLOW", "O_CLOEXEC"))
_BY_FOLDER = os.open in os.supports_dir_fd and hasattr(os, "O_DIRECTORY")
_SMALL = 2**16  # bytes of a file whose holes do not matter
_PIECES = 10_000  # pieces of data between holes that are counted
_KINDS = {
    stat.S_ISDIR: "a folder",
    stat.S_ISFIFO: "a pipe",
    stat.S_ISSOCK: "a socket",
    stat.S_ISLNK: "a link",
}


def refuse_irregular(path: str | os.PathLike[str], mode: int | None = None) -> None:
    """Raise FileError for a pipe, device or folder; FileNotFoundError if nothing exists there."""
    mode = os.stat(path).st_mode if mode is None else mode
    if not stat.S_ISREG(mode):
        kind = next((words for test, words in _KINDS.items() if test(mode)), "a device")
        rule = f"is {kind}; only regular files are read"
        raise FileError(rule, at="file", file=os.fspath(path))


def refuse_unnamed(path: str | os.PathLike[str]) -> None:
    """Raise FileError for a path that is not UTF-8, which the netCDF library cannot open."""
    try:
        os.path.abspath(path).encode("utf-8")
    except UnicodeEncodeError:
        rule = "is a path that is not UTF-8, which netCDF files require; nothing was done"
        raise FileError(rule, at="path", file=repr(os.path.abspath(path))) from None


def open_regular(path: str, flags: int) -> int:
    """Open a regular file that the user names, perhaps by a link; for `open(path, opener=...)`."""
    refuse_irregular(path)  # opening a device may have effects
    return _kept_if_regular(path, os.open(path, flags | _WAITLESS))


def open_plain(path: str, flags: int) -> int:
    """Open a regular file that is not a link; for `open(path, opener=open_plain)`."""
    return _checked(path, path, flags, None)


def open_below(path: str, flags: int) -> int:
    """Like `open_plain`, but the file's folder must not be a link either."""
    folder, name = os.path.split(path)
    if not _BY_FOLDER:
        if os.path.islink(folder):
            refuse_irregular(folder, stat.S_IFLNK)
        return open_plain(path, flags)
    at = _opened(folder, folder, os.O_RDONLY | _FOLDER, None)
    try:
        return _checked(path, name, flags, at)
    finally:
        os.close(at)


def _checked(path: str, name: str, flags: int, at: int | None) -> int:
    """Open a file and refuse all but regular files; name : relative to the open folder `at`."""
    return _kept_if_regular(path, _opened(path, name, flags | _FLAGS, at))


def _kept_if_regular(path: str, file: int) -> int:
    """Return an open file; close and refuse it if it is not regular."""
    try:
        refuse_irregular(path, os.fstat(file).st_mode)
    except BaseException:
        os.close(file)
        raise
    return file


def _opened(path: str, name: str, flags: int, at: int | None) -> int:
    if not hasattr(os, "O_NOFOLLOW") and os.path.islink(path):  # Windows
        refuse_irregular(path, stat.S_IFLNK)
    try:
        return os.open(name, flags, 0o666, dir_fd=at)
    except OSError as error:
        # a link, or a pipe without a reader: name its kind if the system reports it
        if error.errno in (errno.ELOOP, errno.EMLINK, errno.ENOTDIR, errno.ENXIO):
            mode = os.lstat(path).st_mode
            if not stat.S_ISDIR(mode):
                refuse_irregular(path, mode)
        raise type(error)(error.errno, error.strerror, path) from None


def copy(path: str, to: str) -> None:
    """Copy a file from an untrusted folder to an existing file."""
    with open(path, "rb", opener=open_below) as source, open(to, "wb", opener=open_plain) as target:
        shutil.copyfileobj(source, target, 2**20)


def data_bytes(file: int) -> int:
    """Return the bytes of an open file that hold data: its size without the holes of a sparse file.

    A sparse file of gigabytes may occupy no disk space. On file systems without holes this is the
    size.
    """
    size = os.fstat(file).st_size
    if not hasattr(os, "SEEK_DATA") or size < _SMALL:
        return size
    data, at = 0, 0
    try:
        for _ in range(_PIECES):
            begin = os.lseek(file, at, os.SEEK_DATA)
            at = os.lseek(file, begin, os.SEEK_HOLE)
            data += at - begin
            if at >= size:
                break
    except OSError as error:
        if error.errno != errno.ENXIO:  # no data after `at`
            return size
    finally:
        os.lseek(file, 0, os.SEEK_SET)
    return data


def data_bytes_at(path: str | os.PathLike[str]) -> int:
    """Return `data_bytes` of the regular file at a path."""
    with open(path, "rb", opener=open_regular) as file:
        return data_bytes(file.fileno())


KINDS = {  # kinds of output, with their suffixes
    "results": (".nc", ".zarr", ".csv", ".parquet"),
    "netCDF files": (".nc",),
    "pictures": (".png", ".pdf", ".svg"),
    "animations": (".gif", ".mp4", ".webm"),
    "pages": (".html",),
    "tables of bounds": (".csv",),
    "scenes": (".toml",),
}
# {suffix: (module that writes it, extra of rigidmc that installs it)}
_NEEDED = {".zarr": ("zarr", "zarr"), ".parquet": ("pyarrow", "table")}


_ELSEWHERE = {
    "results": "; `rigidmc run SCENE -o RUN/` makes a run directory",
    "animations": "; `rigidmc view` makes a page, .html",
}


def check_suffix(path: str | os.PathLike[str], kind: str) -> None:
    """Raise OptionError if a file name lacks a suffix of its kind, and so would misname the
    content, or if its suffix needs a package that is not installed."""
    suffix, endings = os.path.splitext(path)[1], KINDS[kind]
    if suffix.lower() not in endings:
        more = _ELSEWHERE.get(kind, "")
        rule = f"a name for {kind} ends in {', '.join(endings)}, not in '{suffix}'{more}"
        raise OptionError(rule, at="output", value=os.fspath(path))
    module, extra = _NEEDED.get(suffix.lower(), ("", ""))
    if module and importlib.util.find_spec(module) is None:
        rule = f"needs the package {module}: pip install 'rigidmc[{extra}]'"
        raise OptionError(rule, at="output", value=os.fspath(path))


def is_zarr(path: str | os.PathLike[str]) -> bool:
    """Return whether a path is a folder that holds a zarr store."""
    return any(os.path.isfile(os.path.join(path, name)) for name in (".zgroup", "zarr.json"))
