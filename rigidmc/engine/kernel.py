"""The kernel: lanes inside, steps outside. A block of members goes in as rows, and comes out further on in time.

The rows of a block are those of `rigidmc.engine.layout`; LANES members at a time are copied to two flat workspaces, one for
steps, in the precision of the run, and one for looks, in float64.
"""

import math

import numpy as np

from rigidmc.dynamics.euler import MassProperties, angular_velocity, kinetic_energy
from rigidmc.dynamics.so3 import dot, first_three, joined, scale, select, select3, select4, up
from rigidmc.effects.verbs import booked, gross, total_energy, total_energy_scale
from rigidmc.engine.compose import all_rows, inline, read, read_all
from rigidmc.engine.entries import Compiled
from rigidmc.engine.events import (
    COUNT,
    EVENT,
    SCRATCH,
    TIMES,
    TRIES,
    begin_events,
    find,
    held,
    look_at_events,
    note,
    note_first,
    stopped,
)
from rigidmc.engine.layout import (
    ATTITUDE,
    BODY,
    BODY_AT,
    DRIFT,
    EFFECTS,
    EFFECTS_AT,
    ENERGY,
    FAULT_STEP,
    FOUND,
    GOOD,
    GOOD_STEP,
    LANES,
    MEMBER,
    MOMENTUM,
    PRESENT,
    REST,
    REST_AT,
    START,
    STATUS,
    STEP_AT,
    STEPS,
    STEPS_AT,
    STOPPED,
    TRUE,
    aligned,
    clock,
    four_at,
    in_state,
    in_work,
    keep,
    place,
    put,
    put_state,
    record,
    seen,
    state_at,
    three_at,
    tuple_at,
)  # fmt: skip
from rigidmc.engine.noise import as_float, as_word, normals, philox
from rigidmc.engine.watch import OFTEN, SHADOW, all_marks, begin_running, begin_shadow, look_at_running, look_at_shadow, watched
from rigidmc.integrators.verbs import closed, opened, step

LOOK = 32  # steps between two looks at drift and health: a look each step costs 20 to 25 % of rk4, every 16th up to 5 %


def fault(limits, start, scales, q, l, omega, h, energy, squared):
    """The status of a finite member: 0, or the first of the limits that it exceeds; scales = (1/energies in play, L_z(0), 1/largest |L|)."""
    w = scale(h, omega)
    drift, drift2 = abs((energy - start[0]) * scales[0]), abs((squared - start[2]) * start[3])
    drift_z = abs((dot(up(q), l) - scales[1]) * scales[2])
    found = select(drift2 > limits[1], 4.0, select(drift_z > limits[2], 4.0, 0.0))
    found = select(drift > limits[0], 3.0, found)
    found = select(dot(w, w) > limits[3] * limits[3], 5.0, found)
    return select(abs(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3] - 1.0) > limits[4], 6.0, found)


inline(fault)
_BODY = MassProperties(*[0.0] * 9)


def _advance(
    integrator, parts, effects, observables, attitude, compensated, precision, own, limits, noise, ledger, events, running, shadow, block, out, width, column,
    h, slots, first, last, stride, total,
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
    noise : () without random effects; else (key, streams, rows, members): two words, and for each such effect its stream and the row of the
        workspace of steps where its deviates go; the index of each member of the block. See `rigidmc.engine.noise`
    ledger : () where no works are kept; else for each effect () if its energy tells its work, (0.0,) if not. See `rigidmc.effects.verbs`
    events, running, shadow : what is kept of every step, see `rigidmc.engine.watch`: events; (running observable, as many 0.0 as it keeps
        floats) each; (0.0,) for a neighbour, else ()
    block : (rows, n) as above, changed in place; n a multiple of LANES. Between calls it holds the state as the integrator keeps it
        between steps (`opened`), after step `total` the true one
    out : flat; value row r of save slot s of member m goes to out[(s*R + r)*width + column + m], R = value rows in all
    h : the step; with own steps a round of `slots` steps, of which member m makes the first block[STEPS, m], as long as each other
    stride : steps between saves; save slot = step/stride, and step `total` is always saved
    """
    rows, members = block.shape
    real = precision.dtype.type
    parameters = all_rows(effects)
    works, works_seen = EFFECTS_AT + parameters, PRESENT + parameters  # where works are in the two workspaces
    works_good = works_seen + len(ledger)
    events_at, events_seen = works + 2 * len(ledger), works_seen + 2 * len(ledger)
    running_at, running_seen = events_at + EVENT * len(events), events_seen + EVENT * len(events)
    shadow_at = running_at + all_marks(running)
    scratch = shadow_at + SHADOW * len(shadow)
    work, state = aligned((rows + PRESENT - EFFECTS) * LANES, np.float64), aligned((scratch + SCRATCH) * LANES, precision.dtype)
    saves = (total + stride - 1) // stride
    size = out.size // (width * (saves + 1)) if width > 0 else 0
    lead = (parts[0, 0], parts[0, 1], parts[0, 2])
    for low in range(0, members, LANES):
        for i in range(rows):
            for k in range(LANES):
                work[in_work(i) * LANES + k] = block[i, low + k]
        if len(noise) > 0:
            for k in range(LANES):
                work[MEMBER * LANES + k] = as_float(noise[3][low + k] + np.uint64(1))
        if first == 0:
            for k in range(LANES):
                body, present = read(_BODY, work, BODY, k, LANES), read_all(effects, work, PRESENT, k, LANES)
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
                work[FOUND * LANES + k] = 0.0 if finite else 1.0
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
                    work[FOUND * LANES + k] = fast if work[FOUND * LANES + k] == 0.0 else 1.0
            for k in range(LANES):
                status = work[STATUS * LANES + k]
                status = select(status == 0.0, work[FOUND * LANES + k], status)
                healthy = status == 0.0
                work[DRIFT * LANES + k] = 0.0 if healthy else math.nan
                work[(DRIFT + 1) * LANES + k] = 0.0 if healthy else math.nan
                work[STATUS * LANES + k] = status
                work[GOOD_STEP * LANES + k] = 0.0
                work[FAULT_STEP * LANES + k] = -1.0 if healthy else 0.0
            if size > 0:
                for k in range(LANES):
                    body, present = read(_BODY, work, BODY, k, LANES), read_all(effects, work, PRESENT, k, LANES)
                    q, l = four_at(work, k, ATTITUDE), three_at(work, k, MOMENTUM)
                    record(
                        observables,
                        body,
                        present,
                        0.0,
                        q,
                        l,
                        four_at(work, k, START),
                        tuple_at(ledger, work, k, works_seen),
                        out,
                        column + place(own, low + k),
                        width,
                    )
            if len(events) > 0:
                for k in range(LANES):
                    body, present = read(_BODY, work, BODY, k, LANES), read_all(effects, work, PRESENT, k, LANES)
                    q, l = four_at(work, k, ATTITUDE), three_at(work, k, MOMENTUM)
                    begin_events(events, body, present, 0.0, q, l, work, k, events_seen)
            if len(running) > 0:
                for k in range(LANES):
                    body, present = read(_BODY, work, BODY, k, LANES), read_all(effects, work, PRESENT, k, LANES)
                    q, l = four_at(work, k, ATTITUDE), three_at(work, k, MOMENTUM)
                    begin_running(running, body, present, 0.0, q, l, work, k, running_seen)
            for k in range(LANES):
                body, present = read(_BODY, work, BODY, k, LANES), read_all(effects, work, PRESENT, k, LANES)
                q, l = four_at(work, k, ATTITUDE), three_at(work, k, MOMENTUM)
                put(q, work, GOOD * LANES + k, LANES)
                put(l, work, (GOOD + 4) * LANES + k, LANES)
                t, dt, _ = seen(own, work, k, 0, slots, parts[0, 3], h)
                l = joined(l, tuple_at(ledger, work, k, works_seen))
                q, l = opened(integrator, body, present, t, scale(dt, lead), q, l)
                put(q, work, ATTITUDE * LANES + k, LANES)
                put(first_three(l), work, MOMENTUM * LANES + k, LANES)
                put(l[3:], work, works_seen * LANES + k, LANES)
            if len(shadow) > 0:  # beside the state as the integrator keeps it between steps
                for k in range(LANES):
                    body = read(_BODY, work, BODY, k, LANES)
                    q, l = four_at(work, k, ATTITUDE), three_at(work, k, MOMENTUM)
                    weight = 0.5 * work[(START + 4) * LANES + k] * min(body.i1, body.i2, body.i3)
                    begin_shadow(weight, q, l, work, k, shadow_at - EFFECTS_AT + PRESENT)
        for i in range(rows):
            if i < START or i >= BODY:
                for k in range(LANES):
                    state[in_state(i) * LANES + k] = work[in_work(i) * LANES + k]
        busy, unit = 1.0, h  # steps of the member that makes most in a round; what the parts are given in
        if len(own) > 0:
            unit = 1.0
            for k in range(LANES):
                busy = max(busy, work[STEPS * LANES + k])
                state[STEP_AT * LANES + k] = h / work[STEPS * LANES + k]
                state[STEPS_AT * LANES + k] = work[STEPS * LANES + k]
        now, idle = first, False  # idle: an event has stopped all members of these lanes
        while now < last:
            begun = now // slots * slots if len(own) > 0 else 0  # of the round; without own steps there is one
            stop = min(last, begun + ((now - begun) // LOOK + 1) * LOOK, (now // stride + 1) * stride)
            if len(own) > 0:
                stop = min(stop, begun + slots)
            start = real(begun // slots * h) if len(own) > 0 else real(0.0)
            ending = now if idle else min(stop, begun + int(busy)) if len(own) > 0 else stop
            for s in range(now, ending):
                if len(noise) > 0:
                    # the step of a member with its own steps does not depend on how many others make
                    count = np.uint64(s) if len(own) == 0 else (np.uint64(now // slots) << np.uint64(32)) | np.uint64(s - begun)
                    for j in range(noise[1].size):
                        key, stream = (noise[0][0], noise[0][1]), noise[1][j]
                        for k in range(LANES):  # a place known when compiling, and no other array, or nothing is packed
                            x, y, z = normals(philox(key, (as_word(work[MEMBER * LANES + k]), count, stream, np.uint64(1))))
                            work[TRUE * LANES + k] = x
                            work[(TRUE + 1) * LANES + k] = y
                            work[(TRUE + 2) * LANES + k] = z
                        for i in range(3):
                            for k in range(LANES):
                                state[(noise[2][j] + i) * LANES + k] = real(work[(TRUE + i) * LANES + k])
                for p in range(1, parts.shape[0]):
                    shares = (real(parts[p, 0] * unit), real(parts[p, 1] * unit), real(parts[p, 2] * unit))
                    slot, share, now_t, dt = real(s - begun), real(parts[p, 3]), real((s + parts[p, 3]) * h), real(h)
                    for k in range(LANES):  # the loop that must vectorise
                        body = read(_BODY, state, BODY_AT, k, LANES)
                        present = read_all(effects, state, EFFECTS_AT, k, LANES)
                        q, l = state_at(state, k, compensated, ledger, works)
                        t, by, part = clock(own, state, k, start, slot, share, now_t, dt, shares)
                        q, l = step(integrator, body, present, t, by, part, q, l)
                        put_state(own, slot, q, l, state, k, attitude, compensated, works)
                    if len(shadow) > 0:
                        for k in range(LANES):
                            body = read(_BODY, state, BODY_AT, k, LANES)
                            present = read_all(effects, state, EFFECTS_AT, k, LANES)
                            q, l = four_at(state, k, shadow_at), three_at(state, k, shadow_at + 4)
                            t, by, part = clock(own, state, k, start, slot, share, now_t, dt, shares)
                            q, l = step(integrator, body, present, t, by, part, q, l)
                            if len(attitude) > 0:
                                keep(own, slot, q, state, k, shadow_at)
                            keep(own, slot, l, state, k, shadow_at + 4)
                if len(shadow) > 0 and (s + 1) % OFTEN == 0:
                    number = float((s + 1) // OFTEN)
                    for k in range(LANES):
                        look_at_shadow(number, four_at(state, k, ATTITUDE), three_at(state, k, MOMENTUM), state, k, shadow_at)
                if len(running) > 0:
                    opening, part = (
                        real(parts[0, 3]),
                        (real(parts[0, 0] * unit), real(parts[0, 1] * unit), real(parts[0, 2] * unit)),
                    )
                    when = start, real(s - begun), opening, real((s + 1) * h), real(h), part
                    for k in range(LANES):
                        body, present, q, l, t, _ = watched(integrator, effects, compensated, own, when, state, k)
                        look_at_running(running, events, events_at, own, when[1], body, present, t, q, l, state, k, running_at)
                if len(events) > 0:
                    opening, part = (
                        real(parts[0, 3]),
                        (real(parts[0, 0] * unit), real(parts[0, 1] * unit), real(parts[0, 2] * unit)),
                    )
                    when, hits = (start, real(s - begun), opening, real((s + 1) * h), real(h), part), 0
                    for k in range(LANES):
                        body, present, q, l, t, _ = watched(integrator, effects, compensated, own, when, state, k)
                        hits |= look_at_events(events, body, present, t, q, l, state, k, events_at)
                    if hits > 0:
                        new = 0
                        for k in range(LANES):
                            body, present, q, l, t, by = watched(integrator, effects, compensated, own, when, state, k)
                            halted = stopped(events, state, k, events_at)
                            new |= note(events, halted, body, present, t, by, q, l, attitude, state, k, events_at)
                        if new > 0:
                            for k in range(LANES):
                                note_first(events, state, k, events_at)
            now = stop
            looked = (now - begun) % LOOK == 0 and (len(own) == 0 or now - begun < slots)
            if looked or now % stride == 0 or now == total:  # not where a call ends: no result depends on calls
                for i in range(REST):
                    for k in range(LANES):
                        work[i * LANES + k] = state[i * LANES + k]
                if len(compensated) > 0:  # in float32 the remainders are seen in float64
                    for i in range(REST):
                        for k in range(LANES):
                            work[i * LANES + k] += state[(REST_AT + i) * LANES + k]
                for i in range(len(ledger)):
                    for k in range(LANES):
                        work[(works_seen + i) * LANES + k] = state[(works + i) * LANES + k]
                for k in range(LANES):  # look
                    body, present = read(_BODY, work, BODY, k, LANES), read_all(effects, work, PRESENT, k, LANES)
                    q, l = four_at(work, k, ATTITUDE), joined(three_at(work, k, MOMENTUM), tuple_at(ledger, work, k, works_seen))
                    t, dt, _ = seen(own, work, k, now, slots, parts[0, 3], h)
                    true_q, true_l = closed(integrator, body, present, t, scale(dt, lead), q, l)
                    if len(events) > 0:
                        work[STOPPED * LANES + k] = stopped(events, state, k, events_at)
                        true_q, true_l = held(events, state, k, events_at, true_q, true_l)
                    energy, squared = kinetic_energy(body, true_l) + total_energy(present, body, true_q), dot(true_l, true_l)
                    finite = 0.0 * (energy + squared + true_q[0] + true_q[1] + true_q[2] + true_q[3]) == 0.0
                    put(true_q, work, TRUE * LANES + k, LANES)
                    put(first_three(true_l), work, (TRUE + 4) * LANES + k, LANES)
                    put(true_l[3:], work, works_seen * LANES + k, LANES)
                    work[ENERGY * LANES + k], work[(ENERGY + 1) * LANES + k] = energy, squared
                    work[FOUND * LANES + k] = 0.0 if finite else 1.0
                if len(limits) > 0:
                    for k in range(LANES):
                        body, q, l = read(_BODY, work, BODY, k, LANES), four_at(work, k, TRUE), three_at(work, k, TRUE + 4)
                        _, dt, _ = seen(own, work, k, now, slots, parts[0, 3], h)
                        energy, squared = work[ENERGY * LANES + k], work[(ENERGY + 1) * LANES + k]
                        start, scales = four_at(work, k, START), three_at(work, k, START + 4)
                        if len(ledger) > 0:
                            done = tuple_at(ledger, work, k, works_seen)
                            start, scales = (
                                booked(start, ledger, done),
                                (scales[0] / (1.0 + scales[0] * gross(done)), scales[1], scales[2]),
                            )
                        status = fault(limits, start, scales, q, l, angular_velocity(body, l), dt, energy, squared)
                        work[FOUND * LANES + k] = status if work[FOUND * LANES + k] == 0.0 else 1.0
                for k in range(LANES):  # drifts so far; a member that is not ok stays at its last good state
                    start, before, now_found = four_at(work, k, START), work[STATUS * LANES + k], work[FOUND * LANES + k]
                    start = booked(start, ledger, tuple_at(ledger, work, k, works_seen))
                    energy, squared = work[ENERGY * LANES + k], work[(ENERGY + 1) * LANES + k]
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
                    put(select4(healthy, four_at(work, k, TRUE), four_at(work, k, GOOD)), work, GOOD * LANES + k, LANES)
                    put(
                        select3(healthy, three_at(work, k, TRUE + 4), three_at(work, k, GOOD + 4)),
                        work,
                        (GOOD + 4) * LANES + k,
                        LANES,
                    )
                for i in range(REST):
                    for k in range(LANES):
                        frozen, good = work[STATUS * LANES + k] > 0.0, real(work[(GOOD + i) * LANES + k])
                        if len(events) > 0:
                            frozen = frozen | (work[STOPPED * LANES + k] > 0.0)
                        state[i * LANES + k] = good if frozen else state[i * LANES + k]
                        state[(REST_AT + i) * LANES + k] = real(0.0) if frozen else state[(REST_AT + i) * LANES + k]
                if len(events) > 0:
                    idle = True
                    for k in range(LANES):
                        idle = idle & ((work[STATUS * LANES + k] > 0.0) | (work[STOPPED * LANES + k] > 0.0))
                for i in range(len(ledger)):
                    for k in range(LANES):
                        frozen, seen_now, good = (
                            work[STATUS * LANES + k] > 0.0,
                            work[(works_seen + i) * LANES + k],
                            work[(works_good + i) * LANES + k],
                        )
                        work[(works_good + i) * LANES + k] = good if frozen else seen_now
                        state[(works + i) * LANES + k] = real(good) if frozen else state[(works + i) * LANES + k]
            if size > 0 and (now % stride == 0 or now == total):
                at = saves if now == total else now // stride
                base = at * size * width + column
                for k in range(LANES):
                    body, present = read(_BODY, work, BODY, k, LANES), read_all(effects, work, PRESENT, k, LANES)
                    q, l = four_at(work, k, GOOD), three_at(work, k, GOOD + 4)
                    good_works = tuple_at(ledger, work, k, works_good)
                    record(
                        observables,
                        body,
                        present,
                        now // slots * h,
                        q,
                        l,
                        booked(four_at(work, k, START), ledger, good_works),
                        good_works,
                        out,
                        base + place(own, low + k),
                        width,
                    )
        for i in range(REST):
            for k in range(LANES):
                work[i * LANES + k] = state[i * LANES + k]
                work[(REST + i) * LANES + k] = state[(REST_AT + i) * LANES + k]
        for i in range(len(ledger)):
            for k in range(LANES):
                work[(works_seen + i) * LANES + k] = (
                    work[(works_good + i) * LANES + k] if last == total else state[(works + i) * LANES + k]
                )
        for i in range(scratch - events_at):
            for k in range(LANES):
                work[(events_seen + i) * LANES + k] = state[(events_at + i) * LANES + k]
        if last == total:
            for i in range(REST):
                for k in range(LANES):
                    work[i * LANES + k] = work[(GOOD + i) * LANES + k]
            if len(events) > 0:
                tries = 0 if len(noise) > 0 else TRIES  # with noise there are no steps back: the straight line stays
                for which in range(2 * len(events)):
                    happened = False
                    for k in range(LANES):
                        happened = happened | (state[(events_at + which // 2 * EVENT + COUNT) * LANES + k] > 0.0)
                    find(
                        integrator,
                        parts,
                        effects,
                        events,
                        own,
                        which,
                        real(h),
                        tries if happened else 0,
                        precision,
                        state,
                        scratch,
                        events_at,
                    )
                    for k in range(LANES):
                        at = (events_seen + which // 2 * EVENT + TIMES + which % 2) * LANES + k
                        work[at] = state[(scratch + 4) * LANES + k]
        for i in range(rows):
            for k in range(LANES):
                block[i, low + k] = work[in_work(i) * LANES + k]


_compiled = Compiled(_advance)
dispatcher, entry = _compiled.dispatcher, _compiled.entry


def advance(*arguments):
    """Run the kernel; see `_advance` for the arguments."""
    return _compiled(*arguments)
