"""Running statistics over the steps of a member: smallest, largest, mean and variance of any observable of its state.

They use the start and the end of each step: an extreme in between is missed by up to x'' h^2/8, and a mean has the error of the
trapezoidal rule, of order h^2.
"""

from typing import Any, NamedTuple

import numpy as np

from rigidmc.dynamics.so3 import select
from rigidmc.observables.protocol import value

NOTHING = (0.0, 0.0, 0.0, 0.0)


def seen(of, body, effects, t, q, l):
    """The values of an observable that asks for neither start nor works."""
    return value(of, body, effects, t, q, l, NOTHING, ())


def smaller(a, b):
    """The smaller of each two numbers."""
    if len(a) == 0:
        return ()
    return (select(b[0] < a[0], b[0], a[0]),) + smaller(a[1:], b[1:])


def larger(a, b):
    """The larger of each two numbers."""
    if len(a) == 0:
        return ()
    return (select(b[0] > a[0], b[0], a[0]),) + larger(a[1:], b[1:])


def summed(sums, values, shifts):
    """Sums of numbers less their shifts."""
    if len(sums) == 0:
        return ()
    return (sums[0] + (values[0] - shifts[0]),) + summed(sums[1:], values[1:], shifts[1:])


def squared(sums, values, shifts):
    """Sums of squares of numbers less their shifts."""
    if len(sums) == 0:
        return ()
    off = values[0] - shifts[0]
    return (sums[0] + off * off,) + squared(sums[1:], values[1:], shifts[1:])


def zeros(values):
    """As many zeros."""
    if len(values) == 0:
        return ()
    return (0.0 * values[0],) + zeros(values[1:])


def head(like, a):
    """The first len(like) of a tuple."""
    if len(like) == 0:
        return ()
    return (a[0],) + head(like[1:], a[1:])


def rest(like, a):
    """A tuple without its first len(like)."""
    if len(like) == 0:
        return a
    return rest(like[1:], a[1:])


class Minimum(NamedTuple):
    """The smallest of the values at the start and after every step."""

    of: Any
    word, kept = "smallest", 1

    def begin(self, body, effects, t, q, l):
        return seen(self.of, body, effects, t, q, l)

    def update(self, kept, body, effects, t, q, l):
        return smaller(kept, seen(self.of, body, effects, t, q, l))

    def result(self, kept, steps):
        return kept[0]


class Maximum(NamedTuple):
    """The largest of the values at the start and after every step."""

    of: Any
    word, kept = "largest", 1

    def begin(self, body, effects, t, q, l):
        return seen(self.of, body, effects, t, q, l)

    def update(self, kept, body, effects, t, q, l):
        return larger(kept, seen(self.of, body, effects, t, q, l))

    def result(self, kept, steps):
        return kept[0]


class Mean(NamedTuple):
    """The mean over time by the trapezoidal rule on the steps; what is kept: first value, sum of differences from it, last value."""

    of: Any
    word, kept = "mean over time of", 3

    def begin(self, body, effects, t, q, l):
        values = seen(self.of, body, effects, t, q, l)
        return values + zeros(values) + values

    def update(self, kept, body, effects, t, q, l):
        values = seen(self.of, body, effects, t, q, l)
        shifts = head(values, kept)
        return shifts + summed(head(values, rest(values, kept)), values, shifts) + values

    def result(self, kept, steps):
        first, total, last = kept
        return first + (total - 0.5 * (last - first)) / steps


class Variance(NamedTuple):
    """The variance over time by the trapezoidal rule on the steps; what is kept: first value, sums of differences and squares, last value."""

    of: Any
    word, kept = "variance over time of", 4

    def begin(self, body, effects, t, q, l):
        values = seen(self.of, body, effects, t, q, l)
        return values + zeros(values) + zeros(values) + values

    def update(self, kept, body, effects, t, q, l):
        values = seen(self.of, body, effects, t, q, l)
        shifts, sums = head(values, kept), rest(values, kept)
        return (
            shifts
            + summed(head(values, sums), values, shifts)
            + squared(head(values, rest(values, sums)), values, shifts)
            + values
        )

    def result(self, kept, steps):
        first, total, squares, last = kept
        end = last - first
        mean = (total - 0.5 * end) / steps
        return np.maximum((squares - 0.5 * end * end) / steps - mean * mean, 0.0)


STATISTICS: dict[str, Any] = {"min": Minimum, "max": Maximum, "mean": Mean, "variance": Variance}
