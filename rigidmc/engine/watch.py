"""What is kept of every step without being saved: events (`rigidmc.engine.events`), running observables, a neighbour.

All of it are rows of a state from `row` on, after those of the effects and their works: EVENT rows for each event, as many as it has marks for each running
observable, SHADOW rows for the neighbour. Steps are made first, a few dozen at a time, and then watched: no step depends on who watches it.
"""

import math

from rigidmc.dynamics.functions import logarithm
from rigidmc.dynamics.so3 import (
    difference,
    difference4,
    dot,
    first_three,
    joined,
    select,
    select_each,
)
from rigidmc.engine.compose import filled, given, inline
from rigidmc.engine.events import (
    EVENT,
    RECORD,
    RECORDS,
    TIMES,
    any_happened,
    armed_again,
    begin_events,
    guess,
    held,
    level_of,
    levels_at,
    levels_of,
    narrowed,
    note,
    put_levels,
    stopped,
)  # fmt: skip
from rigidmc.engine.layout import (
    ATTITUDE,
    BEGAN,
    BODY,
    BODY_AT,
    EACH,
    EFFECTS,
    EFFECTS_AT,
    GOOD,
    HELD,
    KNOWN,
    LENGTH,
    MOMENTUM,
    REST,
    START,
    STOPPED,
    TRUE,
    body_at,
)  # fmt: skip
from rigidmc.engine.memory import four_at, put, three_at, tuple_at
from rigidmc.engine.numbers import any_of, in_precision, like
from rigidmc.integrators.protocol import closed, keeps, opened
from rigidmc.observables.chaos import NEAR, OFTEN  # noqa: F401
from rigidmc.observables.protocol import begin, update

# rows of the neighbour: its state and the remainders of its sums; sums of ln growth, of the same by number of looks, of Y; 1/|L|^2 of the motion
SUMS, WEIGHT, SHADOW = 14, 17, 18


def begin_watch(kinds, numbers, parts, state, work, row):
    """The rows of what is watched, at the start."""
    _, effects, events, running = given(kinds, numbers)
    body, present = body_at(state, BODY_AT), filled(effects, state, EFFECTS_AT)
    q, l = (
        in_precision(four_at(work, KNOWN + GOOD), state),
        in_precision(three_at(work, KNOWN + GOOD + 4), state),
    )
    begin_events(events, body, present, 0.0, q, l, state, row)
    begin_running(running, body, present, 0.0, q, l, state, row + EVENT * len(events))
    hold(events, state, work, row)
    return 0


def watch(kinds, numbers, parts, state, work, trace, row, first, last):
    """Watch the steps from `first` to `last` of a round, of which the states are in `trace`."""
    integrator, effects, events, running = given(kinds, numbers)
    body, present = body_at(state, BODY_AT), filled(effects, state, EFFECTS_AT)
    began, length = work[BEGAN], work[LENGTH]
    h, each = like(length, state), like(work[EACH], state)
    part = (
        like(parts[0] * length, state),
        like(parts[1] * length, state),
        like(parts[2] * length, state),
    )
    more = tuple_at(keeps(integrator), state, REST)
    levels, kept = levels_at(events, state, row), kept_at(running, state, row + EVENT * len(events))
    for s in range(first, last):
        t, at = like(began + (s + 1.0) * length, state), 7 * (s - first)
        lead = like(began + (s + 1.0 + parts[3]) * length, state)
        q, l = closed(
            integrator,
            body,
            present,
            lead,
            part,
            four_at(trace, at),
            joined(three_at(trace, at + 4), more),
        )
        moves = (each > s) & (stopped(events, state, row) <= 0.0)
        kept = updated(running, moves, kept, body, present, t, q, l)
        levels = watched(events, moves, body, present, t, h, q, l, levels, state, row)
    put_levels(levels, state, row)
    put_kept(kept, state, row + EVENT * len(events))
    hold(events, state, work, row)
    return 0


def watched(events, moves, body, effects, t, h, q, l, before, state, row):
    """The levels of events after a step that ended at t; what happened in it is written down."""
    if len(events) == 0:
        return ()
    now = levels_of(events, body, effects, t, q, l)
    if any_of(any_happened(before, now)):
        note(events, moves, t, h, q, l, before, now, state, row)
    return armed_again(events, moves, body, q, l, before, now)


def hold(events, state, work, row):
    """Tell the looks which members an event has stopped, and where."""
    q, l = held(events, state, row, four_at(state, ATTITUDE), three_at(state, MOMENTUM))
    work[STOPPED] = like(stopped(events, state, row), work)
    put(in_precision(q + l, work), work, HELD)
    return 0


def begin_running(running, body, effects, t, q, l, state, row):
    """The rows of running observables at the start."""
    if len(running) == 0:
        return 0
    put(begin(running[0][0], body, effects, t, q, l), state, row)
    return begin_running(running[1:], body, effects, t, q, l, state, row + len(running[0][1]))


def kept_at(running, state, row):
    """What running observables keep, from their rows."""
    if len(running) == 0:
        return ()
    return (filled(running[0][1], state, row),) + kept_at(
        running[1:], state, row + len(running[0][1])
    )


def updated(running, moves, kept, body, effects, t, q, l):
    """What running observables keep a step further on, of members that move."""
    if len(running) == 0:
        return ()
    new = update(running[0][0], kept[0], body, effects, t, q, l)
    return (select_each(moves, new, kept[0]),) + updated(
        running[1:], moves, kept[1:], body, effects, t, q, l
    )


def put_kept(kept, state, row):
    """Write what `kept_at` reads."""
    if len(kept) == 0:
        return row
    return put_kept(kept[1:], state, put(kept[0], state, row))


def watch_rows(events, running, shadow):
    """How many rows of a block all of it takes."""
    return EVENT * len(events) + all_marks(running) + SHADOW * len(shadow)


def all_marks(running):
    """How many rows running observables take."""
    if len(running) == 0:
        return 0
    return len(running[0][1]) + all_marks(running[1:])


def seek(kinds, numbers, parts, state, work, spare, aside, row, which, tried):
    """One try to find the time of record `which` (2 i + 0 or 1: first or last of event i): the state from which to step back, as long as its level says.

    spare, aside : a state and what is known of it, for the step back; the ends between which the level is 0 are its true state's rows
    """
    integrator, effects, events = given(kinds, numbers)
    at = row + which // 2 * EVENT + RECORDS + which % 2 * RECORD
    body, present = body_at(state, BODY_AT), filled(effects, state, EFFECTS_AT)
    t, before, there, h = state[at], state[at + 1], state[at + 2], like(work[LENGTH], state)
    ends = 0.0 * h, there, h / h, before
    if tried > 0:
        share = like(aside[TRUE + 4], state)
        by = -share * h
        part = like(parts[0], state) * by, like(parts[1], state) * by, like(parts[2], state) * by
        q, l = closed(
            integrator,
            body,
            present,
            t + by + parts[3] * by,
            part,
            four_at(spare, 0),
            momentum_at(integrator, spare),
        )
        found = level_of(events, which // 2, body, present, t + by, q, l)
        ends = narrowed(in_precision(four_at(aside, TRUE), state), share, found)
    share = guess(ends)
    by = -share * h
    put(in_precision(ends + (share,), aside), aside, TRUE)
    part = like(parts[0], state) * by, like(parts[1], state) * by, like(parts[2], state) * by
    q, l = opened(
        integrator,
        body,
        present,
        t + parts[3] * by,
        part,
        four_at(state, at + 3),
        three_at(state, at + 7),
    )
    put_opened(q, l, spare)
    put(in_precision((t, by), aside), aside, BEGAN)
    at_start = (before < 0.0) == (there < 0.0)
    state[row + which // 2 * EVENT + TIMES + which % 2] = select(at_start, t, t + by)
    return 0


def begin_near(kinds, numbers, parts, state, work, near, row):
    """The neighbour of a state at the distance NEAR, in a direction that no body singles out."""
    q, l, body = (
        four_at(work, KNOWN + GOOD),
        three_at(work, KNOWN + GOOD + 4),
        body_at(work, KNOWN + BODY),
    )
    weight = 0.5 * work[KNOWN + START + 4] * min(min(body.i1, body.i2), body.i3)
    root = NEAR / math.sqrt(weight)
    a, b, c = 0.5 * NEAR * 0.31, 0.5 * NEAR * 0.43, 0.5 * NEAR * 0.38
    turned = (
        q[0] - q[1] * a - q[2] * b - q[3] * c,
        q[1] + q[0] * a + q[2] * c - q[3] * b,
        q[2] + q[0] * b + q[3] * a - q[1] * c,
        q[3] + q[0] * c + q[1] * b - q[2] * a,
    )
    moved, none = (l[0] + 0.54 * root, l[1] + 0.47 * root, l[2] + 0.25 * root), 0.0 * weight
    settle(kinds, numbers, parts, work, 0.0, turned, moved, near, state)
    put(in_precision((none, none, none, weight), state), state, row + SUMS)
    return 0


def meet(kinds, numbers, parts, state, work, near, row, slot, number):
    """Book how far the neighbour has gone since look `number` - 1, after `slot` steps of a round, and bring it back."""
    integrator, effects = given(kinds, numbers)
    body, present = body_at(work, KNOWN + BODY), filled(effects, work, KNOWN + EFFECTS)
    t, part = opening(parts, work, slot)
    q, l = closed(integrator, body, present, t, part, *in_double(integrator, state, work))
    p, m = closed(integrator, body, present, t, part, *in_double(integrator, near, work))
    sums, weight = in_precision(three_at(state, row + SUMS), work), like(state[row + WEIGHT], work)
    dq, dl = difference4(p, q), difference(m, l)
    square = 4.0 * (dq[0] * dq[0] + dq[1] * dq[1] + dq[2] * dq[2] + dq[3] * dq[3]) + weight * dot(
        dl, dl
    )
    grown = 0.5 * logarithm(square * (1.0 / (NEAR * NEAR)))
    back = NEAR / math.sqrt(square)
    turned = q[0] + back * dq[0], q[1] + back * dq[1], q[2] + back * dq[2], q[3] + back * dq[3]
    settle(
        kinds,
        numbers,
        parts,
        work,
        slot,
        turned,
        (l[0] + back * dl[0], l[1] + back * dl[1], l[2] + back * dl[2]),
        near,
        state,
    )
    booked = sums[1] + (number - 0.5) * grown
    put(
        in_precision((sums[0] + grown, booked, sums[2] + 2.0 * booked / number), state),
        state,
        row + SUMS,
    )
    return 0


def opening(parts, work, slot):
    """(time of the torque, times) of the part that opens a state after `slot` steps of a round."""
    h, made = work[LENGTH], min(work[EACH], slot)
    return work[BEGAN] + (made + parts[3]) * h, (parts[0] * h, parts[1] * h, parts[2] * h)


def in_double(integrator, state, work):
    """(q, L) of a state in float64, with what the integrator keeps."""
    return in_precision(four_at(state, ATTITUDE), work), in_precision(
        momentum_at(integrator, state), work
    )


def momentum_at(integrator, state):
    """L of a state, with what the integrator keeps."""
    return joined(three_at(state, MOMENTUM), tuple_at(keeps(integrator), state, REST))


def put_opened(q, l, state):
    """Write a state that an integrator has opened; without remainders of sums."""
    put(q + first_three(l), state, ATTITUDE)
    put(rest_of(0.0 * l[0], l[3:]), state, REST)
    return 0


def rest_of(none, keeps):
    """The seven numbers after q and L: what the integrator keeps, or no remainders."""
    if len(keeps) == 0:
        return none, none, none, none, none, none, none
    return keeps


def settle(kinds, numbers, parts, work, slot, q, l, near, state):
    """Make (q, L) the state of the neighbour, as the integrator keeps it."""
    integrator, effects = given(kinds, numbers)
    t, part = opening(parts, work, slot)
    q, l = opened(
        integrator,
        body_at(work, KNOWN + BODY),
        filled(effects, work, KNOWN + EFFECTS),
        t,
        part,
        q,
        l,
    )
    put_opened(in_precision(q, state), in_precision(l, state), near)
    return 0


for _function in (
    opening,
    in_double,
    momentum_at,
    put_opened,
    rest_of,
    settle,
    watched,
    hold,
    begin_running,
    kept_at,
    updated,
    put_kept,
    all_marks,
):
    inline(_function)
