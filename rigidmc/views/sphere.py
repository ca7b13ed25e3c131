"""The unit sphere in pictures: directions, their density, Lambert's map, and Poinsot's polhodes."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import uniform_filter

from rigidmc.arrays import floats
from rigidmc.figures import GREY, HALO, INK, LIGHT, PATH, figure_of, new_figure
from rigidmc.mechanics.free_top import analyse_free_top, solve_free_top

# bins across a disc, averaged 3 x 3 (about 4 degrees): a thin ensemble stays visible under a path
BINS, SMOOTH = 120, 3


Curve = NDArray[np.float64]  # (n, 3)


def central_axis(moments: NDArray[np.float64]) -> int:
    """Return the axis (0 to 2) of the middle moment; if two moments are equal, of the third."""
    low, middle, high = map(int, np.argsort(moments, kind="stable"))
    same = 1e-9 * moments[high]
    if moments[middle] - moments[low] <= same:
        return high
    return low if moments[high] - moments[middle] <= same else middle


def polhodes(
    l: NDArray[np.float64], moments: NDArray[np.float64], points: int = 721
) -> NDArray[np.float64]:
    """Return closed curves (points, axis, member) through the directions l (axis, member).

    The curves circle the axis of the smallest or largest moment. With u = L/|L| and
    c = sum u_i^2/I_i = 2 T/L^2, the distance rho from axis e at the angle phi from the middle axis
    m obeys  rho^2 (cos^2 phi/I_m + sin^2 phi/I_a - 1/I_e) = c - 1/I_e.
    """
    phi, curves = np.linspace(0.0, 2.0 * np.pi, points), np.empty((points, *l.shape))
    with np.errstate(all="ignore"):
        for k, inverse in enumerate(1.0 / moments.T):
            u = l[:, k] / np.sqrt(l[:, k] @ l[:, k])
            c = u * u @ inverse
            order = np.argsort(inverse)
            a, m, e = order if c > inverse[order[1]] else order[::-1]
            slope = np.cos(phi) ** 2 * inverse[m] + np.sin(phi) ** 2 * inverse[a] - inverse[e]
            rho2 = (c - inverse[e]) / slope
            curves[:, e, k] = np.copysign(np.sqrt(1.0 - rho2.clip(0.0, 1.0)), u[e])
            curves[:, m, k] = np.sqrt(rho2) * np.cos(phi)
            curves[:, a, k] = np.sqrt(rho2) * np.sin(phi)
    return curves


def family(moments: NDArray[np.float64]) -> tuple[list[Curve], list[Curve]]:
    """Return (curves, separatrices) on the unit sphere, each (n, 3): the polhodes of one body at
    eight or sixteen energies, and the great circles 2 T I_mid = L^2 of an asymmetric body.

    The momentum of a symmetric body circles its axis; the momentum of a spherical body is fixed.
    """
    low, middle, high = map(int, np.argsort(moments, kind="stable"))
    axes, turn = np.eye(3), np.linspace(0.0, 2.0 * np.pi, 361)[:, None]
    if moments[low] == moments[high]:
        return [], []
    if not moments[low] < moments[middle] < moments[high]:
        axis = high if moments[low] == moments[middle] else low
        one, two = np.delete(axes, axis, axis=0)
        across = np.cos(turn) * one + np.sin(turn) * two
        angles = np.radians(np.arange(20, 161, 20))
        return [np.cos(angle) * axes[axis] + np.sin(angle) * across for angle in angles], []
    angles = np.radians([18, 36, 54, 72])
    # starts on the great circles from the ends of the outer axes to the middle one
    starts = [
        side * np.cos(angle) * axes[pole] + np.sin(angle) * axes[middle]
        for pole in (low, high)
        for side in (-1.0, 1.0)
        for angle in angles
    ]
    many = np.repeat(moments[:, None], len(starts), axis=1)
    curves = polhodes(np.array(starts).T, many, 361).transpose(2, 0, 1)
    slope = np.sqrt(
        (1.0 / moments[middle] - 1.0 / moments[high]) / (1.0 / moments[low] - 1.0 / moments[middle])
    )
    separatrices = []
    for side in (-1.0, 1.0):
        across = side * slope * axes[low] + axes[high]
        across /= np.linalg.norm(across)
        separatrices.append(np.cos(turn) * axes[middle] + np.sin(turn) * across)
    return list(curves), separatrices


def lambert(
    right: NDArray[np.float64], up: NDArray[np.float64], toward: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Project unit vectors by Lambert's azimuthal equal-area projection, (2, ...).

    The projection maps a hemisphere onto a disc of radius sqrt(2); vectors far behind the rim
    become nan.
    """
    scale: NDArray[np.float64] = np.sqrt(2.0 / (1.0 + np.where(toward > -0.5, toward, np.nan)))
    return np.stack([right, up]) * scale


def disc_density(
    v: NDArray[np.float64], sides: Sequence[int], limit: float
) -> list[NDArray[np.float64]]:
    """Return the density of unit vectors (time, axis, member) on discs, relative to an isotropic
    ensemble.

    sides : 1 or -1 for each disc, the side of the viewer;  limit : radius of the discs
    Empty bins are nan.
    """
    right, up, toward = np.moveaxis(v, 1, 0).reshape(3, -1)
    fine = (np.arange(8 * BINS) + 0.5) / (4 * BINS) - 1.0
    inside = np.hypot(fine, fine[:, None]) < 1.0
    area = inside.reshape(BINS, 8, BINS, 8).mean(axis=(1, 3))  # fraction of a bin on the disc
    isotropic = uniform_filter(area, SMOOTH, mode="constant") * (
        v[:, 0].size * (2.0 * limit / BINS) ** 2 / (4.0 * np.pi)
    )
    densities = []
    for side in sides:
        seen = side * toward >= 0.0
        flat = lambert(side * right[seen], up[seen], side * toward[seen])
        x, y = (flat / limit + 1.0) * (BINS / 2)
        place = y.clip(0, BINS - 1).astype(np.intp) * BINS + x.clip(0, BINS - 1).astype(np.intp)
        count = np.bincount(place, minlength=BINS**2).reshape(BINS, BINS).astype(float)
        count = uniform_filter(count, SMOOTH, mode="constant")
        present = (count > 0.5 / SMOOTH**2) & (area > 0.0)
        empty = np.full(count.shape, np.nan)
        densities.append(np.divide(count, isotropic, out=empty, where=present))
    return densities


VIEW = np.array([0.80, 0.45, 0.40])  # toward the reader; along an axis a sphere would look flat
CIRCLE = np.linspace(0.0, 2.0 * np.pi, 361)

Vectors = NDArray[np.float64]  # (..., 3)


def screen(v: Vectors) -> tuple[Vectors, Vectors, Vectors]:
    """Return (x, y, toward the reader) of vectors (..., 3), seen from VIEW with axis 3 upward."""
    toward = VIEW / np.linalg.norm(VIEW)
    right = np.cross((0.0, 0.0, 1.0), toward)
    right /= np.linalg.norm(right)
    return v @ right, v @ np.cross(toward, right), v @ toward


def draw_sphere(axes: Axes, names: tuple[str, str, str]) -> None:
    """Draw a unit sphere with outline, equator and three named axes."""
    axes.set_aspect("equal")
    axes.set_axis_off()
    axes.plot(np.cos(CIRCLE), np.sin(CIRCLE), color=INK, linewidth=1.0)
    equator = np.stack([np.cos(CIRCLE), np.sin(CIRCLE), 0.0 * CIRCLE], -1)
    draw_curve(axes, equator, color=LIGHT, linewidth=0.8)
    for k, name in enumerate(names):
        x, y, _ = screen(np.stack([np.eye(3)[k], 1.22 * np.eye(3)[k]]))
        axes.plot(x, y, color=GREY, linewidth=1.0)
        axes.annotate(
            name,
            (x[1], y[1]),
            ha="center",
            va="center",
            fontsize=10,
            path_effects=HALO,
            xytext=(0, 5),
            textcoords="offset points",
        )
    axes.set(xlim=(-1.25, 1.25), ylim=(-1.5, 1.4))


def draw_curve(axes: Axes, v: Vectors, label: str | None = None, **style: Any) -> None:
    """Draw a curve (n, 3) on the sphere: in full in front, thin and dotted behind."""
    x, y, z = screen(v)
    axes.plot(np.where(z >= 0.0, x, np.nan), np.where(z >= 0.0, y, np.nan), label=label, **style)
    behind = {**style, "linewidth": 0.6 * style["linewidth"], "linestyle": ":"}
    axes.plot(np.where(z < 0.0, x, np.nan), np.where(z < 0.0, y, np.nan), **behind)


def draw_polhodes(moments: ArrayLike, momentum: ArrayLike, axes: Axes | None = None) -> Figure:
    """Draw Poinsot's construction: the curves that the momentum of a free body may follow.

    Energy ellipsoids cut the sphere |L| = const in polhodes, TdC Example 3.6. The polhode through
    `momentum` is coloured and shows start and direction; other energies are grey, the separatrix
    2 T I_mid = |L|^2 is black.

    moments (3,) [kg m^2], momentum (3,) [kg m^2/s] in principal axes
    """
    axes = axes if axes is not None else new_figure("", (5.2, 5.4)).add_subplot()
    moments, momentum = floats(moments, "moments", 3), floats(momentum, "momentum", 3)
    draw_sphere(axes, ("1", "2", "3"))
    curves, separatrices = family(moments)
    for curve in curves:
        draw_curve(axes, curve, color=LIGHT, linewidth=0.9)
    for k, curve in enumerate(separatrices):
        label = None if k else "separatrix"
        draw_curve(axes, curve, label=label, color=INK, linewidth=1.6)
    size = np.linalg.norm(momentum)
    if size > 0.0:
        _this_body(axes, moments, momentum / size)
    axes.legend(loc="lower center", ncols=3, fontsize=9, frameon=False)
    values = ", ".join(f"{i:.3g}" for i in moments)
    title = f"Momentum sphere in body axes, I = ({values}) kg m²"
    axes.set_title(f"{title}\n{analyse_free_top(moments, momentum).kind}", fontsize=10)
    return figure_of(axes)


def _this_body(axes: Axes, moments: Vectors, u: Vectors) -> None:
    """Draw the polhode through u (3,), its start, and an arrow along it."""
    path = _polhode(moments, u)
    draw_curve(axes, path, color=PATH, linewidth=2.2, label="this body")
    x, y, z = screen(path)
    face = PATH if z[0] >= 0 else "white"
    style: dict[str, Any] = {"color": PATH, "markersize": 6, "markerfacecolor": face}
    axes.plot(x[:1], y[:1], "o", label="start", **style)
    at = len(path) // 12
    if np.hypot(x[at + 1] - x[at], y[at + 1] - y[at]) > 0.0:
        arrow = {"arrowstyle": "-|>", "color": PATH, "lw": 1.5}
        axes.annotate("", (x[at + 1], y[at + 1]), (x[at], y[at]), arrowprops=arrow)


def _polhode(moments: Vectors, u: Vectors) -> Vectors:
    """Return momenta (n, 3) over one period of the free motion from the momentum u (3,)."""
    motion = analyse_free_top(moments, u)
    rate = float(motion.rate)
    period = float(motion.period)
    if not np.isfinite(period) or rate == 0.0:
        # if nothing moves, 1 s is as good as any time
        period = 40.0 / rate if rate > 0.0 else 1.0
    t = np.linspace(0.0, period, 721)
    path: Vectors = solve_free_top(moments, u, (1.0, 0.0, 0.0, 0.0), t).momentum
    return path
