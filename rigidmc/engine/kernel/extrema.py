"""Extrema between two nodes of a step: of observables, and of events there and back in one step.

A number whose slopes at two nodes have opposite signs has an extremum between them. It is found in
three stages, each for the members that the previous stage leaves: by a parabola, by a cubic
polynomial, and on the dense output, with one Newton step from there. A loop over all numbers makes
each further number cheap to compile. A Node is as in `rigidmc.engine.kernel.monitoring`.
"""

import sys
from typing import Any, NamedTuple

from rigidmc.engine.compiler.compose import inline_all
from rigidmc.engine.compiler.derivatives import without_derivatives
from rigidmc.engine.compiler.intrinsics import any_of
from rigidmc.engine.kernel.dense_output import AHEAD, interpolate, make_interpolant, time_within
from rigidmc.engine.kernel.events import following, levels_of, record_event, tails_after
from rigidmc.physics.dynamics.so3 import (
    axpy,
    axpy4,
    concat,
    difference,
    difference4,
    first_three,
    root,
    select,
    select_all,
    touch_up,
)
from rigidmc.physics.effects.present import in_state
from rigidmc.physics.observables.compiled import armed, extrema, extremum_limits, update
from rigidmc.physics.observables.statistics import rest

# How far a minimum may lie below its estimate, in units of the change of the slope: for an estimate
# by a parabola, and by a cubic. Over 1.6 rad of a cosine the minimum is 0.007 below the latter.
# Without PARABOLA_DOUBT, extrema near the vertical were 0.026 rad off.
PARABOLA_DOUBT, CUBIC_DOUBT = 0.02, 0.01
# Levels at inner nodes are up to 3e-4 off, so an event may lie slightly beyond them: its bracket is
# wider by this fraction of a step, times x (1 - x).
WIDENING = 0.01
NO_LIMIT = 1e300  # every number is below it


class Extremum(NamedTuple):
    """A possible extremum of a number between two nodes.

    mark : whether it may count
    sign : 1 for a minimum, -1 for a maximum
    limit : it counts if sign * value falls below this
    """

    mark: Any
    sign: Any
    limit: Any


class SubInterval(NamedTuple):
    """The interval between two nodes of a step.

    a, b : the completed fractions of the step at the nodes
    t, q, l : time and state at the second node
    """

    a: Any
    b: Any
    t: Any
    q: Any
    l: Any


def numbers_at(events, running, step, t, q, l):
    """Return the numbers of a Node: levels of events, then `extrema` of running observables."""
    body, effects = step.body, step.effects
    of_events = levels_of(events, body, effects, t, q, l)
    return concat(of_events, running_numbers(running, body, effects, t, q, l))


def running_numbers(running, body, effects, t, q, l):
    """Return the numbers of `extrema` for all running observables, one after the other."""
    if len(running) == 0:
        return ()
    present = in_state(effects, l[3:])
    first = extrema(running[0][0], body, present, t, q, first_three(l))
    return concat(first, running_numbers(running[1:], body, effects, t, q, l))


def interval_starts(levels, interval):
    """Return the start of a SubInterval for each event, as `record_events` takes it."""
    if len(levels) == 0:
        return ()
    zero = 0.0 * levels[0]
    first = zero + (1.0 - interval.a), zero + widening(interval.a)
    return (first,) + interval_starts(levels[1:], interval)


def widening(x):
    """Return how far beyond a node an event may lie [steps]; 0 at the ends of a step."""
    return WIDENING * x * (1.0 - x)


def event_extrema(events, moves, step, interval, levels, before, now):
    """Return the Extremum of each event: of its level beyond 0, or one at which the event arms.

    levels : at the first node, 0 if the event cannot happen
    before, now : the Nodes
    """
    if len(levels) == 0:
        return ()
    sign = select(before[0][0] < 0.0, -1.0, 1.0)
    a, b = signed(sign, before[0]), signed(sign, now[0])
    peak = sign * tangent_bound(a, b, interval)
    # A level that rises and falls again below 0 may arm its event on the way.
    arms = (a[1] > 0.0) & (b[1] < 0.0) & (levels[0] == 0.0)
    arms = arms & armed(
        events[0], step.body, interval.q, first_three(interval.l), peak, peak != peak
    )
    mark = ((b[0] > 0.0) & may_dip(a, b, interval) | arms) & moves
    first = Extremum(mark, select(before[0][1] < 0.0, 1.0, -1.0), select(arms, NO_LIMIT, 0.0))
    others = event_extrema(events[1:], moves, step, interval, levels[1:], before[1:], now[1:])
    return (first,) + others


def signed(sign, point):
    """Return a pair (number, slope), both times `sign`."""
    return sign * point[0], sign * point[1]


def running_extrema(running, moves, interval, totals, before, now):
    """Return the Extremum of each number of running observables, marked if it may change a state.

    before, now : the Nodes, without events
    """
    if len(before) == 0:
        return ()
    limits = extremum_limits(running[0][0], totals[0])
    first = observable_extrema(limits, moves, interval, before, now)
    ends = rest(limits, before), rest(limits, now)
    others = running_extrema(running[1:], moves, interval, totals[1:], ends[0], ends[1])
    return concat(first, others)


def observable_extrema(limits, moves, interval, before, now):
    """Compute `running_extrema` of one observable; limits : from `extremum_limits`."""
    if len(limits) == 0:
        return ()
    is_minimum = before[0][1] < 0.0
    # limits only decide, and some depend on no parameter: all of one type
    low, high = without_derivatives(limits[0][0]), without_derivatives(limits[0][1])
    sign, limit = select(is_minimum, 1.0, -1.0), select(is_minimum, low, -high)
    a = sign * before[0][0] - limit, sign * before[0][1]
    mark = may_dip(a, (sign * now[0][0] - limit, sign * now[0][1]), interval) & moves
    others = observable_extrema(limits[1:], moves, interval, before[1:], now[1:])
    return (Extremum(mark, sign, limit),) + others


def may_dip(a, b, interval):
    """Return whether a number may fall below 0 between two nodes.

    The estimate is a parabola through one value and both slopes.

    a, b : (value, slope) at the nodes
    """
    bend, width = 2.0 * (b[1] - a[1]), interval.b - interval.a
    # The parabola's minimum is value - slope^2 width / (2 bend): multiplied out, because bend may
    # be 0.
    margin = (0.5 * PARABOLA_DOUBT) * bend * bend
    dips = width * (a[1] * a[1] + margin) > bend * a[0]
    dips = dips | (width * (b[1] * b[1] + margin) > bend * b[0])
    return (a[1] < 0.0) & (b[1] > 0.0) & dips


def tangent_bound(a, b, interval):
    """Return an upper bound on a number between two nodes, from the tangents.

    a, b : (value, slope) at the nodes; the number rises from the first and falls to the second
    """
    width = interval.b - interval.a
    return min(a[0] + width * a[1], b[0] - width * b[1])


def cubic_minimum(a, b, interval):
    """Return (place, value) of the minimum of a number between two nodes, by a cubic polynomial.

    a, b : (value, slope) at the nodes, one slope negative, the other positive
    Source: Nocedal & Wright, Numerical Optimization (2006), (3.59).
    """
    width = interval.b - interval.a
    rate = (b[0] - a[0]) / width
    middle = a[1] + b[1] - 3.0 * rate
    discriminant = root(middle * middle - a[1] * b[1])
    divisor = b[1] - a[1] + 2.0 * discriminant
    # For a straight line `discriminant` keeps the unit; where all are 0, any divisor gives 0.
    back = (b[1] + discriminant - middle) / select(divisor == 0.0, 1.0, divisor)
    y, curvature = 1.0 - back, 3.0 * rate - b[1] - 2.0 * a[1]
    value = a[0] + width * y * (a[1] + y * (curvature + y * (a[1] + b[1] - 2.0 * rate)))
    return interval.b - width * back, value


def refine_extrema(
    events, running, extrema, step, interval, before, now, befores, levels, totals, rows
):
    """Return (befores, levels, totals) after the extrema of a SubInterval.

    extrema : the Extremum of each number
    before, now : Nodes
    befores, levels : where events begin in the SubInterval, as `record_events` takes them
    """
    if len(extrema) == 0:
        return befores, levels, totals
    # Branches for all lanes at once: each stage costs more than the previous one, and few members
    # need it.
    if any_of(any_mark(extrema)):
        for k in range(len(extrema)):
            extremum = item_at(extrema, k)
            sign = extremum.sign
            a, b = signed(sign, item_at(before, k)), signed(sign, item_at(now, k))
            x, lowest = cubic_minimum(a, b, interval)
            margin = CUBIC_DOUBT * (interval.b - interval.a) * (b[1] - a[1])
            found = extremum.mark & (lowest - margin < extremum.limit)
            if any_of(found):
                x, q, l = extremum_state(events, running, step, interval, k, sign, a[1], b[1], x)
                totals = update_running(running, k - len(levels), found, step, x, q, l, totals)
                befores, levels = record_extremum(
                    events, k, found, step, x, q, l, befores, levels, rows, step.tails
                )
    return befores, levels, totals


def any_mark(extrema):
    """Return whether any of the extrema is marked."""
    if len(extrema) == 1:
        return extrema[0].mark
    return extrema[0].mark | any_mark(extrema[1:])


def item_at(values, k):
    """Return values[k] of a tuple, where k is known only at run time."""
    if len(values) == 1:
        return values[0]
    if k == 0:
        return values[0]
    return item_at(values[1:], k - 1)


def extremum_state(events, running, step, interval, k, sign, first_slope, last_slope, x):
    """Return (fraction of the step, q, L) at the extremum of number k, near the fraction x.

    first_slope, last_slope : its slopes at the nodes, times `sign`

    One Newton step from x; the second derivative there comes from a parabola through the three
    slopes. The state moves along the motion at x.
    """
    path = make_interpolant(step)
    (q, l), (p, m) = interpolate(path, x), interpolate(path, x + AHEAD)
    t, late = time_within(step, x), time_within(step, x + AHEAD)
    value_here = item_at(numbers_at(events, running, step, t, q, l), k)
    value_ahead = item_at(numbers_at(events, running, step, late, p, m), k)
    slope = sign * ((value_ahead - value_here) * (1.0 / AHEAD))
    before, after = x - interval.a, interval.b - x
    bend = (slope - first_slope) * after * after + (last_slope - slope) * before * before
    # A straight line has no extremum: 1 only keeps the quotient finite.
    change = slope * (interval.b - interval.a) * before * after / select(bend > 0.0, bend, 1.0)
    change = -min(max(select(bend > 0.0, change, 0.0), -after), before)
    steps_ahead = change * (1.0 / AHEAD)
    q = touch_up(axpy4(q, steps_ahead, difference4(p, q)))
    return x + change, q, axpy(l, steps_ahead, difference(m, l))


def update_running(running, k, found, step, x, q, l, totals):
    """Return the states of running observables after an extremum of their number k."""
    if len(running) == 0:
        return ()
    limits, first = extremum_limits(running[0][0], totals[0]), totals[:1]
    others = update_running(running[1:], k - len(limits), found, step, x, q, l, totals[1:])
    if len(limits) == 0:
        return first + others
    if k >= 0 and k < len(limits):
        t = time_within(step, x)
        present = in_state(step.effects, l[3:])
        new = update(running[0][0], totals[0], step.body, present, t, q, first_three(l))
        first = (select_all(found, new, totals[0]),)
    return first + others


def record_extremum(events, k, found, step, x, q, l, befores, levels, rows, tails):
    """Return (befores, levels) of events after an extremum of the level of event k.

    If the event has happened by then, it is recorded and may be rearmed.
    """
    if len(events) == 0:
        return (), ()
    (before, widened), start = befores[0], levels[0]
    if k == 0:
        level = levels_of(events[:1], step.body, step.effects, time_within(step, x), q, l)[0]
        hit = found & (level * start <= 0.0) & (start != 0.0)
        start_back = before, widened
        after = 1.0 - x, 0.0
        record_event(events[0], hit, step, start_back, start, after, level, rows, tails)
        restarts = hit | (found & (start == 0.0))
        arms = armed(events[0], step.body, q, first_three(l), level, level != level)
        rearmed = select(arms, level, 0.0)
        before, widened = select(restarts, 1.0 - x, before), select(restarts, 0.0, widened)
        start = select(restarts, rearmed, start)
    others = record_extremum(
        events[1:], k - 1, found, step, x, q, l, befores[1:], levels[1:], following(rows),
        tails_after(tails, step.effects),
    )  # fmt: skip
    return ((before, widened),) + others[0], (start,) + others[1]


inline_all(sys.modules[__name__])
