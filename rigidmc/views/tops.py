"""Pictures of tops in motion: path of the axis, phase portrait, angles, effective potential.

Each function takes a result and draws up to LINES members as lines, more as a density. Lines are
smooth: where the saves are too far apart, members are recomputed, see
`rigidmc.views.sample.member_paths`. Closed forms are results of the integrator "closed".
"""

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rigidmc.errors import SceneError
from rigidmc.figures import (
    GREY,
    INK,
    LIGHT,
    add_density,
    add_title,
    figure_of,
    line_styles,
)
from rigidmc.mechanics.lagrange_top import (
    analyse_lagrange_top,
    with_axis_third,
)
from rigidmc.mechanics.lagrange_top import (
    effective_potential as potential_of,
)
from rigidmc.mechanics.rotation import to_body, to_space
from rigidmc.physics.observables import OBSERVABLES
from rigidmc.planning.closed_form import ClosedMotion, case_of
from rigidmc.planning.initial import block_rows, initial_block_of, make_sampler
from rigidmc.planning.turns import ATTITUDE
from rigidmc.results.frames import in_principal_axes, principal
from rigidmc.results.labels import axis_label, with_units
from rigidmc.scene.scene import scene_of
from rigidmc.views.attitudes import euler_of, saved_attitude
from rigidmc.views.closed_forms import (
    draw_effective_potential,
    draw_turning_angles,
    euler_angles,
    euler_curves,
    mean_rate,
)
from rigidmc.views.globes import axis_sphere, is_free
from rigidmc.views.quadric import draw_curve, draw_quadric, screen
from rigidmc.views.sample import (
    KEYED,
    LINES,
    MemberPath,
    figure_of_result,
    good_members,
    member_paths,
    note_on,
    omega_or_momentum,
    thin_result,
)
from rigidmc.views.sphere import family

Floats = NDArray[np.float64]

SAME = 1e-9  # relative difference of constants that count as equal
PLANAR = 1e-6  # largest distance of the axis from a plane in which it swings


def trajectory(ds: xr.Dataset, axes: Axes | None = None) -> Figure:
    """Draw the path of body axis 3 on the unit sphere in space; of more than 20 members, the
    density of `axis_sphere`.

    For one heavy symmetric top, circles mark the turning angles.

    ds : result with a scene or with attitude
    """
    good = good_members(ds)
    if good.sizes["member"] > LINES:
        return axis_sphere(ds, axes)
    paths, note = member_paths(good)
    axes = axes or figure_of_result(ds, (6.0, 6.4)).add_subplot()
    draw_quadric(axes, ("x", "y", "z"))
    tops = heavy_tops(good) if len(paths) == 1 else None
    if tops is not None and tops.form[0] == 3:
        one = analyse_lagrange_top(
            *(v[0] for v in (tops.moments, tops.weight, tops.momentum, tops.attitude))
        )
        draw_turning_angles(axes, float(one.high), float(one.low))
    for path, style in zip(paths, line_styles(len(paths)), strict=True):
        tip = to_space(path.attitude, (0.0, 0.0, 1.0))
        draw_curve(axes, tip, _name(path, len(paths)), linewidth=1.5, **style)
        x, y, _ = screen(tip)
        axes.plot(x[:1], y[:1], "o", color=style["color"], markersize=6)
    axes.plot([], [], "o", color=GREY, markersize=6, label="start")
    axes.legend(loc="lower center", ncols=3, fontsize=9, frameon=False)
    add_title(axes, f"Path of axis 3 of the body in space, {_span(paths)}", note)
    return figure_of(axes)


def angles(ds: xr.Dataset, figure: Figure | None = None) -> Figure:
    """Draw the Euler angles z-x-z against time: theta, and phi and psi minus their mean rates.

    Each member has its own mean rates. Near theta = 0 and pi, where phi and psi are not defined,
    lines end.

    ds : result with a scene or with attitude; of more than 20 members with attitude
    Raises ValueError if more than 20 members turn too far between saves.
    """
    good = good_members(ds)
    count = good.sizes["member"]
    if count > LINES:
        return _angle_densities(ds, figure)
    paths, note = member_paths(good)
    figure = figure or figure_of_result(ds, (7.0, 4.8) if count == 1 else (7.0, 7.0))
    if count == 1:
        (axes,) = (figure.add_subplot(),)
        euler_angles(paths[0].attitude, paths[0].t, axes)
        if note:
            add_title(axes, "Euler angles (z-x-z)", note, pad=24)
        return figure
    rows = figure.subplots(3, 1, sharex=True)
    for path, style in zip(paths, line_styles(count), strict=True):
        for row, values in zip(rows, euler_curves(path.attitude), strict=True):
            rate = 0.0 if row is rows[0] else mean_rate(path.t, values)
            angle = np.degrees(values - rate * (path.t - path.t[0]))
            row.plot(path.t, angle, linewidth=1.3, label=_name(path, count), **style)
    _name_rows(rows, axis_label(ds.time), note)
    return figure


def _name_rows(rows: Any, time: str, note: str) -> None:
    """Label the rows of theta, phi and psi."""
    for row, name in zip(rows, ("theta", "phi - mean rate", "psi - mean rate"), strict=True):
        row.set_ylabel(with_units(name.replace("-", "\N{MINUS SIGN}"), "deg"))
    rows[2].set_xlabel(time)
    _, names = rows[0].get_legend_handles_labels()
    if names:
        rows[0].legend(
            loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=4, fontsize=8, frameon=False
        )
    add_title(
        rows[0],
        "Euler angles (z-x-z), without the mean rates of each member",
        note,
        pad=30 if len(names) > 4 else 20 if names else None,
    )


def _angle_densities(ds: xr.Dataset, figure: Figure | None) -> Figure:
    """Draw the Euler angles of many members as densities."""
    part = thin_result(ds.assign(attitude=saved_attitude(ds)))
    if part.sizes.get("time", 1) < 3:
        raise ValueError('angles needs three or more saves: run with every=... and keep="full"')
    found, t = euler_of(part, "313", unwrap=True), part.time.values
    figure = figure or figure_of_result(ds, (7.5, 7.5))
    rows = figure.subplots(3, 1, sharex=True)
    ends = np.concatenate([t[:1], 0.5 * (t[1:] + t[:-1]), t[-1:]])[:: -(-t.size // 160)]
    edges = np.append(ends[ends < t[-1]], t[-1])
    for row, name in zip(rows, ("theta", "phi", "psi"), strict=True):
        values = found[name].transpose("time", "member").values
        if name != "theta":
            values = values - np.polyfit(t - t[0], values, 1)[0] * (t - t[0])[:, None]
        add_density(row, np.repeat(t, values.shape[1]), np.degrees(values).ravel(), "states", edges)
    _name_rows(rows, axis_label(ds.time), "")
    return figure


def effective_potential(ds: xr.Dataset, axes: Axes | None = None) -> Figure:
    """Draw the potential in which theta of a heavy symmetric top moves, the energy and the turning
    angles of each member; of more than 20 members, the density of the potentials.

    theta is the angle of the symmetry axis from the vertical, see
    `rigidmc.mechanics.lagrange_top.effective_potential`.

    ds : result of a scene with gravity on a body with two equal moments and its centre of mass on
        the third axis
    Raises ValueError for other scenes.
    """
    good = good_members(ds)
    try:
        tops = _case(good)
    except SceneError as error:
        raise ValueError(f"effective_potential needs heavy symmetric tops: {error.rule}") from None
    if (tops.form < 1).any():
        raise ValueError("effective_potential needs heavy symmetric tops: no gravity acts on them")
    axes = axes or figure_of_result(ds, (7.0, 4.8)).add_subplot()
    shown = _axis_third(tops)
    draw_effective_potential(shown.moments, shown.weight, shown.momentum, shown.attitude, axes)
    return figure_of(axes)


def _case(good: xr.Dataset) -> ClosedMotion:
    """Return the ClosedMotion of members of a result; SceneError if no closed form covers them."""
    scene = scene_of(good)
    model, members = scene.model, np.asarray(good.member.values, dtype=np.int64)
    known = make_sampler(model, scene.run), members, True, block_rows(model.effects, False)
    return case_of(model.effects, *initial_block_of(model, *known))


def heavy_tops(good: xr.Dataset) -> ClosedMotion | None:
    """Return the ClosedMotion of members that are all heavy symmetric tops; None for others."""
    try:
        tops = _case(good)
    except (SceneError, ValueError, AttributeError, TypeError, KeyError):
        return None
    return tops if (tops.form > 0).all() else None


def _axis_third(tops: ClosedMotion) -> ClosedMotion:
    """Relabel the axes of heavy symmetric tops so that the symmetry axis is the third."""
    moments, momentum = tops.moments.copy(), tops.momentum.copy()
    attitude = tops.attitude.copy()
    for form in np.unique(tops.form):
        of = tops.form == form
        turned = with_axis_third(int(form), moments[of].T, momentum[of].T, attitude[of].T)
        moments[of], momentum[of], attitude[of] = (v.T for v in turned)
    return tops._replace(moments=moments, momentum=momentum, attitude=attitude)


def phase_portrait(ds: xr.Dataset, figure: Figure | None = None) -> Figure:
    """Draw the motion in phase space: of free bodies, pairs of components of omega; of tops with a
    torque, theta against its rate.

    theta is the angle of axis 3 from the vertical (of a heavy symmetric top, of its symmetry axis);
    of an axis that swings in a plane, it counts from 0 to 360 degrees. Black lines are
    separatrices: 2 T I_mid = |L|^2 of a free body, the energy of the upright top of a heavy top
    with L_z = L_3. Grey lines have other energies.

    ds : result with a scene or with states; of more than 20 members with states
    """
    good = good_members(ds)
    if is_free(ds):
        return _free_portrait(ds, good, figure)
    tops = heavy_tops(good)
    figure = figure or figure_of_result(ds, (7.0, 5.2))
    axes = figure.add_subplot()
    note = ""
    if good.sizes["member"] > LINES:
        part = thin_result(good.assign(attitude=saved_attitude(good)))
        theta, rate = _many_swings(part, tops)
        add_density(axes, theta, rate, "states")
    else:
        paths, note = member_paths(good)
        for path, style in zip(paths, line_styles(len(paths)), strict=True):
            theta, rate = _swing(path, _swinging_axis(tops, path))
            jumps = np.abs(np.diff(theta, prepend=theta[:1])) > 180.0
            theta = np.where(jumps, np.nan, theta)
            axes.plot(theta, rate, linewidth=1.5, label=_name(path, len(paths)), **style)
            axes.plot(theta[:1], rate[:1], "o", color=style["color"], markersize=5)
    if tops is not None:
        _levels(axes, _axis_third(tops))
    axes.set(xlabel=with_units("theta", "deg"), ylabel=with_units("rate of theta", "rad s-1"))
    if axes.get_legend_handles_labels()[1]:
        axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=4, fontsize=8, frameon=False)
    add_title(axes, "Phase portrait of the nutation", note, pad=24)
    return figure


def _swinging_axis(tops: ClosedMotion | None, path: MemberPath) -> Floats:
    """Return the axis that theta belongs to, in principal axes (3,)."""
    axis: Floats
    if tops is not None:
        axis = np.eye(3)[int(tops.form[0]) - 1]
        return axis
    axis = to_body(path.principal_attitude[0], to_space(path.attitude[0], (0.0, 0.0, 1.0)))
    return axis


def _swing(path: MemberPath, axis: Floats) -> tuple[Floats, Floats]:
    """Return theta [deg] and its rate [rad/s] (n,).

    With the vertical s in the body, s' = s x omega:  theta' = -axis . (s x omega)/sin theta.
    """
    s = to_body(path.principal_attitude, (0.0, 0.0, 1.0))
    sine = np.linalg.norm(np.cross(axis, s), axis=-1)
    with np.errstate(all="ignore"):
        rate = -np.cross(s, path.omega) @ axis / sine
    theta = np.degrees(np.arctan2(sine, s @ axis))
    u = to_space(path.principal_attitude, axis)
    at = np.argmax(sine)
    # 1e-300: an axis that stays vertical has no plane, and every side of it is the same
    n = u[at, :2] / max(sine[at], 1e-300)
    if np.abs(u[:, 0] * n[1] - u[:, 1] * n[0]).max() > PLANAR:
        return theta, rate
    side = u[:, 0] * n[0] + u[:, 1] * n[1] < 0.0
    return np.where(side, 360.0 - theta, theta), np.where(side, -rate, rate)


def _many_swings(part: xr.Dataset, tops: ClosedMotion | None) -> tuple[Floats, Floats]:
    """Return theta [deg] and its rate [rad/s] of all states of a sample."""
    omega, _ = omega_or_momentum(in_principal_axes(part), "omega")
    q = principal(part, "attitude").transpose("time", "quat", "member").values
    own = part.attitude.transpose("time", "quat", "member").values
    found = []
    for k in range(part.sizes["member"]):
        path = MemberPath(
            k,
            part.time.values,
            own[..., k],
            q[..., k],
            omega[..., k],
            omega[..., k],
            part.moments.values[:, k],
        )
        found.append(_swing(path, _swinging_axis(tops, path)))
    theta, rate = (np.concatenate(values) for values in zip(*found, strict=True))
    return theta, rate


def _levels(axes: Axes, tops: ClosedMotion) -> None:
    """Draw lines of constant energy and the separatrix of tops with the same constants."""
    kinds = analyse_lagrange_top(tops.moments, tops.weight, tops.momentum, tops.attitude)
    scale = np.abs(tops.momentum).max() + np.sqrt(tops.moments[:, 0] * np.abs(tops.weight)).max()
    shared = [
        np.ptp(tops.moments, axis=0).max() / tops.moments.max(),
        np.ptp(tops.weight) / np.abs(tops.weight).max(),
        np.ptp(kinds.p_phi) / scale,
        np.ptp(kinds.p_psi) / scale,
    ]
    if max(shared) > SAME:
        return
    moments, weight = tops.moments[0], float(tops.weight[0])
    p_phi, p_psi = float(kinds.p_phi[0]), float(kinds.p_psi[0])
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    theta = np.linspace(max(left, 1e-3), min(right, 360.0 if right > 180.0 else 179.999), 400)
    rate = np.linspace(bottom, top, 300)
    u = potential_of(moments, weight, p_phi, p_psi, np.radians(theta))
    energy = u + 0.5 * moments[0] * rate[:, None] ** 2
    most = u.min() + 0.5 * moments[0] * np.abs(axes.get_ylim()).max() ** 2
    levels = np.linspace(u.min(), most, 9)[1:]
    axes.contour(
        theta,
        rate,
        energy,
        levels=levels,
        colors=LIGHT,
        linewidths=0.8,
        linestyles="solid",
        zorder=0,
    )
    if abs(p_phi - p_psi) <= SAME * scale and p_psi**2 < 4.0 * moments[0] * weight:
        upright = 0.5 * p_psi**2 / moments[2] + weight
        edge = np.sqrt(np.maximum(2.0 * (upright - u) / moments[0], 0.0))
        axes.plot(theta, edge, "--", color=INK, linewidth=1.3, label="separatrix")
        axes.plot(theta, -edge, "--", color=INK, linewidth=1.3)
    axes.set(xlim=(left, right), ylim=(bottom, top))


def _free_portrait(ds: xr.Dataset, good: xr.Dataset, figure: Figure | None) -> Figure:
    """Draw pairs of components of omega, in principal axes."""
    figure = figure or figure_of_result(ds, (12.0, 4.4))
    panels, count = figure.subplots(1, 3), good.sizes["member"]
    pairs, note = ((0, 1), (1, 2), (2, 0)), ""
    if count > LINES:
        part = in_principal_axes(thin_result(good))
        omega, _ = omega_or_momentum(part, "omega")
        note = note_on(part, ATTITUDE)
        for axes, (i, j) in zip(panels, pairs, strict=True):
            add_density(axes, omega[:, i].ravel(), omega[:, j].ravel(), "states")
        moments, l = part.moments.values[:, 0], omega[0, :, 0] * part.moments.values[:, 0]
        is_shared = np.ptp(part.moments.values, axis=1).max() <= 1e-12 * moments.max()
    else:
        paths, note = member_paths(good)
        moments, l = paths[0].moments, paths[0].momentum[0]
        is_shared = all(np.array_equal(path.moments, moments) for path in paths)
        for path, style in zip(paths, line_styles(count), strict=True):
            for axes, (i, j) in zip(panels, pairs, strict=True):
                x, y = path.omega[:, i], path.omega[:, j]
                axes.plot(x, y, linewidth=1.5, label=_name(path, count), **style)
                axes.plot(x[:1], y[:1], "o", color=style["color"], markersize=5)
    curves, separatrices = family(moments) if is_shared else ([], [])
    for axes, (i, j) in zip(panels, pairs, strict=True):
        for curve in curves if count == 1 else []:
            omega = np.linalg.norm(l) * curve / moments
            axes.plot(omega[:, i], omega[:, j], color=LIGHT, linewidth=0.8, zorder=0)
        for k, curve in enumerate(separatrices):
            omega = np.linalg.norm(l) * curve / moments
            label = "_" if k else "separatrix"
            axes.plot(omega[:, i], omega[:, j], "--", color=INK, linewidth=0.9, label=label)
        units = OBSERVABLES["omega"].units
        names = (with_units(f"$\\omega_{k + 1}$", units) for k in (i, j))
        axes.set(**dict(zip(("xlabel", "ylabel"), names, strict=True)))
    handles, labels = panels[0].get_legend_handles_labels()
    if labels:
        place: dict[str, Any] = {"loc": "outside lower center", "ncols": 8, "fontsize": 8}
        figure.legend(handles, labels, frameon=False, **place)
    add_title(panels[1], "Phase portrait of the free body, principal axes", note)
    return figure


def _name(path: MemberPath, count: int) -> str:
    """Return the label of a member's line; lines of many members have none."""
    return f"member {path.member}" if count <= KEYED else "_"


def _span(paths: list[MemberPath]) -> str:
    """Describe the times that the paths cover."""
    return f"t = {paths[0].t[0]:.5g} to {max(path.t[-1] for path in paths):.5g} s"
