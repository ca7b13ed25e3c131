"""The score: how near a member has come to the event, as a number that never decreases."""

import math
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np

from rigidmc.engine.kernel import layout
from rigidmc.errors import OptionError
from rigidmc.inputs.arrays import Array, Bools
from rigidmc.physics.effects.protocol import is_random
from rigidmc.physics.observables import outputs
from rigidmc.physics.observables.protocol import Event
from rigidmc.physics.observables.saving import roles_of
from rigidmc.results.variables import variables_of
from rigidmc.runs.segments import SegmentedRun
from rigidmc.scene.scene import Scene
from rigidmc.statistics.measures import Result, measure, save_for_measures

RULE = (
    "a noisy scene requires a quantity that only grows: p(NAME_max >= NUMBER),"
    " p(NAME_min <= NUMBER), or the count or first time of an event,"
    ' as in "p(passages >= 1)" and "p(passage_first < 60)"'
)
WHOLE = "as p(NAME >= NUMBER) or p(NAME <= NUMBER), without a condition"


class Score(NamedTuple):
    """The score of members, and its value at which the event begins.

    An event of the scene, such as a passage, scores its count so far, plus how near its level is
    to 0::

        score = count + 1/(1 + |level|/scale)

    Any other quantity scores its value, with the sign that makes the score rise towards the event.
    Levels have different units, so `scale` is a level that occurs among the members. It does not
    change the order of the members, and makes their scores the same numbers in all units.

    result : the quantity of the event;  sign : 1 or -1
    goal, strict : the event is score >= goal, or > goal if `strict`
    event : index of the event in the scene, None for any other quantity
    scale : in the unit of the level; 0 until `sized` finds a level
    """

    text: str
    result: Result
    sign: float
    goal: float
    strict: bool
    event: int | None = None
    scale: float = 0.0

    def reached(self, score: Array) -> Bools:
        """Return whether members with these scores have the event."""
        return score > self.goal if self.strict else score >= self.goal

    def of(self, moving: SegmentedRun, block: Array, part: int) -> Array:
        """Return the scores of the members of a block after a part of the run; -inf if flagged."""
        if self.event is None:
            values = moving.results(block, part)[self.result.name]
            if self.result.axis is not None:
                values = values[self.result.axis - 1]
            # nan of a time: the event comes after the end; nan of any other value: far from it
            none = self.sign * np.inf if self.result.timed else -np.inf
            values = np.where(np.isnan(values), none, self.sign * values)
            return np.where(block[layout.STATUS] == 0.0, values, -np.inf)
        return self.graded(*self.progress(moving, block))

    def progress(self, moving: SegmentedRun, block: Array) -> tuple[Array, Array]:
        """Return (count, distance) of the event for each member: the distance is |level|, inf while
        the event cannot happen next; the count of a flagged member is -inf."""
        assert self.event is not None
        count, level = moving.event(self.event, block)
        healthy = block[layout.STATUS] == 0.0
        return np.where(healthy, count, -np.inf), np.where(level == 0.0, np.inf, np.abs(level))

    def sized(self, off: Array) -> "Score":
        """Return the Score with a scale; if it has none yet, this is the largest finite level in
        `off`."""
        # only the first population decides: levels of later ones must be comparable with its levels
        largest = float(off[np.isfinite(off)].max(initial=0.0))
        return self if self.event is None or self.scale else self._replace(scale=largest)

    def graded(self, count: Array, off: Array) -> Array:
        """Return the scores of members from their `progress`."""
        # without a finite level, no member is nearer than another
        nearness = 1.0 / (1.0 + off / self.scale) if self.scale else np.zeros(off.shape)
        # do not round up to the next count: that event has not happened
        return np.minimum(count + nearness, np.nextafter(count + 1.0, -np.inf))


def make_score(scene: Scene, of: str) -> tuple[Scene, Score]:
    """Return (the scene whose members the study computes, the Score of its event).

    Raises OptionError for a text that is not an event, or for an event without a score.
    """
    scene = save_for_measures(scene.with_run(points="independent"), (of,))
    asked = measure(of, variables_of(scene))
    if asked.kind != "p" or asked.given is not None or asked.relation == "==":
        raise OptionError(f"is not an event: give it {WHOLE}", at="of", value=of)
    recorded = scene.recording
    events = [(label, event) for label, event in recorded.monitored if isinstance(event, Event)]
    keeps = tuple(name for name in scene.run.save if name not in recorded.names)
    scene = scene.with_run(save=keeps, first=0, every=None)
    more, strict = asked.relation[0] == ">", len(asked.relation) == 1
    for i, (label, event) in enumerate(events):
        for name, kind in zip(outputs(label, event), roles_of(event), strict=True):
            if name == asked.result.name and kind == "count" and more:
                # a score between n and n + 1 has n of them
                goal = math.floor(asked.number) + 1.0 if strict else math.ceil(asked.number) + 0.0
                return scene, Score(of, asked.result, 1.0, goal, False, i)
            if name == asked.result.name and kind == "first" and not more:
                if getattr(event, "hold", 0.0):
                    rule = f"a stay that begins by then may end later; use p({label}s >= 1)"
                    raise OptionError(rule, at="of", value=of)
                return _until(scene, of, asked.number), Score(of, asked.result, 1.0, 1.0, False, i)
    grows = asked.result.name.endswith("_max" if more else "_min")
    if is_noisy(scene.effects) and not grows:
        raise OptionError(RULE, at="of", value=of)
    sign = 1.0 if more else -1.0
    if asked.result.timed:
        _until(scene, of, asked.number)
    pairs = scene.recording.monitored
    monitored = [word for label, observable in pairs for word in outputs(label, observable)]
    if asked.result.name not in monitored:
        words = ", ".join(monitored) or "nothing"
        rule = f"is not monitored at every step; monitored: {words}"
        raise OptionError(rule, at="of", value=of)
    return scene, Score(of, asked.result, sign, sign * asked.number, strict)


def is_noisy(effects: Iterable[Any]) -> bool:
    """Return whether one of some effects is random."""
    return any(map(is_random, effects))


def _until(scene: Scene, of: str, end: float) -> Scene:
    """Return the scene with the time of the event as its end; OptionError if it is out of range."""
    if not 0.0 < end <= scene.run.t_end * (1.0 + 1e-9):
        rule = f"the run ends at t_end = {scene.run.t_end:g} s: give a later t_end"
        raise OptionError(rule, at="of", value=of)
    return scene.with_run(t_end=end)
