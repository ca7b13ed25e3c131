"""What a run keeps of every step: from the observables of a scene to the compiled ones, and from
rows of a block to results."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigidmc.engine.kernel import layout
from rigidmc.engine.kernel.events import record_of
from rigidmc.engine.kernel.layout import EVENT, SHADOW, STATUSES, SUMS, Places, places, watch_rows
from rigidmc.physics.dynamics.euler import MassProperties
from rigidmc.physics.dynamics.methods import OFF, Flag, depends, flag, static_count
from rigidmc.physics.effects.protocol import parameter_count
from rigidmc.physics.observables import dimensions, outputs, under
from rigidmc.physics.observables.event_times import FOLLOWED, event_times
from rigidmc.physics.observables.protocol import (
    Ensemble,
    Event,
    Neighbour,
    Running,
    armed,
    averages,
    begin,
    level,
    turning,
    update,
    value,
)
from rigidmc.planning.steps import Clock
from rigidmc.scene.quantities import is_open, rows
from rigidmc.scene.scene import Scene
from rigidmc.scene.validation import PILOT

Labelled = tuple[tuple[str, Any], ...]  # (label, observable) of each


class Watch(NamedTuple):
    """Events, running observables and neighbour as the kernel takes them, and [(label, observable)]
    of each; bins : (dimension, edges, units) of each histogram;  dims : of all that is kept."""

    events: tuple[Any, ...] = ()
    running: tuple[Any, ...] = ()
    shadow: Flag = OFF
    of_events: Labelled = ()
    of_running: Labelled = ()
    of_shadow: Labelled = ()
    bins: tuple[tuple[str, NDArray[np.float64], str], ...] = ()
    dims: tuple[str, ...] = ()

    @property
    def compiled(self) -> tuple[tuple[Any, ...], tuple[Any, ...], Flag]:
        """As arguments of `rigidmc.engine.program.Program`."""
        return self.events, self.running, self.shadow

    @property
    def each_step(self) -> list[str]:
        """Labels of what sees the end of each step only, so that long steps hide things from it."""
        return [label for label, _ in (*self.of_events, *self.of_running)]

    @property
    def rows(self) -> int:
        """How many rows of a block it takes."""
        return int(watch_rows(*self.compiled))


def watch(scene: Scene) -> Watch:
    """The Watch of a scene; SceneError for an event that it cannot have."""
    observables = [(label, one) for label, one in scene.watched() if not isinstance(one, Ensemble)]
    events = tuple((label, one) for label, one in observables if isinstance(one, Event))
    shadow = tuple((label, one) for label, one in observables if isinstance(one, Neighbour))
    running = tuple((label, one) for label, one in observables if isinstance(one, Running))
    moments, complete = _bodies(scene) if events else (np.empty((3, 0)), True)
    return Watch(
        tuple(one.compiled(moments, complete, scene.effects) for _, one in events),
        tuple((under(one, scene.effects), static_count(one.marks)) for _, one in running),
        flag(shadow),
        events,
        running,
        shadow,
        tuple(
            (f"{label}_bin", one.edges(), scene.observable(one.name).units)
            for label, one in scene.histograms()
        ),
        dimensions(scene.recorded(), scene.watched()),
    )


def _bodies(scene: Scene) -> tuple[NDArray[np.float64], bool]:
    """(moments (3, n) of the first members, or of all rows of arrays; whether these are all)."""
    complete = not is_open(scene.body.moments)
    count = (rows(*scene.body.moments) or 1) if complete else PILOT
    return scene.coarse().body.sample(scene.run.seed, 0, count)[0], complete


# arguments with which observables are tried, to see which of them they use; None if that matters
_VALUES = {
    "body": MassProperties.of((0.6, 0.8, 1.0), (0.05, -0.02, 0.3)),
    "effects": (),
    "t": 0.5,
    "l": (0.4, -0.3, 0.5),
    "q": (None,) * 4,
}
_SAVED = {**_VALUES, "start": (1.0, 1.0, 1.0, 1.0)}


def places_of(scene: Scene, watched: Watch) -> Places:
    """The rows of a block of the scene beyond those that every block has."""
    works = len(scene.effects) if "work" in scene.run.save else 0
    marks = [len(numbers) for _, numbers in watched.running]
    events, shadow = len(watched.events), bool(watched.shadow)
    return places(parameter_count(*scene.effects), works, events, marks, shadow)


def needs_attitude(scene: Scene, watched: Watch) -> bool:
    """Whether what is saved and watched needs the attitude itself, not only through the effects.

    watched : the Watch of the scene
    """
    if watched.shadow:  # the distance to the neighbour is that of attitude and momentum
        return True
    works = static_count(len(scene.effects))
    return (
        any(depends(value, o, **_SAVED, works=works) for o in scene.recorded().values())
        or any(
            depends(begin, one, **_VALUES)
            or depends(turning, one, **_VALUES)
            or depends(update, one, **_VALUES, kept=marks)
            for one, marks in watched.running
        )
        or any(
            depends(level, one, **_VALUES) or depends(armed, one, **_VALUES, level=0.5, armed=True)
            for one in watched.events
        )
    )


def results(
    scene: Scene,
    watched: Watch,
    block: NDArray[np.float64],
    clock: Clock,
    total: Any,
    nodes: int = 0,
) -> dict[str, NDArray[np.float64]]:
    """{variable: values of each member} of the Watch of a scene, nan if a member is not ok.

    A member that is flagged keeps the times of events that came while it was still ok: without
    them nobody could tell whether the event had come by then.

    block : its rows at the end of a run, or of a part of it;  clock : of the members
    total : steps that each member has made;  nodes : as of a Plan
    """
    healthy, everyone = block[layout.STATUS] == 0.0, np.ones(block.shape[1], bool)
    known_until = clock.time(np.where(healthy, total, block[layout.GOOD_STEP]))
    rows = places_of(scene, watched)
    variables: dict[str, NDArray[np.float64]] = {}
    steps, lags = total, dict[str, float]()

    def add(label: str, one: Any, values: Any) -> None:
        lags.update(times := event_times(label, one))
        for name, x in zip(outputs(label, one), values, strict=True):
            known = healthy
            if name in times:
                known = healthy | (x <= known_until - times[name])
            variables[name] = np.where(known, x, np.nan)

    for i, (label, one) in enumerate(watched.of_events):
        at = rows.events + EVENT * i
        record = record_of(block[at : at + EVENT], everyone)
        add(label, one, one.results(record).values())
        if one.stop:
            seen = np.where(healthy, record.seen, np.nan)
            steps = np.where(np.isfinite(seen), clock.steps(seen), steps)
    at, weighed = rows.running, clock.weighed(steps, total)
    for (label, one), (_, marks) in zip(watched.of_running, watched.running, strict=True):
        seen = 2.0 * nodes * weighed if nodes and averages(one) else weighed
        add(label, one, one.results(block[at : at + len(marks)], seen).values())
        at += len(marks)
    for label, one in watched.of_shadow:
        distances = block[rows.neighbour + SUMS : rows.neighbour + SHADOW]
        add(label, one, one.results(distances, clock.position(total), clock.dt).values())
    if lags:
        started = block[layout.STATUS] != float(STATUSES["invalid_input"])
        followed = np.where(healthy, clock.time(steps), known_until)
        variables[FOLLOWED] = np.where(started, followed, np.nan)
    return variables
