"""What of a scene is kept of every step: from its observables to what the kernel compiles, and from rows of a block to results."""

from typing import Any, NamedTuple

import numpy as np

from rigidmc.dynamics.euler import MassProperties
from rigidmc.dynamics.methods import depends
from rigidmc.effects.parameters import parameter_count
from rigidmc.engine import layout
from rigidmc.engine.events import record_of
from rigidmc.engine.layout import EVENT, SHADOW, SUMS, watch_rows
from rigidmc.observables import OBSERVABLES, outputs
from rigidmc.observables.chaos import OFTEN
from rigidmc.observables.protocol import (
    Ensemble,
    Event,
    Neighbour,
    Running,
    armed,
    begin,
    level,
    update,
    value,
)
from rigidmc.scene.checks import PILOT
from rigidmc.scene.quantities import is_open, rows


class Watch(NamedTuple):
    """Events, running observables and neighbour as the kernel takes them, and [(label, observable)] of each; (dimension, edges, units) of histograms."""

    events: tuple = ()
    running: tuple = ()
    shadow: tuple = ()
    of_events: tuple = ()
    of_running: tuple = ()
    of_shadow: tuple = ()
    bins: tuple = ()

    @property
    def compiled(self):
        """As arguments of `rigidmc.engine.program.Program`."""
        return self.events, self.running, self.shadow

    @property
    def each_step(self):
        """Labels of what sees the state at the end of each step: how far a step goes decides what it can see."""
        return [label for label, _ in (*self.of_events, *self.of_running)]

    @property
    def rows(self):
        """How many rows of a block it takes."""
        return watch_rows(*self.compiled)


def watch(scene):
    """The Watch of a scene; SceneError for an event that it cannot have."""
    found = scene.watched()
    found = [(label, one) for label, one in found if not isinstance(one, Ensemble)]
    events = tuple((label, one) for label, one in found if isinstance(one, Event))
    running = tuple((label, one) for label, one in found if isinstance(one, Running))
    shadow = tuple((label, one) for label, one in found if isinstance(one, Neighbour))
    bodies = _bodies(scene) if events else ()
    return Watch(
        tuple(one.compiled(*bodies) for _, one in events),
        tuple((one, (0.0,) * one.marks) for label, one in running),
        (0.0,) * len(shadow[:1]),
        events,
        running,
        shadow,
        tuple(
            (f"{label}_bin", one.edges(), OBSERVABLES[one.name].units)
            for label, one in scene.histograms()
        ),
    )


def _bodies(scene):
    """(moments (3, n) of the first members, or of all that arrays have; whether they are all that there are)."""
    sure = not is_open(scene.body.moments)
    count = (rows(*scene.body.moments) or 1) if sure else PILOT
    return scene.coarse().body.sample(scene.run.seed, 0, count)[0], sure


_VALUES = {
    "body": MassProperties.of((0.6, 0.8, 1.0), (0.05, -0.02, 0.3)),
    "effects": (),
    "t": 0.5,
    "l": (0.4, -0.3, 0.5),
    "q": (None,) * 4,
}
_SAVED = {**_VALUES, "start": (1.0, 1.0, 1.0, 1.0)}


def needs_attitude(scene, found):
    """Whether the attitude itself, not only by the effects, goes into what is saved and watched; found : the Watch of the scene."""
    works = (0.0,) * len(scene.effects)
    return (
        bool(
            found.shadow
        )  # the distance to the neighbour is that of attitude and momentum, whatever is saved
        or any(
            depends(value, OBSERVABLES[name](), **_SAVED, works=works) for name in scene.recorded()
        )
        or any(
            depends(begin, one, **_VALUES) or depends(update, one, **_VALUES, kept=marks)
            for one, marks in found.running
        )
        or any(
            depends(level, one, **_VALUES) or depends(armed, one, **_VALUES, level=0.5, armed=True)
            for one in found.events
        )
    )


def results(scene, found, block, h, total):
    """{variable: values of each member} of the Watch of a scene, nan where a member is not ok.

    block : its rows at the end of a run;  h : step of each member [s];  total : steps of each member
    """
    healthy = block[layout.STATUS] == 0.0
    at = (
        layout.EFFECTS
        + parameter_count(*scene.effects)
        + 2 * ("work" in scene.run.save) * len(scene.effects)
    )
    each: dict[str, Any] = {}
    steps = total

    def add(label, one, values):
        for name, x in zip(outputs(label, one), values, strict=True):
            each[name] = np.where(healthy, x, np.nan)

    for label, one in found.of_events:
        record = record_of(block[at : at + EVENT], healthy)
        add(label, one, one.results(record).values())
        if one.stop:
            steps = np.where(np.isfinite(record.seen), np.rint(record.seen / h), steps)
        at += EVENT
    for (label, one), (_, marks) in zip(found.of_running, found.running, strict=True):
        add(label, one, one.results(block[at : at + len(marks)], steps).values())
        at += len(marks)
    for label, one in found.of_shadow:
        add(label, one, one.results(block[at + SUMS : at + SHADOW], total // OFTEN, h).values())
    return each
