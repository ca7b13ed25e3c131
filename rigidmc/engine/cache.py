"""A private disk cache of compiled code that dies with any change of the sources."""

import hashlib
import logging
import os
import shutil
import stat
import sys
import time

import llvmlite
import numba
import platformdirs

log = logging.getLogger("rigidmc")
_PACKAGE = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
_SUM = hashlib.sha256().digest_size
_TOLD: set[str] = set()
_KEEP_SECONDS = 30 * 86400  # kernels of other versions of the sources are deleted after a month


def source_stamp():
    """Hash of all the package's sources and of the compilers: any change of either makes every cached kernel stale."""
    digest = hashlib.sha256(
        f"{sys.version} numba {numba.__version__} llvmlite {llvmlite.__version__}".encode()
    )
    for folder, folders, files in os.walk(_PACKAGE):
        folders.sort()
        for name in sorted(files):
            if name.endswith(".py"):
                with open(os.path.join(folder, name), "rb") as file:
                    digest.update(name.encode() + b"\0" + file.read())
    return digest.hexdigest()[:32]


def cache_folder():
    """Where compiled kernels are kept: RIGIDMC_CACHE_DIR, else the user's own cache folder."""
    return os.environ.get("RIGIDMC_CACHE_DIR") or os.path.join(
        platformdirs.user_cache_dir("rigidmc", appauthor=False), "kernels"
    )


def _private(folder):
    """Make a folder that only this user can write to; raise OSError where that cannot be had."""
    os.makedirs(folder, mode=0o700, exist_ok=True)
    facts = os.stat(folder)
    if hasattr(os, "getuid") and (
        facts.st_uid != os.getuid() or stat.S_IMODE(facts.st_mode) & 0o022
    ):
        raise PermissionError(
            f"{folder} is not private to this user; compiled code is not loaded from it"
        )
    probe = os.path.join(folder, f".probe-{os.getpid()}")
    with open(probe, "w"):
        pass
    os.unlink(probe)
    return folder


def _forget_old(folder, stamp):
    for name in os.listdir(folder):
        path = os.path.join(folder, name)
        if (
            name != stamp
            and os.path.isdir(path)
            and time.time() - os.stat(path).st_mtime > _KEEP_SECONDS
        ):
            shutil.rmtree(path, ignore_errors=True)


def cached(kernel):
    """Give a jitted kernel the private disk cache. One that cannot be read or written costs the time to compile, and one log line that names it."""
    try:
        folder = _private(os.path.join(_private(cache_folder()), source_stamp()))
        _forget_old(cache_folder(), os.path.basename(folder))

        cache, files = _kinds(folder)
        kernel._cache = cache(kernel.py_func)
        kernel._cache._cache_file = files(folder, "kernel", os.path.basename(folder))
    except (ImportError, AttributeError, OSError, RuntimeError) as error:
        _uncached(error)
    return kernel


def _kinds(folder):
    """Numba's classes of a cache and of its files, for a folder."""
    from numba.core import caching

    class Locator(caching._CacheLocator):
        get_cache_path = staticmethod(lambda: folder)
        get_source_stamp = staticmethod(lambda: os.path.basename(folder))
        get_disambiguator = staticmethod(lambda: "kernel")
        from_function = classmethod(lambda cls, function, file: cls())

    class Implementation(caching.CompileResultCacheImpl):
        _locator_classes: list = [Locator]

    class Files(caching.IndexDataCacheFile):
        """One file for each kernel, named by its key: processes that compile at once cannot mix up their entries.

        Behind what Numba writes stands its sha256: a file with a flipped bit is code that crashes, and none of it is loaded.
        """

        def _name(self, key):
            homes = [
                kind.__module__ for kind in _classes(key[0])
            ]  # the text of a type leaves its module out
            return hashlib.sha256(repr((key, homes)).encode()).hexdigest() + ".nbc"

        def _dump(self, obj):
            data = super()._dump(obj)
            return data + hashlib.sha256(data).digest()

        def save(self, key, data):
            try:
                self._save_data(self._name(key), data)
            except OSError as error:
                _uncached(error)

        def load(self, key):
            path = self._data_path(self._name(key))
            try:
                with open(path, "rb") as file:
                    data = file.read()
                if hashlib.sha256(data[:-_SUM]).digest() == data[-_SUM:]:
                    return self._load_data(self._name(key))  # which ends before the sum
                os.unlink(path)
            except FileNotFoundError:
                return None
            except Exception as error:  # unreadable, or of another version
                _uncached(error)
            return None

    class Cache(caching.FunctionCache):
        """Knows only the package's own types: a user's class of the same name may have other physics."""

        _impl_class = Implementation

        def load_overload(self, signature, context):
            return super().load_overload(signature, context) if _own(signature) else None

        def save_overload(self, signature, data):
            if _own(signature):
                super().save_overload(signature, data)

    return Cache, Files


def is_kept(kernel, signature):
    """Whether the disk cache keeps a kernel for a signature, once it is compiled."""
    return hasattr(kernel._cache, "_cache_file") and _own(signature)


def is_cached(kernel, signature):
    """Whether the disk cache has a kernel for a signature, by the name of its file: nothing is read."""
    if not is_kept(kernel, signature):
        return False
    files = kernel._cache._cache_file
    return os.path.exists(
        files._data_path(
            files._name(kernel._cache._index_key(signature, kernel.targetctx.codegen()))
        )
    )


def _uncached(error):
    """Say of a cache, once in a process, that it cannot be used."""
    folder = cache_folder()
    if folder not in _TOLD:
        _TOLD.add(folder)
        log.warning(
            "kernels are compiled anew in every process, as their cache %s cannot be used: %s",
            folder,
            error,
        )


def _classes(signature):
    """All the NamedTuples of a signature, those within tuples included."""
    found, pending = [], list(getattr(signature, "args", signature))
    while pending:
        kind = pending.pop()
        if hasattr(kind, "instance_class"):
            found.append(kind.instance_class)
        pending.extend(kind) if hasattr(kind, "__iter__") else None
    return found


def _own(signature):
    """Whether all the NamedTuples of a signature are the package's."""
    return all(kind.__module__.startswith("rigidmc.") for kind in _classes(signature))
