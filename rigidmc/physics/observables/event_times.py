"""Which variables of a result are times of events, and until when such a time is known.

A member of which the event has not come by the end has no number there, and a result has nan: the
time is later than the end. Its variable says so, `censored_at = "followed_until"`, where that
variable has the end of each member: t_end, or earlier where the member is flagged or stops.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from rigidmc.physics.observables import WATCHED, outputs
from rigidmc.physics.observables.protocol import Event, Record, Running
from rigidmc.physics.observables.statistics import STATISTICS

FOLLOWED = "followed_until"
CENSORED, LAG = "censored_at", "censored_lag"  # attributes of a variable
_COUNT, _FIRST, _FIRST_TAU = 3.0, 5.0, 5.25


def event_times(label: str, one: Any) -> dict[str, float]:
    """{variable: lag} of the times of events among the outputs of an observable over all steps.

    lag : a time is known if it is so long before the end of the member [s]: that of an event that
        has to last

    Those that the class states in `event_times`; without a statement the outputs of an event that
    are its first time, and of a running observable those in seconds.
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


def roles_of(one: Event) -> list[str]:
    """What each output of an event is: "count", "first", or "" for another."""
    numbers = _COUNT, _FIRST, 7.0, 7.25, _FIRST_TAU, 11.0, 5.5
    record = Record(*(np.array([x]) for x in numbers))
    words = {_COUNT: "count", _FIRST: "first", _FIRST_TAU: "first"}
    return [words.get(float(np.ravel(x)[0]), "") for x in one.results(record).values()]


def _in_seconds(one: Running) -> list[str]:
    return ["first" if of[0] == "s" and not of[2] else "" for of in one.outputs.values()]


def is_event_time(name: str, attrs: Mapping[str, Any]) -> bool:
    """Whether a variable of a result is the time of an event.

    attrs : of the variable; results of earlier versions do not say it, so there the shipped names
        tell
    """
    if CENSORED in attrs:
        return bool(attrs[CENSORED] == FOLLOWED)
    word, _, number = name.rpartition("_")
    return (word if number.isdigit() else name) in _SHIPPED


_SHIPPED = frozenset(name for kind in WATCHED.values() for name in kind.event_times or ())
