"""The picture of a spectrum: exponents and indices of chaos over time."""

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from rigidmc.results.labels import in_symbols, long_label
from rigidmc.views.figures import COLOURS, LIGHT, MARKERS, figure_of, legend_above, new_figure

LOWEST = 1e-32  # indices below it are drawn as this


def lyapunov_spectrum(study: xr.Dataset, figure: Figure | None = None) -> Figure:
    """Draw the median of each exponent, and of SALI and GALI_k, over time, with the middle half of
    the members.

    study : the Dataset of `rigidmc.lyapunov`

    Exponents of regular motions fall as 1/t and cross to the other side; indices of chaotic motions
    fall exponentially.
    """
    figure = figure or new_figure(f"{study.attrs['title']}: Lyapunov spectrum", (10.0, 4.6))
    left, right = figure.subplots(1, 2)
    for place, i in enumerate(study.exponent.values):
        _draw(left, study.exponents.sel(exponent=i), in_symbols(f"lambda[{i}]"), place)
    left.set_ylabel(long_label(study.exponents))
    _draw(right, np.maximum(study.sali, LOWEST), "SALI", 0)
    for place, k in enumerate(study.k.values):
        _draw(right, np.maximum(study.gali.sel(k=k), LOWEST), f"GALI {k}", place + 1)
    right.set_yscale("log")
    right.set_ylabel("alignment index")
    for axes in (left, right):
        legend_above(axes, 6)
        axes.set_xlabel(long_label(study.time))
        axes.grid(True, lw=0.3, color=LIGHT)
    return figure_of(left)


def _draw(axes: Any, values: xr.DataArray, label: str, place: int) -> None:
    """Draw the quartiles of values (time, member) over time, in the colour and with the marker of a
    place."""
    rows = values.transpose("time", "member").values
    has_values = np.isfinite(rows).any(axis=1)
    if not has_values.any():
        return
    low, middle, high = np.nanquantile(rows[has_values], [0.25, 0.5, 0.75], axis=1)
    times = values.time.values[has_values]
    colour, marked = COLOURS[place], (0.02 * place, 0.15)  # of the length of the axes
    style = {"marker": MARKERS[place], "markevery": marked, "ms": 4.0, "lw": 1.2}
    axes.plot(times, middle, color=colour, label=label, **style)
    axes.fill_between(times, low, high, color=colour, alpha=0.15, lw=0.0)
