"""Detection of Numba extensions by other packages.

An `overload` by a user changes the code of functions that do not name it, so no stamp of
`rigidmc.engine.compiler.user_stamps` contains it. While there is one, no custom class is cached.
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
_foreign: list[str] = []


def extension() -> str:
    """Return a module, neither Numba's nor of this package, that has extended Numba; or ""."""
    typing, target = cpu_target.typing_context, cpu_target.target_context
    known: list[Any] = [templates.builtin_registry, imputils.builtin_registry]
    for registry in {id(r): r for r in [*known, *typing._registries, *target._registries]}.values():
        for name, entries in vars(registry).items():
            if isinstance(entries, list):
                key = id(registry), name
                # Lists of a registry only grow: entries already checked are skipped.
                for entry in entries[_scanned.get(key, 0) :]:
                    _foreign.extend(set(_teachers(name, entry)) - _TEACHERS)
                _scanned[key] = len(entries)
    others = {home for function in typeof_impl.registry.values() for home in _makers(function, 0)}
    return next(iter([*_foreign, *(others - _TEACHERS)]), "")


def _teachers(name: str, entry: Any) -> Iterator[str]:
    """Yield the top-level packages of the modules behind an entry of a registry's list."""
    if name == "globals":  # (the object with a type, the type)
        teachers = [type(entry[1]), *getattr(entry[1], "templates", ())]
    else:  # a template; or (code, the function it implements, ...)
        teachers = [entry[0] if isinstance(entry, tuple) else entry]
    for teacher in teachers:
        yield from _makers(teacher, 3)


def _makers(thing: Any, depth: int) -> Iterator[str]:
    """Yield the top-level packages of a function or class, and of the functions in it."""
    package = str(getattr(thing, "__module__", None)).partition(".")[0]
    by_function = isinstance(thing, type) and package == "abc"
    if not by_function:
        yield package
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
