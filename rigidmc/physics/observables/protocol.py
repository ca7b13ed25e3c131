"""What is asked of the class of an observable: its facts, its methods, and the defaults of both.

A class is a NamedTuple with one of the decorators below, which states its facts, adds the defaults
and refuses a class that lacks the rest. Its fields are the numbers of a table [observables.NAME] in
a scene.

`value`, `monotone`, `begin`, `update`, `extrema`, `extremum_limits`, `is_time_average`,
`reweighed`, `is_conserved`, `level`, `armed`, `counts_at_start`, `dwell` and `is_terminal` are
called from compiled code. As the methods of effects, they name the arguments that they depend on
and are given no others: body, effects, t, q, l, and `value` also start and works. They are plain
arithmetic, see `rigidmc.physics.dynamics.methods`. All other methods are Python and take arrays,
members last.
"""

import inspect
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, Protocol, TypeVar, cast, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from rigidmc.physics.dynamics.methods import OFF, ON, method

Array = NDArray[np.float64]
Dims = tuple[str, ...]
Outputs = Mapping[str, tuple[str, str, Dims]]  # {variable: (units, long_name, dims)}


class Dimension(NamedTuple):
    """A dimension of values: the label of each component, and what the dimension is."""

    labels: tuple[Any, ...]
    long_name: str


DIMENSIONS = {
    "axis": Dimension((1, 2, 3), "principal axis of the body"),
    "quat": Dimension(("w", "x", "y", "z"), "component of the quaternion, scalar first"),
    "angle": Dimension(("roll", "pitch", "yaw"), "angle of the body in the frame of its orbit"),
}  # the dimension "effect" has as many components as the scene has effects


def size(dims: Dims, effects: int = 0) -> int:
    """How many numbers values of these dimensions have. effects : length of "effect"."""
    return math.prod(effects if d == "effect" else len(DIMENSIONS[d].labels) for d in dims)


@runtime_checkable
class Observable(Protocol):
    """Recorded at save times, by `value`.

    units, long_name, dims : of the variable; dims is () for a number, else names of DIMENSIONS, or
        ("effect",) for one number of each effect
    conserved : "energy", "energy_drift", "l2" or "lz", if that law of
        `rigidmc.scene.recording` keeps it constant; "" for none
    """

    units: str
    long_name: str
    dims: Dims
    conserved: str
    value: Callable[..., tuple[Any, ...]]


class Monitored(Protocol):
    """Observed over all steps, with one result per member and no trajectory kept.

    outputs : the variables of the result; {name} in a long_name stands for one of `label_fields`
    stop : whether the member stops when the event has happened
    event_times : names of the outputs that are times of events, each nan while its event has not
        come: estimates take it for later than the end of the member. None for the first time of an
        event, and for what a running observable gives in seconds; () if that is no such time
    """

    outputs: Outputs
    stop: bool
    event_times: tuple[str, ...] | None

    def check(self) -> None:
        """Raise SceneError if a number of the observable is not allowed."""

    def label_fields(self) -> dict[str, Any]:
        """The numbers as the long_names of `outputs` show them."""


class EventRecord(NamedTuple):
    """What is known of an event at the end of a run, one number of each member.

    count : how often it happened, nan if the member is not healthy
    first, last : when, to the order of the integrator [s]; nan if never
    tau, first_tau : when last and first, by a straight line within the step [s]
    squares : sum of the squares of the times between, by straight lines [s2]
    seen : end of the step in which it first happened [s]; nan if never
    """

    count: Array  # type: ignore[assignment]  # a tuple has a method of this name
    first: Array
    last: Array
    tau: Array
    first_tau: Array
    squares: Array
    seen: Array


@runtime_checkable
class Event(Monitored, Protocol):
    """An event: it happens when its `level` passes through 0 while it is `armed`.

    `bind` gives the NamedTuple that has `level`, and perhaps `armed`, `counts_at_start` and
    `is_terminal`.
    """

    def bind(self, moments: Array, complete: bool, effects: Sequence[Any]) -> Any:
        """The event for bodies of these moments (3, n) under these effects.

        complete : whether these are all bodies
        """

    def results(self, record: EventRecord) -> dict[str, Array]:
        """The outputs."""


@runtime_checkable
class Running(Monitored, Protocol):
    """A few numbers of each member, which `begin` sets and `update` changes after every step.

    state_size : how many numbers
    """

    state_size: int
    begin: Callable[..., tuple[Any, ...]]
    update: Callable[..., tuple[Any, ...]]

    def results(self, state: Array, steps: Array) -> dict[str, Array]:
        """The outputs from the numbers (state_size, n) after so many steps of each member.

        If the last steps are shorter, the steps before them count for more, see `reweighed`.
        """


@runtime_checkable
class Neighbour(Monitored, Protocol):
    """What a shadow trajectory shows, see `rigidmc.engine.kernel.shadow`."""

    shadow: bool

    def results(self, state: Array, steps: float, h: Array) -> dict[str, Array]:
        """The outputs from the sums (3, n) over a time of so many steps h [s]."""


@runtime_checkable
class EnsembleObservable(Monitored, Protocol):
    """Counts of all members at save times, from an observable of which no member is stored.

    name, component : of the observable
    """

    @property
    def name(self) -> str: ...

    @property
    def component(self) -> int: ...

    def edges(self) -> Array:
        """The ends of the bins (bins + 1)."""

    def counts(self, values: Array) -> NDArray[np.intp]:
        """Counts (times, bins + 2) of values (times, members): below, in each bin, above."""


def _conserved(self):
    """The flag of an observable that is conserved."""
    return ON


def _no_check(self: Any) -> None:
    """All numbers are allowed."""


def _no_fields(self: Any) -> dict[str, Any]:
    """No word to fill in."""
    return {}


def _as_it_stands(self: Any, moments: Array, complete: bool, effects: Sequence[Any]) -> Any:
    """The class itself has `level`."""
    return self


_OVER_STEPS = {
    "outputs": {},
    "stop": False,
    "event_times": None,
    "check": _no_check,
    "label_fields": _no_fields,
}
_DEFAULTS: dict[type, dict[str, Any]] = {
    Observable: {"conserved": ""},
    Event: {**_OVER_STEPS, "bind": _as_it_stands},
    Running: _OVER_STEPS,
    Neighbour: _OVER_STEPS,
    EnsembleObservable: _OVER_STEPS,
}
# Methods and facts of earlier versions, and what they are called now; until 1.0.
OLD_WORDS = {
    "turning": "extrema",
    "sought": "extremum_limits",
    "holds": "dwell",
    "stops": "is_terminal",
    "past": "counts_at_start",
    "averages": "is_time_average",
    "steady": "is_conserved",
    "compiled": "bind",
    "under": "bind",
    "marks": "state_size",
    "words": "label_fields",
}
_STATED = ("word", "squares")  # of statistics, see `rigidmc.physics.observables.statistics`
Kind = TypeVar("Kind", bound=type)


def _decorator(protocol: type) -> Callable[..., Callable[[Kind], Kind]]:
    """The decorator of classes for a protocol.

    It states facts of the class, `@observable(units="1", long_name="...", dims=())`, which become
    class attributes. Type checkers would take attributes in the body of a NamedTuple for fields.
    """
    known = {*_members(protocol), *_DEFAULTS[protocol], *_STATED}

    def decorator(**facts: Any) -> Callable[[Kind], Kind]:
        if wrong := facts.keys() - known:
            now = [f"; {old} is now called {OLD_WORDS[old]}" for old in wrong if old in OLD_WORDS]
            raise TypeError(f"{protocol.__name__} has no {', '.join(wrong)}{''.join(now)}")

        def complete(cls: Kind) -> Kind:
            for name, value in facts.items():
                setattr(cls, name, value)
            for name, default in _DEFAULTS[protocol].items():
                if not hasattr(cls, name):
                    setattr(cls, name, default)
            if facts.get("conserved"):
                cast(Any, cls).is_conserved = _conserved
            if missing := [name for name in _members(protocol) if not hasattr(cls, name)]:
                words = ", ".join(missing)
                raise TypeError(f"{cls.__name__} has no {words}: see {protocol.__name__}")
            return cls

        return complete

    return decorator


def _members(protocol: type) -> Sequence[str]:
    """Names of the facts and methods that a protocol asks for."""
    # Protocol itself has members that no class needs.
    bases = [base for base in protocol.__mro__ if base.__module__ == __name__]
    names = [name for base in bases for name in (*inspect.get_annotations(base), *vars(base))]
    return [name for name in names if not name.startswith("_")]


observable = _decorator(Observable)
event = _decorator(Event)
running = _decorator(Running)
neighbour = _decorator(Neighbour)
ensemble = _decorator(EnsembleObservable)


@method
def value(observable, body, effects, t, q, l, start, works):
    """Tuple of values at time t.

    start = (E, 1/scale of E, |L|^2, 1/|L|^2) at t = 0;  works : of the effects so far [J]
    """
    return (0.0,)


@method
def begin(running, body, effects, t, q, l):
    """The numbers of a running observable at the start: a tuple of floats."""
    return (0.0,)


@method
def update(running, state, body, effects, t, q, l):
    """The numbers after a step that ended at t; state : before it."""
    return state


@method
def extrema(observable, body, effects, t, q, l):
    """Numbers whose extrema within a step count: a tuple."""
    return ()


@method
def extremum_limits(observable, state):
    """For each number of `extrema` (low, high): the running observable is updated at a smallest one
    below `low`, and at a largest one above `high`."""
    return ()


@method
def monotone(observable, values):
    """Numbers that rise with each of the values of an observable and are smooth: extremes of the
    values are sought by these."""
    return values


@method
def is_time_average(observable):
    """ON if a running observable is a mean over time: means are updated at states within a step
    too, which lie equally far apart."""
    return OFF


@method
def reweighed(running, state, longer):
    """The numbers of a running observable if each step so far counts as `longer` steps to come: the
    steps of a last interval may be shorter. Sums over steps times this are weighed by time; by
    default nothing changes."""
    return state


@method
def is_conserved(observable):
    """ON if an observable is conserved: statistics of it are those of the ends of steps, because a
    state within a step is known to fewer digits."""
    return OFF


@method
def level(event, body, effects, t, q, l):
    """A number that passes through 0 when the event happens."""
    return 1.0


@method
def armed(event, body, q, l, level, armed):
    """Whether the event may happen next, by default if its level is below 0.

    armed : whether it might have happened in the last step, and did not
    """
    return level < 0.0


@method
def counts_at_start(event, level):
    """Whether the event counts as happened at the start, by default if its level is not below 0."""
    return level >= 0.0


@method
def dwell(event):
    """() if an event counts when its level passes through 0. (T,) if it counts only once the level
    has been above 0 for T seconds; with a second number also within steps, by dense output."""
    return ()


@method
def is_terminal(event):
    """ON if the event stops the member: known when the event is compiled."""
    return OFF
