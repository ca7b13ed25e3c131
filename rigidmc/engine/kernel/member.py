"""The life of one member: it enters, begins, is looked at, is recorded, and leaves.

Between looks it makes steps (`rigidmc.engine.kernel.march`). Written for one number and compiled
for vectors of them (`rigidmc.engine.compiler.vector_types`), so that several members live it side
by side; uncompiled it runs on floats. The functions enter, leave, begin, look and record are
pieces: each is compiled by itself and called by `rigidmc.engine.kernel.block`, so that another
observable compiles `record` alone.

kinds, numbers : what the piece is compiled for, and its numbers, see
    `rigidmc.engine.compiler.trees`
parts : those of a Form, see `rigidmc.physics.integrators.protocol`, flat
state, work : rows, see `rigidmc.engine.kernel.layout`
"""

import math
import sys

from rigidmc.engine.compiler.compose import inline_all
from rigidmc.engine.compiler.intrinsics import in_precision, like
from rigidmc.engine.compiler.memory import four_at, load, put, spread, store, three_at, tuple_at
from rigidmc.engine.compiler.trees import filled, parts_of, row_count
from rigidmc.engine.kernel.layout import (  # fmt: skip
    ATTITUDE,
    BEGAN,
    BODY,
    BODY_AT,
    DRIFT,
    EACH,
    EARLY,
    EFFECTS,
    EFFECTS_AT,
    FAULT_STEP,
    GOOD,
    GOOD_STEP,
    HELD,
    KNOWN,
    LEAST,
    LENGTH,
    MOMENTUM,
    REST,
    START,
    STATUS,
    STEPS,
    STOPPED,
    TRUE,
    body_at,
    more_of,
    more_row,
)
from rigidmc.physics.dynamics.euler import angular_velocity, kinetic_energy
from rigidmc.physics.dynamics.so3 import (
    dot,
    first_three,
    inverse,
    joined,
    larger,
    scale,
    select,
    select_each,
    up,
)
from rigidmc.physics.effects.sums import (
    booked,
    gross,
    marked,
    spent,
    total_energy,
    total_energy_scale,
)
from rigidmc.physics.integrators.protocol import closed, keeps, opened
from rigidmc.physics.observables.protocol import value

ALWAYS = 1e300  # steps of a round, of members without a number of their own


def enter(kinds, numbers, block, rows, members, low, member_steps, h, round_time, state, work):
    """Bring the rows of the members from `low` on side by side, from a block (rows, members).

    member_steps : whether members have steps of their own, which then divide a round of length h
    round_time : when the round began
    """
    for i in range(rows):
        x = load(work, block, i * members + low)
        work[KNOWN + i] = x
        if i < START:
            state[i] = like(x, state)
        if i >= BODY:
            state[BODY_AT + i - BODY] = like(x, state)
    each = load(work, block, STEPS * members + low) if member_steps != 0 else like(ALWAYS, work)
    work[EACH] = each
    work[LENGTH] = h / each if member_steps != 0 else like(h, work)
    work[BEGAN] = like(round_time, work)
    work[STOPPED] = like(0.0, work)
    return 0


def leave(kinds, numbers, block, rows, members, low, works, works_at, near, done, state, work):
    """Put the rows of the members from `low` on back; if the run is done, with the last good state.

    works : how many, in the rows from `works_at` of the block on, followed by the last good ones
    near : the first row of the neighbour, after those of what is watched
    """
    for i in range(rows):
        at = i * members + low
        if i < START:
            x = work[KNOWN + GOOD + i] if (done != 0 and i < REST) else like(state[i], work)
            store(block, at, x)
        elif i < BODY:
            store(block, at, work[KNOWN + i])
        elif i >= near:
            store(block, at, like(state[BODY_AT + i - BODY], work))
        elif i >= works_at + works:
            store(block, at, work[KNOWN + i])
        elif i >= works_at:
            x = work[KNOWN + i + works] if done != 0 else like(state[BODY_AT + i - BODY], work)
            store(block, at, x)
    return 0


def begin(kinds, numbers, parts, state, work):
    """Note energy and momentum of the start, judge it, and open the state for the integrator."""
    integrator, effects, limits, ledger = parts_of(kinds, numbers)
    body, present = body_at(work, KNOWN + BODY), filled(effects, work, KNOWN + EFFECTS)
    q, l, h = four_at(work, KNOWN + ATTITUDE), three_at(work, KNOWN + MOMENTUM), work[LENGTH]
    kinetic, squared = kinetic_energy(body, l), dot(l, l)
    energy = kinetic + total_energy(present, body, q)
    # a user's potential may tell no bound on itself
    in_play = larger(kinetic + total_energy_scale(present, body), abs(energy))
    compared = larger(abs(energy), 1e-3 * in_play)
    widest = 2.0 * in_play / min(min(body.i1, body.i2), body.i3)
    put((energy, compared, squared, in_play, dot(up(q), l), widest), work, KNOWN + START)
    put((0.0 * kinetic, 0.0 * kinetic), work, KNOWN + START + 6)

    endless = select(is_finite(q, l, energy, squared), 0.0, 1.0)
    omega = angular_velocity(body, l)
    flaw = fault(limits, endless, work, ledger, (), 0.0, q, l, omega, h, energy, squared)
    status = work[KNOWN + STATUS]
    status = select(status == 0.0, flaw, status)
    healthy = status == 0.0
    drift, most = select(healthy, 0.0, math.nan), select(healthy, math.inf, math.nan)
    put((drift, drift, status, 0.0, select(healthy, -1.0, 0.0)), work, KNOWN + DRIFT)
    put((drift, drift, most, most), work, KNOWN + EARLY)
    put(q + l, work, KNOWN + GOOD)

    l = joined(l, tuple_at(ledger, work, KNOWN + EFFECTS + row_count(effects)))
    part = parts[0] * h, parts[1] * h, parts[2] * h
    q, l = opened(integrator, body, present, work[BEGAN] + parts[3] * h, part, q, l)
    put(in_precision(q + first_three(l), state), state, ATTITUDE)
    row = more_row(keeps(integrator), EFFECTS_AT + row_count(effects))
    put(in_precision(l[3:], state), state, row)
    return 0


def look(kinds, numbers, parts, state, work, rounds, slot, late, planned):
    """Look at the state after `slot` steps of a round, `rounds` of which are done.

    late : 1 in the second half of the run, else 0;  planned : 1 at a look that no save asked for

    Its drifts and its health are noted. A member that is not well goes back to its last good state
    and stays there. If works are kept, the drift of the energy is what exceeds the work of effects
    without an energy.
    """
    integrator, effects, attitude, compensated, limits, ledger = parts_of(kinds, numbers)
    body, present = body_at(work, KNOWN + BODY), filled(effects, work, KNOWN + EFFECTS)
    works_at = EFFECTS_AT + row_count(effects)
    good_works = KNOWN + EFFECTS + row_count(effects) + len(ledger)
    h, done = work[LENGTH], min(work[EACH], slot)
    q, l = seen(state, work, compensated)
    more = more_of(keeps(integrator), ledger)
    row = more_row(keeps(integrator), works_at)
    l = joined(l, in_precision(tuple_at(more, state, row), work))
    t = work[BEGAN] + (done + parts[3]) * h
    q, l = closed(integrator, body, present, t, (parts[0] * h, parts[1] * h, parts[2] * h), q, l)
    works, stopped = l[3:], work[STOPPED] > 0.0
    q = carried(attitude, q, four_at(work, KNOWN + GOOD))
    q = select_each(stopped, four_at(work, HELD), q)
    l = select_each(stopped, three_at(work, HELD + 4), first_three(l))
    energy, squared = kinetic_energy(body, l) + total_energy(present, body, q), dot(l, l)
    put(q + l + (energy, squared), work, TRUE)

    kinetic = kinetic_energy(body, l)
    # a saved drift knows of planned looks alone: else it would depend on what else is saved
    known = fastest(marked(ledger), work, 6, kinetic)
    most = fastest(marked(ledger), work, 7, kinetic)
    work[KNOWN + START + 6] = select(planned > 0.0, known, work[KNOWN + START + 6])
    work[KNOWN + START + 7] = most
    start = begun(work, ledger, works, most, squared)
    endless = select(is_finite(q, l, energy, squared), 0.0, 1.0)
    omega = angular_velocity(body, l)
    flaw = fault(limits, endless, work, ledger, works, most, q, l, omega, h, energy, squared)
    steps = rounds * work[EACH] + done
    good = judged(flaw, start, energy, squared, steps, q, l, work, late)
    frozen = work[KNOWN + STATUS] > 0.0
    last_works = tuple_at(ledger, work, good_works)
    keep(frozen, last_works, works, work, good_works, state, works_at)
    freeze(frozen | stopped, good, state)
    return 0


def record(kinds, numbers, work, out, at, width, t, past):
    """Write the values of all observables of the last good state to `out`, from `at` on.

    width : from one value to the next;  past : see `rigidmc.engine.compiler.memory.spread`
    """
    observables, effects, ledger = parts_of(kinds, numbers)
    body, present = body_at(work, KNOWN + BODY), filled(effects, work, KNOWN + EFFECTS)
    works = tuple_at(ledger, work, KNOWN + EFFECTS + row_count(effects) + len(ledger))
    q, l = four_at(work, KNOWN + GOOD), three_at(work, KNOWN + GOOD + 4)
    most = fastest(marked(ledger), work, 6, kinetic_energy(body, l))
    start = begun(work, ledger, works, most, dot(l, l))
    write_all(observables, body, present, t, q, l, start, works, work, out, at, width, past)
    return 0


def carried(attitude, moved, q):
    """The attitude after a step, if it is followed at all."""
    if len(attitude) == 0:
        return q
    return moved


def is_finite(q, l, energy, squared):
    """Whether all numbers of a state are finite: 0 times infinity or nan is not 0."""
    return 0.0 * (energy + squared + q[0] + q[1] + q[2] + q[3]) == 0.0


def fastest(marks, work, row, kinetic):
    """The largest kinetic energy, of now and of the looks so far, which counts as in play: of
    bodies that start without any energy, and if the work of effects without an energy is booked.
    Else 0.  row : 6 for planned looks, 7 for all"""
    most = larger(work[KNOWN + START + row], kinetic)
    if len(marks) == 0:
        return select(work[KNOWN + START + 3] == 0.0, most, 0.0)
    return most


def begun(work, ledger, works, most, squared):
    """(E, 1/scale of E, |L|^2, 1/|L|^2) at the start, corrected by the works since.

    The scale is no less than `most`, the energy that `fastest` counts, and |L|^2 of a body that
    starts at rest is compared with that of now, `squared`: a drift is a pure number in every unit.
    0 stands for 1/0: there is nothing to compare with.
    """
    energy, compared, first = three_at(work, KNOWN + START)
    scale = inverse(larger(compared, most))
    start = energy, scale, first, inverse(select(first > 0.0, first, squared))
    return booked(start, ledger, works)


def fault(limits, endless, work, ledger, works, most, q, l, omega, h, energy, squared):
    """The status of a member: 1 if it is not finite, else the first limit that it exceeds, or 0.

    endless : 1 if it is not finite;  most : of `fastest`
    """
    if len(limits) == 0:
        return endless
    first, at_start = work[KNOWN + START + 2], three_at(work, KNOWN + START + 3)
    in_play = larger(at_start[0], most) + gross(works)
    before = work[KNOWN + START] + spent(ledger, works)
    w, rise = scale(h, omega), dot(up(q), l) - at_start[1]
    widest = limits[2] * limits[2] * larger(at_start[2], squared)
    status = select(abs(squared - first) > limits[1] * first, 4.0, 0.0)
    status = select(rise * rise > widest, 4.0, status)
    status = select(abs(energy - before) > limits[0] * in_play, 3.0, status)
    status = select(dot(w, w) > limits[3] * limits[3], 5.0, status)
    status = select(
        abs(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3] - 1.0) > limits[4], 6.0, status
    )
    return select(endless == 0.0, status, 1.0)


def judged(flaw, start, energy, squared, steps, q, l, work, late):
    """The last good state of a member after a look that found this flaw; drifts are noted too."""
    before = work[KNOWN + STATUS]
    well = before == 0.0
    counted = well & (flaw != 1.0)  # the drift that flags a member is part of its largest drift
    healthy, caught = well & (flaw == 0.0), well & (flaw > 0.0)
    drifts = abs((energy - start[0]) * start[1]), abs((squared - start[2]) * start[3])
    most = work[KNOWN + DRIFT], work[KNOWN + DRIFT + 1]
    new = max(most[0], drifts[0]), max(most[1], drifts[1])
    put(select_each(counted, new, most), work, KNOWN + DRIFT)
    if late == 0.0:
        put(select_each(counted, new, most), work, KNOWN + EARLY)
    else:
        least = work[KNOWN + LEAST], work[KNOWN + LEAST + 1]
        lower = min(least[0], drifts[0]), min(least[1], drifts[1])
        put(select_each(counted, lower, least), work, KNOWN + LEAST)
    work[KNOWN + STATUS] = select(well, flaw, before)
    work[KNOWN + GOOD_STEP] = select(healthy, steps, work[KNOWN + GOOD_STEP])
    work[KNOWN + FAULT_STEP] = select(caught, steps, work[KNOWN + FAULT_STEP])
    attitude = select_each(healthy, q, four_at(work, KNOWN + GOOD))
    good = attitude + select_each(healthy, l, three_at(work, KNOWN + GOOD + 4))
    put(good, work, KNOWN + GOOD)
    return good


def seen(state, work, compensated):
    """(q, L) of a state in float64, with the remainders of sums if they are kept."""
    q = in_precision(four_at(state, ATTITUDE), work)
    l = in_precision(three_at(state, MOMENTUM), work)
    if len(compensated) == 0:
        return q, l
    rest = in_precision(four_at(state, REST), work)
    more = in_precision(three_at(state, REST + 4), work)
    return (
        (q[0] + rest[0], q[1] + rest[1], q[2] + rest[2], q[3] + rest[3]),
        (l[0] + more[0], l[1] + more[1], l[2] + more[2]),
    )


def freeze(frozen, good, state):
    """Put the state of a frozen member back to its last good one, without remainders of sums."""
    back = select_each(frozen, in_precision(good, state), filled(good, state, ATTITUDE))
    put(back, state, ATTITUDE)
    put(select_each(frozen, (0.0,) * 7, filled(good, state, REST)), state, REST)
    return 0


def keep(frozen, good, works, work, row, state, at):
    """Note works as the last good ones, or put these back if a member is frozen."""
    put(select_each(frozen, good, works), work, row)
    put(select_each(frozen, in_precision(good, state), filled(good, state, at)), state, at)
    return 0


def write_all(observables, body, effects, t, q, l, start, works, work, out, at, width, past):
    """Write the values of observables, one after the other; the place after them."""
    if len(observables) == 0:
        return at
    values = value(observables[0], body, effects, t, q, l, start, works)
    at = spread(values, work, out, at, width, past)
    return write_all(
        observables[1:], body, effects, t, q, l, start, works, work, out, at, width, past
    )


inline_all(sys.modules[__name__])
