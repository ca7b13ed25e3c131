"""Nested NamedTuples as arguments of compiled code: their types are compiled, their numbers read.

A StaticTree has the types alone. The numbers come from flat memory (`tree_unpack`), where those of
an integrator and its limits lie, or from rows (`tree_unflatten`), where each member has its own, as
the parameters of effects. A kernel for one scene is thus called in the same way as that for any
other.
"""

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

from numba import typeof
from numba.core import types
from numba.core.datamodel.models import OpaqueModel
from numba.core.datamodel.registry import register_default
from numba.extending import typeof_impl

from rigidmc.engine.compiler.intrinsics import intrinsic
from rigidmc.engine.compiler.memory import get_row
from rigidmc.physics.effects.protocol import takes_noise

# as Any: Numba's stubs lack the items and the class of tuples
_Tuple: Any = types.BaseTuple
_NamedTuple: Any = types.BaseNamedTuple


class StaticTree:
    """What a kernel is compiled for: NamedTuples, and tuples of them, without their numbers.

    In compiled code it takes no memory: its type says all.
    """

    def __init__(self, *parts: Any) -> None:
        self.parts = parts


class StaticTreeType(types.Type):
    """The type of a StaticTree."""

    def __init__(self, parts: Any) -> None:
        self.parts = parts
        super().__init__(name=f"kinds of {parts}")

    @property
    def key(self) -> Any:
        return self.parts

    def __iter__(self) -> Iterator[Any]:
        return iter(self.parts)


register_default(StaticTreeType)(OpaqueModel)


@typeof_impl.register(StaticTree)
def _typeof_tree(value: StaticTree, context: Any) -> StaticTreeType:
    return StaticTreeType(typeof(value.parts))


def tree_flatten(part: Any) -> list[float]:
    """The numbers of nested tuples, one after the other: what `tree_unpack` reads."""
    if isinstance(part, tuple):
        return [number for item in part for number in tree_flatten(item)]
    return [float(part)]


def tree_unpack(tree, numbers):
    """The parts of a StaticTree, with the numbers that `tree_flatten` wrote to flat memory."""
    return tree.parts


@intrinsic(tree_unpack)
def _tree_unpack(typing_context, tree, numbers):
    return _read(tree.parts, numbers, tree, numbers)


def tree_unflatten(part, rows, first):
    """Nested tuples of the type of `part` with the numbers rows[first], rows[first + 1], ..."""
    indices = iter(range(first, first + tree_size(part)))

    def like(one):
        if not isinstance(one, tuple):
            return rows[next(indices)]
        return type(one)(*map(like, one)) if hasattr(one, "_fields") else tuple(map(like, one))

    return like(part)


@intrinsic(tree_unflatten)
def _tree_unflatten(typing_context, part, rows, first):
    return _read(part, rows, part, rows, first)


def _read(part: Any, rows: Any, *arguments: Any) -> tuple[Any, Callable[..., Any]]:
    """(signature, code) of an intrinsic that reads nested tuples like `part` from rows.

    arguments : the types of its arguments; if there are three, the last is the first row, else it
        is 0
    """
    word = types.intp

    def kind_of(one: Any) -> Any:
        if not isinstance(one, _Tuple):
            return rows.item
        each = [kind_of(x) for x in one]
        if not isinstance(one, _NamedTuple):
            return types.Tuple(each)
        # As Numba's own `typeof`: tuples of one type of number are another class of types.
        if each and all(x == each[0] for x in each):
            return types.NamedUniTuple(each[0], len(each), one.instance_class)
        return types.NamedTuple(each, one.instance_class)

    def generate(context: Any, builder: Any, sig: Any, values: Any) -> Any:
        memory = values[sig.args.index(rows)]
        first = values[-1] if len(values) > 2 else context.get_constant(word, 0)
        read = partial(get_row, context, builder, rows.item(rows, word))
        count = iter(range(_size_of_type(part)))

        def like(one: Any) -> Any:
            if not isinstance(one, _Tuple):
                return read((memory, builder.add(first, context.get_constant(word, next(count)))))
            return context.make_tuple(builder, kind_of(one), [like(x) for x in one])

        return like(part)

    return kind_of(part)(*arguments), generate


def tree_size(part):
    """How many numbers nested tuples have, which is how many rows they take."""
    return sum(map(tree_size, part)) if isinstance(part, tuple) else 1


@intrinsic(tree_size)
def _tree_size(typing_context, part):
    count = _size_of_type(part)
    return types.intp(part), lambda context, builder, sig, args: context.get_constant(
        types.intp, count
    )


def _size_of_type(kind: Any) -> int:
    """How many numbers a type of nested tuples has."""
    return sum(map(_size_of_type, kind)) if isinstance(kind, _Tuple) else 1


def noise_of(effect):
    """The normal deviates among an effect's numbers, new ones for each step; () if it has none."""
    return effect.noise if takes_noise(effect) else ()


@intrinsic(noise_of)
def _noise_of(typing_context, effect):
    if not takes_noise(effect.instance_class):
        return types.Tuple(())(effect), lambda context, builder, sig, args: context.make_tuple(
            builder, sig.return_type, ()
        )
    index = effect.instance_class._fields.index("noise")
    return effect[index](effect), lambda context, builder, sig, args: builder.extract_value(
        args[0], index
    )


def with_noise(effect, deviates):
    """An effect with other deviates."""
    return effect._replace(noise=deviates)


@intrinsic(with_noise)
def _with_noise(typing_context, effect, deviates):
    index = effect.instance_class._fields.index("noise")
    return effect(effect, deviates), lambda context, builder, sig, args: builder.insert_value(
        args[0], args[1], index
    )
