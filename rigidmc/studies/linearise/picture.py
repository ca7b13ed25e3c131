"""Pictures of steady motions: their eigenvalues, and their branches along a parameter."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rigidmc.inputs.arrays import Array, Bools
from rigidmc.results.labels import axis_label, count_text, in_symbols, long_label, with_degrees
from rigidmc.studies.linearise.stability import MOTION
from rigidmc.views.figures import (
    ALARM,
    COLOURS,
    GREY,
    HALO,
    INK,
    LIGHT,
    MARKERS,
    legend_above,
    new_figure,
)

UNSTABLE = ("saddle", "unstable spiral")
ALIKE = 1e-6  # of curves or eigenvalues that symmetric motions share, relative to the largest
APART = 0.06  # of the height of the axes, between labels


def eigenvalues(study: xr.Dataset) -> Figure:
    """Draw the eigenvalues of steady motions in the complex plane: those right of the line grow.

    Motions that share their eigenvalues are drawn once. Along a parameter: energy, growth rate and
    frequencies of each branch, thick where no change grows, with markers at bifurcations.

    study : the Dataset of `rigidmc.linearise`
    """
    if "value" in study.dims:
        return _branches(study)
    figure = new_figure(f"{study.attrs['title']}: eigenvalues of steady motions", (6.2, 5.4))
    axes = figure.add_subplot()
    others = study.origin.values != MOTION
    axes.plot(
        study.growth.values[others], study.frequency.values[others],
        marker=".", ls="", ms=4.0, color=GREY, label="symmetries and momenta",
    )  # fmt: skip
    values = np.where(others, np.nan, study.growth.values + 1j * study.frequency.values)
    for k, alike in enumerate(_groups(values)):
        motion = study.isel(motion=alike[0])
        grows = motion.stability.item() in UNSTABLE
        style: dict[str, Any] = {"marker": MARKERS[k % 5], "ms": 7.0 + 2.0 * (k % 3), "ls": ""}
        words = f"{_named(motion)}: {count_text(len(alike), 'motion')}"
        axes.plot(
            values[alike[0]].real, values[alike[0]].imag, color=COLOURS[k % len(COLOURS)], zorder=3,
            mfc=None if grows else "none", label=words,
            **style,
        )  # fmt: skip
    _show_growth(axes)
    axes.set(xlabel=long_label(study.growth), ylabel=long_label(study.frequency))
    legend_above(axes, 2)
    return figure


def _named(motion: xr.Dataset) -> str:
    """Return the stability of a motion in words, with what is known of the full motion."""
    word, full = motion.stability.item(), motion.full_motion.item()
    return word if word in UNSTABLE or full == "unknown" else f"{word}, {full}"


def _show_growth(axes: Axes) -> None:
    """Shade the half plane of growth; axes without growth reach a tenth of the frequencies."""
    reach = max(np.abs(axes.get_xlim()).max(), 0.1 * np.abs(axes.get_ylim()).max())
    axes.set_xlim(-reach, reach)
    axes.axvspan(0.0, reach, color=LIGHT, alpha=0.35, lw=0.0, zorder=0)
    axes.axvline(0.0, color=GREY, lw=1.0, zorder=1)
    for x, word in ((0.02, "decays"), (0.98, "grows")):
        side = "left" if x < 0.5 else "right"
        axes.text(x, 0.02, word, ha=side, color=INK, fontsize=8, transform=axes.transAxes)


def _groups(rows: NDArray[Any]) -> list[list[int]]:
    """Return the numbers of the rows that are alike, in order; nan only equals nan."""
    groups: list[list[int]] = []
    size = np.abs(rows[np.isfinite(rows)]).max(initial=0.0)
    for k, row in enumerate(rows):
        for group in groups:
            if np.allclose(rows[group[0]], row, rtol=0.0, atol=ALIKE * size, equal_nan=True):
                group.append(k)
                break
        else:
            groups.append([k])
    return groups


def _branches(study: xr.Dataset) -> Figure:
    """Draw branches along a parameter."""
    study = with_degrees(study, "value", "bifurcation_value")
    title = f"{study.attrs['title']}: steady motions along {in_symbols(study.attrs['along'])}"
    figure = new_figure(title, (7.2, 7.8))
    panels = figure.subplots(3, 1, sharex=True)
    values = np.where(study.origin.values == MOTION, study.growth + 1j * study.frequency, np.nan)
    curves = np.concatenate([study.energy.values[..., None], values], axis=-1)
    groups = _groups(curves.reshape(study.sizes["branch"], -1))
    for k, alike in enumerate(groups):
        of_branch = study.bifurcation_branch.values == alike[0]
        onsets = np.sort(study.bifurcation_value.values[of_branch])
        _draw_branch(panels, study.isel(branch=alike[0]), k, onsets)
    for axes, name in zip(panels, ("energy", "growth_rate", "frequency"), strict=True):
        axes.set_ylabel(axis_label(study[name]))
        for value in study.bifurcation_value.values:
            axes.axvline(value, color=ALARM, lw=0.8, ls=":", zorder=0)
    _mark_bifurcations(panels[0], study)
    _name_branches(panels[0], study, groups)
    panels[2].set_xlabel(long_label(study.value))
    panels[1].plot([], [], color=COLOURS[0], lw=2.4, label="no change grows")
    panels[1].plot([], [], color=COLOURS[0], lw=1.0, ls="--", label="a change grows")
    panels[1].legend(fontsize=8, frameon=False, ncols=2)
    if study.sizes["bifurcation"]:
        legend_above(panels[0], 4)
    return figure


def _draw_branch(panels: NDArray[Any], branch: xr.Dataset, k: int, onsets: Array) -> None:
    """Draw energy, growth rate and frequencies of a branch with bifurcations at `onsets`."""
    value, is_motion = branch.value.values, branch.origin.values == MOTION
    grows, colour = np.isin(branch.stability.values, UNSTABLE), COLOURS[k % len(COLOURS)]
    energy = value, branch.energy.values, grows
    rate = _with_onsets(value, branch.growth_rate.values, grows, onsets)
    for axes, (x, y, thin) in zip(panels[:2], (energy, rate), strict=True):
        axes.plot(x, y, color=colour, lw=1.0, ls="--")
        axes.plot(x, np.where(thin, np.nan, y), color=colour, lw=2.4)
    at, column = np.nonzero(is_motion & (branch.frequency.values >= 0.0))
    frequency = branch.frequency.values[at, column]
    panels[2].plot(value[at], frequency, MARKERS[k % 5], ms=3.0, mfc="none", color=colour)


def _with_onsets(
    value: Array, rate: Array, grows: Bools, onsets: Array
) -> tuple[Array, Array, Bools]:
    """Return the samples of a growth rate and the points where growth begins or ends: it is 0
    there, but a line between samples would miss it."""
    at = np.searchsorted(value, onsets)
    inside = (at > 0) & (at < value.size)
    onsets, at = onsets[inside], at[inside]
    changes = np.isfinite(rate[at - 1] + rate[at]) & (grows[at - 1] != grows[at])
    onsets, at = onsets[changes], at[changes]
    return np.insert(value, at, onsets), np.insert(rate, at, 0.0), np.insert(grows, at, False)


def _mark_bifurcations(axes: Axes, study: xr.Dataset) -> None:
    """Mark bifurcations on the branches, each kind with its own marker."""
    kinds = study.bifurcation_kind.values
    for k, kind in enumerate(dict.fromkeys(kinds)):
        at = np.flatnonzero(kinds == kind)
        heights = []
        for i in at:
            branch = int(study.bifurcation_branch[i])
            energy = study.energy.isel(branch=branch).dropna("value")
            heights.append(np.interp(study.bifurcation_value[i], energy.value, energy))
        values = study.bifurcation_value.values[at]
        axes.plot(values, heights, MARKERS[k], c=ALARM, label=kind, zorder=4, ms=6.0, mec="white")


def _name_branches(axes: Axes, study: xr.Dataset, groups: Sequence[list[int]]) -> None:
    """Write the numbers of branches at their right ends, apart from each other."""
    low, high = axes.get_ylim()
    ends = []
    for k, alike in enumerate(groups):
        energy = study.energy.isel(branch=alike[0]).dropna("value")
        ends.append((float(energy[-1]), float(energy.value[-1]), k, ", ".join(map(str, alike))))
    height, floor = APART * (high - low), -np.inf
    for y, x, k, name in sorted(ends):
        floor = max(y, floor + height)
        axes.annotate(
            name, (x, floor), xytext=(4, 0), textcoords="offset points", va="center", fontsize=8,
            color=COLOURS[k % len(COLOURS)], path_effects=HALO,
        )  # fmt: skip
