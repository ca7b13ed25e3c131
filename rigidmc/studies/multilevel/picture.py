"""The picture of a multilevel study: corrections, members and cost."""

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from rigidmc.results.labels import in_symbols, with_units
from rigidmc.studies.multilevel.corrections import interval_cost
from rigidmc.studies.multilevel.study import plain_members, read_levels
from rigidmc.views.figures import CORE, GREY, INK, LIGHT, MEDIAN, PATH, figure_of, new_figure


def multilevel_levels(study: xr.Dataset, figure: Figure | None = None) -> Figure:
    """Draw mean and variance of the corrections by level, with the expected slopes; the members of
    each level; and the width of the interval against the cost, with that of plain members.

    study : the Dataset of `rigidmc.multilevel`
    """
    title = f"{study.attrs['title']}: {in_symbols(study.attrs['measure'])} by levels of steps"
    figure = figure or new_figure(title, (11.0, 3.8))
    axes = figure.subplots(1, 3)
    _corrections(axes[0], study)
    _members(axes[1], study)
    _costs(axes[2], study)
    for panel in axes:
        panel.grid(True, lw=0.3, color=LIGHT)
        panel.set_axisbelow(True)
        panel.legend(fontsize=8, frameon=False)
    return figure_of(axes[0])


def _corrections(axes: Axes, study: xr.Dataset) -> None:
    """Draw |m_l| and sqrt(V_l) of each level, with lines of the integrator's order and of 1."""
    levels, order = study.level.values, study.attrs["order"]
    spread, size = np.sqrt(study.variance.values), np.abs(study["mean"].values)
    axes.plot(levels, spread, "s-", color=MEDIAN, label="spread over members")
    axes.errorbar(
        levels[1:], size[1:], study.error.values[1:], fmt="o", color=PATH, capsize=2.0,
        label="size of the mean",
    )  # fmt: skip
    for first, falls, dash, colour in ((spread, 1.0, ":", GREY), (size, order, "--", INK)):
        line = first[1] * 0.5 ** (falls * (levels[1:] - 1.0))
        axes.plot(
            levels[1:], line, dash, color=colour, lw=1.0, label=f"order {falls:g} in the step"
        )
    axes.set_yscale("log")
    axes.set_xlabel("level: each halves the step")
    axes.set_ylabel(with_units("corrections", study["mean"].attrs["units"]))
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))


def _members(axes: Axes, study: xr.Dataset) -> None:
    """Draw the members of each level and their cost."""
    cost = (study.members + study.flagged) * study.price
    axes.bar(study.level, study.members, 0.7, color=CORE, label="members")
    axes.plot(study.level, cost, "D-", color=INK, ms=4.0, lw=1.0, label="cost in steps")
    axes.set_yscale("log")
    axes.set_ylim(bottom=0.3 * float(study.members.min()))
    axes.set_xlabel("level")
    axes.set_ylabel("number of members, steps")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))


def _costs(axes: Axes, study: xr.Dataset) -> None:
    """Draw the half-width after each round against its cost, and the cost of other widths."""
    half = study.half.values
    axes.plot(study.cost, half, "o", color=MEDIAN, label="rounds of this study")
    widths = np.geomspace(0.1 * half[-1], 10.0 * half[-1], 50)
    levels, order, confidence = read_levels(study), study.attrs["order"], study.attrs["confidence"]
    ours = [interval_cost(levels, order, width, confidence) for width in widths]
    theirs = [plain_members(study, width).cost for width in widths]
    axes.plot(ours, widths, "-", color=MEDIAN, lw=1.2, label="by levels, width⁻²")
    axes.plot(theirs, widths, "--", color=PATH, lw=1.2, label="plain members, best step")
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("cost: members times steps")
    axes.set_ylabel(with_units("half-width of the interval", study.half.attrs["units"]))
