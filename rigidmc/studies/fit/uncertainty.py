"""The uncertainty of a fit: how far its residuals let the parameters be wrong.

Residuals of a right model are white noise. Those of real records hold what the model leaves out,
drag or time stamps, which lasts from sample to sample. They are described as white noise and a
model error with an exponential autocorrelation (Ornstein-Uhlenbeck), in each channel::

    C_kl = v delta_kl + u exp(-|t_k - t_l|/T)

v, u and T maximise the restricted likelihood of the residuals, that of the combinations which no
parameter of the fit can absorb. With the derivatives J, least squares then has the covariance::

    (J^T J)^-1 J^T C J (J^T J)^-1

Source: Patterson & Thompson, Biometrika 58 (1971) 545; White, Econometrica 48 (1980) 817.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from rigidmc.studies.fit.problem import FitProblem
from rigidmc.studies.fit.streams import Array
from rigidmc.studies.fit.visible import Seen, seen

SEEN = 4.6  # gain of a model error that white noise has with a chance of 1 % (chi^2, 2)
MOST = 2000  # samples of a channel that the likelihood takes; of longer ones, means of neighbours


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

    steps : times since the sample before (samples, channels), 0 before the first
    rows : residual and derivatives (samples, channels, 1 + columns), 0 where there is no sample
    is_there : whether there is one (samples, channels)
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
    steps = np.zeros((longest, len(places)))
    rows = np.zeros((*steps.shape, 1 + index.shape[1]))
    is_there = np.zeros(steps.shape, bool)
    for i, place in enumerate(places):
        steps[1 : place.size, i] = np.diff(times[place])
        rows[: place.size, i, 0] = residuals[place]
        rows[: place.size, i, 1:] = jacobian[place[:, None], index[i]]
        is_there[: place.size, i] = True
    return Channels(steps, rows, is_there, index, jacobian.shape[1])


def model_error(channels: Channels, shown: Seen) -> ModelError:
    """Return the covariance of the residuals that has the largest restricted likelihood."""
    basis = _basis(shown)
    span = float(channels.steps.sum(0).max())
    shortest = float(np.median(channels.steps[channels.steps > 0.0]))
    white = _likelihood(channels, basis, 0.0, 1.0)

    def cost(x: Array) -> float:
        return -_likelihood(channels, basis, math.exp(x[0]), math.exp(x[1]))[0]

    best, low = None, 0.3 * shortest
    for guess in (2.0 * shortest, 0.1 * span, span):
        found = minimize(
            cost, (0.0, math.log(max(guess, low))), method="Nelder-Mead",
            bounds=((-12.0, 16.0), (math.log(low), math.log(3.0 * span))),
            options={"xatol": 0.05, "fatol": 0.05, "maxiter": 80},
        )  # fmt: skip
        if best is None or found.fun < best.fun:
            best = found
    assert best is not None
    gain = -float(best.fun) - white[0]
    if not gain > 0.0:
        return ModelError(white[1], 0.0, shortest, 0.0)
    ratio, time = np.exp(best.x)
    variance = _likelihood(channels, basis, ratio, time)[1]
    return ModelError(variance, ratio * variance, float(time), gain)


def _basis(shown: Seen) -> Array:
    """Return combinations of the coordinates that the data show, as columns: the others have no
    information, whose logarithm would be -inf."""
    values, vectors = np.linalg.eigh(shown.inverse)
    keep = values > 1e-14 * values[-1]
    return np.asarray(vectors[:, keep] * np.sqrt(values[keep]))


def _likelihood(channels: Channels, basis: Array, ratio: float, time: float) -> tuple[float, float]:
    """Return (logarithm of the restricted likelihood at the best v, that v) for u = ratio v.

    By a Kalman filter for the model error, over all channels at once: innovations of residuals and
    derivatives are uncorrelated.
    """
    steps, rows, is_there, index, _ = channels
    decay = np.exp(-steps / time)
    count, columns = rows.shape[1:]
    mean, spread = np.zeros((count, columns)), np.full(count, ratio)
    information, logarithm = np.zeros((count, columns, columns)), 0.0
    for k in range(rows.shape[0]):
        if k:
            mean = decay[k][:, None] * mean
            spread = ratio + decay[k] ** 2 * (spread - ratio)
        there = is_there[k]
        variance = 1.0 + spread
        innovation = np.where(there[:, None], rows[k] - mean, 0.0)
        information += innovation[:, :, None] * (innovation / variance[:, None])[:, None, :]
        logarithm += float(np.log(variance[there]).sum())
        gain = np.where(there, spread / variance, 0.0)
        mean = mean + gain[:, None] * innovation
        spread = spread * (1.0 - gain)
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
    jacobian, decay = channels.rows[..., 1:], np.exp(-channels.steps / error.time)
    white = np.einsum("kci,kcj->cij", jacobian, jacobian)
    both, total = np.zeros_like(white), np.zeros(jacobian.shape[1:])
    for k in range(jacobian.shape[0]):
        total = decay[k][:, None] * total + jacobian[k]
        both += jacobian[k][:, :, None] * total[:, None, :]
    lasting = both + both.transpose(0, 2, 1) - white
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
