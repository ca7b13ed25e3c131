"""The picture of a study of basins: the end of each start, and the uncertain fraction."""

from textwrap import fill

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rigidmc.results.labels import in_degrees, in_symbols, with_units
from rigidmc.studies.basins.study import basin_names, fitted_line
from rigidmc.views.figures import CORE, INK, LIGHT, MARKERS, MEDIAN, PATH, legend_above, new_figure

BASINS = (MEDIAN, "#fdd49e", PATH, CORE, "#777777", "#2a9d6f")  # dark and light in turn


def basins_and_shares(study: xr.Dataset, figure: Figure | None = None) -> Figure:
    """Draw the uncertain fraction against the distance, with the line of slope alpha; for a scene
    with two uncertain parameters, also the basins in their plane.

    study : the Dataset of `rigidmc.basins`
    """
    plane = study.sizes["number"] == 2 and bool(np.isfinite(study.start.values).any(axis=0).all())
    title = f"{study.attrs['title']}: basins and uncertain fraction"
    figure = figure or new_figure(title, (11.5, 5.2) if plane else (6.6, 5.2))
    panels = figure.subplots(1, 1 + plane, squeeze=False)[0]
    if plane:
        _plane(panels[0], study)
    _shares(panels[-1], study)
    return figure


def _plane(axes: Axes, study: xr.Dataset) -> None:
    """Draw the starts, coloured by the basin in which they end."""
    basin, start = study.basin.values, study.start.values
    size = float(np.clip(60000.0 / max(1, basin.size), 1.0, 40.0))  # [pt2] of 130,000
    (across, unit), (up, other) = (
        in_degrees(start[:, k], str(study.units.values[k])) for k in range(2)
    )
    for i, (number, text) in enumerate(basin_names(study).items()):
        there = basin == number
        axes.scatter(
            across[there], up[there], s=size, marker="s", linewidths=0.0,
            color=BASINS[i % len(BASINS)], rasterized=True,
            label=fill(f"{in_symbols(text)}: {there.mean():.1%}", 50),
        )  # fmt: skip
    names = [in_symbols(str(name)) for name in study.number.values]
    axes.set(xlabel=with_units(names[0], unit), ylabel=with_units(names[1], other))
    legend_above(axes, 1)


def _shares(axes: Axes, study: xr.Dataset) -> None:
    """Draw the uncertain fraction against the distance."""
    there = study.uncertain.values > 0.0
    distance, share = study.distance.values[there], study.uncertain.values[there]
    ends = [np.abs(study[f"uncertain_{end}"].values[there] - share) for end in ("low", "high")]
    axes.errorbar(
        distance, share, yerr=ends, fmt=MARKERS[0], ms=5.0, color=MEDIAN, ecolor=INK, lw=1.0,
        capsize=2.0, label="fraction of starts",
    )  # fmt: skip
    alpha = float(study.alpha)
    if np.isfinite(alpha):
        half = 0.5 * float(study.alpha_high - study.alpha_low)
        words = f"ε^α, α = {alpha:.3f} ± {half:.3f}"
        axes.plot(distance, fitted_line(study)[there], color=PATH, lw=1.6, label=words)
    axes.axhline(study.attrs["largest"], color=INK, ls="--", lw=1.0, label="independent ends")
    axes.set(xscale="log", yscale="log")
    axes.set_ylim(top=1.2 * study.attrs["largest"])
    axes.set_xlabel("distance ε between two starts, in probability")
    axes.set_ylabel("uncertain fraction")
    axes.grid(True, which="both", lw=0.3, color=LIGHT)
    axes.set_axisbelow(True)
    legend_above(axes, 3)
