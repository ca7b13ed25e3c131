"""Stays: events that count only once their level has been above 0 for some time.

A stay begins where the level rises through 0 and ends where it falls through 0. Both times are
sought on the dense output, so that it does not depend on the step whether a stay counts. The row
SINCE of the event has the time at which the present stay began, inf if there is none or if it
counts already.
"""

import math
import sys

from rigidmc.dynamics.so3 import select, select_each
from rigidmc.engine.compose import inline_all
from rigidmc.engine.dense import between, smooth, time
from rigidmc.engine.intrinsics import any_of
from rigidmc.engine.kinds import filled
from rigidmc.engine.layout import COUNT, FIRST_TAU, RECORDS, SINCE, TAU
from rigidmc.engine.memory import put
from rigidmc.engine.roots import guess, narrowed
from rigidmc.observables.protocol import level

# Levels that are tried on the dense output: an end of a stay is then known to 1e-6 of a step, which
# is less than the dense output is off.
TRIES = 4


def at_start(wait, there, t):
    """(count, SINCE) of an event that is `there` at the start."""
    if len(wait) == 0:
        return select(there, 1.0, 0.0), 0.0
    return 0.0, select(there, t, math.inf)


def note_end(wait, event, hit, step, first_back, before, back, now, work, row):
    """Write down that a stay begins or ends; one that ends counts if it has lasted.

    wait : see `holds` of `rigidmc.observables.protocol`;  the rest : as of `note_one`
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
    for _ in range(TRIES):
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


inline_all(sys.modules[__name__])
