"""Levenberg-Marquardt for many trials in lockstep, and the polish of the best ones.

Each iteration is one run: it has the normal equations of all trials that still move. A trial steps
by (N + damping diag N)^-1 g, with its own damping. Normal equations square the condition, so the
best trials are polished on the Jacobian itself.
Source: Nielsen, Damping parameter in Marquardt's method (1999); More, LNM 630 (1978) 105.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from rigidmc.studies.fit.problem import LOSSES, FitProblem, Sums
from rigidmc.studies.fit.streams import Array

LONGEST = 1.0  # of a step of ln J: trial bodies change by a factor e at most
GAIN = 1e-3  # a step of less changes nothing that the data can tell
ITERATIONS = 60
ROUND, KEPT = 3, 128  # after 3 iterations the worse half of the trials rests, never the best 128
MOST_DAMPED = 1e8  # no step of this damping has an effect: the trial rests


class Solution(NamedTuple):
    """Where the trials end.

    x : coordinates (trials, size);  sums : there
    is_settled : whether the cost of a trial no longer falls
    ends : number of first guesses that end there
    """

    x: Array
    sums: Sums
    is_settled: NDArray[np.bool_]
    ends: NDArray[np.int64]


def minimise(problem: FitProblem, x: Array, ends: NDArray[np.int64] | None = None) -> Solution:
    """Lower the cost of trials x (trials, size) until a step gains less than GAIN of the variance
    of a residual. ends : as in Solution, 1 each by default"""
    accuracy = GAIN / max(1, problem.residuals)
    x, damping = np.array(x), np.full(x.shape[0], 1e-3)  # a copy, because it changes below
    matrix, gradient, cost = problem.sums(x)
    moves, rests = np.isfinite(cost), np.zeros(cost.size, bool)
    for iteration in range(1, ITERATIONS):
        some = np.flatnonzero(moves)
        if iteration % ROUND == 0 and some.size > KEPT:
            some = np.sort(some[np.argsort(cost[some], kind="stable")[: max(KEPT, some.size // 2)]])
            moves[:] = False
            moves[some] = True
        if not some.size:
            break
        # What would leave its limit stays: clipped at the limit, the step of all goes uphill.
        low, high, at, g = problem.parameters.low, problem.parameters.high, x[some], gradient[some]
        free = np.where(g < 0.0, at > low, at < high)
        both = free[:, :, None] & free[:, None, :]
        step, expected = damped_steps(matrix[some] * both, g * free, damping[some])
        ln_moments = slice(0, problem.parameters.mixed)
        longest = np.abs(step[:, ln_moments]).max(1, initial=0.0)
        step /= np.maximum(1.0, longest / LONGEST)[:, None]
        # A drag below 0 would drive the body: a step ends at the limit of a parameter.
        trial = np.clip(at + step, low, high)
        tried = problem.sums(trial)
        gain = cost[some] - tried.cost
        better = gain > 0.0
        took = some[better]
        x[took] = trial[better]
        matrix[took], gradient[took] = tried.matrix[better], tried.gradient[better]
        # Nielsen: a step as good as expected divides the damping by up to 9.
        ratio = np.clip(gain / np.maximum(expected, np.finfo(float).tiny), 0.0, 1.0)
        factor = np.where(better, np.maximum(1.0 / 9.0, 1.0 - (2.0 * ratio - 1.0) ** 3), 4.0)
        damping[some] = np.maximum(1e-12, damping[some] * factor)
        small = np.where(better, gain, expected) <= accuracy * cost[some]
        cost[took] = tried.cost[better]
        rests[some] = small | (damping[some] > MOST_DAMPED)
        moves[some] = ~rests[some]
    ends = np.ones(cost.size, np.int64) if ends is None else ends
    return Solution(x, Sums(matrix, gradient, cost), rests & np.isfinite(cost), ends)


def damped_steps(matrix: Array, gradient: Array, damping: Array) -> tuple[Array, Array]:
    """Return (steps, the gains that a linear model expects) of trials.

    In units in which the diagonal of the matrix is 1, so no unit of a parameter matters.
    """
    unit = np.sqrt(np.einsum("tii->ti", matrix))
    unit[unit == 0.0] = 1.0  # a parameter that the data do not show does not move
    scaled = matrix / (unit[:, :, None] * unit[:, None, :])
    g = gradient / unit
    step = np.linalg.solve(scaled + damping[:, None, None] * np.eye(g.shape[1]), g[..., None])[
        ..., 0
    ]
    expected = np.einsum("ti,ti->t", step, 2.0 * g)
    expected -= np.einsum("ti,tij,tj->t", step, scaled, step)
    return step / unit, expected


def polish(problem: FitProblem, solution: Solution) -> Solution:
    """Move trials to their minima by the Jacobian itself, by trust regions."""
    x, cost = np.array(solution.x), np.array(solution.sums.cost)
    low, high = problem.parameters.low, problem.parameters.high
    at = lru_cache(1)(lambda y: problem.jacobian(np.frombuffer(y)))  # both at once
    for i in range(cost.size):
        found = least_squares(
            lambda y: at(y.tobytes())[0], x[i], lambda y: at(y.tobytes())[1],
            bounds=(low, high), x_scale="jac",
            ftol=1e-12, xtol=1e-12, gtol=1e-14, max_nfev=40,
            loss=problem.loss, f_scale=LOSSES[problem.loss][1],
        )  # fmt: skip
        if 2.0 * found.cost < cost[i]:
            x[i], cost[i] = found.x, 2.0 * found.cost
    return solution._replace(x=x, sums=solution.sums._replace(cost=cost))
