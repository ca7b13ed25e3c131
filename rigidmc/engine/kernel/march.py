"""The steps of a member: its state goes from rows to registers, and back after the last step.

A piece like those of `rigidmc.engine.kernel.member`, and the only one that knows neither what is
saved nor what is watched. The members that are worked on side by side may be in groups, whose steps
are made one after the other: while those of one group wait for a result, a processor works on
another's.
"""

import sys
from typing import Any, NamedTuple

import numpy as np

from rigidmc.engine.compiler.compose import inline_all
from rigidmc.engine.compiler.intrinsics import in_precision, like
from rigidmc.engine.compiler.memory import put, stream
from rigidmc.engine.compiler.trees import filled, noise_of, parts_of, row_count, with_noise
from rigidmc.engine.kernel.layout import (  # fmt: skip
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
from rigidmc.engine.kernel.member import carried
from rigidmc.engine.kernel.noise import deviates
from rigidmc.physics.dynamics.functions import as_word
from rigidmc.physics.dynamics.so3 import first_three, whole
from rigidmc.physics.integrators.protocol import constants, keeps, step


def march(
    kinds, numbers, parts, count, state, work, trace, traced, key, other, streams, rounds, first,
    last,
):  # fmt: skip
    """Make the steps from `first` to `last` of a round, of `count` - 1 parts each.

    trace, traced : where the state at the start and after each step goes, seven rows each, unless
        traced is 0
    key, other, streams : the two words of the seed, and the stream of each random effect
    rounds : the number of the round; with the number of the step it makes each step's noise its own
    """
    integrator, effects, attitude, compensated, ledger, groups, several, paired = parts_of(
        kinds, numbers
    )
    more = more_of(keeps(integrator), ledger)
    row = more_row(keeps(integrator), EFFECTS_AT + row_count(effects))
    moving = all_moving(groups, groups, 0, compensated, more, row, state)
    fixed = all_fixed(integrator, effects, parts, moving, groups, 0, state, work)
    only = part_at(1, parts)
    if traced != 0:
        all_traced(groups, groups, 0, moving, trace, 0)
    for s in range(first, last):
        number = (np.uint64(rounds) << np.uint64(32)) | np.uint64(s)
        present = all_shaken(fixed, (key, other), number, streams, paired)
        for p in range(1, end_of(several, count)):
            shares, when = part_of(several, only, p, parts)
            moving = all_stepped(integrator, attitude, present, s + when, shares, moving)
        if traced != 0:
            all_traced(groups, groups, 0, moving, trace, 7 * (s - first + 1))
    all_put(groups, groups, 0, moving, compensated, row, state)
    return 0


def end_of(several, count):
    """`count`, the rows of a Form, known to the compiler to be 2 if a step has one part.

    Without a loop over parts the state stays in registers: 6 % of a step of rk4 without effects.
    """
    if len(several) == 0:
        return 2
    return count


def part_at(p, parts):
    """(shares, when) of part p: its times and the time of its torque, in steps."""
    return (parts[4 * p], parts[4 * p + 1], parts[4 * p + 2]), parts[4 * p + 3]


def part_of(several, only, p, parts):
    """(shares, when) of part p. If a step has one part, `only` was read before the loop over steps:
    in the loop it is read again after each write to the trace, for all that the compiler knows.
    """
    if len(several) == 0:
        return only
    return part_at(p, parts)


class Fixed(NamedTuple):
    """What stays the same for a group of members through the steps of a call.

    began, length : when the round began, and the length of a step [s];  h : the same in the
        precision of the run
    index : the bits of the members' index;  constants : what the integrator computes once
    """

    body: Any
    effects: Any
    began: Any
    length: Any
    h: Any
    index: Any
    constants: Any


def all_fixed(integrator, effects, parts, moving, groups, i, state, work):
    """The Fixed of each group."""
    if len(moving) == 0:
        return ()
    rows, known = stream(state, groups, i), stream(work, groups, i)
    body, h = body_at(rows, BODY_AT), like(known[LENGTH], rows)
    once = constants(integrator, body, (parts[4] * h, parts[5] * h, parts[6] * h), moving[0][1])
    present = filled(effects, rows, EFFECTS_AT)
    first = Fixed(body, present, known[BEGAN], known[LENGTH], h, known[INDEX], once)
    return (first,) + all_fixed(integrator, effects, parts, moving[1:], groups, i + 1, state, work)


def all_moving(left, groups, i, compensated, more, row, state):
    """(q, L) of each group."""
    if len(left) == 0:
        return ()
    first = state_at(stream(state, groups, i), compensated, more, row)
    return (first,) + all_moving(left[1:], groups, i + 1, compensated, more, row, state)


def all_shaken(fixed, key, number, streams, paired):
    """The Fixed of each group, the random effects with the deviates of a step.

    paired : ON if a step has the noise of two steps of half its length
    """
    if len(fixed) == 0:
        return ()
    body, effects, began, length, h, index, once = fixed[0]
    present = shaken(effects, key, index, number, streams, 0, h, paired)
    first = Fixed(body, present, began, length, h, index, once)
    return (first,) + all_shaken(fixed[1:], key, number, streams, paired)


def all_stepped(integrator, attitude, fixed, when, shares, moving):
    """(q, L) of each group after a part of a step.

    when : the time of the torque, in steps;  shares : the times of the part, in steps
    """
    if len(fixed) == 0:
        return ()
    one, (q, l), length, h = fixed[0], moving[0], fixed[0].length, fixed[0].h
    part = like(shares[0] * length, h), like(shares[1] * length, h), like(shares[2] * length, h)
    t = like(one.began + when * length, h)
    moved, l = step(integrator, one.body, one.effects, t, h, part, q, l, one.constants)
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


def shaken(effects, key, member, number, streams, i, state, paired):
    """The effects, the random ones with the deviates of a member for a step.

    The deviates are a function of (seed, stream, member, step) and of nothing else.
    """
    if len(effects) == 0:
        return ()
    noise = noise_of(effects[0])
    first = renewed(effects[0], noise, key, member, number, streams, i, state, paired)
    i += len(noise) > 0
    return (first,) + shaken(effects[1:], key, member, number, streams, i, state, paired)


def renewed(effect, noise, key, member, number, streams, i, state, paired):
    """An effect with the deviates of a member for a step from stream i, as it is without noise.

    Numba knows the length of an argument before it compiles the rest of a function. What draws
    deviates takes long to compile, and effects without noise do not wait for it.
    """
    if len(noise) == 0:
        return effect
    three = deviates(paired, key, as_word(member), number, streams[i])
    return with_noise(effect, in_precision(three, state))


inline_all(sys.modules[__name__])
