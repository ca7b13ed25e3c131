"""A fit as members of one prepared run: trials and records become members, and their saves become
the normal equations of the trials."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigidmc.engine.kernel.layout import whole_lanes
from rigidmc.engine.kernel.normal_equations import (
    CAUCHY,
    CAUCHY_SCALE,
    HUBER,
    HUBER_SCALE,
    JACOBIAN,
    LANES,
    Samples,
)
from rigidmc.engine.kernel.normal_equations import NUISANCES as OF_NUISANCES
from rigidmc.engine.normal_equations import sum_samples
from rigidmc.results.sinks import Sink
from rigidmc.runs.blocks import compute
from rigidmc.runs.prepare import PreparedRun
from rigidmc.runs.settled import Machine
from rigidmc.studies.fit.parameters import FitParameters
from rigidmc.studies.fit.streams import NUISANCES, Array, Stream

# Numbers that a block saves, or else 32 members: a block of 32 takes .9 ms of Python.
BLOCK = 1 << 20
# {name, as in scipy.optimize.least_squares: (number in the kernel, scale)}
LOSSES = {"linear": (0, 1.0), "huber": (HUBER, HUBER_SCALE), "cauchy": (CAUCHY, CAUCHY_SCALE)}
# Change of the residuals over their noise, by a unit of a coordinate or by all of it, that may be
# rounding: the azimuth of a top changes its rates by 6e-14, those without noise by 2e-6.
ROUNDED = 1e-5


class Sums(NamedTuple):
    """The normal equations of trials.

    matrix : J^T J (trials, size, size);  gradient : J^T r (trials, size)
    cost : r^T r (trials,), or that of the loss; inf for a trial whose motion is flagged
    """

    matrix: Array
    gradient: Array
    cost: Array


class SumSink(Sink):
    """A sink that compares the saves of each block with the samples, and keeps the sums alone, or,
    if `keeps`, residuals, rates and derivatives.

    x : trials (trials, size); the members are the records of the first one, then of the next
    """

    def __init__(self, problem: "FitProblem", x: Array, keeps: bool, is_white: bool) -> None:
        self.problem, self.layout = problem, problem.run.layout
        self.keeps, self.is_white = keeps, is_white
        parameters, streams = problem.parameters, problem.streams
        records, columns, trials = parameters.records, problem.columns, x.shape[0]
        self.record, members = np.tile(np.arange(records), trials), trials * records
        self.chain = parameters.chain(x)
        self.sensors = [
            stream.sensor(parameters.of_sensor(x, i), members, problem.every)
            for i, stream in enumerate(streams)
        ]
        rows = [columns * (columns + 1) // 2 + columns + 1]
        if keeps:
            rows = [s.times.shape[1] * s.channels * (2 + columns) for s in streams]
        self.arrays = [np.zeros((count, members)) for count in rows]
        self.is_sound = np.zeros(members, bool)

    def gather(self, job: Any, results: Any) -> None:
        """Compare the samples of a finished block, in the thread that moved it."""
        low, size = job.first, job.size
        width = LANES * -(-size // LANES)  # the job has whole_lanes, 32 for one member
        # the padding repeats the last member
        some = np.minimum(np.arange(low, low + width), self.record.size - 1)
        sums = [np.zeros((array.shape[0], width)) for array in self.arrays]
        for i in range(len(self.problem.streams)):
            sum_samples(self._samples(i, job, some, sums[i] if self.keeps else sums[0]))
        for array, part in zip(self.arrays, sums, strict=True):
            array[:, low : low + size] = part[:, :size]
        self.is_sound[low : low + size] = results["status"][:size] == 0

    def _samples(self, i: int, job: Any, some: NDArray[np.int64], sums: Array) -> Samples:
        """Return the samples of stream i for a block; some : the members of its columns."""
        problem, layout = self.problem, self.layout
        stream, parameters = problem.streams[i], problem.parameters
        columns, of_value = problem.columns, (1 + layout.columns) * job.width
        first = layout.saved[stream.observable].start * of_value + job.column
        return Samples(
            saves=job.out.reshape(-1)[first:],
            times=problem.times[i],
            values=np.ascontiguousarray(problem.values[i]),
            weights=problem.weights[i],
            record=self.record[some],
            sensor=np.ascontiguousarray(self.sensors[i][:, some]),
            columns_of=problem.columns_of[i],
            chain=np.ascontiguousarray(self.chain[..., some]),
            along=problem.along[i],
            sums=sums,
            room=np.zeros((JACOBIAN + 4 * columns + 3) * LANES),
            pitch=layout.values * of_value,
            columns=1 + layout.columns,
            width=job.width,
            steps=layout.axes.times.size,
            samples=stream.times.shape[1],
            members=some.size,
            kind=stream.kind,
            channels=stream.channels,
            parameters=columns,
            moving=min(columns, parameters.moving),
            mixed=min(columns, parameters.mixed),
            keeps=int(self.keeps),
            is_shaken=int(self.is_white and stream.jitter.size > 0.0),
            loss=LOSSES[problem.loss][0],
        )


def is_felt(change: Array, x: Array) -> NDArray[np.bool_]:
    """Return whether residuals depend on coordinates x by more than rounding.

    change : of the residuals, over their noise, by a unit of each coordinate
    """
    return np.asarray(change * np.maximum(1.0, np.abs(x)) > ROUNDED)


class FitProblem:
    """What a fit minimises: the sum of the squares of all residuals over their noise, or of a loss.

    run : prepared with the parameters as `varied`, and with derivatives by their components
    """

    def __init__(
        self,
        run: PreparedRun,
        parameters: FitParameters,
        streams: Sequence[Stream],
        threads: int,
        loss: str = "linear",
    ) -> None:
        self.run, self.parameters, self.streams = run, parameters, tuple(streams)
        self.threads, self.loss = threads, loss
        self.columns = parameters.index.shape[1] if run.plan.columns else 0  # with derivatives
        times = run.layout.axes.times
        self.every = float(times[1] - times[0])
        self.weights = [stream.weights() for stream in streams]
        self.along = [stream.along() for stream in streams]
        # as whole arrays without nan: a missing value has the weight 0
        self.corrected = [s.times + np.sum(s.shifts, axis=-1) for s in streams]
        self.times = [np.nan_to_num(t) / self.every for t in self.corrected]
        self.values = [s.values + s.rates * s.shifts for s in streams]
        self.columns_of = np.full((len(streams), OF_NUISANCES), -1)
        for column in parameters.columns:
            if column.word and self.columns:
                row = NUISANCES[column.word].row
                places = column.first + np.arange(column.size)
                self.columns_of[column.stream, row : row + column.size] = places

    def still(self) -> "FitProblem":
        """Return the problem without derivatives: residuals in a fraction of the time."""
        run = self.run.with_derivatives(())
        return FitProblem(run, self.parameters, self.streams, self.threads, self.loss)

    @property
    def residuals(self) -> int:
        """Number of residuals that have a weight."""
        return sum(int(np.count_nonzero(weights)) for weights in self.weights)

    def _moved(self, x: Array, keeps: bool, is_white: bool = True) -> SumSink:
        """Move the members of trials (trials, size), and compare them with the samples."""
        sink = SumSink(self, x, keeps, is_white)
        run = self.run.with_values(self.parameters.of_scene(x))
        most = max(1, BLOCK // run.layout.numbers)
        block = whole_lanes(min(most, -(-run.members.size // self.threads)))
        compute(run, sink, Machine(self.threads, "cpu", block))
        return sink

    def sums(self, x: Array) -> Sums:
        """Return the normal equations of trials x (trials, size), by their coordinates."""
        sink, index = self._moved(x, keeps=False), self.parameters.index
        (sums,), (trials, size), (records, n) = sink.arrays, x.shape, index.shape
        pairs, (rows, columns) = n * (n + 1) // 2, np.triu_indices(n)
        matrix = np.zeros((trials * records, n, n))
        matrix[:, rows, columns] = matrix[:, columns, rows] = sums[:pairs].T
        # A sum that is not finite comes from a motion that is flagged or has no derivative.
        is_sound = sink.is_sound & np.isfinite(sums).all(0)
        matrix[~is_sound] = 0.0
        gradient = np.where(is_sound[:, None], sums[pairs : pairs + n].T, 0.0)
        turns = self.parameters.turns(x, self.every)
        matrix = (turns.transpose(0, 2, 1) @ matrix @ turns).reshape(trials, records, n, n)
        gradient = np.einsum("mij,mi->mj", turns, gradient).reshape(trials, records, n)
        whole, slope = np.zeros((trials, size, size)), np.zeros((trials, size))
        for record, places in enumerate(index):
            whole[:, places[:, None], places] += matrix[:, record]
            slope[:, places] += gradient[:, record]
        felt = is_felt(np.sqrt(np.einsum("tii->ti", whole)), x)
        whole, slope = whole * (felt[:, :, None] & felt[:, None, :]), slope * felt
        cost = np.where(is_sound, sums[-1], np.inf).reshape(trials, records).sum(1)
        return Sums(whole, slope, cost)

    def compared(self, x: Array, is_white: bool = True) -> list[Array]:
        """Return what each stream says of trials x (trials, size): residuals, rates of the model
        and derivatives by the columns of a record, all over the noise of a reading, nan if the
        motion is flagged, as (records, samples, channels, 2 + columns, trials); is_white : those
        whose errors are independent"""
        sink, records = self._moved(x, True, is_white), self.parameters.records
        for array in sink.arrays:  # a flagged member saves its last good state
            array[:, ~sink.is_sound] = np.nan
        return [
            np.moveaxis(array.reshape(*weights.shape[1:], -1, x.shape[0], records), -1, 0)
            for array, weights in zip(sink.arrays, self.weights, strict=True)
        ]

    def rows_of(self, x: Array, is_white: bool = True) -> Array:
        """Return what `compared` returns of all weighted residuals, (n, 2 + columns, trials)."""
        each = zip(self.compared(x, is_white), self.weights, strict=True)
        return np.concatenate([part[weights > 0.0] for part, weights in each])

    def residuals_of(self, x: Array, is_white: bool = True) -> Array:
        """Return all weighted residuals (trials, n) of trials x (trials, size)."""
        return self.rows_of(x, is_white)[:, 0].T

    def jacobian(self, x: Array, is_white: bool = True) -> tuple[Array, Array]:
        """Return all weighted residuals (n,) of one trial (size,), and their derivatives (n, size)
        by its coordinates: of the first stream, record by record, then of the next; is_white :
        those whose errors are independent"""
        rows = self.rows_of(x[None], is_white)[..., 0]
        turns = self.parameters.turns(x[None], self.every)
        slopes, record = np.zeros((len(rows), x.size)), self.samples_in_order()[4]
        for i, places in enumerate(self.parameters.index):
            some = np.flatnonzero(record == i)
            slopes[some[:, None], places] = -rows[some, 2:] @ turns[i]
        return rows[:, 0], slopes * is_felt(np.linalg.norm(slopes, axis=0), x)

    def refined(self, x: Array) -> tuple[Stream, ...]:
        """Return the streams with the noise and the jitter that the residuals of a trial x (size,)
        show; () if these are what the fit took."""
        streams, compared = [], self.compared(x[None], is_white=False)
        for stream, each, weights in zip(self.streams, compared, self.weights, strict=True):
            sigma = np.where(weights > 0.0, stream.noise, np.nan)
            left, rates = sigma * each[..., 0, 0], sigma * each[..., 1, 0] / self.every
            streams.append(stream.refined(left, rates, self.loss != "linear"))
        is_new = any(one is not old for one, old in zip(streams, self.streams, strict=True))
        return tuple(streams) if is_new else ()

    def samples_in_order(self) -> tuple[Array, Array, Array, list[str], NDArray[np.int64], Array]:
        """Return (times, values, noise, channels, records, times with the likeliest errors) of all
        residuals; the name of a channel is that of a component, omega[1]."""
        parts: list[tuple[Any, ...]] = []
        for stream, weights, at in zip(self.streams, self.weights, self.corrected, strict=True):
            record, k, c = np.nonzero(weights > 0.0)
            values, names = stream.values[..., -stream.channels :], np.array(stream.channel_names())
            of_time = stream.times[record, k], values[record, k, c]
            parts.append((*of_time, stream.noise[c], names[c], record, at[record, k]))
        t, values, noise, names, records, at = map(np.concatenate, zip(*parts, strict=True))
        return t, values, noise, names.tolist(), records, at
