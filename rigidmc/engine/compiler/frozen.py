"""Custom classes as they are at one moment, for the compiler.

A user may change a global, a helper, a default or a method at any time, as every notebook does.
Numba knows functions and classes by their identity, and keeps the code of their old content. So it
never sees a custom class itself: it sees a copy of the class, of all functions that the class
reads, and of the globals that these read. A class whose stamp has changed gets a new copy, and with
it new code everywhere; a class that has changed back gets the old copy, and its code from memory.
"""

import inspect
import operator
import threading
from collections import Counter
from collections.abc import Iterator, Mapping
from types import CellType, FunctionType, ModuleType
from typing import Any, NamedTuple

import numba
import numpy as np
from numba.core.registry import CPUDispatcher

from rigidmc.engine.compiler.numba_extensions import extenders, extension, overloads
from rigidmc.engine.compiler.user_stamps import (
    UNDEFINED,
    Foreign,
    Reads,
    Unknown,
    cell_value,
    globals_of,
    is_named_tuple,
    library_name,
    methods_of,
    read_all,
    with_sources,
)
from rigidmc.errors import PartError
from rigidmc.physics.dynamics.methods import METHODS


class Frozen(NamedTuple):
    """A copy of a custom class.

    kind : the copy
    stamp : of the class; None if it has none
    kinds : {class: copy} of all classes that the code reads
    functions : copies of the plain functions that the code may call
    modules : names of the package's modules with more of these
    reads : the original, so that nothing whose identity distinguishes two copies is deleted
    """

    kind: type[Any]
    stamp: str | None
    kinds: dict[type[Any], type[Any]]
    functions: list[FunctionType]
    modules: set[str]
    reads: Reads


config: Any = numba.config
_Dispatcher: Any = CPUDispatcher  # as Any: Numba's stubs lack its attributes
_lock = threading.RLock()
_by_key: dict[tuple[type[Any], str], Frozen] = {}
_copies: dict[type[Any], Frozen] = {}  # by each class among the copies


def is_custom(cls: type[Any]) -> bool:
    """Return whether a NamedTuple is not of the package."""
    return not cls.__module__.startswith("rigidmc.")


def frozen(parts: Any, kinds: Mapping[type[Any], type[Any]] = {}) -> Any:
    """Return nested tuples with each custom class replaced by its copy.

    kinds : copies that a tuple around them reads

    Raises PartError for a class whose inputs cannot be followed.
    """
    if config.DISABLE_JIT or not isinstance(parts, tuple):
        return parts
    cls = type(parts)
    if hasattr(cls, "_fields") and is_custom(cls) and cls not in _copies:
        kinds = kinds if cls in kinds else frozen_class(cls).kinds
        cls = kinds[cls]
    items = [frozen(item, kinds) if isinstance(item, tuple) else item for item in parts]
    same = cls is type(parts) and all(map(operator.is_, items, parts))
    return parts if same else tuple.__new__(cls, items)


def frozen_class(cls: type[Any]) -> Frozen:
    """Return the present copy of a custom class; a copy is its own."""
    with _lock:
        if cls in _copies:
            return _copies[cls]
        try:
            reads = read_all(cls)
        except Unknown as error:
            raise PartError.of(cls, str(error), "code") from None
        _refuse_changes(cls, reads)
        key = reads.key()
        if (cls, key) not in _by_key:
            stamped = not reads.unstamped and not extension()
            _by_key[cls, key] = _Copier(reads).frozen(key if stamped else None)
        return _by_key[cls, key]


# {id of a function: (the function, a hash of what it first read)}
_first: dict[int, tuple[Any, str]] = {}


def _refuse_changes(cls: type[Any], reads: Reads) -> None:
    """Raise PartError if code that Numba keeps, whatever class calls it, reads something else now.

    This is the code of `overload`, `vectorize` and `cfunc`, of which there can be no copy.
    """
    words = [word for each in reads.words for _, word in each]
    things = [word.thing for word in words if isinstance(word, Foreign)]
    # of dispatchers there are copies
    kept = [thing for thing in things if type(thing) is not CPUDispatcher]
    inside = (getattr(getattr(thing, "_dispatcher", thing), "py_func", None) for thing in kept)
    for function in filter(inspect.isfunction, [*extenders(), *inside]):
        try:
            key = read_all(function).key()
        except Unknown:  # an intrinsic, which imports the compiler
            key = ""
        if key != _first.setdefault(id(function), (function, key))[1]:
            raise _changed(cls, function)
    made = Counter((id(each.key), each._overload_func.__qualname__) for each in overloads)
    for each in overloads:
        if made[id(each.key), each._overload_func.__qualname__] > 1:  # Numba takes the first
            raise _changed(cls, each._overload_func)


def _changed(cls: type[Any], function: Any) -> PartError:
    name = f"{function.__qualname__} of {function.__module__}"
    rule = f"{name} has changed since Numba compiled it, and Numba keeps its code: restart Python"
    return PartError.of(cls, rule, "code")


def copy_of(cls: type[Any]) -> Frozen:
    """Return the record of a copy; RuntimeError for a class that is not one."""
    if cls not in _copies:
        raise RuntimeError(f"{cls.__name__} reached the compiler as it is: use `frozen`")
    return _copies[cls]


class _Copier:
    """Copies of all that a class reads."""

    def __init__(self, reads: Reads) -> None:
        self.reads = reads
        self.copies: dict[int, Any] = {}  # by the id of the original
        self.package = set[str]()  # modules of the package whose functions are read
        self.names: dict[int, dict[str, Any]] = {}  # namespaces, by the id of the original
        self.modules: dict[int, ModuleType] = {}
        self.generic: list[Any] = list(METHODS)  # not plain: `compile_method` serves them
        for thing in reads.things:
            self._copy(thing)
        for thing in reads.things:
            if isinstance(thing, FunctionType):
                self._fill(thing, self.copies[id(thing)])
        for thing in reads.things:
            if type(thing) is _Dispatcher and not thing._can_compile:
                self._compile_as(thing, self.copies[id(thing)])

    def frozen(self, stamp: str | None) -> Frozen:
        """Return the copy of the class, and register all classes among the copies."""
        functions = [copied for copied in self.copies.values() if isinstance(copied, FunctionType)]
        kinds = {cls: self.copies[id(cls)] for cls in self.reads.things if isinstance(cls, type)}
        made = Frozen(object, stamp, kinds, functions, self.package, self.reads)
        for place, kind in enumerate(kinds.values()):
            _copies[kind] = made._replace(kind=kind, stamp=stamp and f"{stamp} {place}")
        return _copies[kinds[self.reads.things[0]]]

    def _copy(self, thing: Any) -> Any:
        if id(thing) not in self.copies:
            self.copies[id(thing)] = self._empty(thing)
        return self.copies[id(thing)]

    def _empty(self, thing: Any) -> Any:
        """Return a copy that reads nothing yet: what it reads may read it in turn."""
        if isinstance(thing, FunctionType):
            cells = tuple(CellType() for _ in thing.__closure__ or ())
            names = self._namespace(thing.__globals__)
            made = FunctionType(thing.__code__, names, thing.__name__, None, cells or None)
            made.__module__, made.__qualname__ = thing.__module__, thing.__qualname__
            return made
        if type(thing) is _Dispatcher:
            function, compiler = self._copy(thing.py_func), thing._compiler
            return _Dispatcher(
                function, compiler.locals, dict(thing.targetoptions), compiler.pipeline_class
            )
        methods = {
            name: self._copy(value)
            for name, value in methods_of(thing).items()
            if isinstance(value, FunctionType) and not library_name(value)
        }
        about = {"__slots__": (), "__module__": thing.__module__, "__doc__": thing.__doc__}
        if isinstance(new := thing.__new__, FunctionType):  # with the defaults of fields
            about["__new__"] = FunctionType(
                new.__code__, new.__globals__, "__new__", new.__defaults__, new.__closure__
            )
        made = type(thing)(thing.__name__, (thing,), {**about, **methods})
        made.__qualname__ = thing.__qualname__
        return made

    def _namespace(self, names: dict[str, Any]) -> dict[str, Any]:
        kept = ("__name__", "__file__", "__builtins__")
        namespace = {name: names[name] for name in kept if name in names}
        return self.names.setdefault(id(names), namespace)

    def _fill(self, function: FunctionType, made: FunctionType) -> None:
        """Give a copy what the original reads."""
        made.__defaults__ = self._copied(function.__defaults__)
        keywords = function.__kwdefaults__
        made.__kwdefaults__ = keywords and {k: self._copied(v) for k, v in keywords.items()}
        vars(made).update({name: self._copied(value) for name, value in vars(function).items()})
        for cell, empty in zip(function.__closure__ or (), made.__closure__ or (), strict=True):
            if (value := cell_value(cell)) is not UNDEFINED:
                empty.cell_contents = self._copied(value)
        for name, path, value in globals_of(function):
            if value is not UNDEFINED and name in function.__globals__:
                self._put(function.__globals__, made.__globals__, [name, *path], value)

    def _put(self, names: Any, copies: Any, path: list[str], value: Any) -> None:
        """Put the copy of a value at its path through modules."""
        first, *rest = path
        if not rest:
            copies[first] = self._copied(value)
            return
        module = names[first]
        if id(module) not in self.modules:
            self.modules[id(module)] = ModuleType(module.__name__)
        copies[first] = self.modules[id(module)]
        below = {rest[0]: getattr(module, rest[0])}
        self._put(below, vars(copies[first]), rest, value)

    def _copied(self, value: Any) -> Any:
        if id(value) in self.copies:
            return self.copies[id(value)]
        if isinstance(value, FunctionType) and value not in self.generic:
            self.package.add(value.__module__)
        if isinstance(value, np.ndarray):
            return value.copy(order="K")
        if type(value) is tuple or is_named_tuple(type(value)):
            cls = self.copies.get(id(type(value)), type(value))
            return tuple.__new__(cls, map(self._copied, value))
        return value

    def _compile_as(self, function: Any, made: Any) -> None:
        """Compile a copy for the types to which the user's decorator restricts a function."""
        for types in function.nopython_signatures:
            made.compile(types)
        made.disable_compile()


def homes_of(signature: Any) -> list[str | int]:
    """Return identifiers that distinguish the classes of a signature from namesakes.

    Each is a module of the package and the stamp of its sources, or the stamp of a custom class; a
    number, valid in this process alone, for a class without a stamp.

    signature : of a compiled function, or its types
    """
    return [
        copy_of(cls).stamp or id(cls) if is_custom(cls) else with_sources(cls.__module__)
        for cls in classes_of(signature)
    ]


def classes_of(signature: Any) -> list[type]:
    """Return all NamedTuples of a signature, including nested ones."""
    return list(_classes(getattr(signature, "args", signature)))  # a signature, or its types


def _classes(kinds: Any) -> Iterator[type]:
    pending = list(kinds)
    while pending:
        kind = pending.pop()
        if hasattr(kind, "instance_class"):
            yield kind.instance_class
        if hasattr(kind, "__iter__"):
            pending.extend(kind)


def stamp_of(cls: type[Any]) -> str | None:
    """Return the stamp of a custom class; None if it has none, see `why_not_cached`."""
    return frozen_class(cls).stamp


def why_not_cached(cls: type[Any]) -> str:
    """Return why a class has no stamp, "" if it has one."""
    foreign = extension()
    return f"{foreign} extends Numba" if foreign else frozen_class(cls).reads.unstamped
