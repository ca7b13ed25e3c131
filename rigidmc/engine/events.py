"""Events: whether one happened in a step, and when to the order of the integrator.

An event is EVENT rows of a block. Of one that happened in a step the state at the step's end is kept, and at the end of the run (`find`) steps
are made back from there, of the length at which its level is 0: as exact as the integrator.
"""

from typing import Any, NamedTuple

from rigidmc.dynamics.euler import MassProperties
from rigidmc.dynamics.so3 import joined, scale, select, select3, select4
from rigidmc.engine.compose import inline, read, read_all
from rigidmc.engine.layout import BODY_AT, EFFECTS_AT, LANES, MOMENTUM, REST, REST_AT, STEP_AT, four_at, put, three_at
from rigidmc.integrators.verbs import closed, opened, step
from rigidmc.observables.verbs import armed, level, past

# Rows of an event: its level before and after the last step, 0 where it cannot happen next (two rows and no more: stores are what the loop waits
# for, 2 % of a step each); how often it happened; when by linear interpolation, last and first; the squares of the times between; when exactly,
# first and last; and of first and last the time of the step's end, the levels before and there, and the state.
BEFORE, LEVEL, COUNT, TAU, FIRST_TAU, SQUARES, TIMES, RECORDS, RECORD, EVENT = 0, 1, 2, 3, 4, 5, 6, 8, 10, 28
SCRATCH = 5  # rows in which the times of events are found: two steps back and the levels there, and the time
TRIES = 8  # steps back: by regula falsi after Illinois, of order 3 in three steps; what is left after five is 1e-15 of a step
_BODY = MassProperties(*[0.0] * 9)


class Record(NamedTuple):
    """What is known of an event of each member: how often; times of first and last [s]; sums of `rigidmc.observables`; end of the step of the first."""

    count: Any
    first: Any
    last: Any
    tau: Any
    first_tau: Any
    squares: Any
    seen: Any


def record_of(rows, healthy):
    """The Record of an event from its rows of a block; nan where members are not healthy."""
    import numpy as np

    count = np.where(healthy, rows[COUNT], np.nan)
    never = ~(count > 0.0)
    first, last, seen = (np.where(never, np.nan, x) for x in (rows[TIMES], rows[TIMES + 1], rows[RECORDS]))
    return Record(count, first, last, rows[TAU], rows[FIRST_TAU], rows[SQUARES], seen)


def begin_events(events, body, effects, t, q, l, work, k, row):
    """The rows of events at the start; what an event leads to may be so already."""
    if len(events) == 0:
        return 0
    now = level(events[0], body, effects, t, q, l)
    there = past(events[0], now)
    first = select(armed(events[0], body, q, l, now, False), now, 0.0)
    put((0.0, first, select(there, 1.0, 0.0), t, t, 0.0, t, t), work, row * LANES + k, LANES)
    put((t, now, now) + q + l + (t, now, now) + q + l, work, (row + RECORDS) * LANES + k, LANES)
    return begin_events(events[1:], body, effects, t, q, l, work, k, row + EVENT)


def look_at_events(events, body, effects, t, q, l, state, k, row):
    """Levels of events after a step; 1 where any happened in it, else 0."""
    if len(events) == 0:
        return 0
    now, before = level(events[0], body, effects, t, q, l), state[(row + LEVEL) * LANES + k]
    hit = happened(before, now)
    state[(row + BEFORE) * LANES + k] = before
    state[(row + LEVEL) * LANES + k] = select(armed(events[0], body, q, l, now, (before != 0.0) & (not hit)), now, 0.0)
    return (1 if hit else 0) | look_at_events(events[1:], body, effects, t, q, l, state, k, row + EVENT)


def happened(before, now):
    """Whether an event happened between two levels."""
    return (before * now <= 0.0) & (before != 0.0)


def stopped(events, state, k, row):
    """1 where an event has stopped the member, else 0."""
    if len(events) == 0:
        return 0.0
    if len(events[0].stop) == 0:
        return stopped(events[1:], state, k, row + EVENT)
    return select(state[(row + COUNT) * LANES + k] > 0.0, 1.0, stopped(events[1:], state, k, row + EVENT))


def held(events, state, k, row, q, l):
    """(q, L), or where an event has stopped the member the state at the end of that step."""
    if len(events) == 0:
        return q, l
    if len(events[0].stop) == 0:
        return held(events[1:], state, k, row + EVENT, q, l)
    here, at = state[(row + COUNT) * LANES + k] > 0.0, row + RECORDS + 3
    q, l = select4(here, four_at(state, k, at), q), joined(select3(here, three_at(state, k, at + 4), l), l[3:])
    return held(events[1:], state, k, row + EVENT, q, l)


def note(events, halted, body, effects, t, h, q, l, attitude, state, k, row):
    """Write down the events of a step that ended at t in (q, L); whether one was a first, as a number."""
    if len(events) == 0:
        return 0
    before, now, count = (
        state[(row + BEFORE) * LANES + k],
        level(events[0], body, effects, t, q, l),
        state[(row + COUNT) * LANES + k],
    )
    hit = happened(before, now) & (halted == 0.0)  # a member that is stopped moves on until the next look, and is then put back
    apart = now - before
    tau = t - h * (now / select(apart == 0.0, 1.0, apart))
    last = state[(row + TAU) * LANES + k]
    wait = select(hit & (count > 0.0), tau - last, 0.0)
    state[(row + SQUARES) * LANES + k] += wait * wait
    state[(row + TAU) * LANES + k] = select(hit, tau, last)
    state[(row + COUNT) * LANES + k] = select(hit, count + 1.0, count)
    write(hit, (t, before, now), state, k, row + RECORDS + RECORD)
    if len(attitude) > 0:
        write(hit, q, state, k, row + RECORDS + RECORD + 3)
    write(hit, l, state, k, row + RECORDS + RECORD + 7)
    return (1 if hit & (count == 0.0) else 0) | note(events[1:], halted, body, effects, t, h, q, l, attitude, state, k, row + EVENT)


def note_first(events, state, k, row):
    """The last of each event is its first, where there was one only."""
    if len(events) == 0:
        return 0
    one = state[(row + COUNT) * LANES + k] == 1.0
    state[(row + FIRST_TAU) * LANES + k] = select(one, state[(row + TAU) * LANES + k], state[(row + FIRST_TAU) * LANES + k])
    last = row + RECORDS + RECORD
    write(one, three_at(state, k, last) + four_at(state, k, last + 3) + three_at(state, k, last + 7), state, k, row + RECORDS)
    return note_first(events[1:], state, k, row + EVENT)


def write(condition, values, state, k, row):
    """Write a tuple to rows of lane k where the condition holds."""
    if len(values) == 0:
        return 0
    state[row * LANES + k] = select(condition, values[0], state[row * LANES + k])
    return write(condition, values[1:], state, k, row + 1)


def level_of(events, which, body, effects, t, q, l):
    """The level of one event."""
    if len(events) == 1:
        return level(events[0], body, effects, t, q, l)
    return select(which == 0, level(events[0], body, effects, t, q, l), level_of(events[1:], which - 1, body, effects, t, q, l))


def guess(state, k, row):
    """Where a level is 0 between two steps back, of which share and level are in four rows: by a straight line, within the step."""
    low, below, high, above = (
        state[row * LANES + k],
        state[(row + 1) * LANES + k],
        state[(row + 2) * LANES + k],
        state[(row + 3) * LANES + k],
    )
    apart = above - below
    share = low - (high - low) * (below / select(apart == 0.0, 1.0, apart))
    return select(apart == 0.0, low, min(max(share, min(low, high)), max(low, high)))


def back(own, state, k, row, h):
    """(time, step) of the next step back of lane k."""
    if len(own) > 0:
        return state[(row + 4) * LANES + k], -guess(state, k, row) * state[STEP_AT * LANES + k]
    return state[(row + 4) * LANES + k], -guess(state, k, row) * h


def narrow(share, found, state, k, row):
    """The next two steps back after Illinois: the level of an end that stays is halved."""
    low, below, high, above = (
        state[row * LANES + k],
        state[(row + 1) * LANES + k],
        state[(row + 2) * LANES + k],
        state[(row + 3) * LANES + k],
    )
    turned = found * above < 0.0  # between here and the end that was found last
    state[row * LANES + k] = select(turned, high, low)
    state[(row + 1) * LANES + k] = select(turned, above, 0.5 * below)
    state[(row + 2) * LANES + k] = share
    state[(row + 3) * LANES + k] = found
    return 0


def find(integrator, parts, effects, events, own, which, h, tries, precision, state, row, events_row):
    """The time at which record `which` (2 i + 0 or 1: first or last of event i) happened, to row `row` + 4; the state itself is used up."""
    at = events_row + which // 2 * EVENT + RECORDS + which % 2 * RECORD
    for k in range(LANES):
        state[row * LANES + k], state[(row + 1) * LANES + k] = 0.0 * h, state[(at + 2) * LANES + k]
        state[(row + 2) * LANES + k], state[(row + 3) * LANES + k] = h / h, state[(at + 1) * LANES + k]
        state[(row + 4) * LANES + k] = state[at * LANES + k]
    for i in range(REST):
        for k in range(LANES):
            state[(REST_AT + i) * LANES + k] = state[(at + 3 + i) * LANES + k]
    kind = precision.dtype.type
    lead, opening = kind(parts[0, 3]), (kind(parts[0, 0]), kind(parts[0, 1]), kind(parts[0, 2]))
    for _ in range(tries):
        for k in range(LANES):
            body, present = read(_BODY, state, BODY_AT, k, LANES), read_all(effects, state, EFFECTS_AT, k, LANES)
            t, by = back(own, state, k, row, h)
            q, l = opened(
                integrator,
                body,
                present,
                t + lead * by,
                scale(by, opening),
                four_at(state, k, REST_AT),
                three_at(state, k, REST_AT + 4),
            )
            put(q + l, state, k, LANES)
        for p in range(1, parts.shape[0]):
            share, shares = kind(parts[p, 3]), (kind(parts[p, 0]), kind(parts[p, 1]), kind(parts[p, 2]))
            for k in range(LANES):
                body, present = read(_BODY, state, BODY_AT, k, LANES), read_all(effects, state, EFFECTS_AT, k, LANES)
                t, by = back(own, state, k, row, h)
                q, l = step(
                    integrator,
                    body,
                    present,
                    t + share * by,
                    by,
                    scale(by, shares),
                    four_at(state, k, 0),
                    three_at(state, k, MOMENTUM),
                )
                put(q + l, state, k, LANES)
        for k in range(LANES):
            body, present = read(_BODY, state, BODY_AT, k, LANES), read_all(effects, state, EFFECTS_AT, k, LANES)
            t, by = back(own, state, k, row, h)
            q, l = closed(
                integrator,
                body,
                present,
                t + by + lead * by,
                scale(by, opening),
                four_at(state, k, 0),
                three_at(state, k, MOMENTUM),
            )
            there = level_of(events, which // 2, body, present, t + by, q, l)
            narrow(guess(state, k, row), there, state, k, row)
    for k in range(LANES):
        t, by = back(own, state, k, row, h)
        at_start = (state[(at + 1) * LANES + k] < 0.0) == (state[(at + 2) * LANES + k] < 0.0)
        state[(row + 4) * LANES + k] = select(at_start, t, t + by)


for _function in (
    begin_events, look_at_events, happened, stopped, held, note, note_first, write, level_of, guess, back, narrow, find,
):  # fmt: skip
    inline(_function)
