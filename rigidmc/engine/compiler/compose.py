"""From a tuple of effects to one straight-line function.

Physics is written as plain functions and as methods of NamedTuples. Here they become callable from
compiled code: a plain function by itself, a method by the TYPE of its NamedTuple. Recursion on
their type unrolls tuples of effects, so compiled code holds only the effects of the scene. No
function is ever an argument: Numba's disk cache could not recognise it.
"""

import inspect
import re
import sys
from collections.abc import Callable
from functools import cache
from itertools import pairwise
from types import ModuleType
from typing import Any, cast

from numba import njit
from numba.core import types
from numba.core.errors import NumbaError as NumbaError  # for callers of `innermost_cause`
from numba.core.typing.templates import AbstractTemplate, fold_arguments

import rigidmc.engine.compiler.present  # registers intrinsics before plain functions are inlined
import rigidmc.physics.effects.protocol
import rigidmc.physics.integrators.protocol
import rigidmc.physics.observables.protocol  # noqa: F401  (imported so that METHODS is complete)
from rigidmc.engine.compiler.derivatives import rule_for
from rigidmc.engine.compiler.frozen import copy_of, is_custom
from rigidmc.engine.compiler.intrinsics import INTRINSICS, intrinsic, register_template
from rigidmc.engine.compiler.lowering import lower_function
from rigidmc.engine.compiler.pipeline import INLINE
from rigidmc.physics.dynamics.methods import METHODS, arguments

Function = Callable[..., Any]

_inlined: set[Function] = set()
_done: set[str] = set()  # modules of the package


def is_of_package(function: Any) -> bool:
    """Return whether a function belongs to the package, not to a user."""
    return str(function.__module__).startswith("rigidmc.")


def innermost_cause(error: Exception) -> str:
    """Return the innermost cause of a failed compilation, with its file and line, on one line."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    lines = lines or [f"Numba raises {type(error).__name__}"]
    # Numba prints the chain of callers, the user's function last.
    failed = [i + 1 for i, line in enumerate(lines) if "Failed in nopython mode" in line]
    inner = lines[failed[-1] :] if failed else lines
    place = next((line.rstrip(":") for line in inner if line.startswith("File ")), "")
    code = next((before for before, line in pairwise(inner) if line == "^"), "")
    cause = re.sub(r"\((<module '\w+').*>\)", r"(\1>)", inner[0])[:200]
    return cause + (f" ({place}: {code})" if place else "")


def inline(function: Function) -> Function:
    """Make a plain Python function callable, inlined, from compiled code.

    Numba's `overload` would work, but it compiles a function once more for each kind of caller: a
    third of all compilation.
    """
    if function not in _inlined and function not in INTRINSICS:
        _inlined.add(function)
        inlined = (InlinedFunction if is_of_package(function) else DispatchedFunction)(function)

        class Template(AbstractTemplate):
            key = function

            def generic(self, args: Any, kws: Any) -> Any:
                return inlined.signature_of(self.context, args, kws)

            def get_impl_key(self, sig: Any) -> Any:
                return inlined.compiled[sig.args]

        register_template(Template)
    return function


class DispatchedFunction:
    """A custom function, compiled by Numba's dispatcher, which notifies its listeners.

    compiled : the functions that the code calls, by the types of the arguments
    """

    def __init__(self, function: Function) -> None:
        self.function = function
        self.compiled: dict[tuple[Any, ...], Any] = {}

    def signature_of(self, context: Any, args: Any, kws: Any) -> Any:
        """Return the signature for arguments of these types, and compile it if necessary."""
        dispatcher = types.Dispatcher(_dispatcher(self.function, (*args, *kws.items())))
        signature: Any = dispatcher.get_call_type(context, args, kws)
        self.compiled[signature.args] = dispatcher.get_overload(signature)
        return signature


class InlinedFunction(DispatchedFunction):
    """A function of the package, compiled without a dispatcher: a tenth of the time."""

    def __init__(self, function: Function) -> None:
        super().__init__(function)
        self.parameters = inspect.signature(function)
        self.signatures: dict[tuple[Any, ...], Any] = {}

    def signature_of(self, context: Any, args: Any, kws: Any) -> Any:
        """Return the signature for arguments of these types, and compile it if necessary."""
        folded = fold_arguments(
            self.parameters, args, kws,
            lambda place, parameter, kind: kind,
            lambda place, parameter, default: types.Omitted(default),
            lambda place, parameter, kinds: types.StarArgTuple(kinds),
        )  # fmt: skip
        if folded not in self.signatures:
            code = lower_function(rule_for(self.function, folded), folded)
            self.compiled[folded] = code.entry_point
            self.signatures[folded] = code.signature.replace(pysig=self.parameters)
        return self.signatures[folded]


@cache
def _dispatcher(function: Function, types_of_arguments: tuple[Any, ...]) -> Any:
    """Return a dispatcher of a function for arguments of these types alone."""
    return njit(**INLINE)(function)


def compile_method(call: Any) -> None:
    """Make a generic function of `rigidmc.physics.dynamics.methods` callable from compiled code.

    It calls the method of its first argument with the values that the method names, or the default.
    """
    name, default, available = call.__name__, inline(call.default), call.available

    def resolve(typing_context: Any, part: Any, *values: Any) -> Any:
        before = len(_inlined)
        if is_custom(part.instance_class):
            copy = copy_of(part.instance_class)
            for called in copy.functions:
                inline(called)
            for module in copy.modules:
                inline_all(sys.modules[module])
        method = getattr(part.instance_class, name, None)
        named = available if method is None else arguments(method)
        places = [available.index(argument) for argument in named]
        # A missing method costs nothing: the default is inlined, and usually does nothing.
        function = default if method is None else inline(method)
        if method is not None and is_of_package(method):
            inline_all(sys.modules[method.__module__])
        if len(_inlined) > before:  # Numba does not know templates that `inline` has registered
            typing_context.refresh()
        kind = typing_context.resolve_value_type(function)
        argument_types = [part, *(values[i] for i in places)]
        signature = typing_context.resolve_function_type(kind, argument_types, {})

        def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            values = [args[0], *(args[1 + i] for i in places)]
            return context.get_function(kind, signature)(builder, values)

        return signature and (signature.return_type(part, *values), generate)

    words = [
        inspect.Parameter(word, inspect.Parameter.POSITIONAL_ONLY)
        for word in ("_context", "_part", *available)
    ]
    # Numba would make a tuple of the arguments after a `*`, so this lists their names instead.
    cast(Any, resolve).__signature__ = inspect.Signature(words)
    intrinsic(call)(resolve)


def inline_all(module: ModuleType) -> None:
    """Make every plain function of a module callable from compiled code, and the ones these call.

    The search goes on through all modules of the package from which the module imports a function.
    It skips modules of the engine, because each of them calls this for itself.
    """
    pending, seen = [module.__name__], set(_done)
    # Generic functions are not plain: `compile_method` serves them.
    methods: list[Any] = list(METHODS)
    while pending:
        name = pending.pop()
        if name in seen:
            continue
        seen.add(name)
        for value in list(vars(sys.modules[name]).values()):
            if not inspect.isfunction(value) or value in methods:
                continue
            home = str(value.__module__)
            if home == name:
                inline(value)
            elif is_of_package(value) and not home.startswith("rigidmc.engine."):
                pending.append(home)
    _done.update(seen)


inline_all(sys.modules["rigidmc.engine.compiler.derivatives"])
for _call in METHODS:
    inline_all(sys.modules[_call.default.__module__])
    compile_method(_call)
