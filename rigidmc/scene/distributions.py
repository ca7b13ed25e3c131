"""Distributions of one number: by name, truncated, and mixtures of several.

A number is drawn by inverting the distribution function: any point set in (0, 1) may drive it."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigidmc.arrays import is_number
from rigidmc.errors import SceneError, unknown
from rigidmc.physics.dynamics.functions import normal_quantile

Array = NDArray[np.float64]
_RULES = {  # of the two whose quantiles are computed here
    "normal": "expected normal = [mean, standard deviation > 0], finite numbers",
    "uniform": "expected uniform = [low, high] with low < high, finite numbers",
}


@dataclass(frozen=True)
class Distribution:
    """A probability distribution of one number.

    name : "normal", "uniform", or a continuous distribution of scipy.stats
    parameters : (mean, standard deviation), (low, high), or pairs (keyword, value) for scipy
    """

    name: str
    parameters: tuple[Any, ...]

    @property
    def uses_scipy(self) -> bool:
        """Whether scipy computes the quantiles; another version of scipy may round differently."""
        return self.name not in _RULES

    def ppf(self, u: Array) -> Array:
        """Quantiles of u, an array in (0, 1)."""
        if self.uses_scipy:
            quantiles: Array = _scipy(self.name)(**dict(self.parameters)).ppf(u)
            return quantiles
        a, b = map(float, self.parameters)
        return a + b * normal_quantile(u) if self.name == "normal" else a + (b - a) * u

    def times(self, by: float) -> "Distribution":
        """The distribution of the number times a positive factor."""
        if not self.uses_scipy:
            return Distribution(self.name, tuple(by * p for p in self.parameters))
        parameters = {"loc": 0.0, "scale": 1.0} | dict(self.parameters)
        parameters["loc"] *= by
        parameters["scale"] *= by
        return Distribution(self.name, tuple(parameters.items()))

    def as_table(self) -> dict[str, Any]:
        """The distribution as it is written in a scene file."""
        return {self.name: dict(self.parameters) if self.uses_scipy else list(self.parameters)}

    def words(self) -> str:
        """The distribution as people read it."""
        pairs = [f"{k} = {v:g}" for k, v in self.parameters] if self.uses_scipy else None
        return f"{self.name}({', '.join(pairs or [f'{p:g}' for p in self.parameters])})"

    def least(self) -> float:
        """The 1e-9 quantile, which stands for the least number where there is none."""
        return float(self.ppf(np.array([1e-9]))[0])

    def between(self, low: float, high: float) -> "Distribution":
        """Make the same distribution truncated to (low, high).

        The numbers are those of the distribution that lie between, as if others were drawn again:
        F^-1(F(low) + u (F(high) - F(low))), F the distribution function.

        Parameters
        ----------
        low : float
            lower bound, in units of the quantity; -inf for none
        high : float
            upper bound, in the same units; inf for none

        Returns
        -------
        Distribution
            from which each member draws a number

        Raises
        ------
        SceneError
            unless low < high, and where fewer than 1e-300 of the numbers lie between

        Examples
        --------
        >>> rm.normal(1.0, 0.2).between(0.5, np.inf).ppf(np.array([0.5])).round(6).tolist()
        [1.001557]
        """
        given = {**self.as_table(), "between": [low, high]}
        reals = all(is_number(x) or x in (-math.inf, math.inf) for x in (low, high))
        if not reals or not low < high:
            rule = "expected between = [low, high] with low < high"
            raise SceneError(rule, at="between", value=given)
        if self.name == "uniform":
            low, high = max(low, self.parameters[0]), min(high, self.parameters[1])
        law = Truncated("truncated", (self, float(low), float(high)))
        if not law.acceptance() > 1e-300:  # pure: smaller shares leave no digits to divide by
            rule = "the distribution has no numbers between these"
            raise SceneError(rule, at="between", value=given)
        # a uniform one has bits of its own, which are the same for every version of scipy
        return uniform(low, high) if self.name == "uniform" else law

    def frozen(self) -> Any:
        """The distribution as scipy knows it."""
        if self.uses_scipy:
            return _scipy(self.name)(**dict(self.parameters))
        a, b = self.parameters
        return _scipy("norm")(a, b) if self.name == "normal" else _scipy("uniform")(a, b - a)


@dataclass(frozen=True)
class Truncated(Distribution):
    """A distribution of which only the numbers between two bounds are drawn.

    parameters : (distribution, low, high)
    """

    @property
    def uses_scipy(self) -> bool:
        """Distribution function and quantiles are scipy's."""
        return True

    def acceptance(self) -> float:
        """The share of the numbers of the whole distribution that lie between the bounds."""
        _, below, above, _ = self._ends()
        return abs(above - below)

    def ppf(self, u: Array) -> Array:
        """Quantiles of u, an array in (0, 1)."""
        law, below, above, upper = self._ends()
        at = below + u * (above - below)
        numbers: Array = np.clip(law.isf(at) if upper else law.ppf(at), *self.parameters[1:])
        return numbers

    def _ends(self) -> tuple[Any, float, float, bool]:
        """(scipy's distribution, its probability at each bound, whether that is of numbers above).

        Beyond the median 1 - F has the digits that F has lost: a normal distribution truncated to
        more than 9 standard deviations would have none left.
        """
        inner, low, high = self.parameters
        law = inner.frozen()
        upper = bool(law.cdf(low) > 0.5)
        tail = law.sf if upper else law.cdf
        return law, float(tail(low)), float(tail(high)), upper

    def times(self, by: float) -> "Truncated":
        """The distribution of the number times a positive factor."""
        inner, low, high = self.parameters
        return Truncated(self.name, (inner.times(by), by * low, by * high))

    def as_table(self) -> dict[str, Any]:
        """The distribution as it is written in a scene file."""
        inner, low, high = self.parameters
        return {**inner.as_table(), "between": [low, high]}

    def words(self) -> str:
        """The distribution as people read it."""
        inner, low, high = self.parameters
        return f"{inner.words()} between {low:g} and {high:g}"

    def between(self, low: float, high: float) -> Distribution:
        """Make the same distribution with narrower bounds; see Distribution."""
        inner, least, most = self.parameters
        cut: Distribution = inner.between(max(low, least), min(high, most))
        return cut


def _scipy(name: str) -> Any:
    """A continuous distribution of scipy.stats; None if it has none of that name."""
    import scipy.stats

    family = getattr(scipy.stats, name, None)
    return family if isinstance(family, scipy.stats.rv_continuous) else None


def is_distribution(name: str) -> bool:
    """Whether there is a distribution of that name."""
    return name in _RULES or _scipy(name) is not None


def normal(mean: float, standard_deviation: float) -> Distribution:
    """Make a normal distribution N(mean, standard_deviation^2).

    Parameters
    ----------
    mean : float
        of the numbers, in units of the quantity
    standard_deviation : float
        of the numbers, positive, in the same units

    Returns
    -------
    Distribution
        from which each member draws a number

    Raises
    ------
    SceneError
        for a standard deviation that is not positive

    Examples
    --------
    >>> start = rm.Start(omega=(rm.normal(0.0, 1e-3), 1.0, 0.0))
    >>> rm.normal(2.0, 0.1).ppf(np.array([0.5])).tolist()
    [2.0]
    """
    return distribution("normal", mean, standard_deviation)


def uniform(low: float, high: float) -> Distribution:
    """Make a uniform distribution on (low, high).

    Parameters
    ----------
    low : float
        lower end, in units of the quantity
    high : float
        upper end, in the same units

    Returns
    -------
    Distribution
        from which each member draws a number

    Raises
    ------
    SceneError
        unless low < high

    Examples
    --------
    >>> rm.uniform(1.0, 3.0).ppf(np.array([0.25])).tolist()
    [1.5]
    """
    return distribution("uniform", low, high)


def distribution(name: str, /, *values: float, **parameters: float) -> Distribution:
    """Make a distribution by its name.

    Parameters
    ----------
    name : str
        "normal", "uniform", or a continuous one of scipy.stats
    *values : float
        (mean, sd) of "normal", (low, high) of "uniform"
    **parameters : float
        keywords of one of scipy.stats, such as loc, scale and its shapes

    Returns
    -------
    Distribution
        from which each member draws a number

    Raises
    ------
    SceneError
        for an unknown name, or parameters outside the domain of the distribution

    Examples
    --------
    >>> decay = rm.distribution("expon", scale=2.0)
    >>> decay.ppf(np.array([0.5])).round(6).tolist()  # 2 ln 2
    [1.386294]
    """
    given = {name: list(values) or parameters}
    if name not in _RULES:
        return _by_scipy(name, given, parameters if not values else None)
    plain = len(values) == 2 and not parameters and all(map(is_number, values))
    if not plain or not values[1] > (values[0] if name == "uniform" else 0.0):
        raise SceneError(_RULES[name], at="distribution", value=given)
    return Distribution(name, tuple(float(v) for v in values))


def _by_scipy(name: str, given: Any, parameters: Mapping[str, float] | None) -> Distribution:
    """A distribution of scipy.stats; SceneError."""
    family = _scipy(name)
    if family is None:
        import scipy.stats

        known = [word for word in dir(scipy.stats) if _scipy(word) is not None]
        error = unknown("distribution", [*_RULES, *known], at="distribution", value=name)
        error.rule = (
            "no such distribution; known: normal = [mean, sd], uniform = [low, high], and the"
            " continuous ones of scipy.stats"
        )
        raise error
    shapes = [word.strip() for word in (family.shapes or "").split(",") if word.strip()]
    allowed = [*shapes, "loc", "scale"]
    numbers = parameters is not None and all(is_number(v) for v in parameters.values())
    if parameters is None or not numbers or not parameters.keys() <= set(allowed):
        rule = f"scipy's {name} takes a table of numbers with the keys {', '.join(allowed)}"
        raise SceneError(rule, at="distribution", value=given)
    missing = [word for word in shapes if word not in parameters]
    law = Distribution(name, tuple((key, float(value)) for key, value in parameters.items()))
    if missing or not np.isfinite(law.ppf(np.array([0.25, 0.75]))).all():
        what = ", ".join(missing) or "a parameter"
        rule = f"{what} is missing or outside the domain of the distribution"
        raise SceneError(rule, at="distribution", value=given)
    return law


@dataclass(frozen=True)
class Mixture(Distribution):
    """Numbers of several distributions, each with a weight.

    parameters : pairs (weight, distribution)
    """

    def shares(self) -> Array:
        """The weights, divided by their sum."""
        weights = [weight for weight, _ in self.parameters]
        return np.array(weights) / math.fsum(weights)

    @property
    def uses_scipy(self) -> bool:
        """Whether scipy computes quantiles of a part."""
        return any(law.uses_scipy for _, law in self.parameters)

    def ppf(self, u: Array) -> Array:
        """The number of each u, an array in (0, 1): u tells the part, and its place in it.

        These are numbers of the mixture, not its quantiles.
        """
        shares = self.shares()
        ends = np.cumsum(shares)
        which = np.minimum(np.searchsorted(ends, u, side="right"), len(shares) - 1)
        inside = (u - (ends - shares)[which]) / shares[which]
        inside = np.clip(inside, 0.5**53, 1.0 - 0.5**53)  # rounding may reach an end of (0, 1)
        values = np.empty_like(u)
        for i, (_, law) in enumerate(self.parameters):
            values[which == i] = law.ppf(inside[which == i])
        return values

    def times(self, by: float) -> "Mixture":
        """The distribution of the number times a positive factor."""
        return Mixture(self.name, tuple((w, law.times(by)) for w, law in self.parameters))

    def as_table(self) -> dict[str, Any]:
        """The distribution as it is written in a scene file."""
        parts = [{"weight": weight, **law.as_table()} for weight, law in self.parameters]
        return {"mixture": parts}

    def words(self) -> str:
        """The distribution as people read it."""
        pairs = zip(self.shares(), self.parameters, strict=True)
        return " or ".join(f"{share:.3g} {law.words()}" for share, (_, law) in pairs)

    def least(self) -> float:
        """The least of the parts."""
        return min(float(law.least()) for _, law in self.parameters)

    def between(self, low: float, high: float) -> Distribution:
        """Refused: a mixture has no quantiles in closed form."""
        given = {**self.as_table(), "between": [low, high]}
        raise SceneError("give the bounds to the parts of the mixture", at="between", value=given)


def mixture(*parts: tuple[float, Distribution]) -> Distribution:
    """Make a mixture of distributions.

    Its density is sum_k w_k f_k, the weights divided by their sum.

    Parameters
    ----------
    *parts : tuple (float, Distribution)
        weight, positive, and distribution of each part; at least two

    Returns
    -------
    Distribution
        from which each member draws a number

    Raises
    ------
    SceneError
        for fewer than two parts, a weight that is not positive, a part that is no distribution

    Examples
    --------
    >>> two = rm.mixture((9.0, rm.normal(0.0, 0.01)), (1.0, rm.uniform(-1.0, 1.0)))
    >>> two.ppf(np.array([0.45, 0.975])).round(6).tolist()  # 0.975 is at 3/4 of the second part
    [0.0, 0.5]
    """
    rule = "expected two or more parts, each a weight > 0 and a distribution"
    pairs = [part for part in parts if isinstance(part, (tuple, list)) and len(part) == 2]
    known = all(is_number(w) and w > 0 and isinstance(law, Distribution) for w, law in pairs)
    if not known or len(pairs) != len(parts) or len(parts) < 2:
        raise SceneError(rule, at="mixture", value=[str(part) for part in parts])
    return Mixture("mixture", tuple((float(weight), law) for weight, law in pairs))
