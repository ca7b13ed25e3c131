"""Compilation of some kernels in a second process, while this one compiles others.

The first use of a program then takes little more than half as long. Numba holds Python's global
lock, so threads would not help. The other process puts code into the disk cache, where this one
finds it. It receives the names of functions and NamedTuples of the package. If it fails or is slow,
this process compiles everything itself.
"""

import contextlib
import importlib
import json
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from rigidmc.engine.compiler.kernels import KernelKey, compile_kernel, is_cacheable
from rigidmc.engine.kernel.arguments import record_type
from rigidmc.engine.machine import threads_available
from rigidmc.processes.helpers import can_start, start_helper

PATIENCE = 60.0  # [s] for work of 1 to 3 s on two cores


def helper_can(keys: Mapping[str, KernelKey]) -> list[str]:
    """Return names of the kernels that another process could compile.

    These are the kernels that the disk cache stores, if there is another core and a Python to
    start.

    keys : by the names of the kernels
    """
    if not can_start() or threads_available() < 2:
        return []
    return [name for name, key in keys.items() if is_cacheable(key)]


@contextlib.contextmanager
def compile_in_helper(keys: Sequence[KernelKey]) -> Iterator[None]:
    """Compile kernels in another process while the body runs.

    At the end the other process has finished or is stopped.
    """
    process = _start_helper(keys) if keys else None
    try:
        yield
        if process is not None:
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(PATIENCE)
    finally:
        if process is not None:
            process.kill()
            process.wait()


def _start_helper(keys: Sequence[KernelKey]) -> subprocess.Popen[str] | None:
    """Return the process, None if the system cannot start one."""
    written = [_to_json((_name(key.function), *key[1:-2], key.tangents)) for key in keys]
    try:
        process = start_helper(__name__, answers=False)
    except OSError:
        return None
    assert process.stdin is not None
    with contextlib.suppress(OSError), process.stdin as pipe:
        json.dump(written, pipe)
    return process


def main() -> None:
    """Compile the kernels listed on standard input."""
    for name, parts, dtype, lanes, arguments, tangents in map(_from_json, json.load(sys.stdin)):
        record = record_type(dtype) if "r" in arguments else None
        compile_kernel(KernelKey(_lookup(name), parts, dtype, lanes, arguments, record, tangents))


def _name(thing: Callable[..., Any]) -> str:
    """Return the name of a function or class, as `_lookup` reads it."""
    return f"{thing.__module__}:{thing.__qualname__}"


def _lookup(name: str) -> Any:
    """Return the function or class of a name; raise ImportError if it is not of this package."""
    module, _, word = name.partition(":")
    # Input from a pipe must not import arbitrary modules.
    if not module.startswith("rigidmc."):
        raise ImportError(f"{name} is not of this package")
    return getattr(importlib.import_module(module), word)


def _to_json(part: Any) -> Any:
    """Convert nested NamedTuples, tuples and numbers to JSON."""
    if not isinstance(part, tuple):
        return part
    return [_name(type(part)) if hasattr(part, "_fields") else "", *map(_to_json, part)]


def _from_json(part: Any) -> Any:
    """Convert the output of `_to_json` back."""
    if not isinstance(part, list):
        return part
    kind, *parts = part
    return _lookup(kind)(*map(_from_json, parts)) if kind else tuple(map(_from_json, parts))
