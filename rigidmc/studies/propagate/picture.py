"""The picture of a propagated covariance: ellipses on members of the ensemble."""

import math
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rigidmc.errors import OptionError, nearest
from rigidmc.inputs.arrays import Array
from rigidmc.results.labels import in_degrees, in_symbols, with_units
from rigidmc.views.figures import COLOURS, GREY, INK, LIGHT, add_title, figure_of, new_figure

SIGMAS = 1.0, 2.0
WIDEST = 4.0  # a wider linear ellipse, in widths of the ensemble, is cut: it would hide the members


def covariance_ellipses(
    study: xr.Dataset, x: str | None = None, y: str | None = None, figure: Figure | None = None
) -> Figure:
    """Draw the deviations of members at some saves, with the ellipses of 1 and 2 standard
    deviations: linear ones about the nominal member, dashed ones of the ensemble about its mean.

    study : the Dataset of `rigidmc.propagate`
    x, y : rows such as "omega[1]"; by default the first two components of omega

    Raises OptionError for a row that the study does not have.
    """
    rows = [str(row) for row in study.row.values]
    spins = [row for row in rows if row.startswith("omega[")]
    across, *rest = spins if len(spins) > 1 else rows
    x = x or across
    y = y or next((row for row in rest if row != x), across)
    for name in (x, y):
        if name not in rows:
            rule = f"is not a row of the covariance; known: {', '.join(rows)}"
            raise OptionError(rule, at="x and y", value=name, nearest=nearest(name, rows))
    count = study.sizes["sample_time"]
    columns = math.ceil(math.sqrt(count))
    title = f"{study.attrs['title']}: linear covariance and ensemble"
    figure = figure or new_figure(title, (8.2, 7.0))
    study, labels = _with_degrees(study), []
    for name in (x, y):
        _, unit = in_degrees(0.0, str(study.unit.sel(row=name).item()))
        labels.append(with_units(f"change of {in_symbols(name)}", unit))
    for k in range(count):
        axes = figure.add_subplot(-(-count // columns), columns, k + 1)
        _panel(axes, study.isel(sample_time=k), x, y)
        axes.set(xlabel=labels[0], ylabel=labels[1])
    named = axes.get_legend_handles_labels()
    figure.legend(*named, loc="outside lower center", ncols=3, fontsize=8, frameon=False)
    return figure_of(axes)


def _with_degrees(study: xr.Dataset) -> xr.Dataset:
    """Return a study with changes of angles in degrees."""
    scale = [in_degrees(1.0, str(unit))[0] for unit in study.unit.values]
    by_row, by_column = (xr.DataArray(scale, dims=dim) for dim in ("row", "column"))
    changed = {name: study[name] * by_row for name in ("sample", "bias")}
    for name in ("covariance", "sample_covariance"):
        changed[name] = study[name] * by_row * by_column
    return study.assign(changed)


def _panel(axes: Axes, study: xr.Dataset, x: str, y: str) -> None:
    """Draw one save."""
    time = float(study.sample_time)
    at = study.sel(time=time, method="nearest")
    points = study.sample.sel(row=[x, y]).values
    axes.plot(*points, ".", ms=2.0, color=LIGHT, rasterized=True, label="members")
    mean = at.bias.sel(row=[x, y]).values
    largest = []
    for key, centre, style, colour, word in (
        ("covariance", np.zeros(2), "-", INK, "linear, 1 and 2 standard deviations"),
        ("sample_covariance", mean, "--", COLOURS[0], "ensemble"),
    ):
        matrix = at[key].sel(row=[x, y], column=[x, y]).values
        for sigma in SIGMAS if np.isfinite(matrix).all() else ():
            label = word if sigma == SIGMAS[0] else None
            line = ellipse(matrix, sigma) + centre[:, None]
            axes.plot(*line, style, lw=1.2, color=colour, label=label)
            largest += [line] * (sigma == SIGMAS[-1])
    axes.axhline(0.0, lw=0.3, color=GREY)
    axes.axvline(0.0, lw=0.3, color=GREY)
    wider = cut_linear(axes, points, *largest) if len(largest) == 2 else 1.0
    times = f"{wider:,.0f}" if wider < 1e6 else f"{wider:.1e}"
    cut = f", linear {times} times as wide" if wider > WIDEST else ""
    add_title(axes, f"t = {time:g} s{cut}")


def cut_linear(axes: Axes, members: Array, linear: Array, sampled: Array) -> float:
    """Limit the axes to WIDEST widths of the ensemble; return the width of the linear ellipse in
    widths of the ensemble, that of the axis where it is larger.

    members, linear, sampled : points (2, n) of members and of the largest ellipses
    """
    widest, shown = 1.0, np.concatenate([members, sampled, np.zeros((2, 1))], axis=1)
    limits: tuple[Any, Any] = axes.set_xlim, axes.set_ylim
    for limit, some, line in zip(limits, shown, linear, strict=True):
        low, high = np.nanmin(some), np.nanmax(some)
        # a row that does not vary has no width
        ratio = np.ptp(line) / (high - low) if high > low else 1.0
        if ratio > WIDEST:
            more = 0.5 * (WIDEST - 1.0) * (high - low)
            limit(low - more, high + more)
        widest = max(widest, ratio)
    return float(widest)


def ellipse(covariance: Array, sigma: float) -> Array:
    """Return points (2, n) of the ellipse of `sigma` standard deviations; a line if it is flat."""
    values, vectors = np.linalg.eigh(covariance)
    angle = np.linspace(0.0, 2.0 * np.pi, 181)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    return np.asarray(sigma * vectors * np.sqrt(np.clip(values, 0.0, None)) @ circle)
