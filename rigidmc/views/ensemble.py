"""Pictures of an ensemble, one function each.

Every function takes a Dataset of simulate(), and optionally axes in a figure of the caller. It
reads evenly spaced members and times, see `rigidmc.views.sample`; drifts are from all members.
Pictures exclude flagged members (status not 0); the heading of a new figure counts them. If there
is nothing to draw, ValueError names the variables to save.
"""

from contextlib import suppress
from textwrap import fill
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import ConnectionPatch
from matplotlib.ticker import NullFormatter

from rigidmc.inputs.arrays import Array
from rigidmc.physics.observables import OBSERVABLES
from rigidmc.planning.saves import AXIS, BODY
from rigidmc.results.labels import axis_label, count_text, in_symbols, with_units
from rigidmc.results.principal_axes import in_principal_axes, is_described
from rigidmc.views.figures import (
    BAND,
    CORE,
    INK,
    LIGHT,
    MEDIAN,
    PATH,
    add_title,
    figure_of,
    legend_above,
    line_styles,
    name_powers,
)
from rigidmc.views.globes import axis_density, momentum_density
from rigidmc.views.polhodes import polhodes
from rigidmc.views.sample import (
    LINES,
    drawn_members,
    figure_of_result,
    member_labels,
    member_paths,
    note_on,
    omega_or_momentum,
    span,
    thin_result,
)
from rigidmc.views.snapshots import BELOW, Flight, body_place, draw_flight, flight, has_angle
from rigidmc.views.sphere import central_axis
from rigidmc.views.tops import trajectory

# reversals per member above which a picture shows only one of the members, with the widest swing,
# and a thin line
SWINGS = 25
WIDE = 36  # characters of a title above a third of a summary


def summary(ds: xr.Dataset, figure: Figure | None = None) -> Figure:
    """Draw the summary of a run: a typical body at a few instants, the ensemble against time,
    directions, drifts.

    Against time it shows the angular velocity about the middle axis; with saved attitudes of bodies
    under torques the angle of axis 3 from the vertical. With fewer than three saves, the spread at
    the start and at the end replaces it. The axis in space requires saved attitudes; the body
    requires a result with its scene. Of up to 20 members, lines replace quantiles and densities; of
    one member, its drifts against time, if they were saved, replace their histogram.
    """
    figure = figure or figure_of_result(ds, (10.0, 9.2))
    if not (ds.status.values == 0).any():
        figure.text(0.5, 0.5, "nothing to draw: every member is flagged", ha="center")
        return figure
    part = thin_result(ds)
    has_series = ("omega" in ds or "momentum" in ds) and ds.sizes["time"] > 2
    typical: Flight | None = None
    with suppress(ValueError):  # the result cannot tell the motion of a member
        typical = flight(ds, part) if has_series else None
    heights = [*([0.75] if typical else []), 1.0, 1.55]
    rows = figure.add_gridspec(len(heights), 1, height_ratios=heights)
    axes = figure.add_subplot(rows[-2])
    if typical is not None:
        bodies = figure.add_subplot(rows[0])
        _series(part, axes, bodies, typical)
        draw_flight(ds, typical, bodies)
        _join(figure, bodies, axes, typical)
    else:
        (_series if has_series else start_and_end)(part, axes)
    count = 2 if "attitude" in ds else 1
    lower = rows[-1].subgridspec(1, count + 1, width_ratios=[*(1.1,) * count, 1.0])
    places = [figure.add_subplot(lower[place]) for place in range(count)]
    if typical is not None and part.sizes["member"] <= LINES:
        for sphere, place in zip((polhodes, trajectory), places, strict=False):
            sphere(ds, place)
            _shorten(place)
    else:
        # a free path has the attitude of the principal axes, not of the described ones
        path = typical.path if typical is not None and not is_described(ds) else None
        for density, place in zip((momentum_density, axis_density), places, strict=False):
            density(part, place, path)
    drifts = drift_histogram if ds.sizes["member"] > 1 else _drifts_of_one
    drifts(ds, figure.add_subplot(lower[-1]))
    return figure


def _shorten(axes: Axes) -> None:
    """Shorten title and legend of a picture of a few members to a third of a summary, whose legend
    names the members."""
    title = axes.get_title()
    if title.startswith("Momentum sphere"):
        title = "\n".join(["Angular momentum in principal axes", *title.split("\n")[1:]])
    axes.set_title("\n".join(fill(line, WIDE) for line in title.split("\n")), fontsize=9)
    entries = dict(zip(*reversed(axes.get_legend_handles_labels()), strict=True))
    others = {label: line for label, line in entries.items() if not label.startswith("member")}
    axes.legend(
        others.values(),
        others,
        loc="upper center",  # below the axes, where no name of a space axis stands
        bbox_to_anchor=(0.5, 0.02),
        ncols=1 if len(others) > 2 else 2,
        fontsize=8,
        frameon=False,
    )


def _join(figure: Figure, bodies: Axes, axes: Axes, flown: Flight) -> None:
    """Draw lines from bodies to their times, and mark the times on the line of the member."""
    value = np.interp(flown.instants, flown.path.t, flown.value)
    axes.plot(flown.instants, value, "o", color=PATH, markersize=4, zorder=4)
    for k, t in enumerate(flown.instants):
        line = ConnectionPatch(
            (body_place(k), BELOW),
            (t, 1.0),
            bodies.transData,
            axes.get_xaxis_transform(),
            color=LIGHT,
            linewidth=0.9,
        )
        figure.add_artist(line)
        axes.axvline(t, color=LIGHT, linewidth=0.7, zorder=0)


def middle_component(ds: xr.Dataset, axes: Axes | None = None) -> Figure:
    """Draw angular velocity about the axis of the middle moment against time: quantiles and a few
    members. One member is a smooth line, recomputed where its saves are too far apart.

    ds : result with omega or momentum at three or more times
    """
    part = thin_result(ds)
    value, up, title = _middle(part)
    axes = axes or figure_of_result(ds, (7.0, 4.2)).add_subplot()
    if value.shape[1] == 1:
        (path,), note = member_paths(ds, BODY)
        middle = np.argsort(path.moments, kind="stable")[1]
        axes.plot(path.t, path.omega[:, middle], color=PATH, linewidth=1.2)
        _name_axes(axes, part, up)
        add_title(axes, title, note)
        return figure_of(axes)
    _band(axes, part, value, up)
    few = value[:, drawn_members(value)]
    if np.count_nonzero(np.diff(np.sign(np.diff(few, axis=0)), axis=0)) > SWINGS * few.shape[1]:
        few = few[:, np.argmax(np.ptp(few, axis=0)), None]
    for k, line in enumerate(axes.plot(part.time.values, few, color=PATH, linewidth=0.8)):
        line.set_label("_" if k else "one member" if few.shape[1] == 1 else "single members")
    add_title(axes, title, note_on(part, BODY), pad=20)
    legend_above(axes, 4)
    return figure_of(axes)


def _series(
    part: xr.Dataset, axes: Axes, titled: Axes | None = None, flown: Flight | None = None
) -> None:
    """Draw the ensemble against time for the summary; the title goes above `titled`.

    flown : the member whose line is drawn
    """
    (value, up, title), kind = (_angle(part), AXIS) if has_angle(part) else (_middle(part), BODY)
    is_few = flown is not None and value.shape[1] <= LINES
    (_lines if is_few else _band)(axes, part, value, up)
    if flown is not None:
        shown = flown.path.t <= part.time.values[-1] * (1.0 + 1e-9)
        line = flown.path.t[shown], flown.value[shown]
        swings = np.count_nonzero(np.diff(np.sign(np.diff(line[1]))))
        width = 1.0 if swings <= SWINGS else 0.8 if is_few else 0.4
        label = f"member {flown.path.member}, drawn above{flown.turn()}"
        axes.plot(*line, color=PATH, linewidth=width, label=label)
    name_powers(axes)
    add_title(titled or axes, title, note_on(part, kind), pad=20)
    legend_above(titled or axes, 4, axes)


def _lines(axes: Axes, part: xr.Dataset, value: Array, up: str) -> None:
    """Draw the values (time, member) of a few members against time, in the styles of other pictures
    of single members; the first one is drawn by `_series`."""
    styles, labels = line_styles(value.shape[1]), member_labels(part.member.values)
    for line, style, label in list(zip(value.T, styles, labels, strict=True))[1:]:
        axes.plot(part.time.values, line, label=label, **{**style, "linewidth": 1.0})
    _name_axes(axes, part, up)


def _name_axes(axes: Axes, part: xr.Dataset, up: str) -> None:
    """Name the axes of a picture against time."""
    t = part.time.values
    axes.set(xlabel=axis_label(part.time), ylabel=up, xlim=(t[0], t[-1]))


def _band(axes: Axes, part: xr.Dataset, value: Array, up: str) -> None:
    """Draw the quantiles of values (time, member) against time."""
    t = part.time.values
    low, quarter, median, three_quarters, high = np.quantile(
        value, [0.05, 0.25, 0.5, 0.75, 0.95], axis=1
    )
    axes.fill_between(t, low, high, color=BAND, linewidth=0, label="5 to 95 %")
    axes.fill_between(t, quarter, three_quarters, color=CORE, linewidth=0, label="25 to 75 %")
    axes.plot(t, median, color=MEDIAN, linewidth=2.0, label="median")
    _name_axes(axes, part, up)


def _middle(part: xr.Dataset) -> tuple[Array, str, str]:
    """Return (values (time, member), label, title) of the component of omega about the axis of the
    middle moment of each member [rad/s]."""
    principal = in_principal_axes(part)
    omega, _ = omega_or_momentum(principal, "omega")
    if len(omega) < 3:
        raise ValueError(
            "middle_component needs omega at three or more times:"
            ' run with every=... and save=("omega",)'
        )
    moments = principal.moments.values
    axis = np.argsort(moments, axis=0, kind="stable")[1]
    value = np.take_along_axis(omega, axis[None, None], axis=1)[:, 0]
    # the number of an axis is one of the axes of the result
    is_numbered = np.ptp(axis) == 0 and not is_described(part)
    name = in_symbols(f"omega[{axis[0] + 1}]") if is_numbered else "ω about the middle axis"
    symmetric = central_axis(np.median(moments, axis=1)) != axis[0]
    where = "normal to the symmetry axis" if symmetric else "about the axis of the middle moment"
    units = OBSERVABLES["omega"].units
    return value, with_units(name, units), f"Angular velocity {where}"


def _angle(part: xr.Dataset) -> tuple[Array, str, str]:
    """Return (values (time, member), label, title) of the angle of axis 3 from the vertical."""
    w, x, y, z = np.moveaxis(part.attitude.transpose("time", "quat", "member").values, 1, 0)
    theta = np.degrees(2.0 * np.arctan2(np.hypot(x, y), np.hypot(w, z)))
    return theta, with_units("θ", "deg"), "Angle of axis 3 from the vertical"


def start_and_end(ds: xr.Dataset, axes: Axes | None = None) -> Figure:
    """Draw histograms of the components of the angular velocity at the start and at the end.

    Each histogram is scaled to its own peak.
    ds : result with omega or momentum; otherwise the start alone, from start_omega or
        start_momentum
    """
    part = thin_result(ds)
    omega, when = omega_or_momentum(part, "omega")
    names = {0: when} if len(omega) == 1 else {0: span(part, 0), -1: span(part, -1)}
    if np.ptp(omega):
        edges = np.linspace(omega.min(), omega.max(), 102)
    else:
        edges = omega.min() + np.linspace(-0.5, 0.5, 102)
    axes = axes or figure_of_result(ds, (7.0, 4.2)).add_subplot()
    for row in range(3):
        for time, name in names.items():
            count = np.histogram(omega[time, row], edges)[0]
            height = 0.85 * count / count.max() - row
            style: dict[str, Any] = {"color": BAND, "fill": True}
            if time:
                style = {"color": MEDIAN, "linewidth": 1.2}
            axes.stairs(height, edges, baseline=-row, label=None if row else name, **style)
    axes.set(
        xlabel=with_units(OBSERVABLES["omega"].long_name, OBSERVABLES["omega"].units),
        ylabel="members, rows scaled to their peaks",
        ylim=(-2.1, 1.0),
    )
    axes.set_yticks([0, -1, -2], [in_symbols(f"omega[{i}]") for i in (1, 2, 3)])
    axes.set_title("Spread of the angular velocity", fontsize=10, pad=20)
    legend_above(axes, 2)
    return figure_of(axes)


def drift_histogram(ds: xr.Dataset, axes: Axes | None = None) -> Figure:
    """Draw histograms of energy_drift_max and l2_drift_max of all members, with median and worst.

    The axes are logarithmic; the legend counts drifts of exactly 0. If a quantity is not conserved
    (attribute `conserved`), the title gives the reason.
    """
    is_narrow = axes is not None  # a third of a summary
    axes = axes or figure_of_result(ds, (7.0, 4.2)).add_subplot()
    drifts = {"E - work" if "work" in ds else "E": ds.energy_drift_max, "|L|²": ds.l2_drift_max}
    values = {
        symbol: drift.values[(ds.status.values == 0) & np.isfinite(drift.values)]
        for symbol, drift in drifts.items()
    }
    edges, top = _decades(list(values.values())), 5
    title, rows = ["Largest relative drift" + " of each member" * (not is_narrow)], 0
    styles: tuple[dict[str, Any], ...] = (
        {"color": CORE, "fill": True},
        {"color": INK, "linewidth": 1.2},
    )
    for (symbol, v), style, color in zip(values.items(), styles, (MEDIAN, INK), strict=True):
        count = np.histogram(v, edges)[0]
        top = max(top, count.max())
        label = _drift_label(symbol, v)
        if is_narrow:  # a number stays beside its word
            label = fill(label.replace(" (", "\xa0(").replace(") ", ")\xa0"), WIDE)
        rows += label.count("\n") + 1
        axes.stairs(count, edges, label=label, **style)
        worst = v.max(initial=0.0)
        if worst > 0.0:
            axes.axvline(max(np.median(v), edges[0]), color=color, linestyle="--", linewidth=1.0)
            place = axes.get_xaxis_transform()
            axes.plot(worst, 0.03, "v", color=color, markersize=7, transform=place)
        title += _unconserved(symbol, drifts[symbol])
    axes.set(
        xlabel="largest relative drift",
        ylabel="members per bin",
        xlim=(edges[0], edges[-1]),
        ylim=(0.7, 2 * top),
    )
    axes.set(xscale="log", yscale="log")
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_title("\n".join(title), fontsize=10 if len(title) == 1 else 9, pad=8 + 12 * rows)
    legend_above(axes, 1)
    return figure_of(axes)


def _unconserved(symbol: str, drift: xr.DataArray) -> list[str]:
    """Return why a quantity is not conserved, as lines of a title; [] if it is."""
    conserved = drift.attrs.get("conserved", "yes")
    if conserved == "yes":
        return []
    why = conserved.removeprefix("no").lstrip(":, ")
    return [fill(f"{symbol} is not conserved: {why}", WIDE)]


def _drifts_of_one(ds: xr.Dataset, axes: Axes) -> None:
    """Draw the relative drifts of one member against time, or write the largest ones if they were
    not saved."""
    lines, title = [], ["Relative drift"]
    for symbol, name, color, style in (
        ("E - work" if "work" in ds else "E", "energy_drift", MEDIAN, "-"),
        ("|L|²", "l2_drift", INK, "--"),
    ):
        largest = ds[f"{name}_max"]
        lines.append(f"{symbol}: at most {abs(float(largest.values[0])):.1e}")
        title += _unconserved(symbol, largest)
        if name in ds and ds.sizes["time"] > 2:
            values = abs(ds[name].values[:, 0])
            there = values > 0.0  # 0 at the start
            axes.plot(ds.time.values[there], values[there], style, color=color, label=lines[-1])
    is_drawn = bool(axes.lines)
    axes.set_title("\n".join(title), fontsize=9, pad=32 if is_drawn else None)
    if is_drawn:
        axes.set(xlabel=axis_label(ds.time), ylabel="size of the relative drift", yscale="log")
        legend_above(axes, 1)
    else:
        axes.set_axis_off()
        axes.text(0.5, 0.9, "\n".join(lines), ha="center", va="top", transform=axes.transAxes)


def _decades(values: list[Array]) -> Array:
    """Return edges of ten bins per decade around all positive values."""
    exponents = np.concatenate([np.log10(v[v > 0.0]) for v in values])
    first, last = -17.0, -15.0
    if exponents.size:
        first, last = np.floor(exponents.min()), np.floor(exponents.max()) + 1
    edges: Array = 10.0 ** np.linspace(first, last, round(10 * (last - first)) + 1)
    return edges


def _drift_label(symbol: str, v: Array) -> str:
    """Return the legend of a histogram of drifts."""
    zeros, median = int(np.count_nonzero(v == 0.0)), np.median(v) if v.size else 0.0
    label = f"{symbol}: median (¦) {median:.1e}, worst (▾) {v.max(initial=0.0):.1e}"
    return label + (f"; {count_text(zeros, 'member')} at 0" if zeros else "")
