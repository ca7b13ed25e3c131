"""Effects that a user wrote: found in a Python file, run only if the user allowed it."""

import importlib.util
import os
import traceback
from types import ModuleType
from typing import Any

from rigidmc.dynamics.methods import implements
from rigidmc.effects.protocol import Effect
from rigidmc.errors import SceneError, nearest

# How many numbers each method of an effect returns.
RESULT_SIZES = {
    "torque": 3,
    "kick": 3,
    "shake": 3,
    "torque_rate": 3,
    "energy": 1,
    "energy_scale": 1,
}
RULE = (
    "kernels take floats and small tuples in and out: no arrays, no lists, no calls but of math, "
    "and no loop whose length depends on numbers"
)

_modules: dict[tuple[str, int], ModuleType] = {}  # by path and time of the last change


def class_of(folder: str, path: str, name: str, table: str) -> type[Effect]:
    """The class of an effect in a Python file, which is run: call it only if the user allowed it.

    folder : of the scene file, to which `path` is relative
    table : of the scene file, for messages

    Raises SceneError if the file does not exist, is no Python file, fails, or lacks the class.
    """
    file = os.path.realpath(os.path.join(folder, path))
    if not os.path.isfile(file):
        raise SceneError(table, "module", path, f"there is no file {file}")
    if not file.endswith(".py"):
        raise SceneError(table, "module", path, "is no Python file (.py)")
    key = file, os.stat(file).st_mtime_ns
    if key not in _modules:
        _modules[key] = _run(file, path, table)
    classes = {
        word: value
        for word, value in vars(_modules[key]).items()
        if isinstance(value, type) and hasattr(value, "_fields")
    }
    if name not in classes:
        rule = f"has no NamedTuple {name}; it has {', '.join(classes) or 'none'}"
        raise SceneError(table, "module", path, rule, nearest(name, list(classes)))
    return classes[name]


def _run(file: str, path: str, table: str) -> ModuleType:
    spec: Any = importlib.util.spec_from_file_location(f"own_effects_{len(_modules)}", file)
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except Exception as error:  # the user's code may raise anything
        frames = reversed(traceback.extract_tb(error.__traceback__))
        line = next((f.lineno for f in frames if f.filename == file), None)
        where = f" (line {line})" if line else ""
        rule = f"raises {type(error).__name__}{where}: {error}"
        raise SceneError(table, "module", path, rule) from None
    return module


def source_of(kind: type[Effect]) -> str | None:
    """The file of a user's class; None if it is in no file (a notebook, or the shell)."""
    method = next(getattr(kind, name) for name in RESULT_SIZES if implements(kind, name))
    file: str = method.__code__.co_filename
    return os.path.abspath(file) if os.path.isfile(file) else None
