"""Directions on the unit sphere, in plain NumPy: polhodes, Lambert's equal-area map, density. What the pictures of spheres draw."""

import numpy as np
from scipy.ndimage import uniform_filter

BINS, SMOOTH = (
    120,
    3,
)  # bins across a disc, averaged 3 x 3 (about 4 degrees): a thin ensemble shows on both sides of a path


def central_axis(moments):
    """The axis of the middle moment; where two moments are equal, that of the third."""
    low, middle, high = np.argsort(moments, kind="stable")
    same = 1e-9 * moments[high]
    if moments[middle] - moments[low] <= same:
        return high
    return low if moments[high] - moments[middle] <= same else middle


def polhodes(l, moments, points=721):
    """Closed curves (points, axis, member) through the directions l (axis, member), around the axis of the least or largest moment.

    With u = L/|L| and c = sum u_i^2/I_i = 2 T/L^2: the distance rho from axis e at the angle phi from the middle axis m obeys
    rho^2 (cos^2 phi/I_m + sin^2 phi/I_a - 1/I_e) = c - 1/I_e.
    """
    phi, curves = np.linspace(0.0, 2.0 * np.pi, points), np.empty((points, *l.shape))
    with np.errstate(all="ignore"):
        for k, inverse in enumerate(1.0 / moments.T):
            u = l[:, k] / np.sqrt(l[:, k] @ l[:, k])
            c = u * u @ inverse
            order = np.argsort(inverse)
            a, m, e = order if c > inverse[order[1]] else order[::-1]
            rho2 = (c - inverse[e]) / (
                np.cos(phi) ** 2 * inverse[m] + np.sin(phi) ** 2 * inverse[a] - inverse[e]
            )
            curves[:, e, k] = np.copysign(np.sqrt(1.0 - rho2.clip(0.0, 1.0)), u[e])
            curves[:, m, k], curves[:, a, k] = (
                np.sqrt(rho2) * np.cos(phi),
                np.sqrt(rho2) * np.sin(phi),
            )
    return curves


def lambert(right, up, toward):
    """Lambert's azimuthal equal-area projection of unit vectors, a hemisphere onto a disc of radius sqrt(2); nan far past it."""
    return np.stack([right, up]) * np.sqrt(2.0 / (1.0 + np.where(toward > -0.5, toward, np.nan)))


def density(v, sides, limit):
    """Density of unit vectors (time, axis, member) on discs seen from `sides`, relative to an isotropic ensemble; empty is nan."""
    right, up, toward = np.moveaxis(v, 1, 0).reshape(3, -1)
    fine = (np.arange(8 * BINS) + 0.5) / (4 * BINS) - 1.0
    area = (
        (np.hypot(fine, fine[:, None]) < 1.0).reshape(BINS, 8, BINS, 8).mean(axis=(1, 3))
    )  # the part of a bin on the disc
    isotropic = uniform_filter(area, SMOOTH, mode="constant") * (
        v[:, 0].size * (2.0 * limit / BINS) ** 2 / (4.0 * np.pi)
    )
    found = []
    for side in sides:
        seen = side * toward >= 0.0
        x, y = (lambert(side * right[seen], up[seen], side * toward[seen]) / limit + 1.0) * (
            BINS / 2
        )
        place = y.clip(0, BINS - 1).astype(np.intp) * BINS + x.clip(0, BINS - 1).astype(np.intp)
        count = uniform_filter(
            np.bincount(place, minlength=BINS**2).reshape(BINS, BINS).astype(float),
            SMOOTH,
            mode="constant",
        )
        present = (count > 0.5 / SMOOTH**2) & (area > 0.0)
        found.append(np.divide(count, isotropic, out=np.full(count.shape, np.nan), where=present))
    return found
