"""Means and exact quantiles of the members of a result, block by block, in bounded memory.

A quantile of n numbers has one rank or two, as in `rigidmc.statistics.intervals.quantile`. One pass
over the members counts the numbers below a bracket and keeps those inside; the bracket comes from a
sample of 2^19 members and holds both ranks with near certainty. If it does not, or if too many
numbers are inside, the counts give a better bracket and another pass follows, so that the quantile
is exact in any case.

The means are sums of the sums of blocks: their last digits differ from numpy.mean.

Source: Munro & Paterson, Theor. Comput. Sci. 12 (1980) 315; Floyd & Rivest, Commun. ACM 18 (1975)
165; sums of squares: Chan, Golub & LeVeque, Am. Stat. 37 (1983) 242.
"""

import math
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from rigidmc.inputs.arrays import Array, Ints
from rigidmc.processes.threads import Task, drop, threads_of
from rigidmc.statistics import intervals

BLOCK = 2**19  # members of a block, unless dask has its own
PIECE = 2**18  # numbers searched at once: each call must outlast a switch between threads
SAMPLE = 2**15, 16  # members of each piece of the sample, and number of pieces
KEPT = 2**20  # numbers kept of a bracket; a sample of all is kept of more
SURE = 4.5  # half the width of a bracket, in standard deviations of the rank


class Row(NamedTuple):
    """One number per member: a variable, or component `component` of one, from 0."""

    name: str
    component: int | None = None


class Spread(NamedTuple):
    """How a number is distributed over the good members.

    members : good members;  unknown : of these, those whose number is nan
    finite : how many numbers are finite;  first, low, high : first, smallest, and largest of them
    mean, variance : of the finite numbers;  quantiles : as asked, nan without numbers
    """

    members: int
    unknown: int
    finite: int
    first: float
    low: float
    high: float
    mean: float
    variance: float
    quantiles: tuple[float, ...]

    @property
    def is_constant(self) -> bool:
        """Whether all numbers are the same to rounding."""
        return bool(intervals.is_constant([self.low, self.high]))


def spreads(
    dataset: xr.Dataset,
    rows: Sequence[Row],
    quantiles: Sequence[float],
    codes: Sequence[str] = ("status",),
) -> tuple[dict[str, Ints], list[Spread]]:
    """Return ({name: members with each code} of variables, Spread of each row).

    quantiles : numbers between 0 and 1
    codes : names of variables of small counts; all members are counted
    """
    size = dataset.sizes["member"]
    states = [_State(row, [_Bracket(q) for q in quantiles]) for row in rows]
    counted = {name: np.zeros(256, np.int64) for name in codes}
    if size > KEPT:
        each, count = SAMPLE
        steps = np.linspace(0, size - each, count).astype(int)
        pieces = [_block(dataset, rows, slice(at, at + each))[0] for at in steps]
        for i, state in enumerate(states):
            state.begin(np.sort(np.concatenate([_finite(piece[i]) for piece in pieces])))
    left, first = states, True
    while left or first:
        asked = [state.row for state in left]
        for numbers, part in _passed(dataset, asked, codes if first else ()):
            for name, members in zip(codes, part, strict=False):
                counted[name] += members
            for state, x in zip(left, numbers, strict=True):
                state.take(x, first)
        left, first = [state for state in left if not state.is_known()], False
    return counted, [state.spread() for state in states]


def _block(
    dataset: xr.Dataset, rows: Sequence[Row], part: slice, codes: Sequence[str] = ()
) -> tuple[list[Array], list[Ints]]:
    """Return (numbers of the good members for each row, members with each code) of a block."""
    names = dict.fromkeys(("status", *codes, *(row.name for row in rows)))
    block = dataset[list(names)].isel(member=part)
    if dataset.chunks:  # other threads read other blocks
        block = block.compute(scheduler="synchronous")
    values = {name: block[name].values for name in names}
    good = values["status"] == 0
    some: Any = slice(None) if good.all() else good
    numbers = [values[row.name][... if row.component is None else row.component] for row in rows]
    # as bytes: a file of others may have any numbers
    counts = [np.bincount(values[name].astype("u1"), minlength=256) for name in codes]
    return [np.asarray(x[some], float) for x in numbers], counts


def _finite(numbers: Array) -> Array:
    there = np.isfinite(numbers)
    return numbers if there.all() else numbers[there]


def _passed(
    dataset: xr.Dataset, rows: Sequence[Row], codes: Sequence[str]
) -> Iterator[tuple[list[Array], list[Ints]]]:
    """Yield the numbers and counts of all blocks in order. A thread reads the next block meanwhile;
    more threads would wait for each other in the many short reads of shards."""
    blocks, tasks = _blocks(dataset), list[Task]()
    if len(blocks) == 1:
        yield _block(dataset, rows, blocks[0], codes)
        return
    try:
        for part in blocks:
            tasks.append(Task(_block, dataset, rows, part, codes))
            threads_of("spread", 1).begin(tasks[-1])
            if len(tasks) > 1:
                yield tasks.pop(0).wait()
        yield tasks.pop().wait()
    finally:
        drop(tasks)


def _blocks(dataset: xr.Dataset) -> list[slice]:
    """Return the members of each block."""
    size = dataset.sizes["member"]
    sizes = dataset.chunks.get("member") or [BLOCK] * (size // BLOCK) + [size % BLOCK]
    ends = np.cumsum(sizes).tolist()
    return [slice(end - n, end) for n, end in zip(sizes, ends, strict=True) if n]


class _Found(NamedTuple):
    """Of a piece: numbers below a bracket, at its ends, and those inside."""

    below: int
    at_low: int
    at_high: int
    inside: Array


class _Part(NamedTuple):
    """Of a piece of a block: good members, nan numbers, finite numbers, the first of them, range,
    sum, sum of squares about their mean, and what is found in each bracket."""

    members: int
    unknown: int
    finite: int
    first: float
    low: float
    high: float
    total: float
    squares: float
    found: list[_Found]


def _search(numbers: Array, brackets: list[tuple[float, float]], first: bool) -> _Part:
    """Return the part of a piece; without sums and range after the first pass."""
    x = _finite(numbers)
    ranks = [_find(x, low, high) for low, high in brackets]
    if not first or not x.size:
        unknown = int(np.isnan(numbers).sum()) if first else 0
        members = numbers.size if first else 0
        return _Part(members, unknown, 0, np.nan, np.inf, -np.inf, 0.0, 0.0, ranks)
    unknown = int(np.isnan(numbers).sum()) if x.size < numbers.size else 0
    low, high = float(x.min()), float(x.max())
    with np.errstate(over="ignore", invalid="ignore"):
        total = float(x.sum())
        # about the mean of the piece: squares of 1e8 +- 1 would have no digit of the variance left
        apart = x - total / x.size
        squares = float(np.square(apart, apart).sum())
    return _Part(numbers.size, unknown, x.size, float(x[0]), low, high, total, squares, ranks)


def _find(x: Array, low: float, high: float) -> _Found:
    """Return what is found in a bracket."""
    not_below, not_above = x >= low, x <= high
    above_low, below_high = x > low, x < high
    begin, end = int(np.count_nonzero(not_below)), int(np.count_nonzero(not_above))
    at_low = begin - int(np.count_nonzero(above_low))
    at_high = end - int(np.count_nonzero(below_high))
    return _Found(x.size - begin, at_low, at_high, x[above_low & below_high])


class _Bracket:
    """The search for a quantile: a range, and the numbers in it."""

    def __init__(self, q: float) -> None:
        self.q, self.low, self.high = q, -np.inf, np.inf
        self._misses, self.value = 0, np.nan
        self.clear()

    def clear(self) -> None:
        """Forget the numbers of the last pass."""
        self._below = self._at_low = self._at_high = self._inside = self._held = 0
        self._stride, self._kept = 1, list[Array]()

    def begin(self, numbers: Array, fraction: float) -> None:
        """Set the range from a sorted sample, in which `fraction` of the numbers is smaller."""
        if not numbers.size:
            return
        middle = fraction * (numbers.size - 1)
        wide = math.sqrt(numbers.size * fraction * (1.0 - fraction))
        wide = SURE * 2.0**self._misses * wide + 2.0
        low, high = math.floor(middle - wide), math.ceil(middle + wide)
        if low >= 0:
            self.low = float(numbers[low])
        if high < numbers.size:
            self.high = float(numbers[high])

    def take(self, part: _Found) -> None:
        """Add what is found in a piece."""
        self._below += part.below
        self._at_low += part.at_low
        self._at_high += part.at_high
        self._inside += part.inside.size
        kept = part.inside[:: self._stride]
        self._kept.append(kept)
        self._held += kept.size
        while self._held > KEPT:
            self._stride *= 2
            self._kept = [np.concatenate(self._kept)[::2]]
            self._held = self._kept[0].size

    def is_known(self, count: int) -> bool:
        """Find the quantile of `count` numbers; if that is impossible, choose a better range."""
        k, last = intervals.ranks_of_quantile(self.q, count)
        begin = self._below + self._at_low
        end = begin + self._inside
        inside = np.sort(np.concatenate(self._kept))
        if self._below <= k and last < end + self._at_high:
            if self._stride == 1 or last < begin or k >= end:
                ends = [
                    self.low if i < begin else self.high if i >= end else inside[i - begin]
                    for i in (k, last)
                ]
                self.value = intervals.middle(*map(float, ends))
                return True
            self.begin(inside, min(max((k - begin) / self._inside, 0.0), 1.0))
            self.clear()
            return False
        self._misses += 1
        if last < self._below:
            self.low, self.high = -np.inf, self.low
        elif k >= end + self._at_high:
            self.low, self.high = self.high, np.inf
        else:  # an end is between the two ranks
            self.low, self.high = -np.inf, np.inf
        self.clear()
        return False


class _State:
    """The sums of one row, and the searches for its quantiles."""

    def __init__(self, row: Row, brackets: list[_Bracket]) -> None:
        self.row, self._brackets, self._left = row, brackets, brackets
        self._members = self._unknown = self._count = 0
        self._first, self._low, self._high = math.nan, math.inf, -math.inf
        self._mean = self._squares = 0.0

    def begin(self, numbers: Array) -> None:
        """Set the brackets from a sorted sample."""
        for bracket in self._brackets:
            bracket.begin(numbers, bracket.q)

    def take(self, numbers: Array, first: bool) -> None:
        """Add the numbers of a block; first : whether this is the first pass."""
        brackets = [(bracket.low, bracket.high) for bracket in self._left]
        for i in range(0, numbers.size, PIECE):
            self._add(_search(numbers[i : i + PIECE], brackets, first))

    def _add(self, part: _Part) -> None:
        """Add the part of a piece."""
        for bracket, ranks in zip(self._left, part.found, strict=True):
            bracket.take(ranks)
        self._members += part.members
        self._unknown += part.unknown
        if not part.finite:
            return
        if not self._count:
            self._first = part.first
        self._low, self._high = min(self._low, part.low), max(self._high, part.high)
        both = self._count + part.finite
        apart = part.total / part.finite - self._mean
        self._mean += apart * part.finite / both
        self._squares += part.squares + apart * apart * self._count * part.finite / both
        self._count = both

    def is_known(self) -> bool:
        """Whether all quantiles are known."""
        if not self._count:
            return True
        self._left = [bracket for bracket in self._left if not bracket.is_known(self._count)]
        return not self._left

    def spread(self) -> Spread:
        """Return the result."""
        count = self._count
        variance = self._squares / (count - 1) if count > 1 else math.nan
        mean = self._mean if count else math.nan
        return Spread(
            self._members,
            self._unknown,
            count,
            self._first,
            self._low,
            self._high,
            mean,
            variance,
            tuple(bracket.value for bracket in self._brackets),
        )
