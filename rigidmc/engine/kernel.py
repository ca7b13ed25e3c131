"""The kernel: lanes inside, steps outside. A block of members goes in as rows, and comes out further on in time.

A block is an array (rows, members), members a multiple of LANES: attitude and momentum, what the start was, the drifts,
the last good state, the body, the parameters of the effects. The rows of LANES members at a time are copied to one flat
workspace `work[row*LANES + lane]`: the only arrangement in which LLVM proves that lanes do not touch each other.
"""

import math

import numpy as np

from rigidmc.dynamics.euler import MassProperties, kinetic_energy
from rigidmc.dynamics.so3 import dot
from rigidmc.effects.verbs import total_energy, total_energy_scale
from rigidmc.engine.compose import inline, read, read_all
from rigidmc.engine.entries import Compiled
from rigidmc.integrators.verbs import step
from rigidmc.observables.verbs import value

LANES = 32  # 16 to 128 differ by under 3 %; small means little padding
LOOK = 32  # steps between two looks at drift and health: a look each step costs 20 to 25 % of rk4, every 16th up to 5 %

# rows of a block
ATTITUDE, MOMENTUM, START, DRIFT, STATUS, GOOD_STEP, GOOD, BODY, EFFECTS = 0, 4, 7, 11, 13, 14, 15, 22, 31
STATUSES = {"ok": 0, "non_finite": 1, "invalid_body": 2}  # the STATUS row; what is not ok on entry stays frozen from the start


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


for _function in (four_at, three_at, put, record):
    inline(_function)
_BODY = MassProperties(*[0.0] * 9)


def _advance(integrator, effects, observables, attitude, block, out, width, column, h, first, last, stride, total):
    """Take every member of a block from step `first` to step `last` of `total`.

    attitude : () where nothing needs the attitude: it is then neither moved nor paid for; (0.0,) otherwise
    block : (rows, n) as above, changed in place; n a multiple of LANES
    out : flat; value row r of save slot s of member m goes to out[(s*R + r)*width + column + m], R = value rows in all
    stride : steps between saves; slot = step/stride, and step `total` is always saved
    """
    rows, members = block.shape
    work = np.empty(rows * LANES)
    slots = (total + stride - 1) // stride
    size = out.size // (width * (slots + 1)) if width > 0 else 0
    for low in range(0, members, LANES):
        for i in range(rows):
            for k in range(LANES):
                work[i * LANES + k] = block[i, low + k]
        if first == 0:
            for k in range(LANES):
                body, present = read(_BODY, work, BODY, k, LANES), read_all(effects, work, EFFECTS, k, LANES)
                q, l = four_at(work, k, ATTITUDE), three_at(work, k, MOMENTUM)
                kinetic = kinetic_energy(body, l)
                energy, squared = kinetic + total_energy(present, body, q), dot(l, l)
                scale = max(abs(energy), 1e-3 * (kinetic + total_energy_scale(present, body)))
                finite = 0.0 * (energy + squared + q[0] + q[1] + q[2] + q[3]) == 0.0
                healthy = finite & (work[STATUS * LANES + k] == 0.0)
                work[START * LANES + k] = energy
                work[(START + 1) * LANES + k] = 1.0 / (scale if scale > 0.0 else 1.0)
                work[(START + 2) * LANES + k] = squared
                work[(START + 3) * LANES + k] = 1.0 / (squared if squared > 0.0 else 1.0)
                work[DRIFT * LANES + k] = 0.0 if healthy else math.nan
                work[(DRIFT + 1) * LANES + k] = 0.0 if healthy else math.nan
                work[STATUS * LANES + k] = max(work[STATUS * LANES + k], 0.0 if finite else 1.0)
                work[GOOD_STEP * LANES + k] = 0.0
                for i in range(7):
                    work[(GOOD + i) * LANES + k] = work[(ATTITUDE + i) * LANES + k]
            if size > 0:
                for k in range(LANES):
                    body, present = read(_BODY, work, BODY, k, LANES), read_all(effects, work, EFFECTS, k, LANES)
                    q, l = four_at(work, k, ATTITUDE), three_at(work, k, MOMENTUM)
                    record(observables, body, present, 0.0, q, l, four_at(work, k, START), out, column + low + k, width)
        now = first
        while now < last:
            stop = min(last, (now // LOOK + 1) * LOOK, (now // stride + 1) * stride)
            for s in range(now, stop):
                t = s * h
                for k in range(LANES):  # the loop that must vectorise
                    body, present = read(_BODY, work, BODY, k, LANES), read_all(effects, work, EFFECTS, k, LANES)
                    q, l = four_at(work, k, ATTITUDE), three_at(work, k, MOMENTUM)
                    q, l = step(integrator, body, present, t, h, q, l)
                    if len(attitude) > 0:
                        put(q, work, ATTITUDE * LANES + k, LANES)
                    put(l, work, MOMENTUM * LANES + k, LANES)
            now = stop
            if now % LOOK == 0 or now % stride == 0 or now == total:  # not where a call ends: no result depends on calls
                for k in range(LANES):  # look: drift, and a member that turned non-finite goes back to its last good state
                    body, present = read(_BODY, work, BODY, k, LANES), read_all(effects, work, EFFECTS, k, LANES)
                    q, l = four_at(work, k, ATTITUDE), three_at(work, k, MOMENTUM)
                    good_q, good_l = four_at(work, k, GOOD), three_at(work, k, GOOD + 4)
                    energy, squared = kinetic_energy(body, l) + total_energy(present, body, q), dot(l, l)
                    finite = 0.0 * (energy + squared + q[0] + q[1] + q[2] + q[3]) == 0.0
                    healthy = finite & (work[STATUS * LANES + k] == 0.0)
                    start = four_at(work, k, START)
                    drift, drift2 = abs((energy - start[0]) * start[1]), abs((squared - start[2]) * start[3])
                    old, old2 = work[DRIFT * LANES + k], work[(DRIFT + 1) * LANES + k]
                    work[DRIFT * LANES + k] = (drift if drift > old else old) if healthy else old
                    work[(DRIFT + 1) * LANES + k] = (drift2 if drift2 > old2 else old2) if healthy else old2
                    work[STATUS * LANES + k] = max(work[STATUS * LANES + k], 0.0 if finite else 1.0)
                    work[GOOD_STEP * LANES + k] = float(now) if healthy else work[GOOD_STEP * LANES + k]
                    q = (
                        q[0] if healthy else good_q[0],
                        q[1] if healthy else good_q[1],
                        q[2] if healthy else good_q[2],
                        q[3] if healthy else good_q[3],
                    )
                    l = (l[0] if healthy else good_l[0], l[1] if healthy else good_l[1], l[2] if healthy else good_l[2])
                    put(q, work, ATTITUDE * LANES + k, LANES)
                    put(l, work, MOMENTUM * LANES + k, LANES)
                    put(q, work, GOOD * LANES + k, LANES)
                    put(l, work, (GOOD + 4) * LANES + k, LANES)
            if size > 0 and (now % stride == 0 or now == total):
                slot = slots if now == total else now // stride
                base = slot * size * width + column + low
                for k in range(LANES):
                    body, present = read(_BODY, work, BODY, k, LANES), read_all(effects, work, EFFECTS, k, LANES)
                    q, l = four_at(work, k, ATTITUDE), three_at(work, k, MOMENTUM)
                    record(observables, body, present, now * h, q, l, four_at(work, k, START), out, base + k, width)
        for i in range(rows):
            for k in range(LANES):
                block[i, low + k] = work[i * LANES + k]


_compiled = Compiled(_advance)
dispatcher, entry = _compiled.dispatcher, _compiled.entry


def advance(*arguments):
    """Run the kernel; see `_advance` for the arguments."""
    return _compiled(*arguments)
