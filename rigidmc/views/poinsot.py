"""Poinsot's construction: the inertia ellipsoid of a free body rolls on the invariable plane."""

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rigidmc.mechanics.free_top import analyse_free_top, solve_free_top
from rigidmc.mechanics.rotation import matrix, to_space
from rigidmc.physics.observables import OBSERVABLES
from rigidmc.results.labels import with_units
from rigidmc.results.principal_axes import in_principal_axes
from rigidmc.views.closed_motion import STATES
from rigidmc.views.figures import (
    GREY,
    HALO,
    MEDIAN,
    PATH,
    add_density,
    add_title,
    line_styles,
    mark_starts,
    name_powers,
)
from rigidmc.views.globes import is_free
from rigidmc.views.polhodes import period_of, polhode_of
from rigidmc.views.quadric import CIRCLE, Quadric, Vectors, draw_curve, draw_quadric, screen
from rigidmc.views.sample import (
    DENSE,
    FINE,
    LINES,
    figure_of_result,
    good_members,
    start_labels,
    starts_of,
    thin_result,
)

PERIODS = 8  # of the polhode in a herpolhode: more fill the ring between its circles


def poinsot(ds: xr.Dataset, figure: Figure | None = None) -> Figure:
    """Draw Poinsot's construction: the inertia ellipsoid rolls on the invariable plane.

    The point of omega moves on the ellipsoid along the polhode, and in the plane normal to L along
    the herpolhode. On the left the first member; on the right the herpolhodes of up to 20 members
    as lines, of more as a density, over at most eight periods. The lines are the closed form from
    the start of each member.

    ds : result of a free body with a start
    Raises ValueError if torques act.
    """
    good = in_principal_axes(thin_result(good_members(ds)))
    if not is_free(ds):
        rule = "leave out the effects of the scene, also those without a torque, such as g = 0"
        raise ValueError(f"poinsot needs free bodies: {rule}")
    moments, l, q = starts_of(good)
    if not l.any(axis=1).all():
        raise ValueError("poinsot needs turning bodies: a member is at rest")
    figure = figure or figure_of_result(ds, (11.0, 5.6))
    left, right = figure.subplots(1, 2, width_ratios=[1.0, 1.0])
    _herpolhodes(right, good, moments, l, q)
    _rolling(left, int(good.member[0]), moments[0], l[0], q[0])
    return figure


def _herpolhodes(axes: Axes, good: xr.Dataset, moments: Vectors, l: Vectors, q: Vectors) -> None:
    """Draw the herpolhodes of members: omega in the plane normal to L."""
    kinds = analyse_free_top(moments, l)
    periods = kinds.period[np.isfinite(kinds.period)]
    end = float(np.max(good.time.values, initial=0.0))
    end = min(end, PERIODS * float(np.median(periods))) if periods.size else end
    turns = end * float((np.linalg.norm(l, axis=1) / moments.min(1)).max())
    count = int(np.clip(turns / FINE, *DENSE))
    if len(l) > LINES:
        some = range(0, len(l), -(-len(l) // 1000))
        t = np.linspace(0.0, end, max(count, DENSE[0], STATES // len(some)))
        # members at the same times would show the steps of t as spokes
        shift = (t[1] - t[0]) * (0.618034 * np.arange(len(l)) % 1.0)
        curves = [_in_plane(moments[k], l[k], q[k], t + shift[k]) for k in some]
        x, y, _ = np.concatenate(curves).T
        add_density(axes, x, y, "states")
        wide = 1.05 * np.hypot(x, y).max()
        axes.set(xlim=(-wide, wide), ylim=(-wide, wide))
    else:
        t, labels = np.linspace(0.0, end, count), start_labels(good)
        starts = []
        same = {"color": MEDIAN} if len(l) == 1 else {}  # as on the left, where orange is polhode
        for k, style in enumerate(line_styles(len(l))):
            x, y, _ = _in_plane(moments[k], l[k], q[k], t).T
            axes.plot(x, y, label=labels[k], **{**style, **same})
            starts.append((x[0], y[0]))
            for radius in (np.hypot(x, y).min(), np.hypot(x, y).max()) if len(l) == 1 else ():
                axes.plot(radius * np.cos(CIRCLE), radius * np.sin(CIRCLE), color=GREY, lw=0.7)
        mark_starts(axes, *np.transpose(starts))
        axes.legend(fontsize=8, frameon=False, loc="lower left", bbox_to_anchor=(0, 1), ncols=4)
    up = with_units("angular velocity in the plane", OBSERVABLES["omega"].units)
    axes.set(aspect="equal", xlabel=up, ylabel=up)
    name_powers(axes)
    title = f"Herpolhode in the invariable plane, t = 0 to {end:.4g} s"
    add_title(axes, title, pad=6 if len(l) > LINES else 22 if len(l) <= 3 else 36)


def _in_plane(moments: Vectors, l: Vectors, q: Vectors, t: Vectors) -> Vectors:
    """Return omega (n, 3) [rad/s] in the axes of `_plane_axes` at times t (n,)."""
    motion = solve_free_top(moments, l, q, t)
    frame = np.stack(_plane_axes(to_space(q, l)))
    omega: Vectors = to_space(motion.attitude, motion.omega) @ frame.T
    return omega


def _rolling(axes: Axes, member: int, moments: Vectors, l: Vectors, q: Vectors) -> None:
    """Draw the ellipsoid on the invariable plane, with polhode and herpolhode of one period, at the
    time at which omega is farthest from L."""
    u, t = polhode_of(moments, l), period_of(moments, l)
    path = np.sqrt(moments.min() / (l @ (l / moments))) * _in_plane(moments, l, q, t)
    at = int(np.argmax(np.hypot(path[:, 0], path[:, 1])))
    attitude = solve_free_top(moments, l, q, t[at]).attitude
    on = Quadric(moments, np.stack(_plane_axes(to_space(q, l))) @ matrix(attitude))
    wide = 1.3 * max(np.hypot(path[:, 0], path[:, 1]).max(), 0.6)
    height = float(path[0, 2])
    rim = np.stack([wide * np.cos(CIRCLE), wide * np.sin(CIRCLE), height + 0.0 * CIRCLE], -1)
    axes.fill(*screen(rim)[:2], color="#e8e8e8", zorder=0)
    draw_quadric(axes, ("1", "2", "3"), on)
    axes.plot(*screen(path)[:2], color=MEDIAN, linewidth=1.0, label="herpolhode")
    draw_curve(axes, u / np.linalg.norm(l), "polhode", on, color=PATH, linewidth=2.0)
    outward = 10 if screen(path[at])[0] > 0.0 else -10  # keeps the names of the arrows apart
    for end, name, side in (
        (path[at], "ω", outward),
        (np.array([0.0, 0.0, height]), "L", -outward),
    ):
        x, y, _ = screen(np.stack([0.0 * end, end]))
        axes.annotate("", (x[1], y[1]), (x[0], y[0]), arrowprops={"arrowstyle": "-|>", "lw": 1.5})
        offset: dict[str, Any] = {"xytext": (side, 0), "textcoords": "offset points"}
        middle = (0.5 * x[1], 0.5 * y[1])
        axes.annotate(name, middle, ha="center", path_effects=HALO, **offset)
    x, y, _ = screen(rim)
    axes.set(xlim=(min(-1.25, x.min()), max(1.25, x.max())), ylim=(min(-1.4, y.min() - 0.3), 1.3))
    axes.legend(loc="lower center", ncols=2, fontsize=9, frameon=False)
    add_title(axes, f"Inertia ellipsoid and invariable plane, member {member}, t = {t[at]:.4g} s")


def _plane_axes(l: Vectors) -> tuple[Vectors, Vectors, Vectors]:
    """Return right-handed axes (3,) each: two in the plane normal to L (3,), and -L/|L| upward."""
    up = -l / np.linalg.norm(l)
    first = np.cross(np.eye(3)[np.argmin(np.abs(up))], up)
    first /= np.linalg.norm(first)
    return first, np.cross(up, first), up
