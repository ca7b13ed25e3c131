"""The members of the levels of a multilevel study: pairs of paths with the same start and noise.

Level l makes n 2^l steps. Its members have the indices from l 2^40 on, so that no two levels share
a draw and the variances of their means add up. From level 1 on a member also goes half as many
steps, each with the noise of two fine ones, see `rigidmc.engine.noise.deviates`: the level tells by
how much a measure changes if the step is halved. The paths of a free body in a bath and of the same
body with steps twice as long then differ by a multiple of the step, and the variance of what they
show by its square. Weights that follow the friction, exp(-gamma h) : 1 in place of 1 : 1, would
take out only the part of that which friction causes, not that of the torques.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigidmc.planning.settle import Settled, settled
from rigidmc.runs.blocks import run
from rigidmc.scene.once import once
from rigidmc.scene.scene import Scene
from rigidmc.studies.measures import Measure
from rigidmc.studies.until import Goal

APART = 2**40  # members between the first ones of two levels
TASKS = 2**32  # numbers of tasks between those of two levels
CHUNK = 2**17  # members at once: a call takes as long as 4000 members of few steps
Sums = Mapping[str, NDArray[Any]]


class Request(NamedTuple):
    """What the tasks of a study have in common.

    steps : of the first level;  batch : members of a task
    """

    scene: Scene
    measure: Measure
    steps: int
    batch: int


class Asked(NamedTuple):
    """What a study is asked.

    text, goal : the measure and its width;  order : of the step;  most : cost at most, in steps
    """

    text: str
    goal: Goal
    order: float
    confidence: float
    most: float


def number_of(level: int, batch: int) -> int:
    """The number of the task that is one batch of a level."""
    return level * TASKS + batch


def sums(request: Request, numbers: Sequence[int], threads: int) -> list[dict[str, NDArray[Any]]]:
    """The sums of tasks, each of which depends on request and number alone, to the bit.

    members : that count;  flagged : paths that are flagged, or pairs of which one is
    without : members that are well and have no value
    mean, squares : of the corrections, and the sum of their squared distances from it
    """
    parts = _together(numbers, max(1, CHUNK // request.batch))
    return [one for part in parts for one in _batches(request, *part, threads)]


def _together(numbers: Sequence[int], most: int) -> Iterator[tuple[int, int, int]]:
    """(level, first batch, batches) of numbers that follow each other, `most` at most."""
    count = 0
    for i, number in enumerate(numbers):
        count += 1
        if count == most or i + 1 == len(numbers) or numbers[i + 1] != number + 1:
            level, batch = divmod(number, TASKS)
            yield level, batch + 1 - count, count
            count = 0


def _batches(
    request: Request, level: int, first: int, count: int, threads: int
) -> list[dict[str, NDArray[Any]]]:
    """The sums of `count` batches of a level from batch `first` on."""
    size = request.batch
    values, good = np.zeros(count * size), np.ones(count * size, bool)
    for sign, ready in zip((1.0, -1.0), paths(request, level, threads), strict=False):
        plan = ready.plan._replace(
            first=level * APART + first * size, members=count * size, paired=sign < 0.0
        )
        result = run(ready.scene, plan, threads, units=ready.units)
        values += sign * request.measure.numbers(result)
        good &= result.status.values == 0
    parts = zip(values.reshape(count, size), good.reshape(count, size), strict=True)
    return [_summed(*part) for part in parts]


def paths(request: Request, level: int, threads: int) -> tuple[Settled, ...]:
    """The runs of a level: of its fine paths, and from level 1 on of the coarse ones."""
    each = (request.steps << level, request.steps << level >> 1)[: 1 + (level > 0)]
    return _settled(request.scene, each, threads)


@once
def _settled(scene: Scene, steps: tuple[int, ...], threads: int) -> tuple[Settled, ...]:
    end = scene.run.t_end
    return tuple(settled(scene.with_run(dt=end / each, members=CHUNK), threads) for each in steps)


def _summed(values: NDArray[np.float64], good: NDArray[np.bool_]) -> dict[str, NDArray[Any]]:
    """The sums of the members of a batch."""
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
