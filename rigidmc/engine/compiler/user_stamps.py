"""The stamp of a custom class: a hash of all inputs of its compiled code.

The stamp identifies code in the disk cache. An input missing from a stamp could give stale physics,
so a stamp accepts only a short list of things:

- functions: bytecode, constants, defaults, closure, and every global that they read, recursively
- plain numbers, strings, None, tuples and NamedTuples of these; numbers of NumPy
- NamedTuples as classes: fields, defaults, and the compiled methods
- functions of `numba.njit` with plain options
- objects of builtins, math, numpy and rigidmc under their own names; the versions are in the name
  of the cache folder, those of rigidmc with the stamp of their sources

A function that reads anything else has no stamp and is compiled in every process. The same holds
for a function whose globals have changed since it was first seen: Numba keeps the code compiled
from the old ones in memory.
"""

import builtins
import dis
import functools
import hashlib
import inspect
import linecache
import struct
import sys
import threading
from collections.abc import Iterator
from types import CodeType, FunctionType, ModuleType
from typing import Any, NamedTuple

import numpy as np
from numba.core import compiler, event, ir
from numba.core.caching import NullCache
from numba.core.registry import CPUDispatcher

from rigidmc.engine.compiler.numba_extensions import extension
from rigidmc.engine.compiler.source_stamps import source_stamp
from rigidmc.files.processes import PACKAGE
from rigidmc.physics.dynamics.methods import METHODS

_LIBRARIES = {"builtins", "math", "numpy", "rigidmc"}
_PLAIN = bool, int, str, type(None)
_OPTIONS = {
    "nopython", "nogil", "error_model", "fastmath", "inline", "boundscheck", "forceinline",
    "no_cpython_wrapper", "no_cfunc_wrapper",
}  # fmt: skip
# Operations that Numba also rejects, or that read from elsewhere than globals
_STRANGE = {
    "IMPORT_NAME", "IMPORT_FROM", "LOAD_NAME", "STORE_GLOBAL", "DELETE_GLOBAL", "LOAD_BUILD_CLASS",
    "LOAD_FROM_DICT_OR_GLOBALS", "LOAD_FROM_DICT_OR_DEREF", "LOAD_CLASSDEREF",
}  # fmt: skip


class Unknown(Exception):
    """Raised for an object that no stamp can contain."""


class _Other(NamedTuple):
    """A function or class that another one reads, with words of its own."""

    thing: Any


Words = Iterator[str | _Other]
_lock = threading.RLock()
_first: dict[int, tuple[Any, Any]] = {}  # {id: (the object, what it read when first seen)}
_changed: set[int] = set()  # ids of objects that have read something else since
# {id of an njit function: (the function, types it was compiled for after it was first seen)}
_compiled: dict[int, tuple[Any, set[Any]]] = {}


def stamp_of(cls: type[Any]) -> str | None:
    """Return the stamp of a custom class; None if it has none, see `why_not_cached`."""
    try:
        return _stamp(cls)
    except Unknown:
        return None


def why_not_cached(cls: type[Any]) -> str:
    """Return why a class has no stamp, "" if it has one."""
    try:
        _stamp(cls)
    except Unknown as error:
        return str(error)
    return ""


def classes_of(signature: Any) -> list[type]:
    """Return all NamedTuples of a signature, including nested ones."""
    classes, pending = [], list(getattr(signature, "args", signature))  # a signature, or its types
    while pending:
        cls = pending.pop()
        if hasattr(cls, "instance_class"):
            classes.append(cls.instance_class)
        if hasattr(cls, "__iter__"):
            pending.extend(cls)
    return classes


def homes_of(signature: Any) -> list[str] | None:
    """Return identifiers that distinguish the classes of a signature from namesakes.

    Each is a module of the package and the stamp of its sources, or the stamp of a custom class.
    Return None if a class has no stamp.

    signature : of a compiled function, or its types
    """
    homes = []
    for cls in classes_of(signature):
        of_package = cls.__module__.startswith("rigidmc.")
        home = _with_sources(cls.__module__) if of_package else stamp_of(cls)
        if home is None:
            return None
        homes.append(home)
    return homes


def _with_sources(module: str) -> str:
    """Return the name of a module and the stamp of its sources, if it is one of the package."""
    of_package = module.partition(".")[0] == "rigidmc"
    return f"{module} {source_stamp(module)}" if of_package else module


def tag_of(signature: Any) -> str:
    """Return the suffix of the names of compiled functions.

    Numba counts the functions of a process. With only this number and the types in its name, code
    from the disk could have the name of other code of this process, and run in its place.
    """
    return hashlib.sha256(repr(homes_of(signature)).encode()).hexdigest()[:16]


def observe_user_code(thing: Any) -> None:
    """Record what a custom function or class reads, before it is compiled."""
    with _lock:
        _walk(thing)


def compare_globals(function: Any, code: Any) -> None:
    """Check that what Numba reads for a function agrees with its stamp.

    code : Numba's form of the function
    """
    with _lock:
        known = {id(value) for value in _values(function)}
        for block in code.blocks.values():
            for assignment in block.find_insts(ir.Assign):
                if isinstance(assignment.value, (ir.Global, ir.FreeVar)):
                    value = assignment.value.value
                    # Numba itself adds `bool` and others
                    if id(value) not in known and not _library_name(value):
                        _changed.add(id(function))


class _Listener(event.Listener):
    """A listener that records what every custom function reads, before Numba compiles it."""

    def on_start(self, event: Any) -> None:
        if dispatcher := _user_dispatcher(event):
            observe_user_code(dispatcher.py_func)

    def on_end(self, event: Any) -> None:
        if (dispatcher := _user_dispatcher(event)) and event.data["return_type"] is None:
            known = _compiled.setdefault(id(dispatcher), (dispatcher, set()))[1]
            known.add(tuple(event.data["args"]))


def _user_dispatcher(event: Any) -> Any:
    """Return the dispatcher of a custom function, None for other functions."""
    dispatcher = event.data.get("dispatcher")
    function = getattr(dispatcher, "py_func", None)
    home = str(getattr(function, "__module__", "numba."))
    return None if home.startswith(("rigidmc.", "numba.")) else dispatcher


# Numba compiles a user's njit functions at their first call, from anywhere: their inputs must be
# recorded before that.
event.register("numba:compile", _Listener())


def _stamp(cls: type[Any]) -> str:
    """Return the stamp of a class; raise Unknown if it has none."""
    with _lock:
        things, words, unknown = _walk(cls)
        if foreign := extension():
            raise Unknown(f"{foreign} extends Numba")
    if unknown:
        raise unknown[0]
    # Functions are named by the order in which they are met, so a stamp contains no address.
    places = {id(thing): place for place, thing in enumerate(things)}
    text = [
        [f"part {places[id(word.thing)]}" if isinstance(word, _Other) else word for word in each]
        for each in words
    ]
    return hashlib.sha256(repr(text).encode()).hexdigest()


def _walk(thing: Any) -> tuple[list[Any], list[list[str | _Other]], list[Unknown]]:
    """Return (an object and all that it reads, the words of each, the unknown inputs).

    The walk continues past unknown inputs: each object must be seen before it is compiled.
    """
    things, words, unknown = [thing], list[list[str | _Other]](), list[Unknown]()
    # By identity: two equal functions may read different globals.
    seen = {id(thing)}
    # Breadth first, without recursion: functions may call each other in a circle.
    for item in things:  # grows
        own_words = list[str | _Other]()
        try:
            for word in _words_of(item):
                own_words.append(word)
                if isinstance(word, _Other) and id(word.thing) not in seen:
                    seen.add(id(word.thing))
                    things.append(word.thing)
        except Unknown as error:
            unknown.append(error)
            own_words.append(f"unknown: {error}")
        words.append(own_words)
        read = [id(w.thing) if isinstance(w, _Other) else w for w in own_words]
        if _first.setdefault(id(item), ((item, own_words), read))[1] != read:
            _changed.add(id(item))
        if id(item) in _changed:
            unknown.append(Unknown(f"{_label(item)} has changed since it was compiled"))
    return things, words, unknown


def _words_of(thing: Any) -> Words:
    """Yield the words of a function or a class."""
    if isinstance(thing, FunctionType):
        return _of_function(thing)
    return _of_njit(thing) if type(thing) is CPUDispatcher else _of_class(thing)


def _of_class(cls: Any) -> Words:
    metaclass = type(cls)  # another one could have methods of its own
    if metaclass is not type or not _is_named_tuple(cls):
        raise Unknown(f"{_label(cls)} is not a NamedTuple")
    yield f"class {cls.__name__} {cls._fields}"
    for parameter in inspect.signature(cls).parameters.values():  # as Numba makes an instance
        yield f"{parameter.name} {parameter.kind} {parameter.default is parameter.empty}"
        if parameter.default is not parameter.empty:
            yield from _of_value(parameter.default, f"{cls.__name__}.{parameter.name}")
    # the one fact that is compiled, see `rigidmc.physics.effects.protocol.takes_noise`
    yield from _of_value(getattr(cls, "is_random", False), f"{cls.__name__}.is_random")
    for name in sorted({call.__name__ for call in METHODS} - {*cls._fields}):
        method = inspect.getattr_static(cls, name, None)
        if method is not None:
            if not isinstance(method, FunctionType):
                raise Unknown(f"{cls.__name__}.{name} is not a plain function")
            yield f"method {name}"
            yield from _of_value(method, f"{cls.__name__}.{name}")


def _of_njit(function: Any) -> Words:
    compile_, options = function._compiler, function.targetoptions
    plain = (
        type(function._cache) is NullCache  # Numba's own cache misses changes of other files
        and compile_.pipeline_class is compiler.Compiler
        and not compile_.locals
        and function._can_compile  # for all types; signatures of the user's would convert numbers
        and all(key in _OPTIONS and type(value) in _PLAIN for key, value in options.items())
    )
    if not plain:
        raise Unknown(f"{_label(function)} has njit options that prevent caching")
    if not {*function.overloads} <= _compiled.get(id(function), (None, set()))[1]:
        raise Unknown(f"{_label(function)} was compiled before")
    yield f"njit {sorted(options.items())}"
    yield from _of_value(function.py_func, _label(function))


def _of_function(function: FunctionType) -> Words:
    if vars(function):  # as from `functools.wraps`, which hides another signature
        raise Unknown(f"{_label(function)} has attributes")
    if not linecache.getlines(function.__code__.co_filename, function.__globals__):
        raise Unknown(f"{_label(function)} has no source")
    yield "function"
    yield from _of_code(function.__code__)
    yield from _of_value(function.__defaults__, f"a default of {_label(function)}")
    for name, value in sorted((function.__kwdefaults__ or {}).items()):
        yield name
        yield from _of_value(value, f"{_label(function)} reads {name}")
    for name, path, value in _globals_of(function):
        yield f"reads {name} {path}"
        yield from _of_value(value, f"{_label(function)} reads {'.'.join([name, *path])}")
    for name, value in _closure_of(function):
        yield f"closure {name}"
        yield from _of_value(value, f"{_label(function)} reads {name}")


def _of_code(code: CodeType) -> Words:
    counts = code.co_argcount, code.co_posonlyargcount, code.co_kwonlyargcount, code.co_flags
    names = code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars
    yield f"{code.co_code.hex()} {code.co_exceptiontable.hex()} {counts} {names}"
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _of_code(constant)
        else:
            yield from _of_value(constant, f"{code.co_name} has a constant")


def _of_value(value: Any, what: str) -> Words:
    """Yield the words of a value, numbers by their bits; what : for messages, "f reads K"."""
    cls = type(value)
    if cls in _PLAIN:
        yield f"{cls.__name__} {value!r}"
    elif cls is float:
        yield f"float {struct.pack('>d', value).hex()}"
    elif isinstance(value, np.generic) and value.dtype.kind in "biuf":
        yield f"number {value.dtype.str} {value.tobytes().hex()}"
    elif name := _library_name(value):
        yield name
    elif cls in (FunctionType, CPUDispatcher) or _is_named_tuple(value):
        yield _Other(value)
    elif cls is tuple or _is_named_tuple(cls):
        yield f"tuple {len(value)}"
        if cls is not tuple:
            yield _Other(cls)
        for item in value:
            yield from _of_value(item, what)
    else:
        raise Unknown(f"{what}, {_article(cls.__name__)}")


def _is_named_tuple(cls: Any) -> bool:
    return isinstance(cls, type) and issubclass(cls, tuple) and hasattr(cls, "_fields")


def _library_name(value: Any) -> str:
    """Return the name of a library's object that is found under its own name; "" for all else."""
    for call in METHODS:
        if value is call:
            return f"method {call.__name__} {call.available}"
    home = "numpy" if isinstance(value, np.ufunc) else getattr(value, "__module__", None)
    name = getattr(value, "__qualname__", None) or getattr(value, "__name__", None)
    if not isinstance(home, str) or home.partition(".")[0] not in _LIBRARIES:
        return ""
    ours = home.partition(".")[0] == "rigidmc" and isinstance(value, FunctionType)
    if ours and not value.__code__.co_filename.startswith(PACKAGE):
        return ""
    value_there: Any = sys.modules.get(home)
    for word in str(name).split("."):
        value_there = getattr(value_there, word, None)
    return f"{_with_sources(home)} {name}" if value_there is value else ""


@functools.cache
def _reads(code: CodeType) -> tuple[tuple[str, tuple[str, ...]], ...]:
    """Return (global, attributes read from it at once) for all reads of a function, including
    nested functions."""
    reads = list[tuple[str, tuple[str, ...]]]()
    steps = [step for step in dis.get_instructions(code) if step.opname != "EXTENDED_ARG"]
    for place, step in enumerate(steps):
        if step.opname in _STRANGE:
            raise Unknown(f"{code.co_name} has {step.opname}")
        if step.opname == "LOAD_GLOBAL":
            path = list[str]()
            for after in steps[place + 1 :]:
                if after.opname not in ("LOAD_ATTR", "LOAD_METHOD"):
                    break
                path.append(after.argval)
            reads.append((step.argval, tuple(path)))
    nested = [_reads(constant) for constant in code.co_consts if isinstance(constant, CodeType)]
    return tuple(dict.fromkeys([*reads, *(step for each in nested for step in each)]))


def _globals_of(function: FunctionType) -> Iterator[tuple[str, list[str], Any]]:
    """Yield (global, attributes, value) for all reads of a function; modules end in a value."""
    for name, path in _reads(function.__code__):
        names = function.__globals__ if name in function.__globals__ else vars(builtins)
        value, taken = names.get(name, _first), list[str]()
        if value is _first:
            raise Unknown(f"{_label(function)} reads {name}, which is undefined")
        while isinstance(value, ModuleType):
            if len(taken) == len(path) or path[len(taken)] not in vars(value):
                words = ".".join([name, *taken])
                raise Unknown(f"{_label(function)} reads {words}, a module")
            taken.append(path[len(taken)])
            value = vars(value)[taken[-1]]
        yield name, taken, value


def _closure_of(function: FunctionType) -> Iterator[tuple[str, Any]]:
    for name, cell in zip(function.__code__.co_freevars, function.__closure__ or (), strict=True):
        try:
            yield name, cell.cell_contents
        except ValueError:
            raise Unknown(f"{_label(function)} reads {name}, which is undefined") from None


def _values(function: FunctionType) -> Iterator[Any]:
    """Yield the values of the names that a function reads, including modules."""
    try:
        for name, _ in _reads(function.__code__):
            yield function.__globals__.get(name, getattr(builtins, name, None))
        yield from (value for _, value in _closure_of(function))
    except Unknown:
        return


def _label(thing: Any) -> str:
    return str(getattr(thing, "__qualname__", None) or getattr(thing, "__name__", thing))


def _article(word: str) -> str:
    return f"{'an' if word[:1] in 'aeiou' else 'a'} {word}"
