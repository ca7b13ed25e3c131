"""Derivatives of drawn numbers by the parameters of their distribution, at fixed random numbers.

A number x with distribution function F(x; p) is drawn as F(x; p) = u. At fixed u (the
reparametrisation of Kingma & Welling, Auto-Encoding Variational Bayes, 2014):

    dx/dp = -(dF/dp)/(dF/dx)

so x = mean + sd z has the derivatives 1 and z. A truncated number, F(x) = F(a) + u (F(b) - F(a)),
has for a parameter by which untruncated numbers x move at the rate s(x)

    dx/dp = s(x) - (1 - u) s(a) f(a)/f(x) - u s(b) f(b)/f(x)

with the density f, and dx/da = (1 - u) f(a)/f(x), dx/db = u f(b)/f(x).
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from rigidmc.inputs.arrays import Array
from rigidmc.physics.dynamics.functions import normal_quantile
from rigidmc.scene.distributions import Common, Distribution, Truncated
from rigidmc.scene.mixtures import Mixture
from rigidmc.scene.quantities import Drawn, Grid, Rate

Refusal = str  # the reason why there is no derivative
Quantile = Callable[[Array, Array], Any]  # rate of the numbers x = F^-1(u), a function of (u, x)


def own_number(drawn: Drawn) -> Any:
    """Return the derivative of the members' numbers by themselves, 1."""
    return np.ones_like(drawn.values)


def rates_of(quantity: Any) -> dict[str, Rate | Refusal]:
    """Return {parameter: Rate, or the reason why there is none} of a distribution or a grid; {} for
    a number or an array.

    The names are the arguments of its maker: mean and standard_deviation, low and high, loc and
    scale; between.1 and between.2 for the bounds of a truncated distribution; in a mixture they
    follow the number of the component, as in 2.mean.
    """
    if isinstance(quantity, Grid):
        return {name: _of_grid(quantity, name) for name in ("low", "high")} | dict.fromkeys(
            ("count", "stride"), "is an integer"
        )
    if isinstance(quantity, Distribution):
        return {name: _of_draw(rate) for name, rate in _quantiles(quantity).items()}
    return {}


def _of_draw(rate: Quantile | Refusal) -> Rate | Refusal:
    if isinstance(rate, str):
        return rate

    def derivative(drawn: Drawn) -> Any:
        assert drawn.words is not None
        return rate(drawn.words[drawn.own], drawn.values)

    return derivative


def _of_grid(grid: Grid, name: str) -> Rate:
    def derivative(drawn: Drawn) -> Any:
        share = grid.shares(drawn.first, drawn.values.size)
        share = share if name == "high" else 1.0 - share
        # log-spaced: low^(1 - share) high^share
        return share * drawn.values / getattr(grid, name) if grid.log else share

    return derivative


def _quantiles(law: Distribution) -> dict[str, Quantile | Refusal]:
    """Return the rates of the numbers of a distribution by each of its parameters."""
    if isinstance(law, Mixture):
        return _of_mixture(law)
    if isinstance(law, Truncated):
        return _of_truncated(law)
    if law.name == "normal":
        return {
            "mean": lambda u, x: np.ones_like(x),
            "standard_deviation": lambda u, x: normal_quantile(u),
        }
    if isinstance(law, Common):
        return {"mean": lambda u, x: np.ones_like(x)}
    if law.name == "uniform":
        return {"low": lambda u, x: 1.0 - u, "high": lambda u, x: u}
    parameters = {"loc": 0.0, "scale": 1.0} | dict(law.parameters)
    loc, scale = parameters["loc"], parameters["scale"]
    shapes = {
        name: f"is a shape parameter of {law.name}: scipy has no derivatives by it"
        for name in parameters
        if name not in ("loc", "scale")
    }
    return {"loc": lambda u, x: np.ones_like(x), "scale": lambda u, x: (x - loc) / scale, **shapes}


def _of_truncated(law: Truncated) -> dict[str, Quantile | Refusal]:
    inner, low, high = law.parameters
    frozen = inner.frozen()

    def ratio(bound: float, x: Array) -> Any:
        """Return f(bound)/f(x)."""
        if not np.isfinite(bound):
            return np.zeros_like(x)
        with np.errstate(over="ignore"):
            return np.exp(frozen.logpdf(bound) - frozen.logpdf(x))

    def moved(rate: Quantile) -> Quantile:
        def at(bound: float) -> Any:
            if not np.isfinite(bound):
                return 0.0
            return rate(frozen.cdf(bound), np.array(bound))

        def total(u: Array, x: Array) -> Any:
            ends = (1.0 - u) * at(low) * ratio(low, x) + u * at(high) * ratio(high, x)
            return rate(u, x) - ends

        return total

    rates: dict[str, Quantile | Refusal] = {
        name: rate if isinstance(rate, str) else moved(rate)
        for name, rate in _by_place(inner).items()
    }
    rates["between.1"] = lambda u, x: (1.0 - u) * ratio(low, x)
    rates["between.2"] = lambda u, x: u * ratio(high, x)
    return rates


def _by_place(law: Distribution) -> dict[str, Quantile | Refusal]:
    """Return `_quantiles` with rates that depend on x alone, not on its probability."""
    if law.name != "normal":
        return _quantiles(law)
    mean, sd = law.parameters
    return {
        "mean": lambda u, x: np.ones_like(x),
        "standard_deviation": lambda u, x: (x - mean) / sd,
    }


def _of_mixture(law: Mixture) -> dict[str, Quantile | Refusal]:
    def inside(i: int, rate: Quantile) -> Quantile:
        def of_component(u: Array, x: Array) -> Any:
            which, inside_u = law.components(u)
            rates_of_all, here = np.zeros_like(x), which == i
            rates_of_all[here] = rate(inside_u[here], x[here])
            return rates_of_all

        return of_component

    rates: dict[str, Quantile | Refusal] = {}
    for i, (_, part) in enumerate(law.parameters):
        rates[f"{i + 1}.weight"] = (
            "is a weight: at fixed random numbers, members jump from one component to another"
        )
        for name, rate in _quantiles(part).items():
            rates[f"{i + 1}.{name}"] = rate if isinstance(rate, str) else inside(i, rate)
    return rates
