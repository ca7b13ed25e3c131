"""Mixtures: numbers that one of several distributions draws, each with its weight."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from rigidmc.errors import SceneError
from rigidmc.inputs.arrays import Array, Ints, is_number
from rigidmc.inputs.measured import Measured
from rigidmc.scene.distributions import Common, Distribution


@dataclass(frozen=True)
class Mixture(Distribution):
    """A mixture of several distributions, each with a weight.

    parameters : pairs (weight, distribution)
    """

    def shares(self) -> Array:
        """Return the weights, divided by their sum."""
        weights = [weight for weight, _ in self.parameters]
        return np.array(weights) / math.fsum(weights)

    @property
    def uses_scipy(self) -> bool:
        """Whether scipy computes quantiles of a component."""
        return any(law.uses_scipy for _, law in self.parameters)

    def ppf(self, u: Array) -> Array:
        """Return a number for each u, an array in (0, 1): u selects a component and its quantile.

        The numbers follow the mixture, but are not its quantiles.
        """
        which, inside = self.components(u)
        values = np.empty_like(u)
        for i, (_, law) in enumerate(self.parameters):
            values[which == i] = law.ppf(inside[which == i])
        return values

    def components(self, u: Array) -> tuple[Ints, Array]:
        """Return for each u the index of its component, and the probability of its quantile."""
        shares = self.shares()
        ends = np.cumsum(shares)
        which = np.minimum(np.searchsorted(ends, u, side="right"), len(shares) - 1)
        inside = (u - (ends - shares)[which]) / shares[which]
        # rounding may reach an end of (0, 1)
        return which, np.clip(inside, 0.5**53, 1.0 - 0.5**53)

    def log_density(self, x: Array) -> Array:
        pairs = zip(np.log(self.shares()), self.parameters, strict=True)
        parts = [share + law.log_density(x) for share, (_, law) in pairs]
        return np.asarray(np.logaddexp.reduce(parts))

    def times(self, by: float) -> "Mixture":
        return Mixture(self.name, tuple((w, law.times(by)) for w, law in self.parameters))

    def as_table(self) -> dict[str, Any]:
        parts = [{"weight": weight, **law.as_table()} for weight, law in self.parameters]
        return {"mixture": parts}

    def words(self) -> str:
        pairs = zip(self.shares(), self.parameters, strict=True)
        return " or ".join(f"{share:.3g} {law.words()}" for share, (_, law) in pairs)

    def least(self) -> float:
        """Return the smallest value of `least` over the components."""
        return min(float(law.least()) for _, law in self.parameters)

    def between(self, low: float, high: float) -> Distribution:
        """Raise SceneError: a mixture has no quantiles in closed form."""
        shown = {**self.as_table(), "between": [low, high]}
        rule = "truncate the components of the mixture instead"
        raise SceneError(rule, at="between", value=shown)


def mixture(*parts: tuple[float, Distribution]) -> Distribution:
    """Make a mixture of distributions.

    Its density is sum_k w_k f_k, with the weights divided by their sum.

    Parameters
    ----------
    *parts : tuple (float, Distribution)
        positive weight and distribution of each component; at least two

    Returns
    -------
    Distribution
        the distribution from which each member draws a number

    Raises
    ------
    SceneError
        for fewer than two components, a nonpositive weight, or a component that is not a
        distribution

    Examples
    --------
    >>> two = rm.mixture((9.0, rm.normal(0.0, 0.01)), (1.0, rm.uniform(-1.0, 1.0)))
    >>> two.ppf(np.array([0.45, 0.975])).round(6).tolist()  # 0.975: at 3/4 of the second component
    [0.0, 0.5]
    """
    rule = "expected two or more components, each a weight > 0 and a distribution"
    pairs = [part for part in parts if isinstance(part, (tuple, list)) and len(part) == 2]
    components: Any = pairs
    measured = [law for _, law in components if isinstance(law, Measured)]
    if measured:
        if len(measured) < len(parts) or len({law.unit for law in measured}) > 1:
            rule = "the components of a mixture must have one unit; in a file, give it beside them"
            raise SceneError(rule, at="mixture")
        made = mixture(*((weight, law.value) for weight, law in components))
        return Measured(made, measured[0].unit)  # type: ignore[return-value]
    are_laws = all(is_number(w) and w > 0 and isinstance(law, Distribution) for w, law in pairs)
    are_laws = are_laws and not any(isinstance(law, Common) for _, law in pairs)
    if not are_laws or len(pairs) != len(parts) or len(parts) < 2:
        raise SceneError(rule, at="mixture", value=[str(part) for part in parts])
    return Mixture("mixture", tuple((float(weight), law) for weight, law in pairs))
