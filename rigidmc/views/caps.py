"""Caps of the unit sphere around an axis, seen along it: for directions that stay close to it."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle
from numpy.typing import NDArray

from rigidmc.inputs.arrays import Array
from rigidmc.views.figures import HALO, INK

MINUS = "\N{MINUS SIGN}"
POINT = 1e-9  # size of curves that are a point, far below the smallest of RIMS
# Rims of a cap [deg]: whole seconds, minutes and degrees of arc; a wider one is a sphere
RIMS = (
    *(angle / 3600 for angle in (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 30)),
    *(angle / 60 for angle in (1, 2, 5, 10, 20, 30)),
    *(1, 2, 5, 10, 20, 30, 45, 60),
)

Vectors = Array  # (..., 3)


class Cap(NamedTuple):
    """A cap of the sphere around a coordinate axis (0 to 2), on its side 1 or -1; its rim is at an
    angle [deg] from this axis."""

    axis: int
    side: int
    angle: float

    @property
    def radius(self) -> float:
        """Radius of the cap in the picture."""
        return float(2.0 * np.sin(np.radians(self.angle) / 2.0))


def cap_around(axis: int, u: Vectors, widest: float = 30.0) -> Cap | None:
    """Return the smallest cap around an axis that contains the directions u (n, 3); None if its rim
    would be farther than `widest` [deg]."""
    right, up, toward = u[:, _order(axis)].T
    if toward.min() <= 0.0 <= toward.max():
        return None
    angle = np.degrees(np.arctan2(np.hypot(right, up), np.abs(toward)).max())
    rim = next((rim for rim in RIMS if angle <= rim * (1.0 + 1e-9)), np.inf)
    return Cap(axis, 1 if toward.min() > 0.0 else -1, rim) if rim <= widest else None


def narrow_cap(curves: Sequence[Vectors], widest: float) -> Cap | None:
    """Return the cap around an axis that contains curves of directions (n, 3); None if its rim is
    farther than `widest` [deg], if all are one point, or if a curve has no direction."""
    u = np.concatenate(curves)
    if not np.ptp(u, axis=0).max() > POINT:  # also if one is nan
        return None
    return cap_around(int(np.argmax(np.abs(u).min(axis=0))), u, widest)


def cap_points(cap: Cap, u: Vectors) -> tuple[Vectors, Vectors]:
    """Return (x, y) of directions u (..., 3) on a cap, by Lambert's azimuthal equal-area
    projection; nan for directions far beyond the rim."""
    right, up, toward = (u[..., k] for k in _order(cap.axis))
    toward = cap.side * toward
    scale = np.sqrt(2.0 / (1.0 + np.where(toward > -0.5, toward, np.nan)))
    return cap.side * right * scale, up * scale


def draw_on_cap(
    axes: Axes, u: Vectors, label: str | None = None, *, cap: Cap, **style: Any
) -> None:
    """Draw the curve of directions u (n, 3) on a cap."""
    axes.plot(*cap_points(cap, u), label=label, **style)


def draw_cap(axes: Axes, cap: Cap, names: Sequence[str]) -> Circle:
    """Draw the rim and the centre of a cap, and return the rim; names : of the three axes."""
    axes.set_axis_off()
    rim = Circle((0.0, 0.0), cap.radius, facecolor="none", edgecolor=INK, linewidth=0.8, zorder=4)
    axes.add_patch(rim)
    axes.plot(0.0, 0.0, "o", color=INK, markersize=4, markeredgecolor="white", zorder=5)
    axes.plot([], [], color=INK, linewidth=0.8, label=f"rim: {_angle(cap.angle)} from centre")
    right, up, toward = (names[k] for k in _order(cap.axis))
    for x, y, sign, name in (
        (1, 0, cap.side, right),
        (-1, 0, -cap.side, right),
        (0, 1, 1, up),
        (0, -1, -1, up),
        (0, 0, cap.side, toward),
    ):
        axes.annotate(
            f"{'+' if sign > 0 else MINUS}{name}",
            xy=(x * cap.radius, y * cap.radius),
            xytext=(12 * x, 9 * (y or not x)),
            textcoords="offset points",
            ha="center",
            va="center",
            path_effects=HALO,
            zorder=5,
        )
    ends = (-1.2 * cap.radius, 1.2 * cap.radius)
    axes.set(xlim=ends, ylim=(-1.65 * cap.radius, 1.2 * cap.radius), aspect="equal")
    return rim


def _order(toward: int) -> NDArray[np.int_]:
    """Return the axes right, up and toward the reader, of which the last is given."""
    return np.roll(np.arange(3), 2 - toward)


def _angle(degrees: float) -> str:
    """Write an angle in degrees, minutes or seconds of arc."""
    unit, sign = next(
        (u, s)
        for u, s in ((1, "°"), (60, "\N{PRIME}"), (3600, "\N{DOUBLE PRIME}"))
        if degrees * u >= 1 - 1e-9 or u == 3600
    )
    return f"{degrees * unit:g}{sign}"
