"""A private disk cache of compiled code, which any change of the sources makes stale."""

import os
from typing import Any

from rigidmc.engine.cache_folder import (
    cache_folder,
    forget_old,
    log_once,
    of_package,
    private,
    source_stamp,
)


def cached(kernel: Any) -> Any:
    """Give a jitted kernel the private disk cache.

    If the cache cannot be read or written, the kernel is compiled in every process, and one line of
    the log says so.
    """
    try:
        folder = private(os.path.join(private(cache_folder()), source_stamp()))
        stamp = os.path.basename(folder)
        forget_old(cache_folder(), stamp)
        from rigidmc.engine.cache_files import Files, cache_class  # fails if Numba changes

        kernel._cache = cache_class(folder)(kernel.py_func)
        kernel._cache._cache_file = Files(folder, "kernel", stamp)
    except (ImportError, AttributeError, OSError, RuntimeError) as error:
        log_once(error)
    return kernel


def is_kept(kernel: Any, signature: Any) -> bool:
    """Whether the disk cache keeps a kernel for a signature, once it is compiled."""
    return hasattr(kernel._cache, "_cache_file") and of_package(signature)


def is_cached(kernel: Any, signature: Any) -> bool:
    """Whether the disk cache has a kernel for a signature, by the name of its file."""
    if not is_kept(kernel, signature):
        return False
    files = kernel._cache._cache_file
    key = kernel._cache._index_key(signature, kernel.targetctx.codegen())
    return os.path.exists(files._data_path(files._name(key)))
