"""Detection of Numba extensions by other packages.

An `overload` by a user changes the code of functions that do not name it, so no stamp of
`rigidmc.engine.compiler.user_stamps` contains it. While there is one, no custom class is cached on
disk, and a change of what it reads is refused: Numba keeps its code.
"""

import contextlib
from collections.abc import Iterator
from types import FunctionType
from typing import Any

from numba.core import imputils
from numba.core.registry import cpu_target
from numba.core.typing import templates
from numba.core.typing.typeof import typeof_impl

# Modules of Numba's own extensions; "None" is code that Numba generates.
_TEACHERS = {
    "builtins", "math", "numpy", "rigidmc", "numba", "operator", "_operator", "heapq", "random",
    "None",
}  # fmt: skip
_scanned: dict[tuple[int, str], int] = {}  # {(id of a registry, its list): entries seen}
_foreign: list[Any] = []
overloads: list[Any] = []  # the templates of functions of others, as `extenders` has found them


def extension() -> str:
    """Return a module, neither Numba's nor of this package, that has extended Numba; or ""."""
    return next((_package(thing) for thing in extenders()), "")


def extenders() -> list[Any]:
    """Return all functions and classes of others that have extended Numba."""
    typing, target = cpu_target.typing_context, cpu_target.target_context
    builtin: list[Any] = [templates.builtin_registry, imputils.builtin_registry]
    for registry in {
        id(r): r for r in [*builtin, *typing._registries, *target._registries]
    }.values():
        for name, entries in vars(registry).items():
            if isinstance(entries, list):
                key = id(registry), name
                # Lists of a registry only grow: entries already checked are skipped.
                for entry in entries[_scanned.get(key, 0) :]:
                    _foreign.extend(filter(_is_foreign, _teachers(name, entry)))
                    if _is_foreign(getattr(entry, "_overload_func", extension)):
                        overloads.append(entry)
                _scanned[key] = len(entries)
    return [*_foreign, *filter(_is_foreign, typeof_impl.registry.values())]


def _package(thing: Any) -> str:
    """Return the top-level package of the module of a function or class."""
    return str(getattr(thing, "__module__", None)).partition(".")[0]


def _is_foreign(thing: Any) -> bool:
    return _package(thing) not in _TEACHERS


def _teachers(name: str, entry: Any) -> Iterator[Any]:
    """Yield the functions and classes behind an entry of a registry's list."""
    if name == "globals":  # (the object with a type, the type)
        teachers = [type(entry[1]), *getattr(entry[1], "templates", ())]
    else:  # a template; or (code, the function it implements, ...)
        teachers = [entry[0] if isinstance(entry, tuple) else entry]
    for teacher in teachers:
        yield from _makers(teacher, 3)


def _makers(thing: Any, depth: int) -> Iterator[Any]:
    """Yield a function or class, and the functions in it."""
    by_function = isinstance(thing, type) and _package(thing) == "abc"
    if not by_function:
        yield thing
    inner = [getattr(thing, name, None) for name in ("_overload_func", "_definition_func")]
    if by_function:
        inner += vars(thing).values()
    for cell in getattr(thing, "__closure__", None) or ():
        with contextlib.suppress(ValueError):  # an empty one
            inner.append(cell.cell_contents)
    for value in inner:
        function = getattr(value, "__func__", value)
        if depth and isinstance(function, FunctionType):
            yield from _makers(function, depth - 1)
