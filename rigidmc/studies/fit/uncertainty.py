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

from rigidmc.studies.fit.problem import FitProblem
from rigidmc.studies.fit.streams import Array
from rigidmc.studies.fit.visible import Seen, seen

SEEN = 4.6  # gain of a model error that white noise has with a chance of 1 % (chi^2, 2)


class ModelError(NamedTuple):
    """The covariance of the residuals.

    white : v, of white noise;  lasting : u, of what lasts from sample to sample;  time : T [s]
    gain : in the logarithm of the likelihood over white noise alone, 0 if that explains all
    """

    white: float
    lasting: float
    time: float
    gain: float

    @property
    def is_seen(self) -> bool:
        """Whether the residuals are correlated."""
        return self.gain > SEEN


class Channels(NamedTuple):
    """Residuals and their derivatives, each channel of each record beside the others.

    steps : times since the sample before (channels, samples), 0 before the first
    rows : residual and derivatives (channels, samples, 1 + columns), 0 where there is no sample
    is_there : whether there is one (channels, samples)
    places : place among all coordinates of each column of a channel (channels, columns)
    parameters : number of all coordinates
    """

    steps: Array
    rows: Array
    is_there: NDArray[np.bool_]
    places: NDArray[np.int64]
    parameters: int

    def gathered(self, parts: Array) -> Array:
        """Return the sum (size, size) of matrices (channels, columns, columns)."""
        total = np.zeros((self.parameters, self.parameters))
        for part, places in zip(parts, self.places, strict=True):
            total[np.ix_(places, places)] += part
        return total


def by_channel(
    places: list[NDArray[np.int64]],
    index: NDArray[np.int64],
    times: Array,
    residuals: Array,
    jacobian: Array,
) -> Channels:
    """Put residuals side by side. places : of each channel, in order of time;  index : as in
    Channels"""
    longest = max(place.size for place in places)
    steps = np.zeros((len(places), longest))
    rows = np.zeros((*steps.shape, 1 + index.shape[1]))
    is_there = np.zeros(steps.shape, bool)
    for i, place in enumerate(places):
        steps[i, 1 : place.size] = np.diff(times[place])
        rows[i, : place.size, 0] = residuals[place]
        rows[i, : place.size, 1:] = jacobian[place[:, None], index[i]]
        is_there[i, : place.size] = True
    return Channels(steps, rows, is_there, index, jacobian.shape[1])


def model_error(channels: Channels, shown: Seen) -> ModelError:
    """Return the covariance of the residuals that has the largest restricted likelihood."""
    basis = _basis(shown)
    span = float(channels.steps.sum(1).max())
    shortest = float(np.median(channels.steps[channels.steps > 0.0]))
    white = _likelihood(channels, basis, 0.0, 1.0)

    def cost(x: Any) -> float:
        return -_likelihood(channels, basis, math.exp(x[0]), math.exp(x[1]))[0]

    low, high = math.log(0.3 * shortest), math.log(3.0 * span)
    guesses = product((-3.0, 0.0, 3.0), np.linspace(low, high, 7)[1:-1])
    best = minimize(
        cost, min(guesses, key=cost), method="Nelder-Mead", bounds=((-12.0, 16.0), (low, high)),
        options={"xatol": 0.05, "fatol": 0.05, "maxiter": 80},
    )  # fmt: skip
    gain = -float(best.fun) - white[0]
    if not gain > SEEN:  # a hint of it would widen one interval in ten by a half
        return ModelError(white[1], 0.0, shortest, max(0.0, gain))
    ratio, time = np.exp(best.x)
    variance = _likelihood(channels, basis, ratio, time)[1]
    return ModelError(variance, ratio * variance, float(time), gain)


def _basis(shown: Seen) -> Array:
    """Return combinations of the coordinates that the data show, as columns: the others have no
    information, whose logarithm would be -inf."""
    values, vectors = np.linalg.eigh(shown.inverse)
    keep = values > 1e-14 * values[-1]
    return np.asarray(vectors[:, keep] * np.sqrt(values[keep]))


def _inverse(channels: Channels, time: float) -> tuple[Array, float]:
    """Return (the inverse of the autocorrelation exp(-|t_k - t_l|/T), the logarithm of its
    determinant): tridiagonal, all channels in a row, its upper diagonal before its main one.

    Source: Rasmussen & Williams, Gaussian Processes for Machine Learning (2006), appendix B.
    """
    is_next = channels.is_there & (np.arange(channels.steps.shape[1]) > 0)
    ratio = (channels.steps / time).ravel()[is_next.ravel()]
    rho, left = np.zeros(is_next.size), np.ones(is_next.size)
    rho[is_next.ravel()] = np.exp(-ratio)
    left[is_next.ravel()] = np.maximum(-np.expm1(-2.0 * ratio), 1e-12)  # 1 - rho^2
    diagonal = 1.0 / left
    diagonal[:-1] += (rho**2 / left)[1:]
    return np.stack([-rho / left, diagonal]), float(np.log(left).sum())


def _likelihood(channels: Channels, basis: Array, ratio: float, time: float) -> tuple[float, float]:
    """Return (logarithm of the restricted likelihood at the best v, that v) for u = ratio v.

    C/v = 1 + ratio K with the autocorrelation K, whose inverse is tridiagonal:
    C^-1 v = K^-1 (K^-1 + ratio)^-1, in a time that grows with the number of samples.
    """
    rows, is_there, index = channels.rows, channels.is_there, channels.places
    band, logarithm = _inverse(channels, time)
    factor = cholesky_banded(band + np.array([[0.0], [ratio]]))
    logarithm += 2.0 * float(np.log(factor[1]).sum())
    logarithm -= np.count_nonzero(~is_there) * math.log1p(ratio)
    y = cho_solve_banded((factor, False), rows.reshape(-1, rows.shape[2]))
    x = band[1][:, None] * y
    x[1:] += band[0, 1:, None] * y[:-1]
    x[:-1] += band[0, 1:, None] * y[1:]
    information = rows.transpose(0, 2, 1) @ x.reshape(rows.shape)
    matrix = basis.T @ channels.gathered(information[:, 1:, 1:]) @ basis
    right = np.zeros(channels.parameters)
    np.add.at(right, index, information[:, 1:, 0])
    right = basis.T @ right
    count = int(is_there.sum()) - matrix.shape[0]
    left = float(information[:, 0, 0].sum() - right @ np.linalg.solve(matrix, right))
    variance_of_all = max(left, 1e-300) / count  # 1e-300: its logarithm is a number
    determinant = float(np.linalg.slogdet(matrix)[1])
    return -0.5 * (count * math.log(variance_of_all) + logarithm + determinant), variance_of_all


def covariance_of(channels: Channels, shown: Seen, error: ModelError) -> Array:
    """Return the covariance of the coordinates (size, size), on what the data show."""
    jacobian = channels.rows[..., 1:]
    band = _inverse(channels, error.time)[0]
    lasting = solveh_banded(band, jacobian.reshape(-1, jacobian.shape[2])).reshape(jacobian.shape)
    across = jacobian.transpose(0, 2, 1)
    white, lasting = across @ jacobian, across @ lasting
    middle = channels.gathered(error.white * white + error.lasting * lasting)
    return np.asarray(shown.inverse @ middle @ shown.inverse)


class Assessment(NamedTuple):
    """What the residuals of a fit say.

    residuals : weighted;  variance : their sum of squares over the degrees of freedom
    error : their covariance;  shown : what the data show;  covariance : of the coordinates
    """

    residuals: Array
    variance: float
    error: ModelError
    shown: Seen
    covariance: Array


def assess(problem: FitProblem, x: Array) -> Assessment:
    """Return what the residuals say at the coordinates x (size,) of an answer."""
    residuals, jacobian = problem.jacobian(x)
    shown = seen(jacobian.T @ jacobian)
    times = problem.samples_in_order()[0]
    channels = by_channel(*problem.channels(), times, residuals, jacobian)
    error = model_error(channels, shown)
    free = max(1, residuals.size - x.size + len(shown.unseen))
    variance = float(residuals @ residuals) / free
    return Assessment(residuals, variance, error, shown, covariance_of(channels, shown, error))
