"""The exact motion of a free rigid body over a step, without branches, inverse functions or a modulus.

Momentum by the addition theorem of Jacobi's elliptic functions, attitude by one phase (Celledoni, Fasso, Saefstroem & Zanna,
SIAM J. Sci. Comput. 30 (2008) 2084). One formula serves spheres, symmetric bodies, separatrix and near-degenerate bodies.
The formulas want the middle moment on axis 2; `free_flow` relabels the axes cyclically, by selects, where it is not.
"""

import math
from typing import Any, NamedTuple

from rigidmc.dynamics.arc import Arc, half_and_whole, increment, near_of, of_a_panel, squares
from rigidmc.dynamics.euler import angular_velocity
from rigidmc.dynamics.so3 import (
    add,
    by_precision,
    conjugate,
    dot,
    multiply,
    opposite,
    scale,
    select,
    select_each,
    sincos,
)

_REST = 1e-306  # |L|^2 at which a body stands still: below 2e-308 its digits go, and with them the unit vector L/|L|


class Axes(NamedTuple):
    """The constants of a body whose middle axis is axis 2."""

    i1: float
    i3: float
    a1: float
    a2: float
    a3: float


class Motion(NamedTuple):
    """What stays the same in the free motion of a body, in units of |L|: its momentum is a unit vector u, and its middle axis is axis 2.

    size : |L|;  first, third : whether axis 1 or 3 of the body became axis 2;  twice_energy : 2T/|L|^2
    on_third, sign : about which axis L circles, 3 or 1, and on which side;  inverse : 1/I of that axis
    x, y : P + Q3 and P + Q1, see `squares`;  time : |L| h;  whole : the Arc of h;  half, panel : the Arcs of half a panel of it, and of a panel
    """

    size: float
    first: Any
    third: Any
    body: Axes
    twice_energy: float
    on_third: Any
    sign: float
    inverse: float
    x: float
    y: float
    time: float
    whole: Arc
    half: Arc
    panel: Arc


class Share(NamedTuple):
    """f = 1/(1 + c) and v = c/(1 + c) with its derivatives v', v'' along a free motion, c = |u_j|, j = 3 or 1."""

    f: float
    v: float
    rate: float
    second: float


def _share(m, u, c, f):
    p, q1, q3 = squares(m.body, u)
    rate = m.sign * select(m.on_third, m.body.a3 * u[0], m.body.a1 * u[2]) * u[1]
    ff = f * f
    return Share(
        f, c * f, rate * ff, ff * (c * (p - select(m.on_third, q1, q3)) - 2.0 * rate * rate * f)
    )


def share(m, u):
    """The Share of a unit momentum."""
    c = m.sign * select(m.on_third, u[2], u[0])
    return _share(m, u, c, 1.0 / (1.0 + c))


def slopes(a):
    """How g1 and g3 of an Arc change with x and y."""
    half = 0.5 * a.s * a.s
    return half / (1.0 - a.g1), half / (1.0 - a.g3)


def strayed(m, u):
    """How far rounding has taken x and y of a unit momentum from those of the start."""
    p, q1, q3 = squares(m.body, u)
    return (p + q3) - m.x, (p + q1) - m.y


def followed(m, a, slopes, u):
    """The Arc for a unit momentum that has strayed; slopes : those of the Arc, () where x and y are those of u.

    With g1 and g3 of the start an increment keeps T and |L|^2 for the start's x and y alone, and along a separatrix what rounding takes grows as the
    motion does: by 1e-6 in 10,000 steps.
    """
    if len(slopes) == 0:
        return a
    dx, dy = strayed(m, u)
    return Arc(a.s, a.g1 + slopes[0] * dx, a.g3 + slopes[1] * dy)


def shares_back(m):
    """1/4x and 1/4y, see `returned`; 0 where x or y is."""
    x, y = m.x > 0.0, m.y > 0.0
    return select(x, 0.25 / select(x, m.x, 1.0), 0.0), select(y, 0.25 / select(y, m.y, 1.0), 0.0)


def returned(m, back, u, end):
    """The end of a step from a unit momentum u that has strayed, half of the way back: its axes times 1 - dy/4y, both, and 1 - dx/4x.

    So T and |L|^2 do not walk: 8e-16 off after 1e5 steps of 60 hard and random bodies, where 1.1e-13 would be. Of a body with two equal moments x or y
    is 0 and tells nothing of |L|.
    """
    dx, dy = strayed(m, u)
    x, y = back[0] * dx, back[1] * dy
    return end[0] - y * end[0], end[1] - (x + y) * end[1], end[2] - x * end[2]


def summed(m, panels, u, at, slopes=()):
    """(integral of v over the panels of a step from u on, but for `corrected`; the Share at its end); at : the Share at u.

    A panel's integral by the rule that is exact for polynomials of degree 7: v, v', v'' at both ends, where they come free with the
    flow, and v alone in the middle; its error is 5e-9 h^9 v^(8). Of many panels, and many steps, the ends count twice and v' cancels: here each
    panel counts its end twice, and its start not at all.
    """
    if len(panels) == 0:
        return 0.0, at
    h, f1, f3 = m.time * panels[0], 1.0 - m.half.g1, 1.0 - m.half.g3
    p = m.body.a1 * m.body.a3 * u[1] * u[1]
    first = f1 * u[0] + f3 * m.half.s * m.body.a1 * u[1] * u[2]
    third = f3 * u[2] + f1 * m.half.s * m.body.a3 * u[0] * u[1]
    middle = m.sign * select(m.on_third, third, first)
    below = 1.0 - p * (m.half.s * m.half.s) + middle
    u = add(u, increment(m.body, followed(m, m.panel, slopes, u), p, u, (0.0,)))
    c = m.sign * select(m.on_third, u[2], u[0])
    both = 1.0 / ((1.0 + c) * below)  # one division for two
    end = _share(m, u, c, below * both)
    more, last = summed(m, panels[1:], u, end, slopes)
    return h * (
        (19 / 35) * end.v
        + (16 / 35) * (middle * ((1.0 + c) * both))
        + h * h * ((1 / 420) * end.second)
    ) + more, last


def corrected(m, panels, start, end):
    """What `summed` over any number of steps is to be corrected by; the Shares at their start and end."""
    h = m.time * panels[0]
    return h * (
        (19 / 70) * (start.v - end.v)
        + h * ((1 / 35) * (start.rate - end.rate) + h * ((1 / 840) * (start.second - end.second)))
    )


def phase(m, time, integral):
    """The angle about the axis e_j in a time, with the integral of v over it.

    psi' = 2T (1 - v) + v/I_j: written so that nothing cancels for needles, where 1/I_j exceeds 2T by orders of magnitude
    """
    return m.twice_energy * (time - integral) + m.inverse * integral


def motion(body, halvings, panels, h, l):
    """(Motion, u) of a free body; halvings, panels : see `free_flow`."""
    square = dot(l, l)
    moves = square > by_precision(square, _REST, 1e-36)
    size = select(moves, math.sqrt(square), 0.0)
    u = select_each(
        moves, scale(1.0 / select(moves, size, 1.0), l), (0.0, 0.0, 1.0)
    )  # at rest any unit vector will do: nothing turns
    twice_energy = dot(u, angular_velocity(body, u))
    first, third = middle_axis(body)
    u = relabel(first, third, u)
    i1, _, i3 = relabel(first, third, (body.i1, body.i2, body.i3))
    axes = Axes(i1, i3, *relabel(first, third, (body.a1, body.a2, body.a3)))
    time = h * size
    p, q1, q3 = squares(axes, u)
    half, whole = half_and_whole(time, p + q3, p + q1, halvings)
    on_third = q3 >= q1
    # the side on which L circles stays; where u_j is 0 to rounding its sign may change, and taken anew it would turn the body over
    sign = select(select(on_third, u[2], u[0]) < 0.0, -1.0, 1.0)
    one, panel = of_a_panel(half, whole, time, p + q3, p + q1, panels)
    inverse = select(on_third, i3, i1)
    return Motion(
        size,
        first,
        third,
        axes,
        twice_energy,
        on_third,
        sign,
        inverse,
        p + q3,
        p + q1,
        time,
        whole,
        one,
        panel,
    ), u


def advance(m, halvings, u, slopes=()):
    """What a step adds to the unit momentum u; slopes : see `followed`."""
    p = m.body.a1 * m.body.a3 * u[1] * u[1]
    return increment(m.body, followed(m, m.whole, slopes, u), p, u, near_of(halvings))


def turn_between(m, u, change, angle, start, end):
    """P(u)^-1 exp(angle e_j) P(u + change), the turn of a body between two momenta; their Shares, and the angle is half of the phase.

    As |P(u)|^2 R about u, plus what the change adds, the small turn of a short step has all its digits. The product of the three is off by
    1e-16, alike in every step, so that the error grows with the number of steps.
    """
    s, c = sincos(angle)
    s = s * m.sign
    size, more = 2.0 / start.f, to_axis(m.on_third, m.sign, change)
    more = m.sign * select(m.on_third, change[2], change[0]), more[1], more[2], more[3]
    turn = multiply(
        conjugate(to_axis(m.on_third, m.sign, u)),
        (c, select(m.on_third, 0.0, s), 0.0, select(m.on_third, s, 0.0)),
    )
    turn = multiply(turn, more)
    s = size * m.sign * s
    turn = size * c + turn[0], s * u[0] + turn[1], s * u[1] + turn[2], s * u[2] + turn[3]
    r = 0.5 * math.sqrt(start.f * end.f)  # |P(u)|^2 = 2 (1 + c) before normalisation
    one, two, three = back(m, scale(r, turn[1:]))
    return r * turn[0], one, two, three


def back(m, v):
    """A vector on the axes of the body."""
    return relabel(m.third, m.first, v)


def free_flow(body, halvings, panels, h, l):
    """(turn, change of L) of a free body in the time h: its attitude goes from q to q turn.

        psi = integral of (2T + |L| |L_j| / I_j) / (|L| + |L_j|) dt,   turn = P(L0)* exp(psi e_j / 2) P(L1)

    where P(L) turns L to the body axis e_j, the one (1 or 3) about which L circles. |L|, T and the space momentum are kept to
    rounding at any h; the phase is exact for symmetric bodies and of order 8 in h otherwise.

    The momentum advances by h at once, however many panels there are: its bits do not depend on whether the attitude is computed.

    halvings : a tuple whose LENGTH says how often the series' argument is halved
    panels : n times 1/n: for the phase h is cut into n panels. The tuple holds 1/n because 1/len() would be a float64 in float32
        kernels too
    """
    m, u = motion(body, halvings, panels, h, l)
    change, start = advance(m, halvings, u), share(m, u)
    integral, end = summed(m, panels, u, start)
    angle = 0.5 * phase(m, m.time, integral + corrected(m, panels, start, end))
    return turn_between(m, u, change, angle, start, end), scale(m.size, back(m, change))


def middle_axis(body):
    """(first, third): whether axis 1 or axis 3 has the middle moment; if neither, axis 2 has it.

    That is the case unless a1 a3 < 0. For a body symmetric about axis 2 either other axis will do.
    """
    elsewhere, one_fits = body.a1 * body.a3 < 0.0, body.a2 * body.a3 >= 0.0
    return elsewhere & one_fits, elsewhere & opposite(one_fits)


def relabel(first, third, v):
    """v with its axes shifted so that axis 1 (if `first`) or axis 3 (if `third`) becomes axis 2; swap the two to go back."""
    return (
        select(first, v[2], select(third, v[1], v[0])),
        select(first, v[0], select(third, v[2], v[1])),
        select(first, v[1], select(third, v[0], v[2])),
    )


def to_axis(on_third, sign, u):
    """Quaternion of norm sqrt(2 (1 + c)) that turns the unit vector u to sign e_j, j = 3 or 1, c = sign u_j."""
    return (
        1.0 + sign * select(on_third, u[2], u[0]),
        select(on_third, sign * u[1], 0.0),
        select(on_third, -sign * u[0], sign * u[2]),
        select(on_third, 0.0, -sign * u[1]),
    )
