"""The answers of a fit: the distinct minima in which its trials end."""

from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigidmc.studies.fit.problem import FitProblem
from rigidmc.studies.fit.solve import Solution
from rigidmc.studies.fit.streams import Array

MOST = 20  # answers kept
HOPELESS = 100.0  # excess of the cost, in variances of a residual: ten standard deviations
ALIKE = 4.0  # of the variance of a residual: the data cannot tell costs that differ by less
SAME = 1.0  # squared distance, in standard deviations, up to which two minima are one


class Answers(NamedTuple):
    """Distinct minima, the best first.

    trials : the best trial of each;  ends : number of trials that end in each
    """

    trials: NDArray[np.int64]
    ends: NDArray[np.int64]


def best_of(problem: FitProblem, solution: Solution) -> int:
    """Return the best trial; of those with the same cost, the one whose sensors turn least.

    A body with its axes renamed and its sensor turned back has the same readings: of these 24, the
    one with the least alignment is the answer that a user expects.
    """
    cost, parameters = solution.sums.cost, problem.parameters
    turned = [c.columns for c in parameters.columns if c.word == "alignment"]
    angle = np.zeros(cost.size)
    for columns in turned:
        angle += np.linalg.norm(solution.x[:, parameters.index[0, columns]], axis=1)
    least = float(cost.min())
    alike = cost <= least + ALIKE * least / max(1, problem.residuals)
    # to .1 rad: of the trials alike there, the first has the size of the scene's moments
    return int(np.argmin(np.where(alike, np.round(angle, 1), np.inf)))


def contenders(problem: FitProblem, solution: Solution) -> NDArray[np.int64]:
    """Return the trials whose minima are worth finding by the Jacobian itself: the best one of each
    answer."""
    cost = solution.sums.cost
    best = int(np.argmin(cost))
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
