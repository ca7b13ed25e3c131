"""A user's observable, checked before it is compiled.

Its facts, what its methods ask for, what they return, and whether its results are those it states.
"""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from rigidmc.physics.dynamics.methods import argument_names, implements
from rigidmc.physics.dynamics.trials import RULE, Trial, states
from rigidmc.physics.observables import is_own, word_of_observable
from rigidmc.physics.observables.protocol import (
    DIMENSIONS,
    Event,
    Observable,
    Record,
    Running,
    armed,
    averages,
    begin,
    level,
    past,
    reweighed,
    size,
    sought,
    stops,
    turning,
    update,
    value,
)
from rigidmc.scene.user_parts.effects import BODY

_START = 1.0, 1.0, 1.0, 1.0
_MEMBERS = 3  # for which results are tried


def check_user_observable(one: Any, effects: tuple[Any, ...]) -> None:
    """Raise SceneError, with class, line and rule, for a user's observable that no kernel could
    use. effects : those of the scene, as compiled code has them"""
    if not is_own(one):
        return
    trial = Trial(f"observables.{word_of_observable(one)}", one)
    if isinstance(one, Observable):
        _check_fact(trial, "units", isinstance(one.units, str), "a text such as 'rad s-1'")
        _check_dims(trial, "dims", one.dims)
        _check_recorded(trial._replace(part=as_floats(trial, one)), effects)
        return
    _check_outputs(trial, one.outputs)
    _check_event_times(trial, one.event_times, one.outputs)
    if isinstance(one, Event):
        # what is compiled depends on the moments only for shipped events
        compiled = trial.run("compiled", np.ones((3, 1)), True, effects)
        _check_event(trial._replace(part=as_floats(trial, compiled)), effects)
        found = trial.run("results", Record(*[np.ones(_MEMBERS)] * len(Record._fields)))
    elif isinstance(one, Running):
        whole = isinstance(one.marks, int) and one.marks > 0
        _check_fact(trial, "marks", whole, "a whole number of 1 or more")
        _check_running(trial._replace(part=as_floats(trial, one)), effects, one.marks)
        found = trial.run("results", np.ones((one.marks, _MEMBERS)), np.ones(_MEMBERS))
    else:
        raise trial.complaint("outputs", "expected an observable, an event, or a running one")
    _check_results(trial, one.outputs, found)


def as_floats(trial: Trial, part: Any) -> Any:
    """A NamedTuple with the numbers that compiled code sees, which are floats; SceneError."""

    def plain(name: str, value: Any) -> Any:
        if isinstance(value, tuple):
            parts = [plain(name, x) for x in value]
            return type(value)(*parts) if implements(value, "_fields") else tuple(parts)
        if not isinstance(value, (bool, int, float, np.number)):
            rule = f"is {value!r}: {RULE}; `compiled` can give an event of numbers alone"
            raise trial.complaint(name, rule)
        return float(value)

    return type(part)(*(plain(k, v) for k, v in part._asdict().items()))


def _check_fact(trial: Trial, name: str, right: bool, expected: str) -> None:
    if not right:
        raise trial.complaint(name, f"is {getattr(trial.part, name)!r}, expected {expected}")


def _check_dims(trial: Trial, name: str, dims: Any) -> None:
    known = isinstance(dims, tuple) and set(dims) <= DIMENSIONS.keys()
    rule = f"has the dimensions {dims!r}, expected () or a tuple of {', '.join(DIMENSIONS)}"
    if not known:
        raise trial.complaint(name, rule)


def _check_outputs(trial: Trial, outputs: Any) -> None:
    form = 'expected {"name": (units, long_name, dims)}'
    if not isinstance(outputs, Mapping) or not outputs:
        raise trial.complaint("outputs", f"is {outputs!r}, {form}")
    for name, about in outputs.items():
        words = isinstance(about, tuple) and len(about) == 3 and isinstance(name, str)
        if not words or not name.isidentifier() or not all(isinstance(x, str) for x in about[:2]):
            raise trial.complaint("outputs", f"has {name!r}: {about!r}, {form}")
        _check_dims(trial, "outputs", about[2])


def _check_event_times(trial: Trial, stated: Any, outputs: Mapping[str, Any]) -> None:
    if stated is not None and not (isinstance(stated, tuple) and {*stated} <= {*outputs}):
        rule = f"is {stated!r}, expected a tuple of names of outputs: {', '.join(outputs)}"
        raise trial.complaint("event_times", rule)


def _check_recorded(trial: Trial, effects: Any) -> None:
    trial.read(value)
    if "works" in argument_names(trial.part, "value"):
        raise trial.complaint("value", "asks for works, which only the observable work is given")
    for state in states():
        some = {"body": BODY, "effects": effects, **state._asdict(), "start": _START, "works": ()}
        trial.numbers(value, some, size(trial.part.dims))


def _check_event(trial: Trial, effects: Any) -> None:
    if not implements(trial.part, "level"):
        rule = "is missing: an event has a level, which passes through 0 when it happens"
        raise trial.complaint("level", rule)
    trial.read(level, armed, past, stops)
    for state in states():
        some = {"body": BODY, "effects": effects, **state._asdict()}
        found = {"level": trial.number(level, some), "armed": True}
        trial.number(armed, {**some, **found})
        trial.number(past, {**some, **found})
    trial.numbers(stops, {})


def _check_running(trial: Trial, effects: Any, marks: int) -> None:
    trial.read(begin, update, turning, sought, averages, reweighed)
    kept = None
    for state in states():
        some = {"body": BODY, "effects": effects, **state._asdict()}
        kept = trial.numbers(begin, some, marks) if kept is None else kept
        kept = trial.numbers(update, {**some, "kept": kept}, marks)
        count = len(trial.numbers(turning, some))
        pairs = trial.called(sought, {"kept": kept})
        pair = isinstance(pairs, tuple) and all(isinstance(p, tuple) and len(p) == 2 for p in pairs)
        if not pair or len(pairs) != count:
            rule = f"gives {pairs!r}, expected (low, high) for each number of turning: {count}"
            raise trial.complaint("sought", rule)
    trial.numbers(averages, {})
    trial.numbers(reweighed, {"kept": kept, "longer": 1.5}, marks)


def _check_results(trial: Trial, outputs: Mapping[str, Any], found: Any) -> None:
    """The results have to be those of `outputs`, in its order, with one number per member."""
    names: Iterable[str] = found if isinstance(found, Mapping) else ()
    if list(names) != list(outputs):
        given = ", ".join(names) or type(found).__name__
        raise trial.complaint("results", f"gives {given}, expected {', '.join(outputs)}")
    for name, (_, _, dims) in outputs.items():
        shape = (*(len(DIMENSIONS[d].labels) for d in dims), _MEMBERS)
        if np.shape(found[name]) != shape:
            rule = f"gives {name} of shape {np.shape(found[name])}, expected {shape}"
            raise trial.complaint("results", f"{rule} for {_MEMBERS} members")
