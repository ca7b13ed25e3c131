"""The inertia of a body as ten unrestricted numbers: any ten numbers describe a possible body.

With the tensor I about the fixed point, mass m and centre of mass c:

    S = 1/2 tr(I) 1 - I = m (N N^T + c c^T),   N upper triangular
    numbers = ln N11, ln N22, ln N33, N23, N13, N12, c1, c2, c3, ln m

S is the second moment of mass, N N^T the second moment per mass about the centre of mass; a body
with I, m and c exists iff N N^T is positive. Source: Rucker & Wensing, IEEE Robotics and Automation
Letters 7 (2022) 2771, log-Cholesky parameters of the pseudo-inertia; Wensing, Kim & Slotine, same
journal 3 (2018) 60.

The parameters of a body are xx, yy, zz, yz, zx, xy of I, then c and m. The code uses plain
arithmetic, so that no bit depends on a linear-algebra library.
"""

from collections.abc import Sequence

import numpy as np

from rigidmc.inputs.arrays import Array
from rigidmc.mechanics.inertia import SIX
from rigidmc.physics.dynamics.dual_arrays import DualArray, square_root
from rigidmc.physics.dynamics.functions import exponential_of, logarithm_of


def numbers_of(parameters: Sequence[float]) -> list[float]:
    """Return the ten numbers of a body with these parameters; ValueError if it cannot exist."""
    n11, n22, n33, *others = _triangle(parameters)
    logarithms = [
        np.log(x) if isinstance(x, DualArray) else float(logarithm_of(x))
        for x in (n11, n22, n33, parameters[9])
    ]
    return [*logarithms[:3], *others, *parameters[6:9], logarithms[3]]


def rates_of(parameters: Sequence[float], change: Sequence[float]) -> list[float]:
    """Return the rates of `numbers_of` when the parameters change at the rates `change`."""
    n11, n22, n33, n23, n13, n12 = _triangle(parameters)
    mass, c, second = parameters[9], parameters[6:9], _second(parameters)
    gain, move, moved = change[9] / mass, change[6:9], _second(change)
    xx, yy, zz, yz, zx, xy = (
        (r - s * gain) / mass - move[i] * c[j] - c[i] * move[j]
        for r, s, (i, j) in zip(moved, second, SIX, strict=True)
    )
    r33 = 0.5 * zz / n33
    r23, r13 = (yz - n23 * r33) / n33, (zx - n13 * r33) / n33
    r22 = (0.5 * yy - n23 * r23) / n22
    r12 = (xy - r13 * n23 - n13 * r23 - n12 * r22) / n22
    r11 = (0.5 * xx - n12 * r12 - n13 * r13) / n11
    return [r11 / n11, r22 / n22, r33 / n33, r23, r13, r12, *move, gain]


def _triangle(parameters: Sequence[float]) -> tuple[float, ...]:
    """Return (N11, N22, N33, N23, N13, N12) of a body; ValueError if it cannot exist."""
    mass, c = parameters[9], parameters[6:9]
    xx, yy, zz, yz, zx, xy = (
        s / mass - c[i] * c[j] for s, (i, j) in zip(_second(parameters), SIX, strict=True)
    )
    n33 = square_root(zz)
    n23, n13 = yz / n33, zx / n33
    n22 = square_root(yy - n23 * n23)
    n12 = (xy - n13 * n23) / n22
    n11 = square_root(xx - n12 * n12 - n13 * n13)
    # rounding leaves smaller values of N for a plate
    if not min(n11, n22, n33) > 1e-7 * square_root(xx + yy + zz):
        raise ValueError("a body must have a nonzero extent along each axis")
    return n11, n22, n33, n23, n13, n12


def _second(parameters: Sequence[float]) -> tuple[float, ...]:
    """Return the second moments of mass of a tensor."""
    xx, yy, zz, yz, zx, xy = parameters[:6]
    half = 0.5 * (xx + yy + zz)
    return half - xx, half - yy, half - zz, -yz, -zx, -xy


def parameters_of(numbers: Array) -> Array:
    """Return the parameters (10, n) of bodies with these numbers (10, n)."""
    d1, d2, d3, n23, n13, n12, x, y, z, logarithm = numbers
    n11, n22, n33, mass = (exponential_of(v) for v in (d1, d2, d3, logarithm))
    xx = mass * (n11 * n11 + n12 * n12 + n13 * n13 + x * x)
    yy = mass * (n22 * n22 + n23 * n23 + y * y)
    zz = mass * (n33 * n33 + z * z)
    yz, zx = mass * (n23 * n33 + y * z), mass * (n13 * n33 + z * x)
    xy = mass * (n12 * n22 + n13 * n23 + x * y)
    return np.stack([yy + zz, zz + xx, xx + yy, -yz, -zx, -xy, x, y, z, mass])


def cholesky_factor(covariance: Sequence[Sequence[float]]) -> list[list[float]]:
    """Return a lower triangular C with C C^T = covariance, which may be singular (Cholesky)."""
    size = len(covariance)
    c = [[0.0] * size for _ in range(size)]
    for j in range(size):
        left = covariance[j][j] - sum(x * x for x in c[j][:j])
        if left > 1e-12 * covariance[j][j]:  # else the previous components determine this one
            c[j][j] = square_root(left)
            for i in range(j + 1, size):
                apart = sum(x * y for x, y in zip(c[i][:j], c[j][:j], strict=True))
                c[i][j] = (covariance[i][j] - apart) / c[j][j]
    return c
