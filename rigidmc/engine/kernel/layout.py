"""Positions of numbers in memory: the rows of a block, of a state, and of a member's `work`.

This is the only file with positions of numbers. A block is an array (rows, members), members a
multiple of LANES. For a call, the rows of some members are copied side by side to two workspaces:
`state`, in the precision of the run, for steps, and `work`, in float64, for assessments and
monitors. To a kernel, each row of both is one number, or one vector of numbers.
"""

import math
import sys
from collections.abc import Sequence
from itertools import accumulate
from typing import Any, NamedTuple

from rigidmc.engine.compiler.compose import inline_all
from rigidmc.engine.compiler.intrinsics import in_precision
from rigidmc.engine.compiler.memory import (
    four_at,
    of_body,
    of_effects,
    put_rows,
    shifted,
    three_at,
    tuple_at,
)
from rigidmc.engine.compiler.trees import tree_size, tree_unflatten
from rigidmc.physics.dynamics.body_axes import with_axes
from rigidmc.physics.dynamics.euler import MassProperties
from rigidmc.physics.dynamics.methods import Flag
from rigidmc.physics.dynamics.so3 import concat, first_three
from rigidmc.physics.effects.present import memories_of, states_of
from rigidmc.physics.integrators.protocol import extra_state

# The number of members of a block is a multiple of LANES, the most that are worked on at the same
# time: two vectors of 512 bits of float32. Bits of members do not depend on it, sizes of blocks do.
LANES = 32
# Members of a block of a run: their 30 to 40 rows are 1 MB, and a call on them takes 10 ms or more.
# With 4096, all rows would compete for the same cache set: beginning and ending a block would take
# 64 ns per member instead of 47.
BLOCK = 4064


class _RowCounter:
    """A counter that hands out consecutive rows of memory."""

    def __init__(self) -> None:
        self.end = 0

    def take(self, count: int) -> int:
        """Return the first of the next `count` rows."""
        self.end += count
        return self.end - count


# Rows of a block. After them come the parameters of the effects, what follows L, and the rows of
# monitors, see `RowMap`.
_block = _RowCounter()
ATTITUDE = _block.take(4)  # a quaternion
MOMENTUM = _block.take(3)
EXTRA = _block.take(7)  # remainders of the sums of both, or extra state of the integrator
START = _block.end  # the rows before are a state
START_ENERGY = _block.take(1)
ENERGY_SCALE = _block.take(1)  # of drifts of the energy
START_L2 = _block.take(1)  # |L|^2
ENERGY_IN_PLAY = _block.take(1)
START_LZ = _block.take(1)
MAX_L2 = _block.take(1)  # the largest |L|^2 that the energies in play allow
# the largest kinetic energies since then, see `rigidmc.engine.kernel.member.largest_kinetic_energy`
PLANNED_KINETIC = _block.take(1)  # at planned assessments
MAX_KINETIC = _block.take(1)  # at all
DRIFT = _block.take(2)  # largest drifts of energy and of |L|^2 so far
STATUS = _block.take(1)  # see STATUSES
GOOD_STEP = _block.take(1)  # step of the last good state
FAULT_STEP = _block.take(1)  # step at which the member was flagged
EARLY_DRIFT = _block.take(2)  # largest drifts of energy and of |L|^2 in the first half of the run
LATE_DRIFT = _block.take(2)  # smallest drifts of both in the second half
GOOD_STATE = _block.take(7)  # attitude and momentum when the member was last ok
STEPS = _block.take(1)  # of the member in a round, see `rigidmc.engine.kernel.arguments.StepRange`
BODY = _block.take(9)  # a MassProperties
EFFECTS = _block.end

# The first thing that went wrong. A member that is not ok initially stays frozen from the start.
STATUSES = {
    "ok": 0, "non_finite": 1, "invalid_input": 2, "energy_drift": 3, "momentum_drift": 4,
    "step_too_large": 5, "off_unit_quaternion": 6,
}  # fmt: skip

# Rows of a state: the rows of a block up to START, then those from BODY on. The rows between exist
# only in float64, in `work`.
BODY_AT, EFFECTS_AT = START, START + EFFECTS - BODY

# Rows of `work`: further numbers of a member; from MEMBER_ROWS on, the rows of its block.
_work = _RowCounter()
CHECKED_STATE = _work.take(7)  # the true state at the last assessment
BRACKET, FRACTION = CHECKED_STATE, CHECKED_STATE + 4  # of a step back to an event
CHECKED_ENERGY = _work.take(2)  # energy and |L|^2 there
IS_STOPPED = _work.take(1)  # whether an event has stopped the member
STOPPED_STATE = _work.take(7)  # the state at the end of the step in which the event stopped it
MEMBER_STEPS = _work.take(1)  # its number of steps in a round
ROUND_START = _work.take(1)  # when the round began
STEP_LENGTH = _work.take(1)  # the length of its steps
INDEX = _work.take(1)  # the bits of its index
MEMBER_ROWS = _work.end

# Rows of an event.
_event = _RowCounter()
LEVEL = _event.take(1)  # the level after the last step, 0 if the event cannot happen next
COUNT = _event.take(1)  # how often it has happened
TAU = _event.take(1)  # when it last happened, by linear interpolation
FIRST_TAU = _event.take(1)  # when it first happened, by linear interpolation
SQUARES = _event.take(1)  # sum of the squares of the times between events
TIMES = _event.take(2)  # when it first and last happened, exactly
DWELL_START = SQUARES  # of an event with a dwell time, which needs no squares
# A record: the time of the step's end; for the later end of the bracket, its distance back from the
# step's end, as a fraction of the step, and its level; the same for the earlier end; q and L at the
# step's end.
RECORD_ROWS = 12
RECORD_POSE = 5  # the row of q and L in a record
RECORDS = _event.take(2 * RECORD_ROWS)  # of the first and of the last
EVENT_ROWS = _event.end  # the tails of both records follow the rows of all events, see `tail_of`

# Rows of the growth of a tangent: the tangent, laid out as a state in a block up to START, then
# further numbers.
_growth = _RowCounter()
_growth.take(START)
SUMS = _growth.take(3)  # sum of ln growth, and integrals over time of (d'/d) s and of Y
RECORDED = _growth.take(1)  # time of the last record
WEIGHT = _growth.take(1)  # 1/|L|^2 of the motion
GROWTH_ROWS = _growth.end


class RowMap(NamedTuple):
    """First rows, in a block, of the rows that a scene adds to those above; `end` is the number of
    rows."""

    effects: int  # parameters of the effects
    trailing: int  # states of the effects, then the work of each, then their memories
    good_trailing: int  # the same at the last good state
    events: int  # EVENT_ROWS rows for each event, then the tails of their records
    running: int  # the state of each running observable
    growth: int  # GROWTH_ROWS
    axes: int  # AXES_ROWS if the body is described in axes other than its principal axes
    end: int

    def in_state(self, row: int) -> int:
        """Return the row of a state for a row of a block from BODY on."""
        return row - BODY + BODY_AT


def map_rows(
    parameters: int,
    trailing: int = 0,
    events: int = 0,
    marks: Sequence[int] = (),
    growth: bool = False,
    axes: bool = False,
    tail: int = 0,
) -> RowMap:
    """Return the RowMap for `parameters` parameters of effects and `trailing` numbers after L.

    events : number of events
    marks : state size of each running observable
    growth : whether the growth of a tangent is recorded
    axes : whether members have the rows of their axes
    tail : numbers of `tail_of`
    """
    counts = (
        parameters, trailing, trailing, (EVENT_ROWS + 2 * tail) * events, sum(marks),
        GROWTH_ROWS * growth,
        AXES_ROWS * axes,
    )  # fmt: skip
    return RowMap(*accumulate(counts, initial=EFFECTS))


def monitor_rows(events: Sequence[Any], running: Sequence[Any], growth: Flag) -> int:
    """Return the number of rows of a block for the monitors; arguments as in
    `rigidmc.engine.program.Program`."""
    rows = map_rows(0, 0, len(events), [len(marks) for _, marks in running], len(growth) > 0)
    return rows.end - rows.events


_BODY = MassProperties(*[0.0] * 9)
AXES_ROWS = 4  # a quaternion, see `rigidmc.physics.dynamics.body_axes`


def body_at(rows, row):
    """Return the MassProperties from nine rows."""
    return tree_unflatten(_BODY, rows, row)


def member_rows(work):
    """Return the rows of a block that `work` contains."""
    return shifted(work, MEMBER_ROWS)


def pose_at(rows, row):
    """Return (q, L) from seven rows."""
    return four_at(rows, row), three_at(rows, row + 4)


def precise_pose_at(rows, row, other):
    """Return (q, L) from seven rows, in the precision of the rows `other`."""
    return in_precision(four_at(rows, row), other), in_precision(three_at(rows, row + 4), other)


def good_pose(work):
    """Return (q, L) of members when they were last ok."""
    return pose_at(member_rows(work), GOOD_STATE)


def body_and_effects(effects, work):
    """Return the MassProperties and the effects with the members' numbers, from their rows."""
    body = body_at(of_body(work), MEMBER_ROWS + BODY)
    return body, tree_unflatten(effects, of_effects(work), MEMBER_ROWS + EFFECTS)


def observed_body_and_effects(effects, axes, work, row):
    """Return the MassProperties with their BodyAxes, and the effects, for observables and events.

    axes : AXES_ROWS flags, or () for a body described in its principal axes
    row : the first row of the axes
    """
    body, present = body_and_effects(effects, work)
    return with_axes(body, tree_unflatten(axes, work, row)), present


def opening_substep(substeps, h):
    """Return (drift, kick, gradient) of row 0 of a StepScheme for a step h.

    This substep turns (q, L) into stepping form.
    """
    return substeps[0] * h, substeps[1] * h, substeps[2] * h


def state_at(state, compensated, extra, row):
    """Return (q, L) with the extra numbers after L; pairs (value, remainder) if `compensated`."""
    q, l = pose_at(state, ATTITUDE)
    if len(compensated) == 0:
        return q, concat(l, tuple_at(extra, state, row))
    q_remainder, l_remainder = pose_at(state, EXTRA)
    return (q, q_remainder), (l, l_remainder)


def put_state(q, l, state, compensated, row):
    """Write the rows that `state_at` reads."""
    if len(compensated) == 0:
        put_rows(q + first_three(l), state, ATTITUDE)
        put_rows(l[3:], state, row)
    else:
        put_rows(q[0] + l[0], state, ATTITUDE)
        put_rows(q[1] + l[1], state, EXTRA)
    return 0


def moving(effects, work_flags):
    """Return a tuple as long as the states of effects and the saved works together, which a step
    changes."""
    return concat(states_of(effects), works_of(work_flags))


def trailing(effects, work_flags):
    """Return a tuple as long as the same and the memories of effects together."""
    return concat(moving(effects, work_flags), memories_of(effects))


def tail_of(effects):
    """Return the states and memories of effects: what a record of an event holds besides q and
    L."""
    return concat(states_of(effects), memories_of(effects))


def traced(effects):
    """Return how many rows a state in the trace has."""
    return 7 + len(states_of(effects))


def running_row(row, events, effects):
    """Return the first row of running observables; row : of the events."""
    return row + (EVENT_ROWS + 2 * len(tail_of(effects))) * len(events)


def memories_at(effects, work_flags, rows, row):
    """Return the memories of effects, from the trailing numbers in rows from `row` on."""
    return tuple_at(memories_of(effects), rows, row + len(moving(effects, work_flags)))


def works_of(work_flags):
    """Return a number for each saved work."""
    if len(work_flags) == 0:
        return ()
    return (0.0,) + works_of(work_flags[1:])


def extra_flags(integrator, effects, work_flags):
    """Return a tuple as long as the numbers after L in a state without remainders.

    These are the extra state of the integrator, else states and works, from `extra_row` on.
    """
    if len(extra_state(integrator)) == 0:
        return moving(effects, work_flags)
    return extra_state(integrator)


def extra_row(integrator, effects):
    """Return the row of a state at which these numbers begin; the trailing follow the effects."""
    if len(extra_state(integrator)) == 0:
        return EFFECTS_AT + tree_size(effects)
    return EXTRA


def momentum_at(integrator, state):
    """Return L of a state, followed by the extra state of the integrator."""
    return concat(three_at(state, MOMENTUM), tuple_at(extra_state(integrator), state, EXTRA))


def put_stepping(q, l, state):
    """Write a state in stepping form, with remainders of sums 0."""
    put_rows(q + first_three(l), state, ATTITUDE)
    if len(l) == 3:
        zero = 0.0 * l[0]
        put_rows((zero, zero, zero, zero, zero, zero, zero), state, EXTRA)
    put_rows(l[3:], state, EXTRA)
    return 0


def whole_lanes(count: int) -> int:
    """Round a number of members up to whole lanes."""
    return LANES * math.ceil(count / LANES)


inline_all(sys.modules[__name__])
