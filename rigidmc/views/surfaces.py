"""Surfaces of bodies as triangles, for animations and the viewer."""

import warnings
from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from rigidmc.errors import RigidmcError, SceneWarning
from rigidmc.files.reading import sha256_of
from rigidmc.inputs.arrays import Array
from rigidmc.mechanics import inertia, mesh, rotation
from rigidmc.results.principal_axes import in_principal_axes
from rigidmc.scene.body import Body
from rigidmc.scene.shape import Shape, ShapePart, shape_of_mesh

# light and dark tones for the faces of a box along axes 1, 2 and 3; on a body of revolution, the
# quarters of the sides (SIDE) and of the caps (CAP) alternate, so that its spin is visible
TONES = ("#9ecae1", "#2f6fa8", "#fdae6b", "#b5651d", "#d9d9d9", "#7a7a7a", "#1a1a1a")
SIDE, CAP, HOLE = 0, 4, 6
AROUND = 48  # corners of a circle, a multiple of 4
THIN = 0.03  # least drawn thickness of rods and flat bodies, relative to length, radius or edge


class Surface(NamedTuple):
    """Triangles with outward orientation.

    corners (n, 3) [m];  faces (m, 3) : indices of corners;  tones (m,) : indices of TONES
    """

    corners: Array
    faces: NDArray[np.int_]
    tones: NDArray[np.int_]


def body_surface(ds: xr.Dataset, body: Body) -> Surface:
    """Return the surface of the first member of a result, in its principal axes.

    A body without a shape becomes the ellipsoid of uniform density with the member's mass, centre
    of mass and moments.
    """
    surface, form = surface_of(body), form_of(ds, body)
    return surface._replace(corners=surface.corners @ form[:, :3].T + form[:, 3])


def surface_of(body: Body) -> Surface:
    """Return the shape of a body in its principal axes; the unit ball if it has none."""
    if not (parts := drawn_shape(body)):
        return ball_surface(1.0)
    surface = _united([_part_surface(part) for part in parts])
    return surface._replace(corners=surface.corners @ np.array(body.axes))


def drawn_shape(body: Body) -> Shape:
    """Return the shape of a body with the triangles of its mesh files; () with a SceneWarning if a
    file is missing, or has changed."""
    parts = []
    for part in body.shape:
        if part.solid == "mesh_file":
            drawn, why = _of_file(**part.sizes)
            if drawn is None:
                rule = f"{part.sizes['file']}: {why}: pictures show an ellipsoid with its moments"
                warnings.warn(rule, SceneWarning, stacklevel=2)
                return ()
            part = drawn._replace(at=part.at, turned=part.turned, hole=part.hole)
        parts.append(part)
    return tuple(parts)


@lru_cache(maxsize=8)  # pictures ask for the shape of a body several times
def _of_file(file: str, sha256: str, scale: float) -> tuple[ShapePart | None, str]:
    """Return the part for a mesh file; or None, and why the file cannot be drawn."""
    try:
        if sha256_of(file) != sha256:
            return None, "is not the mesh of this body: its sha256 differs"
        return shape_of_mesh(mesh.load(file, scale, closed=False)), ""
    except FileNotFoundError:
        return None, "the mesh of this body is not there"
    except (OSError, RigidmcError) as error:
        return None, getattr(error, "rule", str(error))


def surface_radius(surface: Surface) -> float:
    """Return the largest distance of a corner from the origin."""
    return float(np.linalg.norm(surface.corners, axis=1).max())


def form_of(ds: xr.Dataset, body: Body) -> Array:
    """Return the (3, 4) that maps `surface_of` to the first member's body: x -> F x + shift.

    For a body without a shape, it maps the unit ball to the ellipsoid.
    """
    if drawn_shape(body):
        return np.eye(3, 4)
    return ellipsoid_form(*member_body(ds, body))


def member_body(ds: xr.Dataset, body: Body) -> tuple[Array, float, Array]:
    """Return (moments (3,), mass, centre of mass (3,) in principal axes) of the first member."""
    member = in_principal_axes(ds.isel(member=[0])).isel(member=0)
    moments = np.asarray(member.moments.values, dtype=float)
    mass = float(member.mass.values) if "mass" in member else body.mass
    centre = member.centre.values if "centre" in member else body.to_principal(body.centre)
    return moments, float(mass), np.asarray(centre, dtype=float)


def ellipsoid_form(moments: Array, mass: float, centre: Array) -> Array:
    """Return the form (3, 4) of the uniform ellipsoid with given moments about the origin.

    a_i^2 = 5 (I_j + I_k - I_i)/(2 M) with the principal moments about its centre.
    """
    about, axes = np.linalg.eigh(inertia.about_centre(np.diag(moments), mass, centre))
    squares = 2.5 * (about.sum() - 2.0 * about) / mass
    semiaxes = np.sqrt(np.maximum(squares, 0.0))
    semiaxes = np.maximum(semiaxes, THIN * semiaxes.max())
    # symmetric, so that the tones of the ball keep their axes
    return np.column_stack([(axes * semiaxes) @ axes.T, centre])


def _part_surface(part: ShapePart) -> Surface:
    """Return the surface of a part in the described axes of its body."""
    surface = _MAKERS[part.solid](**part.sizes)
    tones = np.full_like(surface.tones, HOLE) if part.hole else surface.tones
    size = 1.002 if part.hole else 1.0  # moves the mouth of a hole in front of the surface
    corners = rotation.to_space(part.turned, size * surface.corners) + np.array(part.at)
    return Surface(corners, surface.faces, tones)


def _united(parts: list[Surface]) -> Surface:
    """Join several surfaces."""
    start = np.cumsum([0, *(len(part.corners) for part in parts)])
    faces = [part.faces + at for part, at in zip(parts, start[:-1], strict=True)]
    return Surface(
        np.concatenate([part.corners for part in parts]),
        np.concatenate(faces),
        np.concatenate([part.tones for part in parts]),
    )


def cut(
    triangles: Array, tones: NDArray[np.int_], longest: float
) -> tuple[Array, NDArray[np.int_]]:
    """Halve triangles (n, 3, 3) until no edge exceeds `longest`; return them and their tones."""
    while True:
        edges = np.linalg.norm(np.roll(triangles, -1, 1) - triangles, axis=2)
        long = edges.max(1) > longest
        if not long.any():
            return triangles, tones
        first = edges[long].argmax(1)[:, None]
        a, b, c = (
            np.take_along_axis(triangles[long], ((first + i) % 3)[..., None], 1)[:, 0]
            for i in range(3)
        )
        middle = 0.5 * (a + b)
        halves = np.stack([a, middle, c], 1), np.stack([middle, b, c], 1)
        triangles = np.concatenate([triangles[~long], *halves])
        tones = np.concatenate([tones[~long], tones[long], tones[long]])


def revolve(*outline: tuple[float, float], around: int = AROUND) -> Surface:
    """Return the surface of revolution about axis 3 of an outline of points (r, z), from the bottom
    up along its outer side.

    around : corners of a circle, a multiple of 4
    """
    radius, height = np.array(outline).T
    turn = 2.0 * np.pi * np.arange(around) / around
    corners = np.stack(
        [
            np.multiply.outer(radius, np.cos(turn)),
            np.multiply.outer(radius, np.sin(turn)),
            np.multiply.outer(height, np.ones(around)),
        ],
        -1,
    ).reshape(-1, 3)
    band, k = np.meshgrid(np.arange(len(outline) - 1), np.arange(around), indexing="ij")
    ring, above = band * around + k, band * around + (k + 1) % around
    three, four = above + around, ring + around
    cap = np.abs(np.diff(height)) < np.abs(np.diff(radius))
    tone = np.where(cap[:, None], CAP, SIDE) + 4 * k // around % 2
    pairs = [(np.stack([ring, above, three], -1), tone), (np.stack([ring, three, four], -1), tone)]
    faces = np.concatenate([face.reshape(-1, 3) for face, _ in pairs])
    tones = np.concatenate([tone.ravel() for _, tone in pairs])
    a, b, c = corners[faces].transpose(1, 0, 2)
    is_real = (a != b).any(-1) & (b != c).any(-1) & (c != a).any(-1)  # not degenerate at the poles
    return Surface(corners, faces[is_real], tones[is_real])


def _box(size: tuple[float, float, float]) -> Surface:
    corners, faces, tones = list[Array](), list[tuple[int, ...]](), list[int]()
    for axis in range(3):
        j, k = (axis + 1) % 3, (axis + 2) % 3
        for end in (1.0, -1.0):
            square = np.zeros((4, 3))
            square[:, axis] = end
            square[:, j] = np.array([1.0, 1.0, -1.0, -1.0]) * end
            square[:, k] = [-1.0, 1.0, 1.0, -1.0]
            at = len(corners) * 4
            corners.append(0.5 * square * np.array(size))
            faces += [(at, at + 1, at + 2), (at, at + 2, at + 3)]
            tones += [2 * axis + (end < 0.0)] * 2
    return Surface(np.concatenate(corners), np.array(faces), np.array(tones))


def ball_surface(radius: float, around: int = AROUND) -> Surface:
    angle = np.linspace(-0.5 * np.pi, 0.5 * np.pi, around // 2 + 1)
    across = radius * np.cos(angle)
    across[[0, -1]] = 0.0  # cos(pi/2) is 6e-17
    outline = zip(across, radius * np.sin(angle), strict=True)
    surface = revolve(*outline, around=around)
    return surface._replace(tones=SIDE + surface.tones % 2)


def _cylinder(radius: float, height: float) -> Surface:
    half = 0.5 * height
    return revolve((0.0, -half), (radius, -half), (radius, half), (0.0, half))


def _hollow_cylinder(inner: float, outer: float, height: float) -> Surface:
    half = 0.5 * height
    return revolve((inner, -half), (outer, -half), (outer, half), (inner, half), (inner, -half))


def _stretched(semiaxes: tuple[float, float, float]) -> Surface:
    sphere = ball_surface(1.0)
    return sphere._replace(corners=sphere.corners * np.array(semiaxes))


def _t_handle(radius: float, bar: float, stem: float) -> Surface:
    """Return a bar along axis 1 with a stem along +3 from its middle, about the centre of mass."""
    top = 0.5 * stem * stem / (bar + stem)
    upright = _cylinder(radius, stem)
    lying = _cylinder(radius, bar)
    return _united(
        [
            lying._replace(corners=lying.corners[:, [2, 0, 1]] + np.array([0.0, 0.0, -top])),
            upright._replace(corners=upright.corners + np.array([0.0, 0.0, 0.5 * stem - top])),
        ]
    )


def _particles(masses: tuple[float, ...], positions: tuple[tuple[float, ...], ...]) -> Surface:
    """Return balls with volumes proportional to mass; the largest has a tenth of the body's
    size."""
    m, x = np.array(masses), np.array(positions)
    # 1e-300 m: particles that are all at the fixed point are invisible
    largest = 0.1 * max(np.linalg.norm(x, axis=1).max(), 1e-300)
    radii = largest * np.cbrt(m / m.max())
    around = AROUND if m.size <= 20 else 12 if m.size <= 300 else 4
    parts = [ball_surface(r, around) for r in radii]
    return _united(
        [part._replace(corners=part.corners + at) for part, at in zip(parts, x, strict=True)]
    )


def _mesh(corners: tuple[tuple[float, ...], ...], faces: tuple[tuple[int, ...], ...]) -> Surface:
    points, triangles = np.array(corners), np.array(faces)
    x, y, _ = points[triangles].mean(1).T
    return Surface(points, triangles, SIDE + (x * y > 0.0).astype(int))


_MAKERS: dict[str, Callable[..., Surface]] = {
    "box": _box,
    "ball": ball_surface,
    "shell": ball_surface,
    "cylinder": _cylinder,
    "hollow_cylinder": _hollow_cylinder,
    "cone": lambda radius, height: revolve((0.0, 0.0), (radius, height), (0.0, height)),
    "ellipsoid": _stretched,
    "rod": lambda length, radius: _cylinder(max(radius, 0.5 * THIN * length), length),
    "plate": lambda size: _box((*size, THIN * max(size))),
    "disc": lambda radius: _cylinder(radius, THIN * radius),
    "ring": lambda radius: _hollow_cylinder(
        (1.0 - THIN) * radius, (1.0 + THIN) * radius, 2.0 * THIN * radius
    ),
    "t_handle": _t_handle,
    "particles": _particles,
    "mesh": _mesh,
}
