"""The uncertainty of a fit: how far its residuals let the parameters be wrong.

Residuals of a right model are white noise. Real records also leave what the model lacks, such as
drag or errors of time stamps, which lasts from sample to sample. Each channel has white noise and
a model error with an exponential autocorrelation (Ornstein-Uhlenbeck)::

    C_kl = v delta_kl + u exp(-|t_k - t_l|/T)

v, u and T maximise the restricted likelihood of the residuals, that of the combinations which no
parameter of the fit can absorb. With the derivatives J, least squares then has the covariance::

    (J^T J)^-1 J^T C J (J^T J)^-1

Source: Patterson & Thompson, Biometrika 58 (1971) 545; White, Econometrica 48 (1980) 817.
"""

import math
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve_banded, cholesky_banded, solveh_banded
from scipy.optimize import minimize

from rigidmc.studies.fit.problem import LOSSES, FitProblem
from rigidmc.studies.fit.streams import Array
from rigidmc.studies.fit.visible import Seen, seen

SEEN = 4.6  # gain of a model error that white noise has with a chance of 1 % (chi^2, 2)
VANISHING = 1e-20  # of the variance: residuals of exact readings have rounding, 1e-2 of it and more
FEWEST = 0.05  # share of residuals that a loss takes as they are: fewer tell no deviation


class ModelError(NamedTuple):
    """The covariance of the residuals.

    white : v, of white noise;  lasting : u, of what lasts from sample to sample;  time : T [s]
    gain : in the logarithm of the likelihood over white noise alone, 0 if that explains all
    likelihood : its logarithm, with all parameters of the fit as known
    """

    white: float
    lasting: float
    time: float
    gain: float
    likelihood: float = 0.0

    @property
    def is_seen(self) -> bool:
        """Whether the residuals are correlated."""
        return self.gain > SEEN


class Channels(NamedTuple):
    """Residuals and their derivatives, one channel of one record after the other.

    steps : times since the sample before (n,), inf for the first of a channel
    rows : residual and derivatives (n, 1 + columns)
    parts : (first row, end, places among all coordinates after the residual, 0) of each channel
    size : number of all coordinates
    """

    steps: Array
    rows: Array
    parts: list[tuple[int, int, NDArray[np.int64]]]
    size: int

    def product(self, x: Array) -> Array:
        """Return rows^T x of all coordinates after the residual, (1 + size, 1 + size)."""
        total = np.zeros((1 + self.size, 1 + self.size))
        for low, high, places in self.parts:
            total[np.ix_(places, places)] += self.rows[low:high].T @ x[low:high]
        return total


def by_channel(
    times: Array, channel: NDArray[np.int64], index: NDArray[np.int64], residuals: Array,
    jacobian: Array,
) -> Channels:  # fmt: skip
    """Sort residuals by their channels. channel : of each, among channels of all records;  index :
    places of the coordinates of each channel (channels, columns)"""
    order = np.lexsort((times, channel))
    of_each, places = channel[order], np.pad(1 + index, ((0, 0), (1, 0)))
    steps = np.where(np.diff(of_each, prepend=-1), np.inf, np.diff(times[order], prepend=0.0))
    rows = np.column_stack([residuals[order], jacobian[order[:, None], index[of_each]]])
    bounds = np.searchsorted(of_each, np.arange(len(index) + 1))
    parts = list(zip(bounds[:-1], bounds[1:], places, strict=True))
    return Channels(steps, rows, parts, jacobian.shape[1])


def model_error(channels: Channels, shown: Seen) -> ModelError:
    """Return the covariance of the residuals that has the largest restricted likelihood."""
    basis = _basis(shown)
    steps = channels.steps[np.isfinite(channels.steps)]
    white = _likelihood(channels, basis, 0.0, 1.0)
    if white[1] < VANISHING:  # two equal readings say nothing of the noise: it is what it is stated
        return ModelError(1.0, 0.0, 1.0, 0.0, white[2])
    if not steps.size:  # records of one reading
        return ModelError(white[1], 0.0, 1.0, 0.0, white[2])
    span, shortest = float(steps.sum()) / max(1, len(channels.parts)), float(np.median(steps))

    def cost(x: Any) -> float:
        return -_likelihood(channels, basis, math.exp(x[0]), math.exp(x[1]) * shortest)[0]

    # of T over the distance of samples
    low, high = math.log(0.3), math.log(3.0 * span / shortest)
    guesses = product((-3.0, 0.0, 3.0), np.linspace(low, high, 7)[1:-1])
    first = min(guesses, key=cost)
    # of its own, scipy steps from a ratio of 1 by 2.5e-4 and stays there
    simplex = np.array(first) + np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 0.5]])
    best = minimize(
        cost, first, method="Nelder-Mead", bounds=((-12.0, 16.0), (low, high)),
        options={"xatol": 0.05, "fatol": 0.05, "maxiter": 80, "initial_simplex": simplex},
    )  # fmt: skip
    gain = -float(best.fun) - white[0]
    if not gain > SEEN:  # a hint of it would widen one interval in ten by a half
        return ModelError(white[1], 0.0, shortest, max(0.0, gain), white[2])
    ratio, time = np.exp(best.x) * (1.0, shortest)
    _, variance, likelihood = _likelihood(channels, basis, ratio, time)
    return ModelError(variance, ratio * variance, float(time), gain, likelihood)


def _basis(shown: Seen) -> Array:
    """Return combinations of the coordinates that the data show, as columns: the others have no
    information, whose logarithm would be -inf."""
    values, vectors = np.linalg.eigh(shown.inverse)
    keep = values > 1e-14 * values[-1]
    return np.asarray(vectors[:, keep] * np.sqrt(values[keep]))


def inverse_of(steps: Array, time: float) -> tuple[Array, Array]:
    """Return (the inverse of the autocorrelation exp(-|t_k - t_l|/T): tridiagonal, its upper
    diagonal before its main one; the variance of each, given the one before).

    Source: Rasmussen & Williams, Gaussian Processes for Machine Learning (2006), appendix B.
    """
    rho, left = np.exp(-steps / time), np.maximum(-np.expm1(-2.0 * steps / time), 1e-12)
    diagonal = 1.0 / left  # of 1 - rho^2
    diagonal[:-1] += (rho**2 / left)[1:]
    return np.stack([-rho / left, diagonal]), left


def _likelihood(
    channels: Channels, basis: Array, ratio: float, time: float
) -> tuple[float, float, float]:
    """Return (logarithm of the restricted likelihood at the best v, that v, logarithm of the whole
    likelihood at its best v and without a further step) for u = ratio v.

    C/v = 1 + ratio K with the autocorrelation K, whose inverse is tridiagonal:
    C^-1 v = K^-1 (K^-1 + ratio)^-1, in a time that grows with the number of samples.
    """
    band, variance = inverse_of(channels.steps, time)
    factor = cholesky_banded(band + np.array([[0.0], [ratio]]))
    logarithm = float(np.log(variance).sum()) + 2.0 * float(np.log(factor[1]).sum())
    y = cho_solve_banded((factor, False), channels.rows)
    x = band[1][:, None] * y
    x[1:] += band[0, 1:, None] * y[:-1]
    x[:-1] += band[0, 1:, None] * y[1:]
    whole = channels.product(x)
    matrix, right = basis.T @ whole[1:, 1:] @ basis, basis.T @ whole[1:, 0]
    size = channels.steps.size
    # as many readings as numbers that they show: nothing is left over to judge
    count = max(1, size - matrix.shape[0])
    # 1e-300: its logarithm is a number
    left = max(1e-300, float(whole[0, 0] - right @ np.linalg.solve(matrix, right)))
    restricted = count * math.log(left / count) + float(np.linalg.slogdet(matrix)[1])
    # where the fit ends: a step beyond would drive a body by a drag below 0
    complete = size * math.log(max(1e-300, float(whole[0, 0])) / size)
    return -0.5 * (restricted + logarithm), left / count, -0.5 * (complete + logarithm)


def covariance_of(channels: Channels, shown: Seen, error: ModelError) -> Array:
    """Return the covariance of the coordinates (size, size), on what the data show."""
    lasting = solveh_banded(inverse_of(channels.steps, error.time)[0], channels.rows)
    middle = channels.product(error.white * channels.rows + error.lasting * lasting)[1:, 1:]
    return np.asarray(shown.inverse @ middle @ shown.inverse)


def pseudo_residuals(loss: str, residuals: Array) -> Array:
    """Return psi/E[psi'] of residuals over their noise, with psi(r) = r rho'((r/scale)^2).

    A robust fit is, to first order, that of least squares to these.
    Source: Huber, Robust Statistics (1981), 7.10.
    """
    z = (residuals / LOSSES[loss][1]) ** 2
    if loss == "huber":
        slope, change = 1.0 / np.sqrt(np.maximum(z, 1.0)), np.where(z <= 1.0, 1.0, 0.0)
    elif loss == "cauchy":
        slope, change = 1.0 / (1.0 + z), (1.0 - z) / (1.0 + z) ** 2
    else:
        return residuals
    return np.asarray(slope * residuals / max(FEWEST, float(np.mean(change))))


class Assessment(NamedTuple):
    """What the residuals of a fit say.

    residuals : of the readings over their noise
    variance : of white residuals: the sum of their squares over the degrees of freedom
    error : their covariance;  shown : what the data show;  covariance : of the coordinates
    evidence : logarithm of their likelihood, less 1/2 ln n for each number that is fitted to the n
        residuals. Source: Schwarz, Ann. Stat. 6 (1978) 461.
    """

    residuals: Array
    variance: float
    error: ModelError
    shown: Seen
    covariance: Array
    evidence: float


def assess(problem: FitProblem, x: Array) -> Assessment:
    """Return what the residuals say at the coordinates x (size,) of an answer."""
    white, jacobian = problem.jacobian(x)
    white = pseudo_residuals(problem.loss, white)
    shown = seen(jacobian.T @ jacobian, problem.parameters.slopes(x))
    # at their stamps, errors of 5 ms made a walk that expected 45 times the squares of residuals
    _, _, _, names, records, times = problem.samples_in_order()
    index, channel = problem.parameters.index, np.unique(names, return_inverse=True)[1]
    of_each = np.tile(index, (channel.max() + 1, 1))
    channels = by_channel(times, channel * len(index) + records, of_each, white, jacobian)
    error = model_error(channels, shown)
    free = max(1, white.size - x.size + len(shown.unseen))
    variance, covariance = float(white @ white) / free, covariance_of(channels, shown, error)
    residuals = problem.residuals_of(x[None], is_white=False)[0]
    evidence = error.likelihood - 0.5 * math.log(white.size) * (x.size + 2 * error.is_seen)
    return Assessment(residuals, variance, error, shown, covariance, evidence)
