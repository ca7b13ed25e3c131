"""Pieces compiled in a second process, while this one compiles others of the same program: the first use of a program takes little more than half as long.

The other process puts code into the disk cache, where this one finds it. It is told what to compile by the names of functions and NamedTuples of the
package, and where it fails, or is slow, this process compiles everything itself.
"""

import contextlib
import importlib
import json
import os
import subprocess
import sys
from typing import Any, cast

from rigidmc.engine.frame import frame_type
from rigidmc.engine.machine import threads_available
from rigidmc.engine.pieces import is_kept, piece

PATIENCE = 60.0  # [s] for what takes 1 to 3 s on two cores


def helped(asked):
    """Names of the pieces that another process could compile: those that the disk cache keeps, where there is another core. asked : {name: what `piece` takes}"""
    named_python = "python" in os.path.basename(sys.executable or "").lower() and not hasattr(
        sys, "frozen"
    )
    if not named_python or threads_available() < 2:
        return []
    return [name for name, one in asked.items() if is_kept(*one)]


@contextlib.contextmanager
def beside(asked):
    """Have some pieces compiled by another process within this; at its end it has compiled them, or given up. asked : list of what `piece` takes"""
    process = _started(asked) if asked else None
    try:
        yield
        if process is not None:
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(PATIENCE)
    finally:
        if process is not None:
            process.kill()
            process.wait()


def _started(asked):
    """The process, None where the system does not give one."""
    written = [
        [_name(function), _written(parts), dtype, lanes, arguments]
        for function, parts, dtype, lanes, arguments in asked
    ]
    path = os.pathsep.join(p or os.getcwd() for p in sys.path)
    try:
        process = subprocess.Popen(
            [sys.executable, "-P", "-c", f"from {__name__} import main; main()"], env={**os.environ, "PYTHONPATH": path},
            stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, text=True,
            creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
        )  # fmt: skip
    except OSError:
        return None
    with contextlib.suppress(OSError), cast(Any, process.stdin) as told:
        json.dump(
            written, told, default=lambda record: None
        )  # the record that `advance` takes follows from its precision
    return process


def main():
    """Compile what is written on the standard input."""
    for function, parts, dtype, lanes, arguments in json.load(sys.stdin):
        piece(_named(function), _read(parts), dtype, lanes, arguments or frame_type(dtype))


def _name(thing):
    return f"{thing.__module__}:{thing.__qualname__}"


def _named(name):
    module, _, word = name.partition(":")
    if not module.startswith("rigidmc."):
        raise ImportError(f"{name} is not of this package")
    return getattr(importlib.import_module(module), word)


def _written(part):
    """Nested NamedTuples, tuples and numbers as JSON can have them."""
    if not isinstance(part, tuple):
        return part
    return [_name(type(part)) if hasattr(part, "_fields") else "", *map(_written, part)]


def _read(part):
    if not isinstance(part, list):
        return part
    kind, *parts = part
    return _named(kind)(*map(_read, parts)) if kind else tuple(map(_read, parts))
