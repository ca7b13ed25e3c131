"""A private disk cache of compiled code, invalidated by any change of the sources that it reads.

Its folder is named by a hash of the compilers and of their sources here. Each file is named by a
hash of what decides its content: the types of kernels with the stamps of their sources
(`source_stamps` for the package, `user_stamps` for custom classes), and what else its maker names.
The content is followed by its checksum: a flipped bit in machine code would crash.
"""

import contextlib
import errno
import functools
import hashlib
import logging
import os
import platform
import re
import shutil
import stat
import sys
import time
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import llvmlite
import numba
import numpy as np
import platformdirs

from rigidmc.engine.compiler.frozen import homes_of
from rigidmc.engine.compiler.source_stamps import source_stamp
from rigidmc.files.opening import open_plain


class Entry(NamedTuple):
    """A place in the cache.

    name : of its file, a hash of all that decides the content
    is_lasting : whether the name tells as much in another process; if not, nothing is stored
    """

    name: str
    is_lasting: bool


def entry_of(signatures: Sequence[Any], *inputs: object) -> Entry:
    """Return the place of what the types of kernels decide together with other inputs."""
    # the text of a type does not name its module
    homes = [homes_of(signature) for signature in signatures]
    name = hashlib.sha256(repr((signatures, homes, inputs)).encode()).hexdigest()
    return Entry(name, all(isinstance(home, str) for each in homes for home in each))


def read(entry: Entry) -> bytes | None:
    """Return what is stored, None if there is nothing; delete a damaged file."""
    if not entry.is_lasting:
        return None
    try:
        path = os.path.join(kernel_folder(), entry.name)
        with open(path, "rb", opener=open_plain) as file:
            data = file.read()
        content = data[:-_SUM]
        if data == content + _checksum(entry, content):
            os.utime(path)  # see `delete_unread`
            return content
        os.unlink(path)
    except FileNotFoundError:
        pass
    except (OSError, ValueError) as error:  # a ValueError for a link or a pipe
        log_once(error)
    return None


def store(entry: Entry, content: bytes) -> bool:
    """Store content for other processes; return whether it is stored."""
    if not entry.is_lasting:
        return False
    try:
        path = os.path.join(kernel_folder(), entry.name)
        write_whole(path, content + _checksum(entry, content))
        delete_unread()
    except (OSError, ValueError) as error:
        log_once(error)
        return False
    return True


def write_whole(path: str, content: bytes) -> None:
    """Write a file of the cache; no process reads an incomplete one."""
    part = f"{path}.{os.getpid()}"
    try:
        with open(part, "wb", opener=open_plain) as file:
            file.write(content)
        os.replace(part, path)
    except OSError:
        with contextlib.suppress(OSError):
            os.unlink(part)
        raise


def is_stored(entry: Entry) -> bool:
    """Return whether there is a file, by its name."""
    with contextlib.suppress(OSError):  # there is no cache
        return entry.is_lasting and os.path.exists(os.path.join(kernel_folder(), entry.name))
    return False


def _checksum(entry: Entry, content: bytes) -> bytes:
    """Return what follows the content; it contains the name, so no file passes for another."""
    return hashlib.sha256(entry.name.encode() + content).digest()


_SUM = hashlib.sha256().digest_size
_texts: dict[str, str] = {}  # of this process, by the names of their entries
# The modules that make texts: code for GPUs and browsers, why a part runs on single members.
_TEXT_MAKERS = "rigidmc.engine.cuda.program", "rigidmc.engine.wasm.program"


def text_entry(signatures: Sequence[Any], extra: str) -> Entry:
    """Return the place of a text determined by the types of kernels and `extra`."""
    return entry_of(signatures, source_stamp(*_TEXT_MAKERS), extra)


def has_text(entry: Entry) -> bool:
    """Return whether a text is in memory or in the disk cache."""
    return entry.name in _texts or is_stored(entry)


def cached_text(entry: Entry, make: Callable[[], str]) -> str:
    """Return a text from memory or from the disk cache, or make it and store it there."""
    if entry.name not in _texts:
        content = read(entry)
        if content is None:
            content = make().encode()
            store(entry, content)
        _texts[entry.name] = content.decode()
    return _texts[entry.name]


log = logging.getLogger("rigidmc")
# LLVM evaluates functions of constants, such as sin(0.3), at compile time
_C_LIBRARY = " ".join(platform.libc_ver())
_TOLD: set[str] = set()  # folders whose failure has been logged
_STAMP = re.compile("[0-9a-f]{32}")
_MARK = "made-by-rigidmc"  # an empty file in each folder of kernels
_KEEP_SECONDS = 30 * 86400  # code that no process reads for a month is deleted


@functools.cache
def compiler_stamp() -> str:
    """Return a hash of the compilers, of the sources that call them, of NumPy and the C library.

    Compilers may compute with functions of the two libraries. Any change makes every cached kernel
    stale.
    """
    # Everything that decides code except the CPU, which is in the names of files.
    compilers = f"{sys.version} numba {numba.__version__} llvmlite {llvmlite.__version__}"
    libraries = f"numpy {np.__version__} {_C_LIBRARY}"
    sources = source_stamp("rigidmc.engine.compiler.kernels")
    return hashlib.sha256(f"{compilers} {libraries} {sources}".encode()).hexdigest()[:32]


def cache_folder() -> str:
    """Return the folder of compiled kernels: a subfolder of RIGIDMC_CACHE_DIR if that is set, else
    one in the user's cache folder."""
    named = os.environ.get("RIGIDMC_CACHE_DIR")
    if named:
        return os.path.join(named, "rigidmc-kernels")
    return os.path.join(platformdirs.user_cache_dir("rigidmc", appauthor=False), "kernels")


def cache_home() -> str:
    """Return the folder of the cache, created if missing; raise OSError if it is unusable."""
    if named := os.environ.get("RIGIDMC_CACHE_DIR"):
        make_private(named)
    return make_private(cache_folder())


def kernel_folder() -> str:
    """Return the kernel folder of these compilers; raise OSError if it is unusable."""
    folder = make_private(os.path.join(cache_home(), compiler_stamp()))
    with contextlib.suppress(FileExistsError):
        os.close(os.open(os.path.join(folder, _MARK), os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600))
    return folder


def make_private(folder: str) -> str:
    """Create a folder that only this user can write to; raise OSError if that is impossible.

    A folder of other users is not touched: files planted there could lead anywhere.
    """
    os.makedirs(folder, mode=0o700, exist_ok=True)
    facts = os.stat(folder)
    if hasattr(os, "getuid") and (
        facts.st_uid != os.getuid() or stat.S_IMODE(facts.st_mode) & 0o022
    ):
        rule = "is not private to this user; nothing is read from it or written to it"
        raise PermissionError(f"{folder} {rule}")
    if not os.access(folder, os.W_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), folder)
    return folder


@functools.cache  # once a process, when it stores its first kernel
def delete_unread() -> None:
    """Delete the kernels that no process has read for a month, and folders left empty.

    This touches only folders with the name and the mark of such kernels.
    """
    for folder in os.scandir(cache_home()):
        if not (_STAMP.fullmatch(folder.name) and folder.is_dir(follow_symlinks=False)):
            continue
        with contextlib.suppress(OSError):  # no mark; or another process deletes it
            marked = os.lstat(os.path.join(folder.path, _MARK)).st_mtime
            newest = max(marked, *map(_delete_if_unread, os.scandir(folder.path)), 0.0)
            if time.time() - newest > _KEEP_SECONDS:
                shutil.rmtree(folder.path)


def _delete_if_unread(file: os.DirEntry[str]) -> float:
    """Return the time when a file was last read; delete a kernel or text unread for a month."""
    read = file.stat(follow_symlinks=False).st_mtime
    if file.name != _MARK and time.time() - read > _KEEP_SECONDS:
        os.unlink(file.path)
    return read


def log_once(error: Exception) -> None:
    """Log, once per process, that the cache is unusable."""
    folder = cache_folder()
    if folder not in _TOLD:
        _TOLD.add(folder)
        text = "cannot use the kernel cache %s, so every process recompiles kernels: %s"
        log.warning(text, folder, error)
