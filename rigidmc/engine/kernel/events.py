"""Events: whether one happened in a step, and when, to the order of the integrator.

An event happens when its level passes through 0 while it is armed. The observable arms it, by
default where the level is below 0, so that it happens as the level rises. Its EVENT_ROWS are among
the rows of a member, see `rigidmc.engine.kernel.layout`. At first only a bracket is recorded: the
state at the end of the step, and two levels of opposite sign. After the last step, `refine_events`
of `rigidmc.engine.kernel.block` makes single steps back from that state. The Illinois method
(regula falsi that halves the level at an end that stays) adjusts their length until the level is 0.
So the time is as exact as the integrator.

An event with a dwell time counts only once its level has stayed above 0 that long. A dwell begins
where the level rises through 0 and ends where it falls through 0. Both times are found on the dense
output, so whether a dwell counts does not depend on the length of a step. The row DWELL_START has
the time at which the present dwell began, inf if there is none or if it already counts.
"""

import math
import sys

from rigidmc.engine.compiler import derivatives
from rigidmc.engine.compiler.compose import inline_all
from rigidmc.engine.compiler.intrinsics import any_of, in_precision
from rigidmc.engine.compiler.memory import four_at, put_rows, shifted, tuple_at, without_tangents
from rigidmc.engine.compiler.trees import tree_size, tree_unflatten, tree_unpack
from rigidmc.engine.kernel import layout
from rigidmc.engine.kernel.dense_output import interpolate, make_interpolant, time_within
from rigidmc.physics.dynamics.euler import scaled
from rigidmc.physics.dynamics.so3 import concat, first_three, logical_not, select, select_all, taken
from rigidmc.physics.effects.present import in_memory, in_state, memories_of, states_of
from rigidmc.physics.effects.sums import state_rates
from rigidmc.physics.integrators.protocol import from_stepping, to_stepping
from rigidmc.physics.observables.compiled import armed, counts_at_start, dwell, is_terminal, level

# Steps back: three steps of the Illinois method together have order 3, and after five the error is
# 1e-15 of a step for a smooth level; three more are for levels that are not smooth.
TRIES = 8


def begin_events(events, body, effects, t, q, l, rows, tails):
    """Set the rows of events at the start, where an event may count as happened."""
    if len(events) == 0:
        return 0
    tail = layout.tail_of(effects)
    put_rows(tail + tail, tails, 0)
    now = level(events[0], body, effects, t, q, l)
    count, since = start_counts(events[0], counts_at_start(events[0], now), t)
    # `now != now` is False as a mask of this width: the event was armed in no earlier step.
    first = select(armed(events[0], body, q, l, now, now != now), now, 0.0)
    put_rows((first, count, t, t, since, t, t), rows, layout.LEVEL)  # and the rows up to TIMES
    noted = (t, 0.0, now, 0.0, now) + q + l
    put_rows(noted + noted, rows, layout.RECORDS)
    return begin_events(
        events[1:], body, effects, t, q, l, following(rows), tails_after(tails, effects)
    )


def following(rows):
    """Return the rows of the event after the one with these rows."""
    return shifted(rows, layout.EVENT_ROWS)


def levels_at(events, rows):
    """Return the levels of events after the last step, from their rows."""
    if len(events) == 0:
        return ()
    return (rows[layout.LEVEL],) + levels_at(events[1:], following(rows))


def put_levels(levels, rows):
    """Write the rows that `levels_at` reads."""
    if len(levels) == 0:
        return 0
    rows[layout.LEVEL] = levels[0]
    return put_levels(levels[1:], following(rows))


def levels_of(events, body, effects, t, q, l):
    """Return the levels of events in a state."""
    if len(events) == 0:
        return ()
    first = level(events[0], body, in_state(effects, l[3:]), t, q, first_three(l))
    return (first,) + levels_of(events[1:], body, effects, t, q, l)


def has_happened(before, now):
    """Return whether an event happened between two levels."""
    # `before` is 0 for an unarmed event; `now` = 0 counts as passed.
    return (before * now <= 0.0) & (before != 0.0)


def any_has_happened(before, now):
    """Return whether any event happened in a step."""
    if len(now) == 1:
        return has_happened(before[0], now[0])
    return has_happened(before[0], now[0]) | any_has_happened(before[1:], now[1:])


def rearm(events, moves, body, q, l, before, now):
    """Return the levels now, 0 for unarmed events, which cannot happen in the next step.

    Members that made no step keep the levels before.
    """
    if len(events) == 0:
        return ()
    still = (before[0] != 0.0) & logical_not(has_happened(before[0], now[0]))
    new = select(armed(events[0], body, q, first_three(l), now[0], still), now[0], 0.0)
    rest = rearm(events[1:], moves, body, q, l, before[1:], now[1:])
    return (select(moves, new, before[0]),) + rest


def is_stopped(events, rows):
    """Return 1 if an event has stopped the member, else 0; at most one event stops members."""
    if len(events) == 0:
        return 0.0
    if len(is_terminal(events[0])) == 0:
        return is_stopped(events[1:], following(rows))
    return select(rows[layout.COUNT] > 0.0, 1.0, 0.0)


def stopped_state(events, rows, q, l):
    """Return (q, L); if an event has stopped the member, the state at the end of that step."""
    if len(events) == 0:
        return q, l
    if len(is_terminal(events[0])) == 0:
        return stopped_state(events[1:], following(rows), q, l)
    has_stopped = rows[layout.COUNT] > 0.0
    last_q, last_l = layout.pose_at(rows, layout.RECORDS + layout.RECORD_POSE)
    q, l = select_all(has_stopped, last_q, q), select_all(has_stopped, last_l, l)
    return stopped_state(events[1:], following(rows), q, l)


def events_at_end(events, moves, step, before, rows):
    """Return the levels of events after a step of which only the end is monitored."""
    if len(events) == 0:
        return ()
    now = levels_of(events, step.body, step.effects, step.t, step.q, step.l)
    befores, after = step_starts(before), (0.0, 0.0)
    return update_events(events, moves, step, befores, before, after, step.q, step.l, now, rows)


def step_starts(levels):
    """Return (whole step back, no widening) for each level, as `record_events` takes it."""
    if len(levels) == 0:
        return ()
    return ((1.0, 0.0),) + step_starts(levels[1:])


def update_events(events, moves, step, befores, before, after, q, l, now, rows):
    """Return the levels of events after an interval that ends in (q, L), and record events in it.

    Arguments as in `record_events`.
    """
    # A branch for all lanes at once: in most steps nothing happens, and recording is long code.
    if any_of(any_has_happened(before, now)):
        record_events(events, moves, step, befores, before, after, now, rows, step.tails)
    count_dwells(events, moves, step, after[0], now, rows)
    return rearm(events, moves, step.body, q, l, before, now)


def count_dwells(events, moves, step, after, now, rows):
    """Count the events whose dwell is long enough by the end of an interval."""
    if len(events) == 0:
        return 0
    wait = dwell(events[0])
    if len(wait) > 0:
        t = step.t - after * step.h
        count_if_lasted(wait, moves & (now[0] >= 0.0), t, step, rows)
    return count_dwells(events[1:], moves, step, after, now[1:], following(rows))


def record_events(events, moves, step, befores, before, after, now, rows, tails):
    """Record the events between two states of a step, for members that move.

    step : the Step
    befores, after : pairs for the two states: fraction of the step from the state to the step's
        end, and how far the bracket extends beyond the state; `befores` has a pair for each event
    before, now : the levels in the states
    tails : rows of the tails of the records of these events

    A stopped member makes steps until the next assessment. It does not count as moving, and nothing
    is written for it.
    """
    if len(events) == 0:
        return 0
    hit = has_happened(before[0], now[0]) & moves
    record_event(events[0], hit, step, befores[0], before[0], after, now[0], rows, tails)
    return record_events(
        events[1:], moves, step, befores[1:], before[1:], after, now[1:], following(rows),
        tails_after(tails, step.effects),
    )  # fmt: skip


def tails_after(tails, effects):
    """Return the rows of the tails of the event after the one with these."""
    return shifted(tails, 2 * len(layout.tail_of(effects)))


def record_event(event, hit, step, start_back, before, after, now, rows, tails):
    """Record an event for the members in the mask `hit`; other arguments as in `record_events`."""
    if len(dwell(event)) > 0:
        return record_dwell(dwell(event), event, hit, step, start_back, before, after, now, rows)
    t, h, q, l = step.t, step.h, step.q, first_three(step.l)
    tail = concat(step.l[3:], memories_of(step.effects))
    # Linear interpolation here: the exact time is found once, after the run, only for the first and
    # the last event.
    count, last = rows[layout.COUNT], rows[layout.TAU]
    rise = now - before
    # Both 0: the fraction of the step is 0, in any unit of the level.
    fraction = now / select(rise == 0.0, 1.0, rise)
    tau = t - h * (after[0] + (start_back[0] - after[0]) * fraction)
    interval = select(hit & (count > 0.0), tau - last, 0.0)
    rows[layout.SQUARES] = rows[layout.SQUARES] + interval * interval
    rows[layout.TAU] = select(hit, tau, last)
    rows[layout.COUNT] = select(hit, count + 1.0, count)
    first = hit & (count == 0.0)
    rows[layout.FIRST_TAU] = select(first, tau, rows[layout.FIRST_TAU])
    noted = (t, after[0] - after[1], now, start_back[0] + start_back[1], before) + q + l
    if any_of(first):
        write_if(first, noted, rows, layout.RECORDS)
        write_if(first, tail, tails, 0)
    write_if(hit, noted, rows, layout.RECORDS + layout.RECORD_ROWS)
    write_if(hit, tail, tails, len(tail))
    return 0


def refine_event(
    tree, numbers, substeps, work, spare_state, spare_work, row, axes_row, record, steps_back,
    long_until, ratio,
):  # fmt: skip
    """Make one iteration for the exact time of an event: prepare a step back to the level's zero.

    record : 2 i for the first, 2 i + 1 for the last of event i
    steps_back : steps back made so far
    spare_state, spare_work : a state and its `work` for the step back, which keeps the BRACKET and
        the FRACTION of the step
    long_until, ratio : when the steps before the last interval end [s], and their length relative
        to its steps
    """
    integrator, effects, events, axes, derived, works = tree_unpack(tree, numbers)
    event_rows = shifted(work, row + record // 2 * layout.EVENT_ROWS)
    rows, place = without_tangents(event_rows), layout.TIMES + record % 2
    at = layout.RECORDS + record % 2 * layout.RECORD_ROWS
    body, given = layout.observed_body_and_effects(effects, axes, work, axes_row)
    states, row_after = states_of(effects), layout.EFFECTS_AT + tree_size(effects)
    tail_row = row + layout.EVENT_ROWS * len(events) + len(layout.tail_of(effects)) * record
    memories = tuple_at(memories_of(effects), work, tail_row + len(states))
    present = in_memory(given, memories)
    # The bracket and the step back have no derivatives: the time gets its own at the end.
    last_h, spare = without_tangents(work)[layout.STEP_LENGTH], without_tangents(spare_work)
    t, bracket = rows[at], four_at(rows, at + 1)
    # The end time of a step shows whether it belongs to the last interval.
    h = select(t < long_until + 0.5 * last_h, last_h * ratio, last_h)
    older, level_before = bracket[1], bracket[3]
    # Both ends have one sign: no crossing was bracketed, because the event counted at the start.
    at_start = (level_before < 0.0) == (older < 0.0)
    if steps_back > 0:
        fraction = spare[layout.FRACTION]
        back_step = -fraction * h
        substep = layout.opening_substep(substeps, back_step)
        q = in_precision(four_at(spare_state, layout.ATTITUDE), work)
        l = in_precision(layout.momentum_at(integrator, spare_state), work)
        l = concat(l, in_precision(tuple_at(states, spare_state, row_after), work))
        torque_time = t + back_step + substeps[3] * back_step
        q, l = from_stepping(integrator, body, present, torque_time, substep, q, l)
        level_here = level_at(events, record // 2, body, present, t + back_step, q, l)
        here = derivatives.without_derivatives(level_here)
        bracket = shrink_bracket(four_at(spare, layout.BRACKET), fraction, here)
        keep_time_change(
            derived, effects, events, axes, record // 2, (t + back_step, h), (q, l, memories),
            level_here, work, axes_row, event_rows, place, at_start,
        )  # fmt: skip
    fraction = interpolate_root(bracket)
    back_step = -fraction * h
    put_rows(bracket + (fraction,), spare, layout.BRACKET)
    substep = layout.opening_substep(substeps, back_step)
    q, l = layout.pose_at(event_rows, at + layout.RECORD_POSE)
    l = concat(l, tuple_at(states, work, tail_row))
    q, l = to_stepping(integrator, body, present, t + substeps[3] * back_step, substep, q, l)
    memory_row = row_after + len(layout.moving(effects, works))
    put_rows(in_precision(memories, spare_state), spare_state, memory_row)
    q, l = in_precision(q, spare_state), in_precision(l, spare_state)
    put_stepping_state(states, q, l, spare_state, row_after)
    put_rows((t, back_step), spare, layout.ROUND_START)  # and STEP_LENGTH, the row after it
    rows[place] = select(at_start, t, t + back_step)
    return 0


def put_stepping_state(states, q, l, state, row):
    """Write a state in stepping form; states : of effects, which follow L, from `row` on."""
    if len(states) == 0:
        return layout.put_stepping(q, l, state)
    put_rows(l[3:], state, row)
    return layout.put_stepping(q, first_three(l), state)


def keep_time_change(
    derived, effects, events, axes, index, when, there, level_here, work, axes_row, event_rows,
    place, at_start,
):  # fmt: skip
    """Write the derivatives of the time of an event, -dg/dp / (dg/dt) of its level g (implicit
    function theorem), to a row whose value is written later.

    derived : ON if there are derivatives;  at_start : whether the event counted at the start
    when, there : its time and the length of a step [s]; q, L and the memories of effects then
    """
    if len(derived) == 0:
        return 0
    (t, h), (q, l, memories) = when, there
    plain = without_tangents(work)
    body, given = layout.observed_body_and_effects(effects, axes, plain, axes_row)
    present = in_memory(given, derivatives.first_values(memories))
    l = concat(first_three(l), taken(states_of(effects), l[3:]))
    q, l = derivatives.first_values(q), derivatives.first_values(l)
    dq, dl = state_rates(scaled(body, h), present, body, t, h, q, l)
    q, l = derivatives.moving_each(q, dq), derivatives.moving_each(l, dl)
    rate = derivatives.change_of(
        level_at(events, index, body, present, derivatives.moving(t, h), q, l)
    )
    # no time depends on a parameter if there is no event, if it is that of the start, or if its
    # level stands still
    has_happened_once = without_tangents(event_rows)[layout.COUNT] > 0.0
    is_timed = (rate != 0.0) & has_happened_once & logical_not(at_start)
    event_rows[place] = derivatives.chained(level_here, t, -h / select(is_timed, rate, math.inf))
    return 0


def level_at(events, index, body, effects, t, q, l):
    """Return the level of one event, whose index is known only at run time."""
    if len(events) == 1:
        return levels_of(events, body, effects, t, q, l)[0]
    if index == 0:
        return levels_of(events[:1], body, effects, t, q, l)[0]
    return level_at(events[1:], index - 1, body, effects, t, q, l)


# Levels tried on the dense output: the end of a dwell is then known to 1e-6 of a step, and the
# error of the dense output is larger.
DWELL_TRIES = 4


def start_counts(event, there, t):
    """Return (count, DWELL_START) of an event; there : whether it counts at the start."""
    if len(dwell(event)) == 0:
        return select(there, 1.0, 0.0), 0.0
    return 0.0, select(there, t, math.inf)


def record_dwell(wait, event, hit, step, start_back, before, after, now, rows):
    """Record that a dwell begins or ends; a dwell that ends counts if it was long enough.

    wait : see `dwell` of `rigidmc.physics.observables.compiled`
    other arguments : as in `record_event`
    """
    t = crossing_time(wait[1:], event, step, start_back[0], before, after[0], now)
    count_if_lasted(wait, hit & (before > 0.0), t, step, rows)
    since = select(before < 0.0, t, math.inf)
    rows[layout.DWELL_START] = select(hit, since, rows[layout.DWELL_START])
    return 0


def crossing_time(dense, event, step, start_back, before, after, now):
    """Return the time at which the level passes through 0 between two states of a step.

    Linear interpolation if there is no dense output.
    """
    zero = 0.0 * now
    bracket = zero + (1.0 - start_back), before, zero + (1.0 - after), now
    if len(dense) == 0:
        return time_within(step, interpolate_root(bracket))
    path, x = make_interpolant(step), interpolate_root(bracket)
    for _ in range(DWELL_TRIES):
        q, l = interpolate(path, x)
        level_here = levels_of((event,), step.body, step.effects, time_within(step, x), q, l)[0]
        bracket = shrink_bracket(bracket, x, level_here)
        x = interpolate_root(bracket)
    return time_within(step, x)


def count_if_lasted(wait, beyond, t, step, rows):
    """Count the dwell of members that are `beyond` until t, if it is long enough."""
    since, count = rows[layout.DWELL_START], rows[layout.COUNT]
    lasted = beyond & (t - since >= wait[0])
    first = lasted & (count == 0.0)
    rows[layout.COUNT] = select(lasted, count + 1.0, count)
    rows[layout.TAU] = select(lasted, since, rows[layout.TAU])
    rows[layout.FIRST_TAU] = select(first, since, rows[layout.FIRST_TAU])
    rows[layout.DWELL_START] = select(lasted, math.inf, since)
    if any_of(first):  # the state in which an event may stop the member
        zero = 0.0 * t
        noted = (zero + step.t, zero, zero, zero, zero) + step.q + first_three(step.l)
        write_if(first, noted, rows, layout.RECORDS)
    return 0


def write_if(condition, values, rows, row):
    """Write a tuple to rows if the condition holds."""
    return put_rows(select_all(condition, values, tree_unflatten(values, rows, row)), rows, row)


def interpolate_root(bracket):
    """Return where the level is 0 by linear interpolation, within the bracket.

    bracket = (fraction of the step, level there, fraction, level there)
    """
    low, below, high, above = bracket
    rise = above - below
    # With equal levels the quotient is unused: 1 only keeps it finite.
    fraction = low - (high - low) * (below / select(rise == 0.0, 1.0, rise))
    return select(rise == 0.0, low, min(max(fraction, min(low, high)), max(low, high)))


def shrink_bracket(bracket, fraction, here):
    """Return the next bracket of the Illinois method, one end at `fraction` with the level `here`.

    The level at an end that stays is halved. Otherwise that end would stay forever, and the order
    would be 1.
    """
    low, below, high, above = bracket
    is_newer = here * above < 0.0  # the level is 0 between `fraction` and the newer end
    return select(is_newer, high, low), select(is_newer, above, 0.5 * below), fraction, here


inline_all(sys.modules[__name__])
