"""The pixels of a map: from the values of members to intervals, and to a Dataset."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from rigidmc.engine.kernel.layout import STATUSES
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

    intervals: dict[str, NDArray[np.float64]]
    counts: NDArray[np.int32]

    def at(self, source: NDArray[np.int64]) -> "Pixels":
        """Return Pixels in which each pixel has the values of the pixel `source` at its place."""
        intervals = {text: values[:, source] for text, values in self.intervals.items()}
        return Pixels(intervals, self.counts[:, source])


class PixelCollector:
    """Collector of the values of the members in a range of pixels, (replicas, pixels)."""

    def __init__(
        self, request: MapRequest, measures: Sequence[Measure], pixels: range | None = None
    ) -> None:
        self.request, self.measures = request, measures
        self.pixels = range(request.pixels) if pixels is None else pixels
        shape = request.replicas, len(self.pixels)
        self._status = np.full(shape, _NOT_THERE, "i1")
        self._values = {one.text: np.zeros(shape, one.dtype) for one in measures}
        self._asked = {one.text: np.zeros(shape, bool) for one in measures}

    def take(self, dataset: xr.Dataset) -> None:
        """Store the values of the members of a result."""
        replica, pixel = np.divmod(dataset.member.values, self.request.pixels)
        place = replica * len(self.pixels) + pixel - self.pixels.start
        self._status.reshape(-1)[place] = dataset.status.values
        for one in self.measures:
            self._values[one.text].reshape(-1)[place] = one.values(dataset)
            self._asked[one.text].reshape(-1)[place] = one.asks(dataset)

    def missing(self) -> int:
        """Return the number of members not yet computed."""
        return int(np.count_nonzero(self._status == _NOT_THERE))

    def pixel_values(self) -> Pixels:
        """Return the intervals and counts of the pixels."""
        size = len(self.pixels)
        intervals = {one.text: np.full((4, size), np.nan) for one in self.measures}
        counts, step = np.zeros((3, size), "i4"), max(1, _AT_ONCE // self.request.replicas)
        for low in range(0, size, step):
            part = slice(low, low + step)
            status = self._status[:, part].T
            none, good = status == STATUSES["invalid_input"], status == 0
            failed = ~good & ~none & (status != _NOT_THERE)
            counts[:, part] = good.sum(1), failed.sum(1), none.sum(1)
            for one in self.measures:
                values, asked = (x[one.text][:, part].T for x in (self._values, self._asked))
                found = one.interval(values, asked, self.request.confidence)
                intervals[one.text][:, part] = *found, found.without
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


def map_dataset(
    request: MapRequest,
    scene: Scene,
    known: Mapping[str, Variable],
    measures: Sequence[Measure],
    pixels: Pixels,
    computed: NDArray[np.bool_] | None = None,
) -> xr.Dataset:
    """Return the Dataset of a map.

    known : the variables of the members of the scene
    computed : of an adaptive map, whether each pixel was computed
    """
    shape, dims, variables = request.shape, tuple(request.sides), dict[str, Any]()
    for one in measures:
        attrs = known[one.result.name].attrs
        text = f"{one.text}: {attrs.get('long_name', '')}"
        share = f"of its {100 * request.confidence:g} % interval"
        ends = "", f", low end {share}", f", high end {share}"
        *names, lacking = measure_variables(one)
        *numbers, without = pixels.intervals[one.text]
        if not is_sample(scene.model):  # all members of a pixel are equal: no interval
            numbers[1:] = np.full((2, without.size), np.nan)
        for name, values, end in zip(names, numbers, ends, strict=True):
            about = {"units": one.units(known), "long_name": text + end}
            about |= {CENSORED: FOLLOWED} if one.result.timed else {}
            variables[name] = (dims, values.reshape(shape), about)
        if (without > 0.0).any():
            text = f"{one.text}: fraction of members without a value"
            about = {"units": "1", "long_name": text}
            variables[lacking] = (dims, without.reshape(shape), about)
    for (name, text), count in zip(COUNTS.items(), pixels.counts, strict=True):
        about = {"units": "1", "long_name": text}
        variables[name] = (dims, count.reshape(shape), about)
    if computed is not None:
        about = {"long_name": "1 if the pixel was computed, 0 if it copies a computed one nearby"}
        variables[COMPUTED] = (dims, computed.astype("i1").reshape(shape), about)
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
    return xr.Dataset(variables, _coordinates(request, scene), facts)


def _coordinates(request: MapRequest, scene: Scene) -> dict[str, Any]:
    found = {}
    for key, grid in request.grids().items():
        name, *_, log = request.sides[key]
        attrs = {"long_name": name, "units": unit_at(scene.model, name), "log": int(log)}
        found[key] = ((key,), grid.values(), attrs)
    return found
