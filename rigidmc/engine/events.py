"""Events: whether one happened in a step, and when to the order of the integrator.

An event is EVENT rows of a state. Of one that happened in a step the state at the step's end is kept, and at the end of the run (`find`) steps
are made back from there, of the length at which its level is 0: as exact as the integrator.
"""

from typing import Any, NamedTuple

from rigidmc.dynamics.so3 import opposite, select, select_each
from rigidmc.engine.compose import filled, inline
from rigidmc.engine.memory import four_at, put, three_at
from rigidmc.observables.protocol import armed, level, past

# Rows of an event: its level after the last step, 0 where it cannot happen next; how often it happened; when by linear interpolation, last and first;
# the squares of the times between; when exactly, first and last; and of first and last the time of the step's end, the levels before and there, and the state.
LEVEL, COUNT, TAU, FIRST_TAU, SQUARES, TIMES, RECORDS, RECORD, EVENT = 0, 1, 2, 3, 4, 5, 7, 10, 27
TRIES = 8  # steps back: by regula falsi after Illinois, of order 3 in three steps; what is left after five is 1e-15 of a step


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
    first, last, seen = (
        np.where(never, np.nan, x) for x in (rows[TIMES], rows[TIMES + 1], rows[RECORDS])
    )
    return Record(count, first, last, rows[TAU], rows[FIRST_TAU], rows[SQUARES], seen)


def begin_events(events, body, effects, t, q, l, state, row):
    """The rows of events at the start; what an event leads to may be so already."""
    if len(events) == 0:
        return 0
    now = level(events[0], body, effects, t, q, l)
    there = past(events[0], now)
    first = select(armed(events[0], body, q, l, now, now != now), now, 0.0)
    put((first, select(there, 1.0, 0.0), t, t, 0.0, t, t), state, row)
    put((t, now, now) + q + l + (t, now, now) + q + l, state, row + RECORDS)
    return begin_events(events[1:], body, effects, t, q, l, state, row + EVENT)


def levels_at(events, state, row):
    """The levels of events after the last step, from their rows."""
    if len(events) == 0:
        return ()
    return (state[row + LEVEL],) + levels_at(events[1:], state, row + EVENT)


def levels_of(events, body, effects, t, q, l):
    """The levels of events in a state."""
    if len(events) == 0:
        return ()
    return (level(events[0], body, effects, t, q, l),) + levels_of(
        events[1:], body, effects, t, q, l
    )


def put_levels(levels, state, row):
    """Write what `levels_at` reads."""
    if len(levels) == 0:
        return 0
    state[row + LEVEL] = levels[0]
    return put_levels(levels[1:], state, row + EVENT)


def happened(before, now):
    """Whether an event happened between two levels."""
    return (before * now <= 0.0) & (before != 0.0)


def any_happened(before, now):
    """Whether any event happened in a step."""
    if len(now) == 1:
        return happened(before[0], now[0])
    return happened(before[0], now[0]) | any_happened(before[1:], now[1:])


def armed_again(events, moves, body, q, l, before, now):
    """The levels from which events may happen in the next step, 0 where they cannot; those of a member that made no step stay."""
    if len(events) == 0:
        return ()
    still = (before[0] != 0.0) & opposite(happened(before[0], now[0]))
    first = select(
        moves, select(armed(events[0], body, q, l, now[0], still), now[0], 0.0), before[0]
    )
    return (first,) + armed_again(events[1:], moves, body, q, l, before[1:], now[1:])


def stopped(events, state, row):
    """1 where an event has stopped the member, else 0."""
    if len(events) == 0:
        return 0.0
    if len(events[0].stop) == 0:
        return stopped(events[1:], state, row + EVENT)
    return select(state[row + COUNT] > 0.0, 1.0, stopped(events[1:], state, row + EVENT))


def held(events, state, row, q, l):
    """(q, L), or where an event has stopped the member the state at the end of that step."""
    if len(events) == 0:
        return q, l
    if len(events[0].stop) == 0:
        return held(events[1:], state, row + EVENT, q, l)
    here, at = state[row + COUNT] > 0.0, row + RECORDS + 3
    q, l = select_each(here, four_at(state, at), q), select_each(here, three_at(state, at + 4), l)
    return held(events[1:], state, row + EVENT, q, l)


def note(events, moves, t, h, q, l, before, now, state, row):
    """Write down the events of a step that ended at t in (q, L), of members that move: not of one that is stopped, which moves on until the next look."""
    if len(events) == 0:
        return 0
    count, last = state[row + COUNT], state[row + TAU]
    hit = happened(before[0], now[0]) & moves
    apart = now[0] - before[0]
    tau = t - h * (now[0] / select(apart == 0.0, 1.0, apart))
    wait = select(hit & (count > 0.0), tau - last, 0.0)
    state[row + SQUARES] = state[row + SQUARES] + wait * wait
    state[row + TAU] = select(hit, tau, last)
    state[row + COUNT] = select(hit, count + 1.0, count)
    first = hit & (count == 0.0)
    state[row + FIRST_TAU] = select(first, tau, state[row + FIRST_TAU])
    write(first, (t, before[0], now[0]) + q + l, state, row + RECORDS)
    write(hit, (t, before[0], now[0]) + q + l, state, row + RECORDS + RECORD)
    return note(events[1:], moves, t, h, q, l, before[1:], now[1:], state, row + EVENT)


def write(condition, values, state, row):
    """Write a tuple to rows where the condition holds."""
    return put(select_each(condition, values, filled(values, state, row)), state, row)


def level_of(events, which, body, effects, t, q, l):
    """The level of one event."""
    if len(events) == 1:
        return level(events[0], body, effects, t, q, l)
    if which == 0:
        return level(events[0], body, effects, t, q, l)
    return level_of(events[1:], which - 1, body, effects, t, q, l)


def guess(ends):
    """Where a level is 0 between two steps back, of which ends = (share, level, share, level): by a straight line, within the step."""
    low, below, high, above = ends
    apart = above - below
    share = low - (high - low) * (below / select(apart == 0.0, 1.0, apart))
    return select(apart == 0.0, low, min(max(share, min(low, high)), max(low, high)))


def narrowed(ends, share, found):
    """The next two steps back after Illinois: the level of an end that stays is halved."""
    low, below, high, above = ends
    turned = found * above < 0.0  # between here and the end that was found last
    return select(turned, high, low), select(turned, above, 0.5 * below), share, found


for _function in (
    begin_events, levels_at, levels_of, put_levels, happened, any_happened, armed_again, stopped, held, note, write, level_of, guess, narrowed,
):  # fmt: skip
    inline(_function)
