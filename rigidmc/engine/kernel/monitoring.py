"""Monitors over all steps, with nothing saved per step: events and running observables.

Both have rows of `work` from `row` on: EVENT_ROWS for each event, see
`rigidmc.engine.kernel.events`, then one row per number of the state of each running observable.
These rows and all computations for them are float64, whatever the precision of the steps: float32
is too short for a sum over 1e7 steps or for a time. Steps are made first, a few dozen at a time,
and monitored afterwards, from their trace: no step depends on monitors.

A step is monitored at its nodes: equally spaced states on the dense output
(`rigidmc.engine.kernel.dense_output`), the last of them at the end of the step. Where a monitored
number has an extremum between two nodes, the state there is monitored, too, see
`rigidmc.engine.kernel.extrema`. `begin_monitors` and `monitor_steps` are kernels as in
`rigidmc.engine.kernel.member`.

In this file `running` are pairs (observable, `static_count` of the numbers of its state), `totals`
the states of all running observables, and `rows` the rows of events. A Node is a tuple of pairs
(number, its change over a step at the present rate): of the numbers whose extrema count, which are
the levels of events, then the `extrema` of running observables.
"""

import sys
from typing import Any, NamedTuple

from rigidmc.engine.compiler.compose import inline_all
from rigidmc.engine.compiler.intrinsics import any_of, cast_like, in_precision
from rigidmc.engine.compiler.memory import (
    group_of,
    picked_rows,
    put_rows,
    shifted,
    tuple_at,
    without_tangents,
)
from rigidmc.engine.compiler.trees import tree_size, tree_unpack
from rigidmc.engine.kernel import layout
from rigidmc.engine.kernel.dense_output import (
    AHEAD,
    Step,
    ahead,
    end_of_step,
    interpolate,
    make_interpolant,
    time_within,
)
from rigidmc.engine.kernel.events import (  # fmt: skip
    begin_events,
    events_at_end,
    is_stopped,
    levels_at,
    put_levels,
    stopped_state,
    update_events,
)
from rigidmc.engine.kernel.extrema import (
    SubInterval,
    event_extrema,
    interval_starts,
    numbers_at,
    refine_extrema,
    running_extrema,
    widening,
)
from rigidmc.engine.kernel.running import (
    any_averages,
    begin_running,
    first_note,
    kept_rows,
    kept_states,
    merge_states,
    note_step,
    noted_step,
    put_states,
    states_at,
    update_averages,
    update_states,
)
from rigidmc.physics.dynamics.so3 import concat
from rigidmc.physics.effects.present import in_memory, memories_of, states_of
from rigidmc.physics.integrators.protocol import extra_state, from_stepping
from rigidmc.physics.observables.statistics import rest


def begin_monitors(tree, numbers, substeps, state, work, row, axes_row):
    """Set the rows of monitors at the start."""
    effects, events, running, axes = tree_unpack(tree, numbers)
    body, given = layout.observed_body_and_effects(effects, axes, work, axes_row)
    (q, l), rows, present = (
        layout.good_pose(work),
        shifted(work, row),
        in_memory(given, memories_of(given)),
    )
    begin_events(events, body, present, 0.0, q, l, rows, tails_of(events, rows))
    first = layout.running_row(row, events, effects)
    begin_running(running, body, present, 0.0, q, l, work, first)
    write_stopped(events, state, work, rows)
    return 0


def monitor_steps(
    tree, numbers, substeps, state, work, trace, kept, row, axes_row, first, last, nodes, group
):  # fmt: skip
    """Monitor the steps of a group from `first` to `last` of a round, whose states are in `trace`.

    kept : memory for running states, see `rigidmc.engine.kernel.running`
    nodes : monitored states per step, the last of them at its end
    """
    parts = tree_unpack(tree, numbers)
    groups = parts[7]
    # One group after the other: a branch that one member needs then costs only its own group, and
    # the numbers of a group fit in the registers. The groups are counted by the caller, since LLVM
    # would write this code once for each.
    monitor_group(
        parts, substeps, group_of(state, groups, group), group_of(work, groups, group),
        group_of(trace, groups, group), group_of(kept, groups, group), row, axes_row, first, last,
        nodes,
    )  # fmt: skip
    return 0


def tails_of(events, rows):
    """Return the rows of the tails of the records of events."""
    return shifted(rows, layout.EVENT_ROWS * len(events))


class Monitoring(NamedTuple):
    """What is monitored, and how.

    dense : its length is 0 if only the end of a step is monitored, 1 if there is no inner node
    deferred : ON if extrema of running observables are searched later
    nodes : as in `monitor_steps`
    """

    events: Any
    running: Any
    dense: Any
    deferred: Any
    nodes: Any
    rows: Any


def monitor_group(parts, substeps, state, work, trace, kept, row, axes_row, first, last, nodes):
    """Do the same as `monitor_steps` for a group of members."""
    integrator, effects, events, running, dense, axes, deferred, _, works = parts
    body, given = layout.observed_body_and_effects(effects, axes, work, axes_row)
    row_after = layout.EFFECTS_AT + tree_size(effects)
    memories = layout.memories_at(effects, works, state, row_after)
    present = in_memory(given, in_precision(memories, work))
    extra, rows = tuple_at(extra_state(integrator), state, layout.EXTRA), shifted(work, row)
    reading = trace_reading(integrator, body, present, substeps, extra, work, trace)
    monitoring = Monitoring(events, running, dense, deferred, nodes, rows)
    running_row, h = layout.running_row(row, events, effects), reading.length
    steps = without_tangents(work)[layout.MEMBER_STEPS]
    levels, totals = levels_at(events, rows), states_at(running, work, running_row)
    t, q, l = traced_state(reading, first, first)
    tails = tails_of(events, rows)
    node = node_at(dense, events, running, Step(body, present, t, h, q, l, q, l, tails))
    notes, at_first, size = cast_like(0.0, work), totals, kept_rows(running, totals)
    for s in range(first, last):
        p, m, before, earlier = q, l, node, totals
        t, q, l = traced_state(reading, s + 1, first)
        # Lanes go on together until the slowest member of a round has made its steps. The states of
        # the others do not change, and must not count twice.
        moves = (steps > s) & (is_stopped(events, rows) <= 0.0)
        step, place = Step(body, present, t, h, q, l, p, m, tails), (s - first) * size
        levels, totals, node = monitor_step(monitoring, moves, step, levels, totals, node)
        notes = note_step(
            deferred, notes, running, moves, earlier, levels, before, node, kept, place
        )
    totals = search_noted(monitoring, reading, kept, size, notes, first, last, at_first, totals)
    # Kept in registers over all steps of the call, and written back once.
    put_levels(levels, rows)
    put_states(totals, work, running_row)
    write_stopped(events, state, work, rows)
    return 0


class TraceReading(NamedTuple):
    """Constants with which states are read from the rows of a trace.

    Read before the loop over steps: after each record of an event LLVM would read them again, and
    repeat the divisions by them.

    began, length : when the round began, and the length of its steps [s]
    substep, when : the opening substep, and the time of its torque, in steps
    extra : state of the integrator after L, which the trace does not have
    """

    integrator: Any
    body: Any
    effects: Any
    began: Any
    length: Any
    substep: Any
    when: Any
    extra: Any
    work: Any
    trace: Any


def trace_reading(integrator, body, effects, substeps, extra, work, trace):
    """Return the TraceReading of a group of members."""
    times = without_tangents(work)
    length, began, when = times[layout.STEP_LENGTH], times[layout.ROUND_START], substeps[3]
    substep = layout.opening_substep(substeps, length)
    return TraceReading(integrator, body, effects, began, length, substep, when, extra, work, trace)


def traced_state(reading, s, first):
    """Return (t, q, L) after step s of a round, from the trace of the steps from `first` on."""
    row = layout.traced(reading.effects) * (s - first)
    q, l = layout.pose_at(reading.trace, row)
    states = tuple_at(states_of(reading.effects), reading.trace, row + 7)
    return true_state(reading, s * 1.0, q, concat(l, states))


def true_state(reading, s, q, l):
    """Return (t, q, L) after step s of a round, from the numbers of a trace."""
    r = reading
    q, l = in_precision(q, r.work), in_precision(concat(l, r.extra), r.work)
    t = r.began + (s + r.when) * r.length
    q, l = from_stepping(r.integrator, r.body, r.effects, t, r.substep, q, l)
    return r.began + s * r.length, q, l


def search_noted(monitoring, reading, kept, size, notes, first, last, at_first, totals):
    """Return the running states with the extrema of the noted steps, see
    `rigidmc.engine.kernel.running`.

    size : rows of `kept` for each step
    at_first, totals : the running states before the first step and after the last
    """
    if len(monitoring.deferred) == 0:
        return totals
    running, dense, merged = monitoring.running, monitoring.dense, at_first
    marks = concat((0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), states_of(reading.effects))
    while any_of(notes > 0.0):
        note = first_note(notes)
        there, s, notes = note > 0.0, noted_step(note, (last - first) * 1.0), notes - note
        rows = layout.traced(reading.effects)
        picked = picked_rows(marks, reading.trace, rows * 1.0 * s, 0)
        earlier_t, p, m = true_state(reading, first + s, picked[:4], picked[4:])
        picked = picked_rows(marks, reading.trace, rows * 1.0 * s, rows)
        t, q, l = true_state(reading, first + s + 1.0, picked[:4], picked[4:])
        body, effects, h = reading.body, reading.effects, reading.length
        tails = tails_of((), reading.work)
        step, interval = (
            Step(body, effects, t, h, q, l, p, m, tails),
            SubInterval(0.0, 1.0, t, q, l),
        )
        before = node_at(dense, (), running, Step(body, effects, earlier_t, h, p, m, p, m, tails))
        now = node_at(dense, (), running, step)
        earlier = kept_states(running, totals, kept, size * s, 0)
        earlier = merge_states(running, there, earlier, merged, merged)
        extrema = running_extrema(running, there, interval, earlier, before, now)
        _, _, later = refine_extrema(
            (), running, extrema, step, interval, before, now, (), (), earlier, reading.work
        )
        inserted = update_states(running, there, step, t, q, l, later)
        without = update_states(running, there, step, t, q, l, earlier)
        merged = merge_states(running, there, merged, without, inserted)
        totals = merge_states(running, there, totals, without, inserted)
    return totals


def write_stopped(events, state, work, rows):
    """Write whether an event has stopped the member, and in which state, for `assess`."""
    q, l = layout.precise_pose_at(state, layout.ATTITUDE, work)
    q, l = stopped_state(events, rows, q, l)
    work[layout.IS_STOPPED] = cast_like(is_stopped(events, rows), work)
    put_rows(q + l, work, layout.STOPPED_STATE)
    return 0


def node_at(dense, events, running, step):
    """Return the Node at the end of a step, () if there is no dense output."""
    if len(dense) == 0:
        return ()
    ahead_state, late = ahead(end_of_step(step)), step.t + AHEAD * step.h
    return make_node(events, running, step, step.t, late, (step.q, step.l), ahead_state)


def make_node(events, running, step, t, late, state_here, ahead_state):
    """Return the Node of a state at t; late, ahead_state : time and state AHEAD of a step later."""
    now = numbers_at(events, running, step, t, state_here[0], state_here[1])
    later = numbers_at(events, running, step, late, ahead_state[0], ahead_state[1])
    return with_slopes(now, later)


def with_slopes(now, later):
    """Return the Node of numbers now and AHEAD of a step later."""
    if len(now) == 0:
        return ()
    slope = (later[0] - now[0]) * (1.0 / AHEAD)
    return ((now[0], slope),) + with_slopes(now[1:], later[1:])


def monitor_step(monitoring, moves, step, levels, totals, node):
    """Return (levels, totals, Node) at the end of a step, from their values at its start."""
    events, running, m = monitoring.events, monitoring.running, monitoring
    if len(monitoring.dense) == 0:
        totals = update_states(running, moves, step, step.t, step.q, step.l, totals)
        return events_at_end(events, moves, step, levels, m.rows), totals, node
    # The node at the end of this step is the first of the next: it is computed once.
    end = node_at(m.dense, events, running, step)
    before, levels, totals, node = monitor_nodes(m, moves, step, levels, totals, node)
    interval = SubInterval(before, 1.0, step.t, step.q, step.l)
    levels, totals = monitor_interval(m, moves, step, interval, node, end, levels, totals)
    return levels, update_states(running, moves, step, step.t, step.q, step.l, totals), end


def monitor_nodes(monitoring, moves, step, levels, totals, node):
    """Return (completed fraction, levels, totals, Node) at the last node within a step."""
    if len(monitoring.dense) == 1:
        return 0.0, levels, totals, node
    events, running, m = monitoring.events, monitoring.running, monitoring
    x, path = 0.0 * step.h, make_interpolant(step)
    for j in range(1, m.nodes):
        before, x = x, cast_like(j / m.nodes, m.rows)
        (q, l), ahead_state = interpolate(path, x), interpolate(path, x + AHEAD)
        interval = SubInterval(before, x, time_within(step, x), q, l)
        late = time_within(step, x + AHEAD)
        now = make_node(events, running, step, interval.t, late, (q, l), ahead_state)
        levels, totals = monitor_interval(m, moves, step, interval, node, now, levels, totals)
        totals = update_averages(running, moves, step, interval.t, q, l, totals)
        node = now
    return x, levels, totals, node


def monitor_interval(monitoring, moves, step, interval, before, now, levels, totals):
    """Return (levels, totals) after a SubInterval; before, now : the Nodes at its ends.

    Running observables are updated at extrema and in the middle, not at the end.
    """
    events, running, rows = monitoring.events, monitoring.running, monitoring.rows
    # Means include the middle: the trapezoidal rule then has two states or more per step.
    totals = update_midway(any_averages(running), running, moves, step, interval, totals)
    moving = moves & (is_stopped(events, rows) <= 0.0)
    of_events = event_extrema(events, moving, step, interval, levels, before, now)
    befores, levels, totals = search_now(
        monitoring, of_events, moves, step, interval, before, now, levels, totals
    )
    levels = update_interval_events(events, moving, step, interval, now, befores, levels, rows)
    return levels, totals


def search_now(monitoring, of_events, moves, step, interval, before, now, levels, totals):
    """Return (starts of events, levels, totals) after the extrema of a SubInterval.

    of_events : the Extremum of each event
    """
    events, running, rows = monitoring.events, monitoring.running, monitoring.rows
    befores = interval_starts(levels, interval)
    if len(monitoring.deferred) == 0:
        ends = rest(levels, before), rest(levels, now)
        extrema = running_extrema(running, moves, interval, totals, ends[0], ends[1])
        extrema = concat(of_events, extrema)
        return refine_extrema(
            events, running, extrema, step, interval, before, now, befores, levels, totals, rows
        )
    befores, levels, _ = refine_extrema(
        events, (), of_events, step, interval, before, now, befores, levels, (), rows
    )
    return befores, levels, totals


def update_interval_events(events, moves, step, interval, now, befores, levels, rows):
    """Return the levels of events at the end of a SubInterval, and record events in it."""
    if len(events) == 0:
        return ()
    after, at_end = (1.0 - interval.b, widening(interval.b)), numbers_of(levels, now)
    q, l = interval.q, interval.l
    return update_events(events, moves, step, befores, levels, after, q, l, at_end, rows)


def numbers_of(levels, node):
    """Return the first numbers of a Node, as many as there are levels."""
    if len(levels) == 0:
        return ()
    return (node[0][0],) + numbers_of(levels[1:], node[1:])


def update_midway(averages, running, moves, step, interval, totals):
    """Return the totals of means over time after the middle of a SubInterval."""
    if len(averages) == 0:
        return totals
    # A constant if there is no inner node: so are the weights of the interpolation then.
    middle = cast_like(0.5 * (interval.a + interval.b), step.h)
    q, l = interpolate(make_interpolant(step), middle)
    return update_averages(running, moves, step, time_within(step, middle), q, l, totals)


inline_all(sys.modules[__name__])
