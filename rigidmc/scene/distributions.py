"""Distributions of one number: by name, truncated, and mixtures of several.

Numbers are drawn by inverting the distribution function, so that any point set in (0, 1) can drive
it.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigidmc.dynamics.functions import normal_quantile
from rigidmc.errors import SceneError, unknown

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Distribution:
    """A probability distribution of one number.

    name : "normal", "uniform", or a continuous distribution of scipy.stats
    parameters : (mean, standard deviation), (low, high), or pairs (keyword, value) for scipy

    Numbers are drawn by inverting the distribution function, so that any point set in (0, 1) can
    drive it.
    """

    name: str
    parameters: tuple[Any, ...]

    @property
    def by_scipy(self) -> bool:
        """Whether scipy computes the quantiles; another version of scipy may round differently."""
        return self.name not in ("normal", "uniform")

    def ppf(self, u: Array) -> Array:
        """Quantiles of u, an array in (0, 1)."""
        if self.by_scipy:
            quantiles: Array = _scipy(self.name)(**dict(self.parameters)).ppf(u)
            return quantiles
        a, b = map(float, self.parameters)
        return a + b * normal_quantile(u) if self.name == "normal" else a + (b - a) * u

    def times(self, by: float) -> "Distribution":
        """The distribution of the number times a positive factor."""
        if not self.by_scipy:
            return Distribution(self.name, tuple(by * p for p in self.parameters))
        parameters = {"loc": 0.0, "scale": 1.0} | dict(self.parameters)
        parameters["loc"] *= by
        parameters["scale"] *= by
        return Distribution(self.name, tuple(parameters.items()))

    def as_table(self) -> dict[str, Any]:
        """The distribution as it is written in a scene file."""
        return {self.name: dict(self.parameters) if self.by_scipy else list(self.parameters)}


def _scipy(name: str) -> Any:
    """A continuous distribution of scipy.stats; None if it has none of that name."""
    import scipy.stats

    family = getattr(scipy.stats, name, None)
    return family if isinstance(family, scipy.stats.rv_continuous) else None


def is_distribution(name: str) -> bool:
    """Whether there is a distribution of that name."""
    return name in ("normal", "uniform") or _scipy(name) is not None


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
    if name not in ("normal", "uniform"):
        return _scipy_distribution(name, given, parameters if not values else None)
    allowed = len(values) == 2 and not parameters and all(is_number(v) for v in values)
    if name == "normal" and not (allowed and values[1] > 0):
        rule = "expected normal = [mean, standard deviation > 0], finite numbers"
        raise SceneError("", "distribution", given, rule)
    if name == "uniform" and not (allowed and values[1] > values[0]):
        rule = "expected uniform = [low, high] with low < high, finite numbers"
        raise SceneError("", "distribution", given, rule)
    return Distribution(name, tuple(float(v) for v in values))


def _scipy_distribution(
    name: str, given: dict[str, Any], parameters: Mapping[str, float] | None
) -> Distribution:
    """A distribution of scipy.stats; SceneError."""
    family = _scipy(name)
    if family is None:
        import scipy.stats

        known = [word for word in dir(scipy.stats) if _scipy(word) is not None]
        error = unknown("", "distribution", name, "distribution", ["normal", "uniform", *known])
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
        raise SceneError("", "distribution", given, rule)
    missing = [word for word in shapes if word not in parameters]
    law = Distribution(name, tuple((key, float(value)) for key, value in parameters.items()))
    if missing or not np.isfinite(law.ppf(np.array([0.25, 0.75]))).all():
        what = ", ".join(missing) or "a parameter"
        rule = f"{what} is missing or outside the domain of the distribution"
        raise SceneError("", "distribution", given, rule)
    return law


def is_number(value: Any) -> bool:
    known = isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool)
    return known and math.isfinite(value)
