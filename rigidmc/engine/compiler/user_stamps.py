"""The stamp of a custom class: a hash of all inputs of its compiled code.

The stamp identifies code in memory and in the disk cache. An input missing from a stamp could give
stale physics, so a stamp accepts only a short list of things:

- functions: bytecode, constants, defaults, closure, attributes, and every global that they read,
  recursively; functions of `numba.njit` with their options
- plain numbers, strings, None, tuples and NamedTuples of these; numbers and arrays of NumPy
- NamedTuples as classes: fields, defaults, and the compiled methods
- objects of builtins, math, numpy and rigidmc under their own names; the versions are in the name
  of the cache folder, the version of rigidmc with the stamp of its sources

A class that reads anything else, such as a function of `ctypes`, has no stamp. Within a process its
identity distinguishes such an object, and another process compiles the class again.
"""

import builtins
import dis
import functools
import hashlib
import inspect
import linecache
import struct
import sys
from collections.abc import Iterator
from types import CodeType, FunctionType, ModuleType
from typing import Any, NamedTuple

import numpy as np
from numba.core import compiler
from numba.core.caching import NullCache
from numba.core.registry import CPUDispatcher

from rigidmc.engine.compiler.numba_extensions import overloads
from rigidmc.engine.compiler.source_stamps import source_stamp
from rigidmc.physics.dynamics.methods import METHODS
from rigidmc.processes.helpers import PACKAGE

LIBRARIES = {"builtins", "math", "numpy", "rigidmc"}
_PLAIN = bool, int, str, type(None)
_OPTIONS = {
    "nopython", "nogil", "error_model", "fastmath", "inline", "boundscheck", "forceinline",
    "no_cpython_wrapper", "no_cfunc_wrapper",
}  # fmt: skip
# Operations that Numba also rejects, or that read from elsewhere than globals
_STRANGE = {
    "IMPORT_NAME": "imports a module; import it at the top of the file",
    "STORE_GLOBAL": "changes a global; return the value instead",
    "DELETE_GLOBAL": "deletes a global",
    "LOAD_BUILD_CLASS": "defines a class; define it at the top of the file",
    "LOAD_NAME": "was made by exec",
    "LOAD_FROM_DICT_OR_GLOBALS": "reads a name of a class body",
    "LOAD_FROM_DICT_OR_DEREF": "reads a name of a class body",
    "LOAD_CLASSDEREF": "reads a name of a class body",
}


class Unknown(Exception):
    """Raised for code whose inputs cannot be followed."""


class Other(NamedTuple):
    """A function or class that another one reads, with words of its own."""

    thing: Any


class Library(str):
    """The name of an object of a library."""

    __slots__ = ()


class Foreign(NamedTuple):
    """An object that no other process can recognise; why : no stamp contains it."""

    why: str
    thing: Any


Words = Iterator[tuple[str, str | Other | Foreign]]  # (what is read, its content)


class Reads(NamedTuple):
    """Everything that the compiled code of a class reads, including itself.

    things : functions and classes
    words : of each of them
    """

    things: list[Any]
    words: list[list[tuple[str, str | Other | Foreign]]]

    @property
    def unstamped(self) -> str:
        """Why the class has no stamp, "" if it has one."""
        reasons = (word.why for each in self.words for _, word in each if isinstance(word, Foreign))
        return next(reasons, "")

    def key(self) -> str:
        """Return a hash of all words, a stamp if there is one; else it is valid in this process."""
        # Functions are named by the order in which they are met, so a stamp contains no address.
        places = {id(thing): place for place, thing in enumerate(self.things)}

        def text(word: str | Other | Foreign) -> str:
            if isinstance(word, str):
                return with_sources(word) if isinstance(word, Library) else word
            if isinstance(word, Other):
                return f"part {places[id(word.thing)]}"
            return f"object {id(word.thing)}"

        texts = [[text(word) for _, word in each] for each in self.words]
        return hashlib.sha256(repr(texts).encode()).hexdigest()


def read_all(thing: Any) -> Reads:
    """Return what a class or function reads; raise Unknown for inputs that cannot be followed.

    Functions with an `overload`, which has their code, are among its objects without a stamp.
    """
    overloaded = {id(each.key) for each in overloads}
    things, words = [thing], list[list[tuple[str, str | Other | Foreign]]]()
    # By identity: two equal functions may read different globals.
    seen = {id(thing)}
    # Breadth first, without recursion: functions may call each other in a circle.
    for item in things:  # grows
        words.append(list(words_of(item)))
        for place, (what, word) in enumerate(words[-1]):
            if isinstance(word, Other) and id(word.thing) in overloaded:
                words[-1][place] = what, Foreign(f"{what}, which extends Numba", word.thing)
            elif isinstance(word, Other) and id(word.thing) not in seen:
                seen.add(id(word.thing))
                things.append(word.thing)
    return Reads(things, words)


def words_of(thing: Any) -> Words:
    """Yield the words of a function or a class."""
    if isinstance(thing, FunctionType):
        return _of_function(thing)
    return _of_njit(thing) if type(thing) is CPUDispatcher else _of_class(thing)


def _of_class(cls: Any) -> Words:
    name, metaclass = cls.__name__, type(cls)  # another one could have methods of its own
    if metaclass is not type or not is_named_tuple(cls):
        yield name, Foreign(f"{_label(cls)} is not a NamedTuple", cls)
        return
    yield name, f"class {name} {cls._fields}"
    for parameter in inspect.signature(cls).parameters.values():  # as Numba makes an instance
        empty = parameter.default is parameter.empty
        yield f"{name}.{parameter.name}", f"{parameter.name} {parameter.kind} {empty}"
        if not empty:
            yield from words_of_value(parameter.default, f"{name}.{parameter.name}")
    # the facts that are compiled: `rigidmc.physics.effects.protocol.takes_noise`, and what
    # `rigidmc.physics.effects.present` reads
    for fact in ("is_random", "state", "memory", "shapes", "commands"):
        value = getattr(cls, fact, False)
        plain = tuple(sorted(value.items())) if isinstance(value, dict) else value
        yield from words_of_value(plain, f"{name}.{fact}")
    for method, function in methods_of(cls).items():
        what = f"{name}.{method}"
        yield what, f"method {method}"
        if isinstance(function, FunctionType):
            yield from words_of_value(function, what)
        else:
            yield what, Foreign(f"{what} is not a plain function", function)


def methods_of(cls: Any) -> dict[str, Any]:
    """Return {name: method} of the compiled methods of a custom class."""
    there: dict[str, Any] = {}  # `getattr_static` takes 40 us for all names
    for base in reversed(cls.__mro__):
        there.update(vars(base))
    names = sorted(there.keys() & {call.__name__ for call in METHODS} - {*cls._fields})
    return {name: there[name] for name in names}


def _of_njit(function: Any) -> Words:
    compile_, options = function._compiler, function.targetoptions
    plain = (
        type(function._cache) is NullCache  # Numba's own cache misses changes of other files
        and compile_.pipeline_class is compiler.Compiler
        and not compile_.locals
        and function._can_compile  # for all types; signatures of the user's would convert numbers
        and all(key in _OPTIONS and type(value) in _PLAIN for key, value in options.items())
    )
    label = _label(function)
    yield label, f"njit {sorted(options.items())}"
    if not plain:
        yield label, Foreign(f"{label} has njit options that prevent caching", function)
    yield from words_of_value(function.py_func, label)


def _of_function(function: FunctionType) -> Words:
    label = _label(function)
    if not linecache.getlines(function.__code__.co_filename, function.__globals__):
        yield label, Foreign(f"{label} has no source", None)
    yield label, "function"
    for word in _of_code(function.__code__):
        yield (word if isinstance(word, tuple) else (label, word))
    yield from words_of_value(function.__defaults__, f"a default of {label}")
    named = {**(function.__kwdefaults__ or {}), **vars(function)}  # `__wrapped__` has its signature
    for name, value in sorted(named.items()):
        yield label, name
        yield from words_of_value(value, f"{label} reads {name}")
    for name, path, value in globals_of(function):
        what = f"{label} reads {'.'.join([name, *path])}"
        yield what, f"reads {name} {path}"
        yield from words_of_value(value, what)
    for name, cell in zip(function.__code__.co_freevars, function.__closure__ or (), strict=True):
        yield f"{label} reads {name}", f"closure {name}"
        yield from words_of_value(cell_value(cell), f"{label} reads {name}")


def _of_code(code: CodeType) -> Iterator[Any]:
    """Yield the words of bytecode; words of constants with the code that they belong to."""
    counts = code.co_argcount, code.co_posonlyargcount, code.co_kwonlyargcount, code.co_flags
    names = code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars
    yield f"{code.co_code.hex()} {code.co_exceptiontable.hex()} {counts} {names}"
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _of_code(constant)
        else:
            yield from words_of_value(constant, f"{code.co_name} has a constant")


def words_of_value(value: Any, what: str) -> Words:
    """Yield the words of a value, numbers by their bits; what : for messages, "f reads K"."""
    cls = type(value)
    if cls in _PLAIN:
        yield what, f"{cls.__name__} {value!r}"
    elif cls is float:
        yield what, f"float {struct.pack('>d', value).hex()}"
    elif isinstance(value, np.generic) and value.dtype.kind in "biuf":
        yield what, f"number {value.dtype.str} {value.tobytes().hex()}"
    elif cls is np.ndarray and value.dtype.kind in "biuf":  # Numba copies its numbers into code
        order = value.flags.c_contiguous, value.flags.f_contiguous, value.flags.writeable
        bits = hashlib.sha256(value.tobytes()).hexdigest()
        yield what, f"array {value.dtype.str} {value.shape} {order} {bits}"
    elif name := library_name(value):
        yield what, Library(name)
    elif cls in (FunctionType, CPUDispatcher) or is_named_tuple(value):
        yield what, Other(value)
    elif cls is tuple or is_named_tuple(cls):
        yield what, f"tuple {len(value)}"
        if cls is not tuple:
            yield what, Other(cls)
        for item in value:
            yield from words_of_value(item, what)
    else:
        yield what, Foreign(f"{what}, {article(cls.__name__)}", value)


def with_sources(name: str) -> str:
    """Return a name that begins with a module, and the stamp of the module's sources."""
    home = name.partition(" ")[0]
    return f"{name} {source_stamp(home)}" if home.startswith("rigidmc") else name


def is_named_tuple(cls: Any) -> bool:
    return isinstance(cls, type) and issubclass(cls, tuple) and hasattr(cls, "_fields")


def library_name(value: Any) -> str:
    """Return the name of a library's object that is found under its own name; "" for all else."""
    for call in METHODS:
        if value is call:
            return f"method {call.__name__} {call.available}"
    if isinstance(value, ModuleType):
        return value.__name__ if value.__name__.partition(".")[0] in LIBRARIES else ""
    home = "numpy" if isinstance(value, np.ufunc) else getattr(value, "__module__", None)
    name = getattr(value, "__qualname__", None) or getattr(value, "__name__", None)
    if not isinstance(home, str) or home.partition(".")[0] not in LIBRARIES:
        return ""
    ours = home.partition(".")[0] == "rigidmc" and isinstance(value, FunctionType)
    if ours and not value.__code__.co_filename.startswith(PACKAGE):
        return ""
    value_there: Any = sys.modules.get(home)
    for word in str(name).split("."):
        value_there = getattr(value_there, word, None)
    return f"{home} {name}" if value_there is value else ""


@functools.cache
def _reads(code: CodeType) -> tuple[tuple[str, tuple[str, ...]], ...]:
    """Return (global, attributes read from it at once) for all reads of a function, including
    nested functions."""
    reads = list[tuple[str, tuple[str, ...]]]()
    steps = [step for step in dis.get_instructions(code) if step.opname != "EXTENDED_ARG"]
    for place, step in enumerate(steps):
        if step.opname in _STRANGE and str(step.argval).partition(".")[0] not in LIBRARIES:
            raise Unknown(f"{code.co_name} {_STRANGE[step.opname]}")
        if step.opname == "LOAD_GLOBAL":
            path = list[str]()
            for after in steps[place + 1 :]:
                if after.opname not in ("LOAD_ATTR", "LOAD_METHOD"):
                    break
                path.append(after.argval)
            reads.append((step.argval, tuple(path)))
    nested = [_reads(constant) for constant in code.co_consts if isinstance(constant, CodeType)]
    return tuple(dict.fromkeys([*reads, *(step for each in nested for step in each)]))


UNDEFINED = NameError  # in place of the value of a name that has none


def globals_of(function: FunctionType) -> Iterator[tuple[str, list[str], Any]]:
    """Yield (global, attributes, value) for all reads of a function; modules end in a value."""
    for name, path in _reads(function.__code__):
        names = function.__globals__ if name in function.__globals__ else vars(builtins)
        value, taken = names.get(name, UNDEFINED), list[str]()
        while isinstance(value, ModuleType):
            if len(taken) == len(path):
                if library_name(value):
                    break
                words = ".".join([name, *taken])
                rule = (
                    f"{_label(function)} uses {words}, a module, as a value, which rigidmc cannot"
                )
                raise Unknown(f"{rule} follow: write {words}.name, or import the name")
            taken.append(path[len(taken)])
            value = getattr(value, taken[-1], UNDEFINED)
        yield name, taken, value


def cell_value(cell: Any) -> Any:
    """Return the value in a cell of a closure."""
    try:
        return cell.cell_contents
    except ValueError:
        return UNDEFINED


def _label(thing: Any) -> str:
    return str(getattr(thing, "__qualname__", None) or getattr(thing, "__name__", thing))


def article(word: str) -> str:
    return f"{'an' if word[:1] in 'aeiou' else 'a'} {word}"
