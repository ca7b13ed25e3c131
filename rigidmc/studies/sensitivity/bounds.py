"""Upper bounds of total Sobol indices from derivatives of members.

With the variance V of Y, and the derivatives of members by their own number X_k::

    total_k <= bound_k = C_k <(dY/dX_k)^2> / V

C_k is the Poincare constant of the distribution of X_k, the least for which
``Var f(X_k) <= C_k <f'(X_k)^2>`` holds for every f. The bound is equal to the total index if Y is
linear in a normal X_k.
Source: Sobol & Kucherenko, Math. Comput. Simul. 79 (2009) 3009; Lamboni et al., Math. Comput.
Simul. 87 (2013) 45; Roustant, Barthe & Iooss, Electron. J. Stat. 11 (2017) 3081.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr

from rigidmc.errors import OptionError
from rigidmc.inputs.arrays import Array
from rigidmc.planning.initial import uncertain_numbers
from rigidmc.scene.derivatives import derivative_name, parameter_names_of_derivatives
from rigidmc.scene.distributions import Common, Distribution, Truncated
from rigidmc.scene.model import Model
from rigidmc.scene.parameters import value_at
from rigidmc.scene.scene import Scene
from rigidmc.statistics.measures import Measure


def constants(model: Model) -> dict[str, float]:
    """Return {uncertain parameter: Poincare constant of its distribution}, for those by which
    members have derivatives and whose constant is known."""
    able = set(parameter_names_of_derivatives(model))
    names = [name for name in uncertain_numbers(model)[0] if name in able]
    values = {name: poincare_constant(value_at(model, name)) for name in names}
    return {name: value for name, value in values.items() if value == value}


def poincare_constant(law: Any) -> float:
    """Return the Poincare constant of a distribution, in units of the number squared; nan if it is
    not known.

    A normal distribution truncated to (a, b) has at most that of the whole one, and at most
    ``(b - a)^2/pi^2``, as every log-concave density.
    Source: Roustant, Barthe & Iooss, table 1; Payne & Weinberger, Arch. Ration. Mech. Anal. 5
    (1960) 286.
    """
    if isinstance(law, Truncated):
        inner, low, high = law.parameters
        if inner.name not in ("normal", "norm"):
            return math.nan
        return min(poincare_constant(inner), float((high - low) / math.pi) ** 2)
    if not isinstance(law, Distribution) or isinstance(law, Common):
        return math.nan
    if law.name == "normal":
        return float(law.parameters[1]) ** 2
    if law.name == "uniform":
        low, high = law.parameters
        return float((high - low) / math.pi) ** 2
    factor = {"norm": 1.0, "expon": 4.0, "laplace": 4.0}.get(law.name, math.nan)
    return factor * float(dict(law.parameters).get("scale", 1.0)) ** 2


def with_derivatives(scene: Scene, measures: Sequence[Measure]) -> Scene:
    """Return the scene that also differentiates its members by their uncertain parameters;
    OptionError for a measure without derivatives."""
    able = scene.recording.differentiable
    for measure in measures:
        result = measure.result
        smooth = result.name in able and not result.timed  # times of events jump
        if measure.kind != "mean" or measure.given is not None or not smooth:
            rule = (
                "has no derivatives of members, and so no bounds: use the mean of a smooth quantity"
                " over all members, such as mean(omega_last[3]) or mean(energy_mean)"
            )
            raise OptionError(rule, at="of", value=measure.text)
    if not (names := constants(scene.model)):
        rule = "no uncertain parameter has a bound: use normal or uniform distributions"
        raise OptionError(rule, at="bounds", value=True)
    return scene.with_run(wrt=tuple(names))


def squared_rates(part: xr.Dataset, measure: Measure, names: Sequence[str]) -> Array:
    """Return the squared derivatives of a measure of members by parameters (parameters, members),
    nan for flagged members; OptionError if the result lacks them."""
    name = derivative_name(measure.result.name)
    has = set(map(str, part.parameter.values)) if "parameter" in part.coords else set()
    if name not in part or not has >= set(names):
        rule = f"the result has no {name}: run it with --wrt {','.join(names)}"
        raise OptionError(rule, at="bounds", value=True)
    rates = part[name].sel(parameter=list(names)).transpose("parameter", ..., "member").values
    axis = measure.result.axis
    rates = rates if axis is None else rates[:, axis - 1]
    return np.where(part.status.values == 0, rates * rates, np.nan)
