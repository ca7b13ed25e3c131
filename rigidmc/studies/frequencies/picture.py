"""The picture of a frequency analysis: a frequency map, or the diffusion over two parameters."""

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from rigidmc.errors import OptionError, nearest
from rigidmc.inputs.arrays import Array
from rigidmc.results.labels import in_symbols, label_of, with_degrees
from rigidmc.views.figures import LIGHT, VALUES, figure_of, new_figure

LOWEST = 1e-14  # changes below it are rounding, and drawn as this
FREQUENCY = "frequency[1]"


def frequency_map(
    study: xr.Dataset, x: str | None = None, y: str | None = None, figure: Figure | None = None
) -> Figure:
    """Draw members in the plane of two quantities, coloured by the change of their frequency.

    study : the Dataset of `rigidmc.frequencies`
    x, y : such as "start_omega[3]", "frequency[2]" or "amplitude[1]"; by default the parameter of
        the start that differs most between members, and the first frequency

    Dark members are regular, bright ones chaotic. Raises OptionError for a quantity that the study
    does not have.
    """
    study = with_degrees(
        study, *(str(n) for n, variable in study.data_vars.items() if variable.dtype == "f8")
    )
    quantities = _quantities(study)
    spread = {
        # avoid division by zero for values that are all 0
        name: np.ptp(v) / (np.abs(v).max() or 1.0)
        for name, v in quantities.items()
        if name.startswith("start_")
    }
    names = x or max(spread, key=lambda name: spread[name], default=FREQUENCY), y or FREQUENCY
    for name in names:
        if name not in quantities:
            rule = f"is not a quantity of the study; known: {', '.join(quantities)}"
            raise OptionError(rule, at="x and y", value=name, nearest=nearest(name, quantities))
    good = study.status.values == 0
    title = f"{study.attrs['title']}: frequencies of {in_symbols(study.attrs['of'])}"
    figure = figure or new_figure(title, (7.4, 5.4))
    axes = figure.add_subplot()
    change = np.log10(np.maximum(study.change.values[good], LOWEST))
    order = np.argsort(change)
    across, up = (quantities[name][good][order] for name in names)
    size = float(np.clip(60000.0 / max(1, good.sum()), 1.0, 40.0))  # [pt2] of 130,000
    dots = axes.scatter(
        across, up, s=size, c=change[order], marker="s", cmap=VALUES, vmin=-12.0, vmax=0.0,
        linewidths=0.0, rasterized=True,
    )  # fmt: skip
    axes.set_xlabel(label_of(study, names[0]))
    axes.set_ylabel(label_of(study, names[1]))
    axes.grid(True, lw=0.3, color=LIGHT)
    axes.set_axisbelow(True)
    bar = figure.colorbar(dots, ax=axes, extend="min")
    bar.set_label("log₁₀ of the relative change of ν₁ between the halves")
    return figure_of(axes)


def _quantities(study: xr.Dataset) -> dict[str, Array]:
    """Return {name: values} of all quantities of the members."""
    quantities: dict[str, Array] = {}
    for name, variable in study.data_vars.items():
        if name in ("status", "change", "why") or variable.ndim > 2:
            continue
        dim = next((d for d in variable.dims if d != "member"), None)
        if "member" not in variable.dims:
            variable = variable.broadcast_like(study.status)
        if dim is None:
            quantities[str(name)] = variable.values
        else:
            quantities |= {
                f"{name}[{v.item()}]": variable.sel({dim: v}).values for v in variable[dim].values
            }
    return quantities
