"""Pictures of the hard cases, and of the checks of a scene."""

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from rigidmc.results.labels import axis_label, count_text
from rigidmc.studies.stress.hard_cases import AMBER, VERDICTS
from rigidmc.views.figures import ALARM, COLOURS, GREY, INK, LIGHT, MARKERS, Picture, new_figure

# {verdict of `rigidmc.studies.stress.hard_cases`: (colour, words)}; "not claimed" stays white
_VERDICTS = {
    "good": ("#d9ead3", "good"),
    "close": ("#f6b26b", f"above {AMBER:g} of its bound"),
    "not up to it": ("#999999", "not up to it"),
    "not judged": ("#cfe2f3", "no bound"),
    "above": (ALARM, "above its bound"),
    "crashed": ("#000000", "crashed"),
}
_ALWAYS = ("good", "close", "above")  # always in the legend


def stress_picture(study: xr.Dataset) -> Figure:
    """Draw the picture that suits a study."""
    return (hard_cases if "case" in study.dims else trust)(study)


def hard_cases(study: xr.Dataset, figure: Picture | None = None) -> Figure:
    """Draw the hard cases as a heat map of error / bound, with the error in each field.

    study : the Dataset of `rigidmc.studies.stress.hard_cases.run_cases`
    """
    cases, names = study.case.values, study.integrator.values
    size = 4.8 + 0.62 * len(names), 1.6 + 0.175 * len(cases)
    figure = figure or new_figure(f"{len(cases)} hard cases: error / bound", size)
    figure.has_few_colours = True
    axes = figure.add_subplot()
    verdict, error = np.array(VERDICTS)[study.verdict.values], study.error.values
    colors = np.ones((*verdict.shape, 3))
    for word, (color, _) in _VERDICTS.items():
        colors[verdict == word] = to_rgb(color)
    axes.imshow(colors, aspect="auto", interpolation="none")
    for i, j in np.argwhere(verdict != "not claimed"):
        value = error[i, j]
        words = "0" if value == 0.0 else "X" if np.isnan(value) else f"{value:.0e}"
        color = "white" if verdict[i, j] in ("above", "crashed") else INK
        axes.text(j, i, words, ha="center", va="center", fontsize=6.5, color=color)
    axes.set_xticks(range(len(names)), names, rotation=45, ha="left")
    axes.set_yticks(range(len(cases)), cases, fontsize=7.5)
    axes.tick_params(top=True, labeltop=True, bottom=False, labelbottom=False, length=0)
    _groups(axes, study.group.values)
    handles = [
        Patch(facecolor=color, edgecolor=GREY, label=words)
        for word, (color, words) in _VERDICTS.items()
        if (verdict == word).any() or word in _ALWAYS
    ]
    figure.legend(
        handles=handles,
        loc="outside lower center",
        ncols=len(handles),
        fontsize=8,
        frameon=False,
        title="numbers: error; blank: not claimed",
        title_fontsize=8,
    )
    return figure


def _groups(axes: Axes, groups: NDArray[Any]) -> None:
    """Draw a line above each group of cases, and its name at the right."""
    starts = [i for i in range(len(groups)) if i == 0 or groups[i] != groups[i - 1]]
    for start, stop in zip(starts, [*starts[1:], len(groups)], strict=True):
        axes.axhline(start - 0.5, color=INK, lw=0.8)
        axes.annotate(
            groups[start],
            (1.005, 0.5 * (start + stop) - 0.5),
            xycoords=("axes fraction", "data"),
            fontsize=8,
            va="center",
        )


def trust(study: xr.Dataset, figure: Figure | None = None) -> Figure:
    """Draw the error of each check against time for the worst member, and the limit of two digits.

    study : the Dataset of `rigidmc.studies.stress.trust.trust`
    """
    title = f"{study.attrs['title']}: {study.attrs['verdict']}"
    figure = figure or new_figure(title, (9.5, 5.6))
    axes = figure.add_subplot()
    dashes = {"accuracy": "-", "rounding": ":"}
    for i, (name, kind) in enumerate(zip(study.check.values, study.tells.values, strict=True)):
        axes.plot(
            study.time.values,
            np.maximum(study.error.values[i], 1e-17),
            ls=dashes[kind],
            marker=MARKERS[i % len(MARKERS)],
            ms=4,
            lw=1.3,
            color=COLOURS[i % len(COLOURS)],
            label=f"{name} ({kind})",
        )
    axes.axhline(1e-2, color=ALARM, lw=0.8)
    axes.annotate(
        "two digits are left",
        (1.0, 1e-2),
        xycoords=("axes fraction", "data"),
        xytext=(-4, 3),
        textcoords="offset points",
        ha="right",
        fontsize=8,
        color=ALARM,
    )
    worst = f"error of the worst of {count_text(study.attrs['members'], 'member')}"
    axes.set(yscale="log", xlabel=axis_label(study.time), ylabel=worst)
    axes.grid(True, which="major", lw=0.3, color=LIGHT)
    axes.legend(fontsize=8, frameon=False, loc="center left", bbox_to_anchor=(1.01, 0.5))
    return figure
