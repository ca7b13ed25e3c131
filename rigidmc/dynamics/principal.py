"""Principal axes of a symmetric 3x3 tensor, without branches: Jacobi's rotations, gathered in a unit quaternion."""

import math
from typing import NamedTuple

from rigidmc.dynamics.so3 import cross, multiply, normalised, select, touch_up


def _annulled(a, b, c, f, g, off):
    """One rotation in the plane (1, 2) of the tensor [[a, off, f], [off, b, g], [f, g, c]]: (a, b, c, f, g, cos/2, sin/2) after it."""
    twice = 2.0 * off
    gap = b - a
    # tan of the smaller angle that makes off 0; 0 where it is 0 already
    size = abs(gap) + max(
        math.sqrt(gap * gap + twice * twice), abs(twice)
    )  # the squares of small ones underflow
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


def _swept(state):
    """One rotation in each of the three planes. state: (xx, yy, zz, yz, zx, xy, quaternion)."""
    xx, yy, zz, yz, zx, xy, q = state
    xx, yy, zz, zx, yz, c, s = _annulled(xx, yy, zz, zx, yz, xy)
    q = multiply(q, (c, 0.0, 0.0, s))
    yy, zz, xx, xy, zx, c, s = _annulled(yy, zz, xx, 0.0, zx, yz)
    q = multiply(q, (c, s, 0.0, 0.0))
    zz, xx, yy, yz, xy, c, s = _annulled(zz, xx, yy, 0.0, xy, zx)
    q = multiply(q, (c, 0.0, s, 0.0))
    return xx, yy, zz, yz, 0.0, xy, q


def _swept_3(state):
    return _swept(_swept(_swept(state)))


def _ordered(swap, a, b):
    """(a, b), or (b, a) where `swap`, of tuples (moment, x, y, z)."""
    return (
        (
            select(swap, b[0], a[0]),
            select(swap, b[1], a[1]),
            select(swap, b[2], a[2]),
            select(swap, b[3], a[3]),
        ),
        (
            select(swap, a[0], b[0]),
            select(swap, a[1], b[1]),
            select(swap, a[2], b[2]),
            select(swap, a[3], b[3]),
        ),
    )


def _pointed(v):
    """v or -v, so that its largest component is positive; of equal ones the first counts."""
    x, y, z = abs(v[1]), abs(v[2]), abs(v[3])
    largest = select((x >= y) & (x >= z), v[1], select(y >= z, v[2], v[3]))
    sign = select(largest < 0.0, -1.0, 1.0)
    return sign * v[1], sign * v[2], sign * v[3]


def principal(xx, yy, zz, yz, zx, xy):
    """(moments, first, second, third axis): 12 numbers; ascending, right-handed, the first two axes pointed.

    A tensor whose off-diagonal elements are below 4e-15 of its largest (the rounding of sums) keeps its own axes in their order. Six sweeps: after four the
    off-diagonal elements of a 3x3 tensor are below rounding; their cube counts.
    """
    size = max(max(abs(xx), abs(yy)), abs(zz))
    diagonal = max(max(abs(yz), abs(zx)), abs(xy)) <= 4e-15 * size
    a, b, c, _, _, _, q = _swept_3(_swept_3((xx, yy, zz, yz, zx, xy, (1.0, 0.0, 0.0, 0.0))))
    w, x, y, z = touch_up(normalised(q))
    one = (a, 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (z * x - w * y))
    two = (b, 2.0 * (x * y - w * z), 1.0 - 2.0 * (z * z + x * x), 2.0 * (y * z + w * x))
    three = (c, 2.0 * (z * x + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y))
    one, two = _ordered(one[0] > two[0], one, two)
    two, three = _ordered(two[0] > three[0], two, three)
    one, two = _ordered(one[0] > two[0], one, two)
    e, f = _pointed(one), _pointed(two)
    g = cross(e, f)
    return (
        select(diagonal, xx, one[0]),
        select(diagonal, yy, two[0]),
        select(diagonal, zz, three[0]),
        select(diagonal, 1.0, e[0]),
        select(diagonal, 0.0, e[1]),
        select(diagonal, 0.0, e[2]),
        select(diagonal, 0.0, f[0]),
        select(diagonal, 1.0, f[1]),
        select(diagonal, 0.0, f[2]),
        select(diagonal, 0.0, g[0]),
        select(diagonal, 0.0, g[1]),
        select(diagonal, 1.0, g[2]),
    )


class Principal(NamedTuple):
    """The formula: `principal` of the six elements of a tensor."""

    xx: float
    yy: float
    zz: float
    yz: float
    zx: float
    xy: float

    def values(self):
        return principal(self.xx, self.yy, self.zz, self.yz, self.zx, self.xy)
