"""Confidence intervals of an ensemble's probabilities, means and quantiles.

scipy.stats computes most of them one at a time: `binomtest` takes 0.6 ms for each pixel of a map
(`python -m timeit -s "from scipy.stats import binomtest" "binomtest(3, 16).proportion_ci()"`).
Here, all of 256 x 256 pixels take a hundredth of a second. Ends of quantiles agree with scipy to
the bit, means to 1e-13, probabilities to 5e-13, the accuracy of scipy's root finding
(tests/statistics/test_intervals.py).

This module also decides which numbers differ by rounding alone, with one rule for all studies that
compare members. Floating-point numbers have a resolution of eps, the distance from 1 to the next
larger number, times their size; a sum over many steps loses a few eps times the square root of the
number of steps.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray
from scipy import special

from rigidmc.errors import OptionError, unknown
from rigidmc.inputs.arrays import Array, Bools
from rigidmc.scene.settings import Run

METHODS = ("wilson", "clopper-pearson")
WHOLE = 1e-12  # relative rounding up to which n q counts as an integer


class Interval(NamedTuple):
    """An estimate and the ends of its confidence interval: numbers, or arrays of one shape."""

    value: Any
    low: Any
    high: Any

    @property
    def half(self) -> Any:
        """Half of the width."""
        return 0.5 * (self.high - self.low)


class Estimate(Interval):
    """An Interval of a measure, with the fraction of members without a value.

    without : fraction of the selected members that have no value, or whose event has not occurred
        by the end
    until : the end until which members were followed, if the measure is the time of an event that
        has not occurred in all members; else nan
    """

    without: Any
    until: Any

    def __new__(
        cls, value: Any, low: Any, high: Any, without: Any = 0.0, until: Any = np.nan
    ) -> "Estimate":
        """Make a tuple of the first three; `without` and `until` are attributes."""
        made = super().__new__(cls, value, low, high)
        made.without, made.until = without, until
        return made

    def each(self, function: Callable[[Any], Any]) -> "Estimate":
        """Apply a function to each number of the Estimate."""
        return Estimate(*map(function, (*self, self.without, self.until)))

    def words(self, confidence: float = 0.95) -> str:
        """Write the numbers as text, and the fraction of members without a value."""
        value, low, high = map(self._number, self)
        if self.value != self.value:
            few = "no member has a value" if self.without == 1.0 else "unknown"
            return "no member is selected" if self.without != self.without else few
        ends = f", {100 * confidence:g} % between {low} and {high}" if self.low == self.low else ""
        if np.isposinf(self.value) and ends:
            ends = f", {100 * confidence:g} % above {low}"
        return value + ends + self.lacking()

    def lacking(self) -> str:
        """Write the fraction of members without a value as text; "" if all have one."""
        if not self.without > 0.0:
            return ""
        share = f"{100.0 * self.without:.3g} %"
        if self.until == self.until:
            return f"; no event by {self.until:.6g} s in {share} of the members"
        return f"; {share} of the members have no value"

    def _number(self, x: float) -> str:
        beyond = np.isposinf(x) and self.until == self.until
        return f"beyond {self.until:.6g}" if beyond else f"{x:.6g}"

    def __repr__(self) -> str:
        return f"{super().__repr__()[:-1]}, without={self.without!r}, until={self.until!r})"


def probability(
    successes: ArrayLike, trials: ArrayLike, confidence: float = 0.95, method: str = "wilson"
) -> Interval:
    """Estimate the probability of an event that occurs in `successes` of `trials` independent
    members.

    wilson : (p + z^2/2n +- z sqrt(p (1 - p)/n + z^2/4n^2)) / (1 + z^2/n); its coverage averaged
        over p is the confidence level
    clopper-pearson : from the beta distribution; its coverage is never lower than the confidence
        level; up to twice as wide for few trials

    successes, trials : counts that broadcast; without trials the interval is nan
    Raises OptionError for impossible counts.
    Source: Wilson, J. Am. Stat. Assoc. 22 (1927) 209; Clopper & Pearson, Biometrika 26 (1934) 404;
    Brown, Cai & DasGupta, Stat. Sci. 16 (2001) 101.
    """
    if method not in METHODS:
        raise unknown("interval", METHODS, at="method", value=method, error=OptionError)
    k, n = np.broadcast_arrays(np.asarray(successes, float), np.asarray(trials, float))
    bad = (k < 0) | (k > n)
    if np.any(bad):
        rule = "expected counts between 0 and the number of trials"
        raise OptionError(rule, at="successes", value=float(k[bad].flat[0]))
    _check(confidence)
    with np.errstate(all="ignore"):
        p, tail = k / n, 0.5 * (1.0 - confidence)
        if method == "wilson":
            z = special.ndtri(1.0 - tail)
            centre = p + 0.5 * z * z / n
            half = z * np.sqrt(p * (1.0 - p) / n + 0.25 * (z / n) ** 2)
            scale = 1.0 + z * z / n
            low, high = (centre - half) / scale, (centre + half) / scale
        else:
            low = special.betaincinv(k, n - k + 1.0, tail)
            high = special.betaincinv(k + 1.0, n - k, 1.0 - tail)
        # beyond 1e13 trials, betaincinv errs by more than a narrow interval is wide
        low = np.where(k == 0, 0.0, np.minimum(low, p))
        high = np.where(k == n, 1.0, np.maximum(high, p))
    none = n == 0
    return Interval(*(np.where(none, np.nan, x) for x in (p, low, high)))


def mean(values: ArrayLike, axis: int = -1, confidence: float = 0.95) -> Interval:
    """Estimate the mean of independent values along an axis by Student's t, ignoring non-finite
    values."""
    _check(confidence)
    x = np.asarray(values, float)
    x = np.where(np.isfinite(x), x, np.nan)
    n = np.isfinite(x).sum(axis)
    with np.errstate(all="ignore"):
        value = np.where(n > 0, np.nansum(x, axis) / n, np.nan)
        variance = np.nansum((x - np.expand_dims(value, axis)) ** 2, axis) / (n - 1.0)
        half = half_of_mean(variance, n, confidence)
    return Interval(value, value - half, value + half)


def half_of_mean(variance: ArrayLike, count: ArrayLike, confidence: float = 0.95) -> Any:
    """Return half the width of Student's interval for the mean of `count` independent values with
    this sample variance; nan for fewer than two."""
    n = np.asarray(count)
    with np.errstate(all="ignore"):
        t = special.stdtrit(np.maximum(n - 1, 1), 0.5 + 0.5 * confidence)
        return np.where(n > 1, t * np.sqrt(np.asarray(variance) / n), np.nan)


def correlation(first: Array, other: Array, confidence: float = 0.95) -> Interval:
    """Estimate Pearson's correlation coefficient along the last axis, with Fisher's interval.

    r = sum (a - <a>)(b - <b>) / sqrt(sum (a - <a>)^2 sum (b - <b>)^2),
    tanh(artanh(r) +- z / sqrt(n - 3))

    The interval holds for nearly normal pairs. Pairs with a non-finite number are ignored. The
    coefficient is nan for fewer than two pairs, or if all numbers are the same to rounding; the
    ends are nan for fewer than four pairs.
    Source: Fisher, Metron 1 (1921) 3.
    """
    _check(confidence)
    there = np.isfinite(first) & np.isfinite(other)
    n = there.sum(-1)
    pairs = (np.where(there, x, np.nan) for x in (first, other))
    same = np.logical_or(*map(is_constant, pairs))
    with np.errstate(all="ignore"):
        a, b = (np.where(there, x, 0.0) for x in (first, other))
        a, b = (np.where(there, x - (x.sum(-1) / n)[..., None], 0.0) for x in (a, b))
        # two roots: the product of the sums would overflow for values above 1e77
        size = np.sqrt((a * a).sum(-1)) * np.sqrt((b * b).sum(-1))
        size = np.where(same, np.nan, size)
        r = np.clip((a * b).sum(-1) / size, -1.0, 1.0)
        width = special.ndtri(0.5 + 0.5 * confidence) / np.sqrt(np.where(n > 3, n - 3.0, np.nan))
        return Interval(r, *np.tanh(np.arctanh(r) + np.multiply.outer((-1.0, 1.0), width)))


def quantile(
    values: ArrayLike, q: float, confidence: float = 0.95, infinite: bool = False
) -> Interval:
    """Estimate the quantile q of independent values, by order statistics, for any distribution.

    The value is the smallest x with F(x) >= q, where F is the fraction of values up to x, or the
    middle of the range where F = q (definition 2 of Hyndman & Fan; the median of an even number of
    values is the mean of the middle two). The ranks of the ends follow from the binomial
    distribution. The value lies between the ends for any q, confidence and number of values,
    because a median of the binomial distribution lies between the integers below and above n q
    (Kaas & Buhrman). An interpolated value, as of numpy.quantile, does not. An end is infinite if
    there are too few values for the confidence level. Non-finite values are ignored.

    infinite : whether inf counts as a value, above all others; the quantile may then be inf
    Source: Hyndman & Fan, Am. Stat. 50 (1996) 361; Kaas & Buhrman, Stat. Neerl. 34 (1980) 13;
    David & Nagaraja, Order Statistics (2003), section 7.1.
    """
    _check(confidence)
    if not 0.0 < q < 1.0:
        raise OptionError("expected a number between 0 and 1", at="q", value=q)
    from scipy import stats  # half a second, which runs and maps save

    x = np.asarray(values, float)
    x = np.sort(x[np.isfinite(x) | ((x == np.inf) & infinite)])
    if not x.size:
        return Interval(np.nan, np.nan, np.nan)
    # ranks from 0, with P(too low) and P(too high) at most `tail`
    tail = 0.5 * (1.0 - confidence)
    # `ppf` returns the least rank with a probability of at least `tail`: mostly one too high
    low = int(stats.binom.ppf(tail, x.size, q))
    low -= int(stats.binom.cdf(low, x.size, q) > tail)
    high = int(stats.binom.isf(tail, x.size, q))
    ends = x[low] if low >= 0 else -np.inf, x[high] if high < x.size else np.inf
    return Interval(middle(*x[list(ranks_of_quantile(q, x.size))]), *ends)


def ranks_of_quantile(q: float, n: int) -> tuple[int, int]:
    """Return the ranks, from 0, of the two of n values whose `middle` is the quantile q; they
    differ only if n q is an integer to rounding."""
    first = max(math.ceil(n * q * (1.0 - WHOLE)), 1) - 1
    return first, min(math.floor(n * q * (1.0 + WHOLE)), n - 1)


def middle(low: float, high: float) -> float:
    """Return the mean of two numbers; `low` if `high` is inf, an event beyond the end."""
    # halves first: the sum of two numbers above 9e307 would be inf
    return low if low == high or high == np.inf else 0.5 * low + 0.5 * high


def mean_of_skew(values: ArrayLike, confidence: float = 0.95) -> Interval:
    """Estimate the mean of positive, roughly log-normal values, with an interval of its logarithm.

    For few values of a skewed distribution, Student's interval misses the mean, mostly from below:
    for 16 log-normal values with a relative standard deviation of 0.6, its coverage is 92 %
    (tests/statistics/test_intervals.py). With a relative standard deviation c, the ends are

        mean exp(+-t (c^2/n + c^4/2(n - 1))^(1/2))

    where c^2 approximates the variance of the logarithms, and the second term is the error of this
    variance. For 8 or more values and c up to 0.6, the coverage is 94 to 96 % for log-normal and
    gamma distributions; for 16 values, the interval is an eighth wider than Student's. For c = 1
    the coverage is 92 to 98 %; with a larger spread, few values dominate the mean, and no interval
    is reliable. Source: Cox's method (Land, Technometrics 14 (1972) 145) with Student's t (Olsson,
    J. Stat. Educ. 13 (2005) 1), here about the plain mean.

    values : (n,), not negative;  raises OptionError for an impossible confidence
    """
    value, _, high = (float(number) for number in mean(values, confidence=confidence))
    n = np.size(values)
    half = (high - value) / value if value > 0.0 else 0.0  # t c/n^(1/2)
    t = special.stdtrit(n - 1, 0.5 + 0.5 * confidence)
    with np.errstate(all="ignore"):  # an end may be inf; both are nan for one value
        grown = half * np.sqrt(1.0 + (half / t) ** 2 * n * n / (2.0 * (n - 1.0)))
        return Interval(value, value * float(np.exp(-grown)), value * float(np.exp(grown)))


def quantiles(values: ArrayLike, q: float, confidence: float = 0.95) -> Interval:
    """Estimate the quantile q along the last axis, see `quantile`."""
    values = np.asarray(values, float)
    rows = values.reshape(-1, values.shape[-1])
    table = np.array([quantile(row, q, confidence) for row in rows])
    return Interval(*np.moveaxis(table.reshape(*values.shape[:-1], 3), -1, 0))


def _check(confidence: float) -> None:
    if not 0.0 < confidence < 1.0:
        raise OptionError("expected a number between 0 and 1", at="confidence", value=confidence)


ULPS = 32.0  # largest difference of equal numbers, in units of their resolution


def resolution(dtype: DTypeLike, steps: float = 1.0) -> float:
    """Return the relative resolution of numbers of type `dtype` after `steps` steps."""
    return float(np.finfo(dtype).eps) * math.sqrt(max(1.0, steps))


def resolution_of(run: Run) -> float:
    """Return the relative resolution of the final states of a run."""
    return resolution(run.dtype, 1.0 if run.turn else run.t_end / run.dt)


def is_constant(values: ArrayLike, axis: int | None = -1, resolved: float | None = None) -> Bools:
    """Whether numbers along an axis are all the same to rounding, ignoring non-finite numbers;
    fewer than two numbers are the same.

    The mean of a constant differs from the constant by rounding, so that without this test,
    rounding would determine variances, correlations and sensitivity indices.

    resolved : the relative resolution of the numbers; by default that of their type
    """
    x: NDArray[Any] = np.asarray(values)
    if not np.issubdtype(x.dtype, np.floating):
        x = x.astype(float)
    there, eps = np.isfinite(x), resolution(x.dtype) if resolved is None else resolved
    high = np.max(x, axis=axis, where=there, initial=-np.inf)
    low = np.min(x, axis=axis, where=there, initial=np.inf)
    with np.errstate(invalid="ignore"):
        # by halves: the range of the largest numbers would overflow
        apart, size = 0.5 * high - 0.5 * low, np.maximum(np.abs(high), np.abs(low))
        return np.asarray(~(apart > 0.5 * ULPS * eps * size))
