"""Pictures of directions on a sphere: of momenta in the body, and of body axes in space."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from rigidmc.inputs.arrays import Array
from rigidmc.mechanics.rotation import to_space
from rigidmc.planning.saves import AXIS, BODY
from rigidmc.results.principal_axes import in_principal_axes, is_described
from rigidmc.views.caps import Cap, cap_around, cap_points, draw_cap, draw_on_cap
from rigidmc.views.closed_motion import sample_of_motion
from rigidmc.views.figures import CROWD, GREY, HALO, INK, PATH, add_title, figure_of
from rigidmc.views.quadric import EYE, Quadric, draw_curve, draw_quadric, screen
from rigidmc.views.sample import (
    MemberPath,
    drawn_members,
    figure_of_result,
    note_on,
    omega_or_momentum,
    span,
)
from rigidmc.views.sphere import (
    PIXELS,
    Curve,
    central_axis,
    even_directions,
    family,
    polhodes,
    smooth_density,
)

COARSE = 0.8  # mean cosine of the angle between two steps of a path; below it a path becomes dots,
# because lines would cut corners
WIDE = 48  # characters of a line above a third of a summary
LONG = 40.0  # length of a path in radii, about ten turns; of longer ones a picture shows one
BEHIND = 0.3  # opacity of what lies behind the sphere
RADIUS = EYE / np.sqrt(EYE**2 - 1.0)  # of the rim of the unit sphere in the picture
LAMP = np.array([-0.35, 0.5, 0.8]) / np.sqrt(1.0125)  # light, in the axes of the picture

Vectors = Array  # (time, axis, member)
Names = tuple[str, str, str]


def is_free(ds: xr.Dataset) -> bool:
    """Return whether the momentum of each member stays on its polhode."""
    conserved = [ds[f"{name}_drift_max"].attrs.get("conserved") for name in ("energy", "l2")]
    return conserved == ["yes", "yes"] and "work" not in ds


def momentum_density(
    ds: xr.Dataset, axes: Axes | None = None, path: MemberPath | None = None
) -> Figure:
    """Draw the direction of the angular momentum in the body: density, and paths of a few members.

    The picture shows the momentum sphere in perspective, with the axis of the middle moment upward
    (for a symmetric body, the symmetry axis); directions behind the sphere are faint. If all
    directions lie close to that axis, it shows the cap around it from above, with the angle of its
    rim. The density is of the motion between the saves where a closed form covers it; else of the
    saves, or of the last of two. The path of a free body is its polhode, the curve of constant
    energy and ``|L|^2`` through its start; under torques the path joins these states. If all
    members have the same body, the picture shows its polhodes at other energies, and the
    separatrices 2 T I_mid = L^2 of an asymmetric one.

    The axes are the principal axes, in which polhodes are simple, whatever the axes of the result.

    ds : result with omega or momentum; otherwise start_omega or start_momentum, as the title says
    path : the path to draw, instead of the paths of a few members
    """
    part, of_what = sample_of_motion(ds)
    part = in_principal_axes(part)
    l, when = omega_or_momentum(part, "momentum")
    moments = part.moments.values
    body = np.median(moments, axis=1)
    order = np.roll(np.arange(3), 2 - central_axis(body))
    is_one_body = np.ptp(moments, axis=1).max() <= 1e-12 * body.max()
    lines = family(body[order]) if is_one_body else ([], [])
    axes = axes or figure_of_result(ds, (6.4, 6.0)).add_subplot()
    few, free = drawn_members(l), is_free(ds)
    along, of = l[..., few], moments[:, few]
    if path is not None:
        along, of = path.momentum[..., None], path.moments[:, None]
    paths = polhodes(along[0], of) if free else along
    shown = l if len(l) > 2 else l[-1:]
    first, second, third = (str(i + 1) for i in order)
    names = first, second, third
    _draw_directions(axes, shown[:, order], paths[:, order], names, lines, _label(path), of_what)
    # polhodes and closed forms need no saves
    note = "" if free or of_what == "states" else note_on(part, BODY)
    named = "principal" if is_described(ds) else "body"
    add_title(axes, f"Direction of the angular momentum\nin {named} axes, {when}", note, wide=WIDE)
    return figure_of(axes)


def axis_density(
    ds: xr.Dataset, axes: Axes | None = None, path: MemberPath | None = None
) -> Figure:
    """Draw the direction of body axis 3 in space: density and paths, on a sphere or a cap around
    the vertical as in `momentum_density`.

    Axis 3 is the third column of the rotation matrix, (2(xz + wy), 2(yz - wx),
    w^2 - x^2 - y^2 + z^2).

    ds : result with attitude;  one : the path to draw, instead of the paths of a few members
    """
    if "attitude" not in ds:
        raise ValueError(
            "the direction of axis 3 needs the attitude, which was not saved: run with"
            ' save=("attitude",)'
        )
    part, of_what = sample_of_motion(ds)
    w, x, y, z = np.moveaxis(part.attitude.transpose("time", "quat", "member").values, 1, 0)
    e3 = np.stack(
        [2.0 * (x * z + w * y), 2.0 * (y * z - w * x), w * w - x * x - y * y + z * z], axis=1
    )
    axes = axes or figure_of_result(ds, (6.4, 6.0)).add_subplot()
    shown = e3 if len(e3) > 2 else e3[-1:]
    paths = e3[..., drawn_members(e3)]
    if path is not None:
        paths = to_space(path.attitude, (0.0, 0.0, 1.0))[..., None]
    _draw_directions(axes, shown, paths, ("x", "y", "z"), ([], []), _label(path), of_what)
    note = "" if of_what == "states" else note_on(part, AXIS)
    add_title(axes, f"Axis 3 of the body in space,\n{span(part)}", note, wide=WIDE)
    return figure_of(axes)


def _label(path: MemberPath | None) -> str:
    """Return the label of the paths in a picture."""
    return "single members" if path is None else f"member {path.member}"


def _draw_directions(
    axes: Axes,
    v: Vectors,
    paths: Vectors,
    names: Names,
    lines: tuple[list[Curve], list[Curve]],
    label: str,
    of: str,
) -> None:
    """Draw the density of v, lines along paths, and (polhodes, separatrices), on a sphere or a cap.

    names : of the three axes, the third one upward;  label : of the paths;  of : what is counted
    """
    with np.errstate(all="ignore"):
        v = v / np.linalg.norm(v, axis=1, keepdims=True)
        paths = paths / np.linalg.norm(paths, axis=1, keepdims=True)
    if not np.isfinite(v).any():
        axes.set_axis_off()
        words = "no direction: every member is at rest"
        axes.text(0.5, 0.5, words, ha="center", transform=axes.transAxes)
        return
    u = _columns(v)
    cap = cap_around(2, np.concatenate([u, _columns(paths)], 1).T)
    curves = _clear_paths(paths, v.shape[-1], 1.0 if cap is None else cap.radius)
    if cap is not None:
        _draw_on_cap(axes, u, curves, names, lines[1], cap, label, of)
    else:
        _draw_globe(axes, u, curves, names, lines, label, of)
    _legend(axes)


def _clear_paths(paths: Vectors, members: int, radius: float) -> list[Curve]:
    """Return the curves (n, 3) of paths that leave the density of the members visible, in a picture
    of this radius: all, or the beginning of the first one, or none."""
    curves = [*paths.transpose(2, 0, 1)]
    if members <= len(curves):
        return curves
    if _is_coarse(curves):
        return []
    length = np.nancumsum(np.linalg.norm(np.diff(paths, axis=0), axis=1), axis=0)
    if not length.size or length.max() <= LONG * radius:
        return curves
    return [curves[0][: 1 + np.searchsorted(length[:, 0], LONG * radius)]]


def _columns(v: Vectors) -> Array:
    """Return vectors (time, axis, member) as columns (3, n), without undefined ones."""
    u = np.moveaxis(v, 1, 0).reshape(3, -1)
    is_finite = np.isfinite(u).all(0)
    return u if is_finite.all() else u[:, is_finite]


def _draw_globe(
    axes: Axes,
    u: Array,
    paths: list[Curve],
    names: Names,
    lines: tuple[list[Curve], list[Curve]],
    label: str,
    of: str,
) -> None:
    """Draw directions u (3, n) on the sphere in perspective, and paths."""
    front = _columns(np.stack(paths, -1)) if len(paths) == 1 else u
    on = Quadric(turn=toward_reader(front if front.size else u))
    (x, y, depth), (even_x, even_y, even_depth) = (
        screen((on.turn @ w).T) for w in (u, even_directions())
    )
    layers = []
    for side in (-1.0, 1.0):  # behind, then in front
        seen, even_seen = side * (EYE * depth - 1.0) >= 0.0, side * (EYE * even_depth - 1.0) >= 0.0
        places = np.stack([x[seen], y[seen]]) / RADIUS
        even = np.stack([even_x[even_seen], even_y[even_seen]]) / RADIUS
        layers.append(smooth_density(places, u.shape[1], even, 1.0))
    norm = _scale_of(axes, layers, of)
    draw_ball(axes, on, names, lines, _over(_lit_ball(), layers, norm))
    is_coarse = _is_coarse(paths)
    for path in paths:
        if is_coarse:
            px, py, _ = screen(on.points(path[on.is_seen(path)]))
            axes.plot(px, py, ".", color=PATH, markersize=3, label=label)
        else:
            draw_curve(axes, path, label, on, color=PATH, linewidth=0.8)


def draw_ball(
    axes: Axes,
    on: Quadric,
    names: Names,
    lines: tuple[list[Curve], list[Curve]],
    image: Array | None = None,
) -> None:
    """Draw a lit sphere with named axes, polhodes and separatrices.

    image : its colours (PIXELS, PIXELS, 3), instead of grey
    """
    draw_quadric(axes, names, on)
    axes.set(xlim=(-1.3, 1.3), ylim=(-1.35, 1.45))
    rim = Circle((0.0, 0.0), RADIUS, facecolor="none", edgecolor="none")
    _draw_image(axes, _lit_ball() if image is None else image, rim)
    for n, curve in enumerate(lines[0]):
        label = None if n else "other energies"
        draw_curve(axes, curve, label, on, color=GREY, linewidth=0.6, alpha=0.7)
    for curve in lines[1]:
        draw_curve(axes, curve, "separatrix", on, color=INK, linewidth=1.2)


def toward_reader(u: Array) -> Array:
    """Return the turn about axis 3 by 0 or 180 degrees that brings most directions to the front."""
    is_behind = screen(u.mean(1) * (1.0, 1.0, 0.0))[2] < 0.0
    return np.diag([-1.0, -1.0, 1.0]) if is_behind else np.eye(3)


def _lit_ball() -> Array:
    """Return the colours (PIXELS, PIXELS, 3) of a grey ball in the light of the lamp."""
    x = (np.arange(PIXELS) + 0.5) / (0.5 * PIXELS) - 1.0
    z = np.sqrt(np.clip(1.0 - x**2 - x[:, None] ** 2, 0.0, 1.0))
    light = np.clip(LAMP[0] * x + LAMP[1] * x[:, None] + LAMP[2] * z, 0.0, 1.0)
    return np.repeat((0.80 + 0.17 * light)[..., None], 3, axis=2)


Layer = tuple[Array, Array]  # density, opacity


def _scale_of(axes: Axes, layers: list[Layer], of: str, pad: float = 0.0) -> LogNorm:
    """Return the scale of densities, whole decades, and draw it beside the axes."""
    sure = np.concatenate([density[opacity >= 0.5] for density, opacity in layers])
    sure = sure if sure.size else np.concatenate([d[np.isfinite(d)] for d, _ in layers])
    first, last = np.floor(np.log10(sure.min())), np.ceil(np.log10(sure.max()))
    norm = LogNorm(10.0**first, 10.0 ** max(last, first + 1), clip=True)
    bar = figure_of(axes).colorbar(
        ScalarMappable(norm, CROWD), ax=axes, location="right", shrink=0.6, aspect=24, pad=pad
    )
    bar.set_label(f"{of}, isotropic: 1", fontsize=9)
    bar.ax.tick_params(labelsize=8)
    return norm


def _over(image: Array, layers: list[Layer], norm: LogNorm) -> Array:
    """Return an image with the colours of densities over it, the last one on top."""
    for density, opacity in layers:
        strength = opacity * (1.0 if density is layers[-1][0] else BEHIND)
        colours = CROWD(norm(np.nan_to_num(density)))[..., :3]
        image = image + strength[..., None] * (colours - image)
    return image


def _draw_image(axes: Axes, image: Array, rim: Circle) -> None:
    """Draw an image inside a circle."""
    axes.add_patch(rim)
    (x, y), radius = rim.center, rim.radius
    extent = (x - radius, x + radius, y - radius, y + radius)
    axes.imshow(
        image, extent=extent, origin="lower", interpolation="bilinear", clip_path=rim, zorder=0
    )


def _draw_on_cap(
    axes: Axes,
    u: Array,
    paths: list[Curve],
    names: Names,
    separatrices: Sequence[Curve],
    cap: Cap,
    label: str,
    of: str,
) -> None:
    """Draw directions u (3, n) on a cap around axis 3."""
    rim = draw_cap(axes, cap, names)
    places = np.stack(cap_points(cap, u.T)) / cap.radius
    even = even_directions(np.radians(cap.angle)).T
    spread = np.stack(cap_points(cap._replace(side=1), even)) / cap.radius
    fraction = np.sin(0.5 * np.radians(cap.angle)) ** 2
    layer = smooth_density(places, u.shape[1], spread, fraction)
    paper = np.full((PIXELS, PIXELS, 3), 0.95)
    # the name of an axis stands beside the rim
    _draw_image(axes, _over(paper, [layer], _scale_of(axes, [layer], of, 0.08)), rim)
    for curve in separatrices:
        draw_on_cap(axes, curve, "separatrix", cap=cap, clip_path=rim, color=INK, linewidth=1.0)
    style: dict[str, Any] = {"linewidth": 0.8, "path_effects": HALO}
    if _is_coarse(paths):
        style = {"linestyle": "", "marker": ".", "markersize": 3}
    for path in paths if paths and len(paths[0]) > 2 else []:
        draw_on_cap(axes, path, label, cap=cap, clip_path=rim, color=PATH, **style)


def _is_coarse(paths: list[Curve]) -> bool:
    """Return whether the points of paths (n, 3) are too far apart to be joined."""
    if not paths:
        return False
    step = np.diff(np.stack(paths, -1), axis=0)
    length = np.linalg.norm(step, axis=1)
    along = np.nansum(step[1:] * step[:-1])
    return bool(along < COARSE * np.nansum(length[1:] * length[:-1]))


def _legend(axes: Axes) -> None:
    """Add a legend with one entry per kind of line."""
    entries = dict(zip(*reversed(axes.get_legend_handles_labels()), strict=True))
    if entries:
        axes.legend(
            entries.values(),
            entries,
            fontsize=8,
            frameon=False,
            handlelength=1.2,
            columnspacing=1.0,
            loc="lower center",
            ncols=3,
        )
