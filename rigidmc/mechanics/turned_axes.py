"""The principal axes of many bodies, named after those of one, and what turns into them.

A turn (3, 3, n) has as columns the axes of a body, in those of the one: v' = turn^T v. Numbers are
multiplied one by one, so that no bit depends on a library or on the number of bodies.
"""

from itertools import permutations, product
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def _names() -> tuple[tuple[tuple[int, ...], tuple[float, ...]], ...]:
    """The 24 ways to name the axes of a body that keep them right-handed, as they are first:
    (axis, sign) of each."""
    ways = []
    for places, signs in product(permutations(range(3)), product((1.0, -1.0), repeat=3)):
        frame = np.eye(3)[:, places] * signs
        if np.linalg.det(frame) > 0.0:
            ways.append((places, signs))
    return tuple(ways)


NAMES = _names()


def named(moments: ArrayLike, axes: ArrayLike, mean: ArrayLike) -> tuple[Array, Array]:
    """(moments (3, n), turn (3, 3, n)) of bodies with the axes named after the nearest ones.

    moments (n, 3), axes (n, 3, 3) : of `rigidmc.mechanics.inertia.principal_axes`
    mean (3, 3) : axes of the one body

    Of the 24 right-handed names those count for which the turn is the smallest: less than 63 deg
    (tests/scene/test_uncertain_inertia.py).
    """
    values, columns = np.asarray(moments, dtype=float).T, np.asarray(axes, dtype=float)
    own = np.asarray(mean, dtype=float)
    turn = np.stack(
        [
            np.stack([sum(own[k, i] * columns[:, k, j] for k in range(3)) for j in range(3)])
            for i in range(3)
        ]
    )
    traces = np.stack(
        [sum(s * turn[i, p] for i, (p, s) in enumerate(zip(*way, strict=True))) for way in NAMES]
    )
    best = traces.argmax(0)
    places, signs = (np.array([way[k] for way in NAMES])[best].T for k in (0, 1))
    members = np.arange(values.shape[1])
    return values[places, members], np.stack([row[places, members] * signs for row in turn])


def quaternions(turn: Array) -> tuple[Array, ...]:
    """The unit quaternions (w, x, y, z) of the turns of `named`, which are far from 180 deg."""
    w = 0.5 * np.sqrt(1.0 + turn[0, 0] + turn[1, 1] + turn[2, 2])
    by = 0.25 / w
    parts = turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]
    x, y, z = (by * part for part in parts)
    return w, x, y, z


def vectors_into(turn: Array, vectors: Any) -> Array:
    """turn^T v (3, n) of vectors (3, n)."""
    return np.stack([sum(turn[k, i] * vectors[k] for k in range(3)) for i in range(3)])


def tensors_into(turn: Array, six: Any) -> Array:
    """turn^T C turn of tensors: xx, yy, zz, yz, zx, xy (6, n)."""
    xx, yy, zz, yz, zx, xy = six
    rows = (xx, xy, zx), (xy, yy, yz), (zx, yz, zz)
    half = [vectors_into(turn, row) for row in rows]  # (C turn)[row][i]
    whole = [vectors_into(turn, [row[i] for row in half]) for i in range(3)]
    return np.stack([whole[j][i] for i, j in ((0, 0), (1, 1), (2, 2), (1, 2), (2, 0), (0, 1))])
