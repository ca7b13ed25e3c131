"""From a tuple of effects to one straight-line function.

Physics is written as plain functions and as methods of NamedTuples. Here they become callable from compiled code: a plain
function with itself as the implementation, a method by the TYPE of its NamedTuple.
Tuples of effects are unrolled by recursion on their type, so what is compiled holds what a scene lists and nothing else, and
Numba's disk cache works, since no function is ever an argument.
"""

import inspect
import sys
from functools import cache, partial
from typing import Any, cast

from numba import njit, typeof
from numba.core import types
from numba.core.datamodel import register_default
from numba.core.datamodel.models import OpaqueModel
from numba.core.errors import NumbaError  # noqa: F401  (for those who call)
from numba.core.typing.templates import AbstractTemplate
from numba.extending import overload, typeof_impl

# loaded so that METHODS is complete, and all physics known to `inline_all` below
import rigidmc.dynamics.principal
import rigidmc.effects
import rigidmc.integrators
import rigidmc.observables  # noqa: F401
from rigidmc.dynamics import functions, so3
from rigidmc.dynamics.methods import METHODS, arguments
from rigidmc.engine.memory import get_row
from rigidmc.engine.numbers import coded, known_by
from rigidmc.engine.pipeline import INLINE

# these have code of their own, here and in `rigidmc.engine.numbers`
_known = {
    so3.select, so3.select_each, so3.opposite, so3.by_precision, so3.root, functions.as_float, functions.as_word, functions.double, functions.as_given,
    functions.normal_quantile, functions._ratio,
}  # fmt: skip


def reason(error):
    """The innermost cause of a failed compilation, with the place, on one line."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    causes = [
        line
        for line in lines
        if not line.startswith(
            (
                "During",
                "Failed",
                "There are",
                "- ",
                ">>>",
                "Overload",
                "With argument",
                "Rejected",
                "File",
                "def ",
                "<source",
            )
        )
    ]
    places = [line for line in lines if line.startswith("File ")]
    return (causes[-1] if causes else lines[0])[:200] + (
        f" ({places[-1].rstrip(':')})" if places else ""
    )


def inline(function):
    """Let compiled code call a plain Python function, inlined.

    Numba's `overload` would do, but it compiles a function once more for each kind of caller: a third of all that is compiled.
    """
    if function not in _known:
        _known.add(function)
        made: dict[tuple, Any] = {}  # by the types of the arguments

        class Template(AbstractTemplate):
            key = function

            def generic(self, args, kws):
                kind = types.Dispatcher(_compiled_for(function, (*args, *kws.items())))
                found = kind.get_call_type(self.context, args, kws)
                made[found.args] = kind.get_overload(found)
                return found

            def get_impl_key(self, sig):
                return made[sig.args]

        known_by(Template)
    return function


@cache
def _compiled_for(function, kinds):
    """A function as it is compiled for arguments of these types alone."""
    return njit(**INLINE)(function)


def compile_method(call):
    """Let compiled code call a generic function of `rigidmc.dynamics.methods`: the method of the part, with those of the values that it takes, or the default."""
    name, default, available = call.__name__, inline(call.default), call.available

    def resolve(typing_context, part, *values):
        function = getattr(part.instance_class, name, None)
        at = (
            [-1, *range(len(values))]
            if function is None
            else [-1, *(available.index(a) for a in arguments(function))]
        )
        function = default if function is None else inline(function)
        typing_context.refresh()
        function = typing_context.resolve_value_type(function)
        given = [part if i < 0 else values[i] for i in at]
        found = typing_context.resolve_function_type(function, given, {})

        def generate(context, builder, sig, args):
            return context.get_function(function, found)(builder, [args[1 + i] for i in at])

        return found and (found.return_type(part, *values), generate)

    words = [
        inspect.Parameter(word, inspect.Parameter.POSITIONAL_ONLY)
        for word in ("_context", "_part", *available)
    ]
    cast(Any, resolve).__signature__ = inspect.Signature(
        words
    )  # Numba makes a tuple of what a `*` takes
    coded(call)(resolve)


class Kinds:
    """What a piece of code is compiled for: NamedTuples, and tuples of them, whose types count and whose numbers do not.

    Its type in compiled code tells theirs, and takes no room: pieces for different scenes have one way of being called.
    """

    def __init__(self, *parts):
        self.parts = parts


class KindsType(types.Type):
    """The type of Kinds."""

    def __init__(self, parts):
        self.parts = parts
        super().__init__(name=f"kinds of {parts}")

    @property
    def key(self):
        return self.parts

    def __iter__(self):
        return iter(self.parts)


register_default(KindsType)(OpaqueModel)


@typeof_impl.register(Kinds)
def _typeof_kinds(value, context):
    return KindsType(typeof(value.parts))


def numbers_of(part):
    """The numbers in nested tuples, one after the other: what `given` reads."""
    return (
        [number for one in part for number in numbers_of(one)]
        if isinstance(part, tuple)
        else [float(part)]
    )


def given(kinds, numbers):
    """The parts of Kinds, with the numbers from flat memory that `numbers_of` wrote."""
    return kinds.parts


@coded(given)
def _given(typing_context, kinds, numbers):
    return _made(kinds.parts, numbers, kinds, numbers)


def filled(part, rows, first):
    """Nested tuples of the type of `part` whose numbers are rows[first], rows[first + 1], ..."""
    left = iter(range(first, first + rows_of(part)))

    def made(one):
        if not isinstance(one, tuple):
            return rows[next(left)]
        return type(one)(*map(made, one)) if hasattr(one, "_fields") else tuple(map(made, one))

    return made(part)


@coded(filled)
def _filled(typing_context, part, rows, first):
    return _made(part, rows, part, rows, first)


def _made(part, rows, *arguments):
    """(signature, code) of an intrinsic that makes nested tuples like `part` of numbers from rows; the last argument is the first row, or it is 0."""
    word = types.intp

    def kind_of(one):
        if not isinstance(one, types.BaseTuple):
            return rows.item
        each = [kind_of(x) for x in one]
        alike = all(x == each[0] for x in each)
        if not hasattr(one, "instance_class"):
            return types.Tuple(each)
        if each and alike:
            return types.NamedUniTuple(each[0], len(each), one.instance_class)
        return types.NamedTuple(each, one.instance_class)

    def generate(context, builder, sig, values):
        at = [sig.args.index(rows)]
        first = values[-1] if len(values) > 2 else context.get_constant(word, 0)
        read = partial(get_row, context, builder, rows.item(rows, word))
        count = iter(range(_rows_of(part)))

        def make(one):
            if not isinstance(one, types.BaseTuple):
                return read(
                    (values[at[0]], builder.add(first, context.get_constant(word, next(count))))
                )
            return context.make_tuple(builder, kind_of(one), [make(x) for x in one])

        return make(part)

    return kind_of(part)(*arguments), generate


def _rows_of(kind):
    """How many numbers a type of nested tuples has."""
    return sum(map(_rows_of, kind)) if isinstance(kind, types.BaseTuple) else 1


def rows_of(part):
    """How many numbers nested tuples have: rows that they take."""
    return sum(map(rows_of, part)) if isinstance(part, tuple) else 1


@coded(rows_of)
def _counted(typing_context, part):
    return types.intp(part), lambda context, builder, sig, args: context.get_constant(
        types.intp, _rows_of(part)
    )


def has_noise(effect):
    """Whether an effect has normal deviates among its numbers, new ones for each step."""
    return "noise" in effect._fields


@overload(has_noise, jit_options=INLINE)
def _compiled_has_noise(effect):
    found = "noise" in effect.instance_class._fields
    return lambda effect: found


def with_noise(effect, deviates):
    """An effect with other deviates."""
    return effect._replace(noise=deviates)


@coded(with_noise)
def _with_noise(typing_context, effect, deviates):
    if "noise" not in effect.instance_class._fields:
        return effect(effect, deviates), lambda context, builder, sig, args: args[0]
    place = effect.instance_class._fields.index("noise")
    return effect(effect, deviates), lambda context, builder, sig, args: builder.insert_value(
        args[0], args[1], place
    )


def inline_all(module):
    """Let compiled code call every plain function of a module."""
    for function in list(vars(module).values()):
        if (
            inspect.isfunction(function)
            and function.__module__ == module.__name__
            and function not in METHODS
        ):
            inline(function)


# All physics can be called: the imports above load every effect, integrator and observable.
_PHYSICS = ("rigidmc.dynamics.", "rigidmc.effects.", "rigidmc.integrators.", "rigidmc.observables.")
for _name, _module in list(sys.modules.items()):
    if _name.startswith(_PHYSICS):
        inline_all(_module)
for _call in METHODS:
    compile_method(_call)
