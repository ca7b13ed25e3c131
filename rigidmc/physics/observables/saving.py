"""Observables in a result: how much of each is kept, and which variables are event times.

The larger the ensemble, the less of each member is worth keeping:

full       omega(time, axis, member), every save
thinned    omega_thinned(thinned_time, ...), every `thin`-th save, and the last
summary    omega_min, omega_max, omega_mean and so on, see `rigidmc.physics.observables.statistics`
final      omega_final(axis, member), the last save
none       nothing

Every save of flagged members is kept, whatever is kept of the others: omega_flagged(time, axis,
flagged), with member indices in flagged_member.

If the event of a member has not occurred by the end of the member, its event time is nan: the event
time is censored, later than the end. The variable has the attribute `censored_at =
"followed_until"`, and the variable followed_until has the end of each member: t_end, or earlier if
the member is flagged or stops.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigidmc.errors import SceneError, unknown
from rigidmc.physics.dynamics.dual_arrays import DualArray, has_tangents, plain
from rigidmc.physics.observables import (
    OBSERVABLES,
    OUTCOMES,
    bare_observables,
    default_names,
    is_opaque,
    label_observables,
    monitors,
    outputs,
    own,
    statistics,
    word_of_observable,
)
from rigidmc.physics.observables.protocol import Event, EventRecord, Running
from rigidmc.physics.observables.statistics import STATISTICS

WORDS = ("none", "final", "summary", "thinned", "full")
Keep = str | Mapping[str, str]  # one word for all observables, or {name: word}


def owners_of_variables(given: Iterable[Any] = ()) -> dict[str, str]:
    """Return {variable: observable over all steps that makes it}."""
    custom = {word_of_observable(one): one for one in given if not is_opaque(one)}
    kinds = {**OBSERVABLES, **custom}
    return {name: word for word, one in kinds.items() for name in getattr(one, "outputs", ())}


def why_not_saved(name: str, given: Sequence[Any]) -> str:
    """Return why a variable of results is not a name to save, and what to save; "" for others."""
    base, _, end = name.rpartition("_")
    saved = (*default_names(given), *own(given))
    if (owner := owners_of_variables(given).get(name)) is not None:
        return f"is a variable of {owner}: save '{owner}'"
    if name in OUTCOMES:
        return "is in every result: omit it"
    if base in saved and end in (*WORDS, "flagged"):
        return f"is {base} as the setting keep stores it: save '{base}'"
    if name.removeprefix("d_") in saved:
        base = name.removeprefix("d_")
        return f"is a derivative: save '{base}', and name parameters in wrt"
    return ""


def check_keep(keep: Keep, given: Sequence[Any] = ()) -> None:
    """Raise SceneError if the setting `keep` contains an unknown observable or word.

    given : the observables of the scene, with their parameters
    """
    opaque = [label for label, one in label_observables(given) if is_opaque(one)]
    names, summed = (*bare_observables(), *own(given), *opaque), statistics(given)
    named = {None: keep} if isinstance(keep, str) else keep
    for name, word in named.items():
        key = "keep" if name is None else f"keep.{name}"
        if name in monitors() or name in owners_of_variables(given):
            rule = (
                "has one value per member, whatever is kept: keep is of observables at save times"
            )
            raise SceneError(rule, at=f"run.{key}", table="run", value=name)
        if name is not None and name not in names:
            raise unknown(
                "observable at save times", names, at=f"run.{key}", table="run", value=name
            )
        if word not in WORDS:
            raise unknown("way to keep it", WORDS, at=f"run.{key}", table="run", value=word)
        if word == "summary" and name is not None and f"{name}_mean" not in summed:
            rule = "it has no summary over the steps: keep it final, thinned or full"
            raise SceneError(rule, at=f"run.{key}", table="run", value=word)


def save_words(keep: Keep, saved: Iterable[str], given: Sequence[Any] = ()) -> dict[str, str]:
    """Return {name: word} of the saved observables.

    If all are summarised, an observable without a summary keeps its last save.
    """
    summed = statistics(given)
    words = {name: keep if isinstance(keep, str) else keep.get(name, "full") for name in saved}
    return {
        name: "final" if word == "summary" and f"{name}_mean" not in summed else word
        for name, word in words.items()
    }


def summaries(kept: Mapping[str, str]) -> tuple[str, ...]:
    """Return the names of the running statistics of summarised observables."""
    return tuple(
        f"{name}_{statistic}"
        for name, word in kept.items()
        if word == "summary"
        for statistic in STATISTICS
    )


def thinned_indices(count: int, thin: int) -> NDArray[np.intp]:
    """Return the indices of the saves that a thinned observable keeps, out of `count` saves."""
    return np.unique(np.append(np.arange(0, count, thin), count - 1))


FOLLOWED = "followed_until"
CENSORED, LAG = "censored_at", "censored_lag"  # attributes of a variable
_COUNT, _FIRST, _FIRST_TAU = 3.0, 5.0, 5.25


def event_times(label: str, one: Any) -> dict[str, float]:
    """Return {variable: lag} of the event times among the outputs of an observable over all steps.

    lag : an event time is known if it is this long before the end of the member [s]; 0 except for
        an event with a hold time

    The class may list event times in `event_times`. Otherwise they are the first time of an event,
    or the outputs in seconds of a running observable.
    """
    if type(one) in STATISTICS.values() or not isinstance(one, (Event, Running)):
        return {}
    variables = outputs(label, one)
    stated = one.event_times
    if stated is None:
        roles = roles_of(one) if isinstance(one, Event) else _in_seconds(one)
        found = zip(one.outputs, roles, strict=True)
        stated = tuple(name for name, role in found if role == "first")
    lag = float(getattr(one, "hold", 0.0))
    return {name: lag for name, of in zip(variables, one.outputs, strict=True) if of in stated}


def results_of(one: Any, numbers: Any, *more: Any) -> dict[str, Any]:
    """Return the outputs of an observable over all steps, with tangents if its numbers have them.

    numbers : the first argument of its method `results`;  more : the others
    Code without a rule for tangents gives plain arrays.
    """
    try:
        found: dict[str, Any] = one.results(numbers, *more)
    except (AttributeError, TypeError, ValueError):  # a custom class, written for plain arrays
        if not has_tangents(numbers):
            raise
        record = isinstance(numbers, EventRecord)
        found = one.results(EventRecord(*map(plain, numbers)) if record else plain(numbers), *more)
    return found


def outputs_with_derivatives(label: str, one: Any) -> list[str]:
    """Return the variables of an observable over all steps that have derivatives by parameters of
    the scene. Counts, and the growth of a tangent, have none.

    label : as in `rigidmc.physics.observables.outputs`
    """
    some: Any = DualArray(np.ones(1), np.ones((1, 1)))
    if isinstance(one, Event):
        found = results_of(one, with_derivatives(EventRecord(*(some,) * 7)))
    elif isinstance(one, Running):
        found = results_of(one, np.stack([some] * one.state_size), np.array([3.0]))
    else:
        return []
    names = zip(outputs(label, one), found.values(), strict=True)
    return [name for name, values in names if isinstance(values, DualArray)]


def with_derivatives(record: EventRecord) -> EventRecord:
    """Return a record whose count, and the end of a step, have no tangents."""
    return record._replace(count=plain(record.count), seen=plain(record.seen))


def roles_of(one: Event) -> list[str]:
    """Return the role of each output of an event: "count", "first", or "" for another."""
    # All differ, and no sum, difference or ratio of two of them is 3, 5 or 5.25: an output with one
    # of these has its role.
    numbers = _COUNT, _FIRST, 7.0, 7.25, _FIRST_TAU, 11.0, 5.5
    record = EventRecord(*(np.array([x]) for x in numbers))
    words = {_COUNT: "count", _FIRST: "first", _FIRST_TAU: "first"}
    return [words.get(float(np.ravel(x)[0]), "") for x in one.results(record).values()]


def _in_seconds(one: Running) -> list[str]:
    return ["first" if of[0] == "s" and not of[2] else "" for of in one.outputs.values()]


def is_event_time(name: str, attrs: Mapping[str, Any]) -> bool:
    """Return whether a variable of a result is the time of an event.

    attrs : of the variable; results of earlier versions lack the attribute, so the shipped names
        decide
    """
    if CENSORED in attrs:
        return bool(attrs[CENSORED] == FOLLOWED)
    word, _, number = name.rpartition("_")
    return (word if number.isdigit() else name) in _SHIPPED


_SHIPPED = frozenset(name for kind in monitors().values() for name in kind.event_times or ())
