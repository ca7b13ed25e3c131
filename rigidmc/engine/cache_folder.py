"""The folder of the disk cache, and what may be kept in it."""

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
from typing import Any

import llvmlite
import numba
import numpy as np
import platformdirs

log = logging.getLogger("rigidmc")
_PACKAGE = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
# LLVM computes functions of constants, such as sin(0.3), when it compiles
_C_LIBRARY = " ".join(platform.libc_ver())
_TOLD: set[str] = set()  # folders whose failure has been logged
_STAMP = re.compile("[0-9a-f]{32}")
_MARK = "made-by-rigidmc"  # an empty file in each folder of kernels
_KEEP_SECONDS = 30 * 86400  # kernels of other versions of the sources are deleted after a month


@functools.cache  # sources that change later are not those that this process has loaded
def source_stamp() -> str:
    """Hash of all the package's sources, of the compilers, and of the libraries whose functions
    they may compute with: NumPy and C's.

    A change of any makes every cached kernel stale.
    """
    compilers = f"{sys.version} numba {numba.__version__} llvmlite {llvmlite.__version__}"
    libraries = f"numpy {np.__version__} {_C_LIBRARY}"
    digest = hashlib.sha256(f"{compilers} {libraries}".encode())
    for folder, folders, files in os.walk(_PACKAGE):
        folders.sort()
        for name in sorted(files):
            if name.endswith(".py"):
                with open(os.path.join(folder, name), "rb") as file:
                    digest.update(name.encode() + b"\0" + file.read())
    return digest.hexdigest()[:32]


def cache_folder() -> str:
    """Where compiled kernels are kept: a folder of our own in RIGIDMC_CACHE_DIR, or else in the
    user's cache folder."""
    named = os.environ.get("RIGIDMC_CACHE_DIR")
    if named:
        return os.path.join(named, "rigidmc-kernels")
    return os.path.join(platformdirs.user_cache_dir("rigidmc", appauthor=False), "kernels")


def home() -> str:
    """The folder of the cache, made if there is none; OSError if it cannot be used."""
    if named := os.environ.get("RIGIDMC_CACHE_DIR"):
        private(named)
    return private(cache_folder())


def kernels() -> str:
    """The folder of the kernels of these sources and compilers; OSError if it cannot be used."""
    folder = private(os.path.join(home(), source_stamp()))
    with contextlib.suppress(FileExistsError):
        os.close(os.open(os.path.join(folder, _MARK), os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600))
    return folder


def private(folder: str) -> str:
    """Make a folder that only this user can write to; OSError if that cannot be.

    A folder of others is not touched: what they planted there could lead anywhere.
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


def forget_old(stamp: str) -> None:
    """Delete the kernels of other versions of the sources after a month: folders that have the
    name and the mark of such kernels, and nothing else."""
    for entry in os.scandir(home()):
        with contextlib.suppress(OSError):  # another process deletes it
            facts = entry.stat(follow_symlinks=False)
            ours = _STAMP.fullmatch(entry.name) and stat.S_ISDIR(facts.st_mode)
            if ours and entry.name != stamp and time.time() - facts.st_mtime > _KEEP_SECONDS:
                os.lstat(os.path.join(entry.path, _MARK))  # raises if it is not there
                shutil.rmtree(entry.path, ignore_errors=True)


def log_once(error: Exception) -> None:
    """Log, once in a process, that the cache cannot be used."""
    folder = cache_folder()
    if folder not in _TOLD:
        _TOLD.add(folder)
        text = "kernels are compiled anew in every process, as their cache %s cannot be used: %s"
        log.warning(text, folder, error)


def classes_of(signature: Any) -> list[type]:
    """All the NamedTuples of a signature, those within tuples included."""
    classes, pending = [], list(getattr(signature, "args", signature))  # a signature, or its types
    while pending:
        kind = pending.pop()
        if hasattr(kind, "instance_class"):
            classes.append(kind.instance_class)
        if hasattr(kind, "__iter__"):
            pending.extend(kind)
    return classes


def of_package(signature: Any) -> bool:
    """Whether all the NamedTuples of a signature are the package's."""
    return all(kind.__module__.startswith("rigidmc.") for kind in classes_of(signature))
