"""Run an ensemble of any size, and keep nothing of its members but totals: estimates, histograms
and the number of flagged members."""

import math
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from rigidmc.engine.cuda.devices import resolve_device
from rigidmc.engine.kernel.layout import STATUSES
from rigidmc.engine.machine import threads_available
from rigidmc.errors import OptionError
from rigidmc.progress import Progress, announce
from rigidmc.results import censored
from rigidmc.results.estimates import why_no_interval
from rigidmc.results.intervals import Estimate, half_of_mean, probability
from rigidmc.results.layout import ResultLayout
from rigidmc.results.measures import Measure, measure, save_for_measures
from rigidmc.results.sinks import Arrays, MemorySink, Place, WholeSink, make_buffer
from rigidmc.results.variables import variables_of
from rigidmc.runs.blocks import BlockJob, compute
from rigidmc.runs.prepare import prepare
from rigidmc.runs.resources import block_of
from rigidmc.scene.amounts import read_count
from rigidmc.scene.scene import Scene, takes_scene
from rigidmc.studies.until import without_saves

PART = 2**24  # bytes of the results of members whose totals are taken at once
MORE = 4  # times the members of a block of a file: runs of 100 steps are 1.8 times as fast
KINDS = ("p", "mean")  # of measures that are sums over members


@takes_scene
def simulate_totals(
    scene: Scene,
    measures: str | Iterable[str] = (),
    confidence: float = 0.95,
    threads: int | None = None,
    progress: Progress = False,
    device: str | None = None,
    **options: Any,
) -> xr.Dataset:
    """Run an ensemble and return only its totals, in memory that does not grow with the members.

    A member has the bits that it has in `simulate`. Histograms among the saves of the scene are
    counted; other saves over time are not made. Quantiles and correlations need the numbers of all
    members: use `simulate`, or a run directory and `rigidmc summary`.

    Parameters
    ----------
    scene : Scene or path_like
        a scene, its file, or the name of a shipped scene
    measures : str or iterable of str, optional
        probabilities and means, such as "p(flips >= 1)" and "mean(omega_last[3])"; see
        `rigidmc.results.measures`
    confidence : float, optional
        confidence level of the intervals
    threads : int, optional
        as in `simulate`
    progress : bool or callable, optional
        as in `simulate`
    device : str, optional
        as in `simulate`
    **options : object
        as in `simulate`, such as members=10**9

    Returns
    -------
    xarray.Dataset
        over `measure`: value, low, high, and `without`, the fraction of the selected members
        without a value; over `status`: members; and the histograms

    Raises
    ------
    OptionError
        for a measure that is neither a probability nor a mean

    Examples
    --------
    >>> totals = rm.simulate_totals("dzhanibekov", "p(flips >= 1)", members=1000, t_end=2.5)
    >>> totals.sizes["measure"], int(totals.members.sum())
    (1, 1000)
    """
    texts = (measures,) if isinstance(measures, str) else tuple(measures)
    threads = threads_available() if threads is None else read_count(threads, "threads")
    scene = without_saves(save_for_measures(scene.with_run(**options), texts))
    asked = [_sum_of(measure(text, variables_of(scene))) for text in texts]
    with announce(progress):
        run = prepare(scene)
        device = "cpu" if run.plan.scheme is None else resolve_device(device)
        block = MORE * block_of(run.plan, threads, device, True)
        sink = _TotalsSink(run.layout._replace(block=block), asked)
        compute(
            run.plan,
            run.layout._replace(block=block),
            run.initial,
            run.program(device),
            sink,
            threads=threads,
            block=block,
            units=run.units,
            progress=progress,
        )
    return sink.totals(confidence)


class _Sum(NamedTuple):
    """The totals of a measure: selected members, those with a number, their mean, and the sum of
    squares about it; for a probability the numbers are 1 and 0."""

    measure: Measure
    asked: int = 0
    count: Any = 0
    mean: float = 0.0
    squares: float = 0.0

    def plus(self, part: xr.Dataset) -> "_Sum":
        """Return the totals with the members of a part added."""
        one = self.measure
        who = one.asks(part)
        values = one.values(part)
        if one.result.timed and one.kind == "p":
            values = censored.answers(values, one.relation, one.number)
        elif one.result.timed:
            values = one._plain(values)
        x = values[who & np.isfinite(values)].astype(float)
        asked, both = self.asked + int(who.sum()), self.count + x.size
        if not x.size:
            return self._replace(asked=asked)
        mean = float(x.mean())
        apart = mean - self.mean
        squares = float(np.square(x - mean).sum()) + apart * apart * self.count * x.size / both
        middle = self.mean + apart * x.size / both
        return _Sum(one, asked, both, middle, self.squares + squares)

    def estimate(self, confidence: float) -> Estimate:
        """Return the Estimate; nan if the time of an event is unknown for some members."""
        without = 1.0 - self.count / self.asked if self.asked else math.nan
        if not self.count or (self.measure.result.timed and without > 0.0):
            return Estimate(math.nan, math.nan, math.nan, without)
        if self.measure.kind == "p":
            successes = round(self.mean * self.count)
            value, low, high = map(float, probability(successes, self.count, confidence))
            return Estimate(value, low, high, without)
        variance = self.squares / (self.count - 1) if self.count > 1 else math.nan
        half = float(half_of_mean(variance, self.count, confidence))
        return Estimate(self.mean, self.mean - half, self.mean + half, without)


def _sum_of(asked: Measure) -> _Sum:
    """Return the empty totals of a measure; OptionError for one that is not a sum."""
    if asked.kind not in KINDS:
        rule = (
            "needs the numbers of all members; totals are probabilities and means: use a run"
            " directory, `rigidmc run SCENE -o RUN/` and `rigidmc summary RUN`"
        )
        raise OptionError(rule, at="measures", value=asked.text)
    return _Sum(asked)


class _TotalsSink(WholeSink):
    """A sink that adds finished blocks to totals, many members at a time."""

    def __init__(self, layout: ResultLayout, sums: list[_Sum]) -> None:
        self.layout, self._sums = layout, sums
        names = {"status", "status_time", *(name for one in sums for name in one.measure.names)}
        kept = {name: v for name, v in layout.by_member.items() if name in names}
        self._kept = layout._replace(by_member=kept)
        blocks = max(1, PART // sum(self._kept.bytes_of_a_member()) // layout.block)
        self._size = blocks * layout.block  # members of a part
        self._open: dict[int, tuple[MemorySink, set[int]]] = {}
        self._counts = np.zeros(len(STATUSES), np.int64)
        self._histograms: Arrays = {}
        self._about: xr.Dataset | None = None

    def reserve(self, low: int, count: int) -> Place:
        """Return the place for the values of `count` members."""
        return make_buffer(self.layout, count)

    def take(self, found: tuple[BlockJob, Arrays]) -> None:
        """Add a finished block to its part, and a complete part to the totals."""
        (job, results), layout = found, self.layout
        i = (job.first - layout.first) // self._size
        low = layout.first + i * self._size
        members = min(self._size, layout.first + layout.members - low)
        if i not in self._open:
            part = self._kept._replace(first=low, members=members)
            self._open[i] = MemorySink(part, {}, False), set()
        sink, there = self._open[i]
        sink.take(sink.gather(job, results))
        there.add(job.first)
        if len(there) == -(-members // layout.block):
            self._add(self._open.pop(i)[0].finish())

    def _add(self, part: xr.Dataset) -> None:
        self._counts += np.bincount(part.status.values, minlength=len(STATUSES))
        self._sums = [one.plus(part) for one in self._sums]
        for name in self.layout.of_ensemble:
            self._histograms[name] = self._histograms.get(name, 0) + part[name].values
        if self._about is None:
            self._about = part.drop_dims(("member", "flagged"), errors="ignore")

    def totals(self, confidence: float) -> xr.Dataset:
        """Return the totals as a Dataset."""
        assert self._about is not None and not self._open
        about = self._about
        found = [one.estimate(confidence) for one in self._sums]
        known = not why_no_interval(about)
        table: NDArray[np.float64] = np.array([(*x, x.without) for x in found]).reshape(-1, 4)
        table[:, 1:3] = np.where(known, table[:, 1:3], np.nan)
        units = [one.measure.units(variables_of(self.layout.scene)) for one in self._sums]
        variables: dict[str, Any] = {
            name: ("measure", table[:, i], {"confidence": confidence} if 0 < i < 3 else {})
            for i, name in enumerate(("value", "low", "high", "without"))
        }
        variables["members"] = ("status", self._counts, {"long_name": "members of this status"})
        for name, counts in self._histograms.items():
            variables[name] = (about[name].dims, counts, about[name].attrs)
        coordinates = {
            "measure": ("measure", [one.measure.text for one in self._sums]),
            "units": ("measure", units),
            "status": ("status", list(STATUSES)),
        }
        kept = {name: axis for name, axis in about.coords.items() if name != "measure"}
        return xr.Dataset(variables, {**kept, **coordinates}, self.layout.attributes())

    def finish(self) -> None:
        """Return nothing: `totals` returns the result."""

    def discard(self) -> None:
        """Drop incomplete parts."""
        self._open.clear()
