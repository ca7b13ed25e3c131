"""Censored times: times of events that have not occurred in some members by their end.

A censored time is later than the end of its member, and every estimate includes it. A signed number
encodes both cases: t for an event at t, -c for an event later than c, where -0.0 means later than
0. Members without information are nan.

If all members end at the same time, every censored time comes after every observed time:
probabilities up to the end, and quantiles up to the observed fraction, have the estimates and
intervals of a complete sample. If ends differ, as with flagged or stopped members, the probability
that the event has not occurred is the Kaplan-Meier estimate,

    S(t) = prod over event times u <= t of (1 - d/n),

with d events at u, among n members followed until u without an earlier event. Its variance is
Greenwood's, S^2 sum d/(n (n - d)). A sample of m = (1 - S)/(S sum d/(n (n - d))) members with a
common end has the same variance, so the intervals use m as the number of members. Without a
censored time before t, m equals that number, so both methods agree.
The method assumes that flags occur independently of the event, given the time.

Source: Kaplan & Meier, J. Am. Stat. Assoc. 53 (1958) 457; Greenwood, Rep. Public Health Med. Subj.
33 (1926); m: Dorey & Korn, Stat. Med. 6 (1987) 679; ends of quantiles by inverting the test of S:
Brookmeyer & Crowley, Biometrics 38 (1982) 29, and their middle of the range where S = 1 - q.
"""

import math
import operator
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy import special

from rigidmc.errors import OptionError
from rigidmc.files.reading import toml
from rigidmc.inputs.arrays import Array, Bools
from rigidmc.physics.observables.saving import CENSORED, FOLLOWED, LAG
from rigidmc.scene.toml.read import scene_text
from rigidmc.statistics import intervals
from rigidmc.statistics.intervals import WHOLE, Estimate


class Column(NamedTuple):
    """A variable of a block of members: values (n,) or (3, n), and attributes.

    It has what measures use of a variable of a Dataset. To make a Dataset of each block would cost
    more than the sums over its members.
    """

    values: NDArray[Any]
    attrs: Mapping[str, Any]

    def sel(self, axis: int) -> "Column":
        """Return component 1, 2 or 3 of a vector."""
        return Column(self.values[axis - 1], self.attrs)


Columns = xr.Dataset | Mapping[str, Column]


SAME = 1.0 + 1e-9  # ratio up to which two times count as equal
RELATIONS: dict[str, Callable[[Any, float], Any]] = {
    ">=": operator.ge,
    "<=": operator.le,
    ">": operator.gt,
    "<": operator.lt,
    "==": operator.eq,
}


def signed_times(dataset: Columns, name: str, times: Array) -> Array:
    """Return the signed times (..., n) of an event in the members of a result, see above.

    name : the variable; its attributes state how long the event has to last
    Raises OptionError for negative times, which are impossible for events.
    """
    if (times < 0.0).any():
        rule = (
            f"has negative values, so it is not the time of an event: set `event_times=()` in the"
            f' class that defines {name}, or in Python `ds.{name}.attrs["{CENSORED}"] = "no"`'
        )
        raise OptionError(rule, at="measure", value=name)
    lag = float(dataset[name].attrs.get(LAG, 0.0))
    ends = ends_of(dataset) - lag
    come = np.isfinite(times) & ~(times > ends * SAME)
    later = np.where(ends >= 0.0, -ends, np.nan)
    return np.where(np.isnan(ends), np.nan, np.where(come, np.abs(times), later))


def ends_of(dataset: Columns) -> Array:
    """Return the end until which each member was followed [s]; nan without information."""
    good = dataset["status"].values == 0
    ends = np.full(good.size, np.nan)
    if FOLLOWED in dataset:
        ends = np.array(dataset[FOLLOWED].values, float)
    if (unknown := good & np.isnan(ends)).any():  # a result of an earlier version
        result: Any = dataset
        is_told = "t_end" in result.attrs
        run = result.attrs if is_told else toml(scene_text(result))["run"]
        ends[unknown] = float(run["t_end"])
    if "status_time" in dataset:
        flagged = dataset["status_time"].values
        ends = np.where(good, ends, np.minimum(np.where(np.isnan(ends), np.inf, ends), flagged))
    return ends


def is_censored(times: Array) -> Bools:
    """Whether each of signed times is censored."""
    result: Bools = np.signbit(times) & ~np.isnan(times)
    return result


def times_that_came(times: Array) -> Array:
    """Return the observed times; nan for censored ones."""
    return np.where(is_censored(times), np.nan, times)


def answers(times: Array, relation: str, number: float) -> Array:
    """Return 1 where a relation with a number holds, 0 where not, nan where that is unknown."""
    holds = RELATIONS[relation](np.abs(times), number).astype(float)
    later = {">": 1.0, ">=": 1.0, "<": 0.0, "<=": 0.0, "==": 0.0}[relation]
    is_later = np.abs(times) * SAME >= number
    result = np.where(is_censored(times), np.where(is_later, later, np.nan), holds)
    return np.where(np.isnan(times), np.nan, result)


def refuse_later_times(text: str, times: Array, number: float) -> None:
    """Raise OptionError for a relation with a time beyond the end of all members."""
    ends = np.abs(times[is_censored(times)])
    if ends.size and not number <= (last := float(np.nanmax(np.abs(times)))) * SAME:
        rule = f"members were followed only until {last:g} s, not until {number:g} s"
        raise OptionError(rule, at="measure", value=text)


def share(times: Array) -> Array:
    """Return the fractions (...) of censored times among the times (..., n) that are not nan."""
    there = (~np.isnan(times)).sum(-1)
    with np.errstate(all="ignore"):
        result: Array = np.where(there > 0, is_censored(times).sum(-1) / there, np.nan)
    return result


class Survival(NamedTuple):
    """Survival function: the fraction of members without the event, after each event time.

    times : event times, ascending (k,);  s, size : the fraction after each, and the number of
        members with a common end that gives it the same variance (k + 1); the first entries are
        before all events
    numbers : all times, ascending (n,);  last : end until which the fraction is known
    """

    times: Array
    s: Array
    size: Array
    numbers: Array
    last: float

    def followed(self, t: float) -> int:
        """Return the number of members followed until t without an earlier event."""
        return int(self.numbers.size - np.searchsorted(self.numbers, t / SAME))

    def at(self, t: float, before: bool) -> tuple[float, float]:
        """Return (fraction without the event after t, or before t; size of its sample)."""
        i = int(np.searchsorted(self.times, t, "left" if before else "right"))
        s = float(self.s[i])
        if s == 1.0:
            return s, float(self.followed(t))
        if s > 0.0 and t > self.last * SAME:
            return np.nan, float(self.size[i])
        return s, float(self.size[i])


def survival(times: Array) -> Survival:
    """Return the Survival of signed times (n,), without nan."""
    times = times[~np.isnan(times)]
    numbers, come = np.sort(np.abs(times)), times[~np.signbit(times)]
    at, d = np.unique(come, return_counts=True)
    n = numbers.size - np.searchsorted(numbers, at)
    s = np.concatenate([[1.0], np.cumprod(1.0 - d / n)])
    size = np.full(s.size, float(numbers.size))
    with np.errstate(all="ignore"):
        spread = np.cumsum(d / (n * (n - d).astype(float)))
        rate = (1.0 - s[1:]) / (s[1:] * spread)
    is_finite = np.isfinite(rate)
    size[1:][is_finite] = rate[is_finite]
    for i in np.flatnonzero(~is_finite):  # no members left: use the last known size
        size[i + 1] = size[i] if i else float(n[0])
    return Survival(at, s, size, numbers, float(numbers[-1]) if numbers.size else np.nan)


def censored_probability(times: Array, relation: str, number: float, confidence: float) -> Estimate:
    """Estimate the probability that a relation with a number holds, from signed times (..., n)."""
    told = answers(times, relation, number)
    there = ~np.isnan(times)
    k, n = (told == 1.0).sum(-1), (~np.isnan(told)).sum(-1)
    value, low, high = intervals.probability(k, n, confidence)
    value, low, high = (np.array(x, float) for x in (value, low, high))
    if relation != "==":
        for i in map(tuple, np.argwhere((there & np.isnan(told)).any(-1))):
            estimate = _probability_of(times[i], relation, number, confidence)
            value[i], low[i], high[i] = estimate
    return as_estimate(times, value, low, high)


def as_estimate(times: Array, value: Any, low: Any, high: Any) -> Estimate:
    """Make an Estimate, with the censored fraction and the end of signed times (..., n)."""
    return Estimate(value, low, high, share(times), _last(times))


def _probability_of(
    times: Array, relation: str, number: float, confidence: float
) -> intervals.Interval:
    """Estimate the probability from times (n,) with different ends."""
    s, size = survival(times).at(number, relation in ("<", ">="))
    later = relation[0] == ">"
    if np.isnan(s):
        return intervals.Interval(np.nan, np.nan, np.nan)
    p = s if later else 1.0 - s
    return intervals.Interval(*map(float, intervals.probability(p * size, size, confidence)))


def censored_quantile(times: Array, q: float, confidence: float) -> Estimate:
    """Estimate the quantile q of signed times (..., n); inf if it is beyond the end. Beyond the
    end, the upper end of its interval is inf, and the lower one is the end of the members."""
    rows = times.reshape(math.prod(times.shape[:-1]), times.shape[-1])
    table = np.array([_quantile_of(row[~np.isnan(row)], q, confidence) for row in rows])
    columns = np.moveaxis(table.reshape(*times.shape[:-1], 3), -1, 0)
    return as_estimate(times, *columns)


def _quantile_of(times: Array, q: float, confidence: float) -> tuple[float, float, float]:
    censored, numbers = np.signbit(times), np.abs(times)
    if not times.size:
        return np.nan, np.nan, np.nan
    end = numbers[censored].min(initial=np.inf)
    if not censored.any() or end * SAME >= numbers[~censored].max(initial=-np.inf):
        plain = intervals.quantile(np.where(censored, np.inf, times), q, confidence, True)
        return plain.value, min(max(plain.low, 0.0), end), plain.high
    return _by_survival(survival(times), q, 0.5 * (1.0 - confidence))


def _by_survival(curve: Survival, q: float, tail: float) -> tuple[float, float, float]:
    """Return (quantile, low, high). `low` is the last time at which a test of size `tail` finds the
    quantile later, `high` the first time at which it finds the quantile earlier."""
    at, f = curve.times, 1.0 - curve.s
    # the smallest time with F >= q, or the middle where F = q, as in `intervals.quantile`
    first, last = (np.searchsorted(f[1:], q * (1.0 + x)) for x in (-WHOLE, WHOLE))
    later = np.append(at, np.inf)
    # at each event time, and at the end: the earlier events
    before = np.append(at, curve.last)
    size = np.where(f > 0.0, curve.size, [curve.followed(t) for t in before])
    late = _at_most(size, q, size * f) <= tail
    early = _at_least(curve.size[1:], q, curve.size[1:] * f[1:]) <= tail
    return (
        float(intervals.middle(later[first], later[last])),
        float(before[late].max(initial=0.0)),
        float(at[early].min(initial=np.inf)),
    )


def _at_most(n: Array, p: float, k: Array) -> Array:
    """Return P(B <= k) of a binomial B with n trials, extended to real n and k."""
    k = np.minimum(k, n)
    some = k < n * (1.0 - 1e-12)
    share: Array = np.where(some, special.betainc(np.where(some, n - k, 1.0), k + 1.0, 1.0 - p), 1)
    return share


def _at_least(n: Array, p: float, k: Array) -> Array:
    """Return P(B >= k) of a binomial B with n trials, extended to real n and k."""
    # 1e-300 avoids k = 0, whose value is not used
    share: Array = np.where(k > 0.0, special.betainc(np.maximum(k, 1e-300), n - k + 1.0, p), 1.0)
    return share


def _last(times: Array) -> Any:
    """Return the latest end until which members were followed; nan if no time is censored."""
    ends = np.where(is_censored(times), np.abs(times), np.nan)
    longest = np.max(ends, axis=-1, initial=-np.inf, where=~np.isnan(ends))
    return np.where(np.isneginf(longest), np.nan, longest)
