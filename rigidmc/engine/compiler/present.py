"""The present numbers of effects in compiled code: fields of nested tuples are read and replaced.

Nothing here computes: `rigidmc.physics.effects.present` says what the functions mean.
"""

from collections.abc import Callable, Sequence
from typing import Any

from numba.core import types

from rigidmc.engine.compiler.intrinsics import intrinsic
from rigidmc.engine.compiler.trees import named_tuple
from rigidmc.physics.effects.present import commands_of, in_memory, in_state, memories_of, states_of
from rigidmc.physics.effects.protocol import facts

Fields = Callable[[Any], tuple[str, ...]]  # of an effect: its fields that change
_Tuple: Any = types.BaseTuple  # as Any: Numba's stubs lack the items of tuples


def _states(cls: Any) -> tuple[str, ...]:
    return facts(cls).state


def _memories(cls: Any) -> tuple[str, ...]:
    return facts(cls).memory


def _places(effects: Any, fields: Fields) -> list[tuple[int, ...]]:
    """Return the place of each number: of its effect, its field, and within a vector."""
    places = list[tuple[int, ...]]()
    for i, kind in enumerate(effects):
        for at in map(kind.instance_class._fields.index, fields(kind.instance_class)):
            is_vector = isinstance(kind[at], _Tuple)
            places += [(i, at, k) for k in range(len(kind[at]))] if is_vector else [(i, at)]
    return places


def _type_at(kind: Any, place: Sequence[int]) -> Any:
    for i in place:
        kind = kind[i]
    return kind


def _reader(function: Any, fields: Fields) -> None:
    """Give a function that returns the numbers of some fields its code."""

    @intrinsic(function)
    def define(typing_context, effects):
        places = _places(effects, fields)

        def generate(context, builder, sig, args):
            numbers = [builder.extract_value(args[0], place) for place in places]
            return context.make_tuple(builder, sig.return_type, numbers)

        return types.Tuple([_type_at(effects, place) for place in places])(effects), generate


def _put(context: Any, builder: Any, kind: Any, tree: Any, place: Sequence[int], new: Any) -> Any:
    """Return (type, value) of a nested tuple with another number or tuple at a place.

    The new number decides the type there: with derivatives by the start alone, a state has some
    and the parameters beside it have none.
    """
    if not place:
        return new
    kinds = list(kind)
    count = range(len(kinds))
    parts = [builder.extract_value(tree, i) if builder else None for i in count]
    at = place[0]
    kinds[at], parts[at] = _put(context, builder, kinds[at], parts[at], place[1:], new)
    is_named = isinstance(kind, types.BaseNamedTuple)
    made = named_tuple(kinds, kind.instance_class) if is_named else types.Tuple(kinds)
    return made, context.make_tuple(builder, made, parts) if builder else None


def _writer(function: Any, fields: Fields, commanded: bool) -> None:
    """Give a function that returns effects with other numbers in some fields its code.

    commanded : whether actuators get what memories command
    """

    def changed(effects: Any, numbers: Any, context: Any, builder: Any, values: Any) -> Any:
        kind, tree = effects, values[0] if builder else None
        for i, place in enumerate(_places(effects, fields)):
            new = numbers[i], builder.extract_value(values[1], i) if builder else None
            kind, tree = _put(context, builder, kind, tree, place, new)
        for at, field, target, other, component in (
            commands_of([e.instance_class for e in effects]) if commanded else ()
        ):
            place = (at, kind[at].instance_class._fields.index(field))
            place += () if component is None else (component,)
            new = _type_at(kind, place), builder.extract_value(tree, place) if builder else None
            to = target, kind[target].instance_class._fields.index(other)
            kind, tree = _put(context, builder, kind, tree, to, new)
        return kind, tree

    @intrinsic(function)
    def define(typing_context, effects, numbers):
        kind, _ = changed(effects, numbers, None, None, None)

        def generate(context, builder, sig, args):
            return changed(effects, numbers, context, builder, args)[1]

        return kind(effects, numbers), generate


_reader(states_of, _states)
_reader(memories_of, _memories)
_writer(in_state, _states, commanded=False)
_writer(in_memory, _memories, commanded=True)
