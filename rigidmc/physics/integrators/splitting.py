"""Splittings: free motion ("drift") alternates with kicks L += h torque, which keep the attitude.

A kick depends on attitude and time alone and the kinetic energy is quadratic in L, so Runge-Kutta-
Nystroem coefficients and force gradients are allowed. All compositions are palindromes: symmetric
and, with the exact drift, symplectic to rounding. The error of the energy stays bounded, and under
gravity L_z is conserved. The last kick (or drift) of a step and the first of the next are merged:
between steps the state is kept just after the merged kick, and a partial step back gives the state
of the step's end.

The rows of `StepScheme.substeps` list the drifts and kicks in units of the step, so all
compositions (`rigidmc.physics.integrators.compositions`) share one compiled program for each type
of drift: the free motion over a time h, exact or by rotations.
"""

import math
from typing import Any, NamedTuple

from rigidmc.physics.dynamics.euler import angular_velocity
from rigidmc.physics.dynamics.free_flow import free_flow
from rigidmc.physics.dynamics.methods import OFF, Count, Flag, method, static_count
from rigidmc.physics.dynamics.rotation_flows import split_flow, symmetric_flow
from rigidmc.physics.dynamics.so3 import (
    add_compensated,
    apply_rotation,
    axpy,
    cross,
    difference,
    dot,
    first_three,
    scale,
    select,
    value_of,
)
from rigidmc.physics.effects.protocol import masked_effects
from rigidmc.physics.effects.sums import (
    kick_all,
    kick_all_back,
    kick_by_torques,
    shake_all,
    shake_scored,
    total_torque,
    total_torque_rate,
)
from rigidmc.physics.integrators.protocol import TurnBounds, from_stepping, to_stepping

_SCORES = static_count(7)


def drift_state(drift, body, h, q, l):
    """Return (q, L) after a drift over h."""
    rotation, change = flow(drift, body, h, first_three(value_of(l)))
    return apply_rotation(q, rotation), add_compensated(l, without_radial_part(l, change))


def without_radial_part(l, change):
    """Return the change of L, without its part along L if l is a pair (value, remainder).

    That part is 0 except for rounding: the constants of motion round the same way at every step, so
    |L| would grow in proportion to the number of steps. Without remainders the rounding of the
    state hides that growth.
    """
    if len(l) > 2:
        return change
    middle = axpy(value_of(l), 0.5, change)
    square = dot(middle, middle)
    # at rest L has no direction: the part along it is 0, whatever the divisor
    return axpy(change, -dot(middle, change) / select(square > 0.0, square, 1.0), middle)


class Splitting(NamedTuple):
    """One part of a step: drift, then kick.

    leads : ON if a step begins with a drift, OFF if with a kick
    """

    drift: Any
    leads: Flag = OFF

    def step(self, body, effects, t, substep, q, l):
        q, l = drift_state(self.drift, body, substep[0], q, l)
        return q, kick_by_torques(effects, body, t, substep[1], q, l)

    def to_stepping(self, body, effects, t, substep, q, l):
        if len(self.leads) > 0:
            q, l = drift_state(self.drift, body, substep[0], q, l)
        return q, kick_by_torques(effects, body, t, substep[1], q, l)

    def from_stepping(self, body, effects, t, substep, q, l):
        l = kick_by_torques(effects, body, t, -substep[1], q, l)
        if len(self.leads) > 0:
            q, l = drift_state(self.drift, body, -substep[0], q, l)
        return q, l


class Kicks(NamedTuple):
    """One part: kicks, drift, mirrored kicks. For torques with a flow of L, as in damping."""

    drift: Any

    def step(self, body, effects, t, h, substep, q, l):
        l = kick_all(effects, body, t, substep[1], q, l)
        q, l = drift_state(self.drift, body, substep[0], q, l)
        return q, kick_all_back(effects, body, t + h, substep[2], q, l)


def repeat_drift(count, drift, body, h, q, l):
    """Return (q, L) after one drift over h for each element of `count`."""
    if len(count) == 0:
        return q, l
    q, l = drift_state(drift, body, h, q, l)
    return repeat_drift(count[1:], drift, body, h, q, l)


def until_noise(langevin, body, effects, t, h, substep, q, l):
    """Return (q, L) after the part of a step before the noise: drifts, then flows of L."""
    q, l = repeat_drift(langevin.often, langevin.drift, body, substep[0], q, l)
    flows = masked_effects(effects, langevin.flows)
    return q, kick_all(flows, body, t - 0.5 * h, 0.5 * h, q, l)


def from_noise(langevin, body, effects, t, h, substep, q, l):
    """Return (q, L) after the part of a step after the noise, which mirrors `until_noise`; then a
    kick."""
    flows = masked_effects(effects, langevin.flows)
    l = kick_all_back(flows, body, t - 0.5 * h, 0.5 * h, q, l)
    q, l = repeat_drift(langevin.often, langevin.drift, body, substep[0], q, l)
    pushes = masked_effects(effects, langevin.pushes)
    return q, kick_by_torques(pushes, body, t, substep[1], q, l)


class Langevin(NamedTuple):
    """BAOAB: drifts over half a step, flows of L and noise over the step, drifts, a kick.

    often : one element for each drift within half a step
    pushes : for each effect ON if its torque depends on attitude and time alone
    flows : for each effect ON if it has its own flow of L
    """

    drift: Any
    often: Count = static_count(1)
    pushes: tuple[Flag, ...] = ()
    flows: tuple[Flag, ...] = ()

    def step(self, body, effects, t, h, substep, q, l):
        q, l = until_noise(self, body, effects, t, h, substep, q, l)
        return from_noise(self, body, effects, t, h, substep, q, shake_all(effects, body, h, l))

    def to_stepping(self, body, effects, t, substep, q, l):
        return q, kick_by_torques(masked_effects(effects, self.pushes), body, t, substep[1], q, l)

    def from_stepping(self, body, effects, t, substep, q, l):
        return q, kick_by_torques(masked_effects(effects, self.pushes), body, t, -substep[1], q, l)


class ScoredLangevin(NamedTuple):
    """BAOAB that also adds up the score of the noise, in the numbers after L.

    Everything else in a step is known from the state before, so the density of a motion is the
    product of the densities of L after the noise of each step, and its log a sum.
    """

    langevin: Langevin

    def extra_state(self):
        """Return the numbers after L: the most that a state has."""
        return _SCORES

    def step(self, body, effects, t, h, substep, q, l):
        q, before = until_noise(self.langevin, body, effects, t, h, substep, q, first_three(l))
        after, scores = shake_scored(effects, body, h, before, l[3:])
        q, after = from_noise(self.langevin, body, effects, t, h, substep, q, after)
        return q, after + scores

    def to_stepping(self, body, effects, t, substep, q, l):
        q, l = to_stepping(self.langevin, body, effects, t, substep, q, first_three(l))
        zero = 0.0 * l[0]
        return q, l + (zero, zero, zero, zero, zero, zero, zero)

    def from_stepping(self, body, effects, t, substep, q, l):
        return from_stepping(self.langevin, body, effects, t, substep, q, first_three(l))


class ForceGradient(NamedTuple):
    """One part: drift, then a kick by torque + gradient (D torque - torque x eta).

    eta = I^-1 torque, and D is the rate of change along eta. This is the commutator
    [kick, [kick, drift]], for any torque that depends on attitude and time.
    """

    drift: Any

    def step(self, body, effects, t, h, substep, q, l):
        q, l = drift_state(self.drift, body, substep[0], q, l)
        at = value_of(q)
        # One evaluation serves kick and gradient: with the rate of change, chin4 needs two torques
        # a step.
        torque = total_torque(effects, body, t, at, value_of(l))
        eta = angular_velocity(body, torque)
        more = difference(total_torque_rate(effects, body, t, at, eta), cross(torque, eta))
        return q, add_compensated(l, scale(substep[1], axpy(torque, h * substep[2], more)))

    def to_stepping(self, body, effects, t, substep, q, l):
        return q, kick_by_torques(effects, body, t, substep[1], q, l)

    def from_stepping(self, body, effects, t, substep, q, l):
        return q, kick_by_torques(effects, body, t, -substep[1], q, l)


# Angle lambda h of one panel [rad]. Errors: attitude 4.4e-16, momentum 1.4e-16 (25 random bodies
# against 40 digits).
PANEL_TURN = 0.125
SUBSTEP_TURN = 1.0  # [rad] longer drifts are cut: 8 panels compile in 2 s, and more are no faster


@method
def flow(drift, body, h, l):
    """Return (r, change of L) of the free motion over h, which takes the attitude from q to q r."""
    return (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0)


class Exact(NamedTuple):
    """The free motion of any body.

    The lengths of the tuples define how fine its quadrature is, see
    `rigidmc.physics.dynamics.free_flow`.
    """

    halvings: Count = static_count(0)
    panels: tuple[float, ...] = (1.0,)

    def flow(self, body, h, l):
        return free_flow(body, self.halvings, self.panels, h, l)


class Symmetric(NamedTuple):
    """The free motion of bodies with two equal moments: two rotations, exact for any h."""

    def flow(self, body, h, l):
        return symmetric_flow(body, h, l)


class Split(NamedTuple):
    """The free motion as four rotations: order 2; exact for bodies with two equal moments."""

    def flow(self, body, h, l):
        return split_flow(body, h, l)


def exact_drift(turns: TurnBounds, largest: float) -> Symmetric | Exact:
    """Return the exact drift for steps that turn by `turns`, at most SUBSTEP_TURN at a time.

    largest : the longest drift of a step, as a fraction of the step
    """
    if turns.symmetric:
        return Symmetric()
    # 1e-300 rad: a free rate of 0 has no logarithm
    angle = max(min(turns.free * largest, SUBSTEP_TURN), 1e-300)
    # 1e-9: an angle equal to PANEL_TURN except for rounding needs no further doubling.
    doublings = max(0, math.ceil(math.log2(angle / PANEL_TURN) - 1e-9))
    return Exact(static_count(doublings), (0.5**doublings,) * 2**doublings)


def substep_count(turns: TurnBounds, drift: float) -> int:
    """Return the number of substeps of a drift that keeps each turn within SUBSTEP_TURN.

    drift : length of the drift, as a fraction of the step
    """
    return (
        1 if turns.symmetric else max(1, math.ceil(abs(drift) * turns.free / SUBSTEP_TURN - 1e-9))
    )
