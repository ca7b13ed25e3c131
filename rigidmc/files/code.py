"""Classes that a user wrote: found in a Python file, which is run only if the user allowed it."""

import importlib.util
import inspect
import os
import sys
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType
from typing import Any

from rigidmc.errors import SceneError, nearest

_modules: dict[tuple[str, int], ModuleType] = {}  # by path and time of the last change


def class_of(folder: str, path: str, name: str, table: str) -> type[Any]:
    """A class in a Python file, which is run: call it only if the user allowed it.

    folder : of the scene file, to which `path` is relative
    name : of the class, or the same in snake_case
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
    module = _modules[key]
    classes: dict[str, type[Any]] = {
        word: value
        for word, value in vars(module).items()
        if isinstance(value, type) and value.__module__ == module.__name__
    }
    found = classes.get(name) or {_plain(word): kind for word, kind in classes.items()}.get(
        _plain(name)
    )
    if found is None:
        rule = f"has no class {name}; it has {', '.join(classes) or 'none'}"
        raise SceneError(table, "module", path, rule, nearest(name, list(classes)))
    return found


def _plain(name: str) -> str:
    """A name without case and underscores: my_law and MyLaw are one."""
    return name.replace("_", "").lower()


def _run(file: str, path: str, table: str) -> ModuleType:
    name = f"own_code_{len(_modules)}"
    spec: Any = importlib.util.spec_from_file_location(name, file)
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # as of any other module: classes find their own there
    try:
        with _beside(os.path.dirname(file)):
            spec.loader.exec_module(module)
    except Exception as error:  # the user's code may raise anything
        del sys.modules[name]
        frames = reversed(traceback.extract_tb(error.__traceback__))
        line = next((f.lineno for f in frames if f.filename == file), None)
        where = f" (line {line})" if line else ""
        rule = f"raises {type(error).__name__}{where}: {error}"
        raise SceneError(table, "module", path, rule) from None
    return module


@contextmanager
def _beside(folder: str) -> Iterator[None]:
    """Let a file import from its own folder what is nowhere else, as from a script. What it has
    imported there is forgotten: in another folder the same name is another file."""
    before, path = set(sys.modules), list(sys.path)
    sys.path.append(folder)  # last: no file of that folder hides a library
    try:
        yield
    finally:
        sys.path[:] = path
        for name in set(sys.modules) - before:
            where = getattr(sys.modules[name], "__file__", None)
            if where and os.path.realpath(where).startswith(os.path.join(folder, "")):
                del sys.modules[name]


def source_of(kind: type[Any]) -> str | None:
    """The file of a user's class; None if it is in no file (a notebook, or the shell)."""
    methods = [
        value
        for name, value in vars(kind).items()
        if inspect.isfunction(value) and not name.startswith("_")
    ]
    files = (method.__code__.co_filename for method in methods)
    return next((os.path.abspath(file) for file in files if os.path.isfile(file)), None)
