"""Mixtures of distributions: each member draws from one of several."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from rigidmc.errors import SceneError
from rigidmc.scene.distributions import Array, Distribution, is_number


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
    def by_scipy(self) -> bool:
        """Whether scipy computes quantiles of a part."""
        return any(law.by_scipy for _, law in self.parameters)

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
        least: float = min(law.least() for _, law in self.parameters)
        return least

    def between(self, low: float, high: float) -> Distribution:
        """Refused: a mixture has no quantiles in closed form."""
        given = {**self.as_table(), "between": [low, high]}
        raise SceneError("", "between", given, "give the bounds to the parts of the mixture")


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
    known = all(
        is_number(weight) and weight > 0 and isinstance(law, Distribution) for weight, law in pairs
    )
    if not known or len(pairs) != len(parts) or len(parts) < 2:
        raise SceneError("", "mixture", [str(part) for part in parts], rule)
    return Mixture("mixture", tuple((float(weight), law) for weight, law in pairs))
