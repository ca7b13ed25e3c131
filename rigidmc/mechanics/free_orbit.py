"""Free motion as formulas: the constants of an orbit, then momentum and attitude at any time.

In units of |L| the momentum is u = (B cn, W sn, C dn) of phi = lambda (t - t0) along the axes k, 2,
j. Axis 2 has the middle moment; u circles about axis j, which has the largest or the smallest
moment; k is the third axis. The attitude is a rotation that takes u back to axis j, followed by a
rotation by the angle

    psi = spin t -+ (Theta + chi)                    (Fasso 2003; Celledoni, Fasso, Saefstroem &
    Zanna 2008)

Theta is an integral of the third kind with characteristic r = a_k/a_j, chi = arctan(w tan am phi),
w^2 = |a_2|/a_j, spin = |L|/I_k. If r^2 > m, both change to small differences: Theta has the
characteristic m/r = B^2/C^2, spin = |L|/I_j, and chi is the difference of two arctangents, written
as one. Then no term exceeds the sum, and spheres, symmetric bodies, needles and separatrices need
no special cases.
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
    parity,
    quarter_period,
    reduce_argument,
    third,
)
from rigidmc.physics.dynamics.arc import squares
from rigidmc.physics.dynamics.euler import mass_properties
from rigidmc.physics.dynamics.free_flow import MiddleAxes, middle_axis, relabel, to_axis
from rigidmc.physics.dynamics.functions import arctan2, sincos
from rigidmc.physics.dynamics.quaternions import conjugate, multiply, normalised
from rigidmc.physics.dynamics.vectors import dot, scale, select


class FreeOrbit(NamedTuple):
    """Constants of a free motion, computed once for all times.

    size : |L| [kg m^2/s];  rate : lambda [rad/s]
    m, mc, quarter : modulus, 1 - m, K(m);  offset : phi at t = 0
    b, w2, c : signed amplitudes B, W, C of u;  about : 3 or 1, the axis j
    shift : relabelling of the axes (0, 1, 2);  direct : 1 if r^2 <= m, else 0;  w : see above
    one_plus_nu, mu : the Third of Theta;  sense : the sign -+;  spin [rad/s];  swing : Theta(K)
    phase : sense (Theta + chi) at t = 0; 0 until the caller stores the value of `Phase` here
    q0 ... q3 : the attitude at t = 0, rotated back so that u lies on axis j
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
    sense: float
    spin: float
    swing: float
    phase: float
    q0: float
    q1: float
    q2: float
    q3: float


class FreeOrbitFormula(NamedTuple):
    """Formula for the FreeOrbit of principal moments, body momentum and attitude at t = 0."""

    moments: Any = (0.0,) * 3
    l: Any = (0.0,) * 3
    q: Any = (0.0,) * 4

    def values(self):
        return make_free_orbit(self.moments, self.l, self.q)


def size_and_direction(l):
    """Return (|L|, L/|L|); at rest, an arbitrary direction."""
    big = max(max(abs(l[0]), abs(l[1])), abs(l[2]))
    l = scale(divide(1.0, big), l)  # squares of |L| < 1e-154 would underflow
    norm = math.sqrt(dot(l, l))
    one, two, three = scale(divide(1.0, norm), l)
    # at rest the direction (0, 0, 1)
    return big * norm, (one, two, select(big > 0.0, three, 1.0))


class Curve(NamedTuple):
    """Curve of the unit momentum u, and position of u on it at t = 0.

    on_third : whether axis j is 3, else it is 1;  sign : of u_j;  still : whether u is constant
    rate : lambda/|L|;  m, mc : modulus and 1 - m;  sine, cosine : of the amplitude am phi at t = 0
    b, w2, c : signed amplitudes B, W, C;  direct, nu, w : form and constants of Theta and chi
    """

    on_third: Any
    sign: float
    still: Any
    rate: float
    m: float
    mc: float
    sine: float
    cosine: float
    b: float
    w2: float
    c: float
    direct: Any
    nu: float
    w: float


def curve(axes, u):
    """Return the Curve of a unit momentum, with the middle moment on axis 2."""
    p, q1, q3 = squares(axes, u)
    on_third = q3 >= q1
    uj, uk, u2 = select(on_third, u[2], u[0]), select(on_third, u[0], u[2]), u[1]
    aj, ak = abs(select(on_third, axes.a1, axes.a3)), abs(select(on_third, axes.a3, axes.a1))
    a2 = abs(axes.a2)
    square, low = p + max(q1, q3), p + min(q1, q3)  # lambda^2 and m lambda^2, per |L|^2
    m = divide(low, square)
    # not 1 - m, which is 0 below 1e-16: K still grows by 2.3 for each factor of 100 in mc
    mc = select(square > 0.0, divide(max(q1, q3) - min(q1, q3), square), 1.0)
    bb = uk * uk + divide(aj, a2) * (u2 * u2)
    ww = u2 * u2 + divide(a2, aj) * (uk * uk)
    cc = uj * uj + divide(ak, a2) * (u2 * u2)
    sign = select(uj < 0.0, -1.0, 1.0)
    sign2 = select(axes.a2 < 0.0, -sign, sign)
    # sine and cosine of the amplitude at t = 0 are proportional to u2/W and uk/B
    s, c = sign2 * math.sqrt(aj) * u2, math.sqrt(a2) * uk
    hypotenuse = math.sqrt(s * s + c * c)
    s, c = divide(s, hypotenuse), select(hypotenuse > 0.0, divide(c, hypotenuse), 1.0)
    # a constant u, including a spin about the middle axis, gets the amplitude pi/4, which keeps all
    # of its components
    still = (square == 0.0) | ((mc == 0.0) & (c == 0.0))
    m = select(still, 0.0, m)
    direct = ak * ak <= m * (aj * aj)
    return Curve(
        on_third,
        sign,
        still,
        math.sqrt(square),
        m,
        select(still, 1.0, mc),
        select(still, math.sqrt(0.5), s),
        select(still, math.sqrt(0.5), c),
        select(still, math.sqrt(2.0) * uk, math.sqrt(bb)),
        select(still, math.sqrt(2.0) * u2, sign2 * math.sqrt(ww)),
        select(still, uj, sign * math.sqrt(cc)),
        direct,
        select(direct, divide(ak, aj), divide(bb, cc)),
        math.sqrt(divide(a2, aj)),
    )


def make_free_orbit(moments, l, q):
    """Return the FreeOrbit of principal moments, body momentum and attitude at t = 0."""
    size, u = size_and_direction(l)
    body = mass_properties(moments, (0.0, 0.0, 0.0))
    first, last = middle_axis(body)
    u = relabel(first, last, u)
    i1, i2, i3 = relabel(first, last, (body.i1, body.i2, body.i3))
    o = curve(MiddleAxes(i1, i3, *relabel(first, last, (body.a1, body.a2, body.a3))), u)
    ij, ik = select(o.on_third, i3, i1), select(o.on_third, i1, i3)
    quarter = quarter_period(o.mc)
    kind = third(o.nu, 1.0 + o.nu, o.m + o.nu)
    twice_energy = dot(u, (i1 * u[0], i2 * u[1], i3 * u[2]))
    back = normalised(conjugate(to_axis(o.on_third, o.sign, u)))
    one, two, three = relabel(last, first, back[1:])
    q = multiply(normalised(q), (back[0], one, two, three))
    return FreeOrbit(
        size=size,
        rate=select(o.still, 0.0, size * o.rate),
        m=o.m,
        mc=o.mc,
        quarter=quarter,
        offset=first_kind(o.sine, o.cosine, o.mc, quarter),
        b=o.b,
        w2=o.w2,
        c=o.c,
        about=select(o.on_third, 3.0, 1.0),
        shift=select(first, 1.0, select(last, 2.0, 0.0)),
        direct=select(o.direct, 1.0, 0.0),
        w=o.w,
        one_plus_nu=kind.one_plus_nu,
        mu=kind.mu,
        sense=select(o.direct == (ij < ik), -1.0, 1.0),
        spin=size * select(o.still, twice_energy, select(o.direct, ik, ij)),
        swing=complete(quarter, o.m, o.mc, (kind,))[0],
        phase=0.0,
        q0=q[0],
        q1=q[1],
        q2=q[2],
        q3=q[3],
    )


def direction_and_phase(o, t):
    """Return (u in relabelled axes, sense (Theta + chi)) at time t."""
    kind, phi = Third(o.one_plus_nu, o.mu), o.offset + o.rate * t
    n, v = reduce_argument(phi, o.mc, o.quarter)
    s, c, d, angles = jacobi(v, o.m, o.mc, (kind,))
    odd = parity(n)
    uk, u2, uj = odd * o.b * c, odd * o.w2 * s, o.c * d
    j = abs(uj)
    chi = arctan2(o.w * s, c) + math.pi * n
    small = arctan2(o.w * s * c * (uk * uk + u2 * u2), (1.0 + j) * (j * c * c + o.w * o.w * s * s))
    theta = angle_past(kind, angles[0], o.swing, phi, n, v, o.mc)
    angle = theta + select(o.direct == 1.0, chi, small)
    on_third = o.about == 3.0
    return (select(on_third, uk, uj), u2, select(on_third, uj, uk)), o.sense * angle


def free_state(o, t):
    """Return (attitude, momentum) at time t."""
    u, angle = direction_and_phase(o, t)
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


class Phase(NamedTuple):
    """Formula for sense (Theta + chi) of a FreeOrbit at t = 0."""

    orbit: Any = FreeOrbit(*[0.0] * len(FreeOrbit._fields))

    def values(self):
        return (direction_and_phase(self.orbit, 0.0)[1],)


class FreeStateFormula(NamedTuple):
    """Formula for attitude and momentum of a FreeOrbit at time t."""

    orbit: Any = FreeOrbit(*[0.0] * len(FreeOrbit._fields))
    t: float = 0.0

    def values(self):
        q, l = free_state(self.orbit, self.t)
        return q + l


inline_all(sys.modules[__name__])
