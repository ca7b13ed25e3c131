"""A private disk cache of compiled code, which any change of the sources makes stale."""

import contextlib
import hashlib
import os
from collections.abc import Callable, Sequence
from typing import Any

from rigidmc.engine.cache_folder import forget_old, kernels, log_once, of_package
from rigidmc.engine.own_stamps import homes_of
from rigidmc.files.opening import plain


def cached(kernel: Any) -> Any:
    """Give a jitted kernel the private disk cache.

    If the cache cannot be read or written, the kernel is compiled in every process, and one line of
    the log says so.
    """
    try:
        folder = kernels()
        stamp = os.path.basename(folder)
        forget_old(stamp)
        from rigidmc.engine.cache_files import Files, cache_class  # fails if Numba changes

        kernel._cache = cache_class(folder)(kernel.py_func)
        kernel._cache._cache_file = Files(folder, "kernel", stamp)
    except (ImportError, AttributeError, OSError, RuntimeError) as error:
        log_once(error)
    return kernel


def is_kept(kernel: Any, signature: Any) -> bool:
    """Whether the disk cache keeps a kernel that another process can compile: one of the package's
    classes."""
    return hasattr(kernel._cache, "_cache_file") and of_package(signature)


def is_cached(kernel: Any, signature: Any) -> bool:
    """Whether the disk cache has a kernel for a signature, by the name of its file."""
    if not hasattr(kernel._cache, "_cache_file") or homes_of(signature) is None:
        return False
    files = kernel._cache._cache_file
    key = kernel._cache._index_key(signature, kernel.targetctx.codegen())
    return os.path.exists(files._data_path(files._name(key)))


_texts: dict[tuple[Any, ...], str] = {}  # of this process


def text_path(signatures: Sequence[Any], more: str) -> str | None:
    """The file of a text that follows from the types of pieces and from `more`, None if a class
    among the types has no stamp; OSError if there is no cache."""
    homes = [homes_of(one) for one in signatures]
    if None in homes:
        return None
    name = hashlib.sha256(repr((signatures, homes, more)).encode()).hexdigest()
    return os.path.join(kernels(), name)


def has_text(signatures: Sequence[Any], more: str) -> bool:
    """Whether the text of `kept_text` is in memory or in the disk cache."""
    if (*signatures, more) in _texts:
        return True
    with contextlib.suppress(OSError):  # there is no cache
        path = text_path(signatures, more)
        return path is not None and os.path.exists(path)
    return False


def kept_text(signatures: Sequence[Any], more: str, make: Callable[[], str]) -> str:
    """The text that `make` makes, which follows from the types of pieces and from `more`.

    From memory, or from the disk cache, where its sha256 stands before it.
    """
    key = (*signatures, more)
    if key not in _texts:
        _texts[key] = _from_disk(signatures, more, make)
    return _texts[key]


def _from_disk(signatures: Sequence[Any], more: str, make: Callable[[], str]) -> str:
    """The text from the disk cache, or made and put there."""
    path = None
    try:
        path = text_path(signatures, more)
        if path is not None:
            with (
                contextlib.suppress(FileNotFoundError),
                open(path, encoding="ascii", opener=plain) as file,
            ):
                known, _, text = file.read().partition("\n")
                if known == hashlib.sha256(text.encode()).hexdigest():
                    return text
    except (OSError, ValueError) as error:
        log_once(error)
    text = make()
    if path is not None:
        with contextlib.suppress(OSError):
            if text_path(signatures, more) != path:  # a class has changed meanwhile
                return text
            with open(f"{path}.{os.getpid()}", "w", encoding="ascii", opener=plain) as file:
                file.write(f"{hashlib.sha256(text.encode()).hexdigest()}\n{text}")
            os.replace(file.name, path)
    return text
