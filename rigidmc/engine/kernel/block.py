"""A block of members on one thread, as many at a time as there are lanes.

This file is the order of events in the life of members; the kernels (`rigidmc.engine.kernel.member`
and others) do the work. `advance` is compiled once for all scenes: it gets the kernels of a program
by their addresses, and the number of lanes as a number. A GPU runs `run_lanes` for one member in
each thread.

frame : the record of all arguments, see `rigidmc.engine.kernel.arguments`
"""

import sys
from typing import Any, NamedTuple

import numpy as np

from rigidmc.engine.compiler.compose import inline_all
from rigidmc.engine.compiler.kernels import call_address
from rigidmc.engine.compiler.memory import memory, shifted
from rigidmc.engine.kernel.arguments import NO_STEP
from rigidmc.engine.kernel.layout import (  # fmt: skip
    BODY,
    BODY_AT,
    COUNT,
    EVENT_ROWS,
    INDEX,
    MEMBER_ROWS,
    MEMBER_STEPS,
    ROUND_START,
    START,
    STEP_LENGTH,
)
from rigidmc.physics.dynamics.functions import as_float
from rigidmc.physics.observables.chaos import RECORD_EVERY

# Steps between two assessments of drift and health: one assessment takes as long as 2 steps of rk4
# without effects, 3 % of 64 steps.
ASSESS_INTERVAL = 64
# Steps made before they are monitored: their states for 16 members, 7 x 33 x 16 numbers, fit in a
# first-level cache of 32 kB.
TRACE = 32


class BlockMemory(NamedTuple):
    """The memory of a frame as plain numbers: row i of member k is number i * lanes + k."""

    substeps: Any
    block: Any
    state: Any
    spare_state: Any
    work: Any
    spare_work: Any
    trace: Any


def block_memory(frame):
    """Return the BlockMemory of a frame."""
    real = frame.real
    substeps, block = memory(frame.substeps, 1.0), memory(frame.block, 1.0)
    state, spare_state = memory(frame.state, real), memory(frame.spare_state, real)
    work, spare_work = memory(frame.work, 1.0), memory(frame.spare_work, 1.0)
    trace = memory(frame.trace, real)
    return BlockMemory(substeps, block, state, spare_state, work, spare_work, trace)


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
    flat = block_memory(frame)
    gather_members(frame, low)
    gather_tangents(frame, low, part)
    if frame.growth != 0:
        gather_growing(frame, low)
    if frame.first == 0:
        initialise_members(frame, low, part)
    # Once all lanes are stopped or frozen, no more steps are made, but saves go on to the end.
    now, idle = frame.first, False
    save = next_save(frame, now)
    save_step = step_of_save(frame, save)
    while now < frame.last:
        # the first step of the round; without member steps there is one round
        round_first = now // frame.slots * frame.slots if frame.member_steps != 0 else 0
        stop = next_stop(frame, now, round_first, save_step)
        if now == frame.head:
            begin_last_interval(frame, (frame.slots if frame.member_steps != 0 else now) * 1.0)
        elif frame.member_steps != 0 and now == round_first:
            for k in range(frame.lanes):
                flat.work[ROUND_START * frame.lanes + k] = round_first // frame.slots * frame.h
        if not idle:
            make_steps(frame, round_first, now - round_first, stop - round_first)
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
            save_members(frame, low, now, save, part)
            save += 1
            save_step = step_of_save(frame, save)
    scatter_members(frame, low, part)
    return 0


def gather_members(frame, low):
    """Copy the rows of the members from `low` on to the workspace."""
    flat, lanes, first = block_memory(frame), frame.lanes, frame.first
    member_steps = frame.member_steps
    order, rows, members = memory(frame.order, lanes), frame.rows, frame.width
    indices = memory(frame.members, lanes)
    h, round_start = frame.h, first // frame.slots * frame.h if member_steps != 0 else 0.0
    if first > frame.head:
        h, round_start = frame.last_h, last_round_start(frame)
    state, work = flat.state, flat.work
    arguments = flat.block, rows, members, low, member_steps, h, round_start, state, work
    call_address(frame.gather, arguments)
    for k in range(lanes if frame.is_random != 0 else 0):
        index = order[low + k] if member_steps != 0 else low + k
        # The bits of index + 1 as a float: rows of `work` are float64, and no arithmetic touches
        # them.
        work[INDEX * lanes + k] = as_float(np.uint64(indices[index] + 1))


def gather_tangents(frame, low, part):
    """Copy the derivatives of the members from `low` on to the workspace; part : the pass."""
    flat, lanes, rows, members = block_memory(frame), frame.lanes, frame.rows, frame.width
    for j in range(frame.tangents):
        column = 1 + part * frame.tangents + j
        block = shifted(flat.block, column * rows * members)
        state = shifted(flat.state, (1 + j) * frame.tangents_in_state * lanes)
        work = shifted(flat.work, (1 + j) * frame.tangents_in_work * lanes)
        call_address(frame.gather, (block, rows, members, low, 0, 0.0, 0.0, state, work))
        for k in range(lanes):
            work[MEMBER_STEPS * lanes + k] = 0.0


def begin_last_interval(frame, slot):
    """Begin the last interval, whose steps have another length.

    slot : steps of the round before it
    """
    flat, lanes, work = block_memory(frame), frame.lanes, block_memory(frame).work
    own, h, round_start = frame.member_steps, frame.last_h, last_round_start(frame)
    if frame.changes_length != 0:
        arguments = flat.substeps, flat.state, work, slot, round_start, h, own
        call_address(frame.change_length, arguments)
    if frame.reweighs != 0:
        call_address(frame.reweigh, (work, frame.monitor_row, frame.h / h))
    for k in range(lanes):
        work[STEP_LENGTH * lanes + k] = h / work[MEMBER_STEPS * lanes + k] if own != 0 else h
        work[ROUND_START * lanes + k] = round_start


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
    flat = block_memory(frame)
    substeps, state, work = flat.substeps, flat.state, flat.work
    call_address(frame.initialise, (substeps, state, work))
    if frame.monitors != 0:
        arguments = substeps, state, work, frame.monitor_row, frame.axes_row
        call_address(frame.begin_monitors, arguments)
    if frame.growth != 0:
        arguments = substeps, state, work, frame.growth_row, time_at(frame, frame.total)
        call_address(frame.begin_growth, arguments)
    save_members(frame, low, 0, 0, part)


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
    flat = block_memory(frame)
    arguments = flat.substeps, flat.state, flat.work, rounds, slot * 1.0, late, planned
    return call_address(frame.assess, arguments) == 0


def gather_growing(frame, low):
    """Copy the tangents that grow, of the members from `low` on, to the workspace: they are the
    last derivatives of the state. Bodies and effects do not change along them.
    """
    flat, lanes, members = block_memory(frame), frame.lanes, frame.width
    state = shifted(flat.state, (1 + frame.tangents) * frame.tangents_in_state * lanes)
    work = shifted(flat.work, (1 + frame.tangents) * frame.tangents_in_work * lanes)
    first = (frame.growth_row - MEMBER_ROWS) * members + low
    for i in range(BODY_AT + frame.rows - BODY):
        for k in range(lanes):
            state[i * lanes + k] = flat.block[first + i * members + k] if i < START else 0.0
    for i in range((MEMBER_ROWS + frame.rows) * lanes if frame.tangents != 0 else 0):
        work[i] = 0.0


def scatter_growing(frame, low):
    """Copy the tangents that grow, of the members from `low` on, back to the block."""
    flat, lanes, members = block_memory(frame), frame.lanes, frame.width
    state = shifted(flat.state, (1 + frame.tangents) * frame.tangents_in_state * lanes)
    first = (frame.growth_row - MEMBER_ROWS) * members + low
    for i in range(START):
        for k in range(lanes):
            flat.block[first + i * members + k] = state[i * lanes + k]


def make_steps(frame, round_first, first, last):
    """Make and monitor the steps from `first` to `last` of a round.

    round_first : the step with which the round began
    """
    now, flat = first, block_memory(frame)
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
        # Lanes make steps together: the states of finished members are saved from them.
        idle = frame.member_steps != 0 and park_finished(frame, state, now, 1)
        march_members(frame, state, work, frame.monitors, rounds, now, stop)
        if idle:
            park_finished(frame, state, now, 0)
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
    flat, streams = block_memory(frame), memory(frame.streams, frame.key)
    arguments = (
        flat.substeps, frame.substep_rows, state, work, flat.trace, is_traced, frame.key,
        frame.second_key, streams, rounds, first, last,
    )  # fmt: skip
    call_address(frame.march, arguments)


def max_member_steps(frame, last):
    """Return the largest number of own steps in a round among the members, at most `last`."""
    largest, work = 0, block_memory(frame).work
    for k in range(frame.lanes):
        steps = work[MEMBER_STEPS * frame.lanes + k]
        if steps > largest * 1.0:
            largest = np.int64(steps) if steps < last * 1.0 else last
    return largest


def next_finish(frame, now, stop):
    """Return the step at which the first of the members still moving has made all its steps."""
    work = block_memory(frame).work
    for k in range(frame.lanes):
        steps = work[MEMBER_STEPS * frame.lanes + k]
        if now * 1.0 < steps and steps < stop * 1.0:
            stop = np.int64(steps)
    return stop


def park_finished(frame, state, now, stores):
    """Copy the states of members that have made all their steps behind the trace, or back.

    stores : 0 to copy them back

    Return True if there are any.
    """
    lanes, is_any_finished, parking = frame.lanes, False, frame.parking * frame.lanes
    flat = block_memory(frame)
    trace, work = flat.trace, flat.work
    for k in range(lanes):
        if work[MEMBER_STEPS * lanes + k] <= float(now):
            is_any_finished = True
            for j in range(1 + frame.tangents + frame.growth):
                for i in range(START + frame.works):
                    row = i if i < START else frame.work_row + i - START
                    at = (j * frame.tangents_in_state + row) * lanes + k
                    place = parking + (j * (START + frame.works) + i) * lanes + k
                    if stores != 0:
                        trace[place] = state[at]
                    else:
                        state[at] = trace[place]
    return is_any_finished


def save_members(frame, low, now, save, part):
    """Write the saved values of the members at step `now`, and their derivatives of a pass.

    save : number of the save

    Members with their own steps are sorted by steps: their values go to `saved` first.
    """
    if frame.columns != 0 and frame.values != 0:
        lanes, work, out = frame.lanes, block_memory(frame).work, memory(frame.out, 1.0)
        saved, order = memory(frame.saved, 1.0), memory(frame.order, lanes)
        tangents, each = frame.tangents, 1 + frame.passes * frame.tangents
        base = save * frame.values * each * frame.columns + frame.column
        first, t, reorders = 1 + part * tangents, time_at(frame, now), frame.member_steps != 0
        if reorders:
            arguments = (
                work, frame.axes_row, saved, 0, (1 + tangents) * lanes, t, 0, lanes, lanes,
            )  # fmt: skip
        else:
            pitch = frame.columns
            arguments = (
                work, frame.axes_row, out, base + low, each * pitch, t, frame.skips_cache,
                first * pitch, pitch,
            )  # fmt: skip
        call_address(frame.record, arguments)
        for i in range(frame.values if reorders else 0):
            for j in range(1 + tangents):
                row = i * each + (0 if j == 0 else first + j - 1)
                for k in range(lanes):
                    at = (i * (1 + tangents) + j) * lanes + k
                    out[base + row * frame.columns + order[low + k]] = saved[at]


def scatter_members(frame, low, part):
    """Copy the rows of the members back to the block: their derivatives of a pass, and after the
    last pass all others.

    At the end of the run they contain the last good state and the exact times of events.
    """
    done = 1 if frame.last == frame.total else 0
    if done != 0 and frame.records > 0:
        refine_events(frame)
    scatter_tangents(frame, low, part)
    if part < frame.passes - 1:
        return
    flat, rows, members, works = block_memory(frame), frame.rows, frame.width, frame.works
    work_row = BODY + frame.work_row - BODY_AT
    at = rows, members, low, works, work_row, done
    call_address(frame.scatter, (flat.block, *at, flat.state, flat.work))
    if frame.growth != 0:
        scatter_growing(frame, low)


def scatter_tangents(frame, low, part):
    """Copy the derivatives of the members from `low` on to the block; part : the pass."""
    flat, lanes, rows, members = block_memory(frame), frame.lanes, frame.rows, frame.width
    work_row = BODY + frame.work_row - BODY_AT
    done = 1 if frame.last == frame.total else 0
    for j in range(frame.tangents):
        block = shifted(flat.block, (1 + part * frame.tangents + j) * rows * members)
        state = shifted(flat.state, (1 + j) * frame.tangents_in_state * lanes)
        work = shifted(flat.work, (1 + j) * frame.tangents_in_work * lanes)
        at = rows, members, low, frame.works, work_row, done
        call_address(frame.scatter, (block, *at, state, work))


def refine_events(frame):
    """Find the exact times of the first and last of each event, by steps back from the recorded
    states."""
    lanes, flat, ratio = frame.lanes, block_memory(frame), 1.0
    substeps, work, spare_work = flat.substeps, flat.work, flat.spare_work
    state, spare_state = flat.state, flat.spare_state
    if frame.total > frame.head:
        ratio = frame.h / frame.last_h
    long_until = time_at(frame, min_integer(frame.total, frame.head))
    # Steps back need body, effects and the lengths of steps, and must not change the members
    # themselves.
    for j in range(1 + frame.tangents):
        at = j * frame.tangents_in_work * lanes
        for i in range(at, at + MEMBER_ROWS * lanes):
            spare_work[i] = work[i]
        at = j * frame.tangents_in_state * lanes
        for i in range(at, at + (BODY_AT + frame.rows - BODY) * lanes):
            spare_state[i] = state[i]
    for record in range(frame.records):
        count = 0.0
        for k in range(lanes):
            count += abs(work[(frame.monitor_row + record // 2 * EVENT_ROWS + COUNT) * lanes + k])
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
