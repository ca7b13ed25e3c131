"""Nested NamedTuples as arguments of compiled code: their types are compiled, their numbers read.

A StaticTree holds only the types. The numbers come from flat memory (`tree_unpack`) for an
integrator and its limits, or from rows (`tree_unflatten`) where each member has its own, such as
the parameters of effects. So kernels for all scenes are called in the same way.
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
    """The types a kernel is compiled for: NamedTuples, and tuples of them, without their numbers.

    Compiled, it needs no memory: its type holds all information.
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
    """Return the numbers of nested tuples, one after the other, in the order of `tree_unpack`."""
    if isinstance(part, tuple):
        return [number for item in part for number in tree_flatten(item)]
    return [float(part)]


def tree_unpack(tree, numbers):
    """Return the parts of a StaticTree, with the numbers that `tree_flatten` put in flat memory."""
    return tree.parts


@intrinsic(tree_unpack)
def _tree_unpack(typing_context, tree, numbers):
    return _read(tree.parts, numbers, tree, numbers)


def tree_unflatten(part, rows, first):
    """Return nested tuples of the type of `part`, with numbers rows[first], rows[first + 1], ..."""
    indices = iter(range(first, first + tree_size(part)))

    def like(item):
        if not isinstance(item, tuple):
            return rows[next(indices)]
        return type(item)(*map(like, item)) if hasattr(item, "_fields") else tuple(map(like, item))

    return like(part)


@intrinsic(tree_unflatten)
def _tree_unflatten(typing_context, part, rows, first):
    return _read(part, rows, part, rows, first)


def _read(part: Any, rows: Any, *arguments: Any) -> tuple[Any, Callable[..., Any]]:
    """Return (signature, code) of an intrinsic that reads nested tuples like `part` from rows.

    arguments : the types of its arguments; the third, if given, is the first row, else that is 0
    """
    word = types.intp

    def kind_of(nested: Any) -> Any:
        if not isinstance(nested, _Tuple):
            return rows.item
        each = [kind_of(x) for x in nested]
        if not isinstance(nested, _NamedTuple):
            return types.Tuple(each)
        return named_tuple(each, nested.instance_class)

    def generate(context: Any, builder: Any, sig: Any, values: Any) -> Any:
        memory = values[sig.args.index(rows)]
        first = values[-1] if len(values) > 2 else context.get_constant(word, 0)
        read = partial(get_row, context, builder, rows.item(rows, word))
        count = iter(range(_size_of_type(part)))

        def like(nested: Any) -> Any:
            if not isinstance(nested, _Tuple):
                return read((memory, builder.add(first, context.get_constant(word, next(count)))))
            return context.make_tuple(builder, kind_of(nested), [like(x) for x in nested])

        return like(part)

    return kind_of(part)(*arguments), generate


def named_tuple(each: Any, cls: type) -> Any:
    """Return the type of a NamedTuple with fields of these types."""
    # As in Numba's own `typeof`: tuples with one type of number are another class of types.
    if each and all(x == each[0] for x in each):
        return types.NamedUniTuple(each[0], len(each), cls)
    return types.NamedTuple(each, cls)


def tree_size(part):
    """Return how many numbers nested tuples have, which is the number of rows they need."""
    return sum(map(tree_size, part)) if isinstance(part, tuple) else 1


@intrinsic(tree_size)
def _tree_size(typing_context, part):
    count = _size_of_type(part)
    return types.intp(part), lambda context, builder, sig, args: context.get_constant(
        types.intp, count
    )


def _size_of_type(kind: Any) -> int:
    """Return how many numbers a type of nested tuples has."""
    return sum(map(_size_of_type, kind)) if isinstance(kind, _Tuple) else 1


def noise_of(effect):
    """Return the normal deviates among an effect's numbers, new for each step; () if none."""
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
    """Return an effect with other deviates."""
    return effect._replace(noise=deviates)


@intrinsic(with_noise)
def _with_noise(typing_context, effect, deviates):
    index = effect.instance_class._fields.index("noise")
    return effect(effect, deviates), lambda context, builder, sig, args: builder.insert_value(
        args[0], context.cast(builder, args[1], deviates, effect[index]), index
    )
