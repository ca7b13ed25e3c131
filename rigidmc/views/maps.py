"""Pictures of maps."""

from textwrap import fill
from typing import Any

import numpy as np
from matplotlib.colors import BoundaryNorm, ListedColormap, LogNorm, Normalize
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patheffects import withStroke

from rigidmc.studies.maps.catalogue import MAPS
from rigidmc.views.ensemble import new_figure

HALO = [withStroke(linewidth=3.0, foreground="white")]
PALETTE, FAILED = "cividis", "#d62728"


def stability_map(ds, shown=None, figure=None):
    """A map: one measure as an image, what theory says as lines over it, blank parts hatched, pixels whose members failed in red.

    ds : of `rigidmc.stability_map`;  shown : the variable that is drawn, by default the first, or that of a map of the package
    """
    case = MAPS[ds.attrs["map"]]() if ds.attrs.get("map") in MAPS else None
    name = shown or (case.shown if case else next(iter(ds.data_vars)))
    if name not in ds:
        raise ValueError(
            f"{name}: the map has no such variable; it has {', '.join(map(str, ds.data_vars))}"
        )
    facts = (
        ""
        if case
        else f": {ds.attrs['members']} members to a pixel, to {ds.attrs['t_end']:g} s with {ds.attrs['integrator']}"
    )
    figure = figure or new_figure(fill(ds.attrs["title"] + facts, 95), (9.0, 7.2))
    axes = figure.add_subplot()
    values = ds[name].values
    edges = [_edges(ds[key]) for key in ("x", "y")]
    colours, norm, ticks = _colours(name, values)
    for key in ("x", "y"):
        if ds[key].attrs["log"]:
            getattr(axes, f"set_{key}scale")("log")
    image = axes.pcolormesh(*edges, values, cmap=colours, norm=norm, rasterized=True)
    handles: list[Any] = []
    axes.set_facecolor("#dddddd")
    if (np.isnan(values) & (ds.good.values > 0)).any():
        handles.append(Patch(facecolor="#dddddd", edgecolor="#555555", label="did not happen"))
    for mask, face, hatch, words in (
        ((ds.good == 0) & (ds.failed == 0), "white", "////", "no such body or start"),
        (ds.failed > 0, FAILED, "xx", "members failed"),
    ):
        if mask.values.any():
            grid = np.where(mask.values, 1.0, np.nan)
            axes.pcolormesh(
                *edges, grid, cmap=ListedColormap([face]), vmin=0.0, vmax=2.0, rasterized=True
            )
            over = [
                np.repeat(e, 2)[1:-1] for e in edges
            ]  # each pixel by its four corners: hatched to its edge
            each = np.repeat(np.repeat(mask.values.astype(float), 2, axis=0), 2, axis=1)
            axes.contourf(*over, each, levels=[0.5, 1.5], colors="none", hatches=[hatch])
            handles.append(Patch(facecolor=face, edgecolor="#555555", hatch=hatch, label=words))
    if case and case.contours and min(ds.sizes["x"], ds.sizes["y"]) > 1:
        variable, levels, words = case.contours
        lines = axes.contour(
            ds.x.values,
            ds.y.values,
            ds[variable].values,
            levels=levels,
            colors="black",
            linewidths=1.4,
        )
        lines.set(path_effects=[withStroke(linewidth=2.6, foreground="white")])
        if len(levels) > 1:
            axes.clabel(lines, fontsize=9, fmt="%g", manual=_middles(lines, axes))
            for text in axes.texts:
                text.set_path_effects(HALO)
        handles.append(Line2D([], [], color="black", lw=1.4, label=words))
    for key, axis in (("x", axes.xaxis), ("y", axes.yaxis)):
        axis.set_label_text(case.labels["xy".index(key)] if case else label(ds[key]))
    bar = figure.colorbar(image, ax=axes, pad=0.02, ticks=ticks[0] if ticks else None)
    own = case.labels[2] if case and len(case.labels) > 2 and name == case.shown else None
    units = (
        ""
        if ds[name].attrs["units"] == "1"
        else f" [{ds[name].attrs['units']}]".replace(" ", "\N{NO-BREAK SPACE}")
    )
    bar.set_label(own or fill(ds[name].attrs["long_name"].split(";")[0] + units, 75))
    if ticks:
        bar.ax.set_yticklabels(ticks[1])
    if handles:
        axes.legend(
            handles=handles,
            loc="upper center",
            bbox_to_anchor=(0.5, -0.09),
            ncols=len(handles),
            frameon=False,
        )
    return figure


def label(coordinate):
    """What stands at an axis: the parameter with its units."""
    return f"{coordinate.attrs['long_name']} [{coordinate.attrs['units']}]"


def _middles(lines, axes):
    """The middle of the longest piece of each line, as it is drawn: where numbers do not crowd at ends that meet."""
    found = []
    for pieces in lines.allsegs:
        drawn = [
            (piece, np.hypot(*np.diff(axes.transData.transform(piece), axis=0).T))
            for piece in pieces
            if len(piece) > 1
        ]
        if drawn:
            piece, steps = max(drawn, key=lambda one: one[1].sum())
            found.append(tuple(piece[np.searchsorted(np.cumsum(steps), 0.5 * steps.sum())]))
    return found


def _edges(coordinate):
    """The edges of pixels, halfway between their middles; of even ratios by ratio."""
    x = np.log(coordinate.values) if coordinate.attrs["log"] else coordinate.values
    step = x[1] - x[0] if x.size > 1 else max(abs(x[0]), 1.0)
    edges = np.concatenate([[x[0] - 0.5 * step], x + 0.5 * step])
    return np.exp(edges) if coordinate.attrs["log"] else edges


def _colours(name, values):
    """(colour map, norm, (ticks, words) or None) of a variable: shares from 0 to 1, ends of an axis in two tones, MEGNO by its logarithm."""
    found = values[np.isfinite(values)]
    if not found.size:
        return PALETTE, Normalize(0.0, 1.0), None
    if name.startswith("p("):
        return "cividis_r", Normalize(0.0, 1.0), None
    if name == "end":
        return (
            ListedColormap(["#08306b", "#bbbbbb", "#fdd49e"]),
            BoundaryNorm([-1.5, -0.5, 0.5, 1.5], 3),
            ([-1, 0, 1], ["-3", "none", "+3"]),
        )
    if "megno" in name:
        return (
            PALETTE,
            LogNorm(1.5, 200.0),
            ([2, 5, 10, 20, 50, 100, 200], ["2", "5", "10", "20", "50", "100", "200"]),
        )
    low, high = np.quantile(found, [0.005, 0.995])
    if high <= low:
        return (
            PALETTE,
            Normalize(low - 0.01 * abs(low) - 1e-300, high + 0.01 * abs(high) + 1e-300),
            None,
        )
    return PALETTE, Normalize(low, high), None
