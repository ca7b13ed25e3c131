"""Derivatives of means and quantiles over members, with intervals."""

import math
from typing import NamedTuple

import numpy as np
from scipy import special

from rigidmc.inputs.arrays import Array
from rigidmc.statistics.intervals import Interval, is_constant, mean

NEARBY = 30  # least number of members near a quantile
NONE = Interval(math.nan, math.nan, math.nan)


def of_mean(rates: Array, confidence: float) -> Interval:
    """Estimate d<X>/dp = <dX/dp> from the derivatives of members (n,), by Student's t."""
    return Interval(*map(float, mean(rates, confidence=confidence)))


def of_quantile(values: Array, rates: Array, level: float, confidence: float) -> Interval:
    """Estimate the derivative of the quantile q of X at a level, dq/dp = <dX/dp | X = q>.

    The conditional mean is that of a line fitted to the derivatives of members whose ranks
    u = F(X) are nearest the level, with Epanechnikov weights of half-width h = n^(-1/3), at least
    1.5 NEARBY/n: narrower than the n^(-1/5) of least error, so that the bias, h^2/10 times the
    second derivative in u, is small in units of the interval. The variance has the residuals of the
    fit, and the error of the sample quantile times the slope.
    Source: Hong, Oper. Res. 57 (2009) 118; Fan, J. Am. Stat. Assoc. 87 (1992) 998.

    values, rates : of members (n,); nan for fewer than NEARBY members
    """
    there = np.isfinite(values) & np.isfinite(rates)
    n = int(there.sum())
    if n < NEARBY:
        return NONE
    order = np.argsort(values[there], kind="stable")
    y = rates[there][order]
    x = (np.arange(n) + 0.5) / n - level
    # at an end, NEARBY members on the inner side of the level
    reach = NEARBY / n - min(level, 1.0 - level) + 0.5 / n
    h = max(n ** (-1.0 / 3.0), 1.5 * NEARBY / n, reach)
    weights = np.clip(1.0 - (x / h) ** 2, 0.0, None)
    s0, s1, s2 = (float((weights * x**k).sum()) for k in (0, 1, 2))
    size = s0 * s2 - s1 * s1
    lines = weights * (s2 - s1 * x) / size  # weights of the value of the line at the level
    slopes = weights * (s0 * x - s1) / size
    value, slope = float(lines @ y), float(slopes @ y)
    rest = y - value - slope * x
    # a line takes two of them: at 2 the factor used/(used - 2) of the variance has no bound
    used = max(2.5, 1.0 / float((lines * lines).sum()))
    variance = float((lines * rest) @ (lines * rest)) * used / (used - 2.0)
    variance += slope * slope * level * (1.0 - level) / n
    half = float(special.stdtrit(max(1.0, used - 2.0), 0.5 + 0.5 * confidence)) * math.sqrt(
        variance
    )
    return Interval(value, value - half, value + half)


def terms_of(values: Array, scores: Array) -> Array:
    """Return the terms (n,) whose mean is d<Y | A>/dp by the likelihood ratio,
    (Y - <Y | A>) s 1_A/P(A).

    Subtracting the mean changes nothing in the limit, as <s> = 0, and makes the interval narrower.

    values : Y of the members (n,); nan outside the condition A
    scores : s of all members (n,)
    """
    inside = np.isfinite(values)
    if not inside.any():
        return np.zeros_like(scores)
    away = np.where(inside, values - values[inside].mean(), 0.0)
    terms: Array = away * scores / inside.mean()
    return terms


def of_score(values: Array, scores: Array, confidence: float) -> Interval:
    """Estimate d<Y | A>/dp as the mean of `terms_of`; nan if all members have the same Y, as no
    sample then shows its change."""
    inside = np.isfinite(values)
    if is_constant(values):
        return NONE
    terms = terms_of(values, scores)
    average = mean(terms, confidence=confidence)
    # the denominator P(A) is an estimate, too: the error of the ratio is that of these terms
    value = float(average.value)
    half = float(mean(terms - value * inside / inside.mean(), confidence=confidence).half)
    return Interval(value, value - half, value + half)


class PathGrowth(NamedTuple):
    """How tangents of members grow, and how few of them carry a mean.

    exponent : median log growth over the whole run, nan if unknown
    carriers : effective number of members, (sum |d|)^2/sum d^2
    """

    exponent: float
    carriers: float


def growth_of(half: Array, end: Array, rates: Array) -> PathGrowth:
    """Measure growth from sizes of tangents at half of the time and at the end (n,): twice the
    median of ln(end/half). It is 2 ln 2 for linear growth, and
    lambda t for chaos."""
    with np.errstate(all="ignore"):
        logs = np.log(end / half)
        logs = logs[np.isfinite(logs)]
    exponent = 2.0 * float(np.median(logs)) if logs.size else math.nan
    return PathGrowth(exponent, carriers_of(rates))


def carriers_of(terms: Array) -> float:
    """Return the effective number of members that carry a mean, (sum |x|)^2/sum x^2; nan if all
    terms are 0."""
    size = np.abs(terms[np.isfinite(terms)])
    if not size.any():
        return math.nan
    size = size / size.max()  # squares of chaotic tangents overflow
    return float(size.sum() ** 2 / (size * size).sum())
