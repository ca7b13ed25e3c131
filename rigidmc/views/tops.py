"""Pictures of tops in motion: path of the axis, Euler angles, effective potential.

Each function takes a result and draws up to LINES members as lines, more as a density. Lines are
smooth: where the saves are too far apart, members are recomputed, see
`rigidmc.views.sample.member_paths`. Closed forms are results of the integrator "closed".
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rigidmc.errors import SceneError
from rigidmc.inputs.arrays import Array
from rigidmc.mechanics.lagrange_top import analyse_lagrange_top
from rigidmc.mechanics.rotation import to_space
from rigidmc.planning.saves import ATTITUDE, AXIS
from rigidmc.results.labels import axis_label, with_units
from rigidmc.views.attitudes import euler_of, saved_attitude
from rigidmc.views.caps import cap_points, draw_cap, draw_on_cap, narrow_cap
from rigidmc.views.closed_forms import (
    draw_effective_potential,
    draw_turning_angles,
    euler_angles,
    euler_curves,
    without_mean_rate,
)
from rigidmc.views.closed_motion import case_of_result, heavy_tops, symmetric_about_3
from rigidmc.views.figures import (
    add_density,
    add_title,
    figure_of,
    line_styles,
    mark_starts,
    name_powers,
)
from rigidmc.views.globes import axis_density
from rigidmc.views.quadric import draw_curve, draw_quadric, screen
from rigidmc.views.sample import (
    LINES,
    figure_of_result,
    good_members,
    member_paths,
    start_labels,
    thin_result,
    times_of,
)

NARROW = 60.0  # deg: the sphere hides the far side of loops and cusps around the vertical

GAPS = "\nφ and ψ are left out where axis 3 is near the vertical: their lines end"


def trajectory(ds: xr.Dataset, axes: Axes | None = None) -> Figure:
    """Draw the directions of body axis 3 in space.

    Up to 20 members are paths on the unit sphere, or, if they stay within 60 degrees of a space
    axis, on a cap around it. More members are a density, see
    `rigidmc.views.globes.axis_density`. For one heavy symmetric top, circles mark the turning
    angles.

    ds : result with a scene or with attitude; of more than 20 members with attitude
    """
    good = good_members(ds)
    if good.sizes["member"] > LINES:
        return axis_density(ds, axes)
    paths, note = member_paths(good, AXIS)
    tips = [to_space(path.attitude, (0.0, 0.0, 1.0)) for path in paths]
    styles, labels = line_styles(len(paths)), start_labels(good)
    axes = axes or figure_of_result(ds, (6.0, 6.4)).add_subplot()
    draw: Callable[..., None] = draw_curve
    place: Callable[..., Any] = screen
    cap = narrow_cap(tips, NARROW)
    if cap is None:
        draw_quadric(axes, ("x", "y", "z"))
    else:
        draw_cap(axes, cap, "xyz")
        draw, place = partial(draw_on_cap, cap=cap), partial(cap_points, cap)
    _draw_limits(axes, good, draw)
    for tip, style, label in zip(tips, styles, labels, strict=True):
        draw(axes, tip, label, **style)
    x, y, *_ = place(np.stack([tip[0] for tip in tips]))
    mark_starts(axes, x, y)
    axes.legend(loc="lower center", ncols=3, fontsize=9, frameon=False)
    add_title(axes, f"Path of axis 3 of the body in space, {times_of(paths)}", note)
    return figure_of(axes)


def _draw_limits(axes: Axes, good: xr.Dataset, draw: Callable[..., None]) -> None:
    """Draw the circles on which the axis of one heavy symmetric top turns back, by `draw`."""
    tops = heavy_tops(good) if good.sizes["member"] == 1 else None
    if tops is not None and tops.form[0] == 3:
        top = analyse_lagrange_top(
            *(v[0] for v in (tops.moments, tops.weight, tops.momentum, tops.attitude))
        )
        draw_turning_angles(axes, float(top.high), float(top.low), draw)


def angles(ds: xr.Dataset, figure: Figure | None = None) -> Figure:
    """Draw the Euler angles z-x-z against time: theta, and phi and psi minus their mean rates.

    Each member has its own mean rates. Near theta = 0 and pi, where phi and psi are not defined,
    their lines end, and the picture of one member is grey.

    ds : result with a scene or with attitude; of more than 20 members with attitude
    Raises ValueError if more than 20 members turn too far between saves.
    """
    good = good_members(ds)
    count = good.sizes["member"]
    if count > LINES:
        return _angle_densities(ds, figure)
    paths, note = member_paths(good, ATTITUDE)
    is_flat = count == 1 and _is_within_a_turn(paths[0].t, paths[0].attitude)
    figure = figure or figure_of_result(ds, (7.0, 4.8) if is_flat else (7.0, 7.0))
    if is_flat:
        (axes,) = (figure.add_subplot(),)
        euler_angles(paths[0].attitude, paths[0].t, axes)
        if note:
            is_whole = len(axes.get_legend_handles_labels()[1]) <= 3
            add_title(axes, "Euler angles (z-x-z)", note, pad=24 if is_whole else 38)
        return figure
    rows = figure.subplots(3, 1, sharex=True)
    labels, has_gaps = start_labels(good), False
    for path, style, label in zip(paths, line_styles(count), labels, strict=True):
        theta, *others = euler_curves(path.attitude)
        has_gaps |= bool(np.isnan(others[0]).any())
        curves = [theta, *(without_mean_rate(path.t, values)[0] for values in others)]
        for row, angle in zip(rows, curves, strict=True):
            row.plot(path.t, np.degrees(angle), label=label, **style)
    _name_rows(rows, axis_label(ds.time), note, GAPS if has_gaps else "")
    return figure


def _is_within_a_turn(t: Array, attitude: Array) -> bool:
    """Whether phi and psi minus their mean rates stay within a turn. The rates of a damped top
    change, and leave many turns, beside which theta in the same axes would be a straight line."""
    rests = [without_mean_rate(t, angle)[0] for angle in euler_curves(attitude)[1:]]
    return all(np.nanmax(rest) - np.nanmin(rest) < 2.0 * np.pi for rest in rests)


def _name_rows(rows: Any, time: str, note: str, gaps: str = "") -> None:
    """Label the rows of theta, phi and psi.

    gaps : why the lines have gaps, if they do
    """
    for row, name in zip(rows, ("θ", "φ − ⟨φ′⟩ t", "ψ − ⟨ψ′⟩ t"), strict=True):
        row.set_ylabel(with_units(name, "deg"))
    rows[2].set_xlabel(time)
    name_powers(rows[2])
    _, names = rows[0].get_legend_handles_labels()
    if names:
        rows[0].legend(
            loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=4, fontsize=8, frameon=False
        )
    add_title(
        rows[0],
        "Euler angles (z-x-z), less the mean rates ⟨φ′⟩, ⟨ψ′⟩ of each member" + gaps,
        note,
        pad=30 if len(names) > 4 else 20 if names else None,
    )


def _angle_densities(ds: xr.Dataset, figure: Figure | None) -> Figure:
    """Draw the Euler angles of many members as densities."""
    part = thin_result(ds.assign(attitude=saved_attitude(ds)))
    if part.sizes.get("time", 1) < 3:
        raise ValueError('angles needs three or more saves: run with every=... and keep="full"')
    angles, t = euler_of(part, "313", unwrap=True), part.time.values
    figure = figure or figure_of_result(ds, (7.5, 7.5))
    rows = figure.subplots(3, 1, sharex=True)
    ends = np.concatenate([t[:1], 0.5 * (t[1:] + t[:-1]), t[-1:]])[:: -(-t.size // 160)]
    edges = np.append(ends[ends < t[-1]], t[-1])
    for row, name in zip(rows, ("theta", "phi", "psi"), strict=True):
        values = angles[name].transpose("time", "member").values
        if name != "theta":
            values = values - np.polyfit(t - t[0], values, 1)[0] * (t - t[0])[:, None]
        add_density(row, np.repeat(t, values.shape[1]), np.degrees(values).ravel(), "states", edges)
    _name_rows(rows, axis_label(ds.time), "")
    return figure


def effective_potential(ds: xr.Dataset, axes: Axes | None = None) -> Figure:
    """Draw the potential in which theta of a heavy symmetric top moves, the energy and the turning
    angles of each member; of more than 20 members, the density of the potentials.

    theta is the angle of the symmetry axis from the vertical, see
    `rigidmc.mechanics.lagrange_steady.effective_potential`.

    ds : result of a scene with gravity on a body with two equal moments and its centre of mass on
        the third axis
    Raises ValueError for other scenes.
    """
    good = good_members(ds)
    try:
        tops = case_of_result(good)
    except SceneError as error:
        raise ValueError(f"effective_potential needs heavy symmetric tops: {error.rule}") from None
    if (tops.form < 1).any():
        raise ValueError("effective_potential needs heavy symmetric tops: no gravity acts on them")
    axes = axes or figure_of_result(ds, (7.0, 4.8)).add_subplot()
    shown = symmetric_about_3(tops)
    draw_effective_potential(
        shown.moments, shown.weight, shown.momentum, shown.attitude, axes, start_labels(good)
    )
    return figure_of(axes)
