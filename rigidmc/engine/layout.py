"""How numbers lie: the rows of a block and of the two workspaces, and how a lane reads and writes them.

A block is an array (rows, members), members a multiple of LANES: attitude and momentum, what the start was, the drifts,
the last good state, the body, the parameters of the effects. The rows of LANES members at a time are copied to flat
workspaces `work[row*LANES + lane]`: the only arrangement in which LLVM proves that lanes do not touch each other.
"""

import numpy as np

from rigidmc.dynamics.so3 import first_three, joined, scale, select
from rigidmc.engine.compose import inline
from rigidmc.observables.verbs import value

LANES = 32  # 16 to 128 differ by under 3 %; small means little padding
LINE = 64  # bytes of a cache line, and of the widest vectors

# rows of a block
ATTITUDE, MOMENTUM, REST, START, DRIFT, STATUS, GOOD_STEP, FAULT_STEP, GOOD, STEPS, BODY, EFFECTS = (
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
# Rows of what a step reads and writes, in the precision of the run: attitude 0, momentum 4, body, remainders, effects. Rows 16 apart are
# 4096 bytes apart, where a load waits for a store that it does not depend on: with the body on rows 16 to 22 rk4 was 12 % slower.
BODY_AT, REST_AT, STEP_AT, STEPS_AT, EFFECTS_AT = 7, 16, 23, 24, 25
# Rows of the workspace of looks, which is a block's but for these before the effects: the true state, energy and |L|^2, what was found,
# the bits of the member's index where there is noise, and whether an event has stopped it. Deviates pass through the rows of the true state.
TRUE, ENERGY, FOUND, MEMBER, STOPPED, PRESENT = EFFECTS, EFFECTS + 7, EFFECTS + 9, EFFECTS + 10, EFFECTS + 11, EFFECTS + 12


# After the rows of the effects, where works are kept: one row for that of each effect, and one for what it was at the last good state.


def aligned(count, dtype):
    """An array on a cache line: half of all are 32 bytes off it, where every vector of 512 bits takes two accesses (rk4 with gravity: 5.1 ns a
    step in place of 4.6)."""
    whole = np.empty(count + LINE // 4, dtype)
    off = (-whole.ctypes.data % LINE) // whole.itemsize
    return whole[off : off + count]


def in_work(row):
    """Where a row of a block is in the workspace of looks."""
    return row if row < EFFECTS else row - EFFECTS + PRESENT


def in_state(row):
    """Where a row of a block is in the workspace of steps, which has neither starts nor drifts."""
    if row < REST:
        return row
    if row < START:
        return row - REST + REST_AT
    return row - BODY + BODY_AT if row < EFFECTS else row - EFFECTS + EFFECTS_AT


def four_at(work, k, row):
    """Four numbers of lane k from four rows."""
    return work[row * LANES + k], work[(row + 1) * LANES + k], work[(row + 2) * LANES + k], work[(row + 3) * LANES + k]


def three_at(work, k, row):
    """Three numbers of lane k from three rows."""
    return work[row * LANES + k], work[(row + 1) * LANES + k], work[(row + 2) * LANES + k]


def put(values, out, index, width):
    """Write a tuple to out[index], out[index + width], ..."""
    if len(values) == 0:
        return index
    out[index] = values[0]
    return put(values[1:], out, index + width, width)


def record(observables, body, effects, t, q, l, start, works, out, index, width):
    """Write the values of all observables, one row after the other."""
    if len(observables) == 0:
        return index
    index = put(value(observables[0], body, effects, t, q, l, start, works), out, index, width)
    return record(observables[1:], body, effects, t, q, l, start, works, out, index, width)


def tuple_at(marks, work, k, row):
    """Numbers of lane k from as many rows as there are marks."""
    if len(marks) == 0:
        return ()
    return (work[row * LANES + k],) + tuple_at(marks[1:], work, k, row + 1)


def state_at(work, k, compensated, ledger, works):
    """(q, L) of lane k, the works of the effects after L where they are kept; or ((q, remainder), (L, remainder)) where those are kept."""
    if len(compensated) == 0:
        return four_at(work, k, ATTITUDE), joined(three_at(work, k, MOMENTUM), tuple_at(ledger, work, k, works))
    return (four_at(work, k, ATTITUDE), four_at(work, k, REST_AT)), (three_at(work, k, MOMENTUM), three_at(work, k, REST_AT + 4))


def keep(own, slot, values, work, k, row):
    """Write a tuple to rows of lane k; with steps of their own, where the member has a step in this slot of a round."""
    if len(values) == 0:
        return 0
    at = row * LANES + k
    if len(own) == 0:
        work[at] = values[0]
    else:
        work[at] = select(slot < work[STEPS_AT * LANES + k], values[0], work[at])
    return keep(own, slot, values[1:], work, k, row + 1)


def put_state(own, slot, q, l, work, k, attitude, compensated, works):
    """Write what `state_at` reads; the attitude only where it is carried."""
    if len(compensated) == 0:
        if len(attitude) > 0:
            keep(own, slot, q, work, k, ATTITUDE)
        keep(own, slot, first_three(l), work, k, MOMENTUM)
        keep(own, slot, l[3:], work, k, works)
    else:
        if len(attitude) > 0:
            keep(own, slot, q[0], work, k, ATTITUDE)
            keep(own, slot, q[1], work, k, REST_AT)
        keep(own, slot, l[0], work, k, MOMENTUM)
        keep(own, slot, l[1], work, k, REST_AT + 4)
    return 0


def place(own, index):
    """The column of values of the member at `index` of the block."""
    if len(own) == 0:
        return index
    return own[0][index]


def clock(own, state, k, start, slot, share, t, h, part):
    """(time, step, parts of it) of lane k: t, h and part, or with steps of its own at slot + share of a round that began at `start`."""
    if len(own) == 0:
        return t, h, part
    step = state[STEP_AT * LANES + k]
    return start + (slot + share) * step, step, scale(step, part)


def seen(own, work, k, now, slots, share, h):
    """(time, step, steps made) of lane k after `now` slots, and `share` of a step."""
    if len(own) == 0:
        return (now + share) * h, h, float(now)
    each = work[STEPS * LANES + k]
    made, step = min(float(now % slots), each), h / each
    return now // slots * h + (made + share) * step, step, now // slots * each + made


for _function in (
    aligned,
    in_work,
    in_state,
    four_at,
    three_at,
    put,
    record,
    tuple_at,
    state_at,
    keep,
    put_state,
    place,
    clock,
    seen,
):
    inline(_function)
