"""Pictures of steady motions: their eigenvalues, and their branches along a parameter."""

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rigidmc.figures import ALARM, COLOURS, GREY, LIGHT, MARKERS, legend_above, new_figure
from rigidmc.results.labels import column_head, long_label
from rigidmc.studies.linearise.branches import GAIN
from rigidmc.studies.linearise.stability import MOTION


def eigenvalues(study: xr.Dataset) -> Figure:
    """Draw the eigenvalues of steady motions in the complex plane: those right of the line grow.

    Along a parameter: energy, growth rate and frequencies of each branch; thick where no change
    grows, with vertical lines at bifurcations.

    study : the Dataset of `rigidmc.linearise`
    """
    if "value" in study.dims:
        return _branches(study)
    figure = new_figure(f"{study.attrs['title']}: eigenvalues of steady motions", (6.2, 5.2))
    axes = figure.add_subplot()
    axes.axvline(0.0, color=LIGHT, lw=1.0, zorder=0)
    for k in range(study.sizes["motion"]):
        one = study.isel(motion=k)
        own = one.origin.values == MOTION
        colour = COLOURS[k % len(COLOURS)]
        omega = ", ".join(f"{x + 0.0:.3g}" for x in one.omega.values)
        label = f"{one.stability.item()}, omega = ({omega})"
        style: dict[str, Any] = {"marker": MARKERS[k % 5], "ls": "", "mfc": "none", "label": label}
        axes.plot(one.growth.values[own], one.frequency.values[own], color=colour, **style)
    others = study.origin.values != MOTION
    axes.plot(
        study.growth.values[others], study.frequency.values[others],
        marker=".", ls="", ms=3.0, color=GREY, label="symmetries and momenta",
    )  # fmt: skip
    axes.set(xlabel=long_label(study.growth), ylabel=long_label(study.frequency))
    legend_above(axes, 2)
    return figure


def _branches(study: xr.Dataset) -> Figure:
    """Draw branches along a parameter."""
    title = f"{study.attrs['title']}: steady motions along {study.attrs['along']}"
    figure = new_figure(title, (7.2, 7.6))
    panels = figure.subplots(3, 1, sharex=True)
    for k in range(study.sizes["branch"]):
        _draw_branch(panels, study.isel(branch=k), COLOURS[k % len(COLOURS)], k)
    at = study.bifurcation_value.values[study.bifurcation_kind.values == GAIN]
    for axes, name in zip(panels, ("energy", "growth_rate", "frequency"), strict=True):
        axes.set_ylabel(column_head(study[name]))
        for value in at:
            axes.axvline(value, color=ALARM, lw=0.8, ls=":", zorder=0)
    for branch, value in zip(
        study.bifurcation_branch.values, study.bifurcation_value.values, strict=True
    ):
        energy = study.energy.isel(branch=int(branch)).dropna("value")
        panels[0].plot(value, np.interp(value, energy.value, energy), "o", ms=5.0, color=ALARM)
    panels[2].set_xlabel(long_label(study.value))
    legend_above(panels[0], 4)
    return figure


def _draw_branch(panels: "np.ndarray[Any, Any]", one: xr.Dataset, colour: str, k: int) -> None:
    """Draw energy, growth rate and frequencies of a branch."""
    value, own = one.value.values, one.origin.values == MOTION
    steady = np.isin(one.stability.values, ("centre", "stable spiral", "stable node", "neutral"))
    for axes, name in zip(panels[:2], ("energy", "growth_rate"), strict=True):
        numbers = one[name].values
        axes.plot(value, numbers, color=colour, lw=1.0, ls="--")
        label = f"branch {k}" if name == "energy" else None
        axes.plot(value, np.where(steady, numbers, np.nan), color=colour, lw=2.4, label=label)
    turning: Axes = panels[2]
    at, column = np.nonzero(own & (one.frequency.values >= 0.0))
    turning.plot(value[at], one.frequency.values[at, column], ".", ms=3.0, color=colour)
