"""Why a custom class cannot be compiled, in words: the construct, its line, and what to write.

The compiler stops at the first thing that it cannot type, with a page about its own passes. Here
the source of the method, and of the user's functions that it calls, is searched for the constructs
that never compile. One in the line at which the compiler stopped is the cause; else the first one.
"""

import ast
import inspect
import re
import textwrap
from collections.abc import Iterator
from functools import partial
from types import BuiltinFunctionType, FunctionType
from typing import Any, NamedTuple

import numpy as np
from numba.core.registry import CPUDispatcher

from rigidmc.engine.compiler.user_stamps import (
    Unknown,
    article,
    cell_value,
    globals_of,
    is_named_tuple,
    library_name,
    methods_of,
)

_NODES: dict[type[ast.AST], str] = {
    ast.GeneratorExp: "a generator expression; write the terms out",
    ast.ListComp: "a list comprehension; write the items out, as a tuple",
    ast.SetComp: "a set comprehension; write the items out, as a tuple",
    ast.DictComp: "a dictionary; use a NamedTuple, or numbers with names of their own",
    ast.Dict: "a dictionary; use a NamedTuple, or numbers with names of their own",
    ast.Set: "a set; compare with each number",
    ast.List: "a list; use a tuple",
    ast.JoinedStr: "a formatted text; compiled code has numbers only",
    ast.Try: "try; test the numbers with `select`",
    ast.With: "with; compiled code opens nothing",
    ast.Raise: "raise; return nan instead",
    ast.Assert: "assert; test the class in Python",
    ast.Yield: "yield; return a tuple",
    ast.YieldFrom: "yield; return a tuple",
    ast.Await: "await",
    ast.Global: "global; return the value instead",
    ast.Nonlocal: "nonlocal; return the value instead",
    ast.Import: "an import; import it at the top of the file",
    ast.ImportFrom: "an import; import it at the top of the file",
    ast.ClassDef: "a class; define it at the top of the file",
    ast.Delete: "del; leave it out",
    ast.Match: "match; use `select`",
    ast.Starred: "arguments with a star; name each one",
    ast.While: "while; use a `for` loop over a constant range",
}
_CALLS = {
    "print": "print; record the number with an observable",
    "open": "open; read the file at the top of the module",
    "isinstance": "isinstance; write a class for each case",
    "getattr": "getattr; name the field",
    "setattr": "setattr; return the value instead",
    "hasattr": "hasattr; name the field",
    "sorted": "sorted; use `minimum` and `maximum`",
    "super": "super; call a function instead",
    "map": "map; write the terms out",
    "sum": "sum; write the terms out",
    "filter": "filter; use `select`",
    "list": "a list; use a tuple",
    "dict": "a dictionary; use a NamedTuple",
    "set": "a set; compare with each number",
    "str": "a text; compiled code has numbers only",
}


class Cause(NamedTuple):
    """A construct that cannot be compiled: of a method, in a line of a file; what, and its cure."""

    method: str
    file: str
    line: int
    rule: str


def cause_of(cls: type[Any], error: object = "", method: str = "") -> Cause | None:
    """Return the likeliest cause for which a class cannot be compiled; None if none is known.

    error : of the compiler
    method : the only one that may be the cause; by default any
    """
    places = re.findall(r'File "([^"]+)", line (\d+)', str(error))
    lines = {int(line) for _, line in places}
    causes = [cause for cause in _causes(cls) if method in ("", cause.method)]
    near = [cause for cause in causes if cause.line in lines]
    is_shipped = cls.__module__.startswith("rigidmc.")  # the others of its constructs do compile
    return next(iter(near if near or is_shipped else causes), None)


def _causes(cls: type[Any]) -> Iterator[Cause]:
    for method, function in methods_of(cls).items():
        if not isinstance(function, FunctionType):
            what = f"{_kind(function)}; write `def {method}(self, ...)` in the class"
            code: Any = getattr(getattr(function, "__wrapped__", None), "__code__", None)
            file, line = (code.co_filename, code.co_firstlineno) if code else ("", 0)
            yield Cause(method, file, line, what)
            continue
        if library_name(function) and function.__module__ != cls.__module__:
            continue
        called, seen = [function], {id(function)}
        for each in called:  # grows
            for line, rule in _constructs(each, cls if each is function else None):
                yield Cause(method, each.__code__.co_filename, line, rule)
            for value in _read(each):
                value = getattr(value, "py_func", value)
                custom = isinstance(value, FunctionType) and not library_name(value)
                if custom and id(value) not in seen:
                    seen.add(id(value))
                    called.append(value)


def _read(function: FunctionType) -> Iterator[Any]:
    try:
        yield from (value for _, _, value in globals_of(function))
    except Unknown:
        return
    yield from map(cell_value, function.__closure__ or ())


def _constructs(function: FunctionType, cls: Any) -> Iterator[tuple[int, str]]:
    """Yield (line, rule) of what a function contains; cls : whose method it is, if any."""
    first = function.__code__.co_firstlineno
    try:
        tree: Any = ast.parse(textwrap.dedent(inspect.getsource(function))).body[0]
    except (OSError, TypeError, SyntaxError, IndexError):  # typed into a shell, or a lambda
        tree = ast.Pass()
    arguments = getattr(tree, "args", None)
    if arguments and (arguments.vararg or arguments.kwarg or arguments.kwonlyargs):
        yield first, f"{function.__name__} takes arguments with a star; name each one"
    values = _values(function)
    alone = {id(each.value) for each in ast.walk(tree) if isinstance(each, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and id(node) in alone:  # a docstring
            continue
        line = first + getattr(node, "lineno", 1) - 1
        if rule := _rule(node, cls, values, function):
            yield line, rule


def _values(function: FunctionType) -> dict[str, Any]:
    try:
        values = {".".join([name, *path]): value for name, path, value in globals_of(function)}
    except Unknown:
        return {}
    cells = zip(function.__code__.co_freevars, function.__closure__ or (), strict=True)
    return values | {name: cell_value(cell) for name, cell in cells}


def _rule(node: Any, cls: Any, values: dict[str, Any], function: FunctionType) -> str:
    """Return what is wrong with a node of the source, "" if nothing is known to be."""
    if rule := _NODES.get(type(node), ""):
        return rule
    if isinstance(node, ast.Constant) and isinstance(node.value, (str, bytes)):
        return "a text; compare numbers instead"
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
        name = node.func.id
        if name in _CALLS and not isinstance(values.get(name), FunctionType):
            return _CALLS[name]
        if values.get(name) is function or (name == function.__name__ and name not in values):
            return f"{name} calls itself; write the terms out"
    if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
        return _rule_of_attribute(node.value.id, node.attr, cls, values)
    if isinstance(node, ast.Name) and node.id in values:
        return _rule_of_value(node.id, values[node.id])
    return ""


def _rule_of_attribute(owner: str, name: str, cls: Any, values: dict[str, Any]) -> str:
    """Return what is wrong with `owner.name`, "" if nothing is known to be."""
    value = values.get(f"{owner}.{name}")
    if library_name(value).startswith("numpy") and not isinstance(value, (np.ufunc, type)):
        return f"{owner}.{name}, which works on arrays; use numbers, tuples and functions of math"
    if cls is None or owner != "self" or name in cls._fields:
        return ""
    if callable(getattr(cls, name, None)):
        return f"self.{name}, another method; make it a function outside of the class"
    return f"self.{name}, which is not a field; make it a field, or a global of the file"


def _rule_of_value(name: str, value: Any) -> str:
    is_plain = isinstance(value, (bool, int, float, np.generic, tuple, np.ndarray, type(None)))
    if is_plain or isinstance(value, (FunctionType, BuiltinFunctionType, CPUDispatcher)):
        return ""
    if library_name(value) or is_named_tuple(value) or inspect.ismodule(value):
        return ""
    return f"{name}, {_kind(value)}; {_cure(value)}"


def _kind(value: Any) -> str:
    if isinstance(value, partial):
        return "a partial function"
    if hasattr(value, "__wrapped__"):
        return "a decorated function"
    if isinstance(value, type):
        return "a class"
    return article(type(value).__name__)


def _cure(value: Any) -> str:
    if callable(value) and not isinstance(value, type):
        return "write a plain function, with `def`"
    if isinstance(value, str):
        return "compare numbers instead"
    return "use numbers, tuples or a NamedTuple"
