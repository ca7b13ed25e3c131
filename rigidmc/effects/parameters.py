"""The parameters of effects as rows of numbers, in the order of the fields.

A parameter is a number, or a vector if the class states its length in `shapes`. In a block each
number is a row.
"""

from collections.abc import Iterable
from typing import Any

from rigidmc.effects.protocol import Effect, facts


def shape(kind: Effect | type[Effect], field: str) -> int | None:
    """The length of a parameter, None if it is a plain number."""
    return facts(kind).shapes.get(field)


def given(kind: Effect | type[Effect]) -> tuple[str, ...]:
    """The parameters that a user gives; the engine fills in the hidden ones."""
    return tuple(field for field in kind._fields if field not in facts(kind).hidden)


def numbers(effect: Effect) -> list[tuple[str, int | None, Any]]:
    """[(field, component, value)] of all numbers of an effect; component is None for plain ones."""
    found: list[tuple[str, int | None, Any]] = []
    for field, value in zip(effect._fields, effect, strict=True):
        size = shape(effect, field)
        found += (
            [(field, None, value)] if size is None else [(field, i, value[i]) for i in range(size)]
        )
    return found


def parameter_count(*effects: Effect) -> int:
    """How many numbers some effects have together."""
    return sum(shape(e, field) or 1 for e in effects for field in e._fields)


def filled(kind: type[Effect], values: Iterable[Any]) -> Any:
    """An effect of a class from its numbers in a row; each may be an array or any stand-in."""
    left = iter(values)
    fields = []
    for field in kind._fields:
        size = shape(kind, field)
        fields.append(next(left) if size is None else tuple(next(left) for _ in range(size)))
    return kind(*fields)


def blank(effects: Iterable[Effect]) -> tuple[Any, ...]:
    """The effects with all numbers 0: the types that a kernel is compiled for."""
    return tuple(filled(type(e), [0.0] * parameter_count(e)) for e in effects)
