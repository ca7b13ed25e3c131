"""Poinsot's pictures of a free body: polhodes on the momentum sphere or the inertia ellipsoid, and
the ellipsoid that rolls on the invariable plane.

`draw_polhodes` draws closed forms; `polhodes` and `poinsot` read a result.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from rigidmc.arrays import floats
from rigidmc.errors import OptionError, unknown
from rigidmc.figures import (
    GREY,
    HALO,
    INK,
    LIGHT,
    MEDIAN,
    PATH,
    add_density,
    add_title,
    figure_of,
    line_styles,
    new_figure,
)
from rigidmc.mechanics.free_top import analyse_free_top, solve_free_top
from rigidmc.mechanics.rotation import matrix, to_space
from rigidmc.physics.observables import OBSERVABLES
from rigidmc.results.frames import in_principal_axes
from rigidmc.results.labels import units_text, with_units
from rigidmc.views.globes import is_free, momentum_sphere
from rigidmc.views.quadric import CIRCLE, SPHERE, Quadric, draw_curve, draw_quadric, screen
from rigidmc.views.sample import (
    DENSE,
    FINE,
    KEYED,
    LINES,
    figure_of_result,
    good_members,
    member_paths,
    thin_result,
)
from rigidmc.views.sphere import curves_at_energy, family

SURFACES = ("sphere", "ellipsoid")
PERIODS = 8  # of the polhode in a herpolhode: more fill the ring between its circles

Vectors = NDArray[np.float64]  # (..., 3)


def draw_polhodes(
    moments: ArrayLike,
    momentum: ArrayLike,
    axes: Axes | None = None,
    surface: str = "sphere",
    energies: Sequence[float] = (),
) -> Figure:
    """Draw the curves that the momentum of a free body may follow, and the one that it follows.

    Energy ellipsoids cut the sphere |L| = const in polhodes, TdC Example 3.6. The polhode through
    `momentum` is coloured and shows start and direction; other energies are grey, the separatrix
    2 T I_mid = |L|^2 is black.

    moments (3,) [kg m^2], momentum (3,) [kg m^2/s] in principal axes
    surface : "sphere" of the momentum, or "ellipsoid" of inertia, on which omega moves
    energies : of the other polhodes at the same |L| [J]; by default, eight or sixteen are drawn
    """
    moments, l = floats(moments, "moments", 3), floats(momentum, "momentum", 3)
    axes = axes if axes is not None else new_figure("", (5.2, 5.4)).add_subplot()
    on = _draw_family(axes, moments, l, surface, energies)
    if l.any():
        (style,) = line_styles(1)
        _draw_path(axes, _polhode(moments, l), "this body", on, style)
    _finish(axes, moments, surface, str(analyse_free_top(moments, l).kind))
    return figure_of(axes)


def polhodes(
    ds: xr.Dataset,
    axes: Axes | None = None,
    surface: str = "sphere",
    energies: Sequence[float] = (),
) -> Figure:
    """Draw the polhodes of up to 20 members among polhodes of other energies; for more members, the
    density of `momentum_sphere`.

    Under torques, the lines are the paths of the momentum. The family of grey polhodes belongs to
    the first member's body and |L|.

    ds : result with a start
    surface : "sphere" of the momentum, or "ellipsoid" of inertia, on which omega moves
    energies : of the other polhodes, at the first member's |L| [J]; by default, eight or sixteen
    """
    good = in_principal_axes(good_members(ds))
    if good.sizes["member"] > LINES:
        if surface != "sphere" or energies:
            rule = f"for up to {LINES} members; select some, as in ds.isel(member=[0, 1])"
            raise OptionError(rule, at="surface" if surface != "sphere" else "energies")
        return momentum_sphere(ds, axes)
    moments, l, _ = starts(good)
    if surface == "ellipsoid" and np.ptp(moments, axis=0).max() > 1e-12 * moments.max():
        rule = "the members have different inertia ellipsoids: select one, as ds.isel(member=[0])"
        raise OptionError(rule, at="surface", value=surface)
    if is_free(ds):
        paths, note = [_polhode(*one) for one in zip(moments, l, strict=True)], ""
    else:
        dense, note = member_paths(ds)
        paths = [one.momentum for one in dense]
    axes = axes or figure_of_result(ds, (6.0, 6.4)).add_subplot()
    on = _draw_family(axes, moments[0], l[0], surface, energies)
    for member, path, style in zip(good.member.values, paths, line_styles(len(paths)), strict=True):
        if path.any():
            _draw_path(axes, path, f"member {member}" if len(paths) <= KEYED else None, on, style)
    kind = str(analyse_free_top(moments[0], l[0]).kind) if len(paths) == 1 and not note else note
    _finish(axes, moments[0], surface, kind if is_free(ds) or note else "path under torques")
    return figure_of(axes)


def _draw_family(
    axes: Axes, moments: Vectors, l: Vectors, surface: str, energies: Sequence[float]
) -> Quadric:
    """Draw a surface with the polhodes of one body, and its separatrices."""
    if surface not in SURFACES:
        raise unknown("surface", SURFACES, at="surface", value=surface, error=OptionError)
    on = Quadric(moments) if surface == "ellipsoid" else SPHERE
    draw_quadric(axes, ("1", "2", "3"), on)
    curves, separatrices = family(moments)
    for curve in curves if len(energies) == 0 else []:
        draw_curve(axes, curve, on=on, color=LIGHT, linewidth=0.9)
    for k, energy in enumerate(energies):
        colour = str(round(0.75 - 0.5 * k / max(1, len(energies) - 1), 2))
        for n, curve in enumerate(_at_energy(moments, l, energy)):
            label = None if n else f"T = {energy:.4g} {units_text('J')}"
            draw_curve(axes, curve, label, on, color=colour, linewidth=1.3)
    for n, curve in enumerate(separatrices):
        label = None if n else "separatrix"
        draw_curve(axes, curve, label, on, color=INK, linewidth=1.6)
    return on


def _at_energy(moments: Vectors, l: Vectors, energy: float) -> list[Vectors]:
    """Return the polhodes of an energy [J]; OptionError if the body does not reach it."""
    low, high = (0.5 * float(l @ l) / moment for moment in (moments.max(), moments.min()))
    if not low * (1.0 - 1e-9) <= energy <= high * (1.0 + 1e-9) or not low < high:
        size = f"{np.linalg.norm(l):.4g} {units_text('kg m2 s-1')}"
        rule = f"with |L| = {size}, the energy is {low:.6g} to {high:.6g} J"
        raise OptionError(rule, at="energies", value=energy)
    return curves_at_energy(moments, 2.0 * energy / float(l @ l))


def _draw_path(
    axes: Axes, l: Vectors, label: str | None, on: Quadric, style: dict[str, Any]
) -> None:
    """Draw the path of a momentum l (n, 3), its start, and an arrow along it."""
    with np.errstate(invalid="ignore"):  # a body at rest has no direction
        u = l / np.linalg.norm(l, axis=-1, keepdims=True)
    draw_curve(axes, u, label, on, linewidth=2.0, **style)
    x, y, _ = screen(on.points(u))
    face = style["color"] if on.is_seen(u[0]) else "white"
    axes.plot(x[:1], y[:1], "o", color=style["color"], markersize=6, markerfacecolor=face)
    at = len(u) // 12
    if np.hypot(x[at + 1] - x[at], y[at + 1] - y[at]) > 1e-9:
        arrow = {"arrowstyle": "-|>", "color": style["color"], "lw": 1.5}
        axes.annotate("", (x[at + 1], y[at + 1]), (x[at], y[at]), arrowprops=arrow)


def _finish(axes: Axes, moments: Vectors, surface: str, words: str) -> None:
    """Add a title and a legend; a marker stands for the starts."""
    axes.plot([], [], "o", color=GREY, markersize=6, label="start")
    axes.legend(loc="lower center", ncols=3, fontsize=9, frameon=False)
    values = ", ".join(f"{i:.3g}" for i in moments)
    name = "Momentum sphere" if surface == "sphere" else "Inertia ellipsoid"
    add_title(axes, f"{name} in principal axes, I = ({values}) kg m²\n{words}".rstrip())


def _polhode(moments: Vectors, l: Vectors) -> Vectors:
    """Return momenta (n, 3) over one period of the free motion from the momentum l (3,)."""
    attitude = (1.0, 0.0, 0.0, 0.0)
    path: Vectors = solve_free_top(moments, l, attitude, _period(moments, l)).momentum
    return path


def _period(moments: Vectors, l: Vectors) -> Vectors:
    """Return times over one period of the free motion from the momentum l (3,) [s]."""
    motion = analyse_free_top(moments, l)
    rate = float(motion.rate)
    period = float(motion.period)
    if not np.isfinite(period) or rate == 0.0:
        # if nothing moves, 1 s is as good as any time
        period = 40.0 / rate if rate > 0.0 else 1.0
    turns = float(np.linalg.norm(l / moments)) * period  # of omega, which exceeds the polhode's
    return np.linspace(0.0, period, int(np.clip(turns / 0.1, 721, DENSE[1])))


def starts(good: xr.Dataset) -> tuple[Vectors, Vectors, Vectors]:
    """Return (moments, momentum, attitude) of members at the start (member, ...), in principal
    axes."""
    moments = good.moments.transpose("member", "axis").values
    if "start_momentum" in good:
        l = good.start_momentum.transpose("member", "axis").values
    else:
        l = good.start_omega.transpose("member", "axis").values * moments
    if "start_attitude" in good:
        return moments, l, good.start_attitude.transpose("member", "quat").values
    return moments, l, np.tile([1.0, 0.0, 0.0, 0.0], (len(l), 1))


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
        raise ValueError("poinsot needs free bodies: energy and |L|^2 are not both conserved")
    moments, l, q = starts(good)
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
        t = np.linspace(0.0, end, DENSE[0])
        some = range(0, len(l), -(-len(l) // 1000))
        # members at the same times would show the steps of t as spokes
        shift = (t[1] - t[0]) * (0.618034 * np.arange(len(l)) % 1.0)
        found = [_in_plane(moments[k], l[k], q[k], t + shift[k]) for k in some]
        x, y, _ = np.concatenate(found).T
        add_density(axes, x, y, "states")
    else:
        t = np.linspace(0.0, end, count)
        for k, style in enumerate(line_styles(len(l))):
            x, y, _ = _in_plane(moments[k], l[k], q[k], t).T
            label = f"member {good.member.values[k]}" if len(l) <= KEYED else "_"
            axes.plot(x, y, linewidth=1.3, label=label, **style)
            axes.plot(x[:1], y[:1], "o", color=style["color"], markersize=5)
            for radius in (np.hypot(x, y).min(), np.hypot(x, y).max()) if len(l) == 1 else ():
                axes.plot(radius * np.cos(CIRCLE), radius * np.sin(CIRCLE), color=GREY, lw=0.7)
        axes.plot([], [], "o", color=GREY, markersize=5, label="start")
        axes.legend(fontsize=8, frameon=False, loc="lower left", bbox_to_anchor=(0, 1), ncols=4)
    up = with_units("angular velocity in the plane", OBSERVABLES["omega"].units)
    axes.set(aspect="equal", xlabel=up, ylabel=up)
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
    u, t = _polhode(moments, l), _period(moments, l)
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
        (path[at], r"$\omega$", outward),
        (np.array([0.0, 0.0, height]), "$L$", -outward),
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
    one = np.cross(np.eye(3)[np.argmin(np.abs(up))], up)
    one /= np.linalg.norm(one)
    return one, np.cross(up, one), up
