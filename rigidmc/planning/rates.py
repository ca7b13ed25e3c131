"""How fast members may move, and how many steps of its own each member then makes."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigidmc.dynamics.euler import MassProperties, kinetic_energy
from rigidmc.dynamics.so3 import dot
from rigidmc.effects.parameters import filled, parameter_count
from rigidmc.effects.sums import total_energy_scale
from rigidmc.engine import layout
from rigidmc.engine.forces import energies, torques

Array = NDArray[np.float64]
MOST_OWN_STEPS = 2**24  # of a member in a round: no member stops a run, however fast it spins


def physics(effects: Sequence[Any], block: Array) -> tuple[MassProperties, tuple[Any, ...]]:
    """(body, effects) of the members of a block (rows, n), their fields as arrays (n,)."""
    arrays, row = [], layout.EFFECTS
    for effect in effects:
        arrays.append(filled(type(effect), block[row : row + parameter_count(effect)]))
        row += parameter_count(effect)
    return MassProperties(*block[layout.BODY : layout.EFFECTS]), tuple(arrays)


def rates(effects: Sequence[Any], block: Array) -> Array:
    """How fast each member of a block may move [rad/s]:

        sqrt(2 (E + V)/I) + sqrt(V/I)

    with I the smallest moment, E the energy and V the largest potential energy. The first term
    bounds |omega| for all times, the second is the rate at which torques act. The torque at the
    start stands for V if it is larger, as for effects without an energy.
    """
    body, effects = physics(effects, block)
    q = tuple(block[layout.ATTITUDE : layout.MOMENTUM])
    l = tuple(block[layout.MOMENTUM : layout.REST])
    with np.errstate(all="ignore"):
        highest = total_energy_scale(effects, body)
        smallest = 1.0 / np.max([body.i1, body.i2, body.i3], axis=0)
        torque = torques(effects, body, q, l)
        swing = np.maximum(highest, np.sqrt(dot(torque, torque)))
        energy = kinetic_energy(body, l) + energies(effects, body, q) + highest
        bound = np.sqrt(2.0 * np.maximum(energy, 0.0) / smallest) + np.sqrt(swing / smallest)
        return np.asarray(bound)


def own_steps(rate: Array, span: float, turn: float | None) -> Array:
    """How many steps members that move at `rate` [rad/s] need in a time `span` [s] if none of the
    steps may turn them by more than `turn` [rad], the setting of a scene."""
    assert turn is not None, "members of this scene have no steps of their own"
    with np.errstate(all="ignore"):
        steps = np.ceil(span * rate / turn)
    return np.clip(np.where(np.isfinite(steps), steps, 1.0), 1.0, MOST_OWN_STEPS)


def by_steps(block: Array) -> NDArray[np.int64]:
    """The order of a block's members by their number of steps: equal numbers lie side by side."""
    steps = block[layout.STEPS]
    # whole numbers of two bytes are sorted by radix, 15 times as fast
    keys = steps.astype("u2") if steps.max(initial=0.0) < 2**16 else steps
    return np.argsort(keys, kind="stable")
