"""The picture of a spectrum: exponents and indices of chaos over time."""

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from rigidmc.figures import COLOURS, LIGHT, figure_of, new_figure
from rigidmc.results.labels import long_label

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
    for i, colour in zip(study.exponent.values, COLOURS, strict=False):
        _draw(left, study.exponents.sel(exponent=i), f"{i}", colour)
    left.set_ylabel(long_label(study.exponents))
    left.legend(title="exponent", fontsize=8, ncols=2)
    _draw(right, study.sali, "SALI", COLOURS[0])
    for k, colour in zip(study.k.values, COLOURS[1:], strict=False):
        _draw(right, study.gali.sel(k=k), f"GALI {k}", colour)
    right.set_yscale("log")
    right.set_ylabel("index")
    right.legend(fontsize=8, ncols=2)
    for axes in (left, right):
        axes.set_xlabel(long_label(study.time))
        axes.grid(True, lw=0.3, color=LIGHT)
    return figure_of(left)


def _draw(axes: Any, values: xr.DataArray, label: str, colour: str) -> None:
    """Draw the quartiles of values (time, member) over time."""
    rows = values.transpose("time", "member").values
    if not np.isfinite(rows).any():
        return
    known = np.isfinite(rows).any(axis=1)
    low, middle, high = np.nanquantile(rows[known], [0.25, 0.5, 0.75], axis=1)
    if label.startswith(("SALI", "GALI")):
        low, middle, high = (np.maximum(x, LOWEST) for x in (low, middle, high))
    times = values.time.values[known]
    axes.plot(times, middle, color=colour, lw=1.2, label=label)
    axes.fill_between(times, low, high, color=colour, alpha=0.15, lw=0.0)
