"""Extrapolation of the midpoint rule to order 12."""

from fractions import Fraction
from typing import NamedTuple

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
    left_after,
    rest_axpy,
    scale,
    scale4,
    scale_rest,
    taken,
    value_of,
)
from rigidmc.physics.effects.present import in_state, states_of
from rigidmc.physics.effects.sums import add_slip, push_works, state_rates_of
from rigidmc.physics.integrators.rk4 import add_push, add_rate, couplings, momentum, quarters

# Substeps of the midpoint rule in each sequence. With 12 in the last a step needs 5 % fewer
# operations, but the weights below add up to 26 in size, not to 13, and rounding with them.
SUBSTEPS = (2, 4, 6, 8, 10, 14)
_SPANS = tuple(2.0 / n for n in SUBSTEPS)  # twice a substep, in steps
_PAIRS = static_count(6)  # of substeps that follow the first, in the last sequence


def weights(substeps, power):
    """Return the weight of the change in each sequence, for the limit of short substeps.

        w_n = prod_m n^2/(n^2 - m^2), times (n/2)^(power - 1)

    Sequence n sums n/2 changes of size (2/n)^power. Rounded weights and rounded 2/n would make each
    step too long by 1e-15 of itself (tests/physics/integrators/test_gbs12.py); the first weight,
    the smallest, corrects that.
    """
    exact = [Fraction(n, 2) ** (power - 1) for n in substeps]
    for i, n in enumerate(substeps):
        for m in substeps[:i] + substeps[i + 1 :]:
            exact[i] *= Fraction(n * n, n * n - m * m)
    rounded = [float(weight) for weight in exact]
    lengths = [Fraction(2.0 / n) ** power * Fraction(n, 2) for n in substeps]
    others = sum(Fraction(w) * x for w, x in zip(rounded[1:], lengths[1:], strict=True))
    rounded[0] = float((1 - others) / lengths[0])
    return tuple(rounded)


_B = weights(SUBSTEPS, 1)  # of q, states and works
_C = weights(SUBSTEPS, 2)  # of u, which is itself proportional to a substep


def add_change(effects, body, k, t, span, start, onto, at):
    """Return onto + span times the rate in the state start + at.

    States are (q, u) with u = span omega/2, half the rotation vector over a span; onto and at are
    changes since the start of a step. States of effects and works follow u.
    k : see `couplings`
    """
    q, now, more = add4(start[0], at[0]), add(start[1], at[1]), onto[1][3:]
    u, states, present = first_three(now), states_of(effects), in_state(effects, now[3:])
    l = momentum(body, 2.0 * span, u)
    half = add_slip(present, body, t, span, q, l, u)
    du = add_push(present, body, t, 2.0 * span, 0.5, q, u, add_rate(k, first_three(onto[1]), u))
    moved = rest_axpy(taken(states, more), span, state_rates_of(present, body, t, q, l))
    saved, works = left_after(states, now[3:]), left_after(states, more)
    works = push_works(saved, present, body, t, span, q, l, works)
    return advance_attitude(onto[0], q, half), concat(concat(du, moved), works)


def leapfrog(pairs, effects, body, k, t, span, start, even, odd):
    """Return the change after the last substep, from those after the last two.

    even, odd : at t, and half a span later;  pairs : one element for each pair of substeps to
        come after the next one
    """
    even = add_change(effects, body, k, t + 0.5 * span, span, start, even, odd)
    if len(pairs) == 0:
        return even
    odd = add_change(effects, body, k, t + span, span, start, odd, even)
    return leapfrog(pairs[1:], effects, body, k, t + span, span, start, even, odd)


def midpoint_change(pairs, part, given, zero):
    """Return the change over a step h by the midpoint rule with spans of `part` h.

    given : (effects, body, k, t, h, (q, u) with u over h, change over h at the rate of the start)
    """
    effects, body, k, t, h, start, rate = given
    # The first substep is Euler's: the error then has even powers of the substep only.
    euler = 0.5 * part
    odd = (
        scale4(euler, rate[0]),
        concat(scale(part * euler, first_three(rate[1])), scale_rest(euler, rate[1][3:])),
    )
    within = start[0], concat(scale(part, first_three(start[1])), start[1][3:])
    return leapfrog(pairs, effects, body, k, t, part * h, within, zero, odd)


def extrapolate(b, c, changes, onto):
    """Return onto plus all changes; b weights q, states and works, c weights u."""
    if len(changes) == 0:
        return onto
    dq, du = changes[0]
    u = axpy(first_three(onto[1]), c[0], first_three(du))
    new = axpy4(onto[0], b[0], dq), concat(u, rest_axpy(onto[1][3:], b[0], du[3:]))
    return extrapolate(b[1:], c[1:], changes[1:], new)


class GBS12(NamedTuple):
    """Extrapolation to order 12 of the midpoint rule in 2, 4, 6, 8, 10 and 14 substeps.

    For any torque. The cheapest integrator for errors of 1e-8 and less (`python -m bench orders`),
    in steps of 0.5 to 1.5 rad. The quaternion is normalised; energy and |L|^2 drift as h^13 t.
    Source: Gragg 1965, Bulirsch & Stoer 1966; Hairer, Norsett & Wanner, Solving ODEs I (1993),
    II.9, without the smoothing step.
    """

    order = 12
    slips = True
    has_many_stages = True
    # its cost is 1.05 times that of rk8 at a tolerance of 1e-7 (4,096 heavy tops to 10 s), 0.87 at
    # 1e-8, 0.75 at 1e-10 and 0.61 at 1e-12
    max_tolerance = 2e-8
    drifts_like = "rk8"
    evaluations = 39
    is_reversible = False
    conserves = ()
    accepts = "any torque"
    compensated = True

    def interleaving(self) -> int:
        return 2

    def step(self, body, effects, t, h, q, l):
        x, y, z = quarters(body, 2.0 * h)
        at, now, k = value_of(q), value_of(l), couplings(body)
        start = at, concat((x * now[0], y * now[1], z * now[2]), now[3:])
        # Sums of changes alone: sums onto q would be rounded to its last digit 39 times a step, and
        # the weights, up to 6, would multiply that.
        zero = (0.0, 0.0, 0.0, 0.0), concat((0.0, 0.0, 0.0), scale_rest(0.0, now[3:]))
        given = effects, body, k, t, h, start, add_change(effects, body, k, t, h, start, zero, zero)
        changes = (
            midpoint_change(_PAIRS[:0], _SPANS[0], given, zero),
            midpoint_change(_PAIRS[:1], _SPANS[1], given, zero),
            midpoint_change(_PAIRS[:2], _SPANS[2], given, zero),
            midpoint_change(_PAIRS[:3], _SPANS[3], given, zero),
            midpoint_change(_PAIRS[:4], _SPANS[4], given, zero),
            midpoint_change(_PAIRS[:6], _SPANS[5], given, zero),
        )
        dq, du = extrapolate(_B, _C, changes, zero)
        dl = concat(momentum(body, 2.0 * h, du), du[3:])
        return add_compensated4(q, dq), add_compensated(l, dl)


INTEGRATORS = {"gbs12": GBS12()}
