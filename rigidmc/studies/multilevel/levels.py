"""The levels of a multilevel study: pairs of paths with the same start and noise, and the number of
pairs at each level.

Nearly all members make few long steps. Few members make many short steps; they show how much
shorter steps change the mean. The study adds members to levels, and levels, until it reaches its
goal.

Level l makes n 2^l steps. Its members have the indices from l 2^40 on, so that no two levels share
a draw and the variances of their means add up. From level 1 on, a member also follows a coarse path
of half as many steps, each with the noise of two fine steps, see
`rigidmc.engine.kernel.noise.normal_deviates`. For a free body in a bath, the difference of the two
paths is proportional to the step, and the variance of a correction to its square. Weights that
follow the friction, exp(-gamma h) : 1 in place of 1 : 1, would remove only the part of the
difference due to friction, not that due to the torques.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigidmc.errors import OptionError, SceneError
from rigidmc.runs.prepare import PreparedRun, prepare_scene
from rigidmc.scene.scene import Scene
from rigidmc.statistics.measures import Measure
from rigidmc.studies.multilevel.corrections import (
    SAMPLING,
    Level,
    MultilevelEstimate,
    estimate_levels,
    members_of_levels,
)
from rigidmc.studies.until import Goal

APART = 2**40  # distance between the first members of successive levels
TASKS = 2**32  # distance between the first task numbers of successive levels
CHUNK = 2**17  # members at once: a call costs as much as 4000 members of few steps
Sums = Mapping[str, NDArray[Any]]


class LevelSetup(NamedTuple):
    """The setup common to all tasks of a study.

    steps : of the first level;  batch : members of a task
    """

    scene: Scene
    measure: Measure
    steps: int
    batch: int


class MultilevelGoal(NamedTuple):
    """The goal of a study.

    text, goal : the measure and its width;  order : of the integrator;  most : largest cost, in
    steps
    """

    text: str
    goal: Goal
    order: float
    confidence: float
    most: float


def task_number(level: int, batch: int) -> int:
    """Return the number of the task for a batch of a level."""
    return level * TASKS + batch


def sums(
    request: LevelSetup, numbers: Sequence[int], threads: int, device: str | None = None
) -> list[dict[str, NDArray[Any]]]:
    """Return the sums of tasks; each depends on request and number alone, to the bit.

    members : counted;  flagged : flagged paths, or pairs with a flagged path
    without : members that are ok and have no value
    mean, squares : of the corrections, and the sum of their squared deviations from it
    """
    parts = _together(numbers, max(1, CHUNK // request.batch))
    return [one for part in parts for one in _batches(request, *part, threads, device)]


def _together(numbers: Sequence[int], most: int) -> Iterator[tuple[int, int, int]]:
    """Yield (level, first batch, batches) for consecutive numbers, at most `most` each."""
    count = 0
    for i, number in enumerate(numbers):
        count += 1
        if count == most or i + 1 == len(numbers) or numbers[i + 1] != number + 1:
            level, batch = divmod(number, TASKS)
            yield level, batch + 1 - count, count
            count = 0


def _batches(
    request: LevelSetup, level: int, first: int, count: int, threads: int, device: str | None
) -> list[dict[str, NDArray[Any]]]:
    """Return the sums of `count` batches of a level from batch `first` on."""
    size = request.batch
    values, good = np.zeros(count * size), np.ones(count * size, bool)
    low = level * APART + first * size
    for sign, run in zip((1.0, -1.0), paths(request, level), strict=False):
        some = run.with_members(range(low, low + count * size))
        some = some if sign > 0.0 else some.with_paired_noise()
        result = some.run(threads=threads, device=device)
        values += sign * request.measure.numbers(result)
        good &= result.status.values == 0
    parts = zip(values.reshape(count, size), good.reshape(count, size), strict=True)
    return [_summed(*part) for part in parts]


def paths(request: LevelSetup, level: int) -> tuple[PreparedRun, ...]:
    """Return the runs of a level: its fine paths and, from level 1 on, its coarse paths."""
    each = (request.steps << level, request.steps << level >> 1)[: 1 + (level > 0)]
    scene, end = request.scene, request.scene.run.t_end
    return tuple(prepare_scene(scene.with_run(dt=end / steps, members=CHUNK)) for steps in each)


def _summed(values: NDArray[np.float64], good: NDArray[np.bool_]) -> dict[str, NDArray[Any]]:
    """Return the sums of the members of a batch."""
    there = good & np.isfinite(values)
    kept = values[there]
    mean = kept.mean() if kept.size else 0.0
    return {
        "members": np.array(float(kept.size)),
        "flagged": np.array(float((~good).sum())),
        "without": np.array(float((good & ~there).sum())),
        "mean": np.array(mean),
        "squares": np.array(((kept - mean) ** 2).sum()),
    }


LEVELS = 3  # at first: two corrections give the order
MOST_LEVELS = 12
FLAGGED = 1e-3  # fraction of flagged pairs above which the first step is too long


class MultilevelState(NamedTuple):
    """The progress of a study.

    levels : after the last complete round;  rounds : (cost, half-width) after each
    found : the estimate, None before the end of the first round
    next : numbers of the next tasks, [] at the end;  line : text about these
    short : why the study ends before its goal, or ""
    """

    levels: list[Level]
    rounds: list[tuple[float, float]]
    found: MultilevelEstimate | None
    next: list[int]
    line: str
    short: str = ""


def state_after(
    request: LevelSetup, target: MultilevelGoal, sums: Mapping[int, Sums]
) -> MultilevelState:
    """Return the progress of a study, a function of the sums of its tasks alone."""
    levels: list[Level] = []
    rounds: list[tuple[float, float]] = []
    found, line, wanted = None, "", [float(request.batch)] * LEVELS
    while True:
        more = levels + [_level(request, i) for i in range(len(levels), len(wanted))]
        tasks = [_tasks(request, *each) for each in zip(more, wanted, strict=True)]
        if left := [number for numbers in tasks for number in numbers if number not in sums]:
            return MultilevelState(levels, rounds, found, left, line)
        levels = [
            _filled(request, level, [sums[number] for number in numbers])
            for level, numbers in zip(more, tasks, strict=True)
        ]
        found = estimate_levels(levels, target.order, target.confidence, request.scene.run.dtype)
        rounds.append((_cost(levels), found.half))
        half = target.goal.half_at(found.value)
        if found.half <= half:
            return MultilevelState(levels, rounds, found, [], "")
        wanted = _wanted(request, target, levels, half)
        if all(n <= _taken(one) for n, one in zip(wanted, levels, strict=True)):
            _refuse_slow(target, found, levels)
            wanted.append(float(request.batch))
        if short := _too_dear(request, target, found, wanted):
            if len(rounds) == 1:
                raise OptionError(short, at="run.until", value=target.text)
            return MultilevelState(levels, rounds, found, [], "", short)
        line = _plan(found, wanted)


def _cost(levels: Sequence[Level]) -> float:
    """Return the cost of levels, in steps."""
    return sum(one.cost for one in levels)


def _level(request: LevelSetup, number: int) -> Level:
    return Level(number, request.steps << number)


def _taken(level: Level) -> float:
    """Return the number of members of a level, including flagged ones."""
    return level.members + level.flagged


def _wanted(
    request: LevelSetup, target: MultilevelGoal, levels: Sequence[Level], half: float
) -> list[float]:
    """Return the members that each level needs for a goal, in whole batches."""
    if not half > 0.0:
        rule = "is 0 for the first members, so a relative width is 0; give an absolute width"
        raise OptionError(rule, at="run.until", value=target.text)
    needed = members_of_levels(levels, target.order, SAMPLING * half, target.confidence)
    size = request.batch
    return [
        max(size * math.ceil(n / size), _taken(one)) for n, one in zip(needed, levels, strict=True)
    ]


def _tasks(request: LevelSetup, level: Level, wanted: float) -> list[int]:
    """Return the numbers of the tasks that a level lacks for the wanted members."""
    batches = range(int(_taken(level)) // request.batch, int(wanted) // request.batch)
    return [task_number(level.number, batch) for batch in batches]


def _filled(request: LevelSetup, level: Level, more: Sequence[Sums]) -> Level:
    """Return the level with the members of more tasks added."""
    for one in more:
        if one["without"] > 0.0:
            name = request.measure.result.name
            rule = f"{int(one['without']):,} of {request.batch:,} members have no {name}"
            raise OptionError(rule, at="run.until", value=request.measure.text)
        names = "members", "flagged", "mean", "squares"
        level = level.with_more(*(float(one[name]) for name in names))
    if level.flagged > FLAGGED * _taken(level):
        rule = f"{level.flagged:,.0f} of {_taken(level):,.0f} members of level {level.number} are"
        rule += " flagged because their steps are too long: use a shorter dt"
        raise SceneError(rule, at="run.dt", value=request.scene.run.dt)
    return level


def _plan(found: MultilevelEstimate, wanted: Sequence[float]) -> str:
    """Return a line about the estimate so far and the next members."""
    members = " + ".join(f"{n:,.0f}" for n in wanted)
    ends = f"{found.value:.6g} +- {found.sampling:.2g} by sampling, {found.bias:.2g} by the step"
    return f"{ends}; next: {members} members by level"


def _too_dear(
    request: LevelSetup, target: MultilevelGoal, found: MultilevelEstimate, wanted: Sequence[float]
) -> str:
    """Return why a goal exceeds the cost limit, or ""."""
    cost = sum(n * _level(request, i).price for i, n in enumerate(wanted))
    if cost <= target.most:
        return ""
    by = f"({found.value:.4g} +- {found.half:.2g} so far)"
    return f"needs about {cost:.2g} member-steps {by}, more than the limit of {target.most:.2g}"


def _refuse_slow(
    target: MultilevelGoal, found: MultilevelEstimate, levels: Sequence[Level]
) -> None:
    """Raise OptionError for a measure whose error falls too slowly with the level."""
    if len(levels) > LEVELS and found.order < 0.5 * target.order:
        rule = (
            f"its error falls with order {found.order:.2g} in the step instead of"
            f" {target.order:g}, as for extremes and events between steps. Use NAME_final or"
            " NAME_mean, or a shorter first step"
        )
        raise OptionError(rule, at="run.until", value=target.text)
    if len(levels) == MOST_LEVELS:
        rule = f"the error of the step is {found.bias:.2g} after {MOST_LEVELS} levels"
        raise OptionError(rule, at="run.until", value=target.text)
