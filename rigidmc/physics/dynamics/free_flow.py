"""The exact motion of a free rigid body over a step, without branches or inverse functions.

No modulus of elliptic functions is formed. The momentum follows from the addition theorem of
Jacobi's elliptic functions (`rigidmc.physics.dynamics.arc`), the attitude from one phase
(Celledoni, Fasso, Saefstroem & Zanna, SIAM J. Sci. Comput. 30 (2008) 2084). One formula serves
spheres, symmetric bodies, separatrices and near-degenerate bodies. The formulas require the middle
moment on axis 2; for other bodies `free_flow` relabels the axes cyclically, by selects.
"""

import math
from typing import Any, NamedTuple

from rigidmc.physics.dynamics.arc import (
    EllipticArc,
    half_and_full,
    increment,
    near_flag,
    panel_arcs,
    squares,
)
from rigidmc.physics.dynamics.euler import angular_velocity
from rigidmc.physics.dynamics.functions import sincos
from rigidmc.physics.dynamics.methods import ON
from rigidmc.physics.dynamics.quaternions import conjugate, multiply
from rigidmc.physics.dynamics.vectors import (
    add,
    by_precision,
    dot,
    logical_not,
    scale,
    select,
    select_all,
)

# |L|^2 [kg2 m4/s2] below which a body counts as at rest: squares under 2e-308 lose digits, and with
# them the unit vector L/|L|. This is the limit of float64, not of a unit: internal units keep
# momenta above 1e-60, and in float32, whose limit is 1e-36, above 1e-6.
_REST = 1e-306


class MiddleAxes(NamedTuple):
    """The coefficients of a body whose middle moment is on axis 2."""

    i1: float
    i3: float
    a1: float
    a2: float
    a3: float


class FreeFlow(NamedTuple):
    """The constants of a free motion in units of |L|.

    The momentum is a unit vector u, and axis 2 has the middle moment.

    size : |L|
    first, third : whether axis 1 or 3 of the body became axis 2
    twice_energy : 2T/|L|^2
    on_third, sign : the axis e_j about which L circles, 3 or 1, and the sign of L_j
    inverse : 1/I_j
    x, y : P + Q3 and P + Q1, see `squares`
    time : |L| h
    whole, half, panel : the EllipticArcs of h, of half a panel and of a panel
    """

    size: float
    first: Any
    third: Any
    body: MiddleAxes
    twice_energy: float
    on_third: Any
    sign: float
    inverse: float
    x: float
    y: float
    time: float
    whole: EllipticArc
    half: EllipticArc
    panel: EllipticArc


class PhaseFraction(NamedTuple):
    """f = 1/(1 + c), v = c/(1 + c) and v', v'' along a free motion; c = |u_j|, j = 3 or 1."""

    f: float
    v: float
    rate: float
    second: float


def _fraction(m, u, c, f):
    """Return the PhaseFraction of a unit momentum, given c and f."""
    p, q1, q3 = squares(m.body, u)
    rate = m.sign * select(m.on_third, m.body.a3 * u[0], m.body.a1 * u[2]) * u[1]
    ff = f * f
    second = ff * (c * (p - select(m.on_third, q1, q3)) - 2.0 * rate * rate * f)
    return PhaseFraction(f, c * f, rate * ff, second)


def phase_fraction(m, u):
    """Return the PhaseFraction of a unit momentum."""
    c = m.sign * select(m.on_third, u[2], u[0])
    # L circles about sign e_j, so c >= 0: 1 + c lies between 1 and 2, and nothing cancels
    return _fraction(m, u, c, 1.0 / (1.0 + c))


def slopes(a):
    """Return (dg1/dx, dg3/dy) of an EllipticArc at constant S.

    g1 = 1 - sqrt(1 - x S^2), and g3 likewise with y.
    """
    half = 0.5 * a.s * a.s
    return half / (1.0 - a.g1), half / (1.0 - a.g3)


def drift_of_invariants(m, u):
    """Return (x, y) of a unit momentum less the start's values: the accumulated rounding errors."""
    p, q1, q3 = squares(m.body, u)
    return (p + q3) - m.x, (p + q1) - m.y


def arc_for(m, a, slopes, u):
    """Return the EllipticArc for a unit momentum that has drifted from x and y of the start.

    slopes : of the arc, or () if u has the x and y of the start

    With g1 and g3 of the start, an increment conserves T and |L|^2 only for x and y of the start.
    Along a separatrix rounding errors grow as the motion does: by 1e-6 in 10,000 steps.
    """
    if len(slopes) == 0:
        return a
    dx, dy = drift_of_invariants(m, u)
    return EllipticArc(a.s, a.g1 + slopes[0] * dx, a.g3 + slopes[1] * dy)


def return_factors(m):
    """Return (1/4x, 1/4y) for `pull_back`; 0 where x or y is 0, in any unit."""
    x, y = m.x > 0.0, m.y > 0.0
    # Where x or y is 0 the quotient is unused: 1 keeps it finite.
    return select(x, 0.25 / select(x, m.x, 1.0), 0.0), select(y, 0.25 / select(y, m.y, 1.0), 0.0)


def pull_back(m, back, u, end):
    """Return the end of a step from a drifted unit momentum u, moved half of the way back.

    Axes 1 and 2 of `end` are multiplied by 1 - dy/4y, axes 2 and 3 by 1 - dx/4x. This stops a
    random walk of T and |L|^2: the error is 8e-16 after 1e5 steps of 60 hard and random bodies, and
    1.1e-13 without it (tests/physics/dynamics/test_free_flow.py). For a body with two equal moments
    x or y is 0, and does not determine |L|.
    """
    dx, dy = drift_of_invariants(m, u)
    x, y = back[0] * dx, back[1] * dy
    return end[0] - y * end[0], end[1] - (x + y) * end[1], end[2] - x * end[2]


def integrate_phase(m, panels, u, at, slopes=()):
    """Return (integral of v over the panels of a step from u, PhaseFraction at its end).

    The integral lacks the terms that `end_correction` adds.

    at : PhaseFraction at u
    slopes : see `arc_for`

    The rule of a panel is exact for polynomials of degree 7. It uses v, v', v'' at both ends, which
    the flow provides at no cost, and v in the middle; its error is h^9 v^(8)/(7! 8!). Over many
    panels and steps each inner end counts twice and its v' cancels. So each panel here counts its
    end twice and its start not at all.
    """
    if len(panels) == 0:
        return 0.0, at
    h, f1, f3 = m.time * panels[0], 1.0 - m.half.g1, 1.0 - m.half.g3
    p = m.body.a1 * m.body.a3 * u[1] * u[1]
    first = f1 * u[0] + f3 * m.half.s * m.body.a1 * u[1] * u[2]
    third = f3 * u[2] + f1 * m.half.s * m.body.a3 * u[0] * u[1]
    middle = m.sign * select(m.on_third, third, first)
    below = 1.0 - p * (m.half.s * m.half.s) + middle
    u = add(u, increment(m.body, arc_for(m, m.panel, slopes, u), p, u, ON))
    c = m.sign * select(m.on_third, u[2], u[0])
    inverse = 1.0 / ((1.0 + c) * below)  # one division for two
    end = _fraction(m, u, c, below * inverse)
    others, last = integrate_phase(m, panels[1:], u, end, slopes)
    # 19/70, 16/35, 19/70 of v, +-h/35 of v', h^2/840 of v'': an inner end counts for two panels
    inner = (19 / 35) * end.v + (16 / 35) * (middle * ((1.0 + c) * inverse))
    return h * (inner + h * h * ((1 / 420) * end.second)) + others, last


def end_correction(m, panels, start, end):
    """Return the end terms of the integral in `integrate_phase` over any number of steps.

    start, end : PhaseFraction at the start of the first step and at the end of the last one
    """
    h = m.time * panels[0]
    return h * (
        (19 / 70) * (start.v - end.v)
        + h * ((1 / 35) * (start.rate - end.rate) + h * ((1 / 840) * (start.second - end.second)))
    )


def phase(m, time, integral):
    """Return the angle about the axis e_j over a time, from the integral of v.

    psi' = 2T (1 - v) + v/I_j: nothing cancels for needles, whose 1/I_j exceeds 2T by orders of
    magnitude
    """
    return m.twice_energy * (time - integral) + m.inverse * integral


def make_flow(body, halvings, panels, h, l):
    """Return (FreeFlow, u) of a free body; halvings, panels : see `free_flow`."""
    square = dot(l, l)
    moves = is_moving(square)
    size = momentum_size(moves, square)
    # at rest any unit vector works: nothing rotates
    u = select_all(moves, scale(1.0 / select(moves, size, 1.0), l), (0.0, 0.0, 1.0))
    twice_energy = dot(u, angular_velocity(body, u))
    first, third = middle_axis(body)
    u = relabel(first, third, u)
    i1, _, i3 = relabel(first, third, (body.i1, body.i2, body.i3))
    axes = MiddleAxes(i1, i3, *relabel(first, third, (body.a1, body.a2, body.a3)))
    time = h * size
    p, q1, q3 = squares(axes, u)
    half, whole = half_and_full(time, p + q3, p + q1, halvings)
    # on a separatrix Q1 = Q3 and either axis serves
    on_third = q3 >= q1
    # The sign is a constant of the motion. Computed at each step, it could change where u_j is 0 to
    # rounding, and would turn the body over.
    sign = select(select(on_third, u[2], u[0]) < 0.0, -1.0, 1.0)
    half_panel, panel = panel_arcs(half, whole, time, p + q3, p + q1, panels)
    flow = FreeFlow(
        size, first, third, axes, twice_energy, on_third, sign, select(on_third, i3, i1), p + q3,
        p + q1, time, whole, half_panel, panel,
    )  # fmt: skip
    return flow, u


def is_moving(square):
    """Return whether a body with this |L|^2 moves."""
    # the limits of float64 and float32, see _REST
    return square > by_precision(square, _REST, 1e-36)


def momentum_size(moves, square):
    """Return |L| from |L|^2, 0 unless the body moves."""
    return select(moves, math.sqrt(square), 0.0)


def momentum_change(m, halvings, u, slopes=()):
    """Return the change of the unit momentum u in a step; slopes : see `arc_for`."""
    p = m.body.a1 * m.body.a3 * u[1] * u[1]
    return increment(m.body, arc_for(m, m.whole, slopes, u), p, u, near_flag(halvings))


def turn_between(m, u, change, angle, start, end):
    """Return P(u)^-1 exp(angle e_j) P(u + change), the rotation of a body between two momenta.

    angle : half of the phase
    start, end : PhaseFraction of the two momenta

    Written as |P(u)|^2 times a rotation about u plus a small term for the change, it keeps all
    digits of the small rotation of a short step. The product of the three factors has a rounding
    error that is the same in every step and would grow in proportion to the number of steps.
    """
    s, c = sincos(angle)
    s = s * m.sign
    size, to_end = 2.0 / start.f, to_axis(m.on_third, m.sign, change)
    to_end = m.sign * select(m.on_third, change[2], change[0]), to_end[1], to_end[2], to_end[3]
    rotation = multiply(
        conjugate(to_axis(m.on_third, m.sign, u)),
        (c, select(m.on_third, 0.0, s), 0.0, select(m.on_third, s, 0.0)),
    )
    rotation = multiply(rotation, to_end)
    s = size * m.sign * s
    rotation = (
        size * c + rotation[0],
        s * u[0] + rotation[1],
        s * u[1] + rotation[2],
        s * u[2] + rotation[3],
    )
    r = 0.5 * math.sqrt(start.f * end.f)  # |P(u)|^2 = 2 (1 + c) before normalisation
    one, two, three = to_body_axes(m, scale(r, rotation[1:]))
    return r * rotation[0], one, two, three


def to_body_axes(m, v):
    """Return the components of a vector on the axes of the body, from the axes of the FreeFlow."""
    return relabel(m.third, m.first, v)


def free_flow(body, halvings, panels, h, l):
    """Return (turn, change of L) of a free body over the time h; the attitude becomes q turn.

        psi = integral of (2T + |L| |L_j| / I_j) / (|L| + |L_j|) dt,
        turn = P(L0)* exp(psi e_j / 2) P(L1)

    P(L) rotates L to the body axis e_j, the axis (1 or 3) about which L circles. |L|, T and the
    space momentum are conserved to rounding at any h; the phase is exact for symmetric bodies, else
    of order 8 in h.

    The momentum advances over the whole h whatever the number of panels: its bits do not depend on
    whether the attitude is computed.

    halvings : a tuple whose LENGTH is the number of times the argument of the series is halved
    panels : n times 1/n, to cut h into n panels for the phase. The tuple holds 1/n because 1/len()
        would be a float64 also in float32 kernels
    """
    return flow_about_momentum(body, halvings, panels, h, l)


def flow_about_momentum(body, halvings, panels, h, l):
    """Do the same as `free_flow`; of derivatives, those at rest are lost with the axis of L."""
    m, u = make_flow(body, halvings, panels, h, l)
    change, start = momentum_change(m, halvings, u), phase_fraction(m, u)
    integral, end = integrate_phase(m, panels, u, start)
    angle = 0.5 * phase(m, m.time, integral + end_correction(m, panels, start, end))
    return turn_between(m, u, change, angle, start, end), scale(m.size, to_body_axes(m, change))


def middle_axis(body):
    """Return (first, third): whether axis 1 or axis 3 has the middle moment; else axis 2 has it.

    Axis 2 has it unless a1 a3 < 0. For a body symmetric about axis 2 either other axis works.
    """
    elsewhere, one_fits = body.a1 * body.a3 < 0.0, body.a2 * body.a3 >= 0.0
    return elsewhere & one_fits, elsewhere & logical_not(one_fits)


def relabel(first, third, v):
    """Shift the axes of v cyclically: axis 1 (if `first`) or 3 (if `third`) becomes axis 2.

    Swap `first` and `third` to go back.
    """
    return (
        select(first, v[2], select(third, v[1], v[0])),
        select(first, v[0], select(third, v[2], v[1])),
        select(first, v[1], select(third, v[0], v[2])),
    )


def to_axis(on_third, sign, u):
    """Return the quaternion of norm sqrt(2 (1 + c)) that rotates the unit vector u to sign e_j.

    j = 3 if on_third, else 1;  c = sign u_j
    """
    return (
        1.0 + sign * select(on_third, u[2], u[0]),
        select(on_third, sign * u[1], 0.0),
        select(on_third, -sign * u[0], sign * u[2]),
        select(on_third, 0.0, -sign * u[1]),
    )
