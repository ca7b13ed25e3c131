"""Classical Runge-Kutta."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from rigidmc.physics.dynamics.euler import angular_velocity, scaled
from rigidmc.physics.dynamics.so3 import (
    add,
    add4,
    add_compensated,
    add_compensated4,
    advance_attitude,
    axpy,
    axpy4,
    by_precision,
    concat,
    difference,
    difference4,
    divide_by_three,
    first_three,
    scale4,
    select,
    value_of,
)
from rigidmc.physics.effects.protocol import Effect, has_state
from rigidmc.physics.effects.sums import add_torques, add_work, state_rates
from rigidmc.physics.integrators.protocol import ONE_SUBSTEP, StepScheme
from rigidmc.physics.integrators.rk8 import linear_combination, rates_at_stage

_START = (0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0)


class RK4(NamedTuple):
    """Classical Runge-Kutta of order 4 on quaternion and L; the quaternion is normalised.

    For any torque; the cheapest step for moderate accuracy over short times. Energy and |L|^2 drift
    as h^5 t. Members that turn by more than 2 rad in a step are flagged, and some from 1 rad on,
    for the drift of their energy. Without checks most stay finite up to 5 rad but are wrong.
    Source: Kutta 1901; Hairer, Norsett & Wanner, Solving ODEs I, table II.1.2.
    """

    order = 4
    evaluations = 4
    is_reversible = False
    conserves = ()
    accepts = "any torque"
    compensated = True
    # [rad] in a step: error of 0.03 rad after a revolution (median of 100 bodies; largest 0.17); at
    # 4 rad in a step, 0.4 rad and 3 rad
    max_turn = 2.0

    def interleaving(self) -> int:
        return 2

    def scheme(self, effects: Sequence[Effect]) -> StepScheme:
        """Return the StepScheme of steps without remainders."""
        if any(map(has_state, effects)):
            return StepScheme(self, np.array(ONE_SUBSTEP))
        return StepScheme(ScaledRK4(), np.array([(1.0, 0.0, 0.0, 0.0), (1.0, 1.0, 0.0, 0.0)]))

    def step(self, body, effects, t, h, q, l):
        """Step pairs (value, remainder), or with states of effects, by the changes at the stages
        alone.

        Stages are rounded to the last digit of q, and so would be changes computed from stages.
        """
        # Stages start from the value without its remainder, below the last digit of a stage.
        start, rates = (value_of(q), value_of(l)), scaled(body, h)
        fixed = start, rates, effects, body, t, h
        k1 = state_rates(rates, effects, body, t, h, start[0], start[1])
        k2 = rates_at_stage(fixed, 0.5, (0.5,), (k1,))
        k3 = rates_at_stage(fixed, 0.5, (0.5,), (k2,))
        k4 = rates_at_stage(fixed, 1.0, (1.0,), (k3,))
        # Changes are summed from 0: added to q one by one, they would be rounded to its last digit.
        dq, dl = linear_combination(
            _START, (1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0), (k1, k2, k3, k4)
        )
        return add_compensated4(q, dq), add_compensated(l, dl)


class ScaledRK4(NamedTuple):
    """The compiled form of RK4: it keeps w = h omega/4 instead of L, and 3 q for a free body.

    A stage is q + x (0, w) in 12 multiply-adds, and 3 q(t + h) = x + 2 y + z - q + z (0, w), in
    fewer operations than with q and L. The norm of a free body's q is computed in parallel with the
    stages, from the start of the step: the step is linear in q.
    """

    def interleaving(self) -> int:
        return 2

    def with_compensation(self) -> RK4:
        """Return the integrator of steps with remainders."""
        return RK4()

    def to_stepping(self, body, effects, substep, q, l):
        x, y, z = quarters(body, substep[0])
        return to_norm_three(effects, q), concat((x * l[0], y * l[1], z * l[2]), l[3:])

    def from_stepping(self, body, effects, substep, q, l):
        return from_norm_three(effects, q), concat(momentum(body, substep[0], l), l[3:])

    def step(self, body, effects, t, h, q, l):
        works, l = l[3:], first_three(l)
        # The same in all steps: LLVM moves it out of the loop over steps.
        k = couplings(body)
        # Rates come before attitudes, and the last sums as late as they can: of the orders tried,
        # this one keeps the most numbers in registers (with gravity 6 % faster).
        wx = add_push(effects, body, t, h, 0.5, q, l, add_rate(k, l, l))
        x = advance_attitude(q, q, l)
        wy = add_push(effects, body, t + 0.5 * h, h, 0.5, x, wx, add_rate(k, l, wx))
        y = advance_attitude(q, x, wx)
        # 2 w by an addition, which is exact.
        double = add(wy, wy)
        wz = add_push(effects, body, t + 0.5 * h, h, 1.0, y, wy, add_twice_rate(k, l, wy, double))
        # w is summed from small differences, so conserved quantities are right to the last digit
        dw = axpy(add(difference(wx, l), difference(wz, l)), 2.0, difference(wy, l))
        z = advance_attitude(q, y, double)
        new = advance_attitude(axpy4(add4(difference4(x, q), z), 2.0, y), z, wz)
        dw = add_push(effects, body, t + h, h, 0.5, z, wz, add_rate(k, dw, wz))
        works = works_after_step(works, effects, body, t, h, (q, x, y, z), (l, wx, wy, wz))
        return keep_norm(effects, q, new), concat(axpy(l, 1.0 / 3.0, dw), works)


def works_after_step(works, effects, body, t, h, attitudes, rates):
    """Return the works of the effects after a step with these stages; () if none are saved."""
    if len(works) == 0:
        return ()
    (q, x, y, z), (w, wx, wy, wz), middle = attitudes, rates, t + 0.5 * h
    end, within = h * (1.0 / 6.0), h * (1.0 / 3.0)
    done = add_stage_work(works, effects, body, t, h, end, q, w)
    done = add_stage_work(done, effects, body, middle, h, within, x, wx)
    done = add_stage_work(done, effects, body, middle, h, within, y, wy)
    return add_stage_work(done, effects, body, t + h, h, end, z, wz)


def add_stage_work(works, effects, body, t, h, fraction, q, w):
    """Return the works, increased by the power at a stage times `fraction` [s]."""
    l = momentum(body, h, w)
    return add_work(effects, body, t, fraction, q, l, angular_velocity(body, l), works)


def momentum(body, h, w):
    """Return L for w = h omega/4."""
    x, y, z = quarters(body, h)
    # Multiply by reciprocals, which leave the loop over steps; divisions by x would stay in it.
    return (1.0 / x) * w[0], (1.0 / y) * w[1], (1.0 / z) * w[2]


def quarters(body, h):
    """Return h/4 times the reciprocal moments.

    A step back to an event may have length 0, where w would lose L. The step then lasts 1e-30 s
    (1e-20 s in float32), in which no body moves: internal units keep rates below 1e30/s, see
    `rigidmc.planning.unit_scale.RANGE`.
    """
    # seconds, see above
    h = select(h == 0.0, by_precision(h, 1e-30, 1e-20), h)
    return 0.25 * h * body.i1, 0.25 * h * body.i2, 0.25 * h * body.i3


def couplings(body):
    """Return k with h/2 dw_i/dt = k_i w_j w_k for a free body: 2 (I_j - I_k)/I_i.

    The order of the factors prevents overflow and underflow.
    """
    one, two, three = 1.0 / body.i1, 1.0 / body.i2, 1.0 / body.i3
    return (
        2.0 * (body.a1 * two) * (three * body.i1),
        2.0 * (body.a2 * three) * (one * body.i2),
        2.0 * (body.a3 * one) * (two * body.i3),
    )


def add_rate(k, onto, w):
    """Return onto + h/2 dw/dt for a free body."""
    return (
        onto[0] + k[0] * (w[1] * w[2]),
        onto[1] + k[1] * (w[2] * w[0]),
        onto[2] + k[2] * (w[0] * w[1]),
    )


def add_twice_rate(k, onto, w, double):
    """Return onto + h dw/dt for a free body, double = 2 w."""
    return (
        onto[0] + k[0] * (double[1] * w[2]),
        onto[1] + k[1] * (double[2] * w[0]),
        onto[2] + k[2] * (double[0] * w[1]),
    )


def add_push(effects, body, t, h, fraction, q, w, change):
    """Return change + fraction h dw/dt from the torques at (t, q, L)."""
    if len(effects) == 0:
        return change
    x, y, z = quarters(body, h)
    # w = h omega/4, so a torque counts with h/4 times the reciprocal moment.
    by = (fraction * h * x, fraction * h * y, fraction * h * z)
    return add_torques(effects, body, t, q, momentum(body, h, w), by, change)


def to_norm_three(effects, q):
    """Return 3 q for a free body, else q: torques need a unit quaternion."""
    if len(effects) == 0:
        return scale4(3.0, q)
    return q


def from_norm_three(effects, q):
    """Return the unit quaternion; undoes `to_norm_three`."""
    if len(effects) == 0:
        return divide_by_three(q)
    return q


def keep_norm(effects, q, new):
    """Return `new`, the attitude after a step from q, with the norm of q: 3 if free, else 1.

    For a free body it takes one Newton step: the error of a step in the norm, about
    ``(turn/2)^6/144`` of it, stays until the next step and does not accumulate. The direction of q
    does not depend on the norm.
    """
    # 1/sqrt(n) near n = 9 by one Newton step is (1/3) (3/2 - n/18), and `new` is 3 times too large
    if len(effects) == 0:
        return scale4(
            0.5 - (1.0 / 54.0) * (q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]), new
        )
    return divide_by_three(new)


INTEGRATORS = {"rk4": RK4()}
