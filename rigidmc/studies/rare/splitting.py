"""Adaptive multilevel splitting: branch the members of a noisy scene that come nearest to an
event, and drop the others."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigidmc.engine.kernel import layout
from rigidmc.engine.streams import uniforms
from rigidmc.runs.resources import refuse_count
from rigidmc.runs.segments import SegmentedRun
from rigidmc.studies.rare.score import Score

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
PARTS = 128  # parts of the run; members are scored and may branch at the end of each
# Fraction of the members dropped at a level. The variance is 14 % above that of a vanishing
# fraction (5 % with 0.1). Each level costs a fixed time; there are 2.7 times fewer than with 0.1.
KILLED = 0.25
MOST = 10_000  # levels
FEWER = "use fewer members and more repetitions, which work as well"


class SplittingResult(NamedTuple):
    """The result of a repetition.

    p : the probability;  levels, shares : scores, and the probability of scoring more than each
    steps : of all members together;  flagged : number of members that are not ok
    deep : whether it stopped because the probability fell below the target
    """

    p: float
    levels: Array
    shares: Array
    steps: float
    flagged: int
    deep: bool

    def numbers(self) -> dict[str, Any]:
        """Return the fields as arrays, for storage."""
        return {name: np.asarray(value, float) for name, value in self._asdict().items()}


class SplittingPaths:
    """The paths of members: state and score after each part of the run.

    states : (parts + 1, members, rows);  scores : (parts + 1, members), the largest so far
    """

    def __init__(
        self, moving: SegmentedRun, score: Score, count: int, rows: int | None = None
    ) -> None:
        self.moving, self.score = moving, score
        self.steps, self.used = 0.0, count
        parts, seed = moving.ends.size - 1, moving.plan.run.seed
        # the states of all parts, and a copy of them
        each = 2 * 8 * (parts + 1) * moving.start(seed, 1).shape[0]
        refuse_count(count, "members", each, FEWER)
        each_row = None if rows is None else row_of(moving, rows, even_shares(seed, count))
        block = moving.start(seed, count, each_row)
        self.states = np.empty((parts + 1, count, block.shape[0]))
        self.states[0] = block[:, :count].T
        self.scores = np.full((parts + 1, count), -np.inf)
        everyone = np.arange(count)
        self._go_on(everyone, everyone, np.zeros(count, int))

    def branch(self, ended: Indices, parents: Indices, level: float) -> None:
        """Replace the paths of `ended` by copies of their parents, up to the part where the parent
        scores more than `level`, and continue each with independent noise."""
        at = (self.scores[:, parents] > level).argmax(axis=0)
        order = np.argsort(at, kind="stable")
        ended, parents, at = ended[order], parents[order], at[order]
        self.states[:, ended] = self.states[:, parents]
        self.scores[:, ended] = self.scores[:, parents]
        self._go_on(ended, np.arange(self.used, self.used + ended.size), at)
        self.used += ended.size

    def _go_on(self, which: Indices, members: Indices, at: Indices) -> None:
        """Move members, each from part `at` on; `at` is in ascending order.

        which : their columns;  members : their indices
        """
        ends = self.moving.ends
        for part in range(int(at[0]), ends.size - 1):
            count = int(np.searchsorted(at, part, "right"))
            mine = which[:count]
            now = self.moving.moved(self.states[part, mine].T, members[:count], part)
            self.states[part + 1, mine] = now.T
            self.steps += count * float(ends[part + 1] - ends[part])
        # Score all parts at once, in a tenth of the time; the score of a maximum needs no part.
        rows, column = np.nonzero(np.arange(1, ends.size)[:, None] > at)
        if rows.size == 0:  # all branch at the end of the run
            return
        states = np.ascontiguousarray(self.states[rows + 1, which[column]].T)
        if self.score.event is not None:
            self.score = self.score.sized(self.score.progress(self.moving, states)[1])
        new = self.scores[1:, which]
        new[rows, column] = self.score.of(self.moving, states, ends.size - 2)
        self.scores[1:, which] = np.maximum.accumulate(new, axis=0)


def even_shares(seed: int, count: int) -> Array:
    """Return random numbers in (0, 1), one in each of `count` equal intervals."""
    return np.asarray((np.arange(count) + uniforms(seed, "rare.rows", 0, count, 0)[0]) / count)


def row_of(moving: SegmentedRun, rows: int, share: Array) -> Indices:
    """Return the members at the fractions `share`, numbers in (0, 1), of the first `rows` members
    of a scene."""
    return np.asarray(moving.plan.run.first + np.minimum((share * rows).astype(int), rows - 1))


def split(
    moving: SegmentedRun, score: Score, members: int, target: float, rows: int | None
) -> SplittingResult:
    """Estimate the probability of an event by adaptive multilevel splitting.

    Each level drops the quarter of the members with the lowest scores, and all others with the same
    score as the highest of these. A copy of a random remaining member replaces each: it follows
    this member to the first part of the run at whose end the score exceeds the level, and continues
    with independent noise. For n members, with k_i dropped at level i, the estimate ::

        p = (fraction with the event at the end) prod_i (1 - k_i/n)

    is unbiased for any number of members and parts. Each member has a random row of the scene's
    grids and tables, which its copies keep.
    Source: Cerou & Guyader, Stoch. Anal. Appl. 25 (2007) 417; Brehier, Gazeau, Goudenege, Lelievre
    & Rousset, Ann. Appl. Probab. 26 (2016) 3559.
    """
    paths = SplittingPaths(moving, score, members, rows)
    share, levels, shares, flagged = 1.0, list[float](), list[float](), 0
    for number in range(MOST):
        last = paths.scores[-1]
        reached = score.reached(last)
        level = np.partition(last, int(KILLED * members))[int(KILLED * members)]
        ended = np.flatnonzero((last <= level) & ~reached)
        if score.reached(np.array(level)) or ended.size == 0 or ended.size == members:
            break
        share *= 1.0 - ended.size / members
        levels.append(float(level))
        shares.append(share)
        if share < target:
            break
        flagged += int((paths.states[-1, ended, layout.STATUS] > 0.0).sum())
        alive = np.flatnonzero(np.isin(np.arange(members), ended, invert=True))
        chosen = uniforms(moving.plan.run.seed, "rare.parents", 0, ended.size, number)[0]
        paths.branch(ended, alive[(chosen * alive.size).astype(int)], float(level))
    p = 0.0 if share < target else share * float(reached.mean())
    return SplittingResult(
        p, np.array(levels), np.array(shares), paths.steps, flagged, share < target
    )
