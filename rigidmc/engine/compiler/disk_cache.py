"""A private disk cache of compiled code, invalidated by any change of the sources that it reads.

Its folder is named by a hash of the compilers and of their sources here. Each file is named by a
hash of the kernel's function, of the types that it is compiled for, and of the stamps of their
sources: `source_stamps` for the package, `user_stamps` for custom classes. Each kernel is followed
by its checksum: a flipped bit in machine code would crash. The classes of Numba's disk cache do the
rest; they are private to Numba, and without them every process recompiles.
"""

import contextlib
import errno
import functools
import hashlib
import io
import logging
import math
import os
import pickle
import platform
import re
import shutil
import stat
import sys
import time
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

import llvmlite
import numba
import numpy as np
import platformdirs
from numba.core import caching, types
from numba.core.serialize import NumbaPickler

from rigidmc.engine.compiler.frozen import classes_of, homes_of, is_custom
from rigidmc.engine.compiler.source_stamps import source_stamp
from rigidmc.files.opening import open_plain


def with_cache(kernel: Any) -> Any:
    """Give a jitted kernel the private disk cache.

    If the cache cannot be read or written, every process compiles the kernel, and one line in the
    log says so.
    """
    try:
        folder = kernel_folder()
        # private to Numba: AttributeError if it changes
        kernel._cache = cache_class(folder)(kernel.py_func)
        kernel._cache._cache_file = CacheFiles(folder, home_of(kernel.py_func))
    except (ImportError, AttributeError, OSError, RuntimeError) as error:
        log_once(error)
    return kernel


def keeps_kernel(kernel: Any, signature: Any) -> bool:
    """Return whether the disk cache stores a kernel so that another process can compile it.

    This holds for kernels whose classes are all of the package.
    """
    return hasattr(kernel._cache, "_cache_file") and of_package(signature)


def is_cached(kernel: Any, signature: Any) -> bool:
    """Return whether the disk cache has a kernel for a signature, by the name of its file."""
    if not hasattr(kernel._cache, "_cache_file") or homes_of(signature) is None:
        return False
    files = kernel._cache._cache_file
    key = kernel._cache._index_key(signature, kernel.targetctx.codegen())
    return os.path.exists(files._data_path(files._name(key)))


_texts: dict[tuple[Any, ...], str] = {}  # of this process
# The modules that make texts: code for GPUs and browsers, why a part runs on single members.
_TEXT_MAKERS = "rigidmc.engine.cuda.program", "rigidmc.engine.wasm.program"


def text_path(signatures: Sequence[Any], extra: str) -> str | None:
    """Return the file of a text determined by the types of kernels and `extra`.

    None if a class among the types has no stamp; raises OSError if there is no cache.
    """
    homes = [homes_of(signature) for signature in signatures]
    if None in homes:
        return None
    reads = source_stamp(*_TEXT_MAKERS)
    name = hashlib.sha256(repr((signatures, homes, reads, extra)).encode()).hexdigest()
    return os.path.join(kernel_folder(), name)


def has_text(signatures: Sequence[Any], extra: str) -> bool:
    """Return whether the text of `cached_text` is in memory or in the disk cache."""
    if (*signatures, extra) in _texts:
        return True
    with contextlib.suppress(OSError):  # there is no cache
        path = text_path(signatures, extra)
        return path is not None and os.path.exists(path)
    return False


def cached_text(signatures: Sequence[Any], extra: str, make: Callable[[], str]) -> str:
    """Return the text from `make`, which is determined by the types of kernels and `extra`.

    It comes from memory or from the disk cache, where its sha256 precedes it.
    """
    key = (*signatures, extra)
    if key not in _texts:
        _texts[key] = _from_disk(signatures, extra, make)
    return _texts[key]


def _from_disk(signatures: Sequence[Any], extra: str, make: Callable[[], str]) -> str:
    """Return the text from the disk cache, or make it and store it there."""
    path = None
    try:
        path = text_path(signatures, extra)
        if path is not None:
            with (
                contextlib.suppress(FileNotFoundError),
                open(path, encoding="ascii", opener=open_plain) as file,
            ):
                checksum, _, text = file.read().partition("\n")
                if checksum == hashlib.sha256(text.encode()).hexdigest():
                    os.utime(path)  # see `delete_unread`
                    return text
    except (OSError, ValueError) as error:
        log_once(error)
    text = make()
    if path is not None:
        with contextlib.suppress(OSError):
            with open(f"{path}.{os.getpid()}", "w", encoding="ascii", opener=open_plain) as file:
                file.write(f"{hashlib.sha256(text.encode()).hexdigest()}\n{text}")
            # Written to a temporary file and renamed: no process reads an incomplete file.
            os.replace(file.name, path)
    return text


_SUM = hashlib.sha256().digest_size
# Modules that a file may name: unpickling a name of another module could run anything.
_KNOWN = re.compile(r"(numba|numpy|rigidmc|builtins|copyreg|collections)(\.|$)")
# Functions that custom code may call: of LLVM, and of C if Python's math has them, too. Others are
# addresses in this process.
_CALLED = re.compile(rf"llvm\.|(numba_)?({'|'.join(dir(math))})f?$")
_PRIVATE = 8, 9  # LLVM linkages that no other code sees: internal, private


class CacheFiles(caching.IndexDataCacheFile):
    """One file for each kernel, named by its key: processes that compile at once do not collide.

    Numba's data is followed by its sha256: code with a flipped bit would crash, and is not loaded.

    home : of the kernel's function, see `home_of`
    """

    def __init__(self, folder: str, home: str) -> None:
        super().__init__(folder, "kernel", os.path.basename(folder))
        self.home = home

    def _name(self, key: Any) -> str:
        homes = homes_of(key[0])  # the text of a type does not name its module
        name = repr((self.home, key, homes))
        return hashlib.sha256(name.encode()).hexdigest() + ".nbc"

    def save(self, key: Any, data: Any) -> None:
        try:
            file = io.BytesIO()
            _Pickler(file, _user_classes(key[0])).dump(data)
            packed = file.getvalue()
            with self._open_for_write(self._data_path(self._name(key))) as file:
                file.write(packed + hashlib.sha256(packed).digest())
            delete_unread()
        except OSError as error:
            log_once(error)

    def load(self, key: Any) -> Any:
        path = self._data_path(self._name(key))
        try:
            with open(path, "rb", opener=open_plain) as file:
                data = file.read()
            if hashlib.sha256(data[:-_SUM]).digest() == data[-_SUM:]:
                os.utime(path)  # see `delete_unread`
                return _Unpickler(io.BytesIO(data), _user_classes(key[0])).load()
            os.unlink(path)
        except FileNotFoundError:
            return None
        except Exception as error:  # unreadable, or of another version
            log_once(error)
        return None


def _user_classes(signature: Any) -> list[type]:
    """Return the custom classes in a signature."""
    return list(filter(is_custom, classes_of(signature)))


class _Pickler(NumbaPickler):
    """A pickler that writes a custom class as its place in the signature.

    In another process its name may belong to another class. Nothing else of the user is written.
    """

    def __init__(self, file: Any, own: list[type]) -> None:
        super().__init__(file, protocol=4)
        self._places = {id(kind): place for place, kind in enumerate(own)}

    def persistent_id(self, obj: Any) -> int | None:
        return self._places.get(id(obj)) if isinstance(obj, type) else None

    def reducer_override(self, obj: Any) -> Any:
        # Numba finds the union of the types of a tuple, which no code reads, by their names: it may
        # hold an earlier class of this name.
        if type(obj) is types.UnionType:
            return types.UnionType, ((),)
        return super().reducer_override(obj)


class _Unpickler(pickle.Unpickler):
    """An unpickler for the output of `_Pickler`."""

    def __init__(self, file: Any, own: list[type]) -> None:
        super().__init__(file)
        self._own = own

    def persistent_load(self, pid: Any) -> type:
        kind: type = self._own[pid]
        return kind

    def find_class(self, module: str, name: str) -> Any:
        if not _KNOWN.match(module):
            raise pickle.UnpicklingError(f"a kernel names {module}.{name}")
        return super().find_class(module, name)


def is_closed(code: Any) -> bool:
    """Return whether code stands by itself.

    It must be one function that calls known functions by name and contains no address of this
    process. Numba names other functions, and the environments of functions, by a count in the
    process. In the next process the same name is another function and would be called instead.
    """
    library, module = code.library, code.library._final_module
    text = str(module)
    # "inttoptr (" is a constant address in this process; a computed one has no bracket
    if library.has_dynamic_globals or code.reload_init or code.lifted or "inttoptr (" in text:
        return False
    # All calls are inlined: a second function would be one of Numba's, linked by its name.
    defined = [entry.name for entry in module.functions if not entry.is_declaration]
    called = [entry.name for entry in module.functions if entry.is_declaration]
    if defined != [code.fndesc.llvm_func_name] or not all(map(_CALLED.match, called)):
        return False
    named = Counter(re.findall(r"@([-\w$.]+)", text))
    return all(
        named[entry.name] == 1  # where it is defined
        if entry.name.startswith("_ZN08NumbaEnv")
        else entry.linkage.value in _PRIVATE
        for entry in module.global_variables
    )


def cache_class(folder: str) -> Any:
    """Return the class of a cache for a folder."""

    class Locator(caching._CacheLocator):
        get_cache_path = staticmethod(lambda: folder)
        get_source_stamp = staticmethod(lambda: os.path.basename(folder))
        get_disambiguator = staticmethod(lambda: "kernel")
        from_function = classmethod(lambda cls, function, file: cls())

    class Implementation(caching.CompileResultCacheImpl):
        _locator_classes: list[Any] = [Locator]

        def reduce(self, cres: Any) -> Any:
            # without the environments of functions, which kernels do not use
            return *super().reduce(cres)[:-1], ()

    class Cache(caching.FunctionCache):
        """A cache of code for types whose classes have stamps, see `user_stamps`."""

        _impl_class = Implementation

        def load_overload(self, signature: Any, context: Any) -> Any:
            if homes_of(signature) is None:
                return None
            # Numba's own method first imports all that Numba can compile, with scipy.linalg: 0.3 s
            # of a process that compiles nothing
            with self._guard_against_spurious_io_errors():
                return self._load_overload(signature, context)

        def save_overload(self, signature: Any, data: Any) -> None:
            known = homes_of(signature) is not None
            if known and (of_package(signature) or is_closed(data)):
                super().save_overload(signature, data)

    return Cache


log = logging.getLogger("rigidmc")
# LLVM evaluates functions of constants, such as sin(0.3), at compile time
_C_LIBRARY = " ".join(platform.libc_ver())
_TOLD: set[str] = set()  # folders whose failure has been logged
_STAMP = re.compile("[0-9a-f]{32}")
_MARK = "made-by-rigidmc"  # an empty file in each folder of kernels
_KEEP_SECONDS = 30 * 86400  # code that no process reads for a month is deleted


def home_of(function: Any) -> str:
    """Return an identifier of a kernel's function, with the stamp of the sources that it reads."""
    return f"{function.__module__} {function.__qualname__} {source_stamp(function.__module__)}"


@functools.cache
def compiler_stamp() -> str:
    """Return a hash of the compilers, of the sources that call them, of NumPy and the C library.

    Compilers may compute with functions of the two libraries. Any change makes every cached kernel
    stale.
    """
    # Everything that decides machine code except the CPU, which is in Numba's key.
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


def of_package(signature: Any) -> bool:
    """Return whether all NamedTuples of a signature belong to the package."""
    return not any(map(is_custom, classes_of(signature)))
