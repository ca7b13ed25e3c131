"""A block of members on one thread of the processor: some at a time, side by side, live the life of `rigidmc.engine.member`.

`advance` is compiled once for all scenes: it knows the pieces of a program by their addresses, and how many numbers lie side by side as a number.
"""

from typing import Any, NamedTuple

import numpy as np

from rigidmc.engine.compose import inline
from rigidmc.engine.entries import Compiled
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
from rigidmc.engine.numbers import as_float, memory
from rigidmc.engine.pieces import Piece, call
from rigidmc.engine.watch import OFTEN

LOOK = 32  # steps between two looks at drift and health: a look each step costs 20 to 25 % of rk4, every 16th up to 5 %


class Pieces(NamedTuple):
    """The compiled pieces of a program, see `rigidmc.engine.member` and `rigidmc.engine.watch`; NOTHING where a scene has no use for one."""

    enter: Piece
    leave: Piece
    begin: Piece
    march: Piece
    look: Piece
    record: Piece
    begin_watch: Piece
    watch: Piece
    seek: Piece
    begin_near: Piece
    meet: Piece


class Shape(NamedTuple):
    """How the members of a program lie in memory, and what they have.

    lanes : how many are worked on side by side;  values : numbers of a save;  works : effects whose work is kept, whose rows begin at `works_at` of a state
    watched : the row of a state from which on things are watched;  looks, near, records : whether steps are watched, there is a neighbour, and how many
        records of events there are;  tries : steps back to find an event;  noisy : whether effects are random
    """

    lanes: int
    values: int
    works_at: int
    works: int
    watched: int
    near_at: int
    looks: int
    near: int
    records: int
    tries: int
    noisy: int


class Run(NamedTuple):
    """From which step to which, of how many, and when to save: in rounds of `slots` steps of which a member makes its own, where `own` is 1.

    h : the step, with own steps the length of a round;  stride : steps between saves; step `total` is always saved
    """

    h: float
    slots: int
    stride: int
    total: int
    own: int
    first: int
    last: int


class Noise(NamedTuple):
    """Two words of the seed, the stream of each random effect, and the index of the block's first member."""

    key: int
    other: int
    streams: np.ndarray
    member: int


class Saves(NamedTuple):
    """Where saves go: value row r of save slot s of member m to out[(s*R + r)*width + column + m], R = value rows in all; the members of a block
    that are not in their order are at column + order[m]."""

    out: np.ndarray
    width: int
    column: int
    order: np.ndarray


class Room(NamedTuple):
    """Where everything is in memory: the parts of a step and how many rows they have, a block and its size, two states, what is known of members, the states
    after steps, a save, the streams of noise, where saves go, the order of the members; and whose noise it is."""

    parts: Any
    count: int
    block: Any
    rows: int
    members: int
    state: Any
    near: Any
    work: Any
    trace: Any
    values: Any
    streams: Any
    out: Any
    order: Any
    key: int
    other: int
    member: int


def advance(pieces, shape, run, noise, saves, parts, block, state, near, work, trace, values):
    """Take every member of a block from step run.first to step run.last.

    block : (rows, n) as in `rigidmc.engine.layout`, changed in place; n a multiple of LANES. Between calls it holds the state as the integrator keeps it
        between steps, after step `total` the true one
    state, near : two states;  work : what is known of members;  trace : room for the states after LOOK steps, and one;  values : room for a save
    """
    room = Room(
        memory(parts), parts.size // 4, memory(block), block.shape[0], block.shape[1], memory(state), memory(near), memory(work), memory(trace),
        memory(values), memory(noise.streams), memory(saves.out), memory(saves.order), noise.key, noise.other, noise.member,
    )  # fmt: skip
    for low in range(0, room.members, shape.lanes):
        enter(pieces, shape, run, room, low)
        if run.first == 0:
            begin(pieces, shape, run, saves, room, low)
        elif shape.near != 0:
            swap(shape, room, 0)
        now, idle = run.first, False
        while now < run.last:
            begun = now // run.slots * run.slots if run.own != 0 else 0  # of the round; without own steps there is one
            stop = ending(run, now, begun)
            if run.own != 0 and now == begun:
                for k in range(shape.lanes):
                    room.work[BEGAN * shape.lanes + k] = begun // run.slots * run.h
            if not idle:
                steps(pieces, shape, run, room, begun, now - begun, stop - begun)
            now, slot = stop, stop - begun
            saved = now == run.total or now % run.stride == 0
            if saved or (
                slot % LOOK == 0 and (run.own == 0 or slot < run.slots)
            ):  # not where a call ends: no result depends on calls
                rounds = begun // run.slots * 1.0 if run.own != 0 else 0.0
                call(pieces.look, (room.parts, room.state, room.work, rounds, slot * 1.0))
                idle = is_idle(shape, room)
            if saved:
                save(pieces, shape, run, saves, room, low, now)
        leave(pieces, shape, run, room, low)
    return 0


def enter(pieces, shape, run, room, low):
    """Bring the rows of some members side by side."""
    time = run.first // run.slots * run.h if run.own != 0 else 0.0
    call(pieces.enter, (room.block, room.rows, room.members, low, run.own, run.h, time, room.state, room.work))
    for k in range(shape.lanes if shape.noisy != 0 else 0):
        place = room.order[low + k] if run.own != 0 else low + k
        room.work[INDEX * shape.lanes + k] = as_float(np.uint64(room.member + place + 1))


def begin(pieces, shape, run, saves, room, low):
    """The start of some members."""
    call(pieces.begin, (room.parts, room.state, room.work))
    if shape.looks != 0:
        call(pieces.begin_watch, (room.parts, room.state, room.work, shape.watched))
    if shape.near != 0:
        swap(shape, room, 0)
        call(pieces.begin_near, (room.parts, room.state, room.work, room.near, shape.near_at))
    save(pieces, shape, run, saves, room, low, 0)


def swap(shape, room, out):
    """Bring back the neighbour of members that begin in the middle of a run, or put it to their rows."""
    lanes, at = shape.lanes, shape.near_at * shape.lanes
    for i in range((BODY_AT + room.rows - BODY) * lanes if out == 0 else 0):
        room.near[i] = room.state[i]
    for i in range(START * lanes):
        if out == 0:
            room.near[i] = room.state[at + i]
        else:
            room.state[at + i] = room.near[i]


def ending(run, now, begun):
    """The step at which members are looked at next, saved, or left."""
    stop = min(run.last, begun + ((now - begun) // LOOK + 1) * LOOK, (now // run.stride + 1) * run.stride)
    return min(stop, begun + run.slots) if run.own != 0 else stop


def steps(pieces, shape, run, room, begun, first, last):
    """Steps from `first` to `last` of the round that began with step `begun`, watched where that is asked for."""
    rounds, now = begun // run.slots if run.own != 0 else 0, first
    if run.own != 0:
        last = most_steps(shape, room, last)
    while now < last:
        stop = last
        if shape.near != 0:
            stop = min(last, (begun + now) // OFTEN * OFTEN + OFTEN - begun)
        if run.own != 0:
            stop = some_end(shape, room, now, stop)
        march(pieces, shape, run, room, room.state, shape.looks, rounds, now, stop)
        if shape.near != 0:
            march(pieces, shape, run, room, room.near, 0, rounds, now, stop)
            if (begun + stop) % OFTEN == 0:
                number = (begun + stop) // OFTEN * 1.0
                call(pieces.meet, (room.parts, room.state, room.work, room.near, shape.near_at, stop * 1.0, number))
        if shape.looks != 0:
            call(pieces.watch, (room.parts, room.state, room.work, room.trace, shape.watched, now, stop))
        now = stop


def march(pieces, shape, run, room, state, traced, rounds, now, stop):
    """Steps that all members make that are not done with theirs; the others stay as they are."""
    idle = run.own != 0 and put_aside(shape, room, state, now, 1)
    call(
        pieces.march,
        (room.parts, room.count, state, room.work, room.trace, traced, room.key, room.other, room.streams, rounds, now, stop),
    )
    if idle:
        put_aside(shape, room, state, now, 0)


def most_steps(shape, room, last):
    """How many steps of a round the member makes that makes most, up to `last`."""
    most = 0.0
    for k in range(shape.lanes):
        most = max(most, room.work[EACH * shape.lanes + k])
    return int(min(most, float(last)))


def some_end(shape, room, now, stop):
    """The step at which the first of the members that still move has made all of its own."""
    for k in range(shape.lanes):
        each = room.work[EACH * shape.lanes + k]
        if float(now) < each and each < float(stop):
            stop = int(each)
    return stop


def put_aside(shape, room, state, now, out):
    """Put the states of members that have made all of their steps aside, or bring them back; whether there are any."""
    lanes, found, place = shape.lanes, False, 7 * LOOK * shape.lanes
    for k in range(lanes):
        if room.work[EACH * lanes + k] <= float(now):
            found = True
            for i in range(START + shape.works):
                at = (i if i < START else shape.works_at + i - START) * lanes + k
                if out != 0:
                    room.trace[place + i * lanes + k] = state[at]
                else:
                    state[at] = room.trace[place + i * lanes + k]
    return found


def is_idle(shape, room):
    """Whether all members are stopped, or stay as they are for good."""
    for k in range(shape.lanes):
        if room.work[(KNOWN + STATUS) * shape.lanes + k] == 0.0 and room.work[STOPPED * shape.lanes + k] == 0.0:
            return False
    return True


def save(pieces, shape, run, saves, room, low, now):
    """Write what is saved of some members at a step."""
    if saves.width == 0 or shape.values == 0:
        return
    slot = (run.total + run.stride - 1) // run.stride if now == run.total else now // run.stride
    base, t = slot * shape.values * saves.width + saves.column, now // run.slots * run.h
    if run.own == 0:
        call(pieces.record, (room.work, room.out, base + low, saves.width, t))
        return
    call(pieces.record, (room.work, room.values, 0, shape.lanes, t))
    for i in range(shape.values):
        for k in range(shape.lanes):
            room.out[base + i * saves.width + room.order[low + k]] = room.values[i * shape.lanes + k]


def leave(pieces, shape, run, room, low):
    """Put the rows of some members back; at the end of the run with the last good state, and with the times of events."""
    done = 1 if run.last == run.total else 0
    if shape.near != 0:
        swap(shape, room, 1)
    if done != 0 and shape.records > 0:
        find(pieces, shape, room)
    works_at = BODY + shape.works_at - BODY_AT
    call(pieces.leave, (room.block, room.rows, room.members, low, shape.works, works_at, done, room.state, room.work))


def find(pieces, shape, room):
    """The times of the first and last of each event, by steps back from where it was seen."""
    lanes = shape.lanes
    aside = np.empty(KNOWN * lanes)
    for i in range(KNOWN * lanes):
        aside[i] = room.work[i]
    for i in range((BODY_AT + room.rows - BODY) * lanes):
        room.near[i] = room.state[i]
    for which in range(shape.records):
        seen = 0.0
        for k in range(lanes):
            seen += abs(room.state[(shape.watched + which // 2 * EVENT + COUNT) * lanes + k])
        tries = shape.tries if seen > 0.0 else 0
        for tried in range(tries + 1):
            call(pieces.seek, (room.parts, room.state, room.work, room.near, memory(aside), shape.watched, which, tried))
            if tried < tries:
                call(
                    pieces.march,
                    (room.parts, room.count, room.near, memory(aside), room.trace, 0, room.key, room.other, room.streams, 0, 0, 1),
                )


for _function in (enter, begin, swap, ending, steps, march, most_steps, some_end, put_aside, is_idle, save, leave, find):
    inline(_function)
compiled = Compiled(advance)
