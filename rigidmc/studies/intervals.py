"""How sure a number of an ensemble is: probabilities, means and quantiles with their intervals."""

from typing import Any, NamedTuple

import numpy as np
from scipy import special, stats

from rigidmc.errors import OptionError, unknown

METHODS = ("wilson", "clopper-pearson")


class Interval(NamedTuple):
    """An estimate and the ends of its confidence interval, numbers or arrays of one shape."""

    value: Any
    low: Any
    high: Any

    @property
    def half(self):
        """Half its width."""
        return 0.5 * (self.high - self.low)


def probability(successes, trials, confidence=0.95, method="wilson"):
    """The probability of which `successes` of `trials` independent members tell, as an Interval.

    wilson : (p + z^2/2n +- z sqrt(p (1 - p)/n + z^2/4n^2)) / (1 + z^2/n): covers the confidence in the mean over p
    clopper-pearson : from the beta distribution: never covers less, up to twice as wide for few trials

    successes, trials : counts that broadcast; where there are no trials all three are nan. Raises OptionError for counts that cannot be.
    Source: Wilson, J. Am. Stat. Assoc. 22 (1927) 209; Clopper & Pearson, Biometrika 26 (1934) 404; Brown, Cai & DasGupta, Stat. Sci. 16 (2001) 101.
    """
    if method not in METHODS:
        raise unknown("", "method", method, "interval", METHODS, OptionError)
    k, n = np.broadcast_arrays(np.asarray(successes, float), np.asarray(trials, float))
    if np.any(k < 0) or np.any(k > n):
        raise OptionError(
            "",
            "successes",
            float(k[(k < 0) | (k > n)].flat[0]),
            "expected counts between 0 and the trials",
        )
    _check(confidence)
    with np.errstate(all="ignore"):
        p, tail = k / n, 0.5 * (1.0 - confidence)
        if method == "wilson":
            z = special.ndtri(1.0 - tail)
            middle, wide = p + 0.5 * z * z / n, z * np.sqrt(p * (1.0 - p) / n + 0.25 * (z / n) ** 2)
            low, high = (middle - wide) / (1.0 + z * z / n), (middle + wide) / (1.0 + z * z / n)
        else:
            low, high = (
                special.betaincinv(k, n - k + 1.0, tail),
                special.betaincinv(k + 1.0, n - k, 1.0 - tail),
            )
        low, high = np.where(k == 0, 0.0, low), np.where(k == n, 1.0, high)
    none = n == 0
    return Interval(*(np.where(none, np.nan, x) for x in (p, low, high)))


def mean(values, axis=-1, confidence=0.95):
    """The mean of independent values along an axis as an Interval, by Student's t; what is not finite is left out."""
    _check(confidence)
    x = np.asarray(values, float)
    x = np.where(np.isfinite(x), x, np.nan)
    n = np.isfinite(x).sum(axis)
    with np.errstate(all="ignore"):
        total = np.nansum(x, axis)
        value = np.where(n > 0, total / n, np.nan)
        spread = np.nansum((x - np.expand_dims(value, axis)) ** 2, axis) / (n - 1.0)
        half = stats.t.ppf(0.5 + 0.5 * confidence, np.maximum(n - 1, 1)) * np.sqrt(spread / n)
    half = np.where(n > 1, half, np.nan)
    return Interval(value, value - half, value + half)


def controlled(values, control, expected, confidence=0.95):
    """(Interval, factor): the mean of independent values by a control variate, x - b (c - E[c]) with the b of least variance.

    control : of each value, a number whose mean is known, such as that of the closed form nearest to the scene;  expected : that mean
    factor : of the variance without it over that with it, 1/(1 - correlation^2): as many times as many members would do the same. b is of the
    values themselves, which makes the mean wrong by 1/n of its error at most.
    """
    x, c = np.asarray(values, float), np.asarray(control, float)
    well = np.isfinite(x) & np.isfinite(c)
    x, c = x[well], c[well]
    spread = c.var()
    b = ((x - x.mean()) * (c - c.mean())).mean() / spread if spread > 0.0 else 0.0
    left = x - b * (c - expected)
    return mean(left, confidence=confidence), float(
        x.var() / left.var()
    ) if left.var() > 0.0 else np.inf


def paired(values, confidence=0.95):
    """(Interval, factor): the mean of antithetic pairs, members 2k and 2k + 1, by their averages; factor as in `controlled`, 1 + the correlation
    within pairs below 1 in its denominator. A pair with a value that is not finite is left out."""
    pairs = np.asarray(values, float)[: len(values) // 2 * 2].reshape(-1, 2)
    pairs = pairs[np.isfinite(pairs).all(1)]
    average = pairs.mean(1)
    return mean(average, confidence=confidence), float(
        0.5 * pairs.var() / average.var()
    ) if average.var() > 0.0 else np.inf


def quantile(values, q, confidence=0.95):
    """The quantile q of independent values as an Interval between two of them, by the binomial law of ranks: whatever their distribution.

    Where there are too few values for the confidence, an end is infinite. What is not finite is left out.
    """
    _check(confidence)
    if not 0.0 < q < 1.0:
        raise OptionError("", "q", q, "expected a share between 0 and 1")
    x = np.sort(np.asarray(values, float)[np.isfinite(values)])
    if not x.size:
        return Interval(np.nan, np.nan, np.nan)
    tail = 0.5 * (1.0 - confidence)
    low, high = (
        int(stats.binom.ppf(tail, x.size, q)),
        int(stats.binom.isf(tail, x.size, q)),
    )  # of the ranks from 0: P(too high), P(too low) <= tail
    low -= int(stats.binom.cdf(low, x.size, q) > tail)
    ends = x[low] if low >= 0 else -np.inf, x[high] if high < x.size else np.inf
    return Interval(np.quantile(x, q), *ends)


def quantiles(values, q, confidence=0.95):
    """The quantile q along the last axis as an Interval of arrays; see `quantile`."""
    values = np.asarray(values, float)
    flat = values.reshape(-1, values.shape[-1])
    found = np.array([quantile(row, q, confidence) for row in flat]).reshape(*values.shape[:-1], 3)
    return Interval(*np.moveaxis(found, -1, 0))


def _check(confidence):
    if not 0.0 < confidence < 1.0:
        raise OptionError("", "confidence", confidence, "expected a number between 0 and 1")
