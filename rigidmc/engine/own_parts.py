"""A user's own parts, compiled by themselves: integrators and what is recorded or watched.

What cannot be compiled is refused with the name of its class, and what takes one number at a time
is told.
"""

import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

from rigidmc.dynamics.euler import MassProperties
from rigidmc.dynamics.methods import implements
from rigidmc.dynamics.so3 import first_three, select
from rigidmc.dynamics.trials import RULE
from rigidmc.engine.cache import kept_text
from rigidmc.engine.compose import NumbaError, inline_all, reason
from rigidmc.engine.formulas import WIDTH
from rigidmc.engine.kinds import filled, parts_of
from rigidmc.engine.memory import four_at, put, three_at
from rigidmc.engine.operations import ONE_AT_A_TIME, why_one_at_a_time
from rigidmc.engine.pieces import config, dispatcher_of, kind_of, signature_of
from rigidmc.errors import SceneError
from rigidmc.integrators.protocol import closed, constants, opened, step
from rigidmc.observables.protocol import (
    armed,
    averages,
    begin,
    level,
    past,
    reweighed,
    sought,
    steady,
    stops,
    turning,
    update,
    value,
)

_BODY = MassProperties(*[1.0] * 9)
_found: dict[Any, str] = {}  # by the types of the part and of the effects


def slow_parts(
    integrator: Any, effects: Sequence[Any], watched: Iterable[Any]
) -> list[tuple[str, str]]:
    """[(class, why)] of the user's own parts with which members cannot be worked on side by side.

    watched : observables, compiled events, running observables
    Raises SceneError for an integrator or an observable that cannot be compiled.
    """
    if config.DISABLE_JIT:
        return []
    found = [(type(effect).__name__, why_one_at_a_time(effect)) for effect in effects]
    kinds = [("run", integrator, _made), *(("observables", one, _seen) for one in watched)]
    for table, part, probe in kinds:
        for own in _own(part):
            found.append((type(own).__name__, _why(table, own, part, effects, probe)))
    return [(name, why) for name, why in found if why]


def _own(part: Any) -> Iterator[Any]:
    """The NamedTuples of the user's own among nested tuples."""
    if isinstance(part, tuple):
        if implements(part, "_fields") and not type(part).__module__.startswith("rigidmc."):
            yield part
        for one in part:
            yield from _own(one)


def _why(
    table: str, own: Any, whole: Any, effects: Sequence[Any], probe: Callable[..., int]
) -> str:
    """Why members cannot be worked on side by side with a part, or ""; SceneError."""
    parts = whole, tuple(effects)
    key = probe, kind_of(parts)

    def tried() -> str:
        found = ""
        try:
            code = _compiled(probe, parts, WIDTH)
        except NumbaError:
            found = ONE_AT_A_TIME
            try:
                code = _compiled(probe, parts, 1)
            except NumbaError as error:
                rule = f"cannot be compiled: {reason(error)}; {RULE}"
                raise SceneError(table, type(own).__name__, None, rule) from None
        if "NRT_" in code:
            raise SceneError(table, type(own).__name__, None, f"takes memory; {RULE}")
        return found

    if key not in _found:
        signature = signature_of(parts, "float64", WIDTH, "s")
        _found[key] = kept_text([signature], f"own_parts {probe.__name__}", tried)
    return _found[key]


def _compiled(probe: Callable[..., int], parts: Any, lanes: int) -> str:
    """LLVM's code of a probe for so many members side by side."""
    compiled = dispatcher_of(probe)
    compiled.compile(signature_of(parts, "float64", lanes, "s"))
    (code,) = compiled.inspect_llvm().values()
    return str(code)


def _seen(kinds, numbers, at):
    """What is compiled to see whether all methods of an observable run on vectors."""
    one, effects = parts_of(kinds, numbers)
    present = filled(effects, at, 30)
    body, q, l, t = filled(_BODY, at, 8), four_at(at, 0), three_at(at, 4), at[7]
    put(value(one, body, present, t, q, l, four_at(at, 8), ()), at, 0)
    height = level(one, body, present, t, q, l)
    waits = armed(one, body, q, l, height, height < 0.0)
    put((select(waits, 1.0, 0.0), select(past(one, height), 1.0, 0.0)), at, 0)
    kept = begin(one, body, present, t, q, l)
    put(update(one, kept, body, present, t, q, l), at, 0)
    put(turning(one, body, present, t, q, l), at, 0)
    put_pairs(sought(one, kept), at)
    put(reweighed(one, kept, t), at, 0)
    return len(averages(one)) + len(steady(one)) + len(stops(one))


def put_pairs(pairs, at):
    """Write pairs of numbers."""
    if len(pairs) == 0:
        return 0
    put(pairs[0], at, 0)
    return put_pairs(pairs[1:], at)


def _made(kinds, numbers, at):
    """What is compiled to see whether a step runs on vectors."""
    integrator, effects = parts_of(kinds, numbers)
    present = filled(effects, at, 30)
    body, q, l, t, h = filled(_BODY, at, 8), four_at(at, 0), three_at(at, 4), at[7], at[29]
    part = h, h, h
    q, l = opened(integrator, body, present, t, part, q, l)
    once = constants(integrator, body, part, l)
    q, l = step(integrator, body, present, t, h, part, q, l, once)
    q, l = closed(integrator, body, present, t, part, q, l)
    put(q + first_three(l), at, 0)
    return 0


inline_all(sys.modules[__name__])
