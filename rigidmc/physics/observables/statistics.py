"""Running statistics over the steps of a member: minimum, maximum, mean, variance, last value.

Extremes include the motion within steps: for 400 heavy tops in steps of 1.6 rad the worst nutation
is 2.6e-4 rad off (tests/physics/observables/test_monitoring.py). Means have the error of the
trapezoidal rule on two or more states per step. Conserved quantities, such as the energy of a heavy
top, are evaluated at the ends of steps.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from rigidmc.physics.dynamics.methods import OFF, ON, implements
from rigidmc.physics.dynamics.so3 import select
from rigidmc.physics.observables.compiled import is_conserved, monotone, observed
from rigidmc.physics.observables.protocol import Array, Kind, running, size

_NO_START = (0.0, 0.0, 0.0, 0.0)


def observe(of, body, effects, t, q, l):
    """Return the values of an observable that uses neither start nor works."""
    return observed(of, body, effects, t, q, l, _NO_START, ())


def smaller(a, b):
    """Return the smaller number of each pair."""
    if len(a) == 0:
        return ()
    return (select(b[0] < a[0], b[0], a[0]),) + smaller(a[1:], b[1:])


def larger(a, b):
    """Return the larger number of each pair."""
    if len(a) == 0:
        return ()
    return (select(b[0] > a[0], b[0], a[0]),) + larger(a[1:], b[1:])


def below(state):
    """Return (x, inf) for each number: only smaller values are of interest."""
    if len(state) == 0:
        return ()
    return ((state[0], math.inf),) + below(state[1:])


def above(state):
    """Return (-inf, x) for each number: only larger values are of interest."""
    if len(state) == 0:
        return ()
    return ((-math.inf, state[0]),) + above(state[1:])


def extremal_numbers(of, values):
    """Return numbers with the extremes of an observable; () if it is conserved."""
    if len(is_conserved(of)) > 0:
        return ()
    return monotone(of, values)


def add_differences(sums, values, shifts):
    """Add values less their shifts to sums."""
    if len(sums) == 0:
        return ()
    # Differences from the first value: a small variance would lose its digits in plain sums.
    return (sums[0] + (values[0] - shifts[0]),) + add_differences(sums[1:], values[1:], shifts[1:])


def add_squares(sums, values, shifts):
    """Add the squares of values less their shifts to sums."""
    if len(sums) == 0:
        return ()
    off = values[0] - shifts[0]
    return (sums[0] + off * off,) + add_squares(sums[1:], values[1:], shifts[1:])


def offsets(values, shifts):
    """Return the values less their shifts."""
    if len(values) == 0:
        return ()
    return (values[0] - shifts[0],) + offsets(values[1:], shifts[1:])


def weigh_sums(sums, ends, longer):
    """Multiply sums over steps by `longer`, by the trapezoidal rule.

    ends : the last values; half of each belongs to the next interval
    """
    if len(sums) == 0:
        return ()
    # Half of the last value belongs to the next interval, whose steps have their own length.
    first = sums[0] + (longer - 1.0) * (sums[0] - 0.5 * ends[0])
    return (first,) + weigh_sums(sums[1:], ends[1:], longer)


def zeros(values):
    """Return one zero per value."""
    if len(values) == 0:
        return ()
    # a 0 of the type of the value, which may be a vector or have tangents
    return (0.0 * values[0],) + zeros(values[1:])


def head(like, a):
    """Return the first len(like) numbers of a tuple."""
    if len(like) == 0:
        return ()
    return (a[0],) + head(like[1:], a[1:])


def take_each(step, a):
    """Return every len(step)-th number of a tuple, beginning with the first."""
    if len(a) == 0:
        return ()
    return (a[0],) + take_each(step, rest(step, a))


def rest(like, a):
    """Return a tuple without its first len(like) numbers."""
    if len(like) == 0:
        return a
    return rest(like[1:], a[1:])


# A smallest value lies at the end of a run if the value there is as small within this part of its
# change in the last step: the states of steps and of saves differ by rounding.
_NEAR = 1e-3


def lowered(state: Array, now: Array, rates: Array, step: Array) -> Array:
    """Return the derivatives of smallest values so far by the end of the run: the rate of a value
    that is the smallest now, and falls; else 0.

    now, rates : the values at the end, and their rates;  step : length of the last step [s]
    """
    at_end = now - state <= _NEAR * step * np.abs(rates)
    return np.where(at_end & (rates < 0.0), rates, 0.0)


def summed(total: Array, last: Array, rate: Array, time: float, steps: Array) -> Array:
    """Return the derivative of a sum over steps by the end of the run, for the same number of
    steps: the mean by the trapezoidal rule, m, changes by (last - m)/time.

    last, rate : the last term, and its rate;  time : of all steps [s]
    """
    return 0.5 * rate + (steps * last - (total - 0.5 * last)) / time


def by_rows(of: Any, rows: int, state: Array) -> Array:
    """Reshape a block (rows * values, n) to (rows, values, n); leave it if `of` is a scalar."""
    return state.reshape(rows, -1, state.shape[1]) if of.dims else state


def counts_steps(one: Any) -> bool:
    """Return whether a running observable treats all steps as equally long.

    Its results then depend on the number of steps, and it has no `reweighed`.
    """
    if implements(one, "reweighed"):
        return False
    # A result that depends on the number of steps differs between 3 and 5 of them.
    few, many = (one.results(np.ones((one.state_size, 1)), np.array([n])) for n in (3.0, 5.0))
    return any(not np.array_equal(few[name], many[name], equal_nan=True) for name in few)


def _statistic(
    word: str, numbers: int, squares: bool = False, **shared: Callable[..., Any]
) -> Callable[[Kind], Kind]:
    """Return the decorator of a running statistic of an observable, its field `of`.

    word : it is this word of the observable;  squares : whether it has the units squared
    numbers : of its running state, per value;  shared : methods that other statistics have, too
    """

    def complete(cls: Kind) -> Kind:
        methods = {**shared, "state_size": property(lambda self: numbers * size(self.of.dims))}
        for name, each in methods.items():
            setattr(cls, name, each)
        return running(word=word, squares=squares)(cls)

    return complete


def _observed_values(self, body, effects, t, q, l):
    return observe(self.of, body, effects, t, q, l)


def _extrema_of_values(self, body, effects, t, q, l):
    return extremal_numbers(self.of, observe(self.of, body, effects, t, q, l))


def _averages_unless_conserved(self):
    if len(is_conserved(self.of)) > 0:
        return OFF
    return ON


@_statistic("smallest", 1, begin=_observed_values, extrema=_extrema_of_values)
class Minimum(NamedTuple):
    """The smallest of the values: at the start, after each step and within steps."""

    of: Any

    def update(self, state, body, effects, t, q, l):
        return smaller(state, observe(self.of, body, effects, t, q, l))

    def extremum_limits(self, state):
        return below(extremal_numbers(self.of, state))

    def merged(self, state, inserted):
        return smaller(state, inserted)

    def lengthened(
        self, state: Array, now: Array, rates: Array, time: float, steps: Array
    ) -> Array:
        return lowered(state, now, rates, time / steps)

    def results(self, state: Array, steps: Array) -> dict[str, Array]:
        """Return the smallest values."""
        return {"min": by_rows(self.of, 1, state)[0]}


@_statistic("largest", 1, begin=_observed_values, extrema=_extrema_of_values)
class Maximum(NamedTuple):
    """The largest of the values: at the start, after each step and within steps."""

    of: Any

    def update(self, state, body, effects, t, q, l):
        return larger(state, observe(self.of, body, effects, t, q, l))

    def extremum_limits(self, state):
        return above(extremal_numbers(self.of, state))

    def merged(self, state, inserted):
        return larger(state, inserted)

    def lengthened(
        self, state: Array, now: Array, rates: Array, time: float, steps: Array
    ) -> Array:
        return -lowered(-state, -now, -rates, time / steps)

    def results(self, state: Array, steps: Array) -> dict[str, Array]:
        """Return the largest values."""
        return {"max": by_rows(self.of, 1, state)[0]}


def _lengthened_sums(
    self: Any, state: Array, now: Array, rates: Array, time: float, steps: Array
) -> Array:
    """Return the derivatives of the first values, the sums, and the last values."""
    numbers = self.state_size // size(self.of.dims)
    (first, *sums, last), rate = np.split(state, numbers), np.split(rates, numbers)[-1]
    end = last - first
    terms = (end, rate), (end * end, 2.0 * end * rate)
    of_sums = [summed(x, *term, time, steps) for x, term in zip(sums, terms, strict=False)]
    return np.concatenate([0.0 * rate, *of_sums, rate])


_OF_SUMS: dict[str, Any] = {
    "is_time_average": _averages_unless_conserved,
    "lengthened": _lengthened_sums,
}


@_statistic("mean over time of", 3, **_OF_SUMS)
class Mean(NamedTuple):
    """The mean over time by the trapezoidal rule.

    The running state is the first value, the sum of differences from it, and the last value.
    """

    of: Any

    def begin(self, body, effects, t, q, l):
        values = observe(self.of, body, effects, t, q, l)
        return values + zeros(values) + values

    def update(self, state, body, effects, t, q, l):
        values = observe(self.of, body, effects, t, q, l)
        shifts = head(values, state)
        return shifts + add_differences(head(values, rest(values, state)), values, shifts) + values

    def reweighed(self, state, longer):
        shifts = head(take_each((0, 0, 0), state), state)
        sums = rest(shifts, state)
        last = rest(shifts, sums)
        return shifts + weigh_sums(head(shifts, sums), offsets(last, shifts), longer) + last

    def results(self, state: Array, steps: Array) -> dict[str, Array]:
        """Return the mean; without steps, the first value."""
        first, total, last = by_rows(self.of, 3, state)
        with np.errstate(all="ignore"):
            return {"mean": first + (total - 0.5 * (last - first)) / np.maximum(steps, 1.0)}


@_statistic("variance over time of", 4, squares=True, **_OF_SUMS)
class Variance(NamedTuple):
    """The variance over time by the trapezoidal rule.

    The running state is the first value, the sums of differences from it and of their squares, and
    the last value.
    """

    of: Any

    def begin(self, body, effects, t, q, l):
        values = observe(self.of, body, effects, t, q, l)
        return values + zeros(values) + zeros(values) + values

    def update(self, state, body, effects, t, q, l):
        values = observe(self.of, body, effects, t, q, l)
        shifts, sums = head(values, state), rest(values, state)
        squares = add_squares(head(values, rest(values, sums)), values, shifts)
        return shifts + add_differences(head(values, sums), values, shifts) + squares + values

    def reweighed(self, state, longer):
        shifts = head(take_each((0, 0, 0, 0), state), state)
        sums = rest(shifts, state)
        squares = rest(shifts, sums)
        last = rest(shifts, squares)
        end = offsets(last, shifts)
        ends = add_squares(zeros(end), last, shifts)
        sums = weigh_sums(head(shifts, sums), end, longer)
        return shifts + sums + weigh_sums(head(shifts, squares), ends, longer) + last

    def results(self, state: Array, steps: Array) -> dict[str, Array]:
        """Return the variance; without steps, 0."""
        first, total, squares, last = by_rows(self.of, 4, state)
        with np.errstate(all="ignore"):
            steps = np.maximum(steps, 1.0)
            end = last - first
            mean = (total - 0.5 * end) / steps
            variance = np.maximum((squares - 0.5 * end * end) / steps - mean * mean, 0.0)
        return {"variance": variance}


@_statistic("last", 1, begin=_observed_values, update=_observed_values)
class Last(NamedTuple):
    """The values after the last step."""

    of: Any

    def lengthened(
        self, state: Array, now: Array, rates: Array, time: float, steps: Array
    ) -> Array:
        return rates

    def results(self, state: Array, steps: Array) -> dict[str, Array]:
        """Return the last values."""
        return {"last": by_rows(self.of, 1, state)[0]}


STATISTICS: dict[str, Any] = {
    "min": Minimum,
    "max": Maximum,
    "mean": Mean,
    "variance": Variance,
    "last": Last,
}
