"""Members are added to levels, and levels to a study, until its goal is reached.

Nearly all members make few long steps; few members make many, and tell by how much shorter steps
change the mean.
"""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from rigidmc.errors import OptionError, SceneError
from rigidmc.studies.multilevel.corrections import SAMPLING, Estimate, Level, estimate, members_for
from rigidmc.studies.multilevel.levels import Asked, Request, Sums, number_of

LEVELS = 3  # at first: two corrections tell the order
MOST_LEVELS = 12
FLAGGED = 1e-3  # share of flagged pairs beyond which the first step is too long


class Stand(NamedTuple):
    """How far a study is.

    levels : as of the last whole round;  rounds : (cost, half the width) after each
    found : the estimate, None before the first round has ended
    next : the numbers of the tasks that are next, [] at the end;  line : about these
    short : why the study ends before its goal, or ""
    """

    levels: list[Level]
    rounds: list[tuple[float, float]]
    found: Estimate | None
    next: list[int]
    line: str
    short: str = ""


def stand(request: Request, asked: Asked, sums: Mapping[int, Sums]) -> Stand:
    """How far a study is by the sums of its tasks, on which it depends alone."""
    levels: list[Level] = []
    rounds: list[tuple[float, float]] = []
    found, line, wanted = None, "", [float(request.batch)] * LEVELS
    while True:
        more = levels + [_level(request, i) for i in range(len(levels), len(wanted))]
        tasks = [_tasks(request, *each) for each in zip(more, wanted, strict=True)]
        if left := [number for numbers in tasks for number in numbers if number not in sums]:
            return Stand(levels, rounds, found, left, line)
        levels = [
            _filled(request, level, [sums[number] for number in numbers])
            for level, numbers in zip(more, tasks, strict=True)
        ]
        found = estimate(levels, asked.order, asked.confidence, request.scene.run.dtype)
        rounds.append((_cost(levels), found.half))
        half = asked.goal.half_at(found.value)
        if found.half <= half:
            return Stand(levels, rounds, found, [], "")
        wanted = _wanted(request, asked, levels, half)
        if all(n <= _taken(one) for n, one in zip(wanted, levels, strict=True)):
            _refuse_slow(asked, found, levels)
            wanted.append(float(request.batch))
        if short := _too_dear(request, asked, found, wanted):
            if len(rounds) == 1:
                raise OptionError("run", "until", asked.text, short)
            return Stand(levels, rounds, found, [], "", short)
        line = _plan(found, wanted)


def _cost(levels: Sequence[Level]) -> float:
    """In steps."""
    return sum(one.cost for one in levels)


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


def _tasks(request: Request, level: Level, wanted: float) -> list[int]:
    """The numbers of the tasks that a level lacks of as many members as are wanted."""
    batches = range(int(_taken(level)) // request.batch, int(wanted) // request.batch)
    return [number_of(level.number, batch) for batch in batches]


def _filled(request: Request, level: Level, more: Sequence[Sums]) -> Level:
    """The level with the members of more tasks."""
    for one in more:
        if one["without"] > 0.0:
            name = request.measure.result.name
            rule = f"{int(one['without']):,} of {request.batch:,} members have no {name}"
            raise OptionError("run", "until", request.measure.text, rule)
        names = "members", "flagged", "mean", "squares"
        level = level.with_more(*(float(one[name]) for name in names))
    if level.flagged > FLAGGED * _taken(level):
        rule = f"{level.flagged:,.0f} of {_taken(level):,.0f} members of level {level.number} are"
        rule += " flagged, whose steps are too long: begin with shorter ones"
        raise SceneError("run", "dt", request.scene.run.dt, rule)
    return level


def _plan(found: Estimate, wanted: Sequence[float]) -> str:
    """A line about what has been found and what is next."""
    members = " + ".join(f"{n:,.0f}" for n in wanted)
    ends = f"{found.value:.6g} +- {found.sampling:.2g} by sampling, {found.bias:.2g} by the step"
    return f"{ends}; the levels get {members} members"


def _too_dear(request: Request, asked: Asked, found: Estimate, wanted: Sequence[float]) -> str:
    """Why a goal costs more than may be spent, or ""."""
    cost = sum(n * _level(request, i).price for i, n in enumerate(wanted))
    if cost <= asked.most:
        return ""
    by = f"({found.value:.4g} +- {found.half:.2g} so far)"
    return f"needs about {cost:.2g} steps of members {by}, more than the limit of {asked.most:.2g}"


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
