"""The members of the levels of a multilevel study: pairs of paths with the same start and noise.

Level l makes n 2^l steps. Its members have the indices from l 2^40 on, so that no two levels share
a draw and the variances of their means add up. From level 1 on a member also goes half as many
steps, each with the noise of two fine ones, see `rigidmc.engine.noise.deviates`: the level tells by
how much a measure changes if the step is halved. The paths of a free body in a bath and of the same
body with steps twice as long then differ by a multiple of the step, and the variance of what they
show by its square. Weights that follow the friction, exp(-gamma h) : 1 in place of 1 : 1, would
take out only the part of that which friction causes, not that of the torques.
"""

import re
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigidmc.planning.settle import Settled, settled
from rigidmc.runs.blocks import run
from rigidmc.scene.once import once
from rigidmc.scene.scene import Scene
from rigidmc.studies.measures import Measure
from rigidmc.studies.until import Goal

APART = 2**40  # members between the first ones of two levels
CHUNK = 2**17  # members at once: a call takes as long as 4000 members of few steps
Sums = dict[str, NDArray[np.float64]]
Ask = Callable[[Sequence[str]], list[Sums]]  # the sums of tasks, by their keys
_KEY = re.compile(r"level-(\d+)/batch-(\d+)")


class Request(NamedTuple):
    """What the tasks of a study have in common.

    steps : of the first level;  batch : members of a task
    """

    scene: Scene
    measure: Measure
    steps: int
    batch: int
    threads: int


class Asked(NamedTuple):
    """What a study is asked.

    text, goal : the measure and its width;  order : of the step;  most : cost at most, in steps
    """

    text: str
    goal: Goal
    order: float
    confidence: float
    most: float


def key_of(level: int, batch: int) -> str:
    """The key of a task."""
    return f"level-{level}/batch-{batch:06d}"


def task(request: Request, key: str) -> Sums:
    """The sums of one batch of a level, which depend on request and key alone, to the bit.

    members : that count;  flagged : paths that are flagged, or pairs of which one is
    without : members that are well and have no value
    mean, squares : of the corrections, and the sum of their squared distances from it
    """
    level, batch = _place(key)
    return _batches(request, level, batch, 1)[0]


def asking(request: Request) -> Ask:
    """What computes tasks here and now, neighbouring ones of a level together."""

    def ask(keys: Sequence[str]) -> list[Sums]:
        parts = _together(keys, max(1, CHUNK // request.batch))
        return [one for part in parts for one in _batches(request, *part)]

    return ask


def _place(key: str) -> tuple[int, int]:
    """(level, batch) of a key."""
    found = _KEY.fullmatch(key)
    if found is None:
        raise ValueError(f"{key} is no task of a multilevel study")
    return int(found[1]), int(found[2])


def _together(keys: Sequence[str], most: int) -> Iterator[tuple[int, int, int]]:
    """(level, first batch, batches) of keys that follow each other, `most` of them at most."""
    count = 0
    for i, key in enumerate(keys):
        level, batch = _place(key)
        count += 1
        goes_on = i + 1 < len(keys) and keys[i + 1] == key_of(level, batch + 1)
        if not goes_on or count == most:
            yield level, batch + 1 - count, count
            count = 0


def _batches(request: Request, level: int, first: int, count: int) -> list[Sums]:
    """The sums of `count` batches of a level from batch `first` on."""
    size, threads = request.batch, request.threads
    values, good = np.zeros(count * size), np.ones(count * size, bool)
    for sign, ready in zip((1.0, -1.0), paths(request, level), strict=False):
        plan = ready.plan._replace(
            first=level * APART + first * size, members=count * size, paired=sign < 0.0
        )
        result = run(ready.scene, plan, threads, units=ready.units)
        values += sign * request.measure.values(result)
        good &= result.status.values == 0
    parts = zip(values.reshape(count, size), good.reshape(count, size), strict=True)
    return [_summed(*part) for part in parts]


def paths(request: Request, level: int) -> tuple[Settled, ...]:
    """The runs of a level: of its fine paths, and from level 1 on of the coarse ones."""
    each = (request.steps << level, request.steps << level >> 1)[: 1 + (level > 0)]
    return _settled(request.scene, each, request.threads)


@once
def _settled(scene: Scene, steps: tuple[int, ...], threads: int) -> tuple[Settled, ...]:
    end = scene.run.t_end
    return tuple(settled(scene.with_run(dt=end / each, members=CHUNK), threads) for each in steps)


def _summed(values: NDArray[np.float64], good: NDArray[np.bool_]) -> Sums:
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
