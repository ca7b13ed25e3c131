"""Where a number turns round between two states of a step: extremes, events that come and go.

A number that has opposite slopes at two nodes has an extreme between them. It is sought in three
stages, each for the members that the one before leaves: by a parabola, by a polynomial of degree 3,
and on the dense output, from there by one step of Newton's method. A loop over all numbers makes
another number little to compile.
"""

import sys
from typing import Any, NamedTuple

from rigidmc.engine.compiler.compose import inline_all
from rigidmc.engine.compiler.intrinsics import any_of
from rigidmc.engine.kernel.dense_output import AHEAD, between, smooth, time
from rigidmc.engine.kernel.events import levels_of, note_one
from rigidmc.engine.kernel.layout import EVENT
from rigidmc.physics.dynamics.so3 import (
    axpy,
    axpy4,
    difference,
    difference4,
    joined,
    root,
    select,
    select_each,
    touch_up,
)
from rigidmc.physics.observables.protocol import armed, sought, turning, update
from rigidmc.physics.observables.statistics import rest

# How much lower than its estimate a smallest value may be, as shares of the change of the slope: of
# an estimate by a parabola and by a polynomial of degree 3. Over 1.6 rad of a cosine it is 0.007
# lower than the latter. Without the first, extremes near the vertical were 0.026 rad off.
DOUBT, LESS_DOUBT = 0.02, 0.01
# Levels at inner nodes are up to 3e-4 off, so that an event may be a little beyond them: its time
# is sought in so many parts of a step more, times x (1 - x).
WIDER = 0.01
ANY = 1e300  # a limit that every number keeps


class Extremum(NamedTuple):
    """A number that may turn round between two nodes.

    mark : whether that may count;  way : 1 for a smallest value, -1 for a largest
    limit : what way * value has to fall below to count
    """

    mark: Any
    way: Any
    limit: Any


class Part(NamedTuple):
    """The part of a step between two nodes.

    a, b : the parts of the step done at the nodes;  t, q, l : time and state at the second
    """

    a: Any
    b: Any
    t: Any
    q: Any
    l: Any


def numbers_at(events, running, step, t, q, l):
    """The numbers that may turn round, see `rigidmc.engine.kernel.monitoring.Node`."""
    body, effects = step.body, step.effects
    levels = levels_of(events, body, effects, t, q, l)
    return joined(levels, all_turning(running, body, effects, t, q, l))


def all_turning(running, body, effects, t, q, l):
    """What `turning` gives of all running observables, one after the other."""
    if len(running) == 0:
        return ()
    first = turning(running[0][0], body, effects, t, q, l)
    return joined(first, all_turning(running[1:], body, effects, t, q, l))


def all_begun(levels, part):
    """The start of a Part for each event, as `note` of `rigidmc.engine.kernel.events` takes it."""
    if len(levels) == 0:
        return ()
    zero = 0.0 * levels[0]
    first = zero + (1.0 - part.a), zero + wider(part.a)
    return (first,) + all_begun(levels[1:], part)


def wider(x):
    """Parts of a step beyond a node where an event may be; 0 at the ends of a step."""
    return WIDER * x * (1.0 - x)


def all_touched(events, moves, step, part, levels, values, slopes, others, falls):
    """The Extremum of each event in a Part: its level may turn round beyond 0, or where it arms.

    levels : at the first node, 0 if the event cannot happen
    values, slopes, others, falls : levels and their slopes at the first node and at the second
    """
    if len(levels) == 0:
        return ()
    way = select(values[0] < 0.0, -1.0, 1.0)
    a, b = (way * values[0], way * slopes[0]), (way * others[0], way * falls[0])
    peak = way * farthest(a, b, part)
    arms = (a[1] > 0.0) & (b[1] < 0.0) & (levels[0] == 0.0)
    arms = arms & armed(events[0], step.body, part.q, part.l, peak, peak != peak)
    mark = ((b[0] > 0.0) & dips(a, b, part) | arms) & moves
    first = Extremum(mark, select(slopes[0] < 0.0, 1.0, -1.0), select(arms, ANY, 0.0))
    rest = all_touched(
        events[1:], moves, step, part, levels[1:], values[1:], slopes[1:], others[1:], falls[1:]
    )
    return (first,) + rest


def all_extreme(running, moves, part, kept, values, slopes, others, falls):
    """The Extremum of each number of running observables in a Part: its extreme may count.

    values, slopes, others, falls : the numbers and their slopes at the first node and at the second
    """
    if len(values) == 0:
        return ()
    limits = sought(running[0][0], kept[0])
    first = extreme(limits, moves, part, values, slopes, others, falls)
    left = all_extreme(
        running[1:], moves, part, kept[1:], rest(limits, values), rest(limits, slopes),
        rest(limits, others), rest(limits, falls),
    )  # fmt: skip
    return joined(first, left)


def extreme(limits, moves, part, values, slopes, others, falls):
    """`all_extreme` of one observable; limits : (low, high) of each number, see `sought`."""
    if len(limits) == 0:
        return ()
    least = slopes[0] < 0.0
    way, limit = select(least, 1.0, -1.0), select(least, limits[0][0], -limits[0][1])
    a = way * values[0] - limit, way * slopes[0]
    mark = dips(a, (way * others[0] - limit, way * falls[0]), part) & moves
    rest = extreme(limits[1:], moves, part, values[1:], slopes[1:], others[1:], falls[1:])
    return (Extremum(mark, way, limit),) + rest


def dips(a, b, part):
    """Whether a number may have a smallest value below 0 between two nodes, by a parabola through
    one value and both slopes.

    a, b : (value, slope) at the nodes
    """
    rise, width = 2.0 * (b[1] - a[1]), part.b - part.a
    more = (0.5 * DOUBT) * rise * rise
    low = width * (a[1] * a[1] + more) > rise * a[0]
    low = low | (width * (b[1] * b[1] + more) > rise * b[0])
    return (a[1] < 0.0) & (b[1] > 0.0) & low


def farthest(a, b, part):
    """No less than the largest of a number between two nodes where its slopes have it rise from the
    first and fall to the second, by the tangents; a, b : (value, slope) at the nodes."""
    width = part.b - part.a
    return min(a[0] + width * a[1], b[0] - width * b[1])


def lowest(a, b, part):
    """(where, value): a number is smallest between two nodes, by a polynomial of degree 3.

    a, b : (value, slope) at the nodes, one slope negative, the other positive
    Source: Nocedal & Wright, Numerical Optimization (2006), (3.59).
    """
    width = part.b - part.a
    rate = (b[0] - a[0]) / width
    middle = a[1] + b[1] - 3.0 * rate
    far = root(middle * middle - a[1] * b[1])
    apart = b[1] - a[1] + 2.0 * far
    # a straight line: `far` is of its unit, and where all are 0, `back` is 0 by anything
    back = (b[1] + far - middle) / select(apart == 0.0, 1.0, apart)
    y, square = 1.0 - back, 3.0 * rate - b[1] - 2.0 * a[1]
    value = a[0] + width * y * (a[1] + y * (square + y * (a[1] + b[1] - 2.0 * rate)))
    return part.b - width * back, value


def turned(events, running, extrema, step, part, before, now, backs, levels, kept, work, row):
    """(backs, levels, kept) after the states in a Part where numbers turn round.

    extrema : the Extremum of each number;  before, now : Nodes
    backs, levels : where events begin in the Part, as `note` takes it
    """
    if len(extrema) == 0:
        return backs, levels, kept
    if any_of(any_mark(extrema)):
        for k in range(len(extrema)):
            one = picked(extrema, k)
            a = picked(before.numbers, k), one.way * picked(before.slopes, k)
            b = picked(now.numbers, k), one.way * picked(now.slopes, k)
            x, least = lowest((one.way * a[0], a[1]), (one.way * b[0], b[1]), part)
            doubt = LESS_DOUBT * (part.b - part.a) * (b[1] - a[1])
            there = one.mark & (least - doubt < one.limit)
            if any_of(there):
                x, q, l = turning_state(events, running, step, part, k, one.way, a[1], b[1], x)
                kept = put_in(running, k - len(levels), there, step, x, q, l, kept)
                backs, levels = noted(events, k, there, step, x, q, l, backs, levels, work, row)
    return backs, levels, kept


def any_mark(extrema):
    """Whether any of the extrema is marked."""
    if len(extrema) == 1:
        return extrema[0].mark
    return extrema[0].mark | any_mark(extrema[1:])


def picked(values, k):
    """values[k] of a tuple, k known when it runs."""
    if len(values) == 1:
        return values[0]
    if k == 0:
        return values[0]
    return picked(values[1:], k - 1)


def turning_state(events, running, step, part, k, way, low, high, x):
    """(part of the step, q, L) where number k turns round, near the part x of the step.

    low, high : its slopes at the nodes, times `way`

    One step of Newton's method from x; the second derivative there is that of a parabola through
    the three slopes. The state moves along the motion at x.
    """
    path = smooth(step)
    (q, l), (p, m) = between(path, x), between(path, x + AHEAD)
    here = picked(numbers_at(events, running, step, time(step, x), q, l), k)
    then = picked(numbers_at(events, running, step, time(step, x + AHEAD), p, m), k)
    slope, done, left = way * ((then - here) * (1.0 / AHEAD)), x - part.a, part.b - x
    bend = (slope - low) * left * left + (high - slope) * done * done
    # a straight line does not turn round: what it is divided by does not count
    change = slope * (part.b - part.a) * done * left / select(bend > 0.0, bend, 1.0)
    change = -min(max(select(bend > 0.0, change, 0.0), -left), done)
    far = change * (1.0 / AHEAD)
    q = touch_up(axpy4(q, far, difference4(p, q)))
    return x + change, q, axpy(l, far, difference(m, l))


def put_in(running, k, there, step, x, q, l, kept):
    """The numbers of running observables after an extreme of number k of theirs."""
    if len(running) == 0:
        return ()
    one, limits = running[0][0], sought(running[0][0], kept[0])
    first = put_one(limits, one, k, there, step, x, q, l, kept[0])
    return (first,) + put_in(running[1:], k - len(limits), there, step, x, q, l, kept[1:])


def put_one(limits, one, k, there, step, x, q, l, kept):
    """The numbers of one of them, changed if number k is among its own."""
    if len(limits) == 0:
        return kept
    if k >= 0 and k < len(limits):
        new = update(one, kept, step.body, step.effects, time(step, x), q, l)
        kept = select_each(there, new, kept)
    return kept


def noted(events, k, there, step, x, q, l, backs, levels, work, row):
    """(backs, levels) of events after the state where the level of event k turns round: it is
    written down if it has happened by then, and perhaps armed."""
    if len(events) == 0:
        return (), ()
    (back, more), start = backs[0], levels[0]
    if k == 0:
        turn = levels_of(events[:1], step.body, step.effects, time(step, x), q, l)[0]
        hit = there & (turn * start <= 0.0) & (start != 0.0)
        note_one(events[0], hit, step, (back, more), start, (1.0 - x, 0.0), turn, work, row)
        anew = hit | (there & (start == 0.0))
        again = select(armed(events[0], step.body, q, l, turn, turn != turn), turn, 0.0)
        back, more = select(anew, 1.0 - x, back), select(anew, 0.0, more)
        start = select(anew, again, start)
    rest = noted(events[1:], k - 1, there, step, x, q, l, backs[1:], levels[1:], work, row + EVENT)
    return ((back, more),) + rest[0], (start,) + rest[1]


inline_all(sys.modules[__name__])
