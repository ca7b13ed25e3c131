"""A block of members on one thread of the processor: some at a time, side by side, live the life of `rigidmc.engine.member`.

`advance` is compiled once for all scenes: it knows the pieces of a program by their addresses, and how many numbers lie side by side as a number.
"""

import numpy as np

from rigidmc.engine.compose import inline
from rigidmc.engine.events import COUNT, EVENT
from rigidmc.engine.layout import (
    BEGAN,
    BODY,
    BODY_AT,
    EACH,
    INDEX,
    KNOWN,
    START,
    STATUS,
    STOPPED,
)  # fmt: skip
from rigidmc.engine.memory import memory
from rigidmc.engine.numbers import as_float
from rigidmc.engine.pieces import call
from rigidmc.engine.watch import OFTEN

LOOK = 64  # steps between two looks at drift and health: a look takes as long as 2.7 steps of rk4 without effects, 4 % of 64
TRACE = 32  # steps that are made before they are watched: their states fit in the fastest cache


def advance(kinds, numbers, frame):
    """Take every member of a block from step frame.first to step frame.last; frame: a record of `rigidmc.engine.frame.frame_type`.

    block : (rows, n) as in `rigidmc.engine.layout`, changed in place; n a multiple of LANES. Between calls it holds the state as the integrator keeps it
        between steps, after step `total` the true one
    """
    for low in range(0, frame.width, frame.lanes):
        enter(frame, low)
        if frame.first == 0:
            begin(frame, low)
        elif frame.shadow != 0:
            swap(frame, 0)
        now, idle = frame.first, False
        while now < frame.last:
            begun = (
                now // frame.slots * frame.slots if frame.own != 0 else 0
            )  # of the round; without own steps there is one
            stop = ending(frame, now, begun)
            if frame.own != 0 and now == begun:
                work = memory(frame.work, 1.0)
                for k in range(frame.lanes):
                    work[BEGAN * frame.lanes + k] = begun // frame.slots * frame.h
            if not idle:
                steps(frame, begun, now - begun, stop - begun)
            now, slot = stop, stop - begun
            saved = now == frame.total or now % frame.stride == 0
            if saved or (
                slot % LOOK == 0 and (frame.own == 0 or slot < frame.slots)
            ):  # not where a call ends: no result depends on calls
                idle = look(frame, begun // frame.slots * 1.0 if frame.own != 0 else 0.0, slot)
            if saved:
                save(frame, low, now)
        leave(frame, low)
    return 0


def enter(frame, low):
    """Bring the rows of some members side by side."""
    lanes, own, work, order = (
        frame.lanes,
        frame.own,
        memory(frame.work, 1.0),
        memory(frame.order, frame.lanes),
    )
    time = frame.first // frame.slots * frame.h if own != 0 else 0.0
    state, block = memory(frame.state, frame.real), memory(frame.block, 1.0)
    call(frame.enter, (block, frame.rows, frame.width, low, own, frame.h, time, state, work))
    for k in range(lanes if frame.noisy != 0 else 0):
        place = order[low + k] if own != 0 else low + k
        work[INDEX * lanes + k] = as_float(np.uint64(frame.member + place + 1))


def begin(frame, low):
    """The start of some members."""
    parts, state, work = (
        memory(frame.parts, 1.0),
        memory(frame.state, frame.real),
        memory(frame.work, 1.0),
    )
    call(frame.begin, (parts, state, work))
    if frame.looks != 0:
        call(frame.begin_watch, (parts, state, work, frame.watched))
    if frame.shadow != 0:
        swap(frame, 0)
        call(frame.begin_near, (parts, state, work, memory(frame.near, frame.real), frame.near_at))
    save(frame, low, 0)


def look(frame, rounds, slot):
    """Look at some members after `slot` steps of a round, `rounds` of which are done; whether all are stopped, or stay as they are for good."""
    lanes, work = frame.lanes, memory(frame.work, 1.0)
    call(
        frame.look,
        (memory(frame.parts, 1.0), memory(frame.state, frame.real), work, rounds, slot * 1.0),
    )
    moving = 0
    for k in range(lanes):
        if work[(KNOWN + STATUS) * lanes + k] == 0.0 and work[STOPPED * lanes + k] == 0.0:
            moving += 1
    return moving == 0


def swap(frame, out):
    """Bring back the neighbour of members that begin in the middle of a run, or put it to their rows."""
    at, state, near = (
        frame.near_at * frame.lanes,
        memory(frame.state, frame.real),
        memory(frame.near, frame.real),
    )
    for i in range((BODY_AT + frame.rows - BODY) * frame.lanes if out == 0 else 0):
        near[i] = state[i]
    for i in range(START * frame.lanes):
        if out == 0:
            near[i] = state[at + i]
        else:
            state[at + i] = near[i]


def ending(frame, now, begun):
    """The step at which members are looked at next, saved, or left."""
    stop = min(
        min(frame.last, begun + ((now - begun) // LOOK + 1) * LOOK),
        (now // frame.stride + 1) * frame.stride,
    )
    return min(stop, begun + frame.slots) if frame.own != 0 else stop


def steps(frame, begun, first, last):
    """Steps from `first` to `last` of the round that began with step `begun`, watched where that is asked for."""
    parts, state, work = (
        memory(frame.parts, 1.0),
        memory(frame.state, frame.real),
        memory(frame.work, 1.0),
    )
    near, now = memory(frame.near, frame.real), first
    if frame.own != 0:
        last = most_steps(frame, last)
    while now < last:
        stop = last
        if frame.shadow != 0:
            stop = min(last, (begun + now) // OFTEN * OFTEN + OFTEN - begun)
        if frame.looks != 0:
            stop = min(stop, (now // TRACE + 1) * TRACE)
        if frame.own != 0:
            stop = some_end(frame, now, stop)
        rounds = begun // frame.slots if frame.own != 0 else 0
        for other in range(1 + frame.shadow):
            moving = near if other != 0 else state
            idle = frame.own != 0 and put_aside(frame, moving, now, 1)
            march(frame, moving, work, frame.looks if other == 0 else 0, rounds, now, stop)
            if idle:
                put_aside(frame, moving, now, 0)
        if frame.shadow != 0 and (begun + stop) % OFTEN == 0:
            number = (begun + stop) // OFTEN * 1.0
            call(frame.meet, (parts, state, work, near, frame.near_at, stop * 1.0, number))
        if frame.looks != 0:
            call(
                frame.watch,
                (parts, state, work, memory(frame.trace, frame.real), frame.watched, now, stop),
            )
        now = stop


def march(frame, state, work, traced, rounds, now, stop):
    """Steps of some members, from step `now` of a round to `stop`."""
    trace, streams = memory(frame.trace, frame.real), memory(frame.streams, frame.key)
    parts = memory(frame.parts, 1.0)
    call(
        frame.march,
        (
            parts,
            frame.part_rows,
            state,
            work,
            trace,
            traced,
            frame.key,
            frame.other,
            streams,
            rounds,
            now,
            stop,
        ),
    )


def most_steps(frame, last):
    """How many steps of a round the member makes that makes most, up to `last`."""
    most, work = 0.0, memory(frame.work, 1.0)
    for k in range(frame.lanes):
        most = max(most, work[EACH * frame.lanes + k])
    return int(min(most, float(last)))


def some_end(frame, now, stop):
    """The step at which the first of the members that still move has made all of its own."""
    work = memory(frame.work, 1.0)
    for k in range(frame.lanes):
        each = work[EACH * frame.lanes + k]
        if float(now) < each and each < float(stop):
            stop = int(each)
    return stop


def put_aside(frame, state, now, out):
    """Put the states of members that have made all of their steps aside, or bring them back; whether there are any."""
    lanes, found, place, trace, work = (
        frame.lanes,
        False,
        7 * TRACE * frame.lanes,
        memory(frame.trace, frame.real),
        memory(frame.work, 1.0),
    )
    for k in range(lanes):
        if work[EACH * lanes + k] <= float(now):
            found = True
            for i in range(START + frame.works):
                at = (i if i < START else frame.works_at + i - START) * lanes + k
                if out != 0:
                    trace[place + i * lanes + k] = state[at]
                else:
                    state[at] = trace[place + i * lanes + k]
    return found


def save(frame, low, now):
    """Write what is saved of some members at a step."""
    if frame.columns != 0 and frame.values != 0:
        lanes, out, work = frame.lanes, memory(frame.out, 1.0), memory(frame.work, 1.0)
        saved, order = memory(frame.saved, 1.0), memory(frame.order, frame.lanes)
        slot = (
            (frame.total + frame.stride - 1) // frame.stride
            if now == frame.total
            else now // frame.stride
        )
        base, t = slot * frame.values * frame.columns + frame.column, now // frame.slots * frame.h
        own = frame.own != 0
        past = 0 if own else frame.past
        call(
            frame.record,
            (
                work,
                saved if own else out,
                0 if own else base + low,
                lanes if own else frame.columns,
                t,
                past,
            ),
        )
        for i in range(frame.values if own else 0):
            for k in range(lanes):
                out[base + i * frame.columns + order[low + k]] = saved[i * lanes + k]


def leave(frame, low):
    """Put the rows of some members back; at the end of the run with the last good state, and with the times of events."""
    done = 1 if frame.last == frame.total else 0
    if frame.shadow != 0:
        swap(frame, 1)
    if done != 0 and frame.records > 0:
        find(frame)
    works_at, state = BODY + frame.works_at - BODY_AT, memory(frame.state, frame.real)
    block, work = memory(frame.block, 1.0), memory(frame.work, 1.0)
    call(
        frame.leave, (block, frame.rows, frame.width, low, frame.works, works_at, done, state, work)
    )


def find(frame):
    """The times of the first and last of each event, by steps back from where it was seen."""
    lanes, state, near = (
        frame.lanes,
        memory(frame.state, frame.real),
        memory(frame.near, frame.real),
    )
    parts, work, aside = memory(frame.parts, 1.0), memory(frame.work, 1.0), memory(frame.aside, 1.0)
    for i in range(KNOWN * lanes):
        aside[i] = work[i]
    for i in range((BODY_AT + frame.rows - BODY) * lanes):
        near[i] = state[i]
    for which in range(frame.records):
        seen = 0.0
        for k in range(lanes):
            seen += abs(state[(frame.watched + which // 2 * EVENT + COUNT) * lanes + k])
        tries = frame.tries if seen > 0.0 else 0
        for tried in range(tries + 1):
            call(frame.seek, (parts, state, work, near, aside, frame.watched, which, tried))
            if tried < tries:
                march(frame, near, aside, 0, 0, 0, 1)


for _function in (
    enter,
    begin,
    look,
    swap,
    ending,
    steps,
    march,
    most_steps,
    some_end,
    put_aside,
    save,
    leave,
    find,
):
    inline(_function)
