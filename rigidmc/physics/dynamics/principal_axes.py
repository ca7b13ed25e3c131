"""Principal axes of a symmetric 3x3 tensor, without branches.

The Jacobi rotations accumulate in a unit quaternion.
"""

import math
from typing import NamedTuple

from rigidmc.physics.dynamics.quaternions import multiply, normalised, touch_up
from rigidmc.physics.dynamics.vectors import cross, select, select_all


def _annul(a, b, c, f, g, off):
    """Make one rotation in the plane (1, 2) that makes `off` 0.

    The tensor is [[a, off, f], [off, b, g], [f, g, c]]. Return (a, b, c, f, g, cos, sin): the new
    elements, and cosine and sine of half the angle.
    """
    twice = 2.0 * off
    gap = b - a
    # t is the tangent of the smaller of the two angles that make `off` 0, by Rutishauser's formula:
    # no cancellation, no arctangent. t is 0 if `off` is 0 already. The squares of small numbers
    # underflow, hence `max`.
    size = abs(gap) + max(math.sqrt(gap * gap + twice * twice), abs(twice))
    # where `off` is 0, t is 0 whatever the divisor
    t = twice / select(off == 0.0, 1.0, select(gap < 0.0, -size, size))
    cosine = 1.0 / math.sqrt(1.0 + t * t)
    sine = t * cosine
    half = math.sqrt(0.5 + 0.5 * cosine)
    return (
        a - t * off,
        b + t * off,
        c,
        cosine * f - sine * g,
        sine * f + cosine * g,
        half,
        -0.5 * sine / half,
    )


def _sweep(state):
    """Rotate once in each of the three planes; state : (xx, yy, zz, yz, zx, xy, quaternion)."""
    xx, yy, zz, yz, zx, xy, q = state
    xx, yy, zz, zx, yz, c, s = _annul(xx, yy, zz, zx, yz, xy)
    q = multiply(q, (c, 0.0, 0.0, s))
    yy, zz, xx, xy, zx, c, s = _annul(yy, zz, xx, 0.0, zx, yz)
    q = multiply(q, (c, s, 0.0, 0.0))
    zz, xx, yy, yz, xy, c, s = _annul(zz, xx, yy, 0.0, xy, zx)
    q = multiply(q, (c, 0.0, s, 0.0))
    return xx, yy, zz, yz, 0.0, xy, q


def _sweep_three(state):
    return _sweep(_sweep(_sweep(state)))


def _sort_two(swap, a, b):
    """Return (a, b), or (b, a) if `swap`, for tuples (moment, x, y, z)."""
    return select_all(swap, b, a), select_all(swap, a, b)


def _fix_sign(v):
    """Return x, y, z of a tuple (moment, x, y, z), signed so that the largest is positive.

    If several are largest, the first counts.
    """
    x, y, z = abs(v[1]), abs(v[2]), abs(v[3])
    largest = select((x >= y) & (x >= z), v[1], select(y >= z, v[2], v[3]))
    sign = select(largest < 0.0, -1.0, 1.0)
    return sign * v[1], sign * v[2], sign * v[3]


def principal(xx, yy, zz, yz, zx, xy):
    """Return (moments, first, second, third axis): 12 numbers.

    The moments ascend, the axes are right-handed, and the largest component of each of the first
    two axes is positive. A tensor whose off-diagonal elements are below 4e-15 of its largest (the
    rounding of sums) keeps its axes and their order.

    Six sweeps: after four the off-diagonal elements of a 3x3 tensor are below rounding, and each
    sweep cubes them.
    """
    size = max(max(abs(xx), abs(yy)), abs(zz))
    diagonal = max(max(abs(yz), abs(zx)), abs(xy)) <= 4e-15 * size
    a, b, c, _, _, _, q = _sweep_three(_sweep_three((xx, yy, zz, yz, zx, xy, (1.0, 0.0, 0.0, 0.0))))
    w, x, y, z = touch_up(normalised(q))
    first = (a, 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (z * x - w * y))
    second = (b, 2.0 * (x * y - w * z), 1.0 - 2.0 * (z * z + x * x), 2.0 * (y * z + w * x))
    third = (c, 2.0 * (z * x + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y))
    first, second = _sort_two(first[0] > second[0], first, second)
    second, third = _sort_two(second[0] > third[0], second, third)
    first, second = _sort_two(first[0] > second[0], first, second)
    # The sign of an axis is arbitrary; a rule makes it the same on every machine.
    e, f = _fix_sign(first), _fix_sign(second)
    g = cross(e, f)
    unit_axes = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
    moments = first[0], second[0], third[0]
    return select_all(diagonal, (xx, yy, zz) + unit_axes, moments + e + f + g)


class Principal(NamedTuple):
    """`principal` of the six elements of a tensor, as a formula for `rigidmc.engine.formulas`."""

    xx: float
    yy: float
    zz: float
    yz: float
    zx: float
    xy: float

    def values(self):
        return principal(self.xx, self.yy, self.zz, self.yz, self.zx, self.xy)
