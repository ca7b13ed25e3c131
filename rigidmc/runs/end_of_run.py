"""Derivatives by the end of a run, `run.t_end`.

The end moves only the last state of a member, along its motion. So these derivatives follow from
that state, after the run: derivatives of the last save are the rates of the observables there,
and derivatives of results over all steps follow from such rates (`lengthened` of
`rigidmc.physics.observables.protocol.Running`). No event moves.

A member that is flagged, or that an event has stopped, no longer moves: its derivatives are 0.
"""

import numpy as np
from numpy.typing import NDArray

from rigidmc.engine.compiler.trees import tree_flatten
from rigidmc.engine.formulas import RatesOfChange, evaluate
from rigidmc.engine.kernel import layout
from rigidmc.engine.kernel.member import largest_kinetic_energy, start_values
from rigidmc.physics.dynamics.body_axes import with_axes
from rigidmc.physics.dynamics.euler import BODY_NUMBERS, MassProperties, kinetic_energy
from rigidmc.physics.dynamics.so3 import dot
from rigidmc.physics.effects.protocol import blank
from rigidmc.physics.effects.sums import has_untracked
from rigidmc.physics.observables.protocol import is_time_average
from rigidmc.planning.plan import Plan
from rigidmc.planning.steps import Array, physics
from rigidmc.scene.parameters import END


def add_derivatives_by_end(plan: Plan, rows: Array, saves: Array) -> None:
    """Set the derivatives by the end of a run, in place.

    rows : of a finished block, in the order of the members: rows of running observables change
    saves : (time, value, 1 + columns, member) of the block: the last save changes
    """
    column, places = 1 + plan.wrt.index(END), plan.places
    moves = (rows[layout.STATUS] == 0.0) & ~_stopped(plan, rows)
    found, now, rates = _rates(plan, rows)
    saves[-1, :, column] = np.where(moves, found, 0.0)
    each, time = rows[layout.STEPS], plan.grid.end
    made = plan.grid.steps * each
    steps = plan.grid.clock.of(each).weighed(made, made)
    begins, changes = places.running, rows[column * places.end :]
    for one, marks in plan.monitors.running:
        at = slice(begins, begins := begins + len(marks))
        some = slice(at.start - places.running, at.stop - places.running)
        seen = 2.0 * plan.nodes * steps if plan.nodes and is_time_average(one) else steps
        change = one.lengthened(rows[at], now[some], rates[some], time, seen)
        changes[at] = np.where(moves, change, 0.0)


def _stopped(plan: Plan, rows: Array) -> NDArray[np.bool_]:
    """Return which members an event has stopped."""
    stopped = np.zeros(rows.shape[1], bool)
    for i, (_, one) in enumerate(plan.monitors.of_events):
        if one.stop:
            stopped |= rows[plan.places.events + layout.EVENT_ROWS * i + layout.COUNT] > 0.0
    return stopped


def _rates(plan: Plan, rows: Array) -> tuple[Array, Array, Array]:
    """Return (rates of the saved values, running states that would begin at the end, their rates),
    each with the members last."""
    effects, places, count = plan.model.effects, plan.places, rows.shape[1]
    state, l = rows[: layout.EXTRA], rows[layout.MOMENTUM : layout.EXTRA]
    work = np.concatenate([np.zeros((layout.MEMBER_ROWS, count)), rows[: places.end]])
    with np.errstate(all="ignore"):
        kinetic = kinetic_energy(physics(effects, rows)[0], l)
        largest = largest_kinetic_energy(has_untracked(plan.works), work, 6, kinetic)
        start = start_values(work, (), (), largest, dot(l, l))
        axes = with_axes(_BODY, tuple(rows[places.axes : places.end])).axes
    fixed = (
        tuple(plan.recording.recorded.values()),
        tuple(one for one, _ in plan.monitors.running),
        plan.works,
    )
    columns = [
        *rows[layout.BODY : layout.EFFECTS], *(x for part in axes for x in part),
        *rows[places.effects : places.works], *tree_flatten(fixed), *start, plan.grid.end, *state,
        *rows[places.works : places.good_works],
    ]  # fmt: skip
    body = with_axes(_BODY, (0.0,) * 4 if plan.has_axes else ())
    momentum = (0.0,) * (3 + places.good_works - places.works)
    formula = RatesOfChange(body, blank(effects), *fixed, (0.0,) * 4, 0.0, (0.0,) * 4, momentum)
    values, marks = plan.values, sum(len(marks) for _, marks in plan.monitors.running)
    width = values + 2 * marks
    found = evaluate(formula, width, np.stack(np.broadcast_arrays(*columns)), threads=1)
    return found[:values], found[values : values + marks], found[values + marks :]


_BODY = MassProperties(*[0.0] * BODY_NUMBERS)
