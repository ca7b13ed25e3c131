"""The implicit midpoint rule."""

import math
from typing import NamedTuple

import numpy as np

from rigidmc.physics.dynamics.euler import add_free_change, half_rotation, scaled
from rigidmc.physics.dynamics.methods import Count, static_count
from rigidmc.physics.dynamics.so3 import (
    add_compensated,
    add_compensated4,
    advance_attitude,
    scale,
    scale4,
    spin,
    value_of,
)
from rigidmc.physics.effects.sums import push
from rigidmc.physics.integrators.protocol import ONE_SUBSTEP, StepScheme, TurnBounds


def _iterate(half, effects, body, t, h, q, l, at, now):
    """Make one fixed-point iteration for the middle (at, now) of a step from (q, L)."""
    now = push(effects, body, t, h, at, now, add_free_change(half, l, now))
    return advance_attitude(q, at, half_rotation(half, now)), now


def _iterate_four(half, effects, body, t, h, q, l, at, now):
    """Make four iterations."""
    at, now = _iterate(half, effects, body, t, h, q, l, at, now)
    at, now = _iterate(half, effects, body, t, h, q, l, at, now)
    at, now = _iterate(half, effects, body, t, h, q, l, at, now)
    return _iterate(half, effects, body, t, h, q, l, at, now)


def _solve_stage(count, half, effects, body, t, h, q, l, at, now):
    """Find the middle of a step by iterations, eight for each element of `count`."""
    # Numba compiles one function per tuple length, so each element stands for eight iterations, in
    # two calls of four.
    if len(count) == 0:
        return at, now
    at, now = _iterate_four(half, effects, body, t, h, q, l, at, now)
    at, now = _iterate_four(half, effects, body, t, h, q, l, at, now)
    return _solve_stage(count[1:], half, effects, body, t, h, q, l, at, now)


class Midpoint(NamedTuple):
    """Implicit midpoint rule on quaternion and L: order 2, conserves all quadratic invariants.

    For any torque; the only integrator that conserves the energy of a heavy top exactly. It is not
    symplectic in these variables and does not conserve L_z. The number of iterations is fixed for a
    run and solves the stage to rounding: 8 up to 0.0135 rad a step, 32 up to 0.5 rad, the largest
    step; each needs a torque, and the step one more.
    Source: Hairer, Lubich & Wanner, Geometric Numerical Integration (2006), IV.2.1.
    """

    eights: Count = static_count(2)

    order = 2
    is_reversible = True
    conserves = ("|q|", "|L|^2", "T")
    accepts = "any torque"
    compensated = True
    is_contender = False
    max_spin = 0.5  # [rad] in a step, for 32 iterations; 64 would compile for 20 s
    min_spin = 0.0135  # [rad] in a step, up to which 8 iterations are enough

    @property
    def evaluations(self) -> int:
        """Torques per step: one for each iteration, and the last."""
        return 8 * len(self.eights) + 1

    def scheme(self, turns: TurnBounds) -> StepScheme:
        """Return the StepScheme for steps that turn by `turns`."""
        # Each iteration multiplies the error by |omega| h/2, down to 1e-17. The count is 8, 16 or
        # 32, to compile few kernels.
        rate = max(0.55 * turns.spin, 1e-3)
        count = math.log(1e-17) / math.log(min(rate, 0.66)) / 8.0
        doublings = max(0, math.ceil(math.log2(count)))
        return StepScheme(Midpoint(static_count(2**doublings)), np.array(ONE_SUBSTEP))

    def step(self, body, effects, t, h, q, l):
        at, now = value_of(q), value_of(l)
        half = scaled(body, 0.5 * h)
        middle, spun_up = _solve_stage(
            self.eights, half, effects, body, t + 0.5 * h, 0.5 * h, at, now, at, now
        )
        dl = add_free_change(half, (0.0, 0.0, 0.0), spun_up)
        dl = push(effects, body, t + 0.5 * h, 0.5 * h, middle, spun_up, dl)
        dq = scale4(2.0, spin(middle, half_rotation(half, spun_up)))
        return add_compensated4(q, dq), add_compensated(l, scale(2.0, dl))


INTEGRATORS = {"midpoint": Midpoint()}
