"""A block of members on one thread of the processor, some members at a time side by side.

They live the life of `rigidmc.engine.kernel.member`. `advance` is compiled once for all scenes: it
knows the pieces of a program by their addresses, and how many numbers lie side by side by a number.
"""

import sys
from typing import Any, NamedTuple

import numpy as np

from rigidmc.engine.compiler.compose import inline_all
from rigidmc.engine.compiler.kernels import call
from rigidmc.engine.compiler.memory import memory
from rigidmc.engine.kernel.layout import (  # fmt: skip
    BEGAN,
    BODY,
    BODY_AT,
    COUNT,
    EACH,
    EVENT,
    INDEX,
    KNOWN,
    LENGTH,
    START,
    STATUS,
    STOPPED,
)
from rigidmc.physics.dynamics.functions import as_float
from rigidmc.physics.observables.chaos import OFTEN

# Steps between two looks at drift and health: a look takes as long as 3 steps of rk4 without
# effects, 5 % of 64.
LOOK = 64
TRACE = 32  # steps that are made before they are watched: their states fit in the fastest cache


class Flat(NamedTuple):
    """The memory of a frame as plain numbers: row i of member k is number i * lanes + k."""

    parts: Any
    block: Any
    state: Any
    near: Any
    work: Any
    aside: Any
    trace: Any


def flat_memory(frame):
    """The Flat of a frame."""
    real = frame.real
    parts, block = memory(frame.parts, 1.0), memory(frame.block, 1.0)
    state, near = memory(frame.state, real), memory(frame.near, real)
    work, aside = memory(frame.work, 1.0), memory(frame.aside, 1.0)
    return Flat(parts, block, state, near, work, aside, memory(frame.trace, real))


def advance(kinds, numbers, frame):
    """Take every member of a block from step frame.first to step frame.last.

    frame : a record of `rigidmc.engine.kernel.arguments.frame_type`. Its block (rows, n) is laid
        out as in
        `rigidmc.engine.kernel.layout` and changed in place; n is a multiple of LANES. Between calls
        it holds the state as the integrator keeps it between steps, after step `total` the true one
    """
    for low in range(0, frame.width, frame.lanes):
        live(frame, low)
    return 0


def live(frame, low):
    """Take the members of a block from `low` on, as many as there are lanes."""
    flat = flat_memory(frame)
    enter(frame, low)
    if frame.first == 0:
        begin(frame, low)
    elif frame.shadow != 0:
        swap(frame, 0)
    now, idle = frame.first, False
    while now < frame.last:
        # `begun` is the first step of the round; without member steps there is one round
        begun = now // frame.slots * frame.slots if frame.member_steps != 0 else 0
        stop = ending(frame, now, begun)
        if now == frame.head:
            shorten(frame, (frame.slots if frame.member_steps != 0 else now) * 1.0)
        elif frame.member_steps != 0 and now == begun:
            for k in range(frame.lanes):
                flat.work[BEGAN * frame.lanes + k] = begun // frame.slots * frame.h
        if not idle:
            steps(frame, begun, now - begun, stop - begun)
        now, slot = stop, stop - begun
        saved = now == frame.total or now % frame.stride == 0
        # no look where only a call ends: no result depends on calls
        planned = slot % LOOK == 0 and (frame.member_steps == 0 or slot < frame.slots)
        if saved or planned:
            rounds = begun // frame.slots * 1.0 if frame.member_steps != 0 else 0.0
            late = 1.0 if 2 * now > frame.total else 0.0
            idle = look(frame, rounds, slot, late, 1.0 if planned else 0.0)
        if saved:
            save(frame, low, now)
    leave(frame, low)
    return 0


def enter(frame, low):
    """Bring the rows of the members from `low` on side by side."""
    flat, lanes, member_steps, first = (
        flat_memory(frame),
        frame.lanes,
        frame.member_steps,
        frame.first,
    )
    order, rows, members = memory(frame.order, lanes), frame.rows, frame.width
    indices = memory(frame.members, lanes)
    h, time = frame.h, first // frame.slots * frame.h if member_steps != 0 else 0.0
    if first > frame.head:
        h, time = frame.last_h, last_began(frame)
    call(
        frame.enter,
        (flat.block, rows, members, low, member_steps, h, time, flat.state, flat.work),
    )
    for k in range(lanes if frame.noisy != 0 else 0):
        place = order[low + k] if member_steps != 0 else low + k
        flat.work[INDEX * lanes + k] = as_float(np.uint64(indices[place] + 1))


def shorten(frame, slot):
    """Begin the last interval, whose steps have a length of their own, after `slot` steps of the
    round before it."""
    flat, lanes, member_steps, h = flat_memory(frame), frame.lanes, frame.member_steps, frame.last_h
    parts, state, work, began = flat.parts, flat.state, flat.work, last_began(frame)
    if frame.reopens != 0:
        for other in range(1 + frame.shadow):
            moving = flat.near if other != 0 else state
            call(frame.reopen, (parts, moving, work, slot, began, h, member_steps))
    if frame.reweighs != 0:
        call(frame.reweigh, (work, frame.watched, frame.h / h))
    for k in range(lanes):
        work[LENGTH * lanes + k] = h / work[EACH * lanes + k] if member_steps != 0 else h
        work[BEGAN * lanes + k] = began


def last_began(frame):
    """When the round of the last interval began [s]; without rounds, when steps of its length would
    have begun for step `head` to end where it does."""
    h = frame.h if frame.member_steps != 0 else frame.h - frame.last_h
    return frame.head // frame.slots * h


def time_of(frame, now):
    """The time at step `now`, the end of a round [s]."""
    if now <= frame.head:
        return now // frame.slots * frame.h
    late = (now - frame.head) // frame.slots * frame.last_h
    return frame.head // frame.slots * frame.h + late


def position(frame, now):
    """The time at step `now` in steps of the first length."""
    if now <= frame.head:
        return now * 1.0
    return frame.head + (now - frame.head) * (frame.last_h / frame.h)


def begin(frame, low):
    """The start of the members: judged, watched and saved."""
    flat = flat_memory(frame)
    call(frame.begin, (flat.parts, flat.state, flat.work))
    if frame.looks != 0:
        call(frame.begin_watch, (flat.parts, flat.state, flat.work, frame.watched))
    if frame.shadow != 0:
        swap(frame, 0)
        span = time_of(frame, frame.total)
        call(frame.begin_near, (flat.parts, flat.state, flat.work, flat.near, frame.near_at, span))
    save(frame, low, 0)


def ending(frame, now, begun):
    """The next step at which members are looked at, saved, or left."""
    looked = begun + ((now - begun) // LOOK + 1) * LOOK
    stop = smaller(smaller(frame.last, looked), (now // frame.stride + 1) * frame.stride)
    return smaller(stop, begun + frame.slots) if frame.member_steps != 0 else stop


def smaller(a, b):
    """The smaller of two integers; Numba takes 20 ms to compile `min` for each kind of number."""
    return a if a < b else b


def look(frame, rounds, slot, late, planned):
    """Look at the members after `slot` steps of a round, `rounds` of which are done.

    late : 1 in the second half of the run, else 0;  planned : 1 if no save asked for the look, or 0

    True if all of them are stopped or frozen.
    """
    lanes, flat = frame.lanes, flat_memory(frame)
    call(frame.look, (flat.parts, flat.state, flat.work, rounds, slot * 1.0, late, planned))
    work = flat.work
    moving = 0
    for k in range(lanes):
        if work[(KNOWN + STATUS) * lanes + k] == 0.0 and work[STOPPED * lanes + k] == 0.0:
            moving += 1
    return moving == 0


def swap(frame, out):
    """Bring back the neighbours of members that go on in the middle of a run (`out` is 0), or put
    them to their rows."""
    at, flat = frame.near_at * frame.lanes, flat_memory(frame)
    state, near = flat.state, flat.near
    for i in range((BODY_AT + frame.rows - BODY) * frame.lanes if out == 0 else 0):
        near[i] = state[i]
    for i in range(START * frame.lanes):
        if out == 0:
            near[i] = state[at + i]
        else:
            state[at + i] = near[i]


def steps(frame, begun, first, last):
    """Steps from `first` to `last` of the round that began with step `begun`, watched if asked."""
    now, flat = first, flat_memory(frame)
    parts, state, near, work = flat.parts, flat.state, flat.near, flat.work
    if frame.member_steps != 0:
        last = most_steps(frame, last)
    while now < last:
        stop = last
        if frame.shadow != 0:
            every = pause(begun + now)
            stop = smaller(stop, ((begun + now) // every + 1) * every - begun)
        if frame.looks != 0:
            stop = smaller(stop, (now // TRACE + 1) * TRACE)
        if frame.member_steps != 0:
            stop = first_end(frame, now, stop)
        rounds = begun // frame.slots if frame.member_steps != 0 else 0
        for other in range(1 + frame.shadow):
            moving = near if other != 0 else state
            idle = frame.member_steps != 0 and put_aside(frame, moving, now, 1)
            march(frame, moving, work, frame.looks if other == 0 else 0, rounds, now, stop)
            if idle:
                put_aside(frame, moving, now, 0)
        if frame.shadow != 0 and is_meeting(begun + stop, frame.total):
            at, before = position(frame, stop), position(frame, last_meeting(stop))
            call(frame.meet, (parts, state, work, near, frame.near_at, stop * 1.0, at, before))
        if frame.looks != 0:
            call(
                frame.watch,
                (parts, state, work, flat.trace, frame.watched, now, stop, frame.nodes),
            )
        now = stop


def pause(step):
    """The steps between two meetings with the neighbour after `step`: OFTEN, at first fewer, an
    eighth of those made, because the growth is noted as even between two."""
    return 1 if step < 16 else 2 if step < 32 else 4 if step < 64 else OFTEN


def last_meeting(step):
    """The step of the last meeting before that at `step`."""
    every = pause(step - 1)
    return (step - 1) // every * every


def is_meeting(step, total):
    """Whether the neighbour is met after a step, as after the last, `total`."""
    return step == total or step % pause(step - 1) == 0


def march(frame, state, work, traced, rounds, now, stop):
    """Make steps from step `now` of a round to `stop`."""
    flat, streams = flat_memory(frame), memory(frame.streams, frame.key)
    parts, trace, count, key, other = (
        flat.parts,
        flat.trace,
        frame.part_rows,
        frame.key,
        frame.other,
    )
    call(
        frame.march,
        (parts, count, state, work, trace, traced, key, other, streams, rounds, now, stop),
    )


def most_steps(frame, last):
    """The largest number of own steps in a round among the members, at most `last`."""
    most, work = 0, flat_memory(frame).work
    for k in range(frame.lanes):
        each = work[EACH * frame.lanes + k]
        if each > most * 1.0:
            most = np.int64(each) if each < last * 1.0 else last
    return most


def first_end(frame, now, stop):
    """The step at which the first of the members that still move has made all its steps."""
    work = flat_memory(frame).work
    for k in range(frame.lanes):
        each = work[EACH * frame.lanes + k]
        if now * 1.0 < each and each < stop * 1.0:
            stop = np.int64(each)
    return stop


def put_aside(frame, state, now, out):
    """Put the states of members that have made all their steps aside, or bring them back.

    True if there are any.  out : 0 to bring them back
    """
    lanes, any_done, place = frame.lanes, False, 7 * (TRACE + 1) * frame.lanes
    flat = flat_memory(frame)
    trace, work = flat.trace, flat.work
    for k in range(lanes):
        if work[EACH * lanes + k] <= float(now):
            any_done = True
            for i in range(START + frame.works):
                at = (i if i < START else frame.works_at + i - START) * lanes + k
                if out != 0:
                    trace[place + i * lanes + k] = state[at]
                else:
                    state[at] = trace[place + i * lanes + k]
    return any_done


def save(frame, low, now):
    """Write what is saved of the members at step `now`.

    Members with steps of their own are not in their order: their values go to `saved` first.
    """
    if frame.columns != 0 and frame.values != 0:
        lanes, work, out = frame.lanes, flat_memory(frame).work, memory(frame.out, 1.0)
        saved, order = memory(frame.saved, 1.0), memory(frame.order, lanes)
        last = (frame.total + frame.stride - 1) // frame.stride
        slot = last if now == frame.total else now // frame.stride
        base = slot * frame.values * frame.columns + frame.column
        t, aside = time_of(frame, now), frame.member_steps != 0
        to, at, pitch = (saved, 0, lanes) if aside else (out, base + low, frame.columns)
        call(frame.record, (work, to, at, pitch, t, 0 if aside else frame.past))
        for i in range(frame.values if aside else 0):
            for k in range(lanes):
                out[base + i * frame.columns + order[low + k]] = saved[i * lanes + k]


def leave(frame, low):
    """Put the rows of the members back.

    At the end of the run they have the last good state and the exact times of events.
    """
    done = 1 if frame.last == frame.total else 0
    if frame.shadow != 0:
        swap(frame, 1)
    if done != 0 and frame.records > 0:
        find(frame)
    flat, rows, members, works = flat_memory(frame), frame.rows, frame.width, frame.works
    works_at, near = BODY + frame.works_at - BODY_AT, BODY + frame.near_at - BODY_AT
    call(
        frame.leave,
        (flat.block, rows, members, low, works, works_at, near, done, flat.state, flat.work),
    )


def find(frame):
    """The exact times of the first and last of each event, by steps back from the noted states."""
    lanes, flat, longer = frame.lanes, flat_memory(frame), 1.0
    parts, state, near, work, aside = flat.parts, flat.state, flat.near, flat.work, flat.aside
    if frame.total > frame.head:
        longer = frame.h / frame.last_h
    ends = time_of(frame, smaller(frame.total, frame.head))  # of the steps before the last interval
    for i in range(KNOWN * lanes):
        aside[i] = work[i]
    for i in range((BODY_AT + frame.rows - BODY) * lanes):
        near[i] = state[i]
    for which in range(frame.records):
        seen = 0.0
        for k in range(lanes):
            seen += abs(work[(frame.watched + which // 2 * EVENT + COUNT) * lanes + k])
        tries = frame.tries if seen > 0.0 else 0
        for tried in range(tries + 1):
            given = parts, work, near, aside, frame.watched, which, tried, ends, longer
            call(frame.seek, given)
            if tried < tries:
                march(frame, near, aside, 0, 0, 0, 1)


inline_all(sys.modules[__name__])
