"""Bodies from triangle meshes (STL, OBJ, PLY, ...): solids, convex hulls and thin shells.

trimesh reads the files (extra `mesh`).
"""

import os
from collections.abc import Iterator
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from rigidmc.errors import FileError, SceneError
from rigidmc.files.reading import load_mesh, refuse_large_mesh
from rigidmc.files.trial import refuse_unreadable
from rigidmc.inputs.arrays import Array, Ints

_MIX = np.uint64(0x9E3779B97F4A7C15)  # 2^64 over the golden ratio, odd


@runtime_checkable
class Mesh(Protocol):
    """The attributes of a trimesh.Trimesh that this module uses.

    vertices (n, 3);  faces (m, 3) : indices into the vertices
    """

    vertices: Any
    faces: Any


def load(path: "str | os.PathLike[str] | Mesh", scale: float = 1.0, closed: bool = True) -> Array:
    """Return the triangles (n, 3, 3) [m] of a mesh file or a trimesh.Trimesh.

    scale : metres per unit of the file, e.g. 0.001 for millimetres, the unit of most STL files
    closed : whether the mesh must enclose a volume

    Raises SceneError, with the reason, for a mesh that is not closed, and FileNotFoundError.
    """
    if isinstance(path, Mesh):
        return _triangles(path, "Trimesh", scale, closed)
    name = os.fspath(path)
    try:
        import trimesh  # noqa: F401
    except ImportError as error:
        rule = f"meshes need trimesh: pip install 'rigidmc[mesh]' ({error})"
        raise SceneError(rule, at="mesh", value=name) from None
    if not os.path.exists(path):
        raise FileNotFoundError(f"{path}: no such file")
    try:
        refuse_large_mesh(name)
        refuse_unreadable(name, "mesh")
        mesh: Any = load_mesh(name)
    except FileError as error:
        raise SceneError(error.rule, at="mesh", value=name) from None
    except Exception as error:  # the readers of trimesh raise all kinds of exceptions
        rule = f"is not a mesh that trimesh can read: {error}"
        raise SceneError(rule, at="mesh", value=name) from None
    return _triangles(mesh, name, scale, closed)


def _triangles(mesh: Mesh, name: str, scale: float, closed: bool) -> Array:
    """Return the checked triangles (n, 3, 3) of a mesh."""
    if not len(mesh.faces):
        raise SceneError("has no triangles", at="mesh", value=name)
    vertices = np.asarray(mesh.vertices, dtype=float) + 0.0  # turns -0.0 into 0.0
    faces = np.asarray(mesh.faces)
    if vertices.shape[1:] != (3,) or faces.shape[1:] != (3,):  # vertices of an OBJ file in a plane
        raise SceneError("is not a mesh of triangles in space", at="mesh", value=name)
    if not (faces.min() >= 0 and faces.max() < len(vertices)):
        raise SceneError("has triangles with undefined vertices", at="mesh", value=name)
    _refuse_infinite(vertices, name)
    faces = first_vertices(vertices)[faces]
    # a triangle with two equal vertices has no area, and its edges would count as holes
    one, two, three = faces.T
    thin = (one == two) | (two == three) | (three == one)
    faces = faces[~thin]
    if not len(faces):
        raise SceneError("has no triangles with an area", at="mesh", value=name)
    if closed and (faults := open_edges(faces)):
        raise SceneError(_cure(faults, vertices, faces), at="mesh", value=name)
    triangles: Array = (scale * vertices)[faces]
    return triangles


def _refuse_infinite(vertices: Array, name: str) -> None:
    """Raise SceneError that counts vertices with coordinates that are NaN or infinite."""
    bad = ~np.isfinite(vertices).all(1)
    if not bad.any():
        return
    kind = "NaN" if np.isnan(vertices[bad]).any(1).all() else "NaN or infinite"
    rule = (
        f"{np.count_nonzero(bad):,} of its {len(vertices):,} vertices are {kind}, the first is"
        f" vertex {np.flatnonzero(bad)[0]:,}: export the mesh again, or remove these vertices, in"
        " trimesh by mesh.update_faces(np.isfinite(mesh.triangles).all((1, 2)))"
    )
    raise SceneError(rule, at="mesh", value=name)


def first_vertices(vertices: Array) -> Ints:
    """Return for each of the vertices (n, 3) the index (n,) of the first one equal to it.

    An STL file repeats a vertex for each of its triangles. Only bitwise equal vertices are merged:
    trimesh merges vertices closer than 1e-8, whatever the unit, and so makes holes in small parts
    given in metres (tests/mechanics/test_mesh.py).
    """
    # sort by a hash, because sorting by coordinates takes three times as long; at worst a hash
    # collision keeps equal vertices separate
    key = np.zeros(len(vertices), dtype=np.uint64)
    for bits in np.ascontiguousarray(vertices).view(np.uint64).T:
        key ^= bits
        key ^= key >> np.uint64(32)  # all digits of round numbers are in the upper half
        key *= _MIX
        key ^= key >> np.uint64(29)
    order = np.argsort(key, kind="stable")
    x, y, z = vertices[order].T
    same = (x[1:] == x[:-1]) & (y[1:] == y[:-1]) & (z[1:] == z[:-1])
    start = np.concatenate([[0], np.cumsum(~same)])
    index = np.empty(len(vertices), dtype=np.int64)
    index[order] = order[np.flatnonzero(np.concatenate([[True], ~same]))][start]
    return index


def open_edges(faces: ArrayLike) -> str:
    """Return what keeps faces (n, 3) from enclosing a volume, in words; "" if nothing does.

    Every edge must belong to two triangles that traverse it in opposite directions.
    """
    faces = np.asarray(faces, dtype=np.int64)
    start, end = faces.ravel(), faces[:, [1, 2, 0]].ravel()
    size = faces.max() + 1
    key = np.minimum(start, end) * size + np.maximum(start, end)
    key = 2 * key + (start < end)  # sorted in place: a mesh may have millions of edges
    del start, end
    key.sort()
    sign, key = 2 * (key & 1).astype(np.int8) - 1, key >> 1
    first = np.flatnonzero(np.concatenate([[True], key[1:] != key[:-1]]))
    count = np.diff(np.append(first, key.size))
    direction = np.add.reduceat(sign, first, dtype=np.int64)
    twisted = np.count_nonzero((count == 2) & (direction != 0))
    wrong = [
        (np.count_nonzero(count == 1), "edges with only one triangle: it has holes"),
        (np.count_nonzero(count > 2), "edges with more than two triangles"),
        (twisted, "edges whose triangles are wound in opposite senses"),
    ]
    return ", ".join(f"{n:,} {what}" for n, what in wrong if n)


_WELDS = (1e-6, 1e-5, 1e-4)  # relative to the size of the mesh


def _cure(faults: str, vertices: Array, faces: Ints) -> str:
    """Return the rule that a mesh is not closed, and what to do next."""
    other = (
        'solid = "hull" takes its convex hull, and solid = "shell" a thin sheet of the given mass'
    )
    size = float(np.ptp(vertices[faces.ravel()], axis=0).max())
    for weld in _WELDS:
        digits = -int(np.ceil(np.log10(weld * size)))
        if digits >= 0 and not open_edges(_welded(vertices, faces, 10.0**-digits)):
            return (
                f"is not watertight: {faults}; its triangles meet only to {10.0**-digits:g} units:"
                f" load it by trimesh, call mesh.merge_vertices(digits_vertex={digits}), and give"
                f" the mesh to Body.from_mesh; or {other}"
            )
    return (
        f"is not watertight: {faults}; to close a scan, in MeshLab, Filters > Remeshing,"
        " Simplification and Reconstruction > Close Holes, or there > Surface Reconstruction:"
        f" Screened Poisson; to mend a drawing, export it again as one solid; or {other}"
    )


def _welded(vertices: Array, faces: Ints, distance: float) -> Ints:
    """Return the faces after merging vertices that round to the same multiple of a distance,
    without those that have lost their area."""
    _, index = np.unique(np.round(vertices / distance), axis=0, return_inverse=True)
    merged: Ints = index.ravel()[faces]
    one, two, three = merged.T
    apart = (one != two) & (two != three) & (three != one)
    return np.asarray(merged[apart])


def six_volumes(triangles: Array) -> Array:
    """Return six times the signed volumes (n,) of the tetrahedra from the first vertex to the
    triangles (n, 3, 3)."""
    volumes = np.empty(len(triangles))
    for part in _parts(len(triangles)):
        # from a vertex, not the origin: of a cube of 1 cm at 1 km the volume is 3e-12 off, and not
        # 0.9 %
        local = triangles[part] - triangles[0, 0]
        volumes[part] = np.einsum("ni,ni->n", local[:, 0], np.cross(local[:, 1], local[:, 2]))
    return volumes


def _parts(count: int) -> Iterator[slice]:
    """Yield slices of at most 2^18 triangles: the sums over a part need 50 MB, not a multiple of a
    large mesh."""
    for start in range(0, count, 2**18):
        yield slice(start, start + 2**18)


def faced_outward(triangles: Array) -> tuple[Array, bool]:
    """Return closed triangles (n, 3, 3) wound to face outward, and whether all were reversed."""
    is_inward = six_volumes(triangles).sum() < 0.0
    return (triangles[:, ::-1], True) if is_inward else (triangles, False)


def convex_hull(triangles: Array) -> Array:
    """Return the triangles (n, 3, 3) of the convex hull, facing outward; SceneError if it is
    flat."""
    from scipy.spatial import ConvexHull, QhullError

    points = triangles.reshape(-1, 3)
    try:
        hull = ConvexHull(points)
    except QhullError:
        rule = "is flat: its convex hull has no volume"
        raise SceneError(rule, at="mesh") from None
    faces: Array = points[hull.simplices]
    normals = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
    inward = (normals * hull.equations[:, :3]).sum(1) < 0.0
    faces[inward] = faces[inward, ::-1]
    return faces


def shell_properties(triangles: Array) -> tuple[float, Array, Array]:
    """Return (area [m2], centroid (3,) [m], tensor (3, 3) about the origin per kg/m2) of a thin
    sheet.

    A triangle with the corners a, b, c and the area A has the second moment

        A ((a+b+c)(a+b+c)^T + a a^T + b b^T + c c^T)/12
    """
    edges = triangles[:, 1:] - triangles[:, :1]
    areas = 0.5 * np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    middle = triangles.sum(1)
    area = float(areas.sum())
    second = np.einsum("n,ni,nj->ij", areas, middle, middle)
    for corner in range(3):
        second += np.einsum("n,ni,nj->ij", areas, triangles[:, corner], triangles[:, corner])
    second /= 12.0
    return area, areas @ middle / (3.0 * area), np.trace(second) * np.eye(3) - second


def mass_properties(triangles: Array, density: float) -> tuple[float, Array, Array]:
    """Return (mass [kg], centre of mass (3,) [m], tensor (3, 3) about the origin), TdC (3.17).

    triangles (n, 3, 3) [m] that enclose the volume;  density [kg/m^3]

    Sums over the signed tetrahedra from the first vertex to the triangles. A tetrahedron with edges
    a, b, c from this vertex has the volume V = a.(b x c)/6, the first moment V (a + b + c)/4 and
    the second moment V ((a+b+c)(a+b+c)^T + a a^T + b b^T + c c^T)/20. SceneError if the volume is
    not positive.
    """
    origin = triangles[0, 0]  # a mesh far from the origin of its axes would lose digits
    volume = six_volumes(triangles) / 6.0
    total = volume.sum()
    if not total > 0.0:
        rule = f"encloses the volume {total:.3g}: its triangles must be wound to face outward"
        raise SceneError(rule, at="mesh")
    first, second = np.zeros(3), np.zeros((3, 3))
    for part in _parts(len(triangles)):
        local, volumes = triangles[part] - origin, volume[part]
        middle = local.sum(1)
        first += volumes @ middle
        second += np.einsum("n,ni,nj->ij", volumes, middle, middle)
        for corner in range(3):
            second += np.einsum("n,ni,nj->ij", volumes, local[:, corner], local[:, corner])
    centre = first / 4.0 / total
    shift = np.outer(origin, centre) + np.outer(centre, origin) + np.outer(origin, origin)
    second = second / 20.0 + total * shift
    tensor = np.trace(second) * np.eye(3) - second
    return density * total, centre + origin, density * tensor
