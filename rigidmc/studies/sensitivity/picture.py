"""The picture of a sensitivity study: the uncertain parameters that matter."""

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rigidmc.inputs.arrays import Array
from rigidmc.results.labels import in_symbols
from rigidmc.views.figures import CORE, INK, LIGHT, MEDIAN, figure_of, legend_above, new_figure


def sensitivity_bars(study: xr.Dataset, figure: Figure | None = None) -> Figure:
    """Draw the fraction of the variance of each measure that a parameter causes alone, and together
    with others, with intervals, and upper bounds of the latter; the most important parameter is at
    the top.

    study : the Dataset of `rigidmc.sensitivity`
    """
    count, numbers = study.sizes["measure"], study.sizes["number"]
    title = f"{study.attrs['title']}: which uncertain parameter matters"
    size = 8.0, count * (1.2 + 0.5 * numbers) + 0.8
    figure = figure or new_figure(title, size)
    for i, text in enumerate(study.measure.values):
        rows = study.sel(measure=text)
        rows = rows.isel(number=np.argsort(rows.total.values, kind="stable"))
        axes = figure.add_subplot(count, 1, i + 1)
        for name, shift, colour, label in (
            ("first", 0.2, MEDIAN, "alone"),
            ("total", -0.2, CORE, "together with others"),
        ):
            value = rows[name].values
            ends = np.abs(np.stack([rows[f"{name}_low"] - value, rows[f"{name}_high"] - value]))
            places = np.arange(numbers) + shift
            axes.barh(places, np.maximum(value, 0.0), 0.36, color=colour, label=label)
            axes.errorbar(value, places, xerr=ends, fmt="none", ecolor=INK, lw=1.0, capsize=2.0)
        axes.set_yticks(np.arange(numbers), [in_symbols(str(name)) for name in rows.number.values])
        limit = max(1.0, 1.05 * float(rows.total_high.max()))
        axes.set_xlim(0.0, limit)
        if "bound" in rows:
            _draw_bounds(axes, rows.bound.values, limit)
        axes.set_xlabel(f"{in_symbols(text)}: fraction of the variance between members")
        axes.grid(True, axis="x", lw=0.3, color=LIGHT)
        axes.set_axisbelow(True)
        legend_above(axes, 3 if "bound" in rows else 2)
    return figure_of(axes)


def _draw_bounds(axes: Axes, bounds: Array, limit: float) -> None:
    """Mark upper bounds beside the total indices; those beyond the axis by arrows at its end."""
    places = np.arange(bounds.size) - 0.2
    inside, label = bounds <= limit, "at most, by derivatives"
    axes.plot(bounds[inside], places[inside], "D", color=INK, mfc="white", ms=5, label=label)
    beyond = places[bounds > limit]
    axes.plot(np.full(beyond.size, limit), beyond, ">", color=INK, ms=6, clip_on=False)
