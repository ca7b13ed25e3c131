"""The unit sphere in pictures: directions, their density, Lambert's map, families of polhodes."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

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


def curves_at_energy(moments: NDArray[np.float64], inverse: float) -> list[Curve]:
    """Return the polhodes (n, 3) on the unit sphere with c = 2 T/L^2 = `inverse`, which lies
    between 1/max I and 1/min I.

    On an axis they are points, at the middle moment the separatrices.
    """
    low, middle, high = map(int, np.argsort(moments, kind="stable"))
    axes, c = np.eye(3), 1.0 / moments
    pole = low if inverse > c[middle] or c[middle] == c[high] else high
    across = middle if c[middle] != c[pole] else (high if pole == low else low)
    square = ((c[pole] - inverse) / (c[pole] - c[across])).clip(0.0, 1.0)
    if square == 1.0:
        return family(moments)[1]
    one = np.sqrt(square) * axes[across]
    starts = [side * np.sqrt(1.0 - square) * axes[pole] + one for side in (-1.0, 1.0)]
    curves = polhodes(np.array(starts).T, np.repeat(moments[:, None], 2, axis=1), 361)
    return list(curves.transpose(2, 0, 1))


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
