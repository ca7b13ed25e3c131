"""Extrapolation of the midpoint rule to order 12."""

from fractions import Fraction
from typing import NamedTuple

from rigidmc.physics.dynamics.euler import angular_velocity
from rigidmc.physics.dynamics.methods import static_count
from rigidmc.physics.dynamics.so3 import (
    add,
    add4,
    add_compensated,
    add_compensated4,
    advance_attitude,
    axpy,
    axpy4,
    concat,
    first_three,
    scale,
    scale4,
    value_of,
)
from rigidmc.physics.effects.sums import add_slip, add_work, pay_for_slip
from rigidmc.physics.integrators.rk4 import add_push, add_rate, couplings, momentum, quarters

# Substeps of the midpoint rule in each sequence. Up to 12 the method needs 4 % fewer operations,
# but its rounding is four times as large: the weights below add up to 26 in size, not to 13.
SUBSTEPS = (2, 4, 6, 8, 10, 14)


def weights(substeps, power):
    """Return the weight of each sequence of the extrapolation to substeps of length 0.

        prod_m n^2/(n^2 - m^2), times (n/2)^(power - 1)

    Sequence n makes n/2 changes with a rate times (2/n)^power. Rounded factors 2/n and weights
    would make each step 1e-15 too long or too short; the smallest weight is changed so that a
    constant rate is integrated exactly.
    """
    exact = [Fraction(n, 2) ** (power - 1) for n in substeps]
    for i, n in enumerate(substeps):
        for m in substeps[:i] + substeps[i + 1 :]:
            exact[i] *= Fraction(n * n, n * n - m * m)
    rounded = [float(weight) for weight in exact]
    changes = [Fraction(2.0 / n) ** power * Fraction(n, 2) for n in substeps]
    others = sum(Fraction(w) * c for w, c in zip(rounded[1:], changes[1:], strict=True))
    rounded[0] = float((1 - others) / changes[0])
    return tuple(rounded)


_B = weights(SUBSTEPS, 1)
_C = weights(SUBSTEPS, 2)
_PAIRS = static_count(6)


def add_change(effects, body, k, t, span, start, onto, at):
    """Return onto + span (rate at start + at), for changes (dq, du) since the start of a step.

    u = span omega/2, half the rotation vector over a span;  k : see `couplings`
    Works follow the three components of du.
    """
    q, u = add4(start[0], at[0]), add(start[1], first_three(at[1]))
    l = momentum(body, 2.0 * span, u)
    half = add_slip(effects, body, t, span, q, l, u)
    du = add_push(
        effects, body, t, 2.0 * span, 0.5, q, u, add_rate(k, first_three(onto[1]), u)
    )
    works = work_change(effects, body, t, span, q, l, onto[1][3:])
    return advance_attitude(onto[0], q, half), concat(du, works)


def work_change(effects, body, t, h, q, l, works):
    """Return the works of the effects, increased by their power times h; () if none are saved."""
    if len(works) == 0:
        return ()
    w = add_slip(effects, body, t, 2.0, q, l, angular_velocity(body, l))
    done = add_work(effects, body, t, h, q, l, w, works)
    return pay_for_slip(effects, effects, body, t, h, q, l, done)


def leapfrog(pairs, effects, body, k, t, span, start, even, odd):
    """Return the change at the last even substep; odd substeps are half a span later than even.

    One element of `pairs` for every further pair of substeps.
    """
    even = add_change(effects, body, k, t + 0.5 * span, span, start, even, odd)
    if len(pairs) == 0:
        return even
    odd = add_change(effects, body, k, t + span, span, start, odd, even)
    return leapfrog(pairs[1:], effects, body, k, t + span, span, start, even, odd)


def midpoint_change(pairs, inverse, effects, body, k, t, h, start, rate, zero):
    """Return the change over h by the midpoint rule in 2/inverse substeps.

    start : (q, u) with u over h;  rate : the change over h at the rate of the start
    """
    begin = start[0], scale(inverse, start[1])
    # Half a span by Euler's rule: errors then have even powers of the span alone.
    odd = (
        scale4(0.5 * inverse, rate[0]),
        concat(
            scale(0.5 * inverse * inverse, first_three(rate[1])),
            scale_each(0.5 * inverse, rate[1][3:]),
        ),
    )
    return leapfrog(pairs, effects, body, k, t, inverse * h, begin, zero, odd)


def scale_each(a, numbers):
    """Return a times each number of a tuple of any length."""
    if len(numbers) == 0:
        return ()
    return (a * numbers[0],) + scale_each(a, numbers[1:])


def add_each(a, numbers, onto):
    """Return onto + a numbers, for tuples of any length."""
    if len(numbers) == 0:
        return ()
    return (onto[0] + a * numbers[0],) + add_each(a, numbers[1:], onto[1:])


def weighted(b, c, changes, onto):
    """Return onto plus the changes: of q and works times b, of u times c."""
    if len(changes) == 0:
        return onto
    dq, du = changes[0]
    new = (
        axpy4(onto[0], b[0], dq),
        concat(
            axpy(first_three(onto[1]), c[0], first_three(du)), add_each(b[0], du[3:], onto[1][3:])
        ),
    )
    return weighted(b[1:], c[1:], changes[1:], new)


class GBS12(NamedTuple):
    """Extrapolation to order 12 of the midpoint rule in 2, 4, 6, 8, 10 and 14 substeps.

    For any torque. The cheapest integrator for errors of 1e-9 and less, with steps of about 1 rad.
    The quaternion is normalised; energy and |L|^2 drift as h^13 t.
    Source: Gragg 1965; Hairer, Norsett & Wanner, Solving ODEs I (1993), II.9, without the
    smoothing step.
    """

    order = 12
    slips = True
    evaluations = 39
    is_reversible = False
    conserves = ()
    accepts = "any torque"
    compensated = True

    def step(self, body, effects, t, h, q, l):
        at, now = value_of(q), value_of(l)
        x, y, z = quarters(body, 2.0 * h)
        u, k = (x * now[0], y * now[1], z * now[2]), couplings(body)
        zero = (0.0, 0.0, 0.0, 0.0), concat((0.0, 0.0, 0.0), scale_each(0.0, now[3:]))
        start = at, u
        rate = add_change(effects, body, k, t, h, start, zero, zero)
        two = midpoint_change(_PAIRS[:0], 1.0, effects, body, k, t, h, start, rate, zero)
        four = midpoint_change(_PAIRS[:1], 0.5, effects, body, k, t, h, start, rate, zero)
        six = midpoint_change(_PAIRS[:2], 1.0 / 3.0, effects, body, k, t, h, start, rate, zero)
        eight = midpoint_change(_PAIRS[:3], 0.25, effects, body, k, t, h, start, rate, zero)
        ten = midpoint_change(_PAIRS[:4], 0.2, effects, body, k, t, h, start, rate, zero)
        last = midpoint_change(_PAIRS[:6], 1.0 / 7.0, effects, body, k, t, h, start, rate, zero)
        # Changes are summed from the smallest weight to the largest.
        dq, du = weighted(_B, _C, (two, four, six, eight, ten, last), zero)
        dl = concat(momentum(body, 2.0 * h, du), du[3:])
        return add_compensated4(q, dq), add_compensated(l, dl)


INTEGRATORS = {"gbs12": GBS12()}
