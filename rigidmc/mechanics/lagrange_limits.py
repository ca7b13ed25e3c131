"""Start and turning points of the heavy symmetric top: the roots of its cubic in u = cos theta.

The notation is that of `rigidmc.mechanics.lagrange_orbit`. Distances of the roots u1, u2, u3 from
each other and from +-1 come from products, which do not cancel: (a - b)^2 = beta v1 v2 |v3|,
(a + b)^2 = beta y1 y2 y3, u'^2(0) = -beta s1 s2 s3 with s_i = u_i - u(0).
"""

import math
import sys
from typing import NamedTuple

from rigidmc.engine.compiler.compose import inline_all
from rigidmc.mechanics.jacobi import divide
from rigidmc.physics.dynamics.functions import arctan2, sincos
from rigidmc.physics.dynamics.quaternions import vertical
from rigidmc.physics.dynamics.vectors import logical_not, select

# replaces v2 = 0 or y1 = 0, an exact passage through the vertical, where a phase jumps by pi/2
TINY = 1e-280
# a smaller tilt or swing counts as 0: its square is below SMALLEST of `rigidmc.mechanics.jacobi`
VERTICAL = 1e-60
# rates [rad/s] outside this range are scaled to 1: their sixth powers would over- or underflow
SLOW, FAST = 1e-15, 1e15


def differences(beta, f0, f1, f2):
    """Return (s1, s2, beta s3) from the roots s1 <= 0 <= s2 <= s3 of f0 + f1 s + f2 s^2 + beta s^3.

    f0 >= 0. The trigonometric formula and one Newton step give the isolated root, as S = beta s, so
    that beta = 0 needs no special case. The other two follow from their sum and product: a double
    root at 0 stays exact.
    """
    third_f2 = f2 * (1 / 3)
    p3 = max(third_f2 * third_f2 - (1 / 3) * beta * f1, 0.0)  # -P/3 of X^3 + P X + Q, X = S + f2/3
    half_q = third_f2 * third_f2 * third_f2 - 0.5 * third_f2 * beta * f1 + 0.5 * beta * beta * f0
    angle = (1 / 3) * arctan2(math.sqrt(max(p3 * p3 * p3 - half_q * half_q, 0.0)), -half_q)
    last = half_q <= 0.0  # the largest root is the isolated one, else the smallest
    sine, cosine = sincos(angle)
    x = 2.0 * math.sqrt(p3) * select(last, cosine, -0.5 * cosine - math.sqrt(0.75) * sine)
    big = x - third_f2
    slope = (3.0 * big + 2.0 * f2) * big + beta * f1
    big = big - divide(((big + f2) * big + beta * f1) * big + beta * beta * f0, slope)
    # if last, big = beta s3 and the pair is s1 and s2; else big = beta s1 and the pair is beta s2
    # and beta s3, and a start at u1 has big = 0
    product = -divide(select(last, f0, beta * beta * f0), big)
    total = divide(select(last, f1 - beta * product, beta * f1 - product), big)
    small = logical_not(last) & (2.0 * abs(big) < abs(f2 + big))
    total = select(small, -f2 - big, total)
    product = select(small, beta * f1 - big * total, product)
    # u'^2(0) gives all digits, where the Newton step leaves an error of 1e-16 of the other roots: 0
    # for a start at u1
    big = select(small, -divide(beta * beta * f0, product), big)
    root = math.sqrt(max(total * total - 4.0 * product, 0.0))
    far = 0.5 * (total + select(total < 0.0, -root, root))
    near = divide(product, far)
    low, high = min(far, near), max(far, near)
    s1 = select(last, low, divide(big, beta))
    s2 = select(last, high, divide(low, beta))
    return min(s1, 0.0), max(s2, 0.0), max(select(last, big, high), 0.0)


class CubicStart(NamedTuple):
    """Start of a motion, with rates in the unit `unit` [rad/s].

    one, two : omega_1, omega_2;  b, beta : see above;  v, y : 1 - u and 1 + u
    across : a - b u;  speed : u';  e_minus, e_plus : a - b, a + b
    """

    unit: float
    one: float
    two: float
    b: float
    beta: float
    v: float
    y: float
    across: float
    speed: float
    e_minus: float
    e_plus: float


def plumb(q):
    """Return q/|q|, made exactly upright or hanging if within VERTICAL of it."""
    r = 1.0 / math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    q = (r * q[0], r * q[1], r * q[2], r * q[3])
    upright, hanging = max(abs(q[1]), abs(q[2])) < VERTICAL, max(abs(q[0]), abs(q[3])) < VERTICAL
    return (
        select(hanging, 0.0, q[0]),
        select(upright, 0.0, q[1]),
        select(upright, 0.0, q[2]),
        select(hanging, 0.0, q[3]),
    )


def cubic_start(a, k, l, q):
    """Return the CubicStart of A, k, body momentum and unit quaternion."""
    y, v = 2.0 * (q[0] * q[0] + q[3] * q[3]), 2.0 * (q[1] * q[1] + q[2] * q[2])
    g = vertical(q)
    one, two, b, beta = l[0] / a, l[1] / a, l[2] / a, 2.0 * k / a
    swing, other = max(abs(one), abs(two)), max(abs(b), math.sqrt(beta))
    size = max(swing, other)
    unit = select(((size > FAST) | (size < SLOW)) & (size > 0.0), size, 1.0)
    moving = select(swing < VERTICAL * other, 0.0, 1.0 / unit)
    one, two, b, beta = moving * one, moving * two, b / unit, beta / unit / unit
    across, speed = one * g[0] + two * g[1], g[0] * two - g[1] * one
    return CubicStart(unit, one, two, b, beta, v, y, across, speed, across - b * v, across + b * y)


class TurningPoints(NamedTuple):
    """Turning points u1 <= u2 and quantities that depend on the third root u3.

    v1, v2, y1, y2 : 1 - u and 1 + u there;  s1, s2 : u1 - u(0), u2 - u(0);  width : u2 - u1
    v3, y3, span : beta |1 - u3|, beta (1 + u3), beta (u3 - u1);  e_minus, e_plus : a - b, a + b
    """

    v1: float
    v2: float
    y1: float
    y2: float
    s1: float
    s2: float
    width: float
    v3: float
    y3: float
    span: float
    e_minus: float
    e_plus: float


def turning_points(o):
    """Return the TurningPoints of a CubicStart."""
    u0, w = 0.5 * (o.y - o.v), o.one * o.one + o.two * o.two
    s1, s2, r3 = differences(
        o.beta,
        o.speed * o.speed,
        -o.beta * o.v * o.y - 2.0 * u0 * w + 2.0 * o.across * o.b,
        2.0 * o.beta * u0 - w - o.b * o.b,
    )
    v1 = o.v - s1
    # v2 and beta |v3| from their product and difference, the larger of the two first
    product, gap = divide(o.e_minus * o.e_minus, v1), o.beta * (o.v - s2) - (r3 - o.beta * o.v)
    larger = 0.5 * (abs(gap) + math.sqrt(gap * gap + 4.0 * o.beta * product))
    v2 = select(gap > 0.0, divide(larger, o.beta), divide(product, larger))
    v3 = select(gap > 0.0, divide(product, v2), larger)
    # if u2 and u3 are close, s2 has only half the digits of v2
    s2 = select(2.0 * v2 < o.v, o.v - v2, s2)
    width, y2, y3 = s2 - s1, o.y + s2, 2.0 * o.beta + v3
    through = (v2 == 0.0) & (v3 > 0.0)
    v2 = select(through, TINY, v2)
    e_minus = select(through, math.sqrt(v1 * TINY * v3), o.e_minus)
    y1 = divide(o.e_plus * o.e_plus, y2 * y3)
    through = (y1 == 0.0) & (y2 * y3 > 0.0)
    y1 = select(through, TINY, y1)
    e_plus = select(through, math.sqrt(TINY * y2 * y3), o.e_plus)
    return TurningPoints(v1, v2, y1, y2, s1, s2, width, v3, y3, o.beta * v1 + v3, e_minus, e_plus)


inline_all(sys.modules[__name__])
