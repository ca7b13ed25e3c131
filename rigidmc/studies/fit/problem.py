"""A fit as members of one prepared run: trials and records become members, and their saves become
the normal equations of the trials."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigidmc.engine.kernel.layout import whole_lanes
from rigidmc.engine.kernel.normal_equations import DIVISORS, JACOBIAN, LANES, Samples
from rigidmc.engine.normal_equations import sum_samples
from rigidmc.results.sinks import Sink
from rigidmc.runs.blocks import compute
from rigidmc.runs.prepare import PreparedRun
from rigidmc.runs.settled import Machine
from rigidmc.studies.fit.parameters import FitParameters
from rigidmc.studies.fit.streams import Array, Stream

# Members of a block: their saves, 2,000 times of three rates with 6 derivatives, are 11 MB.
BLOCK = 32


class Sums(NamedTuple):
    """The normal equations of trials.

    matrix : J^T J (trials, size, size);  gradient : J^T r (trials, size)
    cost : r^T r (trials,), inf for a trial whose motion is flagged
    """

    matrix: Array
    gradient: Array
    cost: Array


@dataclass(frozen=True)
class Trials:
    """The members of some trials: what their saves are compared with.

    record : of each member;  sensors : of each stream, (SENSOR_ROWS, members)
    chain : see `rigidmc.engine.kernel.normal_equations.Samples`
    """

    record: NDArray[np.int64]
    sensors: list[Array]
    chain: Array


class SumSink(Sink):
    """A sink that sums the samples over the saves of each block, and keeps the sums alone."""

    def __init__(self, problem: "FitProblem", trials: Trials, keeps: bool) -> None:
        self.problem, self.trials, self.keeps = problem, trials, keeps
        self.layout = problem.run.layout
        members, columns = trials.record.size, problem.parameters.index.shape[1]
        shapes = [(problem.sums_of_a_member,)]
        if keeps:
            shapes = [(s.times.shape[1] * s.channels * (1 + columns),) for s in problem.streams]
        self.arrays = [np.zeros((*shape, members)) for shape in shapes]
        self.is_sound = np.zeros(members, bool)

    def gather(self, job: Any, results: Any) -> None:
        """Sum the samples of a finished block, in the thread that moved it."""
        low, size, width = job.first, job.size, whole_lanes(job.size)
        # the padding repeats the last member
        some = np.minimum(np.arange(low, low + width), self.trials.record.size - 1)
        sums = [np.zeros((array.shape[0], width)) for array in self.arrays]
        for i in range(len(self.problem.streams)):
            target = sums[i] if self.keeps else sums[0]
            sum_samples(self.problem.samples(i, job, self.trials, some, target, self.keeps))
        for array, part in zip(self.arrays, sums, strict=True):
            array[:, low : low + size] = part[:, :size]
        self.is_sound[low : low + size] = results["status"][:size] == 0


class FitProblem:
    """What a fit minimises: the sum of the squares of all residuals over their noise.

    run : prepared with the parameters as `varied`, and with derivatives by their components
    """

    def __init__(
        self, run: PreparedRun, parameters: FitParameters, streams: Sequence[Stream], threads: int
    ) -> None:
        self.run, self.parameters, self.streams = run, parameters, tuple(streams)
        self.threads = threads
        times = run.layout.axes.times
        self.every = float(times[1] - times[0])
        self.weights = [stream.weights() for stream in streams]
        # as whole arrays without nan: a missing value has the weight 0
        self.times = [np.nan_to_num(stream.times) / self.every for stream in streams]
        firsts = np.cumsum(
            [parameters.moving, *(sum(map(s.size_of, s.nuisances)) for s in streams)]
        )
        self.columns_of = [s.columns_of(int(n)) for s, n in zip(streams, firsts, strict=False)]

    @property
    def sums_of_a_member(self) -> int:
        """Number of sums of a member."""
        columns: int = self.parameters.index.shape[1]
        return columns * (columns + 1) // 2 + columns + 1

    @property
    def residuals(self) -> int:
        """Number of residuals that have a weight."""
        return sum(int(np.count_nonzero(weights)) for weights in self.weights)

    def samples(
        self, i: int, job: Any, trials: Trials, some: NDArray[np.int64], sums: Array, keeps: bool
    ) -> Samples:
        """Return the samples of stream i for a block; some : the members of its columns."""
        stream, layout, columns = self.streams[i], self.run.layout, self.parameters.index.shape[1]
        return Samples(
            saves=job.out,
            times=self.times[i],
            values=np.ascontiguousarray(stream.values),
            weights=self.weights[i],
            record=trials.record[some],
            sensor=np.ascontiguousarray(trials.sensors[i][:, some]),
            columns_of=self.columns_of[i],
            divisors=DIVISORS,
            chain=np.ascontiguousarray(trials.chain[..., some]),
            sums=sums,
            room=np.zeros((JACOBIAN + 4 * columns + 3) * LANES),
            first=np.zeros(LANES, np.int64),
            rows=layout.values,
            columns=1 + layout.columns,
            width=job.width,
            column=job.column,
            steps=layout.axes.times.size,
            samples=stream.times.shape[1],
            members=some.size,
            kind=stream.kind,
            row=layout.saved[stream.observable].start,
            channels=stream.channels,
            parameters=columns,
            moving=self.parameters.moving,
            mixed=self.parameters.mixed,
            keeps=int(keeps),
        )

    def _moved(self, x: Array, keeps: bool) -> SumSink:
        """Move the members of trials (trials, size), and return their sums."""
        parameters, count = self.parameters, x.shape[0] * self.parameters.records
        sensors = [
            stream.sensor(parameters.of_sensor(x, i), count, self.every)
            for i, stream in enumerate(self.streams)
        ]
        record = np.tile(np.arange(parameters.records), x.shape[0])
        sink = SumSink(self, Trials(record, sensors, parameters.chain(x)), keeps)
        run = self.run.with_values(parameters.of_scene(x))
        compute(run, sink, Machine(self.threads, "cpu", BLOCK))
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
        cost = np.where(is_sound, sums[-1], np.inf).reshape(trials, records).sum(1)
        return Sums(whole, slope, cost)

    def jacobian(self, x: Array) -> tuple[Array, Array]:
        """Return all weighted residuals (n,) of one trial (size,), and their derivatives (n, size)
        by its coordinates: of the first stream, record by record, then of the next."""
        sink, index = self._moved(x[None], keeps=True), self.parameters.index
        records, n = index.shape
        turns, residuals, slopes = self.parameters.turns(x[None], self.every), [], []
        for array, weights in zip(sink.arrays, self.weights, strict=True):
            kept = array.reshape(*weights.shape[1:], 1 + n, records)
            for record in range(records):
                has_weight = weights[record] > 0.0
                part = kept[..., record][has_weight]
                slope = np.zeros((part.shape[0], x.size))
                slope[:, index[record]] = -part[:, 1:] @ turns[record]
                residuals.append(part[:, 0])
                slopes.append(slope)
        return np.concatenate(residuals), np.concatenate(slopes)

    def channels(self) -> tuple[list[NDArray[np.int64]], NDArray[np.int64]]:
        """Return the places of the residuals of each channel of each record, in order of time; and
        the places of the coordinates of each."""
        places, index, at = list[NDArray[np.int64]](), list[NDArray[np.int64]](), 0
        for weights in self.weights:
            for record, columns in zip(weights, self.parameters.index, strict=True):
                has_weight = record > 0.0
                number = at + np.cumsum(has_weight).reshape(has_weight.shape) - 1
                places += [number[has_weight[:, c], c] for c in range(record.shape[1])]
                index += [columns] * record.shape[1]
                at += int(has_weight.sum())
        return places, np.array(index)

    def samples_in_order(self) -> tuple[Array, Array, Array, list[str], NDArray[np.int64]]:
        """Return (times, values, noise, channels, records) of all residuals; the name of a channel
        is that of a component, omega[1]."""
        parts: list[list[Any]] = [[], [], [], [], []]
        for stream, weights in zip(self.streams, self.weights, strict=True):
            for record, each in enumerate(weights):
                has_weight = each > 0.0
                t = np.broadcast_to(stream.times[record][:, None], each.shape)
                values = stream.values[record][:, -each.shape[1] :]
                noise = np.broadcast_to(stream.noise, each.shape)
                for part, x in zip(parts, (t, values, noise), strict=False):
                    part.append(x[has_weight])
                count = int(has_weight.sum())
                names = stream.channel_names()
                parts[3] += [names[c] for c in np.nonzero(has_weight)[1]]
                parts[4].append(np.full(count, record))
        t, values, noise, records = (np.concatenate(parts[i]) for i in (0, 1, 2, 4))
        return t, values, noise, parts[3], records
