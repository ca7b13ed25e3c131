"""Bodies of uniform density from closed triangle meshes (STL, OBJ, PLY, ...), read by trimesh (extra `mesh`)."""

import os
from typing import Any

import numpy as np

from rigidmc.errors import SceneError
from rigidmc.files.reading import refuse_irregular

_MIX = np.uint64(0x9E3779B97F4A7C15)  # 2^64 over the golden ratio, odd


def load(path, scale=1.0):
    """The triangles (n, 3, 3) [m] of a mesh file or a trimesh.Trimesh; SceneError for one that is not closed, with what is wrong.

    scale : metres per unit of the file; most STL are in millimetres, 0.001
    """
    if hasattr(path, "faces") and hasattr(path, "vertices"):
        return _closed(path, "Trimesh", scale)
    try:
        import trimesh
    except ImportError as error:
        raise SceneError(
            "",
            "mesh",
            os.fspath(path),
            f"meshes need trimesh: pip install 'rigidmc[mesh]' ({error})",
        ) from None
    if not os.path.exists(path):
        raise FileNotFoundError(f"{path}: no such file")
    refuse_irregular(path)
    try:
        mesh: Any = trimesh.load(path, force="mesh", process=False)
    except Exception as error:  # trimesh raises whatever its readers do
        raise SceneError(
            "", "mesh", os.fspath(path), f"is no mesh that trimesh can read: {error}"
        ) from None
    return _closed(mesh, os.fspath(path), scale)


def _closed(mesh, name, scale):
    """The triangles (n, 3, 3) of a mesh with `vertices` and `faces`, checked."""
    if not len(mesh.faces):
        raise SceneError("", "mesh", name, "has no triangles")
    vertices = np.asarray(mesh.vertices, dtype=float) + 0.0  # -0.0 is 0.0
    faces = merged(vertices)[np.asarray(mesh.faces)]
    # a triangle with two corners in one place encloses nothing, and its edges would count as holes
    thin = (
        (faces[:, 0] == faces[:, 1]) | (faces[:, 1] == faces[:, 2]) | (faces[:, 2] == faces[:, 0])
    )
    faces = faces[~thin]
    if not len(faces):
        raise SceneError("", "mesh", name, "has no triangles with an area")
    check(faces, name)
    return scale * vertices[faces]


def merged(vertices):
    """Index (n,) of the first vertex with the same coordinates, for each of vertices (n, 3): an STL repeats them for every triangle.

    To the bit: trimesh merges what is closer than 1e-8, whatever the unit, and makes holes in small parts given in metres.
    """
    # sorted by a hash, as sorting by coordinates takes three times as long; places that share a hash could only stay unmerged
    key = np.zeros(len(vertices), dtype=np.uint64)
    for bits in np.ascontiguousarray(vertices).view(np.uint64).T:
        key ^= bits
        key ^= key >> np.uint64(32)  # the digits of round numbers are all in the upper half
        key *= _MIX
        key ^= key >> np.uint64(29)
    order = np.argsort(key, kind="stable")
    x, y, z = vertices[order].T
    same = (x[1:] == x[:-1]) & (y[1:] == y[:-1]) & (z[1:] == z[:-1])
    start = np.concatenate([[0], np.cumsum(~same)])
    index = np.empty(len(vertices), dtype=np.int64)
    index[order] = order[np.flatnonzero(np.concatenate([[True], ~same]))][start]
    return index


def check(faces, name="mesh"):
    """SceneError for faces (n, 3) that do not close a volume: every edge must belong to two triangles that run along it in opposite
    directions."""
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
    wrong = [
        (np.count_nonzero(count == 1), "edges with one triangle only: it has holes"),
        (np.count_nonzero(count > 2), "edges with more than two triangles"),
        (
            np.count_nonzero((count == 2) & (direction != 0)),
            "edges whose triangles are wound in opposite senses",
        ),
    ]
    found = [f"{n:,} {what}" for n, what in wrong if n]
    if found:
        raise SceneError(
            "", "mesh", name, f"is not watertight: {', '.join(found)}; repair it first"
        )


def mass_properties(triangles, density):
    """(mass [kg], centre of mass (3,) [m], tensor (3, 3) about the origin) of the volume that triangles (n, 3, 3) enclose, TdC (3.17).

    By the signed tetrahedra from the first vertex to the triangles: of one with edges a, b, c from there, V = a.(b x c)/6, first moment
    V (a + b + c)/4 and second V ((a+b+c)(a+b+c)^T + a a^T + b b^T + c c^T)/20. SceneError for a volume that is not positive.
    """
    origin = triangles[0, 0]
    local = triangles - origin  # near the mesh: a part far from the origin would lose its digits
    volume = np.einsum("ni,ni->n", local[:, 0], np.cross(local[:, 1], local[:, 2])) / 6.0
    total = volume.sum()
    if not total > 0.0:
        raise SceneError(
            "",
            "mesh",
            None,
            f"encloses the volume {total:.3g}: its triangles must be wound so that they face outward",
        )
    middle = local.sum(1)
    centre = (volume @ middle) / 4.0 / total
    second = np.einsum("n,ni,nj->ij", volume, middle, middle)
    for corner in range(3):
        second += np.einsum("n,ni,nj->ij", volume, local[:, corner], local[:, corner])
    second = second / 20.0 + total * (
        np.outer(origin, centre) + np.outer(centre, origin) + np.outer(origin, origin)
    )
    tensor = np.trace(second) * np.eye(3) - second
    return density * total, centre + origin, density * tensor
