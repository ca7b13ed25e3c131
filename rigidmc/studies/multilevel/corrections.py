"""The numbers of multilevel Monte Carlo: its estimate, its errors, and what members cost.

With m_l the mean of level l, of paths of n 2^l steps less the same paths of half as many (m_0 of
paths alone), V_l the variance of a member, N_l the members, L the last level, a the order of the
step and f = 2^a::

    mean = m_0 + ... + m_L + m_L / (f - 1)
    variance = sum over l of w_l^2 V_l / N_l,   w_L = f / (f - 1), all others 1
    error of the step = |f m_L - m_(L-1)| / ((f - 1)(2^b - 1))
    half the width = z sqrt(variance + (error of the step)^2)

The last term of the mean is Richardson's: the error of the step of order a, taken out. What is left
is the change |f m_L - m_(L-1)| / (f - 1) that the last level made in this mean, if further changes
fall with the order b or faster; b is the order that the last two corrections show where it is less
than a, and a otherwise. With this width, z that of the confidence, the interval covers 95.0 to
95.5 % if the error of the step is what it is said to be and less than half of the standard error,
and more if it is larger (tests/studies/test_multilevel.py). The cost of an error is least with N_l
proportional to w_l sqrt(V_l / C_l), C_l the cost of a member.
Source: Giles, Oper. Res. 56 (2008) 607, eqs. (10), (12) and section 4.2; Talay & Tubaro, Stoch.
Anal. Appl. 8 (1990) 483.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

from scipy import special

from rigidmc.results.intervals import ULPS, resolution

START = 24  # steps that take as long as the start and the end of a member: 1 us
PAIRED = 1.4  # steps that take as long as one with the noise of two
SAMPLING = 0.95  # of the width asked for; what is left is for the error of the step
SURE = 3.0  # standard errors beyond which a correction is known not to be 0
SLOWEST = 0.25  # order below which no error is known


class Level(NamedTuple):
    """What is known of a level.

    steps : of its fine paths;  members : that count;  flagged : that do not
    mean : of the corrections;  squares : sum of their squared distances from it
    """

    number: int
    steps: int
    members: float = 0.0
    flagged: float = 0.0
    mean: float = 0.0
    squares: float = 0.0

    @property
    def variance(self) -> float:
        """Of the correction of a member."""
        return self.squares / max(self.members - 1.0, 1.0)

    @property
    def error(self) -> float:
        """The standard error of the mean."""
        return math.sqrt(self.variance / max(self.members, 1.0))

    @property
    def price(self) -> float:
        """The cost of a member, in steps."""
        if self.number == 0:
            return START + self.steps
        return 2.0 * START + (1.0 + 0.5 * PAIRED) * self.steps

    @property
    def cost(self) -> float:
        """The cost of all its members, in steps."""
        return (self.members + self.flagged) * self.price

    def with_more(self, members: float, flagged: float, mean: float, squares: float) -> "Level":
        """The level with more members, whose numbers these are.

        Source: Chan, Golub & LeVeque, Am. Stat. 37 (1983) 242, eqs. (1.5a) and (1.5b).
        """
        total, apart = self.members + members, mean - self.mean
        share = members / total if total else 0.0
        return self._replace(
            members=total,
            flagged=self.flagged + flagged,
            mean=self.mean + share * apart,
            squares=self.squares + squares + self.members * share * apart * apart,
        )


class MultilevelEstimate(NamedTuple):
    """A mean, half the width of its interval by sampling alone and by the error of the step alone,
    and the orders by which the last two corrections and their variances fall; nan if they are not
    known."""

    value: float
    sampling: float
    bias: float
    order: float
    variance_order: float

    @property
    def half(self) -> float:
        """Half the width of the interval."""
        return math.hypot(self.sampling, self.bias)


def sigmas(confidence: float) -> float:
    """How many standard errors an interval has on each side."""
    return float(special.ndtri(0.5 + 0.5 * confidence))


def weights(levels: Sequence[Level], order: float) -> list[float]:
    """How often each correction counts in the mean."""
    return [1.0] * (len(levels) - 1) + [2.0**order / (2.0**order - 1.0)]


def estimate_levels(
    levels: Sequence[Level], order: float, confidence: float, dtype: str = "float64"
) -> MultilevelEstimate:
    """The MultilevelEstimate of three levels or more, for an integrator of an order and a
    precision.

    Corrections that are rounding, such as an exact integrator makes, tell no order.
    """
    f, (before, last) = 2.0**order, levels[-2:]
    each = list(zip(weights(levels, order), levels, strict=True))
    z, variance = sigmas(confidence), sum((w * one.error) ** 2 for w, one in each)
    seen, spread = math.nan, math.nan
    size = math.hypot(levels[0].mean, math.sqrt(levels[0].variance))
    rounding = ULPS * resolution(dtype, last.steps) * size
    if all(abs(one.mean) > max(SURE * one.error, rounding) for one in (before, last)):
        seen = math.log2(abs(before.mean / last.mean))
    if before.variance > 0.0 and last.variance > 0.0:
        spread = math.log2(before.variance / last.variance)
    falls = order if math.isnan(seen) else min(order, seen)
    change = abs(f * last.mean - before.mean) / (f - 1.0)
    return MultilevelEstimate(
        value=sum(w * one.mean for w, one in each),
        sampling=z * math.sqrt(variance),
        bias=z * change / (2.0**falls - 1.0) if falls > SLOWEST else math.inf,
        order=seen,
        variance_order=spread,
    )


def members_of_levels(
    levels: Sequence[Level], order: float, half: float, confidence: float
) -> list[float]:
    """Members of each level that bring the sampling error to `half` at the least cost."""
    each = list(zip(weights(levels, order), levels, strict=True))
    total = sum(w * math.sqrt(one.variance * one.price) for w, one in each)
    per = (sigmas(confidence) / half) ** 2 * total
    return [per * w * math.sqrt(one.variance / one.price) for w, one in each]


def interval_cost(levels: Sequence[Level], order: float, half: float, confidence: float) -> float:
    """What an interval of +- `half` costs, in steps."""
    each = members_of_levels(levels, order, SAMPLING * half, confidence)
    return sum(n * one.price for n, one in zip(each, levels, strict=True))


class Plain(NamedTuple):
    """Members with a single step: how many steps each makes, and how many members there are."""

    steps: int
    members: int

    @property
    def cost(self) -> float:
        """In steps."""
        return float(self.members * (START + self.steps))


def cheapest_plain(levels: Sequence[Level], order: float, half: float, confidence: float) -> Plain:
    """The plain members that cost least for an interval of +- `half`.

    Sampling and the error of the step, which the last correction tells, share `half` in the way
    that costs least. The step is at most that of the first level.
    """
    first, last, z = levels[0], levels[-1], sigmas(confidence)
    off = z * abs(last.mean) / (2.0**order - 1.0)  # with the steps of the last level
    found = []
    for bias in (0.01 * i * half for i in range(1, 100)):
        steps = max(first.steps, math.ceil(last.steps * (off / bias) ** (1.0 / order)))
        members = math.ceil(z * z * first.variance / (half * half - bias * bias))
        found.append(Plain(steps, members))
    return min(found, key=lambda one: one.cost)
