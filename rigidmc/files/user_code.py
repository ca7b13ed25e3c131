"""Users' classes: loaded from a Python file, which runs only if the user allowed it."""

import importlib.util
import inspect
import itertools
import os
import sys
import sysconfig
import traceback
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from types import ModuleType
from typing import Any

from rigidmc.errors import PartError, SceneError, nearest

_INSTALLED = tuple(
    os.path.join(path, "")
    for path in {
        *(sysconfig.get_path(word) for word in ("stdlib", "platstdlib", "purelib", "platlib")),
        os.path.dirname(os.path.dirname(os.path.abspath(__file__))),
    }
)
_BESIDE = "__own_files__"  # attribute with the files that a module imported from its folder
_numbers = itertools.count()
# {path: ({file: last change} of it and its imports, the module)}
_modules: dict[str, tuple[dict[str, int], ModuleType]] = {}


def class_of(folder: str, path: str, name: str, at: str) -> type[Any]:
    """Run a Python file and return one of its classes; call this only if the user allowed it.

    folder : folder of the scene file, to which `path` is relative
    name : name of the class, or the same in snake_case
    at : the table of the scene file, for messages

    Raises SceneError if the file does not exist, is not a Python file, fails, or lacks the class.
    """
    file = os.path.realpath(os.path.join(folder, path))
    if not os.path.isfile(file):
        raise SceneError(f"there is no file {file}", at=f"{at}.module", value=path)
    if not file.endswith(".py"):
        raise SceneError("is not a Python file (.py)", at=f"{at}.module", value=path)
    times, module = _modules.get(file, ({}, None))
    if module is None or times != _changed(times):
        module = _run(file, path, at)
        _modules[file] = _changed([file, *getattr(module, _BESIDE)]), module
    classes: dict[str, type[Any]] = {
        word: value
        for word, value in vars(module).items()
        if isinstance(value, type) and value.__module__ == module.__name__
    }
    cls = classes.get(name) or class_named(name, classes.values())
    if cls is None:
        rule = f"has no class {name}; it has {', '.join(classes) or 'none'}"
        close = nearest(name, list(classes))
        raise PartError(rule, at=f"{at}.module", value=path, nearest=close, source=file)
    return cls


def class_named(name: str, classes: Iterable[type[Any]]) -> type[Any] | None:
    """Return the class with a name, or the same in snake_case; None without one."""
    return {_plain(kind.__name__): kind for kind in classes}.get(_plain(name))


def _plain(name: str) -> str:
    """Remove case and underscores from a name: my_law and MyLaw become the same."""
    return name.replace("_", "").lower()


def _run(file: str, path: str, at: str) -> ModuleType:
    name = f"own_code_{next(_numbers)}"
    spec: Any = importlib.util.spec_from_file_location(name, file)
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # as for any module: classes look up their module there
    try:
        with _beside(os.path.dirname(file)) as files:
            spec.loader.exec_module(module)
        setattr(module, _BESIDE, files)
    except Exception as error:  # the user's code may raise anything
        del sys.modules[name]
        frames = reversed(traceback.extract_tb(error.__traceback__))
        line = next((f.lineno for f in frames if f.filename == file), None)
        where = f" (line {line})" if line else ""
        rule = f"raises {type(error).__name__}{where}: {error}"
        raise PartError(rule, at=f"{at}.module", value=path, source=file, line=line) from None
    return module


@contextmanager
def _beside(folder: str) -> Iterator[list[str]]:
    """Let a file import modules from its own folder, after all other places, as a script does.
    Yield a list, which at the end contains the imported files. Python forgets these modules: in
    another folder the same name is another file."""
    before, path, files = set(sys.modules), list(sys.path), list[str]()
    sys.path.append(folder)  # last, so that no file of that folder hides a library
    try:
        yield files
    finally:
        sys.path[:] = path
        for name in set(sys.modules) - before:
            where = os.path.realpath(getattr(sys.modules[name], "__file__", None) or os.sep)
            if where.startswith(os.path.join(folder, "")):
                del sys.modules[name]
                files.append(where)


def _changed(files: Iterable[str]) -> dict[str, int]:
    """Return {file: time of its last change}; 0 for a missing file."""
    return {file: os.stat(file).st_mtime_ns if os.path.isfile(file) else 0 for file in files}


def is_user_code(names: Mapping[str, Any]) -> bool:
    """Return whether a module's namespace comes from a user's file, not from an installed one."""
    file = names.get("__file__")
    return isinstance(file, str) and not os.path.abspath(file).startswith(_INSTALLED)


def is_installed(thing: Any) -> bool:
    """Return whether a function or class comes from Python itself or an installed package."""
    code = getattr(thing, "__code__", None)
    module = sys.modules.get(str(getattr(thing, "__module__", None)))
    file: str | None = code.co_filename if code else getattr(module, "__file__", None)
    if file is None:
        return module is not None and module.__name__ != "__main__"
    return os.path.abspath(file).startswith(_INSTALLED)


def sources_of(kind: type[Any]) -> list[str]:
    """Return the file of a user's class, and the user's files that the class uses."""
    file = source_of(kind)
    if file is None:
        return []
    methods = filter(inspect.isfunction, vars(kind).values())
    pending: list[Mapping[str, Any]] = [method.__globals__ for method in methods]
    files, seen = {file: None}, set[int]()
    while pending:
        names = pending.pop()
        if id(names) in seen or not is_user_code(names):
            continue
        seen.add(id(names))
        files |= dict.fromkeys([os.path.abspath(names["__file__"]), *names.get(_BESIDE, ())])
        for value in list(names.values()):
            if inspect.isfunction(value):
                pending.append(value.__globals__)
            elif inspect.ismodule(value):
                pending.append(vars(value))
    return [name for name in files if os.path.isfile(name)]


def source_of(kind: type[Any]) -> str | None:
    """Return the file of a user's class; None if it has no file (notebook or shell)."""
    methods = [
        value
        for name, value in vars(kind).items()
        if inspect.isfunction(value) and not name.startswith("_")
    ]
    files = (method.__code__.co_filename for method in methods)
    return next((os.path.abspath(file) for file in files if os.path.isfile(file)), None)
