"""Events: whether one happened in a step, and when, to the order of the integrator.

An event is EVENT rows of what is known of a member, see `rigidmc.engine.kernel.monitoring`. When it
happens, the state at the end of that step is noted. At the end of the run (`find` of
`rigidmc.engine.kernel.block`) single steps are made back from there, by regula falsi for the length
at which the level is 0: the time is as exact as the integrator.

Stays: events that count only once their level has been above 0 for some time.

A stay begins where the level rises through 0 and ends where it falls through 0. Both times are
sought on the dense output, so that it does not depend on the step whether a stay counts. The row
SINCE of the event has the time at which the present stay began, inf if there is none or if it
counts already.

The search for a root within a step, by regula falsi after Illinois.
"""

import math
import sys

import numpy as np

from rigidmc.engine.compiler.compose import inline_all
from rigidmc.engine.compiler.intrinsics import any_of, in_precision
from rigidmc.engine.compiler.memory import four_at, put, three_at
from rigidmc.engine.compiler.trees import filled, parts_of
from rigidmc.engine.kernel.dense_output import between, smooth, time
from rigidmc.engine.kernel.layout import (  # fmt: skip
    ATTITUDE,
    BEGAN,
    BODY,
    COUNT,
    EFFECTS,
    EVENT,
    FIRST_TAU,
    KNOWN,
    LENGTH,
    LEVEL,
    RECORD,
    RECORDS,
    SINCE,
    SQUARES,
    TAU,
    TIMES,
    TRUE,
    body_at,
    momentum_at,
    put_opened,
)
from rigidmc.physics.dynamics.so3 import opposite, select, select_each
from rigidmc.physics.integrators.protocol import closed, opened
from rigidmc.physics.observables.protocol import Record, armed, holds, level, past, stops

# Steps back: regula falsi after Illinois has order 3 in three steps, and after five steps the error
# is 1e-15 of a step.
TRIES = 8


def record_of(rows, healthy):
    """The Record of an event from its rows of a block; nan for members that are not healthy."""
    count = np.where(healthy, rows[COUNT], np.nan)
    never = ~(count > 0.0)
    times = rows[TIMES], rows[TIMES + 1], rows[RECORDS]
    first, last, seen = (np.where(never, np.nan, x) for x in times)
    return Record(count, first, last, rows[TAU], rows[FIRST_TAU], rows[SQUARES], seen)


def begin_events(events, body, effects, t, q, l, work, row):
    """Set the rows of events at the start, where an event may count as happened."""
    if len(events) == 0:
        return 0
    now = level(events[0], body, effects, t, q, l)
    count, since = at_start(holds(events[0]), past(events[0], now), t)
    first = select(armed(events[0], body, q, l, now, now != now), now, 0.0)
    put((first, count, t, t, since, t, t), work, row)
    noted = (t, 0.0, now, 0.0, now) + q + l
    put(noted + noted, work, row + RECORDS)
    return begin_events(events[1:], body, effects, t, q, l, work, row + EVENT)


def levels_at(events, work, row):
    """The levels of events after the last step, from their rows."""
    if len(events) == 0:
        return ()
    return (work[row + LEVEL],) + levels_at(events[1:], work, row + EVENT)


def put_levels(levels, work, row):
    """Write what `levels_at` reads."""
    if len(levels) == 0:
        return 0
    work[row + LEVEL] = levels[0]
    return put_levels(levels[1:], work, row + EVENT)


def levels_of(events, body, effects, t, q, l):
    """The levels of events in a state."""
    if len(events) == 0:
        return ()
    first = level(events[0], body, effects, t, q, l)
    return (first,) + levels_of(events[1:], body, effects, t, q, l)


def happened(before, now):
    """Whether an event happened between two levels."""
    return (before * now <= 0.0) & (before != 0.0)


def any_happened(before, now):
    """Whether any event happened in a step."""
    if len(now) == 1:
        return happened(before[0], now[0])
    return happened(before[0], now[0]) | any_happened(before[1:], now[1:])


def armed_again(events, moves, body, q, l, before, now):
    """The levels from which events may happen in the next step, 0 if they cannot.

    For members that made no step they are those before.
    """
    if len(events) == 0:
        return ()
    still = (before[0] != 0.0) & opposite(happened(before[0], now[0]))
    new = select(armed(events[0], body, q, l, now[0], still), now[0], 0.0)
    rest = armed_again(events[1:], moves, body, q, l, before[1:], now[1:])
    return (select(moves, new, before[0]),) + rest


def stopped(events, work, row):
    """1 if an event has stopped the member, else 0."""
    if len(events) == 0:
        return 0.0
    if len(stops(events[0])) == 0:
        return stopped(events[1:], work, row + EVENT)
    return select(work[row + COUNT] > 0.0, 1.0, 0.0)  # at most one event stops members


def held(events, work, row, q, l):
    """(q, L), or if an event has stopped the member the state at the end of that step."""
    if len(events) == 0:
        return q, l
    if len(stops(events[0])) == 0:
        return held(events[1:], work, row + EVENT, q, l)
    here, at = work[row + COUNT] > 0.0, row + RECORDS + 5
    q, l = select_each(here, four_at(work, at), q), select_each(here, three_at(work, at + 4), l)
    return held(events[1:], work, row + EVENT, q, l)


def passed(events, moves, step, before, work, row):
    """The levels of events after a step of which only the end is watched."""
    if len(events) == 0:
        return ()
    now = levels_of(events, step.body, step.effects, step.t, step.q, step.l)
    backs, back = all_begun(before), (0.0, 0.0)
    return settled(events, moves, step, backs, before, back, step.q, step.l, now, work, row)


def all_begun(levels):
    """For each level a whole step back, and no part of a step more."""
    if len(levels) == 0:
        return ()
    return ((1.0, 0.0),) + all_begun(levels[1:])


def settled(events, moves, step, backs, before, back, q, l, now, work, row):
    """The levels of events after a part of a step that ends in (q, L); what happened is written
    down. Arguments as of `note`."""
    if any_of(any_happened(before, now)):
        note(events, moves, step, backs, before, back, now, work, row)
    all_lasting(events, moves, step, back[0], now, work, row)
    return armed_again(events, moves, step.body, q, l, before, now)


def all_lasting(events, moves, step, back, now, work, row):
    """Count the events that have lasted by the end of a part of a step."""
    if len(events) == 0:
        return 0
    lasting(holds(events[0]), moves, step, back, now[0], work, row)
    return all_lasting(events[1:], moves, step, back, now[1:], work, row + EVENT)


def note(events, moves, step, backs, before, back, now, work, row):
    """Write down the events between two states of a step, of members that move.

    step : its Step;  backs, back : of the two states the parts of a step from its end back to
        them, and how much further the event may be; the first may differ by event
    before, now : the levels in the states

    A stopped member makes steps until the next look: it does not move, and nothing is written.
    """
    if len(events) == 0:
        return 0
    hit = happened(before[0], now[0]) & moves
    note_one(events[0], hit, step, backs[0], before[0], back, now[0], work, row)
    return note(events[1:], moves, step, backs[1:], before[1:], back, now[1:], work, row + EVENT)


def note_one(event, hit, step, first_back, before, back, now, work, row):
    """Write down an event of the members that it hit; arguments as of `note`."""
    return note_by(holds(event), event, hit, step, first_back, before, back, now, work, row)


def note_by(wait, event, hit, step, first_back, before, back, now, work, row):
    """`note_one` of an event that has to last if there is a `wait`."""
    if len(wait) == 0:
        return note_pass(hit, step, first_back, before, back, now, work, row)
    return note_end(wait, event, hit, step, first_back, before, back, now, work, row)


def note_pass(hit, step, first_back, before, back, now, work, row):
    """`note_one` of an event that counts when its level passes through 0."""
    t, h, q, l = step.t, step.h, step.q, step.l
    count, last = work[row + COUNT], work[row + TAU]
    apart = now - before
    # both 0: the share of the step is 0, whatever the unit of the level
    share = now / select(apart == 0.0, 1.0, apart)
    tau = t - h * (back[0] + (first_back[0] - back[0]) * share)
    wait = select(hit & (count > 0.0), tau - last, 0.0)
    work[row + SQUARES] = work[row + SQUARES] + wait * wait
    work[row + TAU] = select(hit, tau, last)
    work[row + COUNT] = select(hit, count + 1.0, count)
    first = hit & (count == 0.0)
    work[row + FIRST_TAU] = select(first, tau, work[row + FIRST_TAU])
    noted = (t, back[0] - back[1], now, first_back[0] + first_back[1], before) + q + l
    if any_of(first):
        write(first, noted, work, row + RECORDS)
    write(hit, noted, work, row + RECORDS + RECORD)
    return 0


def seek(kinds, numbers, parts, work, spare, aside, row, which, tried, ends, longer):
    """One try for the exact time of an event: prepare a step back to where its level should be 0.

    which : 2 i for the first, 2 i + 1 for the last of event i;  tried : steps back made so far
    spare, aside : a state, and what is known of it, for the step back. In the rows TRUE of `aside`
        are the ends between which the level is 0, and the length of the step
    ends, longer : when the steps before the last interval end [s], and how many times as long as
        those in it they are
    """
    integrator, effects, events = parts_of(kinds, numbers)
    at = row + which // 2 * EVENT + RECORDS + which % 2 * RECORD
    body, present = body_at(work, KNOWN + BODY), filled(effects, work, KNOWN + EFFECTS)
    t, last_h, within = work[at], work[LENGTH], four_at(work, at + 1)
    h = select(t < ends + 0.5 * last_h, last_h * longer, last_h)
    there, before = within[1], within[3]
    if tried > 0:
        share = aside[TRUE + 4]
        by = -share * h
        part = parts[0] * by, parts[1] * by, parts[2] * by
        q = in_precision(four_at(spare, ATTITUDE), work)
        l = in_precision(momentum_at(integrator, spare), work)
        q, l = closed(integrator, body, present, t + by + parts[3] * by, part, q, l)
        here = level_of(events, which // 2, body, present, t + by, q, l)
        within = narrowed(four_at(aside, TRUE), share, here)
    share = guess(within)
    by = -share * h
    put(within + (share,), aside, TRUE)
    part = parts[0] * by, parts[1] * by, parts[2] * by
    q, l = four_at(work, at + 5), three_at(work, at + 9)
    q, l = opened(integrator, body, present, t + parts[3] * by, part, q, l)
    put_opened(in_precision(q, spare), in_precision(l, spare), spare)
    put((t, by), aside, BEGAN)
    at_start = (before < 0.0) == (there < 0.0)
    work[row + which // 2 * EVENT + TIMES + which % 2] = select(at_start, t, t + by)
    return 0


def level_of(events, which, body, effects, t, q, l):
    """The level of one event."""
    if len(events) == 1:
        return level(events[0], body, effects, t, q, l)
    if which == 0:
        return level(events[0], body, effects, t, q, l)
    return level_of(events[1:], which - 1, body, effects, t, q, l)


# Levels that are tried on the dense output: an end of a stay is then known to 1e-6 of a step, which
# is less than the dense output is off.
DWELL_TRIES = 4


def at_start(wait, there, t):
    """(count, SINCE) of an event that is `there` at the start."""
    if len(wait) == 0:
        return select(there, 1.0, 0.0), 0.0
    return 0.0, select(there, t, math.inf)


def note_end(wait, event, hit, step, first_back, before, back, now, work, row):
    """Write down that a stay begins or ends; one that ends counts if it has lasted.

    wait : see `holds` of `rigidmc.physics.observables.protocol`;  the rest : as of `note_one`
    """
    t = crossing(wait[1:], event, step, first_back[0], before, back[0], now)
    count_stay(wait, hit & (before > 0.0), t, step, work, row)
    since = work[row + SINCE]
    work[row + SINCE] = select(hit, select(before < 0.0, t, math.inf), since)
    return 0


def crossing(known, event, step, first_back, before, back, now):
    """The time at which the level of an event passes through 0 between two states of a step; by a
    straight line if the motion between them is not known."""
    zero = 0.0 * now
    ends = zero + (1.0 - first_back), before, zero + (1.0 - back), now
    if len(known) == 0:
        return time(step, guess(ends))
    path, x = smooth(step), guess(ends)
    for _ in range(DWELL_TRIES):
        q, l = between(path, x)
        here = level(event, step.body, step.effects, time(step, x), q, l)
        ends = narrowed(ends, x, here)
        x = guess(ends)
    return time(step, x)


def lasting(wait, moves, step, back, now, work, row):
    """Count a stay as soon as it has lasted; back, now : part of the step after the present state,
    and the level there."""
    if len(wait) == 0:
        return 0
    return count_stay(wait, moves & (now >= 0.0), step.t - back * step.h, step, work, row)


def count_stay(wait, beyond, t, step, work, row):
    """Count the stay of members that are `beyond` until t, if it has lasted."""
    since, count = work[row + SINCE], work[row + COUNT]
    lasted = beyond & (t - since >= wait[0])
    first = lasted & (count == 0.0)
    work[row + COUNT] = select(lasted, count + 1.0, count)
    work[row + TAU] = select(lasted, since, work[row + TAU])
    work[row + FIRST_TAU] = select(first, since, work[row + FIRST_TAU])
    work[row + SINCE] = select(lasted, math.inf, since)
    if any_of(first):  # where an event that stops members stops them
        zero = 0.0 * t
        noted = (zero + step.t, zero, zero, zero, zero) + step.q + step.l
        write(first, noted, work, row + RECORDS)
    return 0


def write(condition, values, work, row):
    """Write a tuple to rows if the condition holds."""
    return put(select_each(condition, values, filled(values, work, row)), work, row)


def guess(ends):
    """Where the level is 0 by a straight line between two steps back, and within the step.

    ends = (share of the step, level there, share, level there)
    """
    low, below, high, above = ends
    apart = above - below
    # what is divided by 1 is not taken
    share = low - (high - low) * (below / select(apart == 0.0, 1.0, apart))
    return select(apart == 0.0, low, min(max(share, min(low, high)), max(low, high)))


def narrowed(ends, share, here):
    """The next ends after Illinois, one of them `share` with the level `here`.

    An end that stays has its level halved.
    """
    low, below, high, above = ends
    between = here * above < 0.0  # the level is 0 between `share` and the newer end
    return select(between, high, low), select(between, above, 0.5 * below), share, here


inline_all(sys.modules[__name__])
