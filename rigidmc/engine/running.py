"""What is watched at every step and not saved: events, and running observables.

Both are rows of `work` from `row` on: EVENT rows for each event, see `rigidmc.engine.events`, then
as many rows for each running observable as it has marks. They are float64, and so is all that is
computed for them, whatever the precision of the steps: a sum over 1e7 steps and a time have no room
in float32. Steps are made first, a few dozen at a time, and watched afterwards: no step depends on
what is watched. Between the ends of a step there is a dense output, see `rigidmc.engine.within`.
Pieces as those of `rigidmc.engine.member`.
"""

import sys

from rigidmc.dynamics.so3 import first_three, joined
from rigidmc.engine.compose import inline_all
from rigidmc.engine.dense import Step
from rigidmc.engine.events import (
    begin_events,
    held,
    levels_at,
    put_levels,
    stopped,
)  # fmt: skip
from rigidmc.engine.intrinsics import in_precision, like
from rigidmc.engine.kinds import filled, parts_of
from rigidmc.engine.layout import (
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
)  # fmt: skip
from rigidmc.engine.memory import four_at, put, three_at, tuple_at
from rigidmc.engine.within import node_at, through
from rigidmc.integrators.protocol import closed, keeps
from rigidmc.observables.protocol import begin


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


inline_all(sys.modules[__name__])
