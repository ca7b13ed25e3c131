"""The steps of one member, or of a group of members side by side: the state goes from its rows to registers, and back after the last.

A piece like those of `rigidmc.engine.member`, and the one that knows neither what is saved nor what is watched.
"""

from typing import Any, NamedTuple

import numpy as np

from rigidmc.dynamics.so3 import first_three, whole
from rigidmc.engine.compose import filled, given, has_noise, inline, rows_of, with_noise
from rigidmc.engine.layout import (
    BEGAN,
    BODY_AT,
    EFFECTS_AT,
    INDEX,
    LENGTH,
    body_at,
    more_of,
    more_row,
    put_state,
    state_at,
)
from rigidmc.engine.member import carried
from rigidmc.engine.memory import put, stream
from rigidmc.engine.noise import normals, philox
from rigidmc.engine.numbers import as_word, in_precision, like
from rigidmc.integrators.protocol import constants, keeps, step


def march(
    kinds,
    numbers,
    parts,
    count,
    state,
    work,
    trace,
    traced,
    key,
    other,
    streams,
    rounds,
    first,
    last,
):
    """Make the steps from `first` to `last` of a round, of `count` - 1 parts each.

    trace, traced : where the state after each step goes, seven rows a step, unless traced is 0
    key, other, streams, rounds : the two words of the seed, the stream of each random effect, and the number of the round, which no two steps share

    The members that are worked on side by side may be in groups, whose steps are made one after the other: while those of one wait for a result, a processor
    works on another's.
    """
    integrator, effects, attitude, compensated, ledger, groups = given(kinds, numbers)
    more, row = (
        more_of(keeps(integrator), ledger),
        more_row(keeps(integrator), EFFECTS_AT + rows_of(effects)),
    )
    moving = all_moving(groups, groups, 0, compensated, more, row, state)
    fixed = all_fixed(integrator, effects, parts, moving, groups, 0, state, work)
    for s in range(first, last):
        number = (np.uint64(rounds) << np.uint64(32)) | np.uint64(s)
        present = all_shaken(fixed, (key, other), number, streams)
        for p in range(1, count):
            at = 4 * p
            moving = all_stepped(
                integrator,
                attitude,
                present,
                s + parts[at + 3],
                (parts[at], parts[at + 1], parts[at + 2]),
                moving,
            )
        if traced != 0:
            all_traced(groups, groups, 0, moving, trace, 7 * (s - first))
    all_put(groups, groups, 0, moving, compensated, row, state)
    return 0


class Fixed(NamedTuple):
    """What a group of members takes through its steps: body, effects, when the round began, the length of a step, that in the precision of the run, the
    bits of the members' index, and what the integrator makes of a member once."""

    body: Any
    effects: Any
    began: Any
    length: Any
    h: Any
    index: Any
    constants: Any


def all_fixed(integrator, effects, parts, moving, groups, i, state, work):
    """What is Fixed of each group."""
    if len(moving) == 0:
        return ()
    mine, known = stream(state, groups, i), stream(work, groups, i)
    body, h = body_at(mine, BODY_AT), like(known[LENGTH], mine)
    found = constants(integrator, body, (parts[4] * h, parts[5] * h, parts[6] * h), moving[0][1])
    one = Fixed(
        body, filled(effects, mine, EFFECTS_AT), known[BEGAN], known[LENGTH], h, known[INDEX], found
    )
    return (one,) + all_fixed(integrator, effects, parts, moving[1:], groups, i + 1, state, work)


def all_moving(left, groups, i, compensated, more, row, state):
    """(q, L) of each group."""
    if len(left) == 0:
        return ()
    return (state_at(stream(state, groups, i), compensated, more, row),) + all_moving(
        left[1:], groups, i + 1, compensated, more, row, state
    )


def all_shaken(fixed, key, number, streams):
    """What is Fixed of each group, the random effects with the deviates of a step."""
    if len(fixed) == 0:
        return ()
    body, effects, began, length, h, index, found = fixed[0]
    one = Fixed(
        body, shaken(effects, key, index, number, streams, 0, h), began, length, h, index, found
    )
    return (one,) + all_shaken(fixed[1:], key, number, streams)


def all_stepped(integrator, attitude, fixed, when, shares, moving):
    """(q, L) of each group after a part of a step, whose torque is that of the time `when`, in steps; shares: its times in steps."""
    if len(fixed) == 0:
        return ()
    one, (q, l), length, h = fixed[0], moving[0], fixed[0].length, fixed[0].h
    part = like(shares[0] * length, h), like(shares[1] * length, h), like(shares[2] * length, h)
    moved, l = step(
        integrator,
        one.body,
        one.effects,
        like(one.began + when * length, h),
        h,
        part,
        q,
        l,
        one.constants,
    )
    rest = all_stepped(integrator, attitude, fixed[1:], when, shares, moving[1:])
    return ((carried(attitude, moved, q), l),) + rest


def all_traced(left, groups, i, moving, trace, row):
    """Write the states of all groups to the trace."""
    if len(left) == 0:
        return 0
    put(whole(moving[0][0]) + first_three(whole(moving[0][1])), stream(trace, groups, i), row)
    return all_traced(left[1:], groups, i + 1, moving[1:], trace, row)


def all_put(left, groups, i, moving, compensated, row, state):
    """Write the states of all groups to their rows."""
    if len(left) == 0:
        return 0
    put_state(moving[0][0], moving[0][1], stream(state, groups, i), compensated, row)
    return all_put(left[1:], groups, i + 1, moving[1:], compensated, row, state)


def shaken(effects, key, member, number, streams, i, state):
    """The effects, the random ones with the deviates of a member for a step: a function of (seed, stream, member, step) and of nothing else."""
    if len(effects) == 0:
        return ()
    if has_noise(effects[0]):
        deviates = normals(philox(key, (as_word(member), number, streams[i], np.uint64(1))))
        first = with_noise(effects[0], in_precision(deviates, state))
        return (first,) + shaken(effects[1:], key, member, number, streams, i + 1, state)
    return (effects[0],) + shaken(effects[1:], key, member, number, streams, i, state)


for _function in (all_fixed, all_moving, all_shaken, all_stepped, all_traced, all_put, shaken):
    inline(_function)
