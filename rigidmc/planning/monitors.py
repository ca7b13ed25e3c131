"""Quantities that a run records at every step: compile the observables of a scene, and turn rows
of a block into results."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from rigidmc.engine.kernel import layout
from rigidmc.engine.kernel.layout import (
    EVENT_ROWS,
    RECORDED,
    STATUSES,
    SUMS,
    RowMap,
    monitor_rows,
    tail_of,
)
from rigidmc.engine.kernel.layout import map_rows as places_for
from rigidmc.inputs.arrays import Array, Bools
from rigidmc.physics.dynamics.dual_arrays import DualArray, plain
from rigidmc.physics.dynamics.euler import MassProperties
from rigidmc.physics.dynamics.methods import OFF, Flag, argument_names, depends, flag, static_count
from rigidmc.physics.effects.protocol import DECIDING, blank, is_random, parameter_count
from rigidmc.physics.observables import bind, dimensions, outputs
from rigidmc.physics.observables.compiled import (
    armed,
    begin,
    extrema,
    is_time_average,
    level,
    update,
    value,
)
from rigidmc.physics.observables.protocol import (
    EnsembleObservable,
    Event,
    EventRecord,
    Growth,
    NoiseSum,
    Running,
)
from rigidmc.physics.observables.saving import FOLLOWED, event_times, results_of, with_derivatives
from rigidmc.planning.initial import trailing_count
from rigidmc.planning.steps import Clock
from rigidmc.scene.model import Model
from rigidmc.scene.quantities import count_rows, is_variable
from rigidmc.scene.recording import Labelled, Recording
from rigidmc.scene.validation import PILOT

ARC = 1.6  # [rad] that a member may move between two monitored states of a step
LARGEST_TURN = 3.0  # [rad] in a monitored step: beyond it, attitudes within are off by 1e-3
# [rad] with noise, where only the ends of steps are known: for 50 heavy tops to t = 25, monitored
# after steps of 1.6 rad, nutation was up to 0.43 rad off and 43 of 801 passages were missed
RANDOM_TURN = 0.3


class Monitors(NamedTuple):
    """Events, running observables and the growth of a tangent as the kernel uses them, and
    [(label, observable)] of each, and of sums over the noise.

    bins : (dimension, edges, units) of each histogram;  dims : dimensions of all recorded variables
    has_attitude : whether an effect, or a saved or monitored observable, needs the attitude
    """

    events: tuple[Any, ...] = ()
    running: tuple[Any, ...] = ()
    growth: Flag = OFF
    of_events: Labelled = ()
    of_running: Labelled = ()
    of_growth: Labelled = ()
    of_noise: Labelled = ()
    bins: tuple[tuple[str, Array, str], ...] = ()
    dims: tuple[str, ...] = ()
    has_attitude: bool = False

    @property
    def compiled(self) -> tuple[tuple[Any, ...], tuple[Any, ...], Flag]:
        """The arguments of `rigidmc.engine.program.Program`."""
        return self.events, self.running, self.growth

    @property
    def labelled(self) -> Labelled:
        """All (label, observable)."""
        return *self.of_events, *self.of_running, *self.of_growth, *self.of_noise

    @property
    def each_step(self) -> list[str]:
        """Labels of the monitors that see only the end of each step, so that long steps hide
        motion from them."""
        return [label for label, _ in (*self.of_events, *self.of_running)]

    @property
    def rows(self) -> int:
        """Number of block rows that the monitors use."""
        return int(monitor_rows(*self.compiled))


def make_monitors(model: Model, recording: Recording, seed: int) -> Monitors:
    """Return the Monitors of a run; raise SceneError for an event that the run cannot have."""
    observables = [
        (label, kind)
        for label, kind in recording.monitored
        if not isinstance(kind, EnsembleObservable)
    ]
    events = tuple((label, kind) for label, kind in observables if isinstance(kind, Event))
    growth = tuple((label, kind) for label, kind in observables if isinstance(kind, Growth))
    running = tuple((label, kind) for label, kind in observables if isinstance(kind, Running))
    moments, complete = _bodies(model, seed) if events else (np.empty((3, 0)), True)
    monitors = Monitors(
        tuple(kind.bind(moments, complete, model.effects) for _, kind in events),
        tuple((bind(kind, model.effects), static_count(kind.state_size)) for _, kind in running),
        flag(growth),
        events,
        running,
        growth,
        tuple((label, kind) for label, kind in observables if isinstance(kind, NoiseSum)),
        tuple(
            (f"{label}_bin", kind.edges(), recording.observable(kind.name).units)
            for label, kind in recording.histograms
        ),
        dimensions(recording.recorded, recording.monitored),
    )
    return monitors._replace(has_attitude=_needs_attitude(model.effects, recording, monitors))


def _bodies(model: Model, seed: int) -> tuple[Array, bool]:
    """Return (moments (3, n), whether these are all moments of the run).

    Takes the moments of the first members, or of all rows of arrays.
    """
    complete = not is_variable(model.body.moments)
    count = (count_rows(*model.body.moments) or 1) if complete else PILOT
    return model.coarse().body.sample(seed, 0, count)[0], complete


# arguments to try observables with, to find which they use; None if use of the argument matters
_VALUES = {
    "body": MassProperties.of((0.6, 0.8, 1.0), (0.05, -0.02, 0.3)),
    "effects": (),
    "t": 0.5,
    "l": (0.4, -0.3, 0.5),
    "q": (None,) * 4,
}
_SAVED = {**_VALUES, "start": (1.0, 1.0, 1.0, 1.0)}


def places_of(effects: Sequence[Any], has_work: bool, monitors: Monitors, has_axes: bool) -> RowMap:
    """Return the rows of a block beyond the rows that every block has.

    has_axes : whether observables are of axes other than the principal axes
    """
    trailing = trailing_count(effects, has_work)
    marks = [len(numbers) for _, numbers in monitors.running]
    events, growth = len(monitors.events), bool(monitors.growth)
    tail = len(tail_of(blank(effects)))
    return places_for(parameter_count(*effects), trailing, events, marks, growth, has_axes, tail)


def _needs_attitude(effects: Sequence[Any], recording: Recording, monitors: Monitors) -> bool:
    if any("q" in argument_names(e, *DECIDING) for e in effects):
        return True
    if monitors.growth:  # the tangent is of attitude and momentum
        return True
    works = static_count(len(effects))
    return (
        any(depends(value, o, **_SAVED, works=works) for o in recording.recorded.values())
        or any(
            depends(begin, kind, **_VALUES)
            or depends(extrema, kind, **_VALUES)
            or depends(update, kind, **_VALUES, state=marks)
            for kind, marks in monitors.running
        )
        or any(
            depends(level, kind, **_VALUES)
            or depends(armed, kind, **_VALUES, level=0.5, armed=True)
            for kind in monitors.events
        )
    )


def event_record(rows: Any, healthy: Bools) -> EventRecord:
    """Return the EventRecord from rows of a block; nan for members that are not healthy."""
    count = np.where(healthy, rows[layout.COUNT], np.nan)
    never = ~(count > 0.0)
    times = rows[layout.TIMES], rows[layout.TIMES + 1], rows[layout.RECORDS]
    first, last, step_end = (np.where(never, np.nan, x) for x in times)
    linear = rows[layout.TAU], rows[layout.FIRST_TAU], rows[layout.SQUARES]
    return EventRecord(count, first, last, *linear, step_end)


def results(
    monitors: Monitors,
    places: RowMap,
    block: Array | DualArray,
    clock: Clock,
    total: Any,
    nodes: int = 0,
) -> dict[str, Any]:
    """Return {variable: values of each member} of Monitors, nan for members that are not ok.

    A flagged member keeps the times of events that happened while it was ok. Without them, nobody
    could know whether an event had happened by then.

    places : rows of the monitors
    block : its rows at the end of a run, or of part of a run; as a DualArray, the results that have
        derivatives by its parameters are DualArrays, too
    clock : when steps of the members end;  total : steps that each member has made
    nodes : as in a Plan
    """
    if not monitors.labelled:
        return {}
    rows: Any = plain(block)
    healthy, everyone = rows[layout.STATUS] == 0.0, np.ones(rows.shape[1], bool)
    known_until = clock.time(np.where(healthy, total, rows[layout.GOOD_STEP]))
    variables: dict[str, Any] = {}
    steps, lags = total, dict[str, float]()

    def add(label: str, monitor: Any, values: Any) -> None:
        lags.update(times := event_times(label, monitor))
        for name, x in zip(outputs(label, monitor), values, strict=True):
            is_known = healthy
            if name in times:
                is_known = healthy | (x <= known_until - times[name])
            variables[name] = np.where(is_known, x, np.nan)

    for i, (label, monitor) in enumerate(monitors.of_events):
        at = places.events + EVENT_ROWS * i
        record = with_derivatives(event_record(block[at : at + EVENT_ROWS], everyone))
        add(label, monitor, results_of(monitor, record).values())
        if monitor.stop:
            seen = np.where(healthy, record.seen, np.nan)
            steps = np.where(np.isfinite(seen), clock.steps(seen), steps)
    at, weighed = places.running, clock.weighed(steps, total)
    for (label, monitor), (_, marks) in zip(monitors.of_running, monitors.running, strict=True):
        seen = 2.0 * nodes * weighed if nodes and is_time_average(monitor) else weighed
        add(label, monitor, results_of(monitor, block[at : at + len(marks)], seen).values())
        at += len(marks)
    for label, monitor in monitors.of_growth:
        sums = rows[places.growth + SUMS : places.growth + RECORDED]
        add(label, monitor, monitor.results(sums, clock.time(total)).values())
    for label, monitor in monitors.of_noise:
        add(label, monitor, monitor.results(rows[layout.EXTRA : layout.START]).values())
    if lags:
        started = rows[layout.STATUS] != float(STATUSES["invalid_input"])
        followed = np.where(healthy, clock.time(steps), known_until)
        variables[FOLLOWED] = np.where(started, followed, np.nan)
    return variables


def nodes(effects: Sequence[Any], monitors: Monitors, theta: float) -> int:
    """Return how many states of a step are monitored if members move by up to `theta` [rad] in it.

    0 means the end of the step only, because noise cannot be interpolated.
    """
    if not monitors.each_step or any(map(is_random, effects)):
        return 0
    return max(1, math.ceil(min(theta, LARGEST_TURN) / ARC * (1.0 - 1e-9)))


def max_monitored_step(effects: Sequence[Any]) -> float:
    """Return how far a member may move in a monitored step [rad]."""
    return RANDOM_TURN if any(map(is_random, effects)) else LARGEST_TURN


def monitor_notes(
    effects: Sequence[Any], monitors: Monitors, theta: float, dt: float, own_steps: bool
) -> tuple[str, ...]:
    """Return a note if steps `dt` [s] of `theta` [rad] are too long for the monitors."""
    labels, most = monitors.each_step, max_monitored_step(effects)
    if not labels or theta <= most * (1.0 + 1e-9):
        return ()
    limit = f"turn <= {most:g}" if own_steps else f"dt <= {dt * most / theta:.2g} s"
    return (
        f"a member may move by {theta:.2g} rad in a step, too far for {', '.join(labels)};"
        f" use {limit}",
    )
