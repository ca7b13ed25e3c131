"""Pictures of directions: of momenta in the body, and of body axes in space."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.patches import Circle
from numpy.typing import NDArray

from rigidmc.figures import DENSITY, HALO, INK, PATH, add_title, figure_of
from rigidmc.planning.turns import AXIS, BODY
from rigidmc.results.frames import in_principal_axes, is_described
from rigidmc.views.sample import (
    drawn_members,
    figure_of_result,
    note_on,
    omega_or_momentum,
    span,
    thin_result,
)
from rigidmc.views.sphere import central_axis, disc_density, lambert, polhodes

COARSE = 0.8  # mean cosine of the angle between two steps of a path; below it a path becomes dots,
# because lines would cut corners

# Rims of a cap [deg]: whole seconds, minutes and degrees of arc
CAPS = (
    *(angle / 3600 for angle in (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 30)),
    *(angle / 60 for angle in (1, 2, 5, 10, 20, 30)),
    *(1, 2, 5, 10, 20, 30, 45, 60),
)

Vectors = NDArray[np.float64]  # (time, axis, member)


def is_free(ds: xr.Dataset) -> bool:
    """Return whether the momentum of each member stays on its polhode."""
    conserved = [ds[f"{name}_drift_max"].attrs.get("conserved") for name in ("energy", "l2")]
    return conserved == ["yes", "yes"] and "work" not in ds


def momentum_sphere(ds: xr.Dataset, axes: Axes | None = None) -> Figure:
    """Draw the direction of the angular momentum in the body: density, and paths of a few members.

    The picture shows two hemispheres in Lambert's equal-area projection, seen along the axis of the
    middle moment (for a symmetric body, the symmetry axis), or one cap that contains all members.
    The density includes all saves, or only the last of two. The path of a free body is its polhode,
    the curve of constant energy and |L|^2 through its start; under torques the path joins the
    saves. If all members have the same asymmetric body, the picture shows its separatrices
    2 T I_mid = L^2: great circles, which are straight lines in this projection.

    The axes are the principal axes, in which polhodes are simple, whatever the axes of the result.

    ds : result with omega or momentum; otherwise start_omega or start_momentum, as the title says
    """
    part = in_principal_axes(thin_result(ds))
    l, when = omega_or_momentum(part, "momentum")
    moments = part.moments.values
    body = np.median(moments, axis=1)
    order = np.roll(np.arange(3), 2 - central_axis(body))  # axes right, up, toward the reader
    right, up, toward = body[order]
    with np.errstate(all="ignore"):
        slope = np.sqrt((toward / right - 1.0) / (1.0 - toward / up))
    one_body = np.ptp(moments, axis=1).max() <= 1e-12 * body.max()
    axes = axes or figure_of_result(ds, (8.0, 5.2)).add_subplot()
    few, free = drawn_members(l), is_free(ds)
    paths = polhodes(l[0][:, few], moments[:, few]) if free else l[..., few]
    slopes = [slope, -slope] if one_body and 0.0 < slope < np.inf else []
    shown = l if len(l) > 2 else l[-1:]
    _hemispheres(axes, shown[:, order], paths[:, order], [str(i + 1) for i in order], slopes)
    note = "" if free else note_on(part, BODY)  # polhodes need no saves
    named = "principal" if is_described(ds) else "body"
    add_title(axes, f"Direction of the angular momentum in {named} axes, {when}", note)
    return figure_of(axes)


def axis_sphere(ds: xr.Dataset, axes: Axes | None = None) -> Figure:
    """Draw the direction of body axis 3 in space, from above (+z) and below: density and paths.

    Axis 3 is the third column of the rotation matrix, (2(xz + wy), 2(yz - wx),
    w^2 - x^2 - y^2 + z^2); projection and times as in `momentum_sphere`.

    ds : result with attitude
    """
    if "attitude" not in ds:
        raise ValueError(
            'axis_sphere needs the attitude, which was not saved: run with save=("attitude",)'
        )
    part = thin_result(ds)
    w, x, y, z = np.moveaxis(part.attitude.transpose("time", "quat", "member").values, 1, 0)
    e3 = np.stack(
        [2.0 * (x * z + w * y), 2.0 * (y * z - w * x), w * w - x * x - y * y + z * z], axis=1
    )
    axes = axes or figure_of_result(ds, (8.0, 5.2)).add_subplot()
    shown = e3 if len(e3) > 2 else e3[-1:]
    _hemispheres(axes, shown, e3[..., drawn_members(e3)], ["x", "y", "z"])
    add_title(axes, f"Axis 3 of the body in space, {span(part)}", note_on(part, AXIS))
    return figure_of(axes)


def _hemispheres(
    axes: Axes, v: Vectors, paths: Vectors, names: list[str], slopes: Sequence[float] = ()
) -> None:
    """Draw the density of v and lines along paths on two discs or one cap.

    names : of the axes right, up and toward the reader;  slopes : of separatrices
    """
    with np.errstate(all="ignore"):
        v = v / np.linalg.norm(v, axis=1, keepdims=True)
        paths = paths / np.linalg.norm(paths, axis=1, keepdims=True)
    axes.set_axis_off()
    if not np.isfinite(v).any():
        words = "no direction: every member is at rest"
        axes.text(0.5, 0.5, words, ha="center", transform=axes.transAxes)
        return
    sides, angle = _visible(
        np.concatenate([np.moveaxis(w, 1, 0).reshape(3, -1) for w in (v, paths)], 1)
    )
    limit = 2.0 * np.sin(np.radians(angle) / 2.0)
    shown = disc_density(v, sides, limit)
    first, last = np.floor(np.log10(np.nanmin(shown))), np.ceil(np.log10(np.nanmax(shown)))
    norm = LogNorm(10.0**first, 10.0 ** max(last, first + 1))
    for disc, side in enumerate(sides):
        centre = 2.45 * limit * disc
        image, rim = _disc(axes, shown[disc], norm, centre, limit)
        _lines(axes, paths, rim, side, slopes)
        _names(axes, names, rim, side, max(slopes, default=0.0) > 1.0)
    axes.set(
        xlim=(-1.2 * limit, centre + 1.2 * limit), ylim=(-1.2 * limit, 1.2 * limit), aspect="equal"
    )
    _legend(axes, None if angle == 90 else f"rim: {_angle(angle)} from centre", len(sides) > 1)
    bar = figure_of(axes).colorbar(
        image, ax=axes, location="bottom", shrink=0.5, aspect=40, pad=0.01
    )
    bar.set_label("density (isotropic: 1)", fontsize=9)
    bar.ax.tick_params(labelsize=8)


def _visible(directions: NDArray[np.float64]) -> tuple[list[int], float]:
    """Return (sides, angle of the rim [deg]) of two discs, or of the cap that contains all
    directions (right, up, toward)."""
    right, up, toward = directions
    if np.nanmin(toward) <= 0.0 <= np.nanmax(toward):
        return [1, -1], 90
    widest = np.degrees(np.nanmax(np.arctan2(np.hypot(right, up), np.abs(toward))))
    rim = next((angle for angle in CAPS if widest <= angle * (1.0 + 1e-9)), 90)
    return [1 if np.nanmin(toward) > 0.0 else -1], rim


def _angle(degrees: float) -> str:
    """Write an angle in degrees, minutes or seconds of arc."""
    unit, sign = next(
        (u, s)
        for u, s in ((1, "°"), (60, "\N{PRIME}"), (3600, "\N{DOUBLE PRIME}"))
        if degrees * u >= 1 - 1e-9 or u == 3600
    )
    return f"{degrees * unit:g}{sign}"


def _disc(
    axes: Axes, shown: NDArray[Any], norm: LogNorm, centre: float, limit: float
) -> tuple[AxesImage, Circle]:
    """Draw the image of a density on a disc, and the rim of the disc."""
    rim = Circle((centre, 0.0), limit, facecolor="none", edgecolor=INK, linewidth=0.8, zorder=4)
    axes.add_patch(rim)
    box = (centre - limit, centre + limit, -limit, limit)
    axes.plot(centre, 0.0, "o", color=INK, markersize=4, markeredgecolor="white", zorder=5)
    image = axes.imshow(
        shown, DENSITY, norm, extent=box, origin="lower", interpolation="nearest", clip_path=rim
    )
    return image, rim


def _lines(axes: Axes, paths: Vectors, rim: Circle, side: int, slopes: Sequence[float]) -> None:
    """Draw separatrices and the paths of single members on a disc."""
    centre, limit = rim.center[0], rim.radius
    for slope in slopes:
        x = np.array([-limit, limit]) / np.hypot(1.0, slope)
        style: dict[str, Any] = {"color": INK, "linewidth": 0.8, "zorder": 3}
        axes.plot(centre + x, slope * x, "--", label="separatrices", **style)
    if len(paths) < 3:
        return
    step = np.diff(paths, axis=0)
    length = np.linalg.norm(step, axis=1)
    dense = np.nansum(step[1:] * step[:-1]) >= COARSE * np.nansum(length[1:] * length[:-1])
    style = {"linestyle": "", "marker": ".", "markersize": 3}
    if dense:
        style = {"linewidth": 0.8, "path_effects": HALO}
    for right, up, toward in paths.transpose(2, 1, 0):
        x, y = lambert(side * right, up, side * toward)
        axes.plot(x + centre, y, color=PATH, clip_path=rim, label="single members", **style)


def _names(axes: Axes, names: list[str], rim: Circle, side: int, steep: bool) -> None:
    """Label the axes around a disc and at its centre; steep : separatrices cross above it."""
    centre, limit = rim.center[0], rim.radius
    places = ((1, 0, side, 0), (-1, 0, -side, 0), (0, 1, 1, 1), (0, -1, -1, 1), (0, 0, side, 2))
    for x, y, sign, name in places:
        offset = (12 * x, 9 * y) if name < 2 else (14, 0) if steep else (0, 9)
        axes.annotate(
            f"${'+' if sign > 0 else '-'}{names[name]}$",
            xy=(centre + x * limit, y * limit),
            xytext=offset,
            textcoords="offset points",
            ha="center",
            va="center",
            path_effects=HALO,
            zorder=5,
        )


def _legend(axes: Axes, note: str | None, two: bool) -> None:
    """Add a legend with one entry per kind of line, and a note on the rim as its title."""
    entries = dict(zip(*reversed(axes.get_legend_handles_labels()), strict=True))
    if not entries and not note:
        return
    place: dict[str, Any] = {"loc": "lower left", "bbox_to_anchor": (0.85, 0.0)}
    axes.legend(
        entries.values(),
        entries,
        title=note,
        fontsize=8,
        title_fontsize=8,
        frameon=False,
        handlelength=1.4,
        **({"loc": "lower center"} if two else place),
    )
