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
from rigidmc.inputs.arrays import Array, Bools
from rigidmc.runs.prepare import PreparedRun, prepare_scene
from rigidmc.scene.scene import Scene
from rigidmc.studies.multilevel.corrections import (
    Level,
    MultilevelEstimate,
    estimate_levels,
    members_for_goal,
)
from rigidmc.studies.until import Goal

APART = 2**40  # distance between the first members of successive levels
TASKS = 2**32  # distance between the first task numbers of successive levels
CHUNK = 2**17  # members at once: a call costs as much as 4000 members of few steps
LEVELS = 3  # at first: two corrections give the order
MOST_LEVELS = 12
FLAGGED = 1e-3  # fraction of flagged pairs above which the first step is too long
Sums = Mapping[str, NDArray[Any]]


class MultilevelSetup(NamedTuple):
    """The setup common to all tasks of a study, and its goal.

    text, goal : the measure and its width;  order : of the integrator
    steps : of the first level;  batch : members of a task;  most : largest cost, in steps
    """

    scene: Scene
    text: str
    goal: Goal
    order: float
    confidence: float
    steps: int
    batch: int
    most: float

    def empty_level(self, number: int) -> Level:
        """Return a level without members."""
        return Level(number, self.steps << number)

    def refusal(self, rule: str) -> OptionError:
        """Return the error for a goal that cannot be reached."""
        return OptionError(rule, at="run.until", value=self.text)


def task_number(level: int, batch: int) -> int:
    """Return the number of the task for a batch of a level."""
    return level * TASKS + batch


def sums(
    setup: MultilevelSetup, numbers: Sequence[int], threads: int, device: str | None = None
) -> list[dict[str, NDArray[Any]]]:
    """Return the sums of tasks; each depends on setup and number alone, to the bit.

    members : counted;  flagged : flagged paths, or pairs with a flagged path
    without : members that are ok and have no value
    mean, squares : of the corrections, and the sum of their squared deviations from it
    """
    size, batches = setup.batch, list[dict[str, NDArray[Any]]]()
    for level, first, count in _together(numbers, max(1, CHUNK // size)):
        values, good = np.zeros(count * size), np.ones(count * size, bool)
        low = level * APART + first * size
        for sign, run in zip((1.0, -1.0), paths(setup, level), strict=False):
            result = run.run(members=range(low, low + count * size), threads=threads, device=device)
            values += sign * setup.goal.measure.numbers(result)
            good &= result.status.values == 0
        parts = zip(values.reshape(count, size), good.reshape(count, size), strict=True)
        batches += [_summed(*part) for part in parts]
    return batches


def _together(numbers: Sequence[int], most: int) -> Iterator[tuple[int, int, int]]:
    """Yield (level, first batch, batches) for consecutive numbers, at most `most` each."""
    count = 0
    for i, number in enumerate(numbers):
        count += 1
        if count == most or i + 1 == len(numbers) or numbers[i + 1] != number + 1:
            level, batch = divmod(number, TASKS)
            yield level, batch + 1 - count, count
            count = 0


def paths(setup: MultilevelSetup, level: int) -> Iterator[PreparedRun]:
    """Yield the runs of a level: its fine paths and, from level 1 on, its coarse paths."""
    end, steps = setup.scene.run.t_end, setup.steps << level
    # other scenes: each level has a step of its own, and more members than the scene
    yield prepare_scene(setup.scene.with_run(dt=end / steps, members=CHUNK))
    if level:
        coarse = setup.scene.with_run(dt=end / (steps >> 1), members=CHUNK)
        yield prepare_scene(coarse).with_paired_noise()


def _summed(values: Array, good: Bools) -> dict[str, NDArray[Any]]:
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


class MultilevelState(NamedTuple):
    """The progress of a study.

    levels : after the last complete round;  rounds : (cost, half-width) after each
    estimate : None before the end of the first round
    next : numbers of the next tasks, [] at the end;  line : text about these
    short : why the study ends before its goal, or ""
    """

    levels: list[Level]
    rounds: list[tuple[float, float]]
    estimate: MultilevelEstimate | None
    next: list[int]
    line: str = ""
    short: str = ""


def state_after(setup: MultilevelSetup, sums: Mapping[int, Sums]) -> MultilevelState:
    """Return the progress of a study, a function of the sums of its tasks alone."""
    # Replayed from the first round: a study that was killed takes the same decisions again.
    levels: list[Level] = []
    rounds: list[tuple[float, float]] = []
    estimate, line, wanted = None, "", [float(setup.batch)] * LEVELS
    while True:
        more = levels + [setup.empty_level(i) for i in range(len(levels), len(wanted))]
        tasks = [_tasks(setup, *pair) for pair in zip(more, wanted, strict=True)]
        if left := [number for numbers in tasks for number in numbers if number not in sums]:
            return MultilevelState(levels, rounds, estimate, left, line)
        levels = [
            _filled(setup, level, [sums[number] for number in numbers])
            for level, numbers in zip(more, tasks, strict=True)
        ]
        estimate = estimate_levels(levels, setup.order, setup.confidence, setup.scene.run.dtype)
        rounds.append((sum(level.cost for level in levels), estimate.half))
        half = setup.goal.half_at(estimate.value)
        if estimate.half <= half:
            return MultilevelState(levels, rounds, estimate, [])
        wanted = _wanted(setup, levels, half)
        if all(n <= level.taken for n, level in zip(wanted, levels, strict=True)):
            # sampling is good enough on every level, and only shorter steps narrow the interval
            _refuse_slow(setup, estimate, levels)
            wanted.append(float(setup.batch))
        cost = sum(n * setup.empty_level(i).price for i, n in enumerate(wanted))
        if cost > setup.most:
            by = f"({estimate.value:.4g} +- {estimate.half:.2g} so far)"
            limit = f"more than the limit of {setup.most:.2g}"
            short = f"needs about {cost:.2g} member-steps {by}, {limit}"
            if len(rounds) == 1:
                raise setup.refusal(short)
            return MultilevelState(levels, rounds, estimate, [], "", short)
        members = " + ".join(f"{n:,.0f}" for n in wanted)
        line = f"{estimate.words()}; next: {members} members by level"


def _wanted(setup: MultilevelSetup, levels: Sequence[Level], half: float) -> list[float]:
    """Return the members that each level needs for a goal, in whole batches."""
    if not half > 0.0:
        rule = "is 0 for the first members, so a relative width is 0; give an absolute width"
        raise setup.refusal(rule)
    needed, size = members_for_goal(levels, setup.order, half, setup.confidence), setup.batch
    pairs = zip(needed, levels, strict=True)
    return [max(size * math.ceil(n / size), level.taken) for n, level in pairs]


def _tasks(setup: MultilevelSetup, level: Level, wanted: float) -> list[int]:
    """Return the numbers of the tasks that a level lacks for the wanted members."""
    batches = range(int(level.taken) // setup.batch, int(wanted) // setup.batch)
    return [task_number(level.number, batch) for batch in batches]


def _filled(setup: MultilevelSetup, level: Level, more: Sequence[Sums]) -> Level:
    """Return the level with the members of more tasks added."""
    for task in more:
        if (without := float(task["without"])) > 0.0:
            measure = setup.goal.measure
            rule = f"{without:,.0f} of {setup.batch:,} members have no {measure.result.name}"
            raise OptionError(rule, at="run.until", value=measure.text)
        names = "members", "flagged", "mean", "squares"
        level = level.with_more(*(float(task[name]) for name in names))
    if level.flagged > FLAGGED * level.taken:
        rule = f"{level.flagged:,.0f} of {level.taken:,.0f} members of level {level.number} are"
        rule += " flagged because their steps are too long: use a shorter dt"
        raise SceneError(rule, at="run.dt", value=setup.scene.run.dt)
    return level


def _refuse_slow(
    setup: MultilevelSetup, estimate: MultilevelEstimate, levels: Sequence[Level]
) -> None:
    """Raise OptionError for a measure whose error falls too slowly with the level."""
    if len(levels) > LEVELS and estimate.order < 0.5 * setup.order:
        raise setup.refusal(
            f"its error falls with order {estimate.order:.2g} in the step instead of"
            f" {setup.order:g}, as for extremes and events between steps. Use NAME_final or"
            " NAME_mean, or a shorter first step"
        )
    if len(levels) == MOST_LEVELS:
        rule = f"the error of the step is {estimate.bias:.2g} after {MOST_LEVELS} levels"
        raise setup.refusal(rule)
