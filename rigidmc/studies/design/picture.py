"""The picture of a design: the standard deviation over the duration of a measurement."""

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from rigidmc.results.labels import in_symbols, long_label, with_units
from rigidmc.views.figures import COLOURS, DASHES, GREY, MARKERS, figure_of, new_figure


def deviation_over_duration(study: xr.Dataset) -> Figure:
    """Draw a line for each start, by its colour and marker, and each sensor, by its dashes."""
    of = study.sel(quantity=study.attrs["of"])
    figure = new_figure(f"{study.attrs['title']}: what measurements show", (7.0, 4.8))
    axes = figure.add_subplot()
    for i, j in np.ndindex(study.sizes["start"], study.sizes["sensor"]):
        each = of.isel(start=i, sensor=j)
        words = [str(each.sensor.item()), str(each.start.item())][: 1 + (study.sizes["start"] > 1)]
        words += ["not shown"] * bool(np.isinf(each.deviation).all())
        axes.plot(
            each.duration, each.deviation.where(np.isfinite), DASHES[j % len(DASHES)], lw=1.3,
            marker=MARKERS[i % len(MARKERS)], mfc="none", color=COLOURS[3 * i % len(COLOURS)],
            label=", ".join(words),
        )  # fmt: skip
    if "reach" in study.attrs:
        axes.axhline(study.attrs["reach"], lw=0.8, color=GREY, label="to reach")
    label = f"standard deviation of {in_symbols(study.attrs['of'])}"
    axes.set(xscale="log", yscale="log", xlabel=long_label(study.duration))
    axes.set_ylabel(with_units(label, str(of.unit.item())))
    times = study.duration.values[:: 1 + study.sizes["duration"] // 10]
    axes.set_xticks(times, [f"{t:g}" for t in times])
    axes.xaxis.minorticks_off()
    figure.legend(loc="outside lower center", ncols=1, fontsize=8, frameon=False)
    return figure_of(axes)
