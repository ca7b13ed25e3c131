"""Check of a custom observable before compilation.

It checks the properties, the arguments and return values of the methods, and the stated results.
"""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from rigidmc.physics.dynamics.methods import argument_names, implements
from rigidmc.physics.dynamics.trials import RULE, Trial, states
from rigidmc.physics.observables import is_own, word_of_observable
from rigidmc.physics.observables.compiled import (
    armed,
    begin,
    counts_at_start,
    extrema,
    extremum_limits,
    is_terminal,
    is_time_average,
    level,
    merged,
    reweighed,
    update,
    value,
)
from rigidmc.physics.observables.protocol import (
    DIMENSIONS,
    OLD_WORDS,
    Event,
    EventRecord,
    Observable,
    Running,
    size,
)
from rigidmc.scene.user_parts.effects import BODY

_START = 1.0, 1.0, 1.0, 1.0
_MEMBERS = 3  # number of members in a trial of results


def check_user_observable(user: Any, effects: tuple[Any, ...]) -> None:
    """Raise SceneError, with class, line and rule, for a custom observable that no kernel can use.
    effects : effects of the scene, in the form of compiled code"""
    if not is_own(user):
        return
    trial = Trial(f"observables.{word_of_observable(user)}", user)
    trial.refuse_old(OLD_WORDS)
    if isinstance(user, Observable):
        _check_fact(trial, "units", isinstance(user.units, str), "a text such as 'rad s-1'")
        _check_dims(trial, "dims", user.dims)
        _check_recorded(trial._replace(part=as_floats(trial, user)), effects)
        return
    _check_outputs(trial, user.outputs)
    times, outputs = user.event_times, user.outputs
    if times is not None and not (isinstance(times, tuple) and {*times} <= {*outputs}):
        rule = f"is {times!r}, expected a tuple of names of outputs: {', '.join(outputs)}"
        raise trial.complaint("event_times", rule)
    if isinstance(user, Event):
        # compiled code depends on the moments only for shipped events
        compiled = trial.run("bind", np.ones((3, 1)), True, effects)
        _check_event(trial._replace(part=as_floats(trial, compiled)), effects)
        made = trial.run("results", EventRecord(*[np.ones(_MEMBERS)] * len(EventRecord._fields)))
    elif isinstance(user, Running):
        is_count = isinstance(user.state_size, int) and user.state_size > 0
        _check_fact(trial, "state_size", is_count, "an integer of 1 or more")
        _check_running(trial._replace(part=as_floats(trial, user)), effects, user.state_size)
        made = trial.run("results", np.ones((user.state_size, _MEMBERS)), np.ones(_MEMBERS))
    else:
        raise trial.complaint("outputs", "expected an observable, event or running observable")
    _check_results(trial, user.outputs, made)


def as_floats(trial: Trial, part: Any) -> Any:
    """Return a NamedTuple with floats, the numbers of compiled code; SceneError."""

    def plain(name: str, value: Any) -> Any:
        if isinstance(value, tuple):
            parts = [plain(name, x) for x in value]
            return type(value)(*parts) if implements(value, "_fields") else tuple(parts)
        if not isinstance(value, (bool, int, float, np.number)):
            rule = f"is {value!r}: {RULE}; `bind` can return an event with only numbers"
            raise trial.complaint(name, rule)
        return float(value)

    return type(part)(*(plain(k, v) for k, v in part._asdict().items()))


def _check_fact(trial: Trial, name: str, right: bool, expected: str) -> None:
    if not right:
        raise trial.complaint(name, f"is {getattr(trial.part, name)!r}, expected {expected}")


def _check_dims(trial: Trial, name: str, dims: Any) -> None:
    are_known = isinstance(dims, tuple) and set(dims) <= DIMENSIONS.keys()
    rule = f"has the dimensions {dims!r}, expected () or a tuple of {', '.join(DIMENSIONS)}"
    if not are_known:
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


def _check_recorded(trial: Trial, effects: Any) -> None:
    trial.read(value)
    if "works" in argument_names(trial.part, "value"):
        raise trial.complaint("value", "uses works, which only the observable work receives")
    for state in states():
        some = {"body": BODY, "effects": effects, **state._asdict(), "start": _START, "works": ()}
        trial.numbers(value, some, size(trial.part.dims))


def _check_event(trial: Trial, effects: Any) -> None:
    if not implements(trial.part, "level"):
        rule = "is missing: an event needs a level, which passes through 0 when it happens"
        raise trial.complaint("level", rule)
    trial.read(level, armed, counts_at_start, is_terminal)
    for state in states():
        some = {"body": BODY, "effects": effects, **state._asdict()}
        levels = {"level": trial.number(level, some), "armed": True}
        trial.number(armed, {**some, **levels})
        trial.number(counts_at_start, {**some, **levels})
    trial.numbers(is_terminal, {})


def _check_running(trial: Trial, effects: Any, size_of_state: int) -> None:
    trial.read(begin, update, extrema, extremum_limits, merged, is_time_average, reweighed)
    numbers = None
    for state in states():
        some = {"body": BODY, "effects": effects, **state._asdict()}
        numbers = trial.numbers(begin, some, size_of_state) if numbers is None else numbers
        numbers = trial.numbers(update, {**some, "state": numbers}, size_of_state)
        count = len(trial.numbers(extrema, some))
        pairs = trial.called(extremum_limits, {"state": numbers})
        pair = isinstance(pairs, tuple) and all(isinstance(p, tuple) and len(p) == 2 for p in pairs)
        if not pair or len(pairs) != count:
            rule = f"returns {pairs!r}, expected (low, high) for each number of extrema: {count}"
            raise trial.complaint("extremum_limits", rule)
    trial.numbers(is_time_average, {})
    trial.numbers(reweighed, {"state": numbers, "longer": 1.5}, size_of_state)
    same = {"state": numbers, "without": numbers, "inserted": numbers}
    trial.numbers(merged, same, size_of_state)


def _check_results(trial: Trial, outputs: Mapping[str, Any], results: Any) -> None:
    """Check that the results match `outputs`, in its order, with one number per member."""
    names: Iterable[str] = results if isinstance(results, Mapping) else ()
    if list(names) != list(outputs):
        names_found = ", ".join(names) or type(results).__name__
        raise trial.complaint("results", f"returns {names_found}, expected {', '.join(outputs)}")
    for name, (_, _, dims) in outputs.items():
        shape = (*(len(DIMENSIONS[d].labels) for d in dims), _MEMBERS)
        if np.shape(results[name]) != shape:
            rule = f"returns {name} with shape {np.shape(results[name])}, expected {shape}"
            raise trial.complaint("results", f"{rule} for {_MEMBERS} members")
