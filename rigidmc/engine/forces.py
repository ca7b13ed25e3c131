"""Torque and energy of the effects for many members at once, outside a run: by arrays where the formulas pass them, else compiled."""

from typing import Any, NamedTuple

import numpy as np

from rigidmc.dynamics.euler import MassProperties
from rigidmc.effects.parameters import blank, numbers
from rigidmc.effects.sums import total_energy, total_torque
from rigidmc.engine.compose import NumbaError
from rigidmc.engine.formulas import evaluate
from rigidmc.engine.operations import refuse_misdeeds


class Felt(NamedTuple):
    """The torque of effects on a body [N m], and its potential energy [J]."""

    q: tuple
    l: tuple
    body: MassProperties
    effects: Any

    def values(self):
        x, y, z = total_torque(self.effects, self.body, 0.0, self.q, self.l)
        return x, y, z, total_energy(self.effects, self.body, self.q)


_BODY = MassProperties(*[0.0] * 9)


def energies(effects, body, q):
    """Potential energy of all effects [J], of attitudes (4, ...) and effects and body whose numbers are arrays that broadcast."""
    try:
        return total_energy(effects, body, q)
    except (TypeError, ValueError):  # a branch, or a function of math, which takes no array
        return evaluated(effects, body, q, (0.0, 0.0, 0.0))[3]


def torques(effects, body, q, l):
    """Torques of all effects at t = 0 [N m], (3, ...), as `energies`."""
    try:
        return np.array(np.broadcast_arrays(*total_torque(effects, body, 0.0, q, l)))
    except (TypeError, ValueError):
        return evaluated(effects, body, q, l)[:3]


def evaluated(effects, body, q, l):
    """Torque and energy (4, ...) by compiled code."""
    columns = np.broadcast_arrays(
        *q, *l, *body, *(value for e in effects for _, _, value in numbers(e))
    )
    rows = [column.ravel() for column in columns]
    formula = Felt((0.0,) * 4, (0.0,) * 3, _BODY, blank(effects))
    try:
        found = evaluate(formula, 4, rows, threads=1)
    except NumbaError:  # code of a user's own that takes one member only
        refuse_misdeeds(effects)
        found = evaluate(formula, 4, rows, threads=1, side=1)
    return found.reshape(4, *columns[0].shape)
