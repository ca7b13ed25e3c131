"""Sinks collect the results of finished blocks: here in memory, in `rigidmc.results.writer` in
files."""

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rigidmc.engine.kernel.layout import whole_lanes
from rigidmc.engine.machine import allocate_aligned
from rigidmc.engine.threads import Keeper
from rigidmc.inputs.arrays import Array, Ints
from rigidmc.results.layout import ResultLayout, Selection
from rigidmc.scene.recording import Labelled

if TYPE_CHECKING:
    import xarray as xr

Arrays = dict[str, NDArray[Any]]
Place = tuple[Array, int, int]  # an array, its width, and the column of a block in it


def kept_values(layout: ResultLayout, parts: Arrays) -> Arrays:
    """Return {variable: array, members last} of the kept values.

    parts : saved values and derivatives by name, at all times, see `ResultLayout.split`
    """
    kept = {}
    for observable, word in layout.recording.retained.items():
        for axis, name in enumerate(layout.names_of(observable)):  # axis : of times
            values: Any = parts[name]
            before = (slice(None),) * axis
            if word == "full":
                kept[name] = values
            elif word == "thinned":
                kept[f"{name}_thinned"] = values[(*before, layout.axes.thinned)]
            elif word == "final":
                kept[f"{name}_final"] = values[(*before, -1)]
    return kept


def flagged_values(
    layout: ResultLayout, members: Ints, parts: Arrays, status: NDArray[Any]
) -> Arrays:
    """Return {variable: array, flagged members last} of the flagged members of a block, given the
    indices of all; {} if all values of all members are kept."""
    names = [name for name, word in layout.recording.retained.items() if word != "full"]
    if not names:
        return {}
    bad = np.flatnonzero(status)
    return {
        "flagged_member": members[bad],
        **{
            f"{part}_flagged": parts[part][..., bad]
            for name in names
            for part in layout.names_of(name)
        },
    }


def concat_flagged(pieces: Iterable[Arrays]) -> Arrays:
    """Join pieces of flagged values to {variable: array}, members in order."""
    pieces = [piece for piece in pieces if piece]
    if not pieces:
        return {}
    both = {name: np.concatenate([piece[name] for piece in pieces], axis=-1) for name in pieces[0]}
    order = np.argsort(both["flagged_member"])
    return {name: values[..., order] for name, values in both.items()}


class HistogramCounts:
    """Histograms of a run, counted block by block."""

    def __init__(self, histograms: Labelled) -> None:
        self.histograms = histograms
        self.counts: Arrays = {}

    def of(self, job: Any, parts: Arrays, status: NDArray[Any]) -> Arrays:
        """Return the counts of the healthy members of a block; parts : its values by name, at all
        times."""
        healthy: Any = status[: job.size] == 0
        if healthy.all():
            healthy = slice(None)  # copies nothing
        counts = {}
        for label, histogram in self.histograms:
            values = parts[histogram.name][..., : job.size]
            values = values[:, histogram.component] if values.ndim == 3 else values
            counts[label] = histogram.counts(values[:, healthy])
        return counts

    def add(self, counts: Arrays) -> None:
        """Add the counts of a block."""
        for label, some in counts.items():
            self.counts[label] = self.counts.get(label, 0) + some

    def variables(self) -> Arrays:
        """Return {name: counts} of the results."""
        variables = {}
        for label, _ in self.histograms:
            counts = self.counts[label]
            variables[label] = counts[:, 1:-1]
            variables[f"{label}_below"], variables[f"{label}_above"] = counts[:, 0], counts[:, -1]
        return variables


class Sink:
    """A destination for the results of blocks: memory, a file, or the shards of a run directory.

    keeper : stores states of blocks in progress, None if nothing does
    """

    layout: ResultLayout
    keeper: Keeper | None = None

    def reserve(self, low: int, count: int) -> Place:
        """Return the place for the values of `count` members from number `low` of the run on."""
        return make_buffer(self.layout, count)

    def has(self, place: int) -> bool:
        """Return whether an earlier run left the results of the block at a place."""
        return False

    def resumed(self, job: Any) -> Any:
        """Return a block continued from the state that an earlier run left, if there is one."""
        return job

    def gather(self, job: Any, results: Arrays) -> Any:
        """Gather the values of a finished block, in the thread that moved it; return what `take`
        needs. Several blocks may do this at once."""
        return job, results

    def take(self, gathered: Any) -> None:
        """Store a finished block, in the main thread; gathered : what `gather` returned."""

    def finish(self) -> Any:
        """Complete the result and return it."""

    def discard(self) -> None:
        """Drop an incomplete result."""


class ResultSink(Sink):
    """A sink of a whole result, with its histograms and its flagged members."""

    def __init__(self, layout: ResultLayout, members: Selection) -> None:
        self.layout, self.members = layout, members
        self.counts, self.flagged = HistogramCounts(layout.recording.histograms), list[Arrays]()

    def saved(self, job: Any, status: NDArray[Any]) -> tuple[Arrays, Arrays, Arrays]:
        """Return the values of a block at all saves, its counts and its flagged values."""
        saves = self.layout.saves(job.out, job.width)
        parts = self.layout.split(saves[..., job.column : job.column + job.size])
        flagged = flagged_values(self.layout, job.members, parts, status[: job.size])
        return parts, self.counts.of(job, parts, status), flagged

    def take(self, gathered: Any) -> None:
        """Take the counts and the flagged values, the first two of what `gather` returns."""
        self.counts.add(gathered[0])
        self.flagged.append(gathered[1])

    def of_ensemble(self) -> Arrays:
        """Return {variable: array} of the variables without a member dimension."""
        return {**self.counts.variables(), **concat_flagged(self.flagged)}


_ARRAY, _COUNTS, _FLAGGED = "array ", "counts ", "flagged "  # prefixes of the names in a part


def _named(part: Mapping[str, NDArray[Any]], mark: str) -> Arrays:
    """Copy the arrays of a part with the prefix `mark`; return them by name without the prefix."""
    return {n.removeprefix(mark): a.copy() for n, a in part.items() if n.startswith(mark)}


class MemorySink(ResultSink):
    """A sink that collects blocks in one Dataset.

    If all saved values are kept, the kernel writes them directly to their place.
    """

    def __init__(
        self,
        layout: ResultLayout,
        members: Selection,
        more: Mapping[str, Any] = {},
        direct: bool = True,
        blank: "xr.Dataset | None" = None,
    ) -> None:
        """more : further attributes;  direct : whether blocks may write directly to the result
        blank : see `Blanks`
        """
        super().__init__(layout, members)
        self.more, self.blank, recording = more, blank, layout.recording
        all_kept = set(recording.retained.values()) <= {"full"}
        self.direct = direct and tuple(recording.recorded) == recording.names and all_kept
        self.width = whole_lanes(members.size)
        size = layout.numbers * self.width if self.direct else 0
        self.out = allocate_aligned(size, float, np.empty)
        sizes, saved = layout.axes.lengths(members.size), {} if self.direct else layout.at_saves
        self.arrays = {
            name: np.empty([sizes[dim] for dim in v.dims], v.dtype)
            for name, v in {**layout.by_member, **saved}.items()
            if name not in layout.constant
        }

    def reserve(self, low: int, count: int) -> Place:
        if self.direct:
            return self.out, self.width if self.layout.values else 0, low
        return super().reserve(low, count)

    def gather(self, job: Any, results: Arrays) -> tuple[Arrays, Arrays]:
        """Copy the values of a finished block to their places; return its counts and its flagged
        values."""
        layout, counts, flagged = self.layout, Arrays(), Arrays()
        low = job.first - self.members.first
        part = slice(low, low + job.size)
        if layout.values and (self.counts.histograms or not self.direct):
            parts, counts, flagged = self.saved(job, results["status"])
            if not self.direct:
                for name, kept in kept_values(layout, parts).items():
                    self.arrays[name][..., part] = kept
        for name in layout.by_member:
            if name not in self.arrays:  # all members share it: one column is enough
                column = results[name][..., :1]
                shape = (*column.shape[:-1], self.members.size)
                self.arrays[name] = np.broadcast_to(column.copy(), shape)
            elif name not in layout.constant:
                self.arrays[name][..., part] = results[name][..., : job.size]
        return counts, flagged

    def values(self) -> Arrays:
        """Return {variable: array} of the result."""
        arrays = {**self.arrays, **self.of_ensemble()}
        if self.direct:
            saves = self.layout.saves(self.out, self.width)
            arrays |= self.layout.split(saves[..., : self.members.size])
        return arrays

    def part(self) -> Arrays:
        """Return the existing part of an incomplete result, for `fill`."""
        counts, flagged = self.counts.counts, concat_flagged(self.flagged)
        return {
            **{f"{_ARRAY}{name}": self.arrays[name] for name in self._own()},
            **{f"{_COUNTS}{name}": values for name, values in counts.items()},
            **{f"{_FLAGGED}{name}": values for name, values in flagged.items()},
        }

    def fill(self, part: Mapping[str, NDArray[Any]]) -> bool:
        """Take the part of a result; False, without changes, if it belongs to another result."""
        mine = {f"{_ARRAY}{name}": self.arrays[name] for name in self._own()}
        there = {name: array for name, array in part.items() if name in mine}
        fits = there.keys() == mine.keys() and all(
            (array.shape, array.dtype) == (mine[name].shape, mine[name].dtype)
            for name, array in there.items()
        )
        if not fits:
            return False
        for name, array in there.items():
            mine[name][...] = array
        self.counts.counts = _named(part, _COUNTS)
        self.flagged = [flagged] if (flagged := _named(part, _FLAGGED)) else []
        return True

    def largest(self) -> int:
        """Return the maximum bytes of `part`, which has all saves of flagged members."""
        saves = max(self.layout.axes.times.size, self.layout.numbers) * self.members.size
        counts = sum(values.nbytes for values in self.counts.counts.values())
        return sum(self.arrays[name].nbytes for name in self._own()) + 16 * saves + counts + 2**20

    def _own(self) -> list[str]:
        """Return the names of arrays with a value for each member."""
        return [name for name in self.arrays if name not in self.layout.constant]

    def finish(self) -> "xr.Dataset":
        arrays, layout = self.values(), self.layout
        if self.blank is not None:
            dataset = self.blank.copy(data=arrays)
            dataset.attrs.update(self.more)
            return dataset
        return _make_dataset(layout, self.members, arrays, self.more)

    def discard(self) -> None:
        self.out = np.empty(0)


def _make_dataset(
    layout: ResultLayout, members: Selection, arrays: Arrays, more: Mapping[str, Any] = {}
) -> "xr.Dataset":
    """Return the Dataset of a layout with the arrays of its variables; more : further attributes.

    Variables and indexes are made here: from plain arrays, xarray would make the same ones after
    importing dask and pint, to see that the arrays are not theirs: 0.4 s of a process
    (`python -m bench startup`).
    """
    import pandas as pd
    import xarray as xr  # 0.3 s of a process, in which only results need it

    variables, indexes = dict[str, xr.Variable](), dict[str, xr.indexes.PandasIndex]()
    coordinates = layout.axes.coordinates(members.indices(members.first, members.size))
    for name, (dims, values, attrs) in coordinates.items():
        if dims != (name,):
            variables[name] = xr.Variable(dims, values, attrs, fastpath=True)
            continue
        index = xr.indexes.PandasIndex(pd.Index(values), name, coord_dtype=values.dtype)
        named = {name: xr.Variable(dims, values, attrs, fastpath=True)}
        variables.update(index.create_variables(named))
        indexes[name] = index
    return xr.Dataset(
        {
            name: xr.Variable(v.dims, arrays[name], v.attrs, fastpath=True)
            for name, v in layout.variables.items()
        },
        xr.Coordinates(variables, indexes),
        {**layout.attributes(), **more},
    )


class Blanks:
    """Results without values, for the runs of one PreparedRun. To make a Dataset with coordinates
    and the text of its scene takes 0.7 ms, to copy one 0.08 ms (python -m bench calls)."""

    def __init__(self) -> None:
        # a single attribute, so that several threads may use the same run
        self._last: tuple[object, xr.Dataset | None] = None, None

    def of(self, layout: ResultLayout, members: Selection) -> "xr.Dataset | None":
        """Return a result to copy, from the second consecutive request for some members on; else
        None. Also None if the number of flagged members is unknown, which makes copies
        impossible."""
        if layout.of_flagged or members.which is not None:
            return None
        key, (last, blank) = (members.first, members.size), self._last
        if key == last and blank is None:
            sizes, nothing = layout.axes.lengths(members.size), np.zeros(())
            blanks = {
                name: np.broadcast_to(nothing, [sizes[d] for d in v.dims])
                for name, v in layout.variables.items()
            }
            blank = _make_dataset(layout, members, blanks)
        blank = blank if key == last else None
        self._last = key, blank
        return blank


def make_buffer(layout: ResultLayout, count: int) -> Place:
    """Return a place for the saved values of a block of `count` members."""
    width = whole_lanes(count)
    values = allocate_aligned(layout.numbers * width, float, np.empty)
    return values, width if layout.values else 0, 0
