"""How numbers lie: the rows of a block, of a member's state, and of what is known of a member.

The one file with places of numbers. A block is an array (rows, members), members a multiple of
LANES. Some members at a time have their rows copied, side by side, to two flat workspaces:
`state`, in the precision of the run, for steps, and `work`, in float64, for looks and for what is
watched. To a member's program they are rows of one number each.
"""

import math
import sys
from collections.abc import Sequence
from itertools import accumulate
from typing import Any, NamedTuple

from rigidmc.engine.compiler.compose import inline_all
from rigidmc.engine.compiler.memory import four_at, put, three_at, tuple_at
from rigidmc.engine.compiler.trees import filled
from rigidmc.physics.dynamics.euler import MassProperties
from rigidmc.physics.dynamics.methods import Flag
from rigidmc.physics.dynamics.so3 import first_three, joined
from rigidmc.physics.integrators.protocol import keeps

LANES = 32  # members of a block are a multiple of this: the most that are worked on side by side
# Members of a block of a run: their 30 to 40 rows are 1 MB, and a call on them takes 10 ms or more.
# With 4096 all rows would compete for one place in the cache, and a block would begin and end in
# 64 ns a member, not 47.
BLOCK = 4064


class _Table:
    """Rows of memory, taken one part after the other."""

    def __init__(self) -> None:
        self.end = 0

    def take(self, count: int) -> int:
        """The first of the next `count` rows."""
        self.end += count
        return self.end - count


# Rows of a block. After them come the parameters of the effects, their works, and what is watched:
# see `Places`.
_block = _Table()
ATTITUDE = _block.take(4)  # a quaternion
MOMENTUM = _block.take(3)
REST = _block.take(7)  # remainders of the sums of both, or what the integrator keeps instead
# of the start: energy, what it is compared with, |L|^2, energies in play, L_z, largest |L|^2 that
# these allow; and the largest kinetic energies since, at planned looks and at all of them, see
# `rigidmc.engine.kernel.member.fastest`
START = _block.take(8)
DRIFT = _block.take(2)  # largest drifts of energy and of |L|^2 so far
STATUS = _block.take(1)  # see STATUSES
GOOD_STEP = _block.take(1)  # step of the last good state
FAULT_STEP = _block.take(1)  # step at which the member was found not to be ok
EARLY = _block.take(2)  # largest drifts of energy and of |L|^2 in the first half of the run
LEAST = _block.take(2)  # smallest drifts of both in the second half
GOOD = _block.take(7)  # the last good state: attitude and momentum
STEPS = _block.take(1)  # steps of the member in a round, see `rigidmc.engine.kernel.arguments.Run`
BODY = _block.take(9)  # a MassProperties
EFFECTS = _block.end

# The first thing that went wrong. A member that is not ok on entry stays frozen from the start.
STATUSES = {
    "ok": 0, "non_finite": 1, "invalid_input": 2, "energy_drift": 3, "momentum_drift": 4,
    "step_too_large": 5, "off_unit_quaternion": 6,
}  # fmt: skip

# Rows of a state: those of a block up to START, then those from BODY on.
BODY_AT, EFFECTS_AT = START, START + EFFECTS - BODY

# Rows of `work`: what is known of a member; from KNOWN on, the rows of its block.
_work = _Table()
TRUE = _work.take(7)  # the true state at the last look
ENERGY = _work.take(2)  # energy and |L|^2 there
STOPPED = _work.take(1)  # whether an event has stopped the member
HELD = _work.take(7)  # the state at which an event has stopped it
EACH = _work.take(1)  # its number of steps in a round
BEGAN = _work.take(1)  # when the round began
LENGTH = _work.take(1)  # the length of its steps
INDEX = _work.take(1)  # the bits of its index
KNOWN = _work.end

# Rows of an event.
_event = _Table()
LEVEL = _event.take(1)  # the level after the last step, 0 if the event cannot happen next
COUNT = _event.take(1)  # how often it has happened
TAU = _event.take(1)  # when it last happened, by linear interpolation
FIRST_TAU = _event.take(1)  # when it first happened, by linear interpolation
SQUARES = _event.take(1)  # sum of the squares of the times between
TIMES = _event.take(2)  # when it first and last happened, exactly
SINCE = SQUARES  # of an event that has to last: see `rigidmc.engine.kernel.events`
# time of the step's end; the ends between which the level passes through 0 as parts of a step back
# from there, and the levels at them, the later end first; the state at the step's end
RECORD = 12
RECORDS = _event.take(2 * RECORD)  # of the first and of the last
EVENT = _event.end

# Rows of the neighbour, after 14 of its state and the remainders of its sums.
_neighbour = _Table()
_neighbour.take(START)
SUMS = _neighbour.take(3)  # sums of ln growth, and over steps of (d'/d) s and of Y
WEIGHT = _neighbour.take(1)  # 1/|L|^2 of the motion
SHADOW = _neighbour.end


class Places(NamedTuple):
    """First rows, in a block, of what a scene adds to the rows above; `end` is their number."""

    effects: int  # parameters of the effects
    works: int  # work of each effect
    good_works: int  # the same at the last good state
    events: int  # EVENT rows for each event
    running: int  # the marks of each running observable
    neighbour: int  # SHADOW rows
    end: int

    def in_state(self, row: int) -> int:
        """The row of a state that is a row of a block from BODY on."""
        return row - BODY + BODY_AT


def places(
    parameters: int,
    works: int = 0,
    events: int = 0,
    marks: Sequence[int] = (),
    shadow: bool = False,
) -> Places:
    """The Places of effects with so many parameters, of which so many works are kept.

    events : how many;  marks : of each running observable;  shadow : whether there is a neighbour
    """
    counts = parameters, works, works, EVENT * events, sum(marks), SHADOW * shadow
    return Places(*accumulate(counts, initial=EFFECTS))


def watch_rows(events: Sequence[Any], running: Sequence[Any], shadow: Flag) -> int:
    """How many rows of a block are watched; events, running, shadow : as `Program` takes them."""
    watched = places(0, 0, len(events), [len(marks) for _, marks in running], len(shadow) > 0)
    return watched.end - watched.events


_BODY = MassProperties(*[0.0] * 9)


def body_at(rows, row):
    """The MassProperties from nine rows."""
    return filled(_BODY, rows, row)


def state_at(state, compensated, more, row):
    """(q, L), L followed by `more_of`; ((q, remainder), (L, remainder)) if sums keep remainders."""
    if len(compensated) == 0:
        l = joined(three_at(state, MOMENTUM), tuple_at(more, state, row))
        return four_at(state, ATTITUDE), l
    return (four_at(state, ATTITUDE), four_at(state, REST)), (
        three_at(state, MOMENTUM),
        three_at(state, REST + 4),
    )


def put_state(q, l, state, compensated, row):
    """Write what `state_at` reads."""
    if len(compensated) == 0:
        put(q, state, ATTITUDE)
        put(first_three(l), state, MOMENTUM)
        put(l[3:], state, row)
    else:
        put(q[0], state, ATTITUDE)
        put(q[1], state, REST)
        put(l[0], state, MOMENTUM)
        put(l[1], state, REST + 4)
    return 0


def more_of(keeps, ledger):
    """Marks of what follows L in a state without remainders, from `more_row` on.

    It is what the integrator keeps, else the works.
    """
    if len(keeps) == 0:
        return ledger
    return keeps


def more_row(keeps, works):
    """The row of a state at which `more_of` begins; works : the first row of the works."""
    if len(keeps) == 0:
        return works
    return REST


def momentum_at(integrator, state):
    """L of a state, followed by what the integrator keeps."""
    return joined(three_at(state, MOMENTUM), tuple_at(keeps(integrator), state, REST))


def put_opened(q, l, state):
    """Write a state that an integrator has opened; the remainders of sums are 0."""
    put(q + first_three(l), state, ATTITUDE)
    put(rest_of(0.0 * l[0], l[3:]), state, REST)
    return 0


def rest_of(zero, keeps):
    """The seven numbers after q and L: what the integrator keeps, or no remainders."""
    if len(keeps) == 0:
        return zero, zero, zero, zero, zero, zero, zero
    return keeps


def whole_lanes(count: int) -> int:
    """A number of members rounded up to whole lanes."""
    return LANES * math.ceil(count / LANES)


inline_all(sys.modules[__name__])
