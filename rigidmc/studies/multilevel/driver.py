"""Members are added to levels, and levels to a study, until its goal is reached.

Nearly all members make few long steps; few members make many, and tell by how much shorter steps
change the mean.
"""

import math
import time
import warnings
from collections.abc import Callable, Sequence

import xarray as xr

from rigidmc.errors import OptionError, SceneError, SceneWarning
from rigidmc.studies.multilevel.corrections import SAMPLING, Estimate, Level, estimate, members_for
from rigidmc.studies.multilevel.dataset import dataset
from rigidmc.studies.multilevel.levels import Ask, Asked, Request, key_of

LEVELS = 3  # at first: two corrections tell the order
MOST_LEVELS = 12
FLAGGED = 1e-3  # share of flagged pairs beyond which the first step is too long
Say = Callable[[str], object]


def driven(request: Request, asked: Asked, ask: Ask, progress: Say | None = None) -> xr.Dataset:
    """The study whose tasks `ask` does; it depends on request and sums alone.

    ask : the sums of tasks by their keys, see `rigidmc.studies.multilevel.levels.task`
    """
    levels: list[Level] = []
    rounds: list[tuple[float, float]] = []  # (cost, half the width) after each
    for number in range(LEVELS):
        began = time.perf_counter()
        levels = _filled(request, [*levels, _level(request, number)], ask)
    per_step = (time.perf_counter() - began) / levels[-1].cost  # the first levels compile
    while True:
        found = estimate(levels, asked.order, asked.confidence)
        spent = sum(one.cost for one in levels)
        rounds.append((spent, found.half))
        half = asked.goal.half_at(found.value)
        if found.half <= half:
            return dataset(request, asked, levels, rounds, found)
        wanted = _wanted(request, asked, levels, half)
        if all(n <= _taken(one) for n, one in zip(wanted, levels, strict=True)):
            _refuse_slow(asked, found, levels)
            wanted.append(request.batch)
        more = [*levels, _level(request, len(levels))][: len(wanted)]
        cost = sum(n * one.price for n, one in zip(wanted, more, strict=True))
        if cost > asked.most:
            _too_dear(asked, found, cost, len(rounds) == 1)
            return dataset(request, asked, levels, rounds, found)
        if progress is not None:
            progress(_plan(found, wanted, cost - spent, (cost - spent) * per_step))
        levels = _filled(request, more, ask, wanted)


def _level(request: Request, number: int) -> Level:
    return Level(number, request.steps << number)


def _taken(level: Level) -> float:
    """The members that a level has taken, also those that do not count."""
    return level.members + level.flagged


def _wanted(request: Request, asked: Asked, levels: Sequence[Level], half: float) -> list[float]:
    """Members of each level for a goal, whole batches."""
    if not half > 0.0:
        rule = "is 0 by the first members: no number of them brings it to a share of 0"
        raise OptionError("run", "until", asked.text, f"{rule}; give the width itself")
    needed = members_for(levels, asked.order, SAMPLING * half, asked.confidence)
    size = request.batch
    return [
        max(size * math.ceil(n / size), _taken(one)) for n, one in zip(needed, levels, strict=True)
    ]


def _filled(
    request: Request, levels: Sequence[Level], ask: Ask, wanted: Sequence[float] = ()
) -> list[Level]:
    """The levels with as many members as are wanted, one batch at least."""
    size, full = request.batch, []
    for one in levels:
        taken = int(_taken(one)) // size
        last = int(wanted[one.number]) // size if one.number < len(wanted) else 1
        for sums in ask([key_of(one.number, batch) for batch in range(taken, last)]):
            if sums["without"] > 0.0:
                name = request.measure.result.name
                rule = f"{int(sums['without']):,} of {size:,} members have no {name}"
                raise OptionError("run", "until", request.measure.text, rule)
            names = "members", "flagged", "mean", "squares"
            one = one.with_more(*(float(sums[name]) for name in names))
        if one.flagged > FLAGGED * _taken(one):
            rule = f"{one.flagged:,.0f} of {_taken(one):,.0f} members of level {one.number} are"
            rule += " flagged, whose steps are too long: begin with shorter ones"
            raise SceneError("run", "dt", request.scene.run.dt, rule)
        full.append(one)
    return full


def _plan(found: Estimate, wanted: Sequence[float], cost: float, seconds: float) -> str:
    """A line about what has been found and what is next."""
    members = " + ".join(f"{n:,.0f}" for n in wanted)
    ends = f"{found.value:.6g} +- {found.sampling:.2g} by sampling, {found.bias:.2g} by the step"
    return f"{ends}; next {members} members: {cost:.2g} steps more, about {seconds:.2g} s"


def _too_dear(asked: Asked, found: Estimate, cost: float, at_once: bool) -> None:
    """A goal that costs more than may be spent: OptionError at once, later a warning."""
    by = f"({found.value:.4g} +- {found.half:.2g} so far)"
    rule = f"needs about {cost:.2g} steps of members {by}, more than the limit of {asked.most:.2g}"
    if at_once:
        raise OptionError("run", "until", asked.text, rule)
    warnings.warn(f"{asked.text} is not reached: {rule}", SceneWarning, stacklevel=4)


def _refuse_slow(asked: Asked, found: Estimate, levels: Sequence[Level]) -> None:
    """OptionError for a measure whose error falls so slowly that no level will do."""
    if len(levels) > LEVELS and found.order < 0.5 * asked.order:
        rule = (
            f"its error falls with the order {found.order:.2g} in the step, in place of"
            f" {asked.order:g}: extremes and events between steps do so. Take NAME_final or"
            " NAME_mean, or a shorter first step"
        )
        raise OptionError("run", "until", asked.text, rule)
    if len(levels) == MOST_LEVELS:
        rule = f"the error of the step is {found.bias:.2g} after {MOST_LEVELS} levels"
        raise OptionError("run", "until", asked.text, rule)
