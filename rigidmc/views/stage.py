"""Solids and curves in perspective, drawn from far to near: the stage of the pages
(`rigidmc/views/web/stage.js`) in the axes of matplotlib."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgb, to_rgba
from numpy.typing import ArrayLike

from rigidmc.inputs.arrays import Array, Bools
from rigidmc.views.surfaces import TONES, Surface, cut

EYE = 5.0  # distance of the eye from the middle, relative to the reach of the stage
LAMP = np.array([0.5, -0.6, 0.8]) / np.sqrt(1.25)  # direction of the light in space
DARK = 0.62  # brightness of a face that the lamp does not reach
SEAM = 0.35  # points: thinner, the triangles show; wider, the edges of a box look torn
HEAD = 0.12  # length of the head of an arrow
LONGEST = 0.2  # longest edge of a triangle relative to the body: faces are sorted by mean depth


class Solid:
    """The faces of a body of size 1: triangles (n, 3, 3), their normals and colours (n, 3).

    centre : centre of mass (3,) in the units of the surface;  stick : pieces (n, 2, 3) of the line
        to it from the fixed point that are outside the body
    """

    def __init__(self, surface: Surface, centre: ArrayLike = (0.0, 0.0, 0.0)) -> None:
        scale = 1.0 / np.linalg.norm(surface.corners, axis=1).max()
        triangles, tones = cut(scale * surface.corners[surface.faces], surface.tones, LONGEST)
        normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
        # for a surface of size 1; a face without area has normal 0
        normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-300)[:, None]
        self.scale, self.triangles, self.normals = scale, triangles, normals
        self.colours = np.array([to_rgb(tone) for tone in TONES])[tones]

        line = np.linspace(0.0, 1.0, 13)[:, None] * (scale * np.asarray(centre, float))
        pieces = np.stack([line[:-1], line[1:]], 1)
        self.stick = pieces[~self.holds(pieces.mean(1))] if line.any() else pieces[:0]

    def holds(self, points: Array) -> Bools:
        """Return whether points (n, 3) are inside: there the triangles fill the whole sphere.

        Solid angles of triangles: van Oosterom & Strackee, IEEE Trans. Biomed. Eng. 30 (1983) 125.
        """
        a, b, c = np.moveaxis(self.triangles - points[:, None, None], 2, 0)
        la, lb, lc = (np.linalg.norm(v, axis=-1) for v in (a, b, c))
        volume = (a * np.cross(b, c)).sum(-1)
        product = la * lb * lc + (a * b).sum(-1) * lc + (b * c).sum(-1) * la + (c * a).sum(-1) * lb
        half = np.arctan2(volume, product).sum(-1)  # 2 pi inside, 0 outside
        inside: Bools = np.abs(half) > np.pi
        return inside


class Stage:
    """Parts in space, seen from a direction, as one collection of polygons.

    azimuth, elevation : of the eye [rad];  reach : largest distance of a point from the middle
    """

    def __init__(self, axes: Axes, azimuth: float, elevation: float, reach: float) -> None:
        ca, sa, ce, se = (f(x) for x in (azimuth, elevation) for f in (np.cos, np.sin))
        self.toward = np.array([ca * ce, sa * ce, se])
        self.right, self.up = np.array([-sa, ca, 0.0]), np.array([-ca * se, -sa * se, ce])
        self.far = EYE * reach
        # round, and edges SEAM wide in the colours of the faces, to close gaps between triangles
        self.polygons = PolyCollection([], capstyle="round", joinstyle="round")
        axes.add_collection(self.polygons, autolim=False)
        self.begin()

    def begin(self) -> None:
        """Remove all parts."""
        self._depth, self._corners = list[Array](), list[Array]()
        self._faces, self._edges, self._widths = list[Array](), list[Array](), list[Array]()

    def place(self, points: ArrayLike, at: ArrayLike = (0.0, 0.0)) -> tuple[Array, Array]:
        """Return (places (..., 2), depths (...,)) of points (..., 3); depth grows toward the eye.

        at : place of the middle
        """
        p = np.asarray(points, float)
        depth = p @ self.toward
        flat = np.stack([p @ self.right, p @ self.up], -1)
        return np.asarray(at) + flat * (self.far / (self.far - depth))[..., None], depth

    def solid(self, solid: Solid, turn: Array, at: ArrayLike = (0.0, 0.0)) -> None:
        """Add a body with a rotation (3, 3) from its axes to space."""
        triangles, normals = solid.triangles @ turn.T, solid.normals @ turn.T
        seen = (normals * (self.far * self.toward - triangles.mean(1))).sum(1) > 0.0
        light = DARK + (1.0 - DARK) * np.clip(normals[seen] @ LAMP, 0.0, 1.0)
        colours = np.ones((len(light), 4))
        colours[:, :3] = solid.colours[seen] * light[:, None]
        places, depth = self.place(triangles[seen], at)
        self._add(depth.mean(1), places, colours, colours, np.full(len(light), SEAM))

    def curve(
        self,
        points: ArrayLike,
        colour: str,
        width: float = 1.2,
        at: ArrayLike = (0.0, 0.0),
        is_fading: bool = False,
    ) -> None:
        """Add a curve through points (n, 3) in short pieces, so that solids hide them.

        is_fading : whether the curve gets fainter toward its first point
        """
        places, depth = self.place(points, at)
        count = max(0, len(depth) - 1)
        colours = np.tile(to_rgba(colour), (count, 1))
        if is_fading:
            colours[:, 3] = np.linspace(0.1, 1.0, count)
        pieces = np.stack([places[:-1], places[1:], places[1:]], 1)
        clear = np.zeros((count, 4))
        self._add(0.5 * (depth[1:] + depth[:-1]), pieces, clear, colours, np.full(count, width))

    def segment(
        self, start: ArrayLike, end: ArrayLike, colour: str, width: float = 1.2, **options: Any
    ) -> None:
        """Add a straight line between two points (3,)."""
        share = np.linspace(0.0, 1.0, 13)[:, None]
        line = (1.0 - share) * np.asarray(start) + share * np.asarray(end)
        self.curve(line, colour, width, **options)

    def stick(self, solid: Solid, turn: Array, colour: str, width: float, **options: Any) -> None:
        """Add the line from the fixed point to the centre of mass, as far as it is outside."""
        for piece in solid.stick @ turn.T:
            self.curve(piece, colour, width, **options)

    def arrow(self, end: ArrayLike, colour: str, width: float = 2.5) -> None:
        """Add an arrow from the middle to a point (3,)."""
        self.segment((0.0, 0.0, 0.0), end, colour, width)
        start, depth = self.place((0.0, 0.0, 0.0))
        tip, depth = self.place(end)
        length = float(np.linalg.norm(tip - start))
        if length > 0.0:
            along = (tip - start) / length * min(HEAD, length)
            aside = 0.4 * np.array([-along[1], along[0]])
            head = np.stack([tip + 0.3 * along, tip - along + aside, tip - along - aside])
            paint = np.array([to_rgba(colour)])
            self._add(depth[None], head[None], paint, paint, np.ones(1))

    def _add(self, depth: Array, corners: Array, faces: Array, edges: Array, widths: Array) -> None:
        self._depth.append(depth)
        self._corners.append(corners)
        self._faces.append(faces)
        self._edges.append(edges)
        self._widths.append(widths)

    def end(self) -> None:
        """Draw all parts from far to near."""
        order = np.argsort(np.concatenate(self._depth), kind="stable")
        # the stubs of matplotlib know lists only
        polygons: Any = self.polygons
        polygons.set_verts(np.concatenate(self._corners)[order])
        polygons.set_facecolor(np.concatenate(self._faces)[order])
        polygons.set_edgecolor(np.concatenate(self._edges)[order])
        polygons.set_linewidth(np.concatenate(self._widths)[order])
