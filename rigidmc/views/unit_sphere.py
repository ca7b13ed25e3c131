"""A unit sphere drawn by lines, and Poinsot's construction on it: the polhodes of one body."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from rigidmc.arrays import floats
from rigidmc.mechanics.free_top import free_motion, free_top
from rigidmc.views.figure import GREY, HALO, INK, LIGHT, PATH, figure_of, new_figure
from rigidmc.views.sphere import family

VIEW = np.array([0.80, 0.45, 0.40])  # towards the reader; along an axis a sphere would look flat
CIRCLE = np.linspace(0.0, 2.0 * np.pi, 361)

Vectors = NDArray[np.float64]  # (..., 3)


def screen(v: Vectors) -> tuple[Vectors, Vectors, Vectors]:
    """(x, y, towards the reader) of vectors (..., 3), seen from VIEW with axis 3 upward."""
    toward = VIEW / np.linalg.norm(VIEW)
    right = np.cross((0.0, 0.0, 1.0), toward)
    right /= np.linalg.norm(right)
    return v @ right, v @ np.cross(toward, right), v @ toward


def draw_sphere(axes: Axes, names: tuple[str, str, str]) -> None:
    """A unit sphere with outline, equator and three named axes."""
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
    """A curve (n, 3) on the sphere: in full in front, thin and dotted behind."""
    x, y, z = screen(v)
    axes.plot(np.where(z >= 0.0, x, np.nan), np.where(z >= 0.0, y, np.nan), label=label, **style)
    behind = {**style, "linewidth": 0.6 * style["linewidth"], "linestyle": ":"}
    axes.plot(np.where(z < 0.0, x, np.nan), np.where(z < 0.0, y, np.nan), **behind)


def polhodes(moments: ArrayLike, momentum: ArrayLike, axes: Axes | None = None) -> Figure:
    """Poinsot's construction: the curves that the momentum of a free body may follow.

    Energy ellipsoids cut the sphere |L| = const in polhodes, TdC Example 3.6: grey for other
    energies, black for the separatrix 2 T I_mid = |L|^2, coloured through `momentum`, with its
    start and its direction.

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
    axes.set_title(f"{title}\n{free_motion(moments, momentum).kind}", fontsize=10)
    return figure_of(axes)


def _this_body(axes: Axes, moments: Vectors, u: Vectors) -> None:
    """The polhode through u (3,), its start, and an arrow along it."""
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
    """Momenta (n, 3) over one period of the free motion from the momentum u (3,)."""
    motion = free_motion(moments, u)
    rate = float(motion.rate)
    period = float(motion.period)
    if not np.isfinite(period) or rate == 0.0:
        # where nothing moves, 1 s is as good as any time
        period = 40.0 / rate if rate > 0.0 else 1.0
    t = np.linspace(0.0, period, 721)
    path: Vectors = free_top(moments, u, (1.0, 0.0, 0.0, 0.0), t).momentum
    return path
