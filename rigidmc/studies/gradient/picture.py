"""The picture of a gradient: derivatives with intervals, a panel per measure."""

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from rigidmc.results.labels import in_symbols, with_units
from rigidmc.scene.derivatives import quotient
from rigidmc.views.figures import COLOURS, GREY, figure_of, new_figure


def gradient_bars(study: xr.Dataset, figure: Figure | None = None) -> Figure:
    """Draw the derivatives of each measure with their intervals, a panel per measure; those by the
    likelihood ratio are hollow. Parameters differ in units, which stand beside their names."""
    count, names = study.sizes["measure"], [str(n) for n in study.parameter.values]
    figure = figure or new_figure(study.attrs["title"], (8.2, 1.4 + 0.5 * count * (1 + len(names))))
    places = -np.arange(len(names), dtype=float)
    for i, text in enumerate(map(str, study.measure.values)):
        row = study.isel(measure=i)
        axes = figure.add_subplot(count, 1, i + 1)
        values = row.derivative.values
        ends = np.stack([values - row.derivative_low.values, row.derivative_high.values - values])
        ends = np.where(np.isfinite(ends), ends, 0.0)
        colour = COLOURS[i % len(COLOURS)]
        axes.errorbar(values, places, xerr=ends, fmt="none", color=colour, capsize=3)
        for j, method in enumerate(row.method.values):
            face = "none" if method == "score" else colour
            axes.plot(values[j], places[j], "o", color=colour, mfc=face)
        axes.axvline(0.0, lw=0.5, color=GREY)
        unit = str(row.unit.item())
        units = [quotient(unit, str(by)) for by in study.parameter_unit.values]
        labels = [with_units(in_symbols(n), by) for n, by in zip(names, units, strict=True)]
        axes.set_yticks(places, labels)
        axes.set_ylim(places[-1] - 0.6, 0.6)
        axes.set_xlabel(f"derivative of {in_symbols(text)}")
        axes.set_ylabel("parameter")
    return figure_of(axes)
