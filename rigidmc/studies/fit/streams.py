"""Streams: the measurements of one observable by one sensor, in one or several records."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigidmc.engine.kernel.normal_equations import (
    ATTITUDE,
    BIAS,
    DRIFT,
    MOUNTING,
    OF_DRIFT,
    OF_OFFSET,
    OF_ROTATION,
    OF_SCALE,
    OFFSET,
    SCALE,
    SENSOR_ROWS,
    VECTOR,
)

Array = NDArray[np.float64]


class Nuisance(NamedTuple):
    """An unknown property of a sensor.

    row : of its derivatives among all of a sensor;  size : its components, 0 for one a channel
    sensor_row : of its values, see `rigidmc.engine.kernel.normal_equations`
    unit : "" for the unit of the observable
    is_shared : whether all records of a sensor have the same
    kinds : of the streams that may have it
    """

    row: int
    size: int
    sensor_row: int
    unit: str
    is_shared: bool
    kinds: tuple[int, ...]


OUTLIER = 9.0  # medians: six standard deviations
ROUNDS = 100  # of steps to the largest likelihood
LEAST = 0.1  # of the mean variance of the channels of a sensor
SAME, LOWER = 0.03, 0.9  # changes of noise that change no weight much
ANY = 0, VECTOR, ATTITUDE
NUISANCES = {
    "bias": Nuisance(0, 0, BIAS, "", True, (0, VECTOR)),
    "scale": Nuisance(OF_SCALE, 0, SCALE, "1", True, (0, VECTOR)),
    "alignment": Nuisance(OF_ROTATION, 3, 0, "rad", True, (VECTOR, ATTITUDE)),
    "offset": Nuisance(OF_OFFSET, 1, OFFSET, "s", False, ANY),
    "drift": Nuisance(OF_DRIFT, 1, DRIFT, "1", False, ANY),
    "jitter": Nuisance(-1, 1, -1, "s", True, ANY),  # no parameter: it weighs the others
}


class Jitter(NamedTuple):
    """Random errors of the times of samples: their standard deviation [s], and that of it."""

    size: float = 0.0
    deviation: float = 0.0


class Stream(NamedTuple):
    """The measurements of one observable by one sensor.

    observable : its name;  kind : 0, VECTOR or ATTITUDE
    times : of the samples of each record since its start [s], (records, samples)
    values : (records, samples, components), nan where missing
    noise : standard deviation of each channel, in the unit of the observable; nan if unknown
    nuisances : names of NUISANCES
    is_estimated : whether the noise is found from the readings
    has_jitter : whether their times have errors, then `jitter`
    rates, shifts : of the model at the samples [1/s], and the likeliest errors of their times [s]
    """

    observable: str
    kind: int
    times: Array
    values: Array
    noise: Array
    nuisances: tuple[str, ...] = ()
    is_estimated: bool = False
    has_jitter: bool = False
    jitter: Jitter = Jitter()
    rates: Array | float = 0.0
    shifts: Array | float = 0.0

    @property
    def channels(self) -> int:
        """Number of residuals of a sample: an attitude has the three of a rotation vector."""
        return 3 if self.kind == ATTITUDE else self.values.shape[2]

    def channel_names(self) -> list[str]:
        """Return the names of the channels: the observable, with the number of its component."""
        name, several = self.observable, self.channels > 1
        return [f"{name}[{i + 1}]" if several else name for i in range(self.channels)]

    def weights(self) -> Array:
        """Return 1/sigma of each residual, 0 where a value or the time is missing."""
        present = np.isfinite(self.values)
        if self.kind == ATTITUDE:
            present = np.repeat(present.all(2, keepdims=True), 3, axis=2)
        present &= np.isfinite(self.times)[..., None]
        return np.where(present, 1.0 / self.noise, 0.0)

    def along(self) -> Array:
        """Return h of each channel of a sample, (records, samples, channels): 1 - h h^T makes the
        residuals r of a sample white, whose covariance the jitter makes 1 + s s^T, with the change
        s of r in its standard deviation. It is the inverse root of this covariance."""
        weights = self.weights()
        change = np.where(weights > 0.0, self.jitter.size * self.rates * weights, 0.0)
        root = np.sqrt(1.0 + np.sum(change**2, axis=2, keepdims=True))
        return np.asarray(change / np.sqrt(root * (root + 1.0)))

    def refined(self, left: Array, rates: Array, is_robust: bool) -> "Stream":
        """Return the stream with the noise and the jitter of residuals and rates [1/s] (records,
        samples, channels), nan where missing; itself if they are about its own."""
        if self.has_jitter:
            noise, jitter = noise_and_jitter(self, left, rates, is_robust)
            is_same = abs(jitter.size - self.jitter.size) <= 0.3 * jitter.deviation
            if is_same and (np.abs(noise - self.noise) <= SAME * noise).all():
                return self
            # the rate itself changes within an error of 5 ms: by a third of the noise of a phone
            each, factor = rates / noise, jitter.size**2
            shifts = factor * np.sum(each * left / noise, axis=2, keepdims=True)
            shifts /= 1.0 + factor * np.sum(each**2, axis=2, keepdims=True)
            shifts = np.nan_to_num(shifts) if self.kind != ATTITUDE else 0.0
            return self._replace(noise=noise, jitter=jitter, rates=rates, shifts=shifts)
        if not self.is_estimated:
            return self
        # a fast motion between two readings adds to their noise; rough errors of the model, too
        noise = np.minimum(self.noise, high_frequency_noise(self, left, is_robust))
        return self._replace(noise=noise) if (noise < LOWER * self.noise).any() else self

    def size_of(self, nuisance: str) -> int:
        """Return the number of components of a nuisance."""
        return NUISANCES[nuisance].size or self.channels

    def sensor(self, values: dict[str, Array], members: int, every: float) -> Array:
        """Return the numbers of the sensor for each member, (SENSOR_ROWS, members).

        values : of its nuisances, (members, components);  every : between saves [s]
        """
        from scipy.spatial.transform import Rotation  # .1 s of a process that fits nothing

        sensor = np.zeros((SENSOR_ROWS, members))
        sensor[[0, 4, 8]] = 1.0
        for name, x in values.items():
            if name == "alignment":
                sensor[:9] = Rotation.from_rotvec(x).as_matrix().reshape(-1, 9).T
            else:
                row = NUISANCES[name].sensor_row
                sensor[row : row + x.shape[1]] = x.T / (every if name == "offset" else 1.0)
        if self.kind == ATTITUDE:
            turned = Rotation.from_matrix(sensor[:9].T.reshape(-1, 3, 3)).inv()
            sensor[MOUNTING : MOUNTING + 4] = turned.as_quat(scalar_first=True).T
        return sensor


def padded(records: Sequence[Array]) -> Array:
    """Return records of different lengths as one array, filled with nan."""
    longest = max(len(record) for record in records)
    out = np.full((len(records), longest, *records[0].shape[1:]), np.nan)
    for row, record in zip(out, records, strict=True):
        row[: len(record)] = record
    return out


def kind_of(dims: tuple[str, ...]) -> int:
    """Return the kind of a stream of an observable with these dimensions."""
    return VECTOR if dims == ("axis",) else ATTITUDE if dims == ("quat",) else 0


def high_frequency_noise(
    stream: Stream, left: Array | None = None, is_robust: bool = False
) -> Array:
    """Return the noise of each channel from third divided differences of its readings, or of
    residuals `left` (records, samples, channels); they vanish for a smooth motion.

    is_robust : leaves outliers out

    A channel that always reads the same has the noise of the others: it may be a sensor that hangs.
    """
    if left is None:  # a rotation vector is twice the vector part of a quaternion
        left = stream.values[..., -stream.channels :] * (2.0 if stream.kind == ATTITUDE else 1.0)
    noise = np.zeros(stream.channels)
    for c in range(stream.channels):
        x = left[..., c : c + 1]
        weight, four = _successive(stream.times, x)
        third = (weight[..., None] * four).sum(1)
        third = third[_is_inside(third, is_robust)]
        if third.size and np.nanmax(x) > np.nanmin(x):
            noise[c] = max(np.sqrt(np.mean(third**2)), 1e-9 * np.nanmax(np.abs(x)))
    other = noise.max()
    # 1 where no channel changes: all residuals are then as good, in any unit
    return np.where(noise > 0.0, noise, other if other > 0.0 else 1.0)


def noise_and_jitter(
    stream: Stream, left: Array, rates: Array, is_robust: bool
) -> tuple[Array, Jitter]:
    """Return the noise of each channel and the jitter of the times, from residuals and rates [1/s]
    (records, samples, channels). The residuals of a sample have the covariance

        S = diag(sigma^2) + tau^2 rate rate^T

    of the largest likelihood. A given noise has an unknown factor, since a model error adds to it,
    too; tau is then told in its units. Each step multiplies a variance of the part V by the root of
    sum of r^T S^-1 V S^-1 r over sum of tr(S^-1 V).
    Source: Zhou, Hu, Zhou & Lange, J. Comput. Graph. Stat. 28 (2019) 350.
    """
    both = np.concatenate([left / stream.noise, rates / stream.noise], axis=2)
    both = both[np.isfinite(both).all(2)]
    r, rate = np.split(both[_is_inside(both[:, : stream.channels], is_robust)], 2, axis=1)
    if not rate.any():
        return stream.noise, Jitter(0.0, np.inf)
    size = np.ones(stream.channels)
    tau2 = np.sum(r**2) / np.sum(rate**2)
    for _ in range(ROUNDS):
        part = rate / size
        along = (rate * part).sum(1)
        below = 1.0 + tau2 * along
        left_along = (part * r).sum(1) / below
        squares = ((r / size - tau2 * part * left_along[:, None]) ** 2).sum(0)
        traces = (1.0 / size - tau2 * part**2 / below[:, None]).sum(0)
        if not stream.is_estimated:
            squares, traces = squares.sum(), traces.sum()
        size = size * np.sqrt(squares / traces)
        # the jitter explains all of a channel that alone changes: its noise would go to 0
        size = np.maximum(size, LEAST * np.mean(size * stream.noise**2) / stream.noise**2)
        tau2 *= np.sqrt(np.sum(left_along**2) / np.sum(along / below))
    # of Fisher's information on a factor of the noise, and on tau^2
    mixed = np.sum(along / below**2)
    total, of_tau = np.sum(stream.channels - 1 + below**-2), np.sum((along / below) ** 2)
    factor = 1.0 if stream.is_estimated else size[0]
    variance = tau2 / factor
    spread = np.sqrt(2.0 / (of_tau - mixed**2 / total)) / factor
    deviation = spread / max(2.0 * np.sqrt(variance), np.sqrt(spread))
    jitter = Jitter(float(np.sqrt(variance)), float(deviation))
    return stream.noise * np.sqrt(size / factor), jitter


def _successive(times: Array, x: Array) -> tuple[Array, Array]:
    """Return (weights of third divided differences (n, 4), of length 1; what they multiply
    (n, 4, columns)) of the values x (records, samples, columns), without gaps."""
    weights, fours, spans = [], [], []
    for t, record in zip(times, x, strict=True):
        there = np.flatnonzero(np.isfinite(t) & np.isfinite(record).all(1))
        four = there[np.arange(max(0, there.size - 3))[:, None] + np.arange(4)]
        apart = t[four][:, :, None] - t[four][:, None, :] + np.eye(4)
        # the 1 of a weight: its norm is set below, whatever the unit of time
        weights.append(1.0 / apart.prod(-1))
        fours.append(record[four])
        spans.append(t[four[:, 3]] - t[four[:, 0]])
    weight, span = np.concatenate(weights), np.concatenate(spans)
    near = span <= 2.0 * np.median(span) if span.size else span > 0.0
    weight = weight[near] / np.linalg.norm(weight[near], axis=1, keepdims=True)
    return weight, np.concatenate(fours)[near]


def _is_inside(third: Array, is_robust: bool) -> NDArray[np.bool_]:
    """Return which third differences (n, channels) have no outlier."""
    if not is_robust or not third.size:
        return np.ones(third.shape[0], bool)
    return np.asarray((np.abs(third) <= OUTLIER * np.median(np.abs(third), axis=0)).all(1))
