"""Distributions of one number: by name, truncated, and correlated ones.

Numbers are drawn by inverting the distribution function, so any point set in (0, 1) can drive
them."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest
from typing import Any, ClassVar

import numpy as np

from rigidmc.errors import SceneError, unknown
from rigidmc.inputs.arrays import Array, is_number
from rigidmc.inputs.measured import Measured, common_unit
from rigidmc.physics.dynamics.functions import normal_quantile

_NAMES = {"normal": ("mean", "standard_deviation"), "uniform": ("low", "high")}
_RULES = {  # for the distributions whose quantiles are computed here
    "normal": "expected normal = [mean, standard deviation > 0], finite numbers",
    "uniform": "expected uniform = [low, high] with low < high, finite numbers",
    "common": "expected common = [mean, a_1, ...], finite numbers, not all of a_1, ... zero",
}


@dataclass(frozen=True)
class Distribution:
    """A probability distribution of one number.

    name : "normal", "uniform", or a continuous distribution of scipy.stats
    parameters : (mean, standard deviation), (low, high), or pairs (keyword, value) for scipy
    stream : the random stream of its words; "" for that of the quantity which it draws
    """

    stream: ClassVar[str] = ""
    name: str
    parameters: tuple[Any, ...]

    @property
    def uses_scipy(self) -> bool:
        """Whether scipy computes the quantiles; other versions of scipy may round differently."""
        return self.name not in _RULES

    def ppf(self, u: Array) -> Array:
        """Return the quantiles of u, an array in (0, 1)."""
        if self.uses_scipy:
            quantiles: Array = _scipy(self.name)(**dict(self.parameters)).ppf(u)
            return quantiles
        a, b = map(float, self.parameters)
        return a + b * normal_quantile(u) if self.name == "normal" else a + (b - a) * u

    def log_density(self, x: Array) -> Array:
        """Return the logarithms of the density at numbers (n,), -inf where it is 0."""
        logarithms: Array = self.frozen().logpdf(x)
        return logarithms

    def of_words(self, words: Array, own: int) -> Array:
        """Return values from the words (4, n) of a draw, of which this number has word `own`."""
        return self.ppf(words[own])

    def times(self, by: float) -> "Distribution":
        """Return the distribution of the number times a positive factor."""
        if not self.uses_scipy:
            return replace(self, parameters=tuple(by * p for p in self.parameters))
        parameters = {"loc": 0.0, "scale": 1.0} | dict(self.parameters)
        parameters["loc"] *= by
        parameters["scale"] *= by
        return Distribution(self.name, tuple(parameters.items()))

    def as_table(self) -> dict[str, Any]:
        """Return the distribution as written in a scene file."""
        return {self.name: dict(self.parameters) if self.uses_scipy else list(self.parameters)}

    def words(self) -> str:
        """Return the distribution in readable notation."""
        pairs = [f"{k} = {v:g}" for k, v in self.parameters] if self.uses_scipy else None
        return f"{self.name}({', '.join(pairs or [f'{p:g}' for p in self.parameters])})"

    def least(self) -> float:
        """Return the 1e-9 quantile, in place of the minimum, which may be -inf."""
        return float(self.ppf(np.array([1e-9]))[0])

    def between(self, low: float, high: float) -> "Distribution":
        """Truncate the distribution to (low, high).

        The result is the distribution conditional on low < x < high, drawn as
        F^-1(F(low) + u (F(high) - F(low))), with the distribution function F.

        Parameters
        ----------
        low : float
            lower bound, in units of the quantity; -inf for none
        high : float
            upper bound, in the same units; inf for none

        Returns
        -------
        Distribution
            the distribution from which each member draws a number

        Raises
        ------
        SceneError
            unless low < high, and if the probability of the interval is at most 1e-300

        Examples
        --------
        >>> rm.normal(1.0, 0.2).between(0.5, np.inf).ppf(np.array([0.5])).round(6).tolist()
        [1.001557]
        """
        shown = {**self.as_table(), "between": [low, high]}
        reals = all(is_number(x) or x in (-math.inf, math.inf) for x in (low, high))
        if not reals or not low < high:
            rule = "expected between = [low, high] with low < high"
            raise SceneError(rule, at="between", value=shown)
        if self.name == "uniform":
            low, high = max(low, self.parameters[0]), min(high, self.parameters[1])
        law = Truncated("truncated", (self, float(low), float(high)))
        if not law.acceptance() > 1e-300:  # pure: smaller fractions leave no digits to divide by
            rule = "the distribution has no numbers between these bounds"
            raise SceneError(rule, at="between", value=shown)
        # a uniform distribution has the same bits for every version of scipy
        return uniform(low, high) if self.name == "uniform" else law

    def frozen(self) -> Any:
        """Return the distribution as a frozen distribution of scipy."""
        if self.uses_scipy:
            return _scipy(self.name)(**dict(self.parameters))
        a, b = self.parameters
        return _scipy("norm")(a, b) if self.name == "normal" else _scipy("uniform")(a, b - a)


@dataclass(frozen=True)
class Truncated(Distribution):
    """A distribution truncated to the numbers between two bounds.

    parameters : (distribution, low, high)
    """

    @property
    def uses_scipy(self) -> bool:
        """True: scipy computes the distribution function and quantiles."""
        return True

    def acceptance(self) -> float:
        """Return the probability of the interval in the untruncated distribution."""
        _, below, above, _ = self._ends()
        return abs(above - below)

    def ppf(self, u: Array) -> Array:
        law, below, above, upper = self._ends()
        at = below + u * (above - below)
        numbers: Array = np.clip(law.isf(at) if upper else law.ppf(at), *self.parameters[1:])
        return numbers

    def log_density(self, x: Array) -> Array:
        inner, low, high = self.parameters
        inside = inner.log_density(x) - math.log(self.acceptance())
        return np.where((x >= low) & (x <= high), inside, -np.inf)

    def _ends(self) -> tuple[Any, float, float, bool]:
        """Return (scipy's distribution, its probability at each bound, whether these are 1 - F).

        Above the median, 1 - F keeps the digits that F loses: F of a normal distribution truncated
        to more than 9 standard deviations would have no digits left.
        """
        inner, low, high = self.parameters
        law = inner.frozen()
        upper = bool(law.cdf(low) > 0.5)
        tail = law.sf if upper else law.cdf
        return law, float(tail(low)), float(tail(high)), upper

    def times(self, by: float) -> "Truncated":
        inner, low, high = self.parameters
        return Truncated(self.name, (inner.times(by), by * low, by * high))

    def as_table(self) -> dict[str, Any]:
        inner, low, high = self.parameters
        return {**inner.as_table(), "between": [low, high]}

    def words(self) -> str:
        inner, low, high = self.parameters
        return f"{inner.words()} between {low:g} and {high:g}"

    def between(self, low: float, high: float) -> Distribution:
        """Narrow the bounds; see `Distribution.between`."""
        inner, least, most = self.parameters
        cut: Distribution = inner.between(max(low, least), min(high, most))
        return cut


@dataclass(frozen=True)
class Common(Distribution):
    """A normal number whose random part is a combination of numbers z that are common to several,

        x = mean + a_1 z_1 + a_2 z_2 + ...

    parameters : (mean, a_1, a_2, ...)
    """

    stream: ClassVar[str] = "common"

    @property
    def uses_scipy(self) -> bool:
        return False

    def of_words(self, words: Array, own: int) -> Array:
        mean, *by = self.parameters
        numbers: Array = mean + sum(a * normal_quantile(words[k]) for k, a in enumerate(by) if a)
        return numbers

    def alone(self) -> Distribution:
        """Return the distribution of this number without the others."""
        mean, *by = self.parameters
        return Distribution("normal", (mean, math.hypot(*by)))

    def ppf(self, u: Array) -> Array:
        """Return the quantiles of this number alone."""
        return self.alone().ppf(u)

    def frozen(self) -> Any:
        return self.alone().frozen()

    def words(self) -> str:
        return f"{self.alone().words()}, correlated"

    def between(self, low: float, high: float) -> Distribution:
        """Raise SceneError: bounds would change the others, too."""
        shown = {**self.as_table(), "between": [low, high]}
        raise SceneError("a number in common has no bounds", at="between", value=shown)


def joint_log_density(laws: Sequence[Common], numbers: Sequence[Array]) -> Array:
    """Return the logarithms of the joint density (n,) of correlated numbers (n,); SceneError if
    some follow from the others."""
    away = [x - law.parameters[0] for law, x in zip(laws, numbers, strict=True)]
    by = np.array([*zip_longest(*(law.parameters[1:] for law in laws), fillvalue=0.0)]).T
    sizes = np.linalg.norm(by, axis=1)
    correlation = (by @ by.T) / np.outer(sizes, sizes)
    if np.linalg.eigvalsh(correlation)[0] < 1e-10:
        rule = "no density, since some of these numbers follow from the others"
        raise SceneError(rule, at="common")
    factor = np.linalg.cholesky(correlation) * sizes[:, None]
    z: Array = np.linalg.solve(factor, np.stack(away))
    normal = -0.5 * (np.square(z) + math.log(2.0 * math.pi)) - np.log(np.diag(factor))[:, None]
    return np.asarray(normal.sum(0))


def _scipy(name: str) -> Any:
    """Return the continuous distribution of scipy.stats with this name; None if there is none."""
    import scipy.stats

    family = getattr(scipy.stats, name, None)
    return family if isinstance(family, scipy.stats.rv_continuous) else None


def is_distribution(name: str) -> bool:
    """Return whether a distribution of this name exists."""
    return name in _RULES or _scipy(name) is not None


def normal(mean: Any, standard_deviation: Any) -> Distribution:
    """Make a normal distribution N(mean, standard_deviation^2).

    Parameters
    ----------
    mean : float, str or quantity
        mean, in units of the quantity; or with its unit, as "10 deg/s" or a quantity of pint or
        astropy
    standard_deviation : float, str or quantity
        standard deviation, positive, in the same units

    Returns
    -------
    Distribution
        the distribution from which each member draws a number

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


def uniform(low: Any, high: Any) -> Distribution:
    """Make a uniform distribution on (low, high).

    Parameters
    ----------
    low : float, str or quantity
        lower end, in units of the quantity; or with its unit, as "10 deg/s"
    high : float, str or quantity
        upper end, in the same units

    Returns
    -------
    Distribution
        the distribution from which each member draws a number

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


def common(mean: Any, *by: Any) -> Distribution:
    """Make a normal number that is correlated with others.

    With standard normal numbers z_k of each member, which all such numbers of a scene have in
    common::

        x = mean + by[0] z_1 + by[1] z_2 + ...

    The covariance of two of them is the sum of the products of their `by`. For a covariance C of
    several numbers, `by` are the rows of its Cholesky factor.

    Parameters
    ----------
    mean : float
        mean, in units of the quantity
    *by : float
        factors of z_1, z_2, ..., in the same units

    Returns
    -------
    Distribution
        the distribution from which each member draws a number

    Raises
    ------
    SceneError
        without a factor that is not 0

    Examples
    --------
    >>> mass, g = rm.common(2.0, 0.1), rm.common(9.81, 0.01, 0.02)  # correlation 0.45
    >>> rm.Body.from_moments((1.0, 1.0, 1.5), mass=mass).sample(0, 0, 3)[1].shape
    (3,)
    """
    return distribution("common", mean, *by)


def distribution(name: str, /, *values: Any, **parameters: Any) -> Distribution:
    """Make a distribution by its name.

    Parameters
    ----------
    name : str
        "normal", "uniform", "common", or a continuous distribution of scipy.stats
    *values : float, str or quantity
        (mean, sd) of "normal", (low, high) of "uniform", (mean, a_1, ...) of "common"
    **parameters : float, str or quantity
        keywords of a scipy.stats distribution: loc and scale, which may have a unit, and its shape
        parameters

    Returns
    -------
    Distribution
        the distribution from which each member draws a number

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
    if len(values) == 2 and not parameters:
        numbers, unit = common_unit(dict(zip(_NAMES.get(name, "ab"), values, strict=True)), name)
        if unit:
            return Measured(distribution(name, *numbers.values()), unit)  # type: ignore[return-value]
    elif name not in _RULES:
        lengths: dict[str, Any] = {k: v for k, v in parameters.items() if k in ("loc", "scale")}
        numbers, unit = common_unit(lengths, name)
        if unit:
            made = distribution(name, *values, **{**parameters, **numbers})
            return Measured(made, unit)  # type: ignore[return-value]
    shown = {name: list(values) or parameters}
    if name not in _RULES:
        return _by_scipy(name, shown, parameters if not values else None)
    plain = len(values) >= 2 and not parameters and all(map(is_number, values))
    if name == "common" and plain and any(values[1:]):
        return Common(name, tuple(map(float, values)))
    plain = plain and len(values) == 2 and name != "common"
    if not plain or not values[1] > (values[0] if name == "uniform" else 0.0):
        raise SceneError(_RULES[name], at="distribution", value=shown)
    return Distribution(name, tuple(float(v) for v in values))


def _by_scipy(name: str, shown: Any, parameters: Mapping[str, float] | None) -> Distribution:
    """Return a distribution of scipy.stats; SceneError."""
    family = _scipy(name)
    if family is None:
        import scipy.stats

        continuous = [word for word in dir(scipy.stats) if _scipy(word) is not None]
        error = unknown("distribution", [*_RULES, *continuous], at="distribution", value=name)
        error.rule = (
            "no such distribution; known: normal = [mean, sd], uniform = [low, high], and the"
            " continuous distributions of scipy.stats"
        )
        raise error
    shapes = [word.strip() for word in (family.shapes or "").split(",") if word.strip()]
    allowed = [*shapes, "loc", "scale"]
    numbers = parameters is not None and all(is_number(v) for v in parameters.values())
    if parameters is None or not numbers or not parameters.keys() <= set(allowed):
        rule = f"scipy's {name} needs a table of numbers with the keys {', '.join(allowed)}"
        raise SceneError(rule, at="distribution", value=shown)
    missing = [word for word in shapes if word not in parameters]
    law = Distribution(name, tuple((key, float(value)) for key, value in parameters.items()))
    if missing or not np.isfinite(law.ppf(np.array([0.25, 0.75]))).all():
        what = ", ".join(missing) or "a parameter"
        rule = f"{what} is missing or outside the domain of the distribution"
        raise SceneError(rule, at="distribution", value=shown)
    return law
