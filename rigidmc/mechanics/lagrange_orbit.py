"""The motion of the heavy symmetric top as formulas: constants of an orbit, then momentum and attitude at any time.

With u = cos theta, v = 1 - u and y = 1 + u, a = L_z/A and b = L_3/A, w = omega_1^2 + omega_2^2, beta = 2 k/A, k = m g l,

    u'^2 = beta (u - u1)(u - u2)(u - u3),   u1 <= u2 <= 1 <= u3,   u = u1 + (u2 - u1) sn^2(p t + d),   p^2 = beta (u3 - u1)/4

(TdC (3.40)-(3.42)). The attitude is carried as its Cayley-Klein parameters w + i z = sqrt(y/2) e^(i sigma/2) and
x + i y = sqrt(v/2) e^(i delta/2), sigma = phi + psi, delta = phi - psi: each phase is one integral of the third kind whose coefficient
is exactly +-1, so that an upright or hanging passage is a half turn of one phase and nothing diverges.

Roots near each other and distances from +-1 come from products: (a - b)^2 = beta v1 v2 |v3|, (a + b)^2 = beta y1 y2 y3,
u'^2(0) = -beta s1 s2 s3 with s_i = u_i - u(0).
"""

import math
import sys
from typing import NamedTuple

from rigidmc.dynamics.so3 import opposite, select, sincos, up
from rigidmc.engine.compose import inline_all
from rigidmc.mechanics.jacobi import (
    Third,
    angle_past,
    arctan2,
    complete,
    divided,
    first_kind,
    jacobi,
    jacobi_at,
    quarter_period,
    reduced,
    third,
)

TINY = 1e-280  # stands for v2 = 0 or y1 = 0, an exact passage through the vertical, where a phase jumps by pi/2 at once
VERTICAL = 1e-60  # a tilt or a swing below it is none: its square is below the smallest 1 - m of `rigidmc.mechanics.jacobi`
SLOW, FAST = (
    1e-15,
    1e15,
)  # rates [rad/s] beyond which their sixth powers leave the range of doubles: they are scaled to 1


class Orbit(NamedTuple):
    """What is constant along a motion, and so computed once for all times.

    inertia : A [kg m^2];  spin : L_3 [kg m^2/s];  rate : p [rad/s];  m, mc, quarter, offset : modulus, 1 - m, K(m), p t + d at t = 0
    v1, v2, y1, y2, width : 1 - u and 1 + u at the lower and upper turning angle, u2 - u1;  b, e_minus, e_plus : b, a - b, a + b [rad/s]
    sigma, delta : phases of the two parameters at t = 0, less what the formulas give there;  own : (L_3/C - b)/2 [rad/s], and what else sigma has where u stays 1
    direct : 1 where sigma is h u - Theta;  s_plus, s_minus : signs of a + b and a - b;  h_s, h_c : h as a ratio;  h_minus
    plus_nu, plus_mu, plus_all, minus_nu, minus_mu, minus_all : the Thirds (1 + nu, mu) of the two phases and their Theta(K)
    """

    inertia: float
    spin: float
    rate: float
    m: float
    mc: float
    quarter: float
    offset: float
    v1: float
    v2: float
    y1: float
    y2: float
    width: float
    b: float
    e_minus: float
    e_plus: float
    sigma: float
    delta: float
    own: float
    direct: float
    s_plus: float
    s_minus: float
    h_s: float
    h_c: float
    h_minus: float
    plus_nu: float
    plus_mu: float
    plus_all: float
    minus_nu: float
    minus_mu: float
    minus_all: float


class Started(NamedTuple):
    """The Orbit of A, C, k = m g l >= 0, body momentum and attitude at t = 0."""

    a: float
    c: float
    k: float
    l1: float
    l2: float
    l3: float
    q0: float
    q1: float
    q2: float
    q3: float

    def values(self):
        return orbit(
            self.a,
            self.c,
            self.k,
            (self.l1, self.l2, self.l3),
            (self.q0, self.q1, self.q2, self.q3),
        )


def differences(beta, f0, f1, f2):
    """(s1, s2, beta s3) of f0 + f1 s + f2 s^2 + beta s^3, which has three real roots s1 <= 0 <= s2 <= s3 and f0 >= 0.

    The root that stands alone by trigonometry and one Newton step, for S = beta s so that beta = 0 is no special case; the other two
    from their sum and product, in which a double root at 0 stays exact.
    """
    third_f2 = f2 * (1 / 3)
    p3 = max(third_f2 * third_f2 - (1 / 3) * beta * f1, 0.0)  # -P/3 of X^3 + P X + Q, X = S + f2/3
    half_q = third_f2 * third_f2 * third_f2 - 0.5 * third_f2 * beta * f1 + 0.5 * beta * beta * f0
    angle = (1 / 3) * arctan2(math.sqrt(max(p3 * p3 * p3 - half_q * half_q, 0.0)), -half_q)
    last = half_q <= 0.0  # the largest root stands alone, else the smallest
    sine, cosine = sincos(angle)
    x = 2.0 * math.sqrt(p3) * select(last, cosine, -0.5 * cosine - math.sqrt(0.75) * sine)
    big = x - third_f2
    slope = (3.0 * big + 2.0 * f2) * big + beta * f1
    big = big - divided(((big + f2) * big + beta * f1) * big + beta * beta * f0, slope)
    # last: big = beta s3, the pair is s1 and s2; else big = beta s1, the pair is beta s2 and beta s3, and a start at u1 has big = 0
    product = -divided(select(last, f0, beta * beta * f0), big)
    total = divided(select(last, f1 - beta * product, beta * f1 - product), big)
    small = opposite(last) & (2.0 * abs(big) < abs(f2 + big))
    total = select(small, -f2 - big, total)
    product = select(small, beta * f1 - big * total, product)
    # from u'^2(0) to all its digits, where the Newton step leaves 1e-16 of the others: 0 for a start at u1
    big = select(small, -divided(beta * beta * f0, product), big)
    root = math.sqrt(max(total * total - 4.0 * product, 0.0))
    far = 0.5 * (total + select(total < 0.0, -root, root))
    near = divided(product, far)
    low, high = min(far, near), max(far, near)
    s1 = select(last, low, divided(big, beta))
    s2 = select(last, high, divided(low, beta))
    return min(s1, 0.0), max(s2, 0.0), max(select(last, big, high), 0.0)


def orbit(a, c, k, l, q):
    """The constants of a motion, in the order of Orbit."""
    r = 1.0 / math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    q = (r * q[0], r * q[1], r * q[2], r * q[3])
    upright, hanging = max(abs(q[1]), abs(q[2])) < VERTICAL, max(abs(q[0]), abs(q[3])) < VERTICAL
    q = (
        select(hanging, 0.0, q[0]),
        select(upright, 0.0, q[1]),
        select(upright, 0.0, q[2]),
        select(hanging, 0.0, q[3]),
    )
    y0, v0 = 2.0 * (q[0] * q[0] + q[3] * q[3]), 2.0 * (q[1] * q[1] + q[2] * q[2])
    u0 = 0.5 * (y0 - v0)
    g = up(q)
    one, two, b, beta = l[0] / a, l[1] / a, l[2] / a, 2.0 * k / a
    swing, other = max(abs(one), abs(two)), max(abs(b), math.sqrt(beta))
    size = max(swing, other)
    unit = select(((size > FAST) | (size < SLOW)) & (size > 0.0), size, 1.0)
    moving = select(swing < VERTICAL * other, 0.0, 1.0 / unit)
    one, two, b, beta = moving * one, moving * two, b / unit, beta / unit / unit
    w = one * one + two * two
    across, speed = one * g[0] + two * g[1], g[0] * two - g[1] * one  # a - b u and u' at t = 0
    e_minus, e_plus = across - b * v0, across + b * y0
    s1, s2, r3 = differences(
        beta,
        speed * speed,
        -beta * v0 * y0 - 2.0 * u0 * w + 2.0 * across * b,
        2.0 * beta * u0 - w - b * b,
    )
    v1 = v0 - s1
    # v2 and beta |v3| from their product and difference, whichever is larger first
    product, gap = divided(e_minus * e_minus, v1), beta * (v0 - s2) - (r3 - beta * v0)
    larger = 0.5 * (abs(gap) + math.sqrt(gap * gap + 4.0 * beta * product))
    v2 = select(gap > 0.0, divided(larger, beta), divided(product, larger))
    r3v = select(gap > 0.0, divided(product, v2), larger)
    s2 = select(
        2.0 * v2 < v0, v0 - v2, s2
    )  # where u2 and u3 are near each other, s2 has half the digits of v2
    width, y2, r3y = s2 - s1, y0 + s2, 2.0 * beta + r3v
    through = (v2 == 0.0) & (r3v > 0.0)
    v2 = select(through, TINY, v2)
    e_minus = select(through, math.sqrt(v1 * TINY * r3v), e_minus)
    y1 = divided(e_plus * e_plus, y2 * r3y)
    through = (y1 == 0.0) & (y2 * r3y > 0.0)
    y1 = select(through, TINY, y1)
    e_plus = select(through, math.sqrt(TINY * y2 * r3y), e_plus)
    span = beta * v1 + r3v  # beta (u3 - u1) = 4 p^2
    m, mc = divided(beta * width, span), select(span > 0.0, divided(beta * v2 + r3v, span), 1.0)
    # amplitude at t = 0
    still = (span == 0.0) | ((mc == 0.0) & (s2 == 0.0))
    moves = (width > 0.0) & opposite(still)
    sn = select(moves, math.sqrt(divided(-s1, width)), 0.0)
    cn = select(moves, math.sqrt(divided(s2, width)), 1.0)
    m, mc = select(still, 0.0, m), select(still, 1.0, mc)
    dn = math.sqrt(cn * cn + mc * sn * sn)
    v1, v2, y1, y2 = (
        select(moves, v1, v0),
        select(moves, v2, v0),
        select(moves, y1, y0),
        select(moves, y2, y0),
    )
    quarter = quarter_period(mc)
    sign = select(speed < 0.0, -1.0, 1.0)
    offset = first_kind(sn, cn, mc, quarter)
    # the two phases; nu of sigma is width/y1, or its partner beta y1/span where that is smaller
    s_plus, s_minus = select(e_plus < 0.0, -1.0, 1.0), select(e_minus < 0.0, -1.0, 1.0)
    direct = width * width * span <= beta * width * y1 * y1
    plus = third(
        select(direct, divided(width, y1), divided(beta * y1, span)),
        select(direct, divided(y2, y1), divided(r3y, span)),
        select(direct, divided(width * r3y, span * y1), divided(beta * y2, span)),
    )
    minus = Third(
        divided(v2, v1),
        math.sqrt(divided(divided(width, v1) * divided(width, v1) * v2 * r3v, v1 * span)),
    )
    h_s, h_c = math.sqrt(y2 * r3y), math.sqrt(y1 * span)
    h_s, h_c = select(still, 0.0, h_s), select(still, 1.0, h_c)
    h_minus = select(still, 0.0, math.sqrt(divided(v2 * r3v, v1 * span)))
    rate = select(still, 0.0, 0.5 * unit * math.sqrt(span))
    plus_all, minus_all = complete(quarter, m, mc, (plus, minus))
    at_start = jacobi_at(offset, m, mc, (plus, minus), sn, cn, dn)
    half_turn = select(direct, 0.0, arctan2(h_s * sign * sn, h_c * cn * dn))
    theta_plus, theta_minus = sign * at_start[0], sign * at_start[1]
    slope_plus = select(direct, divided(h_s, h_c) * sign * offset, half_turn)
    own = 0.5 * l[2] * (1.0 / c - 1.0 / a) + select(still, 0.5 * unit * divided(e_plus, y0), 0.0)
    # a parameter that is 0 at t = 0 has the phase of its derivative half a jump later
    alpha = (
        select(y0 > 0.0, q[0], -(q[1] * one + q[2] * two)),
        select(y0 > 0.0, q[3], q[1] * two - q[2] * one),
    )
    gamma = (
        select(v0 > 0.0, q[1], q[0] * one - q[3] * two),
        select(v0 > 0.0, q[2], q[0] * two + q[3] * one),
    )
    sigma = arctan2(alpha[1], alpha[0]) - select(y0 > 0.0, 0.0, s_plus * 0.5 * math.pi)
    delta = arctan2(gamma[1], gamma[0]) - select(v0 > 0.0, 0.0, s_minus * 0.5 * math.pi)
    sigma = sigma - s_plus * (slope_plus + select(direct, -theta_plus, theta_plus))
    delta = delta - s_minus * (h_minus * sign * offset + theta_minus)
    return (
        a,
        l[2],
        rate,
        m,
        mc,
        quarter,
        sign * offset,
        v1,
        v2,
        y1,
        y2,
        width,
        unit * b,
        unit * e_minus,
        unit * e_plus,
        sigma,
        delta,
        own,
        select(direct, 1.0, 0.0),
        s_plus,
        s_minus,
        h_s,
        h_c,
        h_minus,
        plus.one_plus_nu,
        plus.mu,
        plus_all,
        minus.one_plus_nu,
        minus.mu,
        minus_all,
    )


def motion(o, t):
    """(attitude, momentum) at time t."""
    x = o.offset + o.rate * t
    plus, minus = Third(o.plus_nu, o.plus_mu), Third(o.minus_nu, o.minus_mu)
    n, z = reduced(x, o.mc, o.quarter)
    s, c, d, angles = jacobi(z, o.m, o.mc, (plus, minus))
    theta_plus = angle_past(plus, angles[0], o.plus_all, x, n, z, o.mc)
    theta_minus = angle_past(minus, angles[1], o.minus_all, x, n, z, o.mc)
    v, y = o.v1 * (c * c) + o.v2 * (s * s), o.y1 * (c * c) + o.y2 * (s * s)
    jump = arctan2(o.h_s * s, o.h_c * c * d) + math.pi * n
    sigma = o.s_plus * select(
        o.direct == 1.0, divided(o.h_s, o.h_c) * x - theta_plus, jump + theta_plus
    )
    delta = o.s_minus * (o.h_minus * x + theta_minus)
    sine, cosine = sincos(o.sigma + (o.own * t + sigma))
    sine2, cosine2 = sincos(o.delta + (delta - o.own * t))
    rv, ry = math.sqrt(v), math.sqrt(y)
    half = math.sqrt(0.5)
    q = (half * ry * cosine, half * rv * cosine2, half * rv * sine2, half * ry * sine)
    # omega_1 + i omega_2 = i e^(i (delta - sigma)/2) ((a - b u) + i u')/sqrt(v y)
    across = select(v < y, o.e_minus + o.b * v, o.e_plus - o.b * y)
    r = divided(o.inertia, rv * ry)
    speed = 2.0 * o.rate * o.width * s * c * d
    re, im = cosine2 * cosine + sine2 * sine, sine2 * cosine - cosine2 * sine
    return q, (-r * (im * across + re * speed), r * (re * across - im * speed), o.spin)


class Reached(NamedTuple("Reached", [*Orbit.__annotations__.items(), ("t", float)])):  # type: ignore[misc]
    """Attitude and momentum of an Orbit at time t."""

    def values(self):
        q, l = motion(self, self.t)
        return q + l


inline_all(sys.modules[__name__])
