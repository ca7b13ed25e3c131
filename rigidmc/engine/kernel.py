"""The kernel: lanes inside, steps outside. A block of members goes in as rows, and comes out further on in time.

A block is an array (rows, members), members a multiple of LANES: attitude and momentum, what the start was, the drifts,
the last good state, the body, the parameters of the effects. The rows of LANES members at a time are copied to one flat
workspace `work[row*LANES + lane]`: the only arrangement in which LLVM proves that lanes do not touch each other.
"""

import math

import numpy as np

from rigidmc.dynamics.euler import MassProperties, angular_velocity, kinetic_energy
from rigidmc.dynamics.so3 import dot, scale, select, select3, select4, up
from rigidmc.effects.verbs import total_energy, total_energy_scale
from rigidmc.engine.compose import inline, read, read_all
from rigidmc.engine.entries import Compiled
from rigidmc.integrators.verbs import closed, opened, step
from rigidmc.observables.verbs import value

LANES = 32  # 16 to 128 differ by under 3 %; small means little padding
LOOK = 32  # steps between two looks at drift and health: a look each step costs 20 to 25 % of rk4, every 16th up to 5 %

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
_BODY_AT, _REST_AT, _STEP_AT, _STEPS_AT, _EFFECTS_AT = 7, 16, 23, 24, 25
# Rows of the workspace of looks, which is a block's but for these before the effects: the true state, energy and |L|^2, what was found.
_TRUE, _ENERGY, _FOUND, _PRESENT = EFFECTS, EFFECTS + 7, EFFECTS + 9, EFFECTS + 10


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


def record(observables, body, effects, t, q, l, start, out, index, width):
    """Write the values of all observables, one row after the other."""
    if len(observables) == 0:
        return index
    index = put(value(observables[0], body, effects, t, q, l, start), out, index, width)
    return record(observables[1:], body, effects, t, q, l, start, out, index, width)


def state_at(work, k, compensated):
    """(q, L) of lane k, or ((q, remainder), (L, remainder)) where those are kept."""
    if len(compensated) == 0:
        return four_at(work, k, ATTITUDE), three_at(work, k, MOMENTUM)
    return (four_at(work, k, ATTITUDE), four_at(work, k, _REST_AT)), (three_at(work, k, MOMENTUM), three_at(work, k, _REST_AT + 4))


def keep(own, slot, values, work, k, row):
    """Write a tuple to rows of lane k; with steps of their own, where the member has a step in this slot of a round."""
    if len(values) == 0:
        return 0
    at = row * LANES + k
    if len(own) == 0:
        work[at] = values[0]
    else:
        work[at] = select(slot < work[_STEPS_AT * LANES + k], values[0], work[at])
    return keep(own, slot, values[1:], work, k, row + 1)


def put_state(own, slot, q, l, work, k, attitude, compensated):
    """Write what `state_at` reads; the attitude only where it is carried."""
    if len(compensated) == 0:
        if len(attitude) > 0:
            keep(own, slot, q, work, k, ATTITUDE)
        keep(own, slot, l, work, k, MOMENTUM)
    else:
        if len(attitude) > 0:
            keep(own, slot, q[0], work, k, ATTITUDE)
            keep(own, slot, q[1], work, k, _REST_AT)
        keep(own, slot, l[0], work, k, MOMENTUM)
        keep(own, slot, l[1], work, k, _REST_AT + 4)
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
    step = state[_STEP_AT * LANES + k]
    return start + (slot + share) * step, step, scale(step, part)


def seen(own, work, k, now, slots, share, h):
    """(time, step, steps made) of lane k after `now` slots, and `share` of a step."""
    if len(own) == 0:
        return (now + share) * h, h, float(now)
    each = work[STEPS * LANES + k]
    made, step = min(float(now % slots), each), h / each
    return now // slots * h + (made + share) * step, step, now // slots * each + made


def fault(limits, start, scales, q, l, omega, h, energy, squared):
    """The status of a finite member: 0, or the first of the limits that it exceeds; scales = (1/energies in play, L_z(0), 1/largest |L|)."""
    w = scale(h, omega)
    drift, drift2 = abs((energy - start[0]) * scales[0]), abs((squared - start[2]) * start[3])
    drift_z = abs((dot(up(q), l) - scales[1]) * scales[2])
    found = select(drift2 > limits[1], 4.0, select(drift_z > limits[2], 4.0, 0.0))
    found = select(drift > limits[0], 3.0, found)
    found = select(dot(w, w) > limits[3] * limits[3], 5.0, found)
    return select(abs(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3] - 1.0) > limits[4], 6.0, found)


for _function in (four_at, three_at, put, record, state_at, keep, put_state, place, clock, seen, fault):
    inline(_function)
_BODY = MassProperties(*[0.0] * 9)


def _advance(
    integrator, parts, effects, observables, attitude, compensated, precision, own, limits, block, out, width, column, h, slots, first, last,
    stride, total,
):  # fmt: skip
    """Take every member of a block from step `first` to step `last` of `total`.

    integrator, parts : a Form, see `rigidmc.integrators.forms`
    attitude : () where nothing needs the attitude: it is then neither moved nor paid for; (0.0,) otherwise
    compensated : (0.0,) where sums keep their remainders, else ()
    precision : an empty array of the type of number in which steps are made; starts, drifts and saves are float64 always
    own : () where all members make the same steps; else (order,): member i of the block has its values at column order[i]
    limits : () where only non-finite members are flagged; else what else flags them, inf where a scene has no such law: drift of energy
        (of the energies in play), of |L|^2 (of its size) and of L_z (of the largest |L| that the energies allow), |omega| h [rad],
        and ||q|^2 - 1|
    block : (rows, n) as above, changed in place; n a multiple of LANES. Between calls it holds the state as the integrator keeps it
        between steps (`opened`), after step `total` the true one
    out : flat; value row r of save slot s of member m goes to out[(s*R + r)*width + column + m], R = value rows in all
    h : the step; with own steps a round of `slots` steps, of which member m makes the first block[STEPS, m], as long as each other
    stride : steps between saves; save slot = step/stride, and step `total` is always saved
    """
    rows, members = block.shape
    real = precision.dtype.type
    work = np.empty((rows + _PRESENT - EFFECTS) * LANES)
    state = np.empty((_EFFECTS_AT + rows - EFFECTS) * LANES, precision.dtype)
    saves = (total + stride - 1) // stride
    size = out.size // (width * (saves + 1)) if width > 0 else 0
    lead = (parts[0, 0], parts[0, 1], parts[0, 2])
    for low in range(0, members, LANES):
        for i in range(rows):
            at = i if i < EFFECTS else i - EFFECTS + _PRESENT
            for k in range(LANES):
                work[at * LANES + k] = block[i, low + k]
        if first == 0:
            for k in range(LANES):
                body, present = read(_BODY, work, BODY, k, LANES), read_all(effects, work, _PRESENT, k, LANES)
                q, l = four_at(work, k, ATTITUDE), three_at(work, k, MOMENTUM)
                kinetic = kinetic_energy(body, l)
                energy, squared = kinetic + total_energy(present, body, q), dot(l, l)
                in_play = kinetic + total_energy_scale(present, body)
                compared = max(abs(energy), 1e-3 * in_play)
                finite = 0.0 * (energy + squared + q[0] + q[1] + q[2] + q[3]) == 0.0
                work[START * LANES + k] = energy
                work[(START + 1) * LANES + k] = 1.0 / (compared if compared > 0.0 else 1.0)
                work[(START + 2) * LANES + k] = squared
                work[(START + 3) * LANES + k] = 1.0 / (squared if squared > 0.0 else 1.0)
                work[(START + 4) * LANES + k] = 1.0 / (in_play if in_play > 0.0 else 1.0)
                work[_FOUND * LANES + k] = 0.0 if finite else 1.0
            if len(limits) > 0:  # in loops of their own: what is computed beside the state may change how the compiler rounds it
                for k in range(LANES):
                    body = read(_BODY, work, BODY, k, LANES)
                    q, l = four_at(work, k, ATTITUDE), three_at(work, k, MOMENTUM)
                    _, dt, _ = seen(own, work, k, 0, slots, parts[0, 3], h)
                    start, in_play = four_at(work, k, START), work[(START + 4) * LANES + k]
                    largest = math.sqrt(2.0 / (in_play * min(body.i1, body.i2, body.i3)))
                    work[(START + 5) * LANES + k] = dot(up(q), l)
                    work[(START + 6) * LANES + k] = 1.0 / (largest if largest > 0.0 else 1.0)
                    scales = three_at(work, k, START + 4)
                    fast = fault(
                        limits, start, (scales[0], scales[1], 0.0), q, l, angular_velocity(body, l), dt, start[0], start[2]
                    )
                    work[_FOUND * LANES + k] = fast if work[_FOUND * LANES + k] == 0.0 else 1.0
            for k in range(LANES):
                status = work[STATUS * LANES + k]
                status = select(status == 0.0, work[_FOUND * LANES + k], status)
                healthy = status == 0.0
                work[DRIFT * LANES + k] = 0.0 if healthy else math.nan
                work[(DRIFT + 1) * LANES + k] = 0.0 if healthy else math.nan
                work[STATUS * LANES + k] = status
                work[GOOD_STEP * LANES + k] = 0.0
                work[FAULT_STEP * LANES + k] = -1.0 if healthy else 0.0
            if size > 0:
                for k in range(LANES):
                    body, present = read(_BODY, work, BODY, k, LANES), read_all(effects, work, _PRESENT, k, LANES)
                    q, l = four_at(work, k, ATTITUDE), three_at(work, k, MOMENTUM)
                    record(observables, body, present, 0.0, q, l, four_at(work, k, START), out, column + place(own, low + k), width)
            for k in range(LANES):
                body, present = read(_BODY, work, BODY, k, LANES), read_all(effects, work, _PRESENT, k, LANES)
                q, l = four_at(work, k, ATTITUDE), three_at(work, k, MOMENTUM)
                put(q, work, GOOD * LANES + k, LANES)
                put(l, work, (GOOD + 4) * LANES + k, LANES)
                t, dt, _ = seen(own, work, k, 0, slots, parts[0, 3], h)
                q, l = opened(integrator, body, present, t, scale(dt, lead), q, l)
                put(q, work, ATTITUDE * LANES + k, LANES)
                put(l, work, MOMENTUM * LANES + k, LANES)
        for i in range(rows):
            at = (
                i
                if i < REST
                else i - REST + _REST_AT
                if i < START
                else i - BODY + _BODY_AT
                if i < EFFECTS
                else i - EFFECTS + _EFFECTS_AT
            )
            if i < START or i >= BODY:
                for k in range(LANES):
                    state[at * LANES + k] = work[(i if i < EFFECTS else i - EFFECTS + _PRESENT) * LANES + k]
        busy, unit = 1.0, h  # steps of the member that makes most in a round; what the parts are given in
        if len(own) > 0:
            unit = 1.0
            for k in range(LANES):
                busy = max(busy, work[STEPS * LANES + k])
                state[_STEP_AT * LANES + k] = h / work[STEPS * LANES + k]
                state[_STEPS_AT * LANES + k] = work[STEPS * LANES + k]
        now = first
        while now < last:
            begun = now // slots * slots if len(own) > 0 else 0  # of the round; without own steps there is one
            stop = min(last, begun + ((now - begun) // LOOK + 1) * LOOK, (now // stride + 1) * stride)
            if len(own) > 0:
                stop = min(stop, begun + slots)
            start = real(begun // slots * h) if len(own) > 0 else real(0.0)
            for s in range(now, min(stop, begun + int(busy)) if len(own) > 0 else stop):
                for p in range(1, parts.shape[0]):
                    shares = (real(parts[p, 0] * unit), real(parts[p, 1] * unit), real(parts[p, 2] * unit))
                    slot, share, now_t, dt = real(s - begun), real(parts[p, 3]), real((s + parts[p, 3]) * h), real(h)
                    for k in range(LANES):  # the loop that must vectorise
                        body = read(_BODY, state, _BODY_AT, k, LANES)
                        present = read_all(effects, state, _EFFECTS_AT, k, LANES)
                        q, l = state_at(state, k, compensated)
                        t, by, part = clock(own, state, k, start, slot, share, now_t, dt, shares)
                        q, l = step(integrator, body, present, t, by, part, q, l)
                        put_state(own, slot, q, l, state, k, attitude, compensated)
            now = stop
            looked = (now - begun) % LOOK == 0 and (len(own) == 0 or now - begun < slots)
            if looked or now % stride == 0 or now == total:  # not where a call ends: no result depends on calls
                for i in range(REST):
                    for k in range(LANES):
                        work[i * LANES + k] = state[i * LANES + k]
                if len(compensated) > 0:  # in float32 the remainders are seen in float64
                    for i in range(REST):
                        for k in range(LANES):
                            work[i * LANES + k] += state[(_REST_AT + i) * LANES + k]
                for k in range(LANES):  # look
                    body, present = read(_BODY, work, BODY, k, LANES), read_all(effects, work, _PRESENT, k, LANES)
                    q, l = four_at(work, k, ATTITUDE), three_at(work, k, MOMENTUM)
                    t, dt, _ = seen(own, work, k, now, slots, parts[0, 3], h)
                    true_q, true_l = closed(integrator, body, present, t, scale(dt, lead), q, l)
                    energy, squared = kinetic_energy(body, true_l) + total_energy(present, body, true_q), dot(true_l, true_l)
                    finite = 0.0 * (energy + squared + q[0] + q[1] + q[2] + q[3]) == 0.0
                    put(true_q, work, _TRUE * LANES + k, LANES)
                    put(true_l, work, (_TRUE + 4) * LANES + k, LANES)
                    work[_ENERGY * LANES + k], work[(_ENERGY + 1) * LANES + k] = energy, squared
                    work[_FOUND * LANES + k] = 0.0 if finite else 1.0
                if len(limits) > 0:
                    for k in range(LANES):
                        body, q, l = read(_BODY, work, BODY, k, LANES), four_at(work, k, _TRUE), three_at(work, k, _TRUE + 4)
                        _, dt, _ = seen(own, work, k, now, slots, parts[0, 3], h)
                        energy, squared = work[_ENERGY * LANES + k], work[(_ENERGY + 1) * LANES + k]
                        start, scales = four_at(work, k, START), three_at(work, k, START + 4)
                        status = fault(limits, start, scales, q, l, angular_velocity(body, l), dt, energy, squared)
                        work[_FOUND * LANES + k] = status if work[_FOUND * LANES + k] == 0.0 else 1.0
                for k in range(LANES):  # drifts so far; a member that is not ok stays at its last good state
                    start, before, now_found = four_at(work, k, START), work[STATUS * LANES + k], work[_FOUND * LANES + k]
                    energy, squared = work[_ENERGY * LANES + k], work[(_ENERGY + 1) * LANES + k]
                    _, _, made = seen(own, work, k, now, slots, parts[0, 3], h)
                    drift, drift2 = abs((energy - start[0]) * start[1]), abs((squared - start[2]) * start[3])
                    was, counted = before == 0.0, (before == 0.0) & (now_found != 1.0)  # the drift that flagged a member is told
                    healthy = was & (now_found == 0.0)
                    old, old2 = work[DRIFT * LANES + k], work[(DRIFT + 1) * LANES + k]
                    work[DRIFT * LANES + k] = (drift if drift > old else old) if counted else old
                    work[(DRIFT + 1) * LANES + k] = (drift2 if drift2 > old2 else old2) if counted else old2
                    work[STATUS * LANES + k] = now_found if was else before
                    work[GOOD_STEP * LANES + k] = made if healthy else work[GOOD_STEP * LANES + k]
                    work[FAULT_STEP * LANES + k] = made if was & (now_found > 0.0) else work[FAULT_STEP * LANES + k]
                    put(select4(healthy, four_at(work, k, _TRUE), four_at(work, k, GOOD)), work, GOOD * LANES + k, LANES)
                    put(
                        select3(healthy, three_at(work, k, _TRUE + 4), three_at(work, k, GOOD + 4)),
                        work,
                        (GOOD + 4) * LANES + k,
                        LANES,
                    )
                for i in range(REST):
                    for k in range(LANES):
                        frozen, good = work[STATUS * LANES + k] > 0.0, real(work[(GOOD + i) * LANES + k])
                        state[i * LANES + k] = good if frozen else state[i * LANES + k]
                        state[(_REST_AT + i) * LANES + k] = real(0.0) if frozen else state[(_REST_AT + i) * LANES + k]
            if size > 0 and (now % stride == 0 or now == total):
                at = saves if now == total else now // stride
                base = at * size * width + column
                for k in range(LANES):
                    body, present = read(_BODY, work, BODY, k, LANES), read_all(effects, work, _PRESENT, k, LANES)
                    q, l = four_at(work, k, GOOD), three_at(work, k, GOOD + 4)
                    record(
                        observables,
                        body,
                        present,
                        now // slots * h,
                        q,
                        l,
                        four_at(work, k, START),
                        out,
                        base + place(own, low + k),
                        width,
                    )
        for i in range(REST):
            for k in range(LANES):
                work[i * LANES + k] = state[i * LANES + k]
                work[(REST + i) * LANES + k] = state[(_REST_AT + i) * LANES + k]
        if last == total:
            for i in range(REST):
                for k in range(LANES):
                    work[i * LANES + k] = work[(GOOD + i) * LANES + k]
        for i in range(rows):
            for k in range(LANES):
                block[i, low + k] = work[(i if i < EFFECTS else i - EFFECTS + _PRESENT) * LANES + k]


_compiled = Compiled(_advance)
dispatcher, entry = _compiled.dispatcher, _compiled.entry


def advance(*arguments):
    """Run the kernel; see `_advance` for the arguments."""
    return _compiled(*arguments)
