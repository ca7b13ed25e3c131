"""Times of events of which some have not come by the end of their member: censored times.

Such a time is later than the end, and no estimate leaves it out. One number tells both: t for a
time that has come, -c for one that is later than c, where -0.0 is later than 0. Members that tell
nothing are nan.

With one end for all, the order of the times that have come is known, and all others come after:
probabilities up to the end and quantiles up to the share that has come are those of complete
samples, with the same intervals. Where ends differ, as those of flagged and stopped members do, the
probability to be without the event is that of Kaplan and Meier,

    S(t) = prod over event times u <= t of (1 - d/n),

with d events at u and n members that were followed until u and had none before. Its variance is
Greenwood's, S^2 sum d/(n (n - d)); a sample of m = (1 - S)/(S sum d/(n (n - d))) members with one
end has the same variance, and m takes the place of the members in the intervals. Without a
censored time before t it is their number, so that both ways agree.
Flags are taken to come independently of the event, given the time.

Source: Kaplan & Meier, J. Am. Stat. Assoc. 53 (1958) 457; Greenwood, Rep. Public Health Med. Subj.
33 (1926); m: Dorey & Korn, Stat. Med. 6 (1987) 679; ends of quantiles by inverting the test of S:
Brookmeyer & Crowley, Biometrics 38 (1982) 29.
"""

import math
import operator
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy import special

from rigidmc.errors import OptionError
from rigidmc.files.reading import toml
from rigidmc.physics.observables.saving import CENSORED, FOLLOWED, LAG
from rigidmc.results import intervals
from rigidmc.results.intervals import Estimate
from rigidmc.scene.toml.read import scene_text

Array = NDArray[np.float64]
SAME = 1.0 + 1e-9  # times that are so near are the same
RELATIONS: dict[str, Callable[[Any, float], Any]] = {
    ">=": operator.ge,
    "<=": operator.le,
    ">": operator.gt,
    "<": operator.lt,
    "==": operator.eq,
}


def signed_times(dataset: xr.Dataset, name: str, times: Array) -> Array:
    """The times of an event of the members of a result (..., n), see above.

    name : the variable, whose attributes tell of an event that has to last
    Raises OptionError for negative times, which no event has.
    """
    if (times < 0.0).any():
        rule = (
            f"has negative values, which no time of an event has: state `event_times=()` in the"
            f' class that gives {name}, or in Python `ds.{name}.attrs["{CENSORED}"] = "no"`'
        )
        raise OptionError(rule, at="measure", value=name)
    lag = float(dataset[name].attrs.get(LAG, 0.0))
    ends = ends_of(dataset) - lag
    come = np.isfinite(times) & ~(times > ends * SAME)
    later = np.where(ends >= 0.0, -ends, np.nan)
    return np.where(np.isnan(ends), np.nan, np.where(come, np.abs(times), later))


def ends_of(dataset: xr.Dataset) -> Array:
    """Until when each member was followed [s]; nan for one that tells nothing."""
    good, count = dataset.status.values == 0, dataset.sizes["member"]
    ends = np.full(count, np.nan)
    if FOLLOWED in dataset:
        ends = np.array(dataset[FOLLOWED].values, float)
    if (unknown := good & np.isnan(ends)).any():  # a result of an earlier version
        ends[unknown] = _t_end(dataset)
    if "status_time" in dataset:
        flagged = dataset.status_time.values
        ends = np.where(good, ends, np.minimum(np.where(np.isnan(ends), np.inf, ends), flagged))
    return ends


def _t_end(dataset: xr.Dataset) -> float:
    if "t_end" in dataset.attrs:
        return float(dataset.attrs["t_end"])
    return float(toml(scene_text(dataset))["run"]["t_end"])


def is_censored(times: Array) -> NDArray[np.bool_]:
    """Which of signed times have not come."""
    found: NDArray[np.bool_] = np.signbit(times) & ~np.isnan(times)
    return found


def times_that_came(times: Array) -> Array:
    """Times that have come; nan for others."""
    return np.where(is_censored(times), np.nan, times)


def answers(times: Array, relation: str, number: float) -> Array:
    """1 where a relation with a number holds, 0 where not, nan where a member tells neither."""
    holds = RELATIONS[relation](np.abs(times), number).astype(float)
    later = {">": 1.0, ">=": 1.0, "<": 0.0, "<=": 0.0, "==": 0.0}[relation]
    known = np.abs(times) * SAME >= number
    found = np.where(is_censored(times), np.where(known, later, np.nan), holds)
    return np.where(np.isnan(times), np.nan, found)


def refuse_later_times(text: str, times: Array, number: float) -> None:
    """OptionError for a relation with a time that no member was followed to."""
    ends = np.abs(times[is_censored(times)])
    if ends.size and not number <= (last := float(np.nanmax(np.abs(times)))) * SAME:
        rule = f"members were followed to {last:g} s: nothing is known of {number:g} s"
        raise OptionError(rule, at="measure", value=text)


def share(times: Array) -> Array:
    """The shares (...) of censored times among the times (..., n) of members that tell some."""
    there = (~np.isnan(times)).sum(-1)
    with np.errstate(all="ignore"):
        found: Array = np.where(there > 0, is_censored(times).sum(-1) / there, np.nan)
    return found


class Survival(NamedTuple):
    """The share without the event, after each time at which it came.

    times : at which the event came, ascending (k,);  s, size : the share after each, and of how
        many members with one end it would have the same variance (k + 1); the first are before all
    numbers : all times, ascending (n,);  last : until when the share is known
    """

    times: Array
    s: Array
    size: Array
    numbers: Array
    last: float

    def followed(self, t: float) -> int:
        """How many members were followed until t without an event before."""
        return int(self.numbers.size - np.searchsorted(self.numbers, t / SAME))

    def at(self, t: float, before: bool) -> tuple[float, float]:
        """(share without the event after t, or before t; the size of its sample)."""
        i = int(np.searchsorted(self.times, t, "left" if before else "right"))
        s = float(self.s[i])
        if s == 1.0:
            return s, float(self.followed(t))
        if s > 0.0 and t > self.last * SAME:
            return np.nan, float(self.size[i])
        return s, float(self.size[i])


def survival(times: Array) -> Survival:
    """The Survival of signed times (n,), nan left out."""
    times = times[~np.isnan(times)]
    numbers, come = np.sort(np.abs(times)), times[~np.signbit(times)]
    at, d = np.unique(come, return_counts=True)
    n = numbers.size - np.searchsorted(numbers, at)
    s = np.concatenate([[1.0], np.cumprod(1.0 - d / n)])
    size = np.full(s.size, float(numbers.size))
    with np.errstate(all="ignore"):
        spread = np.cumsum(d / (n * (n - d).astype(float)))
        found = (1.0 - s[1:]) / (s[1:] * spread)
    known = np.isfinite(found)
    size[1:][known] = found[known]
    for i in np.flatnonzero(~known):  # nobody is left: the last one of whom that is known
        size[i + 1] = size[i] if i else float(n[0])
    return Survival(at, s, size, numbers, float(numbers[-1]) if numbers.size else np.nan)


def censored_probability(times: Array, relation: str, number: float, confidence: float) -> Estimate:
    """The probability that a time has a relation with a number, of signed times (..., n)."""
    told = answers(times, relation, number)
    there = ~np.isnan(times)
    k, n = (told == 1.0).sum(-1), (~np.isnan(told)).sum(-1)
    value, low, high = intervals.probability(k, n, confidence)
    value, low, high = (np.array(x, float) for x in (value, low, high))
    if relation != "==":
        for i in map(tuple, np.argwhere((there & np.isnan(told)).any(-1))):
            found = _probability_of(times[i], relation, number, confidence)
            value[i], low[i], high[i] = found
    return as_estimate(times, value, low, high)


def as_estimate(times: Array, value: Any, low: Any, high: Any) -> Estimate:
    """The Estimate of numbers with what signed times (..., n) tell of the members."""
    return Estimate(value, low, high, share(times), _last(times))


def _probability_of(
    times: Array, relation: str, number: float, confidence: float
) -> intervals.Interval:
    """The same of times (n,) with several ends."""
    s, size = survival(times).at(number, relation in ("<", ">="))
    later = relation[0] == ">"
    if np.isnan(s):
        return intervals.Interval(np.nan, np.nan, np.nan)
    p = s if later else 1.0 - s
    return intervals.Interval(*map(float, intervals.probability(p * size, size, confidence)))


def censored_quantile(times: Array, q: float, confidence: float) -> Estimate:
    """The quantile q of signed times (..., n): inf if it is beyond the end. An end of its interval
    that is beyond is inf too, but the lower one is the end of the members."""
    rows = times.reshape(math.prod(times.shape[:-1]), times.shape[-1])
    table = np.array([_quantile_of(row[~np.isnan(row)], q, confidence) for row in rows])
    found = np.moveaxis(table.reshape(*times.shape[:-1], 3), -1, 0)
    return as_estimate(times, *found)


def _quantile_of(times: Array, q: float, confidence: float) -> tuple[float, float, float]:
    censored, numbers = np.signbit(times), np.abs(times)
    if not times.size:
        return np.nan, np.nan, np.nan
    end = numbers[censored].min(initial=np.inf)
    if not censored.any() or end * SAME >= numbers[~censored].max(initial=-np.inf):
        found = intervals.quantile(np.where(censored, np.inf, times), q, confidence, True)
        return found.value, min(max(found.low, 0.0), end), found.high
    return _by_survival(survival(times), q, 0.5 * (1.0 - confidence))


def _by_survival(found: Survival, q: float, tail: float) -> tuple[float, float, float]:
    """(quantile, low, high): the ends are the last and the first time at which a test of size
    `tail` on each side takes the quantile for later, and for earlier."""
    at, f = found.times, 1.0 - found.s
    value = at[f[1:] >= q * (1.0 - 1e-12)]
    # at each time, and at the end: as many have come before
    before = np.append(at, found.last)
    size = np.where(f > 0.0, found.size, [found.followed(t) for t in before])
    late = _at_most(size, q, size * f) <= tail
    early = _at_least(found.size[1:], q, found.size[1:] * f[1:]) <= tail
    return (
        float(value[0]) if value.size else np.inf,
        float(before[late].max(initial=0.0)),
        float(at[early].min(initial=np.inf)),
    )


def _at_most(n: Array, p: float, k: Array) -> Array:
    """P(B <= k) of a binomial number B of n, for real n and k too."""
    k = np.minimum(k, n)
    some = k < n * (1.0 - 1e-12)
    found: Array = np.where(some, special.betainc(np.where(some, n - k, 1.0), k + 1.0, 1.0 - p), 1)
    return found


def _at_least(n: Array, p: float, k: Array) -> Array:
    """P(B >= k) of a binomial number B of n, for real n and k too."""
    # a count: what stands for 0 is not taken
    found: Array = np.where(k > 0.0, special.betainc(np.maximum(k, 1e-300), n - k + 1.0, p), 1.0)
    return found


def _last(times: Array) -> Any:
    """Until when members were followed, the longest; nan if all times have come."""
    ends = np.where(is_censored(times), np.abs(times), np.nan)
    longest = np.max(ends, axis=-1, initial=-np.inf, where=~np.isnan(ends))
    return np.where(np.isneginf(longest), np.nan, longest)
