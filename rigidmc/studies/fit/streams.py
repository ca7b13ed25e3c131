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
    text : its meaning
    """

    row: int
    size: int
    sensor_row: int
    unit: str
    is_shared: bool
    kinds: tuple[int, ...]
    text: str


IDENTITY = np.eye(3)
ANY = 0, VECTOR, ATTITUDE
NUISANCES = {
    "bias": Nuisance(0, 0, BIAS, "", True, (0, VECTOR), "added to each reading"),
    "scale": Nuisance(OF_SCALE, 0, SCALE, "1", True, (0, VECTOR), "relative error of each reading"),
    "alignment": Nuisance(
        OF_ROTATION, 3, 0, "rad", True, (VECTOR, ATTITUDE), "rotation vector of the sensor's axes"
    ),
    "offset": Nuisance(OF_OFFSET, 1, OFFSET, "s", False, ANY, "of the sensor's clock"),
    "drift": Nuisance(OF_DRIFT, 1, DRIFT, "1", False, ANY, "relative error of the sensor's clock"),
}


class Stream(NamedTuple):
    """The measurements of one observable by one sensor.

    observable : its name;  kind : 0, VECTOR or ATTITUDE
    times : of the samples of each record since its start [s], (records, samples)
    values : (records, samples, components), nan where missing
    noise : standard deviation of each channel, in the unit of the observable; nan if unknown
    nuisances : names of NUISANCES
    mounting : rotation from body axes to axes of the sensor, before any alignment
    """

    observable: str
    kind: int
    times: Array
    values: Array
    noise: Array
    nuisances: tuple[str, ...] = ()
    mounting: Array = IDENTITY

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

    def size_of(self, nuisance: str) -> int:
        """Return the number of components of a nuisance."""
        return NUISANCES[nuisance].size or self.channels

    def sensor(self, values: dict[str, Array], members: int, every: float) -> Array:
        """Return the numbers of the sensor for each member, (SENSOR_ROWS, members).

        values : of its nuisances, (members, components);  every : between saves [s]
        """
        from scipy.spatial.transform import Rotation  # .1 s of a process that fits nothing

        sensor = np.zeros((SENSOR_ROWS, members))
        sensor[:9] = self.mounting.reshape(9, 1)
        for name, x in values.items():
            if name == "alignment":
                turned = Rotation.from_rotvec(x).as_matrix() @ self.mounting
                sensor[:9] = turned.reshape(-1, 9).T
            else:
                row = NUISANCES[name].sensor_row
                sensor[row : row + x.shape[1]] = x.T / (every if name == "offset" else 1.0)
        if self.kind == ATTITUDE:
            turned = Rotation.from_matrix(sensor[:9].T.reshape(-1, 3, 3)).inv()
            sensor[MOUNTING : MOUNTING + 4] = turned.as_quat(scalar_first=True).T
        return sensor

    def columns_of(self, first: int) -> NDArray[np.int64]:
        """Return the column of the derivative by each nuisance from column `first` on, -1 for the
        others."""
        columns = np.full(11, -1, np.int64)
        for name in self.nuisances:
            row, size = NUISANCES[name].row, self.size_of(name)
            columns[row : row + size] = first + np.arange(size)
            first += size
        return columns


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


def high_frequency_noise(stream: Stream) -> Array:
    """Return the noise of each channel from third divided differences of its records, scaled to the
    variance of one reading; they vanish for a smooth motion.

    A channel that always reads the same has the noise of the others: it may be a sensor that hangs.
    """
    shown = stream.times[:, np.arange(stream.times.shape[1] - 3)[:, None] + np.arange(4)]
    apart = shown[..., :, None] - shown[..., None, :] + np.eye(4)
    span = shown[..., 3] - shown[..., 0]
    has_gap = ~(span <= 2.0 * np.nanmedian(span)) if span.size else span > 0.0
    # the 1 of a weight: its norm is set below, whatever the unit of time
    weight = np.where(has_gap, np.nan, 1.0)[..., None] / apart.prod(-1)
    weight /= np.linalg.norm(weight, axis=-1, keepdims=True)
    values = stream.values[..., -stream.channels :]  # the vector part of a quaternion
    noise = np.zeros(stream.channels)
    for c in range(stream.channels):
        x = values[..., c]
        third = sum(weight[..., i] * x[:, i : x.shape[1] - 3 + i] for i in range(4))
        if np.isfinite(third).any() and np.nanmax(x) > np.nanmin(x):
            noise[c] = max(np.sqrt(np.nanmean(third**2)), 1e-9 * np.nanmax(np.abs(x)))
    other = noise.max()
    # 1 where no channel changes: all residuals are then as good, in any unit
    return np.where(noise > 0.0, noise, other if other > 0.0 else 1.0)
