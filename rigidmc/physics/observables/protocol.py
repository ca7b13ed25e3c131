"""The protocol of observables: facts and methods that a class must have, and their defaults.

A class is a NamedTuple with one of the decorators below. The decorator states the facts of the
class, adds defaults and rejects a class that lacks a required member. The fields of the class are
the parameters of a table [observables.NAME] in a scene. `parameter_units={"hold": "s"}` states the
SI units of those that have one: by it they accept other units, and enter the units of integration.

Compiled code calls the methods that `rigidmc.physics.observables.compiled` lists, with their
defaults. All other methods are Python and take arrays, members last.

States and effects are in the principal axes of the member. `described(body, v)` turns a vector into
the axes in which the body is described, `described_attitude(body, q)` an attitude. Values with dims
("axis",) are taken as a vector of the body, those with ("quat",) as its attitude, and are turned;
in_body=() declares that nothing of a class is along the axes of the body, and turns no value.
"""

import inspect
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, Protocol, TypeVar, cast, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from rigidmc.errors import SceneError
from rigidmc.physics.dynamics.methods import ON

Array = NDArray[np.float64]
Dims = tuple[str, ...]
Outputs = Mapping[str, tuple[str, str, Dims]]  # {variable: (units, long_name, dims)}


class Dimension(NamedTuple):
    """A dimension of values: the label of each component, and a description."""

    labels: tuple[Any, ...]
    long_name: str


DIMENSIONS = {
    "axis": Dimension((1, 2, 3), "axis of the body"),
    "principal_axis": Dimension(
        (1, 2, 3), "principal axis, numbered as the nearest axis of the body"
    ),
    "quat": Dimension(("w", "x", "y", "z"), "component of the quaternion, scalar first"),
    "angle": Dimension(("roll", "pitch", "yaw"), "angle of the body in the frame of its orbit"),
}  # the dimension "effect" has as many components as the scene has effects


def size(dims: Dims, effects: int = 0) -> int:
    """Return the number of values with these dimensions. effects : length of "effect"."""
    return math.prod(effects if d == "effect" else len(DIMENSIONS[d].labels) for d in dims)


def require(is_right: bool, rule: str, at: str, value: Any) -> None:
    """Raise SceneError with a rule for the value of a parameter that is not right."""
    if not is_right:
        raise SceneError(rule, at=at, value=value)


def is_finite(value: Any) -> bool:
    """Return whether a value is a finite number."""
    is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
    return is_number and math.isfinite(value)


@runtime_checkable
class Observable(Protocol):
    """Recorded at save times, by `value`.

    units, long_name, dims : of the variable; dims is () for a scalar, else names of DIMENSIONS, or
        ("effect",) for one number per effect
    conserved : "energy", "energy_drift", "l2" or "lz", if that conservation law of
        `rigidmc.scene.recording` keeps the observable constant; "" for none
    """

    units: str
    long_name: str
    dims: Dims
    conserved: str
    value: Callable[..., tuple[Any, ...]]


class Monitored(Protocol):
    """Observed over all steps, with one result per member and no trajectory kept.

    outputs : the variables of the result; {name} in a long_name stands for a value of
        `label_fields`
    stop : whether the member stops after the event
    event_times : names of the outputs that are event times. Such an output is nan until its event
        occurs; estimates then place the event later than the end of the member. None means the
        first time of an event, and the outputs in seconds of a running observable; () means none
    """

    outputs: Outputs
    stop: bool
    event_times: tuple[str, ...] | None

    def check(self) -> None:
        """Raise SceneError for an invalid parameter."""

    def label_fields(self) -> dict[str, Any]:
        """Return the parameters as the long_names of `outputs` show them."""


class EventRecord(NamedTuple):
    """The record of an event at the end of a run, one number per member.

    count : number of events, nan if the member is not healthy
    first, last : times of both events, to the order of the integrator [s]; nan if never
    tau, first_tau : times of last and first, interpolated linearly within the step [s]
    squares : sum of the squared times between events, each interpolated linearly [s2]
    seen : end of the step with the first event [s]; nan if never
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

    `bind` returns the NamedTuple with `level` and, optionally, `armed`, `counts_at_start` and
    `is_terminal`.
    """

    def bind(self, moments: Array, complete: bool, effects: Sequence[Any]) -> Any:
        """Return the event for bodies of these moments (3, n) under these effects.

        complete : whether these are all the bodies
        """

    def results(self, record: EventRecord) -> dict[str, Array]:
        """Return the outputs."""


@runtime_checkable
class Running(Monitored, Protocol):
    """A few running numbers per member; `begin` sets and `update` changes them after each step.

    state_size : how many numbers

    A class whose results have derivatives by the end of the run has a method
    `lengthened(state, now, rates, time, steps)`, which returns the running state's.

    state : at the end (state_size, n);  now, rates : `begin` there, and its rates (state_size, n)
    time : from the start to the end [s];  steps : as in `results`; it counts as fixed
    """

    state_size: int
    begin: Callable[..., tuple[Any, ...]]
    update: Callable[..., tuple[Any, ...]]

    def results(self, state: Array, steps: Array) -> dict[str, Array]:
        """Return the outputs from the running state (state_size, n).

        steps : number of steps of each member

        If the last steps are shorter, the earlier steps have more weight, see `reweighed`.
        """


@runtime_checkable
class Growth(Monitored, Protocol):
    """Results of the growth of a tangent, see `rigidmc.engine.kernel.growth`.

    growth_method : how the growth is found; the attribute `method` of the results
    """

    growth_method: str

    def results(self, state: Array, time: Array) -> dict[str, Array]:
        """Return the outputs from the sums (3, n) over this time [s]."""


@runtime_checkable
class NoiseSum(Monitored, Protocol):
    """Sums over the steps of what their noise contributes, see `noise_score` in
    `rigidmc.physics.effects.protocol`."""

    of_noise: bool

    def results(self, sums: Array) -> dict[str, Array]:
        """Return the outputs from the sums (7, n)."""


@runtime_checkable
class EnsembleObservable(Monitored, Protocol):
    """Counts over all members at save times. The observable itself is not stored.

    name, component : of the observable
    """

    @property
    def name(self) -> str: ...

    @property
    def component(self) -> int: ...

    def edges(self) -> Array:
        """Return the edges of the bins (bins + 1)."""

    def counts(self, values: Array) -> NDArray[np.intp]:
        """Count values (times, members) into (times, bins + 2): below, in each bin, above."""


def _is_on(self):
    """Return the flag of a conserved observable, of a vector of the body, or of its attitude."""
    return ON


def _no_check(self: Any) -> None:
    """Accept all numbers."""


def _no_fields(self: Any) -> dict[str, Any]:
    """Return no words to fill in."""
    return {}


def _as_it_stands(self: Any, moments: Array, complete: bool, effects: Sequence[Any]) -> Any:
    """Return the observable itself, whose class has `level`."""
    return self


# values that `observed` turns into the described axes
_OF_AXES = {("axis",): "is_body_vector", ("quat",): "is_attitude"}
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
    Growth: _OVER_STEPS,
    NoiseSum: _OVER_STEPS,
    EnsembleObservable: _OVER_STEPS,
}
# Former names of methods and facts, and their present names; until 1.0.
OLD_WORDS = {
    "turning": "extrema", "sought": "extremum_limits", "holds": "dwell", "stops": "is_terminal",
    "past": "counts_at_start", "averages": "is_time_average", "steady": "is_conserved",
    "compiled": "bind", "under": "bind", "marks": "state_size", "words": "label_fields",
}  # fmt: skip
# word and squares are of statistics, see `rigidmc.physics.observables.statistics`
_STATED = ("word", "squares", "in_body", "parameter_units")
Kind = TypeVar("Kind", bound=type)


def _decorator(protocol: type) -> Callable[..., Callable[[Kind], Kind]]:
    """Return the decorator of classes for a protocol.

    The decorator states facts, `@observable(units="1", long_name="...", dims=())`, which become
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
                cast(Any, cls).is_conserved = _is_on
            _state_axes(cls)
            if missing := [name for name in _members(protocol) if not hasattr(cls, name)]:
                words = ", ".join(missing)
                raise TypeError(f"{cls.__name__} has no {words}: see {protocol.__name__}")
            return cls

        return complete

    return decorator


def _state_axes(cls: Any) -> None:
    """Let the values be turned into the described axes if they are along the axes of the body."""
    turns = getattr(cls, "dims", ()) in _OF_AXES
    stated = getattr(cls, "in_body", ("value",) if turns else ())
    if stated not in ((), ("value",)):
        cure = "its methods turn a field by `described`; () or ('value',) are allowed"
        raise TypeError(f"{cls.__name__}: in_body = {stated!r}: {cure}")
    if stated and not turns:
        raise TypeError(f"{cls.__name__}: in_body: values with dims {cls.dims} have no axes")
    if stated:
        setattr(cls, _OF_AXES[cls.dims], _is_on)


def _members(protocol: type) -> Sequence[str]:
    """Return the names of the facts and methods that a protocol requires."""
    # The base class Protocol has members that no class needs.
    bases = [base for base in protocol.__mro__ if base.__module__ == __name__]
    names = [name for base in bases for name in (*inspect.get_annotations(base), *vars(base))]
    return [name for name in names if not name.startswith("_")]


observable = _decorator(Observable)
event = _decorator(Event)
running = _decorator(Running)
growth = _decorator(Growth)
noise_sum = _decorator(NoiseSum)
ensemble = _decorator(EnsembleObservable)
