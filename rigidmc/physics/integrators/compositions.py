"""Splittings by name: palindromes of drifts (free motion) and kicks, with their coefficients."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from itertools import accumulate
from operator import add
from typing import Any

import numpy as np

from rigidmc.physics.dynamics.methods import flag, static_count
from rigidmc.physics.effects.protocol import depends_on_momentum, is_random
from rigidmc.physics.integrators.protocol import ONE_SUBSTEP, StepScheme, TurnBounds
from rigidmc.physics.integrators.splitting import (
    ForceGradient,
    Kicks,
    Langevin,
    Split,
    Splitting,
    exact_drift,
    substep_count,
)


@dataclass(frozen=True)
class Composition:
    """A palindrome of drifts and kicks.

    text : description, with its source
    drifts, kicks : first half of the coefficients, the middle one included, in units of the step
    drift_first : whether a step begins with a drift
    gradient : coefficient of h^2 of the force gradient in the middle kick
    split : whether the free motion is split into rotations instead of exact
    is_contender, drifts_like : see `rigidmc.physics.integrators.protocol`
    """

    text: str
    order: int
    drifts: tuple[float, ...]
    kicks: tuple[float, ...]
    drift_first: bool = False
    gradient: float = 0.0
    split: bool = False
    is_contender: bool = True
    drifts_like: str = ""

    is_splitting = True
    is_reversible = True
    compensated = True

    @property
    def conserves(self) -> tuple[str, ...]:
        """Quantities of a free body that it conserves to rounding."""
        return ("|q|", "|L|^2", "L in space") if self.split else ("|q|", "|L|^2", "T", "L in space")

    @property
    def accepts(self) -> str:
        """Torques that it accepts."""
        if self.gradient:
            return "torques of attitude and time with a gradient"
        return "torques with an exact flow" if self.order == 2 else "torques of attitude and time"

    @property
    def evaluations(self) -> int:
        """Torques per step; the last torque of a step is the first of the next."""
        drifts, kicks = self.sequence()
        return min(len(drifts), len(kicks))

    def sequence(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Return (drifts, kicks) of the whole step; one of them is longer by one."""
        longer, shorter = (
            (self.drifts, self.kicks) if self.drift_first else (self.kicks, self.drifts)
        )
        # The middle coefficient of a palindrome is not repeated.
        middle_is_longer = len(longer) > len(shorter)
        longer = (*longer, *longer[-2 if middle_is_longer else -1 :: -1])
        shorter = (*shorter, *shorter[-1 if middle_is_longer else -2 :: -1])
        return (longer, shorter) if self.drift_first else (shorter, longer)

    def scheme(self, turns: TurnBounds, effects: Sequence[Any]) -> StepScheme:
        """Return the StepScheme for steps that turn by `turns`."""
        # Noise acts between two halves of the free motion, which changes the order of all parts.
        if any(is_random(e) for e in effects):
            return self._noisy(turns, effects)
        lead, parts = self._parts()
        drift = Split() if self.split else exact_drift(turns, max(abs(a) for a, _ in parts))
        if any(depends_on_momentum(e) for e in effects):
            n = 1 if self.split else substep_count(turns, 1.0)
            rows = [(1.0 / n, 0.5 * (k == 0), 0.5 * (k == n - 1), 0.0) for k in range(n)]
            return StepScheme(Kicks(drift), np.array([ONE_SUBSTEP[0], *rows]))
        # Row 0 opens the state, which merges the last kick of a step with the first of the next.
        rows = [(*lead, 0.0, lead[0])]
        times = accumulate((a for a, _ in parts), initial=lead[0])
        for i, ((a, b), time) in enumerate(zip(parts, times, strict=False)):
            n = 1 if self.split else substep_count(turns, a)
            rows += [(a / n, 0.0, 0.0, time + a * k / n) for k in range(1, n)]
            middle = self.gradient if 2 * (i + 1) == len(parts) else 0.0
            rows.append((a / n, b, middle, time + a))
        splitting = Splitting(drift, flag(self.drift_first))
        return StepScheme(ForceGradient(drift) if self.gradient else splitting, np.array(rows))

    def _parts(self) -> tuple[tuple[float, float], list[tuple[float, float]]]:
        """Return (opening, parts), each (drift, kick); a step ends with the opening of the next."""
        drifts, kicks = self.sequence()
        if not self.drift_first:
            return (0.0, kicks[0]), [
                *zip(drifts, [*kicks[1:-1], kicks[-1] + kicks[0]], strict=True)
            ]
        drifts_after = [*drifts[1:-1], drifts[-1] + drifts[0]]
        return (drifts[0], kicks[0]), [*zip(drifts_after, [*kicks[1:], kicks[0]], strict=True)]

    def _noisy(self, turns: TurnBounds, effects: Sequence[Any]) -> StepScheme:
        """Return BAOAB: half a kick, half a drift, flows and noise, half a drift, half a kick.

        The last half kick of a step and the first of the next are one kick.
        """
        drift = Split() if self.split else exact_drift(turns, 0.5)
        n = 1 if self.split else substep_count(turns, 0.5)
        rows = [(0.0, 0.5, 0.0, 0.0), (0.5 / n, 1.0, 0.0, 1.0)]
        pushes = tuple(flag(not depends_on_momentum(e) and not is_random(e)) for e in effects)
        flows = tuple(flag(depends_on_momentum(e)) for e in effects)
        return StepScheme(Langevin(drift, static_count(n), pushes, flows), np.array(rows))


def _with_rest(total: float, *given: float) -> tuple[float, ...]:
    """Return coefficients with a last one that makes the sum `total`."""
    return (*given, total - reduce(add, given))  # from Python 3.12 on, `sum` rounds differently


def _with_middle(*given: float) -> tuple[float, ...]:
    """Return the first half of a palindrome with sum 1, middle coefficient included."""
    return (*given, 1.0 - 2.0 * reduce(add, given))


# Suzuki's 1/(4 - 4^(1/3)): the sum of cubes of the five steps is 0, which cancels order 3.
_THIRD = 1.0 / (4.0 - 4.0 ** (1.0 / 3.0))

INTEGRATORS = {
    "strang": Composition(
        """Kick, exact free motion, kick: order 2, for fast tops over long times and for damping.

        Source: Strang, SIAM J. Numer. Anal. 5 (1968) 506; Celledoni et al., SIAM J. Sci. Comput. 30
        (2008) 2084, section 4.""",
        order=2,
        kicks=(0.5,),
        drifts=(1.0,),
    ),
    "rotations": Composition(
        """Like strang, with the free motion split into four rotations: order 2, cheap.

        For moderate accuracy over long times. One rotation about L removes the middle moment,
        which makes the splitting exact for bodies with two equal moments; the plain splitting into
        rotations about three axes is not. The error of the energy stays bounded, but the energy is
        not conserved even for a free body.
        Source: McLachlan, Phys. Rev. Lett. 71 (1993) 3043; Reich, Physica D 76 (1994) 375; Fasso,
        J. Comput. Phys. 189 (2003) 527.""",
        order=2,
        kicks=(0.5,),
        drifts=(1.0,),
        split=True,
        is_contender=False,
    ),
    "chin4": Composition(
        """Force gradient, order 4 with positive steps only: 2 drifts and 2 torques a step, each
        with its rate of change.

        Source: Chin, Phys. Lett. A 226 (1997) 344, scheme A.""",
        order=4,
        kicks=(1 / 6, 2 / 3),
        drifts=(0.5,),
        gradient=1 / 24,
    ),
    "suzuki4": Composition(
        """Five strang steps, one of them backwards: order 4.

        Source: Suzuki, Phys. Lett. A 146 (1990) 319.""",
        order=4,
        kicks=(_THIRD / 2, _THIRD, (1 - 3 * _THIRD) / 2),
        drifts=(_THIRD, _THIRD, 1 - 4 * _THIRD),
        is_contender=False,
        drifts_like="srkn11",
    ),
    "srkn6": Composition(
        """Runge-Kutta-Nystroem splitting of order 4: 6 drifts, 6 torques a step.

        Its error constants are small.
        Source: Blanes & Moan, J. Comput. Appl. Math. 142 (2002) 313, table 3, SRKN6b.""",
        order=4,
        kicks=_with_middle(0.0829844064174052, 0.396309801498368, -0.0390563049223486),
        drifts=(0.245298957184271, 0.604872665711080, 0.5 - 0.245298957184271 - 0.604872665711080),
        drifts_like="srkn11",
    ),
    "srkn11": Composition(
        """Runge-Kutta-Nystroem splitting of order 6: 11 drifts, 11 torques a step.

        For heavy tops to high accuracy over long times.
        Source: Blanes & Moan, J. Comput. Appl. Math. 142 (2002) 313, table 3, SRKN11b.""",
        order=6,
        kicks=_with_rest(
            0.5,
            0.0414649985182624,
            0.198128671918067,
            -0.0400061921041533,
            0.0752539843015807,
            -0.0115113874206879,
        ),
        drifts=_with_middle(
            0.123229775946271,
            0.290553797799558,
            -0.127049212625417,
            -0.246331761062075,
            0.357208872795928,
        ),
    ),
    "aba864": Composition(
        """For small torques e (fast tops): errors of e h^8, e^2 h^6 and e^3 h^4.

        7 drifts and torques a step.
        Source: Blanes, Casas, Farres, Laskar, Makazaga & Murua, Appl. Numer. Math. 68 (2013) 58,
        table 3.""",
        order=4,
        drift_first=True,
        drifts=(
            0.0711334264982231177779387300061549964174,
            0.241153427956640098736487795326289649618,
            0.521411761772814789212136078067994229991,
            -0.333698616227678005726562603400438876027,
        ),
        kicks=(
            0.183083687472197221961703757166430291072,
            0.310782859898574869507522291054262796375,
            -0.0265646185119588006972121379164987592663,
            0.0653961422823734184559721793911134363710,
        ),
        drifts_like="aba1064",
    ),
    "aba1064": Composition(
        """For small torques e (fast tops): errors of e h^10, e^2 h^6 and e^3 h^4.

        8 drifts and torques a step.
        Source: Blanes, Casas, Farres, Laskar, Makazaga & Murua, Appl. Numer. Math. 68 (2013) 58,
        table 3.""",
        order=4,
        drift_first=True,
        drifts=(
            0.03809449742241219545697532230863756534060,
            0.1452987161169137492940200726606637497442,
            0.2076276957255412507162056113249882065158,
            0.4359097036515261592231548624010651844006,
            -0.6538612258327867093807117373907094120024,
        ),
        kicks=(
            0.09585888083707521061077150377145884776921,
            0.2044461531429987806805077839164344779763,
            0.2170703479789911017143385924306336714532,
            -0.01737538195906509300561788011852699719871,
        ),
    ),
}
