"""What custom classes read, in a form that another process can compare.

A stamp (`rigidmc.engine.compiler.user_stamps`) covers compiled methods. Here are all methods and
attributes of a class, also those that Python runs, such as the `sample` of a distribution; and
values that no stamp takes, such as lists. A run stores them when it begins.
"""

import hashlib
import sys
from collections.abc import Iterable, Iterator, Mapping
from types import BuiltinFunctionType, FunctionType
from typing import Any

from numba.core.registry import CPUDispatcher

from rigidmc.engine.compiler.user_stamps import (
    Foreign,
    Other,
    Unknown,
    Words,
    library_name,
    words_of,
    words_of_value,
)
from rigidmc.files.user_code import is_installed

UNKNOWN = "unknown"  # instead of the hash of something that cannot be compared
# of the methods with such names, those that are not generated
_WRITTEN = {"__init__", "__post_init__", "__call__", "__getattr__"}


def contents_of(classes: Iterable[type[Any]]) -> dict[str, str]:
    """Return {what custom classes read: a hash of it}, such as "Wind.torque reads TABLE"."""
    texts: dict[str, list[str]] = {}
    things: list[Any] = list(classes)
    seen = {id(thing) for thing in things}
    for thing in things:  # grows
        for what, word in _compared(_words_of_all(thing)):
            text = word if isinstance(word, str) else "part"
            if isinstance(word, Other) and id(word.thing) not in seen:
                seen.add(id(word.thing))
                things.append(word.thing)
            texts.setdefault(what, []).append(text)
    hashes = {what: hashlib.sha256(repr(text).encode()).hexdigest() for what, text in texts.items()}
    hashes |= {what: UNKNOWN for what, text in texts.items() if UNKNOWN in text}
    # bytecode differs between versions of Python
    return {"Python": f"{sys.version_info[:2]}", **hashes} if hashes else {}


def changes(before: Mapping[str, str], now: Mapping[str, str]) -> list[str]:
    """Return what has changed between two results of `contents_of`, as far as they compare."""
    if before.get("Python") != now.get("Python"):
        return []
    return [what for what in {**before, **now} if before.get(what) != now.get(what)]


def _words_of_all(thing: Any) -> Words:
    """Yield the words of a function, or of all that a class has."""
    if not isinstance(thing, type):
        yield from words_of(thing)
        return
    for base in thing.__mro__:
        if is_installed(base) or library_name(base):
            continue
        yield thing.__name__, f"class {base.__name__}"
        for name, value in sorted(vars(base).items()):
            generated = name.startswith("__") and name not in _WRITTEN
            machinery = isinstance(value, (FunctionType, classmethod)) and is_installed(value)
            if not (generated or machinery or name in getattr(thing, "_fields", ())):
                yield from words_of_value(value, f"{thing.__name__}.{name}")


def _compared(words: Words) -> Iterator[tuple[str, str | Other]]:
    """Yield words, with their content for those that have no stamp."""
    try:
        for what, word in words:
            if isinstance(word, Foreign):
                yield from _compared(_inside(word.thing, what))
            else:
                yield what, word
    except Unknown as error:  # Python may do more than the compiler
        yield str(error).partition(" ")[0], UNKNOWN


def _inside(value: Any, what: str) -> Words:
    """Yield the words of an object that has no stamp."""
    function = getattr(value, "__func__", getattr(value, "fget", getattr(value, "func", None)))
    if isinstance(value, (list, set, frozenset, dict)):
        items: list[Any] = (
            sorted(value, key=repr) if isinstance(value, (set, frozenset)) else [*value]
        )
        items += value.values() if isinstance(value, dict) else ()
        yield what, f"{type(value).__name__} {len(items)}"
        for item in items:
            yield from words_of_value(item, what)
    elif isinstance(value, (bytes, complex, range, slice)):
        yield what, repr(value)
    elif isinstance(value, (FunctionType, BuiltinFunctionType, type)) and is_installed(value):
        yield what, f"{value.__module__} {value.__qualname__}"
    elif function is not None:  # of a property, static method or partial function
        yield from words_of_value(function, what)
    elif isinstance(value, (type, CPUDispatcher)):
        yield what, Other(value)
    elif value is not None:  # None stands for code without a source
        yield what, UNKNOWN
