"""How numbers lie: the rows of a block, of a member's state and of what is known of it; the one file with places of numbers.

A block is an array (rows, members), members a multiple of LANES: attitude and momentum, what the start was, the drifts, the last good state, the body,
the parameters of the effects, their works, and what is watched. Some members at a time have their rows copied, side by side, to two flat workspaces:
`state`, in the precision of the run, for steps, and `work`, in float64, for looks. To a member's program they are rows of one number each.
"""

import math

from rigidmc.dynamics.euler import MassProperties
from rigidmc.dynamics.so3 import first_three, joined
from rigidmc.engine.compose import filled, inline
from rigidmc.engine.memory import four_at, put, three_at, tuple_at

LANES = 32  # what a block's members are a multiple of: the most that are worked on at once

# rows of a block
(
    ATTITUDE,
    MOMENTUM,
    REST,
    START,
    DRIFT,
    STATUS,
    GOOD_STEP,
    FAULT_STEP,
    GOOD,
    STEPS,
    BODY,
    EFFECTS,
) = (
    0,
    4,
    7,
    14,
    21,
    23,
    24,
    25,
    26,
    33,
    34,
    43,
)
# the STATUS row: the first thing that went wrong; what is not ok on entry stays frozen from the start
STATUSES = {
    "ok": 0, "non_finite": 1, "invalid_input": 2, "energy_drift": 3, "momentum_drift": 4, "step_too_large": 5, "off_unit_quaternion": 6,
}  # fmt: skip
# rows of a state: those of a block up to START, then those from BODY on
BODY_AT, EFFECTS_AT = START, START + EFFECTS - BODY
# Rows of what is known of a member: its true state, and energy and |L|^2 there; whether an event has stopped it, and the state at which; how many
# steps of a round are its own; when the round began, and the length of its steps; the bits of its index. Then those of a block.
TRUE, ENERGY, STOPPED, HELD, EACH, BEGAN, LENGTH, INDEX, KNOWN = 0, 7, 9, 10, 17, 18, 19, 20, 21
# After the rows of the effects, where works are kept: one row for that of each effect, and one for what it was at the last good state.

_BODY = MassProperties(*[0.0] * 9)


def body_at(rows, row):
    """The MassProperties from nine rows."""
    return filled(_BODY, rows, row)


def state_at(state, compensated, more, row):
    """(q, L), with what follows L, see `more_of`; or ((q, remainder), (L, remainder)) where those are kept."""
    if len(compensated) == 0:
        return four_at(state, ATTITUDE), joined(
            three_at(state, MOMENTUM), tuple_at(more, state, row)
        )
    return (four_at(state, ATTITUDE), four_at(state, REST)), (
        three_at(state, MOMENTUM),
        three_at(state, REST + 4),
    )


def more_of(keeps, ledger):
    """What follows L in a state without remainders: what the integrator keeps, else the works of the effects; `more_row` is where it lies."""
    if len(keeps) == 0:
        return ledger
    return keeps


def more_row(keeps, works):
    """See `more_of`; works : the first row of the works."""
    if len(keeps) == 0:
        return works
    return REST


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


def whole_lanes(count):
    """A number of members rounded up to whole lanes."""
    return LANES * math.ceil(count / LANES)


for _function in (body_at, more_of, more_row, state_at, put_state):
    inline(_function)
