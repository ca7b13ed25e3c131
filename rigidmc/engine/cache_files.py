"""Numba's classes of a disk cache, changed: names of files, checksums, and what is kept.

They build on private parts of Numba; `rigidmc.engine.cache` does without them if these change.
"""

import hashlib
import os
from typing import Any

from numba.core import caching

from rigidmc.engine.cache_folder import classes_of, log_once, of_package
from rigidmc.files.opening import plain

_SUM = hashlib.sha256().digest_size


class Files(caching.IndexDataCacheFile):
    """One file for each kernel, named by its key: processes that compile at once do not collide.

    Behind what Numba writes stands its sha256: code with a flipped bit would crash, and is not
    loaded.
    """

    def _name(self, key: Any) -> str:
        homes = [kind.__module__ for kind in classes_of(key[0])]  # the text of a type has no module
        return hashlib.sha256(repr((key, homes)).encode()).hexdigest() + ".nbc"

    def _dump(self, obj: Any) -> bytes:
        data: bytes = super()._dump(obj)
        return data + hashlib.sha256(data).digest()

    def save(self, key: Any, data: Any) -> None:
        try:
            self._save_data(self._name(key), data)
        except OSError as error:
            log_once(error)

    def load(self, key: Any) -> Any:
        path = self._data_path(self._name(key))
        try:
            with open(path, "rb", opener=plain) as file:
                data = file.read()
            if hashlib.sha256(data[:-_SUM]).digest() == data[-_SUM:]:
                return self._load_data(self._name(key))  # pickle ends before the sum
            os.unlink(path)
        except FileNotFoundError:
            return None
        except Exception as error:  # unreadable, or of another version
            log_once(error)
        return None


def cache_class(folder: str) -> Any:
    """The class of a cache, for a folder."""

    class Locator(caching._CacheLocator):
        get_cache_path = staticmethod(lambda: folder)
        get_source_stamp = staticmethod(lambda: os.path.basename(folder))
        get_disambiguator = staticmethod(lambda: "kernel")
        from_function = classmethod(lambda cls, function, file: cls())

    class Implementation(caching.CompileResultCacheImpl):
        _locator_classes: list[Any] = [Locator]

    class Cache(caching.FunctionCache):
        """Keeps only the package's types: a user's class of the same name may be other physics."""

        _impl_class = Implementation

        def load_overload(self, signature: Any, context: Any) -> Any:
            return super().load_overload(signature, context) if of_package(signature) else None

        def save_overload(self, signature: Any, data: Any) -> None:
            if of_package(signature):
                super().save_overload(signature, data)

    return Cache
