"""Splittings: free motion ("drift") alternates with kicks L += h torque, which keep the attitude.

A kick depends on attitude and time alone and the kinetic energy is quadratic in L, so that Runge-Kutta-Nystroem coefficients and
force gradients are allowed. All compositions are palindromes: symmetric and, with the exact drift, symplectic to rounding; energy
errors stay bounded for ever, and L_z is kept under gravity. The last kick (or drift) of a step is one with the first of the next:
between steps the state is kept just after that first one, and looked at by a step back.

The free motion is kept in units of the step by `parts`; all compositions share one compiled kernel for each kind of drift.
"""

from typing import Any, NamedTuple

from rigidmc.dynamics.euler import angular_velocity
from rigidmc.dynamics.so3 import (
    axpy,
    cross,
    difference,
    dot,
    first_three,
    gain,
    moved,
    scale,
    select,
    whole,
)
from rigidmc.effects.protocol import chosen
from rigidmc.effects.sums import (
    kick_all,
    kick_all_back,
    kicked,
    shake_all,
    total_torque,
    total_torque_rate,
)
from rigidmc.integrators.drifts import flow


def drifted(drift, body, h, q, l):
    """(q, L) after a drift over h."""
    turn, change = flow(drift, body, h, first_three(whole(l)))
    return moved(q, turn), gain(l, levelled(l, change))


def levelled(l, change):
    """Of a pair (value, remainder) a change without its part along L, 0 but for rounding: the constants of motion are rounded alike at
    every step, which lengthens L by up to 3e-19 of it each time; what the state's own rounding hides for 1e5 steps is all that is left here.
    """
    if len(l) > 2:
        return change
    middle = axpy(whole(l), 0.5, change)
    square = dot(middle, middle)
    return axpy(change, -dot(middle, change) / select(square > 0.0, square, 1.0), middle)


class Splitting(NamedTuple):
    """A part: drift, then kick. leads: () where steps begin with a kick, (0.0,) where with a drift."""

    drift: Any
    leads: tuple = ()

    def step(self, body, effects, t, part, q, l):
        q, l = drifted(self.drift, body, part[0], q, l)
        return q, kicked(effects, body, t, part[1], q, l)

    def opened(self, body, effects, t, part, q, l):
        if len(self.leads) > 0:
            q, l = drifted(self.drift, body, part[0], q, l)
        return q, kicked(effects, body, t, part[1], q, l)

    def closed(self, body, effects, t, part, q, l):
        l = kicked(effects, body, t, -part[1], q, l)
        if len(self.leads) > 0:
            q, l = drifted(self.drift, body, -part[0], q, l)
        return q, l


class Kicks(NamedTuple):
    """A part: kicks at the start of the step, drift, kicks at its end in mirror image, for torques with their own flow of L (damping)."""

    drift: Any

    def step(self, body, effects, t, h, part, q, l):
        l = kick_all(effects, body, t, part[1], q, l)
        q, l = drifted(self.drift, body, part[0], q, l)
        return q, kick_all_back(effects, body, t + h, part[2], q, l)


def drifted_often(often, drift, body, h, q, l):
    """(q, L) after as many drifts over h as a tuple is long."""
    if len(often) == 0:
        return q, l
    q, l = drifted(drift, body, h, q, l)
    return drifted_often(often[1:], drift, body, h, q, l)


class Langevin(NamedTuple):
    """BAOAB: drifts over half a step, flows of L and noise over all of it, drifts, then a kick by the torques of attitude and time.

    often : as long as half a step has drifts
    pushes, flows : for each effect (0.0,) where it is a torque of attitude and time, or has a flow of L of its own; else ()
    """

    drift: Any
    often: tuple = (0.0,)
    pushes: tuple = ()
    flows: tuple = ()

    def step(self, body, effects, t, h, part, q, l):
        q, l = drifted_often(self.often, self.drift, body, part[0], q, l)
        flows, middle = chosen(effects, self.flows), t - 0.5 * h
        l = kick_all(flows, body, middle, 0.5 * h, q, l)
        l = shake_all(effects, body, h, l)
        l = kick_all_back(flows, body, middle, 0.5 * h, q, l)
        q, l = drifted_often(self.often, self.drift, body, part[0], q, l)
        return q, kicked(chosen(effects, self.pushes), body, t, part[1], q, l)

    def opened(self, body, effects, t, part, q, l):
        return q, kicked(chosen(effects, self.pushes), body, t, part[1], q, l)

    def closed(self, body, effects, t, part, q, l):
        return q, kicked(chosen(effects, self.pushes), body, t, -part[1], q, l)


class ForceGradient(NamedTuple):
    """A part: drift, then a kick by torque + gradient (D torque - torque x eta), eta = I^-1 torque and D the rate along eta.

    That is the commutator [kick, [kick, drift]], for any torque that depends on attitude and time.
    """

    drift: Any

    def step(self, body, effects, t, h, part, q, l):
        q, l = drifted(self.drift, body, part[0], q, l)
        at = whole(q)
        torque = total_torque(effects, body, t, at, whole(l))
        eta = angular_velocity(body, torque)
        more = difference(total_torque_rate(effects, body, t, at, eta), cross(torque, eta))
        return q, gain(l, scale(part[1], axpy(torque, h * part[2], more)))

    def opened(self, body, effects, t, part, q, l):
        return q, kicked(effects, body, t, part[1], q, l)

    def closed(self, body, effects, t, part, q, l):
        return q, kicked(effects, body, t, -part[1], q, l)
