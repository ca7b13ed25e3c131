"""Subset simulation: the random numbers that define the members of a scene walk towards values
whose members come nearest to an event."""

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from rigidmc.engine.kernel import layout
from rigidmc.engine.streams import uniforms
from rigidmc.planning.initial import random_dimensions
from rigidmc.runs.segments import SegmentedRun
from rigidmc.scene.sampling import FixedPoints, RandomDimension
from rigidmc.studies.rare.score import Score
from rigidmc.studies.rare.splitting import SplittingResult, even_shares, row_of

Array = NDArray[np.float64]
KEPT = 0.1  # fraction of the members kept at a level, as starts of the walks
# Accepted fraction of the steps of the walks; the best in one dimension, see Papaioannou et al.
ACCEPTED = 0.44
FARTHEST = 8.2  # standard deviations; beyond it the distribution function rounds to 1
MOST = 100  # levels


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
    for number in range(MOST):
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
        pace = float(np.clip(pace * np.exp((taken.mean() - ACCEPTED) / np.sqrt(walk)), 1e-3, 10.0))
        all_z.append(z)
        all_scores.append(scores)
    return np.concatenate(all_z, axis=1), np.concatenate(all_scores), pace
