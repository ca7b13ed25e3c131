"""The folder of the disk cache, and what may be kept in it."""

import hashlib
import logging
import os
import shutil
import stat
import sys
import time
from typing import Any

import llvmlite
import numba
import platformdirs

log = logging.getLogger("rigidmc")
_PACKAGE = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
_TOLD: set[str] = set()  # folders whose failure has been logged
_KEEP_SECONDS = 30 * 86400  # kernels of other versions of the sources are deleted after a month


def source_stamp() -> str:
    """Hash of all the package's sources and of the compilers.

    A change of either makes every cached kernel stale.
    """
    compilers = f"{sys.version} numba {numba.__version__} llvmlite {llvmlite.__version__}"
    digest = hashlib.sha256(compilers.encode())
    for folder, folders, files in os.walk(_PACKAGE):
        folders.sort()
        for name in sorted(files):
            if name.endswith(".py"):
                with open(os.path.join(folder, name), "rb") as file:
                    digest.update(name.encode() + b"\0" + file.read())
    return digest.hexdigest()[:32]


def cache_folder() -> str:
    """Where compiled kernels are kept: RIGIDMC_CACHE_DIR, else the user's cache folder."""
    return os.environ.get("RIGIDMC_CACHE_DIR") or os.path.join(
        platformdirs.user_cache_dir("rigidmc", appauthor=False), "kernels"
    )


def private(folder: str) -> str:
    """Make a folder that only this user can write to; OSError if that cannot be."""
    os.makedirs(folder, mode=0o700, exist_ok=True)
    facts = os.stat(folder)
    if hasattr(os, "getuid") and (
        facts.st_uid != os.getuid() or stat.S_IMODE(facts.st_mode) & 0o022
    ):
        rule = "is not private to this user; compiled code is not loaded from it"
        raise PermissionError(f"{folder} {rule}")
    probe = os.path.join(folder, f".probe-{os.getpid()}")
    with open(probe, "w"):
        pass
    os.unlink(probe)
    return folder


def forget_old(folder: str, stamp: str) -> None:
    """Delete the kernels of other versions of the sources after a month."""
    for name in os.listdir(folder):
        path = os.path.join(folder, name)
        other = name != stamp and os.path.isdir(path)
        if other and time.time() - os.stat(path).st_mtime > _KEEP_SECONDS:
            shutil.rmtree(path, ignore_errors=True)


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
