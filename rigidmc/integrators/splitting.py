"""Splittings: free motion ("drift") alternates with kicks L += h torque, which keep the attitude.

A kick depends on attitude and time alone and the kinetic energy is quadratic in L, so that Runge-Kutta-Nystroem coefficients and
force gradients are allowed. All compositions are palindromes: symmetric and, with the exact drift, symplectic to rounding; energy
errors stay bounded for ever, and L_z is kept under gravity. The last kick (or drift) of a step is one with the first of the next:
between steps the state is kept just after that first one, and looked at by a step back.

The free motion is kept in units of the step by `parts`; all compositions share one compiled kernel for each kind of drift.
"""

from dataclasses import dataclass
from itertools import accumulate
from typing import Any, NamedTuple

import numpy as np

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
from rigidmc.effects.protocol import chosen, depends_on_momentum, is_random
from rigidmc.effects.sums import (
    kick_all,
    kick_all_back,
    kicked,
    shake_all,
    total_torque,
    total_torque_rate,
)
from rigidmc.integrators.drifts import Split, exact_drift, flow, pieces
from rigidmc.integrators.form import ONE, Form


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


@dataclass(frozen=True)
class Composition:
    """A palindrome of drifts and kicks.

    kicks, drifts : first half of the coefficients, the middle one included, in units of the step
    drift_first : whether a step begins with a drift
    gradient : coefficient of h^2 of the force gradient, in the middle kick
    text : what it is for, with source
    """

    text: str
    order: int
    drifts: tuple
    kicks: tuple
    drift_first: bool = False
    gradient: float = 0.0
    split: bool = False  # by turns about axes in place of the exact drift
    reversible: bool = True
    compensated: bool = True

    @property
    def conserves(self):
        """What it keeps of a free body to rounding."""
        return ("|q|", "|L|^2", "L in space") if self.split else ("|q|", "|L|^2", "T", "L in space")

    @property
    def accepts(self):
        """Which torques it takes."""
        if self.gradient:
            return "torques of attitude and time with a gradient"
        return "torques with an exact flow" if self.order == 2 else "torques of attitude and time"

    def sequence(self):
        """((drifts), (kicks)) in full, one of them one longer than the other."""
        longer, shorter = (
            (self.drifts, self.kicks) if self.drift_first else (self.kicks, self.drifts)
        )
        middle_is_longer = len(longer) > len(shorter)
        longer = (*longer, *longer[-2 if middle_is_longer else -1 :: -1])
        shorter = (*shorter, *shorter[-1 if middle_is_longer else -2 :: -1])
        return (longer, shorter) if self.drift_first else (shorter, longer)

    @property
    def evaluations(self):
        """Torques per step, the last one of a step being the first of the next."""
        drifts, kicks = self.sequence()
        return min(len(drifts), len(kicks))

    def prepared(self, turns, effects):
        """The Form for steps of `turns`."""
        drifts, kicks = self.sequence()
        if self.drift_first:
            lead, drifts, kicks = (
                (drifts[0], kicks[0]),
                [*drifts[1:-1], drifts[-1] + drifts[0]],
                [*kicks[1:], kicks[0]],
            )
        else:
            lead, drifts, kicks = (0.0, kicks[0]), drifts, [*kicks[1:-1], kicks[-1] + kicks[0]]
        largest = max(abs(a) for a in drifts)
        if any(is_random(e) for e in effects):
            return self._noisy(turns, effects)
        drift = Split() if self.split else exact_drift(turns, largest)
        if any(depends_on_momentum(e) for e in effects):
            n = 1 if self.split else pieces(turns, 1.0)
            rows = [(1.0 / n, 0.5 * (k == 0), 0.5 * (k == n - 1), 0.0) for k in range(n)]
            return Form(Kicks(drift), np.array([ONE[0], *rows]))
        rows = [(*lead, 0.0, lead[0])]
        for i, (a, b, time) in enumerate(
            zip(drifts, kicks, accumulate(drifts, initial=lead[0]), strict=False)
        ):
            n = 1 if self.split else pieces(turns, a)
            rows += [(a / n, 0.0, 0.0, time + a * k / n) for k in range(1, n)]
            middle = self.gradient if 2 * (i + 1) == len(drifts) else 0.0
            rows.append((a / n, b, middle, time + a))
        kind = (
            ForceGradient(drift)
            if self.gradient
            else Splitting(drift, (0.0,) if self.drift_first else ())
        )
        return Form(kind, np.array(rows))

    def _noisy(self, turns, effects):
        """BAOAB: half a kick, half a drift, flows and noise, half a drift, half a kick; the halves of two steps are one kick."""
        drift = Split() if self.split else exact_drift(turns, 0.5)
        n = 1 if self.split else pieces(turns, 0.5)
        rows = [(0.0, 0.5, 0.0, 0.0), (0.5 / n, 1.0, 0.0, 1.0)]
        pushes = tuple(() if depends_on_momentum(e) or is_random(e) else (0.0,) for e in effects)
        flows = tuple((0.0,) if depends_on_momentum(e) else () for e in effects)
        return Form(Langevin(drift, (0.0,) * n, pushes, flows), np.array(rows))


_THIRD = 1.0 / (4.0 - 4.0 ** (1.0 / 3.0))

STRANG = Composition(
    """Kick, exact free motion, kick: order 2, for fast tops over long times and for damping.

    Source: Strang, SIAM J. Numer. Anal. 5 (1968) 506; Celledoni et al., SIAM J. Sci. Comput. 30 (2008) 2084, section 4.""",
    order=2, kicks=(0.5,), drifts=(1.0,),
)  # fmt: skip
ROTATIONS = Composition(
    """As strang, with the free motion split into four turns: order 2, cheap, for moderate accuracy over long times.

    One turn about L takes the middle moment out, so that it is exact for bodies with two equal moments; the plain splitting into turns
    about three axes is not. Energy is bounded, not kept, even of a free body.
    Source: McLachlan, Phys. Rev. Lett. 71 (1993) 3043; Reich, Physica D 76 (1994) 375; Fasso, J. Comput. Phys. 189 (2003) 527.""",
    order=2, kicks=(0.5,), drifts=(1.0,), split=True,
)  # fmt: skip
CHIN4 = Composition(
    """Force gradient, order 4 with positive steps only: 2 drifts and 3 torques a step.

    Source: Chin, Phys. Lett. A 226 (1997) 344, scheme A.""",
    order=4, kicks=(1 / 6, 2 / 3), drifts=(0.5,), gradient=1 / 24,
)  # fmt: skip
SUZUKI4 = Composition(
    """Five strang steps, one of them backwards: order 4.

    Source: Suzuki, Phys. Lett. A 146 (1990) 319.""",
    order=4, kicks=(_THIRD / 2, _THIRD, (1 - 3 * _THIRD) / 2), drifts=(_THIRD, _THIRD, 1 - 4 * _THIRD),
)  # fmt: skip
SRKN6 = Composition(
    """Runge-Kutta-Nystroem splitting of order 4 with small error constants: 6 drifts and torques a step.

    Source: Blanes & Moan, J. Comput. Appl. Math. 142 (2002) 313, table 3, SRKN6b.""",
    order=4,
    kicks=(0.0829844064174052, 0.396309801498368, -0.0390563049223486, 1 - 2 * (0.0829844064174052 + 0.396309801498368 - 0.0390563049223486)),
    drifts=(0.245298957184271, 0.604872665711080, 0.5 - 0.245298957184271 - 0.604872665711080),
)  # fmt: skip
SRKN11 = Composition(
    """Runge-Kutta-Nystroem splitting of order 6: 11 drifts and torques a step, for heavy tops to high accuracy over long times.

    Source: Blanes & Moan, J. Comput. Appl. Math. 142 (2002) 313, table 3, SRKN11b.""",
    order=6,
    kicks=(0.0414649985182624, 0.198128671918067, -0.0400061921041533, 0.0752539843015807, -0.0115113874206879,
           0.5 - (0.0414649985182624 + 0.198128671918067 - 0.0400061921041533 + 0.0752539843015807 - 0.0115113874206879)),
    drifts=(0.123229775946271, 0.290553797799558, -0.127049212625417, -0.246331761062075, 0.357208872795928,
            1 - 2 * (0.123229775946271 + 0.290553797799558 - 0.127049212625417 - 0.246331761062075 + 0.357208872795928)),
)  # fmt: skip
ABA864 = Composition(
    """For small torques (fast tops): errors of e h^8, e^2 h^6 and e^3 h^4 for torques of size e; 7 drifts and torques a step.

    Source: Blanes, Casas, Farres, Laskar, Makazaga & Murua, Appl. Numer. Math. 68 (2013) 58, table 3.""",
    order=4, drift_first=True,
    drifts=(0.0711334264982231177779387300061549964174, 0.241153427956640098736487795326289649618,
            0.521411761772814789212136078067994229991, -0.333698616227678005726562603400438876027),
    kicks=(0.183083687472197221961703757166430291072, 0.310782859898574869507522291054262796375,
           -0.0265646185119588006972121379164987592663, 0.0653961422823734184559721793911134363710),
)  # fmt: skip
ABA1064 = Composition(
    """For small torques (fast tops): errors of e h^10, e^2 h^6 and e^3 h^4 for torques of size e; 8 drifts and torques a step.

    Source: Blanes, Casas, Farres, Laskar, Makazaga & Murua, Appl. Numer. Math. 68 (2013) 58, table 3.""",
    order=4, drift_first=True,
    drifts=(0.03809449742241219545697532230863756534060, 0.1452987161169137492940200726606637497442,
            0.2076276957255412507162056113249882065158, 0.4359097036515261592231548624010651844006,
            -0.6538612258327867093807117373907094120024),
    kicks=(0.09585888083707521061077150377145884776921, 0.2044461531429987806805077839164344779763,
           0.2170703479789911017143385924306336714532, -0.01737538195906509300561788011852699719871),
)  # fmt: skip
