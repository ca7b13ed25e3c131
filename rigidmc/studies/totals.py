"""Run an ensemble of any size, and keep nothing of its members but totals: estimates, histograms
and the number of flagged members."""

import math
import operator
from collections.abc import Iterable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from rigidmc.engine.cuda.devices import resolve_device
from rigidmc.engine.machine import threads_available
from rigidmc.errors import OptionError
from rigidmc.inputs.amounts import read_count
from rigidmc.inputs.arrays import Array
from rigidmc.processes.progress import Progress, announce
from rigidmc.results.layout import ResultLayout
from rigidmc.results.sinks import Arrays, HistogramCounts, Sink
from rigidmc.results.variables import variables_of
from rigidmc.runs.blocks import BlockJob, compute
from rigidmc.runs.resources import block_of
from rigidmc.runs.settled import Machine
from rigidmc.runs.simulate import prepare
from rigidmc.scene.scene import Scene, takes_scene
from rigidmc.statistics.censored import Column, Columns
from rigidmc.statistics.estimates import why_no_interval
from rigidmc.statistics.intervals import Estimate, half_of_mean, probability
from rigidmc.statistics.measures import Measure, Variables, measure, save_for_measures
from rigidmc.statistics.sums import GROUP, Moments, OrderedSums, moments_of_groups
from rigidmc.studies.until import without_saves

MORE = 8  # times the members of a block of a file: runs of 100 steps are 1.8 times as fast
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

    A member has the bits that it has in `simulate`; totals have the same bits for any number of
    threads. Histograms among the saves of the scene are counted; other saves over time are not
    made. Quantiles and correlations need the numbers of all members: use `simulate`, or a run
    directory and `rigidmc summary`.

    Parameters
    ----------
    scene : Scene or path_like
        a scene, its file, or the name of a shipped scene
    measures : str or iterable of str, optional
        probabilities and means, such as "p(flips >= 1)" and "mean(omega_last[3])"; see
        `rigidmc.statistics.measures`
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
    asked = [_sum_measure(text, variables_of(scene)) for text in texts]
    with announce(progress):
        run = prepare(scene)  # without the saves of the user's scene
        device = "cpu" if run.plan.scheme is None else resolve_device(device)
        block = MORE * block_of(run, threads, device, True)
        sink = _TotalsSink(run.layout, run.members.first, asked)
        # the layout of the sink: what no total needs stays in the units of integration
        run = replace(run, layout=sink.layout)
        members = compute(run, sink, Machine(threads, device, block, progress))
    return sink.totals(members, confidence)


class _Total(NamedTuple):
    """The total of a measure over some members.

    asked, there : number of selected members, and how many of them have a number
    successes : of a probability, how many numbers are 1
    groups : of a mean, the Moments of each group of members, see `rigidmc.statistics.sums`
    """

    asked: int = 0
    there: int = 0
    successes: int = 0
    groups: Array | None = None

    def plus(self, other: "_Total") -> "_Total":
        """Return the total of the members of both, without groups."""
        asked, there, successes = map(operator.add, self[:3], other[:3])
        return _Total(asked, there, successes)

    def estimate(self, measure: Measure, moments: Moments, confidence: float) -> Estimate:
        """Return the Estimate; nan if the time of an event is unknown for some members.

        moments : of the numbers of a mean
        """
        without = 1.0 - self.there / self.asked if self.asked else math.nan
        if not self.there or (measure.result.timed and without > 0.0):
            return Estimate(math.nan, math.nan, math.nan, without)
        if measure.kind == "p":
            share = probability(self.successes, self.there, confidence)
            return Estimate(*share, without).each(float)
        mean = moments.mean
        variance = moments.squares / (self.there - 1) if self.there > 1 else math.nan
        half = float(half_of_mean(variance, self.there, confidence))
        return Estimate(mean, mean - half, mean + half, without)


def _total_of(measure: Measure, block: Columns) -> _Total:
    """Return the total of a measure over a block of members."""
    who, values = measure.asks(block), measure.outcomes(block)
    there = who & np.isfinite(values)
    asked, count = int(np.count_nonzero(who)), int(np.count_nonzero(there))
    if measure.kind == "p":
        return _Total(asked, count, int(np.count_nonzero(there & (values == 1.0))))
    return _Total(asked, count, 0, moments_of_groups(values, there))


def _sum_measure(text: str, variables: Variables) -> Measure:
    """Return a measure that is a sum over members; OptionError for another one."""
    asked = measure(text, variables)
    if asked.kind not in KINDS:
        rule = (
            "needs the numbers of all members; totals are probabilities and means: use a run"
            " directory, `rigidmc run SCENE -o RUN/` and `rigidmc summary RUN`"
        )
        raise OptionError(rule, at="measures", value=asked.text)
    return asked


class _TotalsSink(Sink):
    """A sink that adds finished blocks to totals. The thread that moved a block takes its totals,
    while its values are in the cache of this core."""

    def __init__(self, layout: ResultLayout, first: int, measures: list[Measure]) -> None:
        names = {"status", "status_time", *(name for x in measures for name in x.names)}
        kept = {name: v for name, v in layout.by_member.items() if name in names}
        self.layout, self._measures = layout._replace(by_member=kept), measures
        self._first = first
        self._totals = [_Total() for _ in measures]
        self._sums = OrderedSums(sum(x.kind == "mean" for x in measures))
        self._histograms = HistogramCounts(layout.recording.histograms)

    def gather(self, job: BlockJob, results: Arrays) -> tuple[int, list[_Total], Arrays]:
        """Return the first group of a finished block, its totals, and its counts."""
        block, counts = self._columns(job, results), Arrays()
        if self._histograms.histograms:
            parts = self.layout.split(self.layout.saves(job.out, job.width)[..., job.column :])
            counts = self._histograms.of(job, parts, results["status"])
        group = (job.first - self._first) // GROUP
        return group, [_total_of(x, block) for x in self._measures], counts

    def _columns(self, job: BlockJob, results: Arrays) -> dict[str, Column]:
        """Return the variables of the members of a block, as a result has them."""
        block = {}
        for name, (_, dtype, attrs) in self.layout.by_member.items():
            values = results[name]
            if name in self.layout.constant:  # one column is enough
                values = np.broadcast_to(values[..., :1], (*values.shape[:-1], job.size))
            block[name] = Column(np.asarray(values[..., : job.size], dtype), attrs)
        return block

    def take(self, gathered: tuple[int, list[_Total], Arrays]) -> None:
        """Add the totals of a finished block."""
        group, totals, counts = gathered
        both = zip(self._totals, totals, strict=True)
        self._totals = [total.plus(more) for total, more in both]
        self._sums.add(group, [x.groups for x in totals if x.groups is not None])
        self._histograms.add(counts)

    def totals(self, members: dict[str, int], confidence: float) -> xr.Dataset:
        """Return the totals as a Dataset; members : of each status."""
        layout, rows = self.layout, iter(self._sums.totals())
        estimates = [
            total.estimate(x, next(rows) if x.kind == "mean" else Moments(), confidence)
            for x, total in zip(self._measures, self._totals, strict=True)
        ]
        attributes = layout.attributes()
        is_sample = not why_no_interval(xr.Dataset(attrs=attributes))
        table: Array = np.array([(*x, x.without) for x in estimates]).reshape(-1, 4)
        table[:, 1:3] = np.where(is_sample, table[:, 1:3], np.nan)
        units = [x.units(variables_of(layout.scene)) for x in self._measures]
        variables: dict[str, Any] = {
            name: ("measure", table[:, i], {"confidence": confidence} if 0 < i < 3 else {})
            for i, name in enumerate(("value", "low", "high", "without"))
        }
        about = {"long_name": "members of this status"}
        variables["members"] = ("status", list(members.values()), about)
        for name, counts in self._histograms.variables().items():
            dims, _, attrs = layout.of_ensemble[name]
            variables[name] = (dims, counts, attrs)
        coordinates: dict[str, Any] = {
            **layout.axes.coordinates(),
            "measure": ("measure", [x.text for x in self._measures]),
            "units": ("measure", units),
            "status": ("status", list(members)),
        }
        del coordinates["member"]
        return xr.Dataset(variables, coordinates, attributes)
