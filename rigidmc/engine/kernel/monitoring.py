"""What is watched at every step and not saved: events, and running observables.

Both are rows of `work` from `row` on: EVENT rows for each event, see
`rigidmc.engine.kernel.events`, then as many rows for each running observable as it has marks. They
are float64, and so is all that is computed for them, whatever the precision of the steps: a sum
over 1e7 steps and a time have no room in float32. Steps are made first, a few dozen at a time, and
watched afterwards: no step depends on what is watched. Between the ends of a step there is a dense
output, see `rigidmc.engine.kernel.monitoring`. Pieces as those of `rigidmc.engine.kernel.member`.

What is watched within a step: nodes, and the parts of a step between them.

A step is watched at some of its states, its nodes, the last of them at its end. Where a number that
counts turns round between two nodes, the state there is watched too, see
`rigidmc.engine.kernel.extrema`.
"""

import sys
from typing import Any, NamedTuple

from rigidmc.engine.compiler.compose import inline_all
from rigidmc.engine.compiler.intrinsics import in_precision, like
from rigidmc.engine.compiler.memory import four_at, put, three_at, tuple_at
from rigidmc.engine.compiler.trees import filled, parts_of
from rigidmc.engine.kernel.dense_output import AHEAD, Step, ahead, between, ended, smooth, time
from rigidmc.engine.kernel.events import (  # fmt: skip
    begin_events,
    held,
    levels_at,
    passed,
    put_levels,
    settled,
    stopped,
)
from rigidmc.engine.kernel.extrema import (
    Part,
    all_begun,
    all_extreme,
    all_touched,
    numbers_at,
    turned,
    wider,
)
from rigidmc.engine.kernel.layout import (  # fmt: skip
    ATTITUDE,
    BEGAN,
    BODY,
    EACH,
    EFFECTS,
    EVENT,
    GOOD,
    HELD,
    KNOWN,
    LENGTH,
    MOMENTUM,
    REST,
    STOPPED,
    body_at,
)
from rigidmc.physics.dynamics.methods import OFF
from rigidmc.physics.dynamics.so3 import first_three, joined, select_each
from rigidmc.physics.effects.sums import either
from rigidmc.physics.integrators.protocol import closed, keeps
from rigidmc.physics.observables.protocol import averages, begin, update
from rigidmc.physics.observables.statistics import head, rest


def begin_watch(kinds, numbers, parts, state, work, row):
    """Set the rows of what is watched at the start."""
    effects, events, running = parts_of(kinds, numbers)
    body, present = body_at(work, KNOWN + BODY), filled(effects, work, KNOWN + EFFECTS)
    q, l = four_at(work, KNOWN + GOOD), three_at(work, KNOWN + GOOD + 4)
    begin_events(events, body, present, 0.0, q, l, work, row)
    begin_running(running, body, present, 0.0, q, l, work, row + EVENT * len(events))
    hold(events, state, work, row)
    return 0


def watch(kinds, numbers, parts, state, work, trace, row, first, last, nodes):
    """Watch the steps from `first` to `last` of a round, whose states are in `trace`.

    nodes : states that are watched in a step, the last of them at its end
    """
    integrator, effects, events, running, dense = parts_of(kinds, numbers)
    body, present = body_at(work, KNOWN + BODY), filled(effects, work, KNOWN + EFFECTS)
    h, each = work[LENGTH], work[EACH]
    levels, kept = levels_at(events, work, row), kept_at(running, work, row + EVENT * len(events))
    t, q, l = traced(integrator, body, present, parts, state, work, trace, first, first)
    node = node_at(dense, events, running, Step(body, present, t, h, q, l, q, l))
    for s in range(first, last):
        p, m = q, l
        t, q, l = traced(integrator, body, present, parts, state, work, trace, s + 1, first)
        moves = (each > s) & (stopped(events, work, row) <= 0.0)
        step = Step(body, present, t, h, q, l, p, m)
        levels, kept, node = through(
            dense, events, running, moves, step, nodes, levels, kept, node, work, row
        )
    put_levels(levels, work, row)
    put_kept(kept, work, row + EVENT * len(events))
    hold(events, state, work, row)
    return 0


def traced(integrator, body, effects, parts, state, work, trace, s, first):
    """(t, q, L) after step s of a round, from the trace of the steps from `first` on."""
    began, length = work[BEGAN], work[LENGTH]
    part = parts[0] * length, parts[1] * length, parts[2] * length
    at, more = 7 * (s - first), tuple_at(keeps(integrator), state, REST)
    lead = began + (s * 1.0 + parts[3]) * length
    q, l = four_at(trace, at), joined(three_at(trace, at + 4), more)
    q, l = in_precision(q, work), in_precision(l, work)
    q, l = closed(integrator, body, effects, lead, part, q, l)
    return began + (s * 1.0) * length, q, first_three(l)


def hold(events, state, work, row):
    """Tell the looks which members an event has stopped, and where."""
    q, l = four_at(state, ATTITUDE), three_at(state, MOMENTUM)
    q, l = in_precision(q, work), in_precision(l, work)
    q, l = held(events, work, row, q, l)
    work[STOPPED] = like(stopped(events, work, row), work)
    put(q + l, work, HELD)
    return 0


def begin_running(running, body, effects, t, q, l, work, row):
    """Set the rows of running observables at the start."""
    if len(running) == 0:
        return 0
    put(begin(running[0][0], body, effects, t, q, l), work, row)
    return begin_running(running[1:], body, effects, t, q, l, work, row + len(running[0][1]))


def kept_at(running, work, row):
    """The numbers of running observables, from their rows."""
    if len(running) == 0:
        return ()
    first = filled(running[0][1], work, row)
    return (first,) + kept_at(running[1:], work, row + len(running[0][1]))


def put_kept(kept, work, row):
    """Write what `kept_at` reads."""
    if len(kept) == 0:
        return row
    return put_kept(kept[1:], work, put(kept[0], work, row))


class Node(NamedTuple):
    """What is known at a state that is watched.

    numbers : those that may turn round: levels of events, then `turning` of running observables
    slopes : how fast they change over a step
    """

    numbers: Any
    slopes: Any


def node_at(dense, events, running, step):
    """The Node at the end of a step, () if there is no dense output."""
    if len(dense) == 0:
        return ()
    then, late = ahead(ended(step)), step.t + AHEAD * step.h
    return node_of(events, running, step, step.t, late, (step.q, step.l), then)


def node_of(events, running, step, t, late, here, then):
    """The Node of a state at time t; late, then : time and state AHEAD of a step later."""
    now = numbers_at(events, running, step, t, here[0], here[1])
    return Node(now, rates(numbers_at(events, running, step, late, then[0], then[1]), now))


def rates(then, now):
    """The changes over a step at the rates between `now` and `then`, AHEAD later."""
    if len(now) == 0:
        return ()
    return ((then[0] - now[0]) * (1.0 / AHEAD),) + rates(then[1:], now[1:])


def through(dense, events, running, moves, step, nodes, levels, kept, node, work, row):
    """(levels, kept, Node) at the end of a step, from those at its start.

    dense : its length is 0 if only the end of the step is watched, 1 if there is no inner node
    """
    if len(dense) == 0:
        kept = updated(running, moves, step, step.t, step.q, step.l, kept)
        return passed(events, moves, step, levels, work, row), kept, node
    end = node_at(dense, events, running, step)
    before, levels, kept, node = inner(
        dense, events, running, moves, step, nodes, levels, kept, node, work, row
    )
    part = Part(before, 1.0, step.t, step.q, step.l)
    levels, kept = across(events, running, moves, step, part, node, end, levels, kept, work, row)
    return levels, updated(running, moves, step, step.t, step.q, step.l, kept), end


def inner(dense, events, running, moves, step, nodes, levels, kept, node, work, row):
    """(part of the step done, levels, kept, Node) at the last node within a step."""
    if len(dense) == 1:
        return 0.0, levels, kept, node
    x, path = 0.0 * step.h, smooth(step)
    for j in range(1, nodes):
        before, x = x, like(j / nodes, work)
        (q, l), then = between(path, x), between(path, x + AHEAD)
        part = Part(before, x, time(step, x), q, l)
        now = node_of(events, running, step, part.t, time(step, x + AHEAD), (q, l), then)
        levels, kept = across(
            events, running, moves, step, part, node, now, levels, kept, work, row
        )
        kept = averaged(running, moves, step, part.t, q, l, kept)
        node = now
    return x, levels, kept, node


def across(events, running, moves, step, part, before, now, levels, kept, work, row):
    """(levels, kept) after a Part; before, now : the Nodes at its ends.

    Running observables are updated where numbers turn round and in the middle, not at the end.
    """
    kept = halved(any_averages(running), running, moves, step, part, kept)
    going = moves & (stopped(events, work, row) <= 0.0)
    touched = all_touched(
        events, going, step, part, levels, before.numbers, before.slopes, now.numbers, now.slopes
    )
    extreme = all_extreme(
        running, moves, part, kept, rest(levels, before.numbers), rest(levels, before.slopes),
        rest(levels, now.numbers), rest(levels, now.slopes),
    )  # fmt: skip
    backs, levels, kept = turned(
        events, running, joined(touched, extreme), step, part, before, now,
        all_begun(levels, part), levels, kept, work, row,
    )  # fmt: skip
    return all_settled(events, going, step, part, now, backs, levels, work, row), kept


def all_settled(events, moves, step, part, now, backs, levels, work, row):
    """The levels of events at the end of a Part; what happened in it is written down."""
    if len(events) == 0:
        return ()
    back, at_end = (1.0 - part.b, wider(part.b)), head(levels, now.numbers)
    return settled(events, moves, step, backs, levels, back, part.q, part.l, at_end, work, row)


def updated(running, moves, step, t, q, l, kept):
    """The numbers of running observables after a state, changed for members that move."""
    if len(running) == 0:
        return ()
    new = update(running[0][0], kept[0], step.body, step.effects, t, q, l)
    rest = updated(running[1:], moves, step, t, q, l, kept[1:])
    return (select_each(moves, new, kept[0]),) + rest


def averaged(running, moves, step, t, q, l, kept):
    """The same of those that are means over time; the others stay."""
    if len(running) == 0:
        return ()
    first = averaged_one(averages(running[0][0]), running[0][0], moves, step, t, q, l, kept[0])
    return (first,) + averaged(running[1:], moves, step, t, q, l, kept[1:])


def averaged_one(averages, one, moves, step, t, q, l, kept):
    """The numbers of one, which is a mean if there is a mark."""
    if len(averages) == 0:
        return kept
    return select_each(moves, update(one, kept, step.body, step.effects, t, q, l), kept)


def any_averages(running):
    """ON if any running observable is a mean over time."""
    if len(running) == 0:
        return OFF
    return either(averages(running[0][0]), any_averages(running[1:]))


def halved(averages, running, moves, step, part, kept):
    """The numbers of means over time after the middle of a Part."""
    if len(averages) == 0:
        return kept
    middle = 0.0 * step.h + 0.5 * (part.a + part.b)
    q, l = between(smooth(step), middle)
    return averaged(running, moves, step, time(step, middle), q, l, kept)


inline_all(sys.modules[__name__])
