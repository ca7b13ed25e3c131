"""Pictures of maps."""

import math
from textwrap import fill
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.colors import ListedColormap
from matplotlib.contour import QuadContourSet
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patheffects import withStroke
from scipy.ndimage import uniform_filter

from rigidmc.inputs.arrays import Array, Bools
from rigidmc.physics.observables.saving import CENSORED
from rigidmc.results.labels import (
    count_text,
    in_symbols,
    long_label,
    value_text,
    with_degrees,
    with_units,
)
from rigidmc.studies.stability_map.cases import MAPS
from rigidmc.studies.stability_map.question import MapCase
from rigidmc.views.figures import ALARM, GREY, MEDIAN, Scale, colour_scale, new_figure

BLANK = "#dddddd"  # pixels without a value of the measure
Edges = list[Array]  # of the pixels, along x and along y


def stability_map(ds: xr.Dataset, shown: str | None = None, figure: Figure | None = None) -> Figure:
    """Draw a map: one variable as an image, with theory as lines over it.

    Pixels with an impossible body or start are hatched; pixels with failed members are red. A stack
    of maps has a panel for each layer. An adaptive map has an extra panel with the computed pixels.

    ds : of `rigidmc.stability_map`
    shown : the variable to draw; by default the first, or that of a shipped map
    """
    case = MAPS[ds.attrs["map"]]() if ds.attrs.get("map") in MAPS else None
    name = shown or (case.shown if case else str(next(iter(ds.data_vars))))
    if name not in ds:
        names = ", ".join(map(str, ds.data_vars))
        raise ValueError(f"{name}: is not a variable of the map; known: {names}")
    ds = with_degrees(ds, name, *(key for key in "xyz" if key in ds.coords))
    parts = [ds.isel(z=k) for k in range(ds.sizes["z"])] if "z" in ds.dims else [ds]
    marked = "computed" in ds and len(parts) == 1
    count = len(parts) + marked
    columns = count if count < 4 else math.ceil(math.sqrt(count))
    rows = -(-count // columns)
    width, height = (7.6, 7.2) if rows == 1 else (4.6, 4.2 + 1.0 / rows)
    size = width * columns + 1.4, height * rows
    figure = figure or new_figure(fill(_title(ds, case), 95), size)
    panels = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    scale = colour_scale(name, ds[name].values, case.ticks if case and name == case.shown else {})
    handles: list[Any] = []
    for axes, part in zip(panels.flat, parts, strict=False):
        image, more = _panel(axes, part, name, case, scale)
        labels = {handle.get_label() for handle in handles}
        handles += [handle for handle in more if handle.get_label() not in labels]
        if "z" in ds.dims:
            name_of_z, value = in_symbols(part.z.attrs["long_name"]), float(part.z)
            axes.set_title(f"{name_of_z} = {value_text(value, part.z, 4)}", fontsize=9)
    if marked:
        _mark(panels.flat[1], ds)
    for axes in panels.flat[count:]:
        axes.set_axis_off()
    across, upwards = (
        with_units(case.labels[k], ds[key].attrs["units"]) if case else long_label(ds[key])
        for k, key in enumerate("xy")
    )
    for axes in panels[-1]:
        axes.set_xlabel(across)
    for axes in panels[:, 0]:
        axes.set_ylabel(upwards)
    ticks = scale[2]
    where = panels if len(parts) > 1 else panels.flat[0]
    bar = figure.colorbar(image, ax=where, pad=0.02, ticks=ticks[0] if ticks else None)
    bar.set_label(_bar_label(ds[name], case))
    if ticks:
        bar.ax.set_yticklabels(ticks[1])
    if handles:
        words: dict[str, Any] = {"handles": handles, "ncols": len(handles), "frameon": False}
        if count > 1:
            figure.legend(loc="outside lower center", **words)
        else:
            panels.flat[0].legend(loc="upper center", bbox_to_anchor=(0.5, -0.09), **words)
    return figure


def _panel(
    axes: Axes, ds: xr.Dataset, name: str, case: MapCase | None, scale: Scale
) -> tuple[QuadMesh, list[Any]]:
    """Draw a map; return its image and the handles for the legend."""
    values, edges = ds[name].values, [_edges(ds[key]) for key in ("x", "y")]
    axes.set(**{f"{key}scale": "log" for key in ("x", "y") if ds[key].attrs["log"]})
    image = axes.pcolormesh(*edges, values, cmap=scale[0], norm=scale[1], rasterized=True)
    axes.set_facecolor(BLANK)
    handles: list[Any] = []
    unknown = ~np.isfinite(values) & (ds.good.values > 0)
    if unknown.any():
        some = "none by the end" if ds.attrs["members"] == 1 else "not in all members by the end"
        words = some if CENSORED in ds[name].attrs else "no value"
        handles.append(Patch(facecolor=BLANK, edgecolor=GREY, label=words))
    for mask, face, hatch, words in (
        ((ds.good == 0) & (ds.failed == 0), "white", "////", "impossible body or start"),
        (ds.failed > 0, ALARM, "xx", "failed members"),
    ):
        if mask.values.any():
            handles.append(_hatched(axes, edges, mask.values, face, hatch, words))
    if case and case.contours and min(ds.sizes["x"], ds.sizes["y"]) > 1:
        variable, levels, words = case.contours
        handles.append(_contours(axes, ds, ds[variable].values, levels, words))
    elif not case and name.startswith("p("):
        handles += _half(axes, ds, name)
    return image, handles


def _mark(axes: Axes, ds: xr.Dataset) -> None:
    """Draw the computed pixels."""
    edges, computed = [_edges(ds[key]) for key in ("x", "y")], ds["computed"].values
    axes.pcolormesh(*edges, computed, cmap=ListedColormap(["white", MEDIAN]), rasterized=True)
    axes.set_title(f"computed: {100 * computed.mean():.3g} % of the pixels", fontsize=10)


def _title(ds: xr.Dataset, case: MapCase | None) -> str:
    """Return the title of a map; unless it is a shipped map, add the facts of its run."""
    a = ds.attrs
    members = f"{count_text(a['members'], 'member')} per pixel"
    facts = "" if case else f": {members}, to {a['t_end']:g} s with {a['integrator']}"
    return f"{a['title']}{facts}"


def _bar_label(variable: xr.DataArray, case: MapCase | None) -> str:
    """Return the label of the colour bar, with units."""
    if case and len(case.labels) > 2 and variable.name == case.shown:
        return with_units(case.labels[2], variable.attrs["units"])
    units = with_units("", variable.attrs["units"]).replace(" ", "\N{NO-BREAK SPACE}")
    measure, colon, words = variable.attrs["long_name"].split(";")[0].partition(": ")
    return fill((in_symbols(measure) if colon else measure) + colon + words + units, 75)


def _hatched(axes: Axes, edges: Edges, mask: Bools, face: str, hatch: str, words: str) -> Patch:
    """Colour and hatch the pixels of a mask; return the handle for the legend."""
    grid = np.where(mask, 1.0, np.nan)
    axes.pcolormesh(*edges, grid, cmap=ListedColormap([face]), vmin=0.0, vmax=2.0, rasterized=True)
    # draw each pixel by its four corners, so that the hatching ends at its edge
    corners = [np.repeat(e, 2)[1:-1] for e in edges]
    each = np.repeat(np.repeat(mask.astype(float), 2, axis=0), 2, axis=1)
    axes.contourf(*corners, each, levels=[0.5, 1.5], colors="none", hatches=[hatch])
    return Patch(facecolor=face, edgecolor=GREY, hatch=hatch, label=words)


def _contours(
    axes: Axes, ds: xr.Dataset, values: Array, levels: tuple[float, ...], words: str
) -> Line2D:
    """Draw contour lines of values, labelled if there are several levels; return the handle for the
    legend."""
    style: dict[str, Any] = {"colors": "black", "linewidths": 1.4}
    lines = axes.contour(ds.x.values, ds.y.values, values, levels=levels, **style)
    lines.set(path_effects=[withStroke(linewidth=2.6, foreground="white")])
    if len(levels) > 1:
        axes.clabel(lines, fontsize=9, fmt="%g", manual=_middles(lines, axes))
        for text in axes.texts:
            text.set_path_effects([withStroke(linewidth=3.0, foreground="white")])
    return Line2D([], [], color="black", lw=1.4, label=words)


def _half(axes: Axes, ds: xr.Dataset, name: str) -> list[Line2D]:
    """Draw the line on which the fraction of members is one half; return the handle for the legend.

    Fractions are averaged over 3 x 3 pixels, so that the line follows the border, not single
    pixels.
    """
    values = ds[name].values
    is_known = np.isfinite(values)
    weights = uniform_filter(is_known.astype(float), 3, mode="nearest")
    sums = uniform_filter(np.where(is_known, values, 0.0), 3, mode="nearest")
    smooth = np.divide(sums, weights, out=np.full(values.shape, np.nan), where=is_known)
    if min(values.shape) < 2 or not np.nanmin(smooth) < 0.5 < np.nanmax(smooth):
        return []
    masked = np.ma.masked_invalid(smooth)
    words = "half of the members" if ds.attrs["members"] > 1 else "border between 0 and 1"
    return [_contours(axes, ds, masked, (0.5,), words)]


def _middles(contours: QuadContourSet, axes: Axes) -> list[tuple[float, float]]:
    """Return the middle of the longest piece of each line on the screen, for its label: labels
    there do not overlap where the lines meet."""
    middles = []
    for pieces in contours.allsegs:
        lines = [piece for piece in pieces if len(piece) > 1]
        if lines:
            lengths = [np.hypot(*np.diff(axes.transData.transform(x), axis=0).T) for x in lines]
            piece, steps = max(zip(lines, lengths, strict=True), key=lambda pair: pair[1].sum())
            middles.append(tuple(piece[np.searchsorted(np.cumsum(steps), 0.5 * steps.sum())]))
    return middles


def _edges(coordinate: xr.DataArray) -> Array:
    """Return the edges of pixels, halfway between their centres on a linear or log scale."""
    x = np.log(coordinate.values) if coordinate.attrs["log"] else coordinate.values
    # a single pixel is as wide as its value, or a factor of e on a log scale
    alone = 1.0 if coordinate.attrs["log"] else abs(x[0]) or 1.0
    step = x[1] - x[0] if x.size > 1 else alone
    edges = np.concatenate([[x[0] - 0.5 * step], x + 0.5 * step])
    return np.exp(edges) if coordinate.attrs["log"] else edges
