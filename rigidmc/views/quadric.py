"""The unit sphere and the inertia ellipsoid in perspective: outline, named axes, curves in front
and behind."""

from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes

from rigidmc.inputs.arrays import Array, Bools
from rigidmc.views.figures import GREY, HALO, INK, LIGHT

VIEW = np.array([0.80, 0.45, 0.40])  # toward the reader; along an axis a sphere would look flat
TOWARD = VIEW / np.linalg.norm(VIEW)
RIGHT = np.cross((0.0, 0.0, 1.0), TOWARD) / np.hypot(*TOWARD[:2])
EYE = 6.0  # distance of the eye from the centre; the surface has a radius of at most 1
CIRCLE = np.linspace(0.0, 2.0 * np.pi, 361)

Vectors = Array  # (..., 3)


def screen(v: Vectors) -> tuple[Vectors, Vectors, Vectors]:
    """Return (x, y, toward the reader) of vectors (..., 3), seen from VIEW with axis 3 upward."""
    depth = v @ TOWARD
    nearer = EYE / (EYE - depth)
    return nearer * (v @ RIGHT), nearer * (v @ np.cross(TOWARD, RIGHT)), depth


class Quadric(NamedTuple):
    """The unit sphere, or with `moments` (3,) the inertia ellipsoid, turned by `turn` (3, 3).

    A direction u of the momentum is the normal at its point: on the sphere u itself, on the
    ellipsoid  sum I_i x_i^2 = min I  the point of omega,  x = sqrt(min I/(2 T)) omega.
    """

    moments: Vectors | None = None
    turn: Vectors = np.eye(3)

    def points(self, u: Vectors) -> Vectors:
        """Return the points (..., 3) of directions u (..., 3)."""
        if self.moments is None:
            return u @ self.turn.T
        x = u / self.moments / np.sqrt((u * u / self.moments).sum(-1, keepdims=True))
        points: Vectors = np.sqrt(self.moments.min()) * x @ self.turn.T
        return points

    def is_seen(self, u: Vectors) -> Bools:
        """Return whether the reader sees the points of directions u (..., 3), which are not behind
        the surface."""
        to_eye = (u @ self.turn.T) * (EYE * TOWARD - self.points(u))  # along the normals
        seen: Bools = to_eye.sum(-1) >= 0.0
        return seen

    def outline(self) -> Vectors:
        """Return the directions (n, 3) of the points on the rim that the reader sees."""
        toward = TOWARD @ self.turn
        right = np.cross(toward, np.eye(3)[np.argmin(np.abs(toward))])
        right /= np.linalg.norm(right)
        across = np.outer(np.cos(CIRCLE), right) + np.outer(np.sin(CIRCLE), np.cross(toward, right))
        u: Vectors = across
        # each step is a factor EYE nearer: 3e-10 after 12
        for _ in range(12):
            sine = ((u @ self.turn.T) * self.points(u)).sum(-1, keepdims=True) / EYE
            u = np.sqrt(1.0 - sine * sine) * across + sine * toward
        return u


SPHERE = Quadric()


def draw_quadric(axes: Axes, names: tuple[str, str, str], on: Quadric = SPHERE) -> None:
    """Draw a sphere or an ellipsoid with outline, equator and three named axes."""
    axes.set_aspect("equal")
    axes.set_axis_off()
    x, y, _ = screen(on.points(on.outline()))
    axes.plot(x, y, color=INK, linewidth=1.0)
    equator = np.stack([np.cos(CIRCLE), np.sin(CIRCLE), 0.0 * CIRCLE], -1)
    draw_curve(axes, equator, on=on, color=LIGHT, linewidth=0.8)
    for k, name in enumerate(names):
        end = on.points(np.eye(3)[k])
        x, y, _ = screen(np.stack([end, end + 0.22 * on.turn[:, k]]))
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


def draw_curve(
    axes: Axes, u: Vectors, label: str | None = None, on: Quadric = SPHERE, **style: Any
) -> None:
    """Draw the curve of directions u (n, 3): in full in front, thin and dotted behind."""
    x, y, _ = screen(on.points(u))
    front = on.is_seen(u)
    axes.plot(np.where(front, x, np.nan), np.where(front, y, np.nan), label=label, **style)
    behind = {**style, "linewidth": 0.6 * style["linewidth"], "linestyle": ":"}
    axes.plot(np.where(front, np.nan, x), np.where(front, np.nan, y), **behind)
