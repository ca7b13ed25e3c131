"""The free motion as formulas: constants of an orbit, then momentum and attitude at any time, for every body and every start.

In units of |L| the momentum is u = (B cn, W sn, C dn) of phi = lambda (t - t0) along the axes k, 2, j: 2 is the axis of the middle
moment, j (of the largest or the smallest) the one about which u circles, k the third. The attitude turns u back to axis j, then by

    psi = spin t -+ (Theta + chi)                                 (Fasso 2003; Celledoni, Fasso, Saefstroem & Zanna 2008)

Theta is an integral of the third kind with characteristic r = a_k/a_j, chi = arctan(w tan am phi), w^2 = |a_2|/a_j, spin = |L|/I_k. Where
r^2 > m, both become small differences; there Theta has the characteristic m/r = B^2/C^2, spin = |L|/I_j, and chi is the difference
of two arctangents, written as one. So no term exceeds the sum, and spheres, symmetric bodies, needles and separatrices need no case.
"""

import math
import sys
from typing import NamedTuple

from rigidmc.dynamics.arc import squares
from rigidmc.dynamics.euler import mass_properties
from rigidmc.dynamics.free_flow import Axes, relabel, to_axis
from rigidmc.dynamics.so3 import (
    conjugate,
    dot,
    multiply,
    normalised,
    opposite,
    scale,
    select,
    sincos,
)
from rigidmc.engine.compose import inline_all
from rigidmc.mechanics.jacobi import (
    Third,
    angle_past,
    arctan2,
    complete,
    divided,
    first_kind,
    jacobi,
    parity,
    quarter_period,
    reduced,
    third,
)


class Orbit(NamedTuple):
    """What is constant along a free motion, and so computed once for all times.

    size : |L| [kg m^2/s];  rate : lambda [rad/s];  m, mc, quarter : modulus, 1 - m, K(m);  offset : phi at t = 0
    b, w2, c : signed amplitudes B, W, C of u;  about : 3 or 1, the axis j;  shift : how the axes were relabelled (0, 1, 2)
    direct : 1 where r^2 <= m;  w;  one_plus_nu, mu : the Third;  turn : the sign -+;  spin [rad/s];  swing : Theta(K)
    phase : turn (Theta + chi) at t = 0, 0 until `Phase` is put there;  q0 ... q3 : attitude at t = 0, turned back so that u lies on axis j
    """

    size: float
    rate: float
    m: float
    mc: float
    quarter: float
    offset: float
    b: float
    w2: float
    c: float
    about: float
    shift: float
    direct: float
    w: float
    one_plus_nu: float
    mu: float
    turn: float
    spin: float
    swing: float
    phase: float
    q0: float
    q1: float
    q2: float
    q3: float


class Started(NamedTuple):
    """The Orbit of principal moments, body momentum and attitude at t = 0."""

    i1: float
    i2: float
    i3: float
    l1: float
    l2: float
    l3: float
    q0: float
    q1: float
    q2: float
    q3: float

    def values(self):
        return orbit(
            (self.i1, self.i2, self.i3),
            (self.l1, self.l2, self.l3),
            (self.q0, self.q1, self.q2, self.q3),
        )


def orbit(moments, l, q):
    """The constants of a free motion, in the order of Orbit."""
    big = max(max(abs(l[0]), abs(l[1])), abs(l[2]))
    l = scale(divided(1.0, big), l)  # squares of |L| < 1e-154 would underflow
    norm = math.sqrt(dot(l, l))
    one, two, three = scale(divided(1.0, norm), l)
    u = one, two, select(big > 0.0, three, 1.0)  # at rest any direction will do
    size = big * norm
    body = mass_properties(moments, (0.0, 0.0, 0.0))
    # axis 2 is the middle one unless a1 a3 < 0; of a body symmetric about axis 2 either other axis will do
    elsewhere, one_fits = body.a1 * body.a3 < 0.0, body.a2 * body.a3 >= 0.0
    first, last = elsewhere & one_fits, elsewhere & opposite(one_fits)
    u = relabel(first, last, u)
    i1, i2, i3 = relabel(first, last, (body.i1, body.i2, body.i3))
    a1, a2, a3 = relabel(first, last, (body.a1, body.a2, body.a3))
    p, q1, q3 = squares(Axes(i1, i3, a1, a2, a3), u)
    on_third = q3 >= q1
    uj, uk, u2 = select(on_third, u[2], u[0]), select(on_third, u[0], u[2]), u[1]
    aj, ak, a2_size = abs(select(on_third, a1, a3)), abs(select(on_third, a3, a1)), abs(a2)
    ij, ik = select(on_third, i3, i1), select(on_third, i1, i3)
    square, low = p + max(q1, q3), p + min(q1, q3)  # lambda^2 and m lambda^2, per |L|^2
    m, mc = (
        divided(low, square),
        select(square > 0.0, divided(max(q1, q3) - min(q1, q3), square), 1.0),
    )
    cc, bb = uj * uj + divided(ak, a2_size) * (u2 * u2), uk * uk + divided(aj, a2_size) * (u2 * u2)
    ww = u2 * u2 + divided(a2_size, aj) * (uk * uk)
    sign = select(uj < 0.0, -1.0, 1.0)
    sign2 = select(a2 < 0.0, -sign, sign)
    # amplitude at t = 0: sin and cos in proportion to u2/W and uk/B
    s, c = sign2 * math.sqrt(aj) * u2, math.sqrt(a2_size) * uk
    hypotenuse = math.sqrt(s * s + c * c)
    s, c = divided(s, hypotenuse), select(hypotenuse > 0.0, divided(c, hypotenuse), 1.0)
    # what does not move, a spin about the middle axis too, keeps its place at the amplitude pi/4, where none of its components is lost
    still = (square == 0.0) | ((mc == 0.0) & (c == 0.0))
    s, c = select(still, math.sqrt(0.5), s), select(still, math.sqrt(0.5), c)
    b, w2 = (
        select(still, math.sqrt(2.0) * uk, math.sqrt(bb)),
        select(still, math.sqrt(2.0) * u2, sign2 * math.sqrt(ww)),
    )
    c_amplitude = select(still, uj, sign * math.sqrt(cc))
    mc, m = select(still, 1.0, mc), select(still, 0.0, m)
    quarter = quarter_period(mc)
    direct = ak * ak <= m * (aj * aj)
    nu = select(direct, divided(ak, aj), divided(bb, cc))
    kind = third(nu, 1.0 + nu, m + nu)
    turn = select(direct == (ij < ik), -1.0, 1.0)
    swing = complete(quarter, m, mc, (kind,))[0]
    back = normalised(conjugate(to_axis(on_third, sign, u)))
    one, two, three = relabel(last, first, back[1:])
    q = multiply(normalised(q), (back[0], one, two, three))
    return (
        size,
        select(still, 0.0, size * math.sqrt(square)),
        m,
        mc,
        quarter,
        first_kind(s, c, mc, quarter),
        b,
        w2,
        c_amplitude,
        select(on_third, 3.0, 1.0),
        select(first, 1.0, select(last, 2.0, 0.0)),
        select(direct, 1.0, 0.0),
        math.sqrt(divided(a2_size, aj)),
        kind.one_plus_nu,
        kind.mu,
        turn,
        size * select(still, dot(u, (i1 * u[0], i2 * u[1], i3 * u[2])), select(direct, ik, ij)),
        swing,
        0.0,
        q[0],
        q[1],
        q[2],
        q[3],
    )


def turned_phase(o, t):
    """(u in relabelled axes, turn (Theta + chi)) at time t."""
    kind, phi = Third(o.one_plus_nu, o.mu), o.offset + o.rate * t
    n, v = reduced(phi, o.mc, o.quarter)
    s, c, d, angles = jacobi(v, o.m, o.mc, (kind,))
    odd = parity(n)
    uk, u2, uj = odd * o.b * c, odd * o.w2 * s, o.c * d
    j = abs(uj)
    chi = arctan2(o.w * s, c) + math.pi * n
    small = arctan2(o.w * s * c * (uk * uk + u2 * u2), (1.0 + j) * (j * c * c + o.w * o.w * s * s))
    angle = angle_past(kind, angles[0], o.swing, phi, n, v, o.mc) + select(
        o.direct == 1.0, chi, small
    )
    on_third = o.about == 3.0
    return (select(on_third, uk, uj), u2, select(on_third, uj, uk)), o.turn * angle


def motion(o, t):
    """(attitude, momentum) at time t."""
    u, angle = turned_phase(o, t)
    on_third = o.about == 3.0
    s, c = sincos(0.5 * (o.spin * t + (angle - o.phase)))
    sign = select(o.c < 0.0, -1.0, 1.0)
    s = sign * s
    turn = multiply(
        (c, select(on_third, 0.0, s), 0.0, select(on_third, s, 0.0)),
        normalised(to_axis(on_third, sign, u)),
    )
    first, last = o.shift == 1.0, o.shift == 2.0
    one, two, three = relabel(last, first, turn[1:])
    q = multiply((o.q0, o.q1, o.q2, o.q3), (turn[0], one, two, three))
    return q, scale(o.size, relabel(last, first, u))


class Phase(NamedTuple("Phase", Orbit.__annotations__.items())):  # type: ignore[misc]
    """turn (Theta + chi) of an Orbit at t = 0."""

    def values(self):
        return (turned_phase(self, 0.0)[1],)


class Reached(NamedTuple("Reached", [*Orbit.__annotations__.items(), ("t", float)])):  # type: ignore[misc]
    """Attitude and momentum of an Orbit at time t."""

    def values(self):
        q, l = motion(self, self.t)
        return q + l


inline_all(sys.modules[__name__])
