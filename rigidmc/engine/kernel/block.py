"""A block of members on one thread, as many at a time as there are lanes.

This file is the order of events in the life of members; the kernels (`rigidmc.engine.kernel.member`
and others) do the work, and `rigidmc.engine.kernel.transfer` copies members to the lanes and back.
`advance` is compiled once for all scenes: it gets the kernels of a program by their addresses, and
the number of lanes as a number. A GPU runs `run_lanes` for one member in each thread.

frame : the record of all arguments, see `rigidmc.engine.kernel.arguments`
"""

import sys

import numpy as np

from rigidmc.engine.compiler.compose import inline_all
from rigidmc.engine.compiler.kernels import call_address
from rigidmc.engine.compiler.memory import memory
from rigidmc.engine.kernel import layout, transfer
from rigidmc.engine.kernel.arguments import CUT_ROWS, NO_STEP
from rigidmc.physics.observables.chaos import RECORD_EVERY

# Steps between two assessments of drift and health: one assessment takes as long as 2 steps of rk4
# without effects, 3 % of 64 steps.
ASSESS_INTERVAL = 64
# Steps made before they are monitored: their states for 16 members, 7 x 33 x 16 numbers, fit in a
# first-level cache of 32 kB.
TRACE = 32
OTHER_NOISE = 2**28  # of the number of a round, for the noise of another part of its steps


def advance(tree, numbers, frame):
    """Take every member of a block from step frame.first to step frame.last.

    The block (rows, n) is laid out as in `rigidmc.engine.kernel.layout` and changed in place; n is
    a multiple of LANES. Between calls it holds the state in stepping form, after step `total` the
    true state.
    """
    for low in range(0, frame.width, frame.lanes):
        run_lanes(frame, low)
    return 0


def run_lanes(frame, low):
    """Take the members of a block from `low` on, one per lane, through the steps: once for each
    pass, with other derivatives.

    All passes begin with the rows of the block; only the last one changes the members themselves.
    """
    for part in range(frame.passes):
        run_pass(frame, low, part)
    return 0


def run_pass(frame, low, part):
    """Take the members of a block from `low` on through the steps; part : the pass."""
    flat = transfer.block_memory(frame)
    h, round_start = first_round(frame)
    transfer.gather_members(frame, low, h, round_start, part)
    if frame.growth != 0:
        transfer.gather_growing(frame, low)
    if frame.first == 0:
        initialise_members(frame, low, part)
    # Once all lanes are stopped or frozen, no more steps are made, but saves go on to the end.
    now, idle = frame.first, False
    save = next_save(frame, now)
    save_step = step_of_save(frame, save)
    cut = next_cut(frame, now)
    while now < frame.last:
        # the first step of the round; without member steps there is one round
        round_first = now // frame.slots * frame.slots if frame.member_steps != 0 else 0
        stop, cut_step = next_stop(frame, now, round_first, save_step), step_of_cut(frame, cut)
        if now == frame.head:
            slots = frame.slots * 1.0 if frame.member_steps != 0 else now * 1.0
            new_slot = 0.0 if frame.member_steps != 0 else slots  # each round begins with step 0
            lengths = frame.h, frame.last_h
            change_steps(frame, slots, new_slot, lengths, last_round_start(frame))
        elif frame.member_steps != 0 and now == round_first:
            begins = round_first // frame.slots * frame.h
            for k in range(frame.lanes):
                flat.work[layout.ROUND_START * frame.lanes + k] = begins
        if now == cut_step:
            stop = now + frame.slots
            cut = make_cut_steps(frame, cut, now, idle)
        elif not idle:
            stop = min_integer(stop, cut_step)
            make_steps(frame, round_first, now - round_first, stop - round_first, 0)
        now, slot = stop, stop - round_first
        is_saved = now == save_step
        # No assessment where only a call ends: no result depends on how a run is cut into calls.
        # At the end of a round the slots begin again: it is assessed only if it is saved.
        is_planned = slot % ASSESS_INTERVAL == 0 and (frame.member_steps == 0 or slot < frame.slots)
        if is_saved or is_planned:
            rounds = round_first // frame.slots * 1.0 if frame.member_steps != 0 else 0.0
            is_late = 1.0 if 2 * now > frame.total else 0.0
            idle = assess_members(frame, rounds, slot, is_late, 1.0 if is_planned else 0.0)
        if is_saved:
            transfer.save_members(frame, low, time_at(frame, now), save, part)
            save += 1
            save_step = step_of_save(frame, save)
    if frame.last == frame.total and frame.records > 0:
        refine_events(frame)
    transfer.scatter_members(frame, low, part)
    return 0


def change_steps(frame, slot, new_slot, lengths, round_start):
    """Begin steps of another length, see `rigidmc.engine.kernel.last_interval`.

    slot, new_slot : steps so far since the old and the new `round_start` [s]
    lengths : of a step before and from now on, with member steps of a round [s]
    """
    flat, lanes, work = transfer.block_memory(frame), frame.lanes, transfer.block_memory(frame).work
    own, h = frame.member_steps, lengths[1]
    if frame.changes_length != 0:
        arguments = flat.substeps, flat.state, work, slot, new_slot, round_start, h, own
        call_address(frame.change_length, arguments)
    if frame.reweighs != 0:
        call_address(frame.reweigh, (work, frame.monitor_row, lengths[0] / h))
    for k in range(lanes):
        steps = work[layout.MEMBER_STEPS * lanes + k]
        work[layout.STEP_LENGTH * lanes + k] = h / steps if own != 0 else h
        work[layout.ROUND_START * lanes + k] = round_start


def make_cut_steps(frame, cut, now, idle):
    """Make the step after `now`, or with member steps the round, in the parts from row `cut` on.

    Return the row after these parts.
    """
    rows, own, width = memory(frame.cuts, frame.h), frame.member_steps, cut_width(frame)
    work = transfer.block_memory(frame).work
    first, last = (0, frame.slots) if own != 0 else (now, now + 1)
    h = frame.h if now < frame.head else frame.last_h
    round_start = work[layout.ROUND_START * frame.lanes]
    begun, length, part = first * 1.0, h, 0
    while step_of_cut(frame, cut) == now:
        new, begins = rows[width * cut + 1], rows[width * cut + 2]
        change_steps(frame, begun, first * 1.0, (length, new), begins)
        if frame.sampling != 0:
            sample_members(frame, first, width * cut + CUT_ROWS)
        if not idle:
            make_steps(frame, now if own != 0 else 0, first, last, part)
        begun, length, part, cut = last * 1.0, new, part + 1, cut + 1
    change_steps(frame, begun, last * 1.0, (length, h), round_start)
    return cut


def next_cut(frame, now):
    """Return the first row of parts of a step from `now` on."""
    low, high = 0, frame.cut_count
    while low < high:
        middle = (low + high) // 2
        if step_of_cut(frame, middle) >= now:
            high = middle
        else:
            low = middle + 1
    return low


def step_of_cut(frame, cut):
    """Return the step before the part in a row; NO_STEP after the last row."""
    # the row beyond all others has 1e300, which no integer holds: its conversion is undefined
    unit = memory(frame.cuts, frame.h)[cut_width(frame) * cut]
    return np.int64(unit) * frame.slots if unit < 1e18 else NO_STEP


def cut_width(frame):
    """Return how many numbers the row of a part has."""
    return CUT_ROWS + 1 + frame.sampling if frame.sampling != 0 else CUT_ROWS


def sample_members(frame, slot, place):
    """Let effects sample at the begin of a part, whose samples are from cuts[place] on; the time is
    -1 if there are none."""
    cuts, flat = memory(frame.cuts, frame.h), transfer.block_memory(frame)
    if cuts[place] >= 0.0:
        arguments = (
            flat.substeps, flat.state, flat.work, slot * 1.0, cuts, place, frame.key,
            frame.second_key, memory(frame.streams, frame.key),
        )  # fmt: skip
        call_address(frame.take_samples, arguments)


def first_round(frame):
    """Return (length of the steps, or of a round of member steps, when it began) at the first step
    of a call [s]."""
    if frame.first > frame.head:
        return frame.last_h, last_round_start(frame)
    return frame.h, frame.first // frame.slots * frame.h if frame.member_steps != 0 else 0.0


def last_round_start(frame):
    """Return when the round of the last interval began [s].

    Without rounds: when steps of its length would have begun so that step `head` ends at its actual
    time.
    """
    h = frame.h if frame.member_steps != 0 else frame.h - frame.last_h
    return frame.head // frame.slots * h


def time_at(frame, now):
    """Return the time at step `now`, the end of a round [s]."""
    if now <= frame.head:
        return now // frame.slots * frame.h
    # By products, not by adding h step by step: exact to rounding at any step.
    late = (now - frame.head) // frame.slots * frame.last_h
    return frame.head // frame.slots * frame.h + late


def initialise_members(frame, low, part):
    """Classify, monitor and save the start of the members."""
    flat = transfer.block_memory(frame)
    substeps, state, work = flat.substeps, flat.state, flat.work
    call_address(frame.initialise, (substeps, state, work))
    if frame.monitors != 0:
        arguments = substeps, state, work, frame.monitor_row, frame.axes_row
        call_address(frame.begin_monitors, arguments)
    if frame.growth != 0:
        arguments = substeps, state, work, frame.growth_row, time_at(frame, frame.total)
        call_address(frame.begin_growth, arguments)
    transfer.save_members(frame, low, 0.0, 0, part)


def next_save(frame, now):
    """Return the number of the first save after step `now`."""
    if frame.stride > 0:
        return now // frame.stride + 1
    steps, low, high = memory(frame.save_steps, frame.lanes), 0, frame.save_count
    while low < high:
        middle = (low + high) // 2
        if steps[middle] > now:
            high = middle
        else:
            low = middle + 1
    return low


def step_of_save(frame, save):
    """Return the step that ends at a save; NO_STEP beyond the last save."""
    # The last save has its own number, whatever the stride.
    if frame.stride > 0:
        return min_integer(frame.total, save * frame.stride)
    return memory(frame.save_steps, frame.lanes)[save] if save < frame.save_count else NO_STEP


def next_stop(frame, now, round_first, save_step):
    """Return the next step at which members are assessed, saved or left."""
    next_check = round_first + ((now - round_first) // ASSESS_INTERVAL + 1) * ASSESS_INTERVAL
    stop = min_integer(frame.last, next_check)
    stop = min_integer(stop, save_step)
    return min_integer(stop, round_first + frame.slots) if frame.member_steps != 0 else stop


def min_integer(a, b):
    """Return the smaller of two integers."""
    # Numba needs 20 ms to compile `min` for each kind of number.
    return a if a < b else b


def assess_members(frame, rounds, slot, late, planned):
    """Assess the members after `slot` steps of a round, `rounds` of which are done.

    late : 1 in the second half of the run, else 0
    planned : 0 if only a save requested the assessment, else 1

    Return True if all members are stopped or frozen.
    """
    flat = transfer.block_memory(frame)
    arguments = flat.substeps, flat.state, flat.work, rounds, slot * 1.0, late, planned
    return call_address(frame.assess, arguments) == 0


def make_steps(frame, round_first, first, last, part):
    """Make and monitor the steps from `first` to `last` of a round.

    round_first : the step with which the round began;  part : of these steps, 0 for the first
    """
    now, flat = first, transfer.block_memory(frame)
    substeps, state, work = flat.substeps, flat.state, flat.work
    if frame.member_steps != 0:
        last = max_member_steps(frame, last)
    while now < last:
        stop = last
        if frame.growth != 0:
            # Counted from the start of the round, so calls and saves shift no record.
            interval = record_interval(round_first, now)
            stop = min_integer(stop, (now // interval + 1) * interval)
        if frame.monitors != 0:
            stop = min_integer(stop, (now // TRACE + 1) * TRACE)
        if frame.member_steps != 0:
            stop = next_finish(frame, now, stop)
        rounds = round_first // frame.slots if frame.member_steps != 0 else 0
        rounds += part * OTHER_NOISE
        # Lanes make steps together: the states of finished members are saved from them.
        idle = frame.member_steps != 0 and transfer.park_finished(frame, state, now, 1)
        march_members(frame, state, work, frame.monitors, rounds, now, stop)
        if idle:
            transfer.park_finished(frame, state, now, 0)
        if frame.growth != 0:
            is_planned = is_recorded(frame, round_first, stop)
            if is_planned or frame.member_steps != 0:
                planned = 1.0 if is_planned else 0.0
                arguments = substeps, state, work, frame.growth_row, stop * 1.0, planned
                call_address(frame.record_growth, arguments)
        for group in range(frame.monitors):
            arguments = (
                substeps, state, work, flat.trace, memory(frame.kept, 1.0), frame.monitor_row,
                frame.axes_row, now, stop, frame.nodes, group,
            )  # fmt: skip
            call_address(frame.monitor_steps, arguments)
        now = stop


def record_interval(round_first, step):
    """Return the steps between two records of growth after step `step` of a round.

    At first this is an eighth of the steps made: between two records the tangent is assumed to grow
    at one rate.
    """
    if round_first > 0:
        return RECORD_EVERY
    return 1 if step < 16 else 2 if step < 32 else 4 if step < 64 else RECORD_EVERY


def is_recorded(frame, round_first, step):
    """Return whether growth is recorded after step `step` of a round for all members: as planned,
    and after the last step of a run without member steps."""
    is_last = frame.member_steps == 0 and step == frame.total
    return is_last or step % record_interval(round_first, step - 1) == 0


def march_members(frame, state, work, is_traced, rounds, first, last):
    """Make steps from step `first` of a round to `last`."""
    flat, streams = transfer.block_memory(frame), memory(frame.streams, frame.key)
    arguments = (
        flat.substeps, frame.substep_rows, state, work, flat.trace, is_traced, frame.key,
        frame.second_key, streams, rounds, first, last,
    )  # fmt: skip
    call_address(frame.march, arguments)


def max_member_steps(frame, last):
    """Return the largest number of own steps in a round among the members, at most `last`."""
    largest, work = 0, transfer.block_memory(frame).work
    for k in range(frame.lanes):
        steps = work[layout.MEMBER_STEPS * frame.lanes + k]
        if steps > largest * 1.0:
            largest = np.int64(steps) if steps < last * 1.0 else last
    return largest


def next_finish(frame, now, stop):
    """Return the step at which the first of the members still moving has made all its steps."""
    work = transfer.block_memory(frame).work
    for k in range(frame.lanes):
        steps = work[layout.MEMBER_STEPS * frame.lanes + k]
        if now * 1.0 < steps and steps < stop * 1.0:
            stop = np.int64(steps)
    return stop


def refine_events(frame):
    """Find the exact times of the first and last of each event, by steps back from the recorded
    states."""
    lanes, flat, ratio = frame.lanes, transfer.block_memory(frame), 1.0
    substeps, work, spare_work = flat.substeps, flat.work, flat.spare_work
    state, spare_state = flat.state, flat.spare_state
    if frame.total > frame.head:
        ratio = frame.h / frame.last_h
    long_until = time_at(frame, min_integer(frame.total, frame.head))
    # Steps back need body, effects and the lengths of steps, and must not change the members
    # themselves.
    for j in range(1 + frame.tangents):
        at = j * frame.tangents_in_work * lanes
        for i in range(at, at + layout.MEMBER_ROWS * lanes):
            spare_work[i] = work[i]
        at = j * frame.tangents_in_state * lanes
        for i in range(at, at + (layout.BODY_AT + frame.rows - layout.BODY) * lanes):
            spare_state[i] = state[i]
    for record in range(frame.records):
        count, row = 0.0, frame.monitor_row + record // 2 * layout.EVENT_ROWS + layout.COUNT
        for k in range(lanes):
            count += abs(work[row * lanes + k])
        # A nan count means that the member is not healthy; it compares False.
        tries = frame.tries if count > 0.0 else 0
        for steps_back in range(tries + 1):
            arguments = (
                substeps, work, spare_state, spare_work, frame.monitor_row, frame.axes_row, record,
                steps_back, long_until, ratio,
            )  # fmt: skip
            call_address(frame.refine_event, arguments)
            if steps_back < tries:
                march_members(frame, spare_state, spare_work, 0, 0, 0, 1)


inline_all(sys.modules[__name__])
