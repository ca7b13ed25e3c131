"""Both methods for rare events, which go towards the event level by level.

Adaptive multilevel splitting branches the members of a noisy scene that come nearest to the event,
and drops the others. In subset simulation, the random numbers that define members walk towards
values whose members come nearest.
"""

from typing import Any, NamedTuple

import numpy as np
from scipy.special import ndtr, ndtri

from rigidmc.engine.kernel import layout
from rigidmc.engine.streams import uniforms
from rigidmc.inputs.arrays import Array, Ints
from rigidmc.planning.initial import random_dimensions
from rigidmc.runs.resources import refuse_count
from rigidmc.runs.segments import SegmentedRun
from rigidmc.scene.sampling import FixedPoints, RandomDimension
from rigidmc.studies.rare.score import Score

PARTS = 128  # parts of the run; members are scored and may branch at the end of each
# Fraction of the members dropped at a level. The variance is 14 % above that of a vanishing
# fraction (5 % with 0.1). Each level costs a fixed time; there are 2.7 times fewer than with 0.1.
KILLED = 0.25
MOST_SPLITS, MOST_SUBSETS = 10_000, 100  # levels
FEWER = "use fewer members and more repetitions, which work as well"
KEPT = 0.1  # fraction of the members kept at a level, as starts of the walks
# Accepted fraction of the steps of the walks; the best in one dimension, see Papaioannou et al.
ACCEPTED = 0.44
FARTHEST = 8.2  # standard deviations; beyond it the distribution function rounds to 1


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

    def branch(self, ended: Ints, parents: Ints, level: float) -> None:
        """Replace the paths of `ended` by copies of their parents, up to the part where the parent
        scores more than `level`, and continue each with independent noise."""
        at = (self.scores[:, parents] > level).argmax(axis=0)
        # by part, so that `_go_on` moves a prefix that grows: one call for each part
        order = np.argsort(at, kind="stable")
        ended, parents, at = ended[order], parents[order], at[order]
        self.states[:, ended] = self.states[:, parents]
        self.scores[:, ended] = self.scores[:, parents]
        self._go_on(ended, np.arange(self.used, self.used + ended.size), at)
        self.used += ended.size

    def _go_on(self, which: Ints, members: Ints, at: Ints) -> None:
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


def row_of(moving: SegmentedRun, rows: int, share: Array) -> Ints:
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
    for number in range(MOST_SPLITS):
        last = paths.scores[-1]
        reached = score.reached(last)
        level = np.partition(last, int(KILLED * members))[int(KILLED * members)]
        # All ties go: where only a quarter goes, the estimate of a random walk on integers is 22 %
        # low.
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


class ScoredMembers:
    """Members made from normal deviates z (d, n), one for each number that a member draws. With
    grids and tables, the last deviate selects the row.

    rows : number of rows, None without grids and tables
    """

    def __init__(self, moving: SegmentedRun, score: Score, rows: int | None) -> None:
        self.moving, self.score, self.rows = moving, score, rows
        self.dimensions: tuple[RandomDimension, ...] = random_dimensions(moving.plan.model)
        self.steps, self.flagged = 0.0, 0

    def normals(self, count: int, name: str, number: int) -> Array:
        """Return independent deviates (d, count), a function of seed, name and number."""
        d = len(self.dimensions) + (self.rows is not None)
        seed, name = self.moving.plan.run.seed, f"{name}.{number}"
        draws = [uniforms(seed, name, 0, count, i) for i in range(-(-d // 4))]
        deviates: Array = ndtri(np.concatenate(draws)[:d])
        return deviates

    def scores(self, z: Array) -> Array:
        """Compute the members made from z and return the best score of each."""
        moving, count = self.moving, z.shape[1]
        shares, rows = ndtr(z), None
        if self.rows is not None:
            rows = row_of(moving, self.rows, shares[-1])
        block = moving.start(FixedPoints(self.dimensions, shares), count, rows)[:, :count]
        members = np.zeros(count, np.int64)
        times, off = np.full(count, -np.inf), np.full(count, np.inf)
        for part in range(moving.ends.size - 1):
            block = moving.moved(block, members, part)
            if self.score.event is not None:
                now, far = self.score.progress(moving, block)
                off = np.where(now > times, far, np.where(now == times, np.minimum(off, far), off))
                times = np.maximum(times, now)
        if self.score.event is None:
            best = self.score.of(moving, block, part)
        else:
            self.score = self.score.sized(off)
            best = self.score.graded(times, off)
        self.steps += count * float(moving.ends[-1])
        self.flagged += int((block[layout.STATUS] > 0.0).sum())
        return best


def descend(
    moving: SegmentedRun, score: Score, members: int, target: float, rows: int | None
) -> SplittingResult:
    """Estimate the probability of an event by subset simulation.

    Each level keeps the tenth of the members with the best scores, and all others with the same
    score as the lowest of these. A walk through the normal deviates z starts from each, until the
    number of members is restored::

        z' = (1 - s^2)^(1/2) z + s n,   accepted if its member scores at least the level

    This leaves the normal distribution under that condition invariant. s, at most 1, is a multiple
    of the spread of the kept members in each direction; it adapts to the accepted fraction. The
    product of the kept fractions has a bias of the order 1/n, since levels and walks share members.
    Source: Au & Beck, Probab. Eng. Mech. 16 (2001) 263; Papaioannou, Betz, Zwirglmaier & Straub,
    Probab. Eng. Mech. 41 (2015) 89.
    """
    made = ScoredMembers(moving, score, rows)
    z = made.normals(members, "rare.start", 0)
    if rows is not None:
        z[-1] = ndtri(even_shares(moving.plan.run.seed, members))
    scores, share, pace = made.scores(z), 1.0, 1.0
    levels, shares = list[float](), list[float]()
    for number in range(MOST_SUBSETS):
        reached = score.reached(scores)
        level = np.partition(scores, -int(KEPT * members))[-int(KEPT * members)]
        kept = scores >= level
        if score.reached(np.array(level)) or kept.all() or np.isneginf(level):
            break
        if levels and not level > levels[-1]:  # no progress
            break
        share *= float(kept.mean())
        levels.append(float(level))
        shares.append(share)
        if share < target:
            break
        z, scores, pace = _walked(made, z[:, kept], scores[kept], level, members, pace, number)
    p = 0.0 if share < target else share * float(reached.mean())
    return SplittingResult(
        p, np.array(levels), np.array(shares), made.steps, made.flagged, share < target
    )


def _walked(
    made: ScoredMembers,
    z: Array,
    scores: Array,
    level: float,
    members: int,
    pace: float,
    number: int,
) -> tuple[Array, Array, float]:
    """Return (z, scores, pace) of `members` members that score `level` or more, by walks from
    given ones.

    pace : width of the steps, in units of the spread of the kept members
    """
    spread = np.minimum(1.0, z.std(axis=1, keepdims=True))
    all_z, all_scores, walk = [z], [scores], 0
    while (missing := members - sum(some.size for some in all_scores)) > 0:
        z, scores = z[:, :missing], scores[:missing]
        width = np.minimum(1.0, pace * spread)
        if made.rows is not None:  # every other step keeps the row: adjacent rows may differ much
            width = np.vstack([width[:-1], np.zeros(1) if walk % 2 else np.ones(1)])
        normals = made.normals(scores.size, f"rare.walk.{number}", walk)
        tried = np.clip(np.sqrt(1.0 - width**2) * z + width * normals, -FARTHEST, FARTHEST)
        new_scores = made.scores(tried)
        taken = new_scores >= level
        z, scores = np.where(taken, tried, z), np.where(taken, new_scores, scores)
        walk += 1
        # changes shrink as walk^-1/2: a width that follows the walk for ever would bias it
        pace = float(np.clip(pace * np.exp((taken.mean() - ACCEPTED) / np.sqrt(walk)), 1e-3, 10.0))
        all_z.append(z)
        all_scores.append(scores)
    return np.concatenate(all_z, axis=1), np.concatenate(all_scores), pace
