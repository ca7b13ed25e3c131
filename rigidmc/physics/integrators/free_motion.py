"""The motion of a free body in equal steps, which share almost all computations."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rigidmc.physics.dynamics.free_flow import (
    end_correction,
    integrate_phase,
    make_flow,
    momentum_change,
    phase,
    phase_fraction,
    pull_back,
    return_factors,
    slopes,
    to_body_axes,
    turn_between,
)
from rigidmc.physics.dynamics.methods import static_count
from rigidmc.physics.dynamics.so3 import (
    add,
    apply_rotation,
    difference,
    first_three,
    nearest_integer,
    scale,
    two_sum,
)
from rigidmc.physics.integrators.protocol import StepScheme, TurnBounds
from rigidmc.physics.integrators.splitting import (
    Exact,
    Splitting,
    Symmetric,
    exact_drift,
    substep_count,
)

_KEPT = static_count(7)


class FreeSteps(NamedTuple):
    """The exact free motion in equal steps.

    The state between steps is the start and the progress since then: the unit momentum, and the
    phase in periods with its remainder. The attitude is computed only for saves and checks. A step
    adds one increment to the momentum and one to the phase: a third of the operations of
    `rigidmc.physics.dynamics.free_flow.free_flow`. Rounding of attitude, energy and |L| does not
    accumulate; the remaining error comes from the constants, up to 2e-17 of L a step (16 tops, 2e6
    steps of 0.05 s: 4e-11; tests/physics/integrators/test_precision.py).
    """

    drift: Exact

    def extra_state(self):
        """Return the size of the start's attitude and momentum."""
        return _KEPT

    def precompute(self, body, substep, l):
        m, _ = make_flow(body, self.drift.halvings, self.drift.panels, substep[0], l[7:])
        return m, slopes(m.whole), slopes(m.panel), return_factors(m)

    def step(self, body, substep, constants, q, l):
        m, of_step, of_panel, shares = constants
        u = first_three(l)
        integral, _ = integrate_phase(m, self.drift.panels, u, phase_fraction(m, u), of_panel)
        # The phase in turns as a compensated sum: all steps add nearly the same number and would
        # round the same way.
        turns, rest = two_sum(q[0], (0.25 / math.pi) * phase(m, m.time, integral) + q[1])
        end = add(u, momentum_change(m, self.drift.halvings, u, of_step))
        # Drop whole turns: the attitude does not depend on them, and the fraction keeps its digits.
        end = unit_momentum_after(body, substep[0], l[7:], u, pull_back(m, shares, u, end))
        return (turns - nearest_integer(turns), rest, q[2], q[3]), end + l[3:]

    def to_stepping(self, body, substep, q, l):
        _, u = make_flow(body, self.drift.halvings, self.drift.panels, substep[0], l)
        zero = 0.0 * l[0]
        return (zero, zero, zero, zero), u + q + l

    def from_stepping(self, body, substep, q, l):
        m, start = make_flow(body, self.drift.halvings, self.drift.panels, substep[0], l[7:])
        u = first_three(l)
        one, two = phase_fraction(m, start), phase_fraction(m, u)
        angle = (2.0 * math.pi) * (q[0] + q[1]) + 0.5 * phase(
            m, 0.0, end_correction(m, self.drift.panels, one, two)
        )
        turn = turn_between(m, start, difference(u, start), angle, one, two)
        turn, momentum = turn_and_momentum(l[7:], u, turn, scale(m.size, to_body_axes(m, u)))
        return apply_rotation(l[3:7], turn), momentum


def unit_momentum_after(body, h, l, u, end):
    """Return the unit momentum `end` after a step h from u; l : L at the start.

    At rest, where u has no direction, its derivatives are the rotation vector's since the
    start: a rule of `rigidmc.engine.compiler.derivatives`.
    """
    return end


def turn_and_momentum(l, u, turn, momentum):
    """Return (turn since the start, L now); at rest with the derivatives of u, see
    `unit_momentum_after`.

    l, u : L at the start, and the unit momentum now
    """
    return turn, momentum


@dataclass(frozen=True)
class FreeMotion:
    """The closed-form motion of a free body: any step, no error but rounding. Rejects torques.

    Energy and |L|^2 stay constant to the last digit for any number of steps; with two equal
    moments their rounding errors form a random walk. `compensated` matters only for these bodies:
    the steps of all others keep the remainder of the phase and return to T and |L|^2. Long steps
    are cut into pieces that turn by at most 1 rad; bodies with two equal moments need no cut.
    Source: Celledoni, Fasso, Saefstroem & Zanna, SIAM J. Sci. Comput. 30 (2008) 2084; see
    `rigidmc.physics.dynamics.free_flow`.
    """

    order = float("inf")
    evaluations = 0
    is_reversible = True
    compensated = True
    conserves = ("|q|", "|L|^2", "T", "L in space")
    accepts = "no torque"
    drifts_like = "closed"

    def scheme(self, turns: TurnBounds) -> StepScheme:
        """Return the StepScheme for steps that turn by `turns`."""
        n, drift = substep_count(turns, 1.0), exact_drift(turns, 1.0)
        steps = Splitting(drift) if isinstance(drift, Symmetric) else FreeSteps(drift)
        # row 0, which opens a state, has the length of the others
        return StepScheme(steps, np.array([(1.0 / n, 0.0, 0.0, 0.0)] * (n + 1)))


INTEGRATORS = {"exact": FreeMotion()}
