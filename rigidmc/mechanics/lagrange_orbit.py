"""Motion of the heavy symmetric top as formulas: the constants of an orbit, then its motion.

With u = cos theta, v = 1 - u and y = 1 + u, a = L_z/A and b = L_3/A, w = omega_1^2 + omega_2^2,
beta = 2 k/A, k = m g l,

    u'^2 = beta (u - u1)(u - u2)(u - u3),   u1 <= u2 <= 1 <= u3, u = u1 + (u2 - u1) sn^2(p t + d),
    p^2 = beta (u3 - u1)/4                     (TdC (3.40)-(3.42))

The attitude is represented by its Cayley-Klein parameters w + i z = sqrt(y/2) e^(i sigma/2) and
x + i y = sqrt(v/2) e^(i delta/2), sigma = phi + psi, delta = phi - psi. Each phase is one integral
of the third kind with the exact coefficient +-1: in a passage through the upright or hanging
position one phase jumps by half a revolution, and nothing diverges.
"""

import math
import sys
from typing import Any, NamedTuple

from rigidmc.engine.compiler.compose import inline_all
from rigidmc.mechanics.jacobi import (
    Third,
    angle_past,
    complete,
    divide,
    first_kind,
    jacobi,
    jacobi_at,
    quarter_period,
    reduce_argument,
    third,
)
from rigidmc.mechanics.lagrange_limits import cubic_start, plumb, turning_points
from rigidmc.physics.dynamics.functions import arctan2, sincos
from rigidmc.physics.dynamics.vectors import logical_not, select


class LagrangeOrbit(NamedTuple):
    """Constants of a motion, computed once for all times.

    inertia : A [kg m^2];  spin : L_3 [kg m^2/s];  rate : p [rad/s]
    m, mc, quarter, offset : modulus, 1 - m, K(m), p t + d at t = 0
    v1, v2, y1, y2 : 1 - u and 1 + u at the lower and upper turning point;  width : u2 - u1
    b, e_minus, e_plus : b, a - b, a + b [rad/s]
    sigma, delta : sigma/2 and delta/2 at t = 0, minus the values of the formulas there
    drift : (L_3/C - b)/2 [rad/s], constant rate of sigma/2 and -delta/2; if u stays 1, plus the
        rest of the rate of sigma/2
    direct : 1 if sigma is h u - Theta, else 0;  s_plus, s_minus : signs of a + b and a - b
    h_s, h_c : h of sigma as a ratio;  h_minus : h of delta
    plus_nu, plus_mu, minus_nu, minus_mu : the Thirds (1 + nu, mu) of sigma and delta
    plus_all, minus_all : their Theta(K)
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
    drift: float
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


class LagrangeOrbitFormula(NamedTuple):
    """Formula for the LagrangeOrbit of A, C, k = m g l >= 0, momentum and attitude at t = 0."""

    a: float = 0.0
    c: float = 0.0
    k: float = 0.0
    l: Any = (0.0,) * 3
    q: Any = (0.0,) * 4

    def values(self):
        return make_lagrange_orbit(self.a, self.c, self.k, self.l, self.q)


class Amplitude(NamedTuple):
    """Modulus m and mc = 1 - m, and |sn|, cn, dn at t = 0.

    still : whether u is constant, because p is 0 or has no effect
    v1, v2, y1, y2 : as in TurningPoints; if u is constant, the values at the start
    """

    m: float
    mc: float
    sn: float
    cn: float
    dn: float
    still: Any
    v1: float
    v2: float
    y1: float
    y2: float


def amplitude(o, p):
    """Return the Amplitude of a CubicStart and its TurningPoints."""
    m = divide(o.beta * p.width, p.span)
    # a sum of positive terms: 1 - m is 0 below 1e-16, and the period of a near-separatrix top inf
    mc = select(p.span > 0.0, divide(o.beta * p.v2 + p.v3, p.span), 1.0)
    still = (p.span == 0.0) | ((mc == 0.0) & (p.s2 == 0.0))
    moves = (p.width > 0.0) & logical_not(still)
    sn = select(moves, math.sqrt(divide(-p.s1, p.width)), 0.0)
    cn = select(moves, math.sqrt(divide(p.s2, p.width)), 1.0)
    m, mc = select(still, 0.0, m), select(still, 1.0, mc)
    return Amplitude(
        m,
        mc,
        sn,
        cn,
        math.sqrt(cn * cn + mc * sn * sn),
        still,
        select(moves, p.v1, o.v),
        select(moves, p.v2, o.v),
        select(moves, p.y1, o.y),
        select(moves, p.y2, o.y),
    )


class PhaseRates(NamedTuple):
    """Coefficients of the two phases as functions of the argument x = p t + d of sn.

    direct, h_s, h_c, h_minus : see LagrangeOrbit;  plus, minus : the Thirds of sigma and delta
    """

    direct: Any
    h_s: float
    h_c: float
    h_minus: float
    plus: Third
    minus: Third


def phase_rates(o, p, e):
    """Return the PhaseRates of a CubicStart, its TurningPoints and its Amplitude."""
    # nu of sigma is width/y1, or its partner beta y1/span if that is smaller
    direct = p.width * p.width * p.span <= o.beta * p.width * e.y1 * e.y1
    plus = third(
        select(direct, divide(p.width, e.y1), divide(o.beta * e.y1, p.span)),
        select(direct, divide(e.y2, e.y1), divide(p.y3, p.span)),
        select(direct, divide(p.width * p.y3, p.span * e.y1), divide(o.beta * e.y2, p.span)),
    )
    tilt = divide(p.width, e.v1)
    minus = Third(divide(e.v2, e.v1), math.sqrt(divide(tilt * tilt * e.v2 * p.v3, e.v1 * p.span)))
    return PhaseRates(
        direct,
        select(e.still, 0.0, math.sqrt(e.y2 * p.y3)),
        select(e.still, 1.0, math.sqrt(e.y1 * p.span)),
        select(e.still, 0.0, math.sqrt(divide(e.v2 * p.v3, e.v1 * p.span))),
        plus,
        minus,
    )


def start_phases(o, q, s_plus, s_minus):
    """Return (sigma/2, delta/2) at t = 0: the phases of w + i z and x + i y.

    A parameter that is 0 at t = 0 has the phase of its derivative, half a jump later.
    """
    not_hanging, not_upright = o.y > 0.0, o.v > 0.0
    alpha = (
        select(not_hanging, q[0], -(q[1] * o.one + q[2] * o.two)),
        select(not_hanging, q[3], q[1] * o.two - q[2] * o.one),
    )
    gamma = (
        select(not_upright, q[1], q[0] * o.one - q[3] * o.two),
        select(not_upright, q[2], q[0] * o.two + q[3] * o.one),
    )
    return (
        arctan2(alpha[1], alpha[0]) - select(not_hanging, 0.0, s_plus * 0.5 * math.pi),
        arctan2(gamma[1], gamma[0]) - select(not_upright, 0.0, s_minus * 0.5 * math.pi),
    )


def make_lagrange_orbit(a, c, k, l, q):
    """Return the LagrangeOrbit of A, C, k = m g l, body momentum and attitude at t = 0."""
    q = plumb(q)
    o = cubic_start(a, k, l, q)
    p = turning_points(o)
    e = amplitude(o, p)
    f = phase_rates(o, p, e)
    quarter = quarter_period(e.mc)
    sign = select(o.speed < 0.0, -1.0, 1.0)
    offset = first_kind(e.sn, e.cn, e.mc, quarter)
    s_plus, s_minus = select(p.e_plus < 0.0, -1.0, 1.0), select(p.e_minus < 0.0, -1.0, 1.0)
    plus_all, minus_all = complete(quarter, e.m, e.mc, (f.plus, f.minus))
    angles = jacobi_at(offset, e.m, e.mc, (f.plus, f.minus), e.sn, e.cn, e.dn)
    theta_plus, theta_minus = sign * angles[0], sign * angles[1]
    jump = select(f.direct, 0.0, arctan2(f.h_s * sign * e.sn, f.h_c * e.cn * e.dn))
    slope = select(f.direct, divide(f.h_s, f.h_c) * sign * offset, jump)
    sigma, delta = start_phases(o, q, s_plus, s_minus)
    stays = select(e.still, 0.5 * o.unit * divide(p.e_plus, o.y), 0.0)
    return LagrangeOrbit(
        inertia=a,
        spin=l[2],
        rate=select(e.still, 0.0, 0.5 * o.unit * math.sqrt(p.span)),
        m=e.m,
        mc=e.mc,
        quarter=quarter,
        offset=sign * offset,
        v1=e.v1,
        v2=e.v2,
        y1=e.y1,
        y2=e.y2,
        width=p.width,
        b=o.unit * o.b,
        e_minus=o.unit * p.e_minus,
        e_plus=o.unit * p.e_plus,
        sigma=sigma - s_plus * (slope + select(f.direct, -theta_plus, theta_plus)),
        delta=delta - s_minus * (f.h_minus * sign * offset + theta_minus),
        drift=0.5 * l[2] * (1.0 / c - 1.0 / a) + stays,
        direct=select(f.direct, 1.0, 0.0),
        s_plus=s_plus,
        s_minus=s_minus,
        h_s=f.h_s,
        h_c=f.h_c,
        h_minus=f.h_minus,
        plus_nu=f.plus.one_plus_nu,
        plus_mu=f.plus.mu,
        plus_all=plus_all,
        minus_nu=f.minus.one_plus_nu,
        minus_mu=f.minus.mu,
        minus_all=minus_all,
    )


def lagrange_state(o, t):
    """Return (attitude, momentum) at time t."""
    x = o.offset + o.rate * t
    plus, minus = Third(o.plus_nu, o.plus_mu), Third(o.minus_nu, o.minus_mu)
    n, z = reduce_argument(x, o.mc, o.quarter)
    s, c, d, angles = jacobi(z, o.m, o.mc, (plus, minus))
    theta_plus = angle_past(plus, angles[0], o.plus_all, x, n, z, o.mc)
    theta_minus = angle_past(minus, angles[1], o.minus_all, x, n, z, o.mc)
    v, y = o.v1 * (c * c) + o.v2 * (s * s), o.y1 * (c * c) + o.y2 * (s * s)
    jump = arctan2(o.h_s * s, o.h_c * c * d) + math.pi * n
    sigma = o.s_plus * select(
        o.direct == 1.0, divide(o.h_s, o.h_c) * x - theta_plus, jump + theta_plus
    )
    delta = o.s_minus * (o.h_minus * x + theta_minus)
    sine, cosine = sincos(o.sigma + (o.drift * t + sigma))
    sine2, cosine2 = sincos(o.delta + (delta - o.drift * t))
    rv, ry = math.sqrt(v), math.sqrt(y)
    half = math.sqrt(0.5)
    q = (half * ry * cosine, half * rv * cosine2, half * rv * sine2, half * ry * sine)
    # omega_1 + i omega_2 = i e^(i (delta - sigma)/2) ((a - b u) + i u')/sqrt(v y)
    across = select(v < y, o.e_minus + o.b * v, o.e_plus - o.b * y)
    r = divide(o.inertia, rv * ry)
    speed = 2.0 * o.rate * o.width * s * c * d
    re, im = cosine2 * cosine + sine2 * sine, sine2 * cosine - cosine2 * sine
    return q, (-r * (im * across + re * speed), r * (re * across - im * speed), o.spin)


class LagrangeStateFormula(NamedTuple):
    """Formula for attitude and momentum of a LagrangeOrbit at time t."""

    orbit: Any = LagrangeOrbit(*[0.0] * len(LagrangeOrbit._fields))
    t: float = 0.0

    def values(self):
        q, l = lagrange_state(self.orbit, self.t)
        return q + l


inline_all(sys.modules[__name__])
