"""The momentum in the body: polhodes on the momentum sphere or the inertia ellipsoid.

`draw_polhodes` draws closed forms; `polhodes` reads a result.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from rigidmc.errors import OptionError, unknown
from rigidmc.inputs.arrays import floats
from rigidmc.mechanics.free_top import analyse_free_top, solve_free_top
from rigidmc.planning.saves import BODY, MOST
from rigidmc.results.labels import units_text
from rigidmc.results.principal_axes import in_principal_axes
from rigidmc.views.caps import cap_points, draw_cap, draw_on_cap, narrow_cap
from rigidmc.views.figures import (
    INK,
    LIGHT,
    add_title,
    figure_of,
    line_styles,
    mark_starts,
    new_figure,
)
from rigidmc.views.globes import is_free, momentum_density
from rigidmc.views.quadric import SPHERE, Quadric, Vectors, draw_curve, draw_quadric, screen
from rigidmc.views.sample import (
    DENSE,
    LINES,
    figure_of_result,
    good_members,
    member_paths,
    start_labels,
    starts_of,
    times_of,
)
from rigidmc.views.sphere import curves_at_energy, family

SURFACES = ("sphere", "ellipsoid")
NARROW = 10.0  # deg: paths that stay so close to an axis would be a dot on the sphere


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
    _check_surface(surface)
    moments, l = floats(moments, "moments", 3), floats(momentum, "momentum", 3)
    axes = axes if axes is not None else new_figure("", (5.2, 5.4)).add_subplot()
    on = _draw_family(axes, moments, l, surface, energies)
    if l.any():
        (style,) = line_styles(1)
        u = polhode_of(moments, l) / np.linalg.norm(l)
        _draw_path(axes, u, "this body", on, style)
        _mark_starts(axes, [u], on)
    _add_key(axes)
    _add_title(axes, moments, surface, str(analyse_free_top(moments, l).kind))
    return figure_of(axes)


def polhodes(
    ds: xr.Dataset,
    axes: Axes | None = None,
    surface: str = "sphere",
    energies: Sequence[float] = (),
) -> Figure:
    """Draw the directions of the angular momentum in the body: of free bodies, their polhodes.

    Up to 20 members are lines among polhodes of other energies, on a sphere, or, if they stay
    within 10 degrees of a principal axis, on a cap around it. More members are a density, see
    `rigidmc.views.globes.momentum_density`. Under torques, lines are the paths
    of the momentum. The grey polhodes belong to the first member's body and |L|.

    ds : result with a start; under torques, also with omega or momentum, or with its scene
    surface : "sphere" of the momentum, or "ellipsoid" of inertia, on which omega moves
    energies : of the other polhodes, at the first member's |L| [J]; by default, eight or sixteen
    """
    _check_surface(surface)
    good = in_principal_axes(good_members(ds))
    if good.sizes["member"] > LINES:
        if surface != "sphere" or energies:
            rule = f"for up to {LINES} members; select some, as in ds.isel(member=[0, 1])"
            raise OptionError(rule, at="surface" if surface != "sphere" else "energies")
        return momentum_density(ds, axes)
    moments, l, _ = starts_of(good)
    if surface == "ellipsoid" and np.ptp(moments, axis=0).max() > 1e-12 * moments.max():
        rule = "the members have different inertia ellipsoids: select one, as ds.isel(member=[0])"
        raise OptionError(rule, at="surface", value=surface)
    if is_free(ds):
        curves, note = [polhode_of(*path) for path in zip(moments, l, strict=True)], ""
        words = str(analyse_free_top(moments[0], l[0]).kind) if len(l) == 1 else ""
    else:
        paths, note = member_paths(ds, BODY)
        curves, words = [path.momentum for path in paths], f"path under torques, {times_of(paths)}"
    curves = [_directions(curve) for curve in curves]
    labels = start_labels(good)
    axes = axes or figure_of_result(ds, (6.0, 6.4)).add_subplot()
    cap = narrow_cap(curves, NARROW) if surface == "sphere" and not energies else None
    if cap is not None:
        draw_cap(axes, cap, "123")
    else:
        on = _draw_family(axes, moments[0], l[0], surface, energies)
    for u, label, style in zip(curves, labels, line_styles(len(curves)), strict=True):
        if cap is not None:
            thin = {**style, "linewidth": 0.7}  # many turns of a wobble would fill a ring
            draw_on_cap(axes, u, label, cap=cap, **thin)
        elif np.isfinite(u).any():
            _draw_path(axes, u, label, on, style)
    if cap is not None:
        mark_starts(axes, *cap_points(cap, np.stack([u[0] for u in curves])))
    else:
        _mark_starts(axes, curves, on)
    _add_key(axes)
    _add_title(axes, moments[0], surface, words, note)
    return figure_of(axes)


def _check_surface(surface: str) -> None:
    """Raise OptionError for an unknown surface."""
    if surface not in SURFACES:
        raise unknown("surface", SURFACES, at="surface", value=surface, error=OptionError)


def _directions(l: Vectors) -> Vectors:
    """Return the directions of momenta l (n, 3), nan at rest and where a momentum reverses through
    zero."""
    with np.errstate(invalid="ignore"):
        u = l / np.linalg.norm(l, axis=-1, keepdims=True)
        reverses = (u[1:] * u[:-1]).sum(-1) < np.cos(MOST)
    u[1:][reverses] = np.nan
    directions: Vectors = u
    return directions


def _draw_family(
    axes: Axes, moments: Vectors, l: Vectors, surface: str, energies: Sequence[float]
) -> Quadric:
    """Draw a surface with the polhodes of one body, and its separatrices."""
    on = Quadric(moments) if surface == "ellipsoid" else SPHERE
    draw_quadric(axes, ("1", "2", "3"), on)
    curves, separatrices = family(moments)
    for n, curve in enumerate(curves if len(energies) == 0 else []):
        label = None if n else "other energies"
        draw_curve(axes, curve, label, on, color=LIGHT, linewidth=0.9)
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
    axes: Axes, u: Vectors, label: str | None, on: Quadric, style: dict[str, Any]
) -> None:
    """Draw a path of directions u (n, 3), and an arrow along it."""
    draw_curve(axes, u, label, on, **style)
    x, y, _ = screen(on.points(u))
    at = len(u) // 12
    if np.hypot(x[at + 1] - x[at], y[at + 1] - y[at]) > 1e-9:
        arrow = {"arrowstyle": "-|>", "color": style["color"], "lw": 1.5}
        axes.annotate("", (x[at + 1], y[at + 1]), (x[at], y[at]), arrowprops=arrow)


def _mark_starts(axes: Axes, curves: Sequence[Vectors], on: Quadric) -> None:
    """Mark the first directions of curves (n, 3), after a start at rest."""
    beginnings = [u[np.isfinite(u).all(-1)][:1] for u in curves]
    starts = np.concatenate(beginnings)
    x, y, _ = screen(on.points(starts))
    mark_starts(axes, x, y, on.is_seen(starts))


def _add_key(axes: Axes) -> None:
    """Add a legend below a sphere."""
    axes.legend(loc="lower center", ncols=3, fontsize=9, frameon=False)


def _add_title(axes: Axes, moments: Vectors, surface: str, words: str, note: str = "") -> None:
    """Name the surface, its axes and the moments of the first body in the title."""
    values = ", ".join(f"{i:.3g}" for i in moments)
    name = "Momentum sphere" if surface == "sphere" else "Inertia ellipsoid"
    title = f"{name} in principal axes, I = ({values}) kg m²\n{words}".rstrip()
    add_title(axes, title, note)


def polhode_of(moments: Vectors, l: Vectors) -> Vectors:
    """Return momenta (n, 3) over one period of the free motion from the momentum l (3,)."""
    attitude = (1.0, 0.0, 0.0, 0.0)
    path: Vectors = solve_free_top(moments, l, attitude, period_of(moments, l)).momentum
    return path


def period_of(moments: Vectors, l: Vectors) -> Vectors:
    """Return times over one period of the free motion from the momentum l (3,) [s]."""
    motion = analyse_free_top(moments, l)
    rate = float(motion.rate)
    period = float(motion.period)
    if not np.isfinite(period) or rate == 0.0:
        # if nothing moves, 1 s is as good as any time
        period = 40.0 / rate if rate > 0.0 else 1.0
    turns = float(np.linalg.norm(l / moments)) * period  # of omega, which exceeds the polhode's
    return np.linspace(0.0, period, int(np.clip(turns / 0.1, 721, DENSE[1])))
