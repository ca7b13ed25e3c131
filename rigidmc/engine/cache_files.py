"""Numba's classes of a disk cache, changed: names of files, checksums, and what is kept.

They build on private parts of Numba; `rigidmc.engine.cache` does without them if these change.
"""

import hashlib
import io
import math
import os
import pickle
import re
from collections import Counter
from typing import Any

from numba.core import caching
from numba.core.serialize import NumbaPickler

from rigidmc.engine.cache_folder import classes_of, log_once, of_package
from rigidmc.engine.own_stamps import homes_of
from rigidmc.files.opening import plain

_SUM = hashlib.sha256().digest_size
# Modules that a file may name
_KNOWN = re.compile(r"(numba|numpy|rigidmc|builtins|copyreg|collections)(\.|$)")
# What code of the user's own may call: functions of LLVM, and of C if Python's math has them too.
_CALLED = re.compile(rf"llvm\.|(numba_)?({'|'.join(dir(math))})f?$")
_PRIVATE = 8, 9  # linkages of LLVM's that no other code sees: internal, private


class Files(caching.IndexDataCacheFile):
    """One file for each kernel, named by its key: processes that compile at once do not collide.

    Behind what Numba writes stands its sha256: code with a flipped bit would crash, and is not
    loaded.
    """

    def _name(self, key: Any) -> str:
        homes = homes_of(key[0])  # the text of a type has no module
        return hashlib.sha256(repr((key, homes)).encode()).hexdigest() + ".nbc"

    def save(self, key: Any, data: Any) -> None:
        try:
            file = io.BytesIO()
            _Pickler(file, _own(key[0])).dump(data)
            packed = file.getvalue()
            with self._open_for_write(self._data_path(self._name(key))) as file:
                file.write(packed + hashlib.sha256(packed).digest())
        except OSError as error:
            log_once(error)

    def load(self, key: Any) -> Any:
        path = self._data_path(self._name(key))
        try:
            with open(path, "rb", opener=plain) as file:
                data = file.read()
            if hashlib.sha256(data[:-_SUM]).digest() == data[-_SUM:]:
                return _Unpickler(io.BytesIO(data), _own(key[0])).load()
            os.unlink(path)
        except FileNotFoundError:
            return None
        except Exception as error:  # unreadable, or of another version
            log_once(error)
        return None


def _own(signature: Any) -> list[type]:
    """The classes of the user's own in a signature."""
    return [one for one in classes_of(signature) if not one.__module__.startswith("rigidmc.")]


class _Pickler(NumbaPickler):
    """Writes a class of the user's own by its place in the signature: its name is that of another
    class in another process. Nothing else of the user's is written."""

    def __init__(self, file: Any, own: list[type]) -> None:
        super().__init__(file, protocol=4)
        self._places = {id(kind): place for place, kind in enumerate(own)}

    def persistent_id(self, obj: Any) -> int | None:
        return self._places.get(id(obj)) if isinstance(obj, type) else None


class _Unpickler(pickle.Unpickler):
    """Reads what `_Pickler` writes."""

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
    """Whether code stands by itself: one function, which calls known ones by their names and has no
    address of this process.

    Numba names others, and its environments of functions, by a count in the process: the same name
    is another function in the next process, and would be called for it.
    """
    library, module = code.library, code.library._final_module
    text = str(module)
    if library.has_dynamic_globals or code.reload_init or code.lifted or "inttoptr (" in text:
        return False
    defined = [one.name for one in module.functions if not one.is_declaration]
    called = [one.name for one in module.functions if one.is_declaration]
    if defined != [code.fndesc.llvm_func_name] or not all(map(_CALLED.match, called)):
        return False
    named = Counter(re.findall(r"@([-\w$.]+)", text))
    return all(
        named[one.name] == 1  # where it is defined
        if one.name.startswith("_ZN08NumbaEnv")
        else one.linkage.value in _PRIVATE
        for one in module.global_variables
    )


def cache_class(folder: str) -> Any:
    """The class of a cache, for a folder."""

    class Locator(caching._CacheLocator):
        get_cache_path = staticmethod(lambda: folder)
        get_source_stamp = staticmethod(lambda: os.path.basename(folder))
        get_disambiguator = staticmethod(lambda: "kernel")
        from_function = classmethod(lambda cls, function, file: cls())

    class Implementation(caching.CompileResultCacheImpl):
        _locator_classes: list[Any] = [Locator]

        def reduce(self, cres: Any) -> Any:
            # without the environments of functions, which no piece uses
            return *super().reduce(cres)[:-1], ()

    class Cache(caching.FunctionCache):
        """Keeps what is compiled for types whose classes are known, see `own_stamps`."""

        _impl_class = Implementation

        def load_overload(self, signature: Any, context: Any) -> Any:
            known = homes_of(signature) is not None
            return super().load_overload(signature, context) if known else None

        def save_overload(self, signature: Any, data: Any) -> None:
            known = homes_of(signature) is not None
            if known and (of_package(signature) or is_closed(data)):
                super().save_overload(signature, data)

    return Cache
