"""The answers of a fit: the distinct minima in which its trials end."""

from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from rigidmc.studies.fit.parameters import MOMENTS
from rigidmc.studies.fit.problem import FitProblem
from rigidmc.studies.fit.solve import HOPELESS, Solution
from rigidmc.studies.fit.streams import Array

MOST = 20  # answers kept
ALIKE = 0.01  # of the variance of a residual: a tenth of a standard deviation
SAME = 1.0  # squared distance, in standard deviations, up to which two minima are one


class Answers(NamedTuple):
    """Distinct minima, the best first.

    trials : the best trial of each;  ends : number of trials that end in each
    """

    trials: NDArray[np.int64]
    ends: NDArray[np.int64]


def best_of(problem: FitProblem, solution: Solution) -> int:
    """Return the first trial of the least cost: the first guess, where it ends there, has the size
    of the scene's moments, which rates do not show."""
    cost = solution.sums.cost
    least = float(cost.min())
    return int(np.argmax(cost <= least + ALIKE * least / max(1, problem.residuals)))


def upright(problem: FitProblem, solution: Solution) -> Solution:
    """Return the trials with their axes named so that the sensors turn least.

    A body with its axes renamed and its sensor turned back, R g and g^T omega, has the same
    readings: 24 trials are one answer. Where a torque tells the axes apart, the cost shows it.
    """
    parameters, x = problem.parameters, np.array(solution.x)
    turned = [c for c in parameters.columns if c.word == "alignment"]
    if not turned:
        return solution
    group = Rotation.create_group("O")
    first = Rotation.from_rotvec(x[:, parameters.index[0, turned[0].columns]])
    which = np.argmin([(first * g).magnitude() for g in group], axis=0)
    turn = group[which].as_matrix()
    for column in parameters.columns:
        for places in parameters.index[: 1 if column.is_shared else None, column.columns]:
            if column.word == "alignment":
                x[:, places] = (Rotation.from_rotvec(x[:, places]) * group[which]).as_rotvec()
            elif column.name == MOMENTS:
                x[:, places] = np.einsum("tji,tj->ti", np.abs(turn), x[:, places])
            elif column.stream < 0 and column.size == 3:
                x[:, places] = np.einsum("tji,tj->ti", turn, x[:, places])
    some = np.flatnonzero((x != solution.x).any(1) & np.isfinite(solution.sums.cost))
    if not some.size:
        return solution
    sums = problem.sums(x[some])
    same = sums.cost <= solution.sums.cost[some] * (1.0 + 1e-6)
    for old, new in zip((solution.x, *solution.sums), (x[some], *sums), strict=True):
        old[some[same]] = new[same]
    return solution


def contenders(problem: FitProblem, solution: Solution) -> NDArray[np.int64]:
    """Return the trials whose minima are worth finding by the Jacobian itself: the best one of each
    answer."""
    cost = solution.sums.cost
    best = best_of(problem, solution)
    variance = float(cost[best]) / max(1, problem.residuals - problem.parameters.size)
    return distinct(problem, solution, best, variance).trials


def distinct(problem: FitProblem, solution: Solution, best: int, variance: float) -> Answers:
    """Return the distinct minima among the trials, the trial `best` first.

    A minimum that contradicts the data does not count. Two trials are one answer if the step
    between them changes the residuals by less than their noise: d^T N d <= variance, to first
    order, or as computed. Steps along what the data do not show change nothing, however long.

    variance : of a weighted residual
    """
    cost, left = solution.sums.cost, list[int]()
    order = [int(i) for i in np.argsort(cost) if np.isfinite(cost[i])]
    order = [best, *(i for i in order if i != best)]
    ends = list[int]()
    residuals = cache(lambda i: problem.jacobian(solution.x[i])[0])

    def is_same(i: int, j: int) -> bool:
        least = SAME * variance
        if _distance(solution, i, j) <= least:
            return True
        return bool(np.sum((residuals(i) - residuals(j)) ** 2) <= least)

    for i in order:
        if cost[i] > cost[best] + HOPELESS * variance:
            break
        for j, trial in enumerate(left):
            if is_same(i, trial):
                ends[j] += 1
                break
        else:
            if len(left) < MOST and (solution.is_settled[i] or not left):
                left.append(i)
                ends.append(1)
    return Answers(np.array(left, np.int64), np.array(ends, np.int64))


def _distance(solution: Solution, i: int, j: int) -> float:
    """Return the squared change of the residuals by the step between two trials, to first order."""
    step: Array = solution.x[i] - solution.x[j]
    return float(step @ solution.sums.matrix[j] @ step)
