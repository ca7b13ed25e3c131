"""Phase portraits: theta against its rate, and the components of omega of free bodies."""

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rigidmc.inputs.arrays import Array
from rigidmc.mechanics.lagrange_steady import effective_potential
from rigidmc.mechanics.lagrange_top import analyse_lagrange_top
from rigidmc.mechanics.rotation import to_body, to_space
from rigidmc.physics.observables import OBSERVABLES
from rigidmc.planning.closed_form import ClosedMotion
from rigidmc.planning.saves import ATTITUDE, AXIS, BODY
from rigidmc.results.labels import in_symbols, with_units
from rigidmc.results.principal_axes import in_principal_axes, principal
from rigidmc.views.attitudes import saved_attitude
from rigidmc.views.closed_motion import heavy_tops, sample_of_motion, symmetric_about_3
from rigidmc.views.figures import (
    INK,
    LIGHT,
    add_density,
    add_title,
    line_styles,
    mark_starts,
    name_powers,
)
from rigidmc.views.globes import is_free
from rigidmc.views.sample import (
    LINES,
    MemberPath,
    figure_of_result,
    good_members,
    member_paths,
    omega_or_momentum,
    start_labels,
)
from rigidmc.views.sphere import family

SAME = 1e-9  # relative difference of constants that count as equal
PLANAR = 1e-6  # largest distance of the axis from a plane in which it swings


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
        part, of = sample_of_motion(good.assign(attitude=saved_attitude(good)))
        theta, rate = _many_swings(part, tops)
        add_density(axes, theta, rate, of)
    else:
        # AXIS is axis 3; any other axis turns as fast as the body at most
        kind = AXIS if tops is None or (tops.form == 3).all() else ATTITUDE
        paths, note = member_paths(good, kind)
        styles, labels = line_styles(len(paths)), start_labels(good)
        starts = []
        for path, style, label in zip(paths, styles, labels, strict=True):
            theta, rate = _swing(path, _swinging_axis(tops, path))
            jumps = np.abs(np.diff(theta, prepend=theta[:1])) > 180.0
            theta = np.where(jumps, np.nan, theta)
            axes.plot(theta, rate, label=label, **style)
            starts.append((theta[0], rate[0]))
        mark_starts(axes, *np.transpose(starts))
    if tops is not None:
        _levels(axes, symmetric_about_3(tops))
    axes.set(xlabel=with_units("θ", "deg"), ylabel=with_units("θ′", "rad s-1"))
    name_powers(axes)
    names = len(axes.get_legend_handles_labels()[1])
    if names:
        axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=4, fontsize=8, frameon=False)
    add_title(axes, "Phase portrait of the nutation", note, pad=36 if names > 4 else 24)
    return figure


def _swinging_axis(tops: ClosedMotion | None, path: MemberPath) -> Array:
    """Return the axis that theta belongs to, in principal axes (3,)."""
    axis: Array
    if tops is not None:
        axis = np.eye(3)[int(tops.form[0]) - 1]
        return axis
    axis = to_body(path.principal_attitude[0], to_space(path.attitude[0], (0.0, 0.0, 1.0)))
    return axis


def _swing(path: MemberPath, axis: Array) -> tuple[Array, Array]:
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


def _many_swings(part: xr.Dataset, tops: ClosedMotion | None) -> tuple[Array, Array]:
    """Return theta [deg] and its rate [rad/s] of all states of a sample."""
    omega, _ = omega_or_momentum(in_principal_axes(part), "omega")
    q = principal(part, "attitude").transpose("time", "quat", "member").values
    attitude = part.attitude.transpose("time", "quat", "member").values
    swings = []
    for k in range(part.sizes["member"]):
        path = MemberPath(
            k,
            part.time.values,
            attitude[..., k],
            q[..., k],
            omega[..., k],
            omega[..., k],
            part.moments.values[:, k],
        )
        swings.append(_swing(path, _swinging_axis(tops, path)))
    theta, rate = (np.concatenate(values) for values in zip(*swings, strict=True))
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
    theta = np.linspace(max(left, 1e-3), min(right, 359.999 if right > 180.0 else 179.999), 400)
    rate = np.linspace(bottom, top, 300)
    # beyond 180 degrees a swing in a plane comes back on the other side
    lean = np.radians(np.minimum(theta, 360.0 - theta))
    u = effective_potential(moments, weight, p_phi, p_psi, lean)
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
    axes.plot([], [], color=LIGHT, lw=0.8, label="other energies")
    if abs(p_phi - p_psi) <= SAME * scale and p_psi**2 < 4.0 * moments[0] * weight:
        upright = 0.5 * p_psi**2 / moments[2] + weight
        edge = np.sqrt(np.maximum(2.0 * (upright - u) / moments[0], 0.0))
        axes.plot(theta, edge, ":", color=INK, linewidth=1.3, label="separatrix")
        axes.plot(theta, -edge, ":", color=INK, linewidth=1.3)
    axes.set(xlim=(left, right), ylim=(bottom, top))


def _free_portrait(ds: xr.Dataset, good: xr.Dataset, figure: Figure | None) -> Figure:
    """Draw pairs of components of omega, in principal axes."""
    figure = figure or figure_of_result(ds, (12.0, 4.4))
    panels, count = figure.subplots(1, 3), good.sizes["member"]
    pairs, note = ((0, 1), (1, 2), (2, 0)), ""
    if count > LINES:
        part, of = sample_of_motion(good)
        part = in_principal_axes(part)
        omega, _ = omega_or_momentum(part, "omega")
        for axes, (i, j) in zip(panels, pairs, strict=True):
            add_density(axes, omega[:, i].ravel(), omega[:, j].ravel(), of)
        moments, l = part.moments.values[:, 0], omega[0, :, 0] * part.moments.values[:, 0]
        is_shared = np.ptp(part.moments.values, axis=1).max() <= 1e-12 * moments.max()
    else:
        paths, note = member_paths(good, BODY)
        moments, l = paths[0].moments, paths[0].momentum[0]
        is_shared = all(np.array_equal(path.moments, moments) for path in paths)
        labels = start_labels(good)
        for path, style, label in zip(paths, line_styles(count), labels, strict=True):
            for axes, (i, j) in zip(panels, pairs, strict=True):
                axes.plot(path.omega[:, i], path.omega[:, j], label=label, **style)
        first = np.stack([path.omega[0] for path in paths], -1)
        for axes, (i, j) in zip(panels, pairs, strict=True):
            mark_starts(axes, first[i], first[j])
    curves, separatrices = family(moments) if is_shared else ([], [])
    for axes, (i, j) in zip(panels, pairs, strict=True):
        for k, curve in enumerate(curves if count == 1 else []):
            omega = np.linalg.norm(l) * curve / moments
            label = "_" if k else "other energies"
            axes.plot(omega[:, i], omega[:, j], color=LIGHT, lw=0.8, zorder=0, label=label)
        for k, curve in enumerate(separatrices):
            omega = np.linalg.norm(l) * curve / moments
            label = "_" if k else "separatrix"
            axes.plot(omega[:, i], omega[:, j], ":", color=INK, linewidth=1.1, label=label)
        units = OBSERVABLES["omega"].units
        names = (with_units(in_symbols(f"omega[{k + 1}]"), units) for k in (i, j))
        axes.set(**dict(zip(("xlabel", "ylabel"), names, strict=True)))
        name_powers(axes)
    handles, labels = panels[0].get_legend_handles_labels()
    if labels:
        place: dict[str, Any] = {"loc": "outside lower center", "ncols": 8, "fontsize": 8}
        figure.legend(handles, labels, frameon=False, **place)
    add_title(panels[1], "Phase portrait of the free body, principal axes", note)
    return figure
