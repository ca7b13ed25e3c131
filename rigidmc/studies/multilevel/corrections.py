"""Formulas of multilevel Monte Carlo: estimate, errors, and cost of members.

m_l is the mean of level l: of paths of n 2^l steps minus the same paths of half as many steps (m_0:
of the paths alone). V_l is the variance of a member, N_l the number of members, L the last level, a
the order of the integrator, and f = 2^a::

    mean = m_0 + ... + m_L + m_L / (f - 1)
    variance = sum over l of w_l^2 V_l / N_l,   w_L = f / (f - 1), all others 1
    error of the step = |f m_L - m_(L-1)| / ((f - 1)(2^b - 1))
    half-width = z sqrt(variance + (error of the step)^2)

The last term of the mean is Richardson extrapolation: it removes the error of the step of order a.
The remaining error follows from |f m_L - m_(L-1)| / (f - 1), the change of this mean by the last
level, if further changes fall with order b or faster; b is the order observed in the last two
corrections if that is less than a, and a otherwise. z follows from the confidence. The interval
then covers 95.0 to 95.5 % if the error of the step has this size and is less than half of the
standard error, and more if it is larger (tests/studies/test_multilevel.py). The cost is least with
N_l proportional to w_l sqrt(V_l / C_l), with C_l the cost of a member.
Source: Giles, Oper. Res. 56 (2008) 607, eqs. (10), (12) and section 4.2; Talay & Tubaro, Stoch.
Anal. Appl. 8 (1990) 483.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

from scipy import special

from rigidmc.statistics.intervals import ULPS, resolution

START = 24  # cost of the start and the end of a member, in steps: 1 us
PAIRED = 1.4  # cost of a step with the noise of two, in steps
SAMPLING = 0.95  # fraction of the width for sampling; the rest is for the error of the step
SURE = 3.0  # standard errors from 0 above which a correction counts as nonzero
SLOWEST = 0.25  # observed order below which the error of the step is unknown


class Level(NamedTuple):
    """Sums over the members of a level.

    steps : of its fine paths;  members : counted;  flagged : left out
    mean : of the corrections;  squares : sum of their squared deviations from it
    """

    number: int
    steps: int
    members: float = 0.0
    flagged: float = 0.0
    mean: float = 0.0
    squares: float = 0.0

    @property
    def variance(self) -> float:
        """Variance of the correction of a member."""
        return self.squares / max(self.members - 1.0, 1.0)

    @property
    def error(self) -> float:
        """Standard error of the mean."""
        return math.sqrt(self.variance / max(self.members, 1.0))

    @property
    def taken(self) -> float:
        """Number of members computed."""
        return self.members + self.flagged

    @property
    def price(self) -> float:
        """Cost of a member, in steps."""
        if self.number == 0:
            return START + self.steps
        return 2.0 * START + (1.0 + 0.5 * PAIRED) * self.steps

    @property
    def cost(self) -> float:
        """Cost of all its members, in steps."""
        return self.taken * self.price

    def with_more(self, members: float, flagged: float, mean: float, squares: float) -> "Level":
        """Return the level with more members added, given their sums.

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
    """A mean; the half-width of its interval from sampling alone, and from the error of the step
    alone; and the orders with which the last two corrections and their variances fall, nan if
    unknown."""

    value: float
    sampling: float
    bias: float
    order: float
    variance_order: float

    @property
    def half(self) -> float:
        """Half-width of the interval."""
        return math.hypot(self.sampling, self.bias)

    def words(self) -> str:
        """Write the mean and both half-widths as text."""
        return f"{self.value:.6g} +- {self.sampling:.2g} by sampling, {self.bias:.2g} by the step"


def sigmas(confidence: float) -> float:
    """Return the standard errors on each side of an interval."""
    return float(special.ndtri(0.5 + 0.5 * confidence))


def weighted(levels: Sequence[Level], order: float) -> list[tuple[float, Level]]:
    """Return (its weight in the mean, level) of each level."""
    weights = [1.0] * (len(levels) - 1) + [2.0**order / (2.0**order - 1.0)]
    return list(zip(weights, levels, strict=True))


def estimate_levels(
    levels: Sequence[Level], order: float, confidence: float, dtype: str = "float64"
) -> MultilevelEstimate:
    """Return the MultilevelEstimate of three levels or more.

    order, dtype : of the integrator

    Corrections at the level of rounding, as of an exact integrator, give no order.
    """
    f, (before, last), pairs = 2.0**order, levels[-2:], weighted(levels, order)
    z, variance = sigmas(confidence), sum((w * level.error) ** 2 for w, level in pairs)
    seen, spread = math.nan, math.nan
    size = math.hypot(levels[0].mean, math.sqrt(levels[0].variance))
    rounding = ULPS * resolution(dtype, last.steps) * size
    if all(abs(level.mean) > max(SURE * level.error, rounding) for level in (before, last)):
        seen = math.log2(abs(before.mean / last.mean))
    if before.variance > 0.0 and last.variance > 0.0:
        spread = math.log2(before.variance / last.variance)
    falls = order if math.isnan(seen) else min(order, seen)
    change = abs(f * last.mean - before.mean) / (f - 1.0)
    return MultilevelEstimate(
        value=sum(w * level.mean for w, level in pairs),
        sampling=z * math.sqrt(variance),
        bias=z * change / (2.0**falls - 1.0) if falls > SLOWEST else math.inf,
        order=seen,
        variance_order=spread,
    )


def members_for_goal(
    levels: Sequence[Level], order: float, half: float, confidence: float
) -> list[float]:
    """Return the members of each level with the least cost for an interval of +- `half`."""
    pairs = weighted(levels, order)
    total = sum(w * math.sqrt(level.variance * level.price) for w, level in pairs)
    per = (sigmas(confidence) / (SAMPLING * half)) ** 2 * total
    return [per * w * math.sqrt(level.variance / level.price) for w, level in pairs]


def interval_cost(levels: Sequence[Level], order: float, half: float, confidence: float) -> float:
    """Return the cost of an interval of +- `half`, in steps."""
    members = members_for_goal(levels, order, half, confidence)
    return sum(n * level.price for n, level in zip(members, levels, strict=True))


class Plain(NamedTuple):
    """Plain members, all with the same step: steps of each, and number of members."""

    steps: int
    members: int

    @property
    def cost(self) -> float:
        """Cost, in steps."""
        return float(self.members * (START + self.steps))


def cheapest_plain(levels: Sequence[Level], order: float, half: float, confidence: float) -> Plain:
    """Return the cheapest plain members for an interval of +- `half`.

    `half` is divided between sampling and the error of the step, estimated from the last
    correction, such that the cost is least. The step is at most that of the first level.
    """
    first, last, z = levels[0], levels[-1], sigmas(confidence)
    off = z * abs(last.mean) / (2.0**order - 1.0)  # with the steps of the last level
    choices = []
    for bias in (0.01 * i * half for i in range(1, 100)):
        steps = max(first.steps, math.ceil(last.steps * (off / bias) ** (1.0 / order)))
        members = math.ceil(z * z * first.variance / (half * half - bias * bias))
        choices.append(Plain(steps, members))
    return min(choices, key=lambda plain: plain.cost)
