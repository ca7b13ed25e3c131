"""A member some time after a state that is known, and what is observed there: a formula."""

import sys
from typing import Any, NamedTuple

from rigidmc.dynamics.euler import MassProperties
from rigidmc.engine.compose import inline_all
from rigidmc.integrators.protocol import step
from rigidmc.observables.protocol import value


class Moved(NamedTuple):
    """One step of an integrator, see `rigidmc.engine.formulas`.

    effects, observables, integrator : as they are compiled;  t, h : when the state (q, l) is known,
        and the time since then [s]
    """

    body: MassProperties
    effects: Any
    observables: Any
    integrator: Any
    t: float
    h: float
    q: tuple[float, ...]
    l: tuple[float, ...]

    def values(self):
        """q and L after h, then the numbers of the observables."""
        part = self.h, self.h, 0.0
        q, l = step(
            self.integrator, self.body, self.effects, self.t, self.h, part, self.q, self.l, ()
        )
        return q + l + seen(self.observables, self.body, self.effects, self.t + self.h, q, l)


def seen(observables, body, effects, t, q, l):
    """The numbers of observables of the state and the time, one after the other."""
    if len(observables) == 0:
        return ()
    zero = 0.0 * t
    first = value(observables[0], body, effects, t, q, l, (zero, zero, zero, zero), ())
    return first + seen(observables[1:], body, effects, t, q, l)


inline_all(sys.modules[__name__])
