"""The picture of a study of a rare event: the probability as it falls towards the event."""

import re

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from rigidmc.results.labels import in_degrees, in_symbols, with_units
from rigidmc.studies.framework.variables import interval_of
from rigidmc.views.figures import CORE, INK, LIGHT, figure_of, legend_above, new_figure


def rare_curve(study: xr.Dataset, figure: Figure | None = None) -> Figure:
    """Draw the probability of passing each level for every repetition, and the event with its
    interval.

    study : the Dataset of `rigidmc.rare`
    """
    of, graded = study.attrs["of"], study.attrs["graded"]
    figure = figure or new_figure(f"{study.attrs['title']}: {in_symbols(of)}", (7.0, 5.0))
    axes = figure.add_subplot()
    scale, units = in_degrees(1.0, study.score.attrs["units"])
    goal = scale * float(study.attrs["goal"])
    for row in range(study.sizes["repetition"]):
        score, share = scale * study.score.values[row], study.share.values[row]
        p = float(study.probability.values[row])
        there = np.isfinite(score)
        x, y = score[there], share[there]
        if p > 0.0:
            x, y = np.append(x, goal), np.append(y, p)
        label = "repetitions" if row == 0 else None
        axes.plot(x, y, color=CORE, lw=0.7, alpha=0.6, label=label)
    p, low, high = interval_of(study, "p")
    if p > 0.0:
        ends = [[p - max(low, 0.01 * p)], [high - p]]
        axes.errorbar(
            [goal], [p], yerr=ends, fmt="o", color=INK, ms=4.0, capsize=3.0, zorder=5,
            label=f"{in_symbols(of)} = {p:.3g}",
        )  # fmt: skip
    axes.set_yscale("log")
    axes.set_xlabel(with_units(_named(of, graded, goal), units))
    axes.set_ylabel("probability of passing the level")
    axes.grid(True, lw=0.3, color=LIGHT)
    legend_above(axes, 2)
    return figure_of(axes)


def _named(of: str, graded: str, goal: float) -> str:
    """Return the label of the axis of levels."""
    if graded == "score":
        return f"score: events so far + 1/(1 + distance to the next); the event is at {goal:g}"
    name = in_symbols(re.split("[<>|]", of.removeprefix("p("))[0].strip())
    return f"{name}: level to pass; the event is at {goal:g}"
