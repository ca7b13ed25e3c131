"""Bodies of uniform density from closed triangle meshes (STL, OBJ, PLY, ...).

trimesh reads the files (extra `mesh`).
"""

import os
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rigidmc.errors import FileError, SceneError
from rigidmc.files.reading import load_mesh
from rigidmc.files.trial import refuse_unreadable

_MIX = np.uint64(0x9E3779B97F4A7C15)  # 2^64 over the golden ratio, odd


@runtime_checkable
class Mesh(Protocol):
    """The attributes of a trimesh.Trimesh that this module uses.

    vertices (n, 3);  faces (m, 3) : indices into the vertices
    """

    vertices: Any
    faces: Any


def load(path: "str | os.PathLike[str] | Mesh", scale: float = 1.0) -> NDArray[np.float64]:
    """Return the triangles (n, 3, 3) [m] of a mesh file or a trimesh.Trimesh.

    scale : metres per unit of the file, e.g. 0.001 for millimetres, the unit of most STL files

    Raises SceneError, with the reason, for a mesh that is not closed, and FileNotFoundError.
    """
    if isinstance(path, Mesh):
        return _closed(path, "Trimesh", scale)
    name = os.fspath(path)
    try:
        import trimesh  # noqa: F401
    except ImportError as error:
        rule = f"meshes need trimesh: pip install 'rigidmc[mesh]' ({error})"
        raise SceneError(rule, at="mesh", value=name) from None
    if not os.path.exists(path):
        raise FileNotFoundError(f"{path}: no such file")
    try:
        refuse_unreadable(name, "mesh")
        mesh: Any = load_mesh(name)
    except FileError as error:
        raise SceneError(error.rule, at="mesh", value=name) from None
    except Exception as error:  # the readers of trimesh raise all kinds of exceptions
        rule = f"is not a mesh that trimesh can read: {error}"
        raise SceneError(rule, at="mesh", value=name) from None
    return _closed(mesh, name, scale)


def _closed(mesh: Mesh, name: str, scale: float) -> NDArray[np.float64]:
    """Return the checked triangles (n, 3, 3) of a mesh."""
    if not len(mesh.faces):
        raise SceneError("has no triangles", at="mesh", value=name)
    vertices = np.asarray(mesh.vertices, dtype=float) + 0.0  # turns -0.0 into 0.0
    faces = np.asarray(mesh.faces)
    if not (faces.min() >= 0 and faces.max() < len(vertices)):
        raise SceneError("has triangles with undefined vertices", at="mesh", value=name)
    if not np.isfinite(vertices).all():
        raise SceneError("has vertices that are not finite", at="mesh", value=name)
    faces = first_vertices(vertices)[faces]
    # a triangle with two equal vertices has no area, and its edges would count as holes
    one, two, three = faces.T
    thin = (one == two) | (two == three) | (three == one)
    faces = faces[~thin]
    if not len(faces):
        raise SceneError("has no triangles with an area", at="mesh", value=name)
    check_closed_surface(faces, name)
    triangles: NDArray[np.float64] = scale * vertices[faces]
    return triangles


def first_vertices(vertices: NDArray[np.float64]) -> NDArray[np.int64]:
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


def check_closed_surface(faces: ArrayLike, name: str = "mesh") -> None:
    """Raise SceneError for faces (n, 3) that do not enclose a volume.

    Every edge must belong to two triangles that traverse it in opposite directions.
    """
    faces = np.asarray(faces, dtype=np.int64)
    start, end = faces[:, [0, 1, 2]].ravel(), faces[:, [1, 2, 0]].ravel()
    size = faces.max() + 1
    low, high = np.minimum(start, end), np.maximum(start, end)
    key, sign = low * size + high, np.where(start < end, 1, -1)
    order = np.argsort(key, kind="stable")
    key, sign = key[order], sign[order]
    first = np.flatnonzero(np.concatenate([[True], key[1:] != key[:-1]]))
    count = np.diff(np.append(first, key.size))
    direction = np.add.reduceat(sign, first)
    twisted = np.count_nonzero((count == 2) & (direction != 0))
    wrong = [
        (np.count_nonzero(count == 1), "edges with only one triangle: it has holes"),
        (np.count_nonzero(count > 2), "edges with more than two triangles"),
        (twisted, "edges whose triangles are wound in opposite senses"),
    ]
    faults = [f"{n:,} {what}" for n, what in wrong if n]
    if faults:
        rule = f"is not watertight: {', '.join(faults)}; repair it first"
        raise SceneError(rule, at="mesh", value=name)


def mass_properties(
    triangles: NDArray[np.float64], density: float
) -> tuple[float, NDArray[np.float64], NDArray[np.float64]]:
    """Return (mass [kg], centre of mass (3,) [m], tensor (3, 3) about the origin), TdC (3.17).

    triangles (n, 3, 3) [m] that enclose the volume;  density [kg/m^3]

    Sums over the signed tetrahedra from the first vertex to the triangles. A tetrahedron with edges
    a, b, c from this vertex has the volume V = a.(b x c)/6, the first moment V (a + b + c)/4 and
    the second moment V ((a+b+c)(a+b+c)^T + a a^T + b b^T + c c^T)/20. SceneError if the volume is
    not positive.
    """
    origin = triangles[0, 0]
    local = triangles - origin  # a mesh far from the origin would lose digits
    volume = np.einsum("ni,ni->n", local[:, 0], np.cross(local[:, 1], local[:, 2])) / 6.0
    total = volume.sum()
    if not total > 0.0:
        rule = f"encloses the volume {total:.3g}: its triangles must be wound to face outward"
        raise SceneError(rule, at="mesh")
    middle = local.sum(1)
    centre = (volume @ middle) / 4.0 / total
    second = np.einsum("n,ni,nj->ij", volume, middle, middle)
    for corner in range(3):
        second += np.einsum("n,ni,nj->ij", volume, local[:, corner], local[:, corner])
    shift = np.outer(origin, centre) + np.outer(centre, origin) + np.outer(origin, origin)
    second = second / 20.0 + total * shift
    tensor = np.trace(second) * np.eye(3) - second
    return density * total, centre + origin, density * tensor
