"""Torque and energy of the effects for many members at once, outside a run.

Arrays go through the formulas as they stand if the formulas take arrays, else the formulas are
compiled.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigidmc.dynamics.euler import MassProperties
from rigidmc.effects.parameters import blank, numbers
from rigidmc.effects.sums import total_energy, total_torque
from rigidmc.engine.compose import NumbaError
from rigidmc.engine.formulas import evaluate
from rigidmc.engine.operations import refuse_memory

Vector = Any  # a tuple of numbers or of arrays that broadcast


class Felt(NamedTuple):
    """The torque of effects on a body [N m], and its potential energy [J]."""

    q: tuple[float, ...]
    l: tuple[float, ...]
    body: MassProperties
    effects: Any

    def values(self) -> tuple[Any, ...]:
        x, y, z = total_torque(self.effects, self.body, 0.0, self.q, self.l)
        return x, y, z, total_energy(self.effects, self.body, self.q)


_BODY = MassProperties(*[0.0] * 9)


def energies(effects: Any, body: Any, q: Vector) -> Any:
    """Potential energy of all effects [J] at attitudes (4, ...).

    The numbers of effects and body are arrays that broadcast with the attitudes.
    """
    try:
        return total_energy(effects, body, q)
    except (TypeError, ValueError):  # a branch, or a function of math, which takes no array
        return evaluated(effects, body, q, (0.0, 0.0, 0.0))[3]


def torques(effects: Any, body: Any, q: Vector, l: Vector) -> NDArray[np.float64]:
    """Torques of all effects at t = 0 [N m], (3, ...), arguments as of `energies`."""
    try:
        return np.array(np.broadcast_arrays(*total_torque(effects, body, 0.0, q, l)))
    except (TypeError, ValueError):
        return evaluated(effects, body, q, l)[:3]


def evaluated(effects: Any, body: Any, q: Vector, l: Vector) -> NDArray[np.float64]:
    """Torque and energy (4, ...) by compiled code."""
    parameters = (value for e in effects for _, _, value in numbers(e))
    columns = np.broadcast_arrays(*q, *l, *body, *parameters)
    rows = [column.ravel() for column in columns]
    formula = Felt((0.0,) * 4, (0.0,) * 3, _BODY, blank(effects))
    try:
        values = evaluate(formula, 4, rows, threads=1)
    except NumbaError:  # a user's code that takes one member at a time
        refuse_memory(effects)
        values = evaluate(formula, 4, rows, threads=1, side=1)
    return np.reshape(values, (4, *columns[0].shape))
