"""Where numbers lie: the rows of a block, of a member's state, and of what is known of a member.

The one file with positions of numbers. A block is an array (rows, members), members a multiple of
LANES. For a call, the rows of some members are copied side by side to two workspaces: `state`, in
the precision of the run, for steps, and `work`, in float64, for assessments and monitors. To a
kernel both are rows of one number, or of one vector of numbers.
"""

import math
import sys
from collections.abc import Sequence
from itertools import accumulate
from typing import Any, NamedTuple

from rigidmc.engine.compiler.compose import inline_all
from rigidmc.engine.compiler.memory import four_at, put_rows, three_at, tuple_at
from rigidmc.engine.compiler.trees import tree_unflatten
from rigidmc.physics.dynamics.euler import MassProperties
from rigidmc.physics.dynamics.methods import Flag
from rigidmc.physics.dynamics.so3 import concat, first_three
from rigidmc.physics.integrators.protocol import extra_state

# Members of a block are a multiple of LANES, the most that are worked on side by side: two vectors
# of 512 bits of float32. Bits of members do not depend on it, sizes of blocks do.
LANES = 32
# Members of a block of a run: their 30 to 40 rows are 1 MB, and a call on them takes 10 ms or more.
# With 4096 all rows would compete for one place in the cache, and a block would begin and end in
# 64 ns a member, not 47.
BLOCK = 4064


class _RowCounter:
    """Rows of memory, given out one after the other."""

    def __init__(self) -> None:
        self.end = 0

    def take(self, count: int) -> int:
        """The first of the next `count` rows."""
        self.end += count
        return self.end - count


# Rows of a block. After them come the parameters of the effects, their works, and the rows of
# monitors, see `RowMap`.
_block = _RowCounter()
ATTITUDE = _block.take(4)  # a quaternion
MOMENTUM = _block.take(3)
EXTRA = _block.take(7)  # remainders of the sums of both, or what the integrator keeps instead
# Of the start: energy, its scale, |L|^2, energies in play, L_z, largest |L|^2 that these allow; and
# the largest kinetic energies since, at planned assessments and at all, see
# `rigidmc.engine.kernel.member.largest_kinetic_energy`.
START = _block.take(8)
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

# The first thing that went wrong. A member that is not ok on entry stays frozen from the start.
STATUSES = {
    "ok": 0, "non_finite": 1, "invalid_input": 2, "energy_drift": 3, "momentum_drift": 4,
    "step_too_large": 5, "off_unit_quaternion": 6,
}  # fmt: skip

# Rows of a state: those of a block up to START, then those from BODY on. What lies between is known
# in float64 alone, in `work`.
BODY_AT, EFFECTS_AT = START, START + EFFECTS - BODY

# Rows of `work`: what is known of a member; from KNOWN on, the rows of its block.
_work = _RowCounter()
CHECKED_STATE = _work.take(7)  # the true state at the last assessment
CHECKED_ENERGY = _work.take(2)  # energy and |L|^2 there
IS_STOPPED = _work.take(1)  # whether an event has stopped the member
STOPPED_STATE = _work.take(7)  # the state at the end of the step in which it did
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
SQUARES = _event.take(1)  # sum of the squares of the times between
TIMES = _event.take(2)  # when it first and last happened, exactly
DWELL_START = SQUARES  # of an event that has to last, which needs no squares
# A record: the time of the step's end; of the later end of the bracket how far back it is from
# there, as a fraction of the step, and the level at it; of the earlier end the same; q and L at the
# step's end.
RECORD_ROWS = 12
RECORDS = _event.take(2 * RECORD_ROWS)  # of the first and of the last
EVENT_ROWS = _event.end

# Rows of the shadow trajectory: its state and the remainders of its sums, as of a block up to
# START, then what is known of it.
_shadow = _RowCounter()
_shadow.take(START)
SUMS = _shadow.take(3)  # sums of ln growth, and over steps of (d'/d) s and of Y
WEIGHT = _shadow.take(1)  # 1/|L|^2 of the motion
SHADOW_ROWS = _shadow.end


class RowMap(NamedTuple):
    """First rows, in a block, of what a scene adds to the rows above; `end` is the number of
    rows."""

    effects: int  # parameters of the effects
    works: int  # work of each effect
    good_works: int  # the same at the last good state
    events: int  # EVENT rows for each event
    running: int  # the marks of each running observable
    shadow: int  # SHADOW_ROWS
    end: int

    def in_state(self, row: int) -> int:
        """The row of a state that is a row of a block from BODY on."""
        return row - BODY + BODY_AT


def map_rows(
    parameters: int,
    works: int = 0,
    events: int = 0,
    marks: Sequence[int] = (),
    shadow: bool = False,
) -> RowMap:
    """The RowMap of effects with so many parameters, of which so many works are kept.

    events : how many;  marks : state size of each running observable;  shadow : whether there is a
        shadow trajectory
    """
    counts = parameters, works, works, EVENT_ROWS * events, sum(marks), SHADOW_ROWS * shadow
    return RowMap(*accumulate(counts, initial=EFFECTS))


def monitor_rows(events: Sequence[Any], running: Sequence[Any], shadow: Flag) -> int:
    """How many rows of a block the monitors take; arguments as of
    `rigidmc.engine.program.Program`."""
    rows = map_rows(0, 0, len(events), [len(marks) for _, marks in running], len(shadow) > 0)
    return rows.end - rows.events


_BODY = MassProperties(*[0.0] * 9)


def body_at(rows, row):
    """The MassProperties from nine rows."""
    return tree_unflatten(_BODY, rows, row)


def body_and_effects(effects, work):
    """The MassProperties and the effects with the numbers of the members, from their rows."""
    return body_at(work, MEMBER_ROWS + BODY), tree_unflatten(effects, work, MEMBER_ROWS + EFFECTS)


def opening_substep(substeps, h):
    """(drift, kick, gradient) of row 0 of a StepScheme for a step h: it turns (q, L) into stepping
    form."""
    return substeps[0] * h, substeps[1] * h, substeps[2] * h


def state_at(state, compensated, extra, row):
    """(q, L), L followed by the extra numbers; pairs (value, remainder) if sums keep remainders."""
    if len(compensated) == 0:
        l = concat(three_at(state, MOMENTUM), tuple_at(extra, state, row))
        return four_at(state, ATTITUDE), l
    return (four_at(state, ATTITUDE), four_at(state, EXTRA)), (
        three_at(state, MOMENTUM),
        three_at(state, EXTRA + 4),
    )


def put_state(q, l, state, compensated, row):
    """Write what `state_at` reads."""
    if len(compensated) == 0:
        put_rows(q, state, ATTITUDE)
        put_rows(first_three(l), state, MOMENTUM)
        put_rows(l[3:], state, row)
    else:
        put_rows(q[0], state, ATTITUDE)
        put_rows(q[1], state, EXTRA)
        put_rows(l[0], state, MOMENTUM)
        put_rows(l[1], state, EXTRA + 4)
    return 0


def extra_flags(keeps, work_flags):
    """As many numbers as follow L in a state without remainders, from `extra_row` on.

    They are the extra numbers of the integrator's own state, else the works.
    """
    if len(keeps) == 0:
        return work_flags
    return keeps


def extra_row(keeps, work_row):
    """The row of a state at which the extra numbers begin; work_row : the first row of the
    works."""
    if len(keeps) == 0:
        return work_row
    return EXTRA


def momentum_at(integrator, state):
    """L of a state, followed by what the integrator keeps."""
    return concat(three_at(state, MOMENTUM), tuple_at(extra_state(integrator), state, EXTRA))


def put_stepping(q, l, state):
    """Write a state in the form that the integrator steps; the remainders of sums are 0."""
    put_rows(q + first_three(l), state, ATTITUDE)
    put_rows(extra_numbers(0.0 * l[0], l[3:]), state, EXTRA)
    return 0


def extra_numbers(zero, keeps):
    """The seven numbers after q and L: what the integrator keeps, or no remainders."""
    if len(keeps) == 0:
        return zero, zero, zero, zero, zero, zero, zero
    return keeps


def whole_lanes(count: int) -> int:
    """A number of members rounded up to whole lanes."""
    return LANES * math.ceil(count / LANES)


inline_all(sys.modules[__name__])
