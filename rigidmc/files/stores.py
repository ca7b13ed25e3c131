"""Objects of a store, such as s3://bucket/run, through fsspec; the only module that knows stores.

A store has no locks, no renames and no folders. One thing is certain: to put an object is atomic,
so readers see all of it or nothing. Files are therefore written here first and put whole.

fsspec is imported when a path is a URL, so nothing is loaded, and nothing on the network is asked,
unless the user names a URL.
"""

import contextlib
import errno
import os
import re
import tempfile
from collections.abc import Iterator
from typing import Any

from rigidmc.errors import FileError, OptionError, OutputExists, RigidmcError, nearest
from rigidmc.files.outputs import Path

_URL = re.compile(r"([A-Za-z][A-Za-z0-9+.-]+)://(.+)")  # two letters: C:// is a disk of Windows
_PACKAGES = {"s3": "s3fs", "gs": "gcsfs", "gcs": "gcsfs", "az": "adlfs", "abfs": "adlfs"}
# what fsspec calls the time of an object, by store
_TIMES = ("LastModified", "mtime", "created", "updated", "last_modified")


def is_url(path: Path) -> bool:
    """Return whether a path is a URL of a store."""
    return _URL.fullmatch(os.fspath(path)) is not None


def is_folder(path: Path) -> bool:
    """Return whether a path can be a run directory: a folder, or a URL."""
    return is_url(path) or os.path.isdir(path)


def absolute(path: Path) -> str:
    """Return the absolute path of a file or folder, or the URL itself."""
    return os.fspath(path) if is_url(path) else os.path.abspath(path)


def join(folder: str, name: str) -> str:
    """Return the path of a name in a folder, or its URL."""
    return f"{folder.rstrip('/')}/{name}" if is_url(folder) else os.path.join(folder, name)


class Store:
    """The objects below a URL.

    Raises OptionError if its protocol is unknown or needs a package that is not installed,
    FileError if the store does not answer or refuses.
    """

    def __init__(self, url: str) -> None:
        self.url = url.rstrip("/")
        protocol = url.partition("://")[0]
        try:
            import fsspec
        except ImportError as error:
            rule = f"needs fsspec: pip install 'rigidmc[store]' ({error})"
            raise OptionError(rule, at="run", value=url) from None
        protocols = [name for name in fsspec.available_protocols() if name not in ("file", "local")]
        if protocol not in protocols:
            rule = "is not a store that fsspec knows; a folder here has no ://"
            close = nearest(protocol, protocols)
            raise OptionError(rule, at="run", value=url, nearest=close and f"{close}://") from None
        try:
            with _naming(url):
                self._files, self._root = fsspec.core.url_to_fs(self.url)
        except ImportError as error:
            package = _PACKAGES.get(protocol, f"of {protocol}")
            rule = f"needs the package {package}: pip install {package} ({error})"
            raise OptionError(rule, at="run", value=url) from None

    def _object(self, name: str) -> str:
        return f"{self._root}/{name}"

    def listed(self, folder: str = "") -> dict[str, float]:
        """Return {name: time of its last change, 0 if unknown} of the objects in a folder."""
        place = self._object(folder) if folder else self._root
        with _naming(self.url):
            self._files.invalidate_cache()  # other machines write here
            try:
                entries = self._files.ls(place, detail=True)
            except FileNotFoundError:  # stores have no empty folders
                return {}
        names = {entry["name"].rstrip("/").rpartition("/")[2]: entry for entry in entries}
        return {name: _time(entry) for name, entry in names.items() if name}

    def get(self, name: str) -> bytes | None:
        """Return the bytes of an object; None if there is none."""
        with _naming(self.url):
            try:
                data: bytes = self._files.cat_file(self._object(name))
            except FileNotFoundError:
                return None
        return data

    def put(self, name: str, data: bytes, new: bool = False) -> None:
        """Put an object whole. new : OutputExists if it exists, where the store can refuse"""
        with _naming(self.url):
            mode = {"mode": "create"} if new else {}
            try:
                self._files.pipe_file(self._object(name), data, **mode)
            except FileExistsError:
                rule = "appeared meanwhile; nothing was overwritten"
                raise OutputExists(f"{self.url}/{name} {rule}") from None
            except FileNotFoundError:
                self.refuse_no_bucket()
                raise

    def upload(self, file: str, name: str) -> None:
        """Put a file whole."""
        with _naming(self.url):
            self._files.put_file(file, self._object(name))

    def download(self, name: str, file: str) -> bool:
        """Get an object as a file; False if there is none."""
        with _naming(self.url):
            try:
                self._files.get_file(self._object(name), file)
            except FileNotFoundError:
                return False
        return True

    def delete(self, name: str) -> None:
        """Delete an object."""
        with _naming(self.url):
            self._files.rm_file(self._object(name))

    def refuse_no_bucket(self) -> None:
        """Raise FileError if the bucket of the URL does not exist."""
        bucket = self._root.partition("/")[0]  # "" where a store has no buckets
        with _naming(self.url):
            there = not bucket or self._files.exists(bucket)
        if not there:
            raise FileError(f"there is no bucket '{bucket}'", at="run", value=self.url)


@contextlib.contextmanager
def local_copy(path: str) -> Iterator[str]:
    """Yield the path of a file here: the path itself, or for a URL a copy with the same name, which
    is deleted at the end. FileError names the URL, FileNotFoundError if there is no such object."""
    if not is_url(path):
        yield path
        return
    folder, _, name = path.rpartition("/")
    with tempfile.TemporaryDirectory(prefix="rigidmc-") as here:
        file = os.path.join(here, name)
        if not Store(folder).download(name, file):
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), path)
        try:
            yield file
        except FileError as error:
            if error.file == file:
                error.file = path
            raise


def _time(facts: dict[str, Any]) -> float:
    time = next((facts[key] for key in _TIMES if facts.get(key)), 0.0)
    return float(time.timestamp() if hasattr(time, "timestamp") else time)


@contextlib.contextmanager
def _naming(url: str) -> Iterator[None]:
    """Turn an error of a store into a FileError that names it; libraries of stores raise many
    kinds, some of which are no OSError."""
    try:
        yield
    except (FileNotFoundError, FileExistsError, ImportError, RigidmcError):
        raise
    except Exception as error:
        words = "access denied: " if isinstance(error, PermissionError) else ""
        text = str(error).partition("\n")[0].rstrip(".") or type(error).__name__
        raise FileError(f"cannot be used: {words}{text}", at="run", value=url) from None
