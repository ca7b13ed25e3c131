"""The pixels of a map: from the values of members to intervals, and to a Dataset."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from rigidmc.engine.kernel.layout import STATUSES
from rigidmc.inputs.arrays import Array, Bools, Ints
from rigidmc.physics.observables.saving import CENSORED, FOLLOWED
from rigidmc.results.variables import Variable
from rigidmc.scene.parameters import unit_at
from rigidmc.scene.sampling import is_sample
from rigidmc.scene.scene import Scene
from rigidmc.statistics.measures import Measure
from rigidmc.studies.stability_map.question import MapRequest
from rigidmc.version import VERSION

ASKED = "asked"  # attribute of a map with its request
COUNTS = {  # of the members of a pixel
    "good": "good members",
    "failed": "failed members",
    "none": "members with an impossible body or start",
}
COMPUTED = "computed"  # the variable of an adaptive map
_NOT_THERE = -1  # status of a member that is not computed yet
_AT_ONCE = 2**17  # values whose intervals are computed at once: a sorted copy takes 1 MB


class Pixels(NamedTuple):
    """Measures and counts of the members of pixels.

    intervals : {measure: (4, pixels)}: value, low, high, and the fraction of the evaluated members
        without a value
    counts : (3, pixels): good members, failed members, members with an impossible body or start
    """

    intervals: dict[str, Array]
    counts: NDArray[np.int32]

    def at(self, source: Ints) -> "Pixels":
        """Return Pixels in which each pixel has the values of the pixel `source` at its place."""
        intervals = {text: values[:, source] for text, values in self.intervals.items()}
        return Pixels(intervals, self.counts[:, source])


class MapRun(NamedTuple):
    """A prepared map, before its first step.

    scene : with the members of the map, integrator and step
    by_member : {name: Variable} of the members
    """

    request: MapRequest
    scene: Scene
    measures: list[Measure]
    by_member: Mapping[str, Variable]


class PixelCollector:
    """Collector of the values of the members in a range of pixels, (replicas, pixels)."""

    def __init__(self, map_run: MapRun, pixels: range | None = None) -> None:
        self.request, self.measures = map_run.request, map_run.measures
        self.pixels = range(self.request.pixels) if pixels is None else pixels
        shape = self.request.replicas, len(self.pixels)
        self._status = np.full(shape, _NOT_THERE, "i1")
        self._values = {measure.text: np.zeros(shape, measure.dtype) for measure in self.measures}
        self._asked = {measure.text: np.zeros(shape, bool) for measure in self.measures}

    def take(self, dataset: xr.Dataset) -> None:
        """Store the values of the members of a result."""
        replica, pixel = np.divmod(dataset.member.values, self.request.pixels)
        place = replica * len(self.pixels) + pixel - self.pixels.start
        self._status.reshape(-1)[place] = dataset.status.values
        for measure in self.measures:
            self._values[measure.text].reshape(-1)[place] = measure.values(dataset)
            self._asked[measure.text].reshape(-1)[place] = measure.asks(dataset)

    def missing(self) -> int:
        """Return the number of members not yet computed."""
        return int(np.count_nonzero(self._status == _NOT_THERE))

    def pixel_values(self) -> Pixels:
        """Return the intervals and counts of the pixels."""
        size = len(self.pixels)
        intervals = {measure.text: np.full((4, size), np.nan) for measure in self.measures}
        counts, step = np.zeros((3, size), "i4"), max(1, _AT_ONCE // self.request.replicas)
        for low in range(0, size, step):
            part = slice(low, low + step)
            status = self._status[:, part].T
            none, good = status == STATUSES["invalid_input"], status == 0
            failed = ~good & ~none & (status != _NOT_THERE)
            counts[:, part] = good.sum(1), failed.sum(1), none.sum(1)
            for measure in self.measures:
                values, asked = (x[measure.text][:, part].T for x in (self._values, self._asked))
                estimate = measure.interval(values, asked, self.request.confidence)
                intervals[measure.text][:, part] = *estimate, estimate.without
        return Pixels(intervals, counts)


def join_pixels(parts: Sequence[Pixels]) -> Pixels:
    """Join the Pixels of consecutive ranges."""
    intervals = {
        text: np.concatenate([part.intervals[text] for part in parts], axis=1)
        for text in parts[0].intervals
    }
    return Pixels(intervals, np.concatenate([part.counts for part in parts], axis=1))


def measure_variables(measure: Measure) -> tuple[str, str, str, str]:
    """Return the variable names of a measure: its value, the ends of its interval, and the fraction
    of members without a value, which a map has if it is not 0."""
    name = measure.text.replace(" ", "")
    return name, f"{name}_low", f"{name}_high", f"{name}_without"


def map_dataset(map_run: MapRun, pixels: Pixels, computed: Bools | None = None) -> xr.Dataset:
    """Return the Dataset of a map.

    computed : of an adaptive map, whether each pixel was computed
    """
    request, scene, by_member = map_run.request, map_run.scene, map_run.by_member
    variables: dict[str, Any] = {}

    def put(name: str, values: NDArray[Any], text: str, units: str = "1", **more: str) -> None:
        attrs = {"units": units, "long_name": text, **more}
        variables[name] = tuple(request.sides), values.reshape(request.shape), attrs

    share = f"of its {100 * request.confidence:g} % interval"
    ends = "", f", low end {share}", f", high end {share}"
    for measure in map_run.measures:
        text = f"{measure.text}: {by_member[measure.result.name].attrs.get('long_name', '')}"
        *names, lacking = measure_variables(measure)
        *numbers, without = pixels.intervals[measure.text]
        if not is_sample(scene.model):  # all members of a pixel are equal: no interval
            numbers[1:] = np.full((2, without.size), np.nan)
        units, more = measure.units(by_member), {CENSORED: FOLLOWED} if measure.result.timed else {}
        for name, values, end in zip(names, numbers, ends, strict=True):
            put(name, values, text + end, units, **more)
        if (without > 0.0).any():
            put(lacking, without, f"{measure.text}: fraction of members without a value")
    for (name, text), count in zip(COUNTS.items(), pixels.counts, strict=True):
        put(name, count, text)
    if computed is not None:
        text = "1 if the pixel was computed, 0 if it copies a computed one nearby"
        marks = computed.astype("i1").reshape(request.shape)
        variables[COMPUTED] = tuple(request.sides), marks, {"long_name": text}
    coordinates = {}
    for key, grid in request.grids().items():
        name, *_, log = request.sides[key]
        attrs = {"long_name": name, "units": unit_at(scene.model, name), "log": int(log)}
        coordinates[key] = (key,), grid.values(), attrs
    facts = {
        "title": scene.title,
        "source": f"rigidmc {VERSION}",
        "scene": scene.dumps(),
        "members": request.replicas,
        "confidence": request.confidence,
        "integrator": scene.run.integrator,
        "t_end": scene.run.t_end,
        ASKED: request.text(),
    }
    return xr.Dataset(variables, coordinates, facts)
