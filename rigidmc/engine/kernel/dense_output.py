"""The state of a member within a step: dense output, by Hermite interpolation.

Attitude and momentum are polynomials of degree 5 in the completed fraction x of the step. They have
the value, the first and the second derivative of the motion at both ends of the step. Over a turn
of x [rad] the error of the attitude is (x/2)^6/46080 or less. This needs no support from the
integrator: derivatives follow from the torque at the ends.
Source: Hairer, Norsett & Wanner, Solving ODEs I (1993), II.6.
"""

import sys
from typing import Any, NamedTuple

from rigidmc.engine.compiler.compose import inline_all
from rigidmc.physics.dynamics.euler import scaled
from rigidmc.physics.dynamics.so3 import (
    axpy,
    axpy4,
    difference,
    difference4,
    scale,
    scale4,
    touch_up,
)
from rigidmc.physics.effects.sums import state_rates

# Fraction of a step over which differences approximate derivatives along the motion. Their errors
# are 1e-4 of the next derivative, which moves an interpolated attitude by 1e-7; rounding, by 1e-12.
AHEAD = 1e-4


class Endpoint(NamedTuple):
    """One end of a step: the state, and its changes over one step at the rates there."""

    q: Any
    l: Any
    dq: Any
    dl: Any


class Step(NamedTuple):
    """A step h of a member.

    t, q, l : time, attitude and momentum at its end
    p, m : attitude and momentum at its start
    tails : rows of the tails of records, see `rigidmc.engine.kernel.layout.tail_of`

    States of effects follow the momenta.
    """

    body: Any
    effects: Any
    t: Any
    h: Any
    q: Any
    l: Any
    p: Any
    m: Any
    tails: Any


def start_of_step(step):
    """Return the Endpoint at the start of a step."""
    t, rates = step.t - step.h, scaled(step.body, step.h)
    dq, dl = state_rates(rates, step.effects, step.body, t, step.h, step.p, step.m)
    return Endpoint(step.p, step.m, dq, dl)


def end_of_step(step):
    """Return the Endpoint at the end of a step."""
    rates = scaled(step.body, step.h)
    dq, dl = state_rates(rates, step.effects, step.body, step.t, step.h, step.q, step.l)
    return Endpoint(step.q, step.l, dq, dl)


def ahead(corner):
    """Return (q, L) after the fraction AHEAD of a step from an Endpoint."""
    return axpy4(corner.q, AHEAD, corner.dq), axpy(corner.l, AHEAD, corner.dl)


def time_within(step, x):
    """Return the time after the fraction x of a step [s]."""
    return step.t - (1.0 - x) * step.h


class Interpolant(NamedTuple):
    """A Step, its Endpoints, and the second derivatives there, times h^2."""

    step: Any
    a: Any
    b: Any
    first: Any
    last: Any


def make_interpolant(step):
    """Return the Interpolant of a Step."""
    a, b = start_of_step(step), end_of_step(step)
    first, last = second_derivative(step, step.t - step.h, a), second_derivative(step, step.t, b)
    return Interpolant(step, a, b, first, last)


def second_derivative(step, t, corner):
    """Return the second derivatives of (q, L) at an Endpoint, times h^2."""
    q, l = ahead(corner)
    rates, later = scaled(step.body, step.h), t + AHEAD * step.h
    dq, dl = state_rates(rates, step.effects, step.body, later, step.h, q, l)
    return (
        scale4(1.0 / AHEAD, difference4(dq, corner.dq)),
        scale(1.0 / AHEAD, difference(dl, corner.dl)),
    )


def interpolate(path, x):
    """Return (q, L) after the fraction x of a step."""
    y = 1.0 - x
    xx, yy = x * x, y * y
    cube, rest = x * xx, y * yy
    # Hermite's quintics, for the change q(1) - q(0): it is small, and rounds less than q itself
    change = cube * (10.0 + x * (6.0 * x - 15.0))
    first, last = x * rest * (1.0 + 3.0 * x), -cube * y * (1.0 + 3.0 * y)
    second, final = 0.5 * xx * rest, 0.5 * cube * yy
    a, b = path.a, path.b
    q = axpy4(a.q, change, difference4(b.q, a.q))
    q = axpy4(axpy4(q, first, a.dq), last, b.dq)
    q = axpy4(axpy4(q, second, path.first[0]), final, path.last[0])
    l = axpy(a.l, change, difference(b.l, a.l))
    l = axpy(axpy(l, first, a.dl), last, b.dl)
    l = axpy(axpy(l, second, path.first[1]), final, path.last[1])
    # The polynomial leaves the unit sphere by its error; one Newton step corrects this.
    return touch_up(q), l


inline_all(sys.modules[__name__])
