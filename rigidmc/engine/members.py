"""Torque and energy of the effects for many members at once, outside a run: by arrays where the formulas pass them, else compiled."""

import numpy as np

from rigidmc.dynamics.euler import MassProperties
from rigidmc.effects.parameters import blank, numbers
from rigidmc.effects.verbs import total_energy, total_torque
from rigidmc.engine.compose import read, read_all
from rigidmc.engine.entries import Compiled
from rigidmc.engine.layout import LANES, four_at, put, three_at

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
    columns = np.broadcast_arrays(*q, *l, *body, *(value for e in effects for _, _, value in numbers(e)))
    rows = np.ascontiguousarray([column.ravel() for column in columns], dtype=float)
    out = np.empty((4, rows.shape[1]))
    _compiled(blank(effects), rows, out)
    return out.reshape(4, *columns[0].shape)


def _fill(effects, rows, out):
    """out[:, m] = torque and energy of the member whose attitude, momentum, body and effects are rows[:, m]."""
    count = rows.shape[0]
    work = np.empty((count + 4) * LANES)
    for low in range(0, rows.shape[1], LANES):
        for i in range(count):
            for k in range(LANES):
                work[i * LANES + k] = rows[i, min(low + k, rows.shape[1] - 1)]
        for k in range(LANES):
            q, l = four_at(work, k, 0), three_at(work, k, 4)
            body, present = read(_BODY, work, 7, k, LANES), read_all(effects, work, 16, k, LANES)
            x, y, z = total_torque(present, body, 0.0, q, l)
            put((x, y, z, total_energy(present, body, q)), work, count * LANES + k, LANES)
        for i in range(4):
            for k in range(min(LANES, rows.shape[1] - low)):
                out[i, low + k] = work[(count + i) * LANES + k]


_compiled = Compiled(_fill)
