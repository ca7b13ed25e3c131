"""Mean and variance of the numbers of members, to the same bits for all blocks and threads.

Rounding makes a sum depend on its order, so the order is fixed. Each GROUP of consecutive members
has its own mean and sum of squares; the thread that moved a block takes them, because a block is
made of whole groups. `OrderedSums` joins the groups of blocks, in the order of members and BATCH
at a time, whatever the order in which blocks end.

Source: Chan, Golub & LeVeque, Am. Stat. 37 (1983) 242.
"""

from typing import Any, NamedTuple

import numpy as np

from rigidmc.engine.kernel.layout import LANES
from rigidmc.inputs.arrays import Array, Bools

GROUP = LANES  # members; every block is a multiple of it
BATCH = 2**13  # groups that are joined at once


class Moments(NamedTuple):
    """How many numbers there are, their mean, and the sum of squares about it: of one group, or of
    several (groups,). Without numbers all three are 0."""

    count: Any = 0.0
    mean: Any = 0.0
    squares: Any = 0.0

    def joined(self) -> "Moments":
        """Return the moments of all groups together."""
        count = float(np.sum(self.count))
        if not count:
            return Moments()
        mean = float(np.sum(self.count * self.mean)) / count
        apart = self.mean - mean
        squares = float(np.sum(self.squares + self.count * apart * apart))
        return Moments(count, mean, squares)


def moments_of_groups(x: Array, there: Bools) -> Array:
    """Return the Moments (3, groups) of each group of numbers (n,), of which only those that are
    `there` count; the last group may be short."""
    starts = np.arange(0, x.size, GROUP)
    moments = np.empty((3, starts.size))
    count, mean, squares = moments
    if everywhere := bool(there.all()):
        count[:], count[-1:] = GROUP, x.size - starts[-1:]
    else:
        x = np.where(there, x, 0.0)
        np.add.reduceat(there, starts, dtype=float, out=count)
    np.add.reduceat(x, starts, out=mean)
    mean /= np.maximum(count, 1.0)
    # about the mean: squares of values of 1e8 that differ by 1 would have no digit of the variance
    apart = x - np.repeat(mean, GROUP)[: x.size]
    np.multiply(apart, apart, out=apart)
    if not everywhere:
        apart[~there] = 0.0
    np.add.reduceat(apart, starts, out=squares)
    return moments


class OrderedSums:
    """The Moments of several rows of numbers, from blocks in any order.

    rows : number of rows
    """

    def __init__(self, rows: int) -> None:
        self._waiting: dict[int, list[Array]] = {}  # blocks after one that is not there yet
        self._next = 0
        self._pieces: list[list[Array]] = [[] for _ in range(rows)]  # not in the totals yet
        self._groups = 0  # of the pieces of a row
        self._totals = [Moments() for _ in range(rows)]

    def add(self, group: int, sums: list[Array]) -> None:
        """Add the Moments (3, groups) of a block, for each row.

        group : number of the first group of the block
        """
        if not self._totals:
            return
        self._waiting[group] = sums
        while (ready := self._waiting.pop(self._next, None)) is not None:
            for pieces, piece in zip(self._pieces, ready, strict=True):
                pieces.append(piece)
            self._next += ready[0].shape[1]
            self._groups += ready[0].shape[1]
        if self._groups >= BATCH:
            self._join(self._groups // BATCH * BATCH)

    def _join(self, groups: int) -> None:
        """Move the first groups of each row to the totals."""
        for i, pieces in enumerate(self._pieces):
            table = np.concatenate(pieces, axis=1)
            for low in range(0, groups, BATCH):
                batch = Moments(*table[:, low : min(low + BATCH, groups)]).joined()
                both = np.array([self._totals[i], batch]).T
                self._totals[i] = Moments(*both).joined()
            self._pieces[i] = [table[:, groups:]]
        self._groups -= groups

    def totals(self) -> list[Moments]:
        """Return the Moments of each row, after the last block."""
        assert not self._waiting
        if self._groups:
            self._join(self._groups)
        return self._totals
