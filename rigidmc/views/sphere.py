"""The unit sphere in pictures: the density of points on it, and families of polhodes."""

import numpy as np
from scipy.ndimage import gaussian_filter

from rigidmc.inputs.arrays import Array

PIXELS = 360  # of an image of a density: more than a picture shows of a sphere
WIDTH = 3.0  # pixels, standard deviation of the kernel, about 1 degree: an ensemble on a line shows
EVEN = 600_000  # even directions, 3 in a pixel and 170 under the kernel

Curve = Array  # (n, 3)


def central_axis(moments: Array) -> int:
    """Return the axis (0 to 2) of the middle moment; if two moments are equal, of the third."""
    low, middle, high = map(int, np.argsort(moments, kind="stable"))
    same = 1e-9 * moments[high]
    if moments[middle] - moments[low] <= same:
        return high
    return low if moments[high] - moments[middle] <= same else middle


def polhodes(l: Array, moments: Array, points: int = 721) -> Array:
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


def family(moments: Array) -> tuple[list[Curve], list[Curve]]:
    """Return (curves, separatrices) on the unit sphere, each (n, 3): the polhodes of one body at
    eight or sixteen energies, and the great circles 2 T I_mid = L^2 of an asymmetric body.

    The momentum of a symmetric body circles its axis; the momentum of a spherical body is fixed.
    """
    low, middle, high = map(int, np.argsort(moments, kind="stable"))
    axes, turn = np.eye(3), np.linspace(0.0, 2.0 * np.pi, 361)[:, None]
    same = 1e-9 * moments[high]  # as in `central_axis`
    if moments[high] - moments[low] <= same:
        return [], []
    if min(moments[middle] - moments[low], moments[high] - moments[middle]) <= same:
        axis = central_axis(moments)
        first, second = np.delete(axes, axis, axis=0)
        across = np.cos(turn) * first + np.sin(turn) * second
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


def curves_at_energy(moments: Array, inverse: float) -> list[Curve]:
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
    half = np.sqrt(square) * axes[across]
    starts = [side * np.sqrt(1.0 - square) * axes[pole] + half for side in (-1.0, 1.0)]
    curves = polhodes(np.array(starts).T, np.repeat(moments[:, None], 2, axis=1), 361)
    return list(curves.transpose(2, 0, 1))


def even_directions(angle: float = np.pi) -> Array:
    """Return EVEN directions (3, EVEN) evenly spaced over the cap within `angle` of axis 3, by
    Fibonacci's spiral: (1 - cos angle)/2 of the sphere."""
    k = np.arange(EVEN)
    # sin of half the distance from the axis; 1 - cos would lose small angles
    half = np.sin(0.5 * angle) * np.sqrt((k + 0.5) / EVEN)
    rim = 2.0 * half * np.sqrt(1.0 - half * half)
    turn = np.pi * (3.0 - np.sqrt(5.0)) * k
    return np.stack([rim * np.cos(turn), rim * np.sin(turn), 1.0 - 2.0 * half * half])


def smooth_density(points: Array, count: int, even: Array, fraction: float) -> tuple[Array, Array]:
    """Return (density, opacity), images (PIXELS, PIXELS) of directions on the square of side 2.

    The density is relative to an isotropic ensemble; the opacity goes from 1 where one direction
    or more lies under the kernel to 0 far from all.

    points (2, n) : places of the directions in the picture, of all `count` directions
    even (2, m) : places of even directions, which cover `fraction` of the sphere with EVEN of them
    """
    counts, isotropic = _counts(points), _counts(even)
    isotropic *= fraction * count / EVEN
    single = 0.5 / (np.pi * WIDTH**2)  # what a single direction adds to its own pixel
    density = np.full(counts.shape, np.nan)
    is_near = (isotropic > 0.0) & (counts > 0.05 * single)
    np.divide(counts, isotropic, out=density, where=is_near)
    return density, np.where(is_near, np.clip(counts / single, 0.0, 1.0), 0.0)


def _counts(points: Array) -> Array:
    """Count points (2, n) in the pixels of the square from -1 to 1, and smooth."""
    x, y = ((points + 1.0) * (0.5 * PIXELS)).clip(0, PIXELS - 1).astype(np.intp)
    count = np.bincount(y * PIXELS + x, minlength=PIXELS**2).reshape(PIXELS, PIXELS)
    smooth: Array = gaussian_filter(count.astype(float), WIDTH, truncate=3.0)
    return smooth
