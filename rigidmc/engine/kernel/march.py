"""The steps of members: their state goes from rows to registers, and back after the last step.

`march` is the kernel in which nearly all time is spent, and the only one without code for saves or
monitors; the other kernels are in `rigidmc.engine.kernel.member`. The members in a vector may be
divided into groups, whose steps are made one group after the other: while one group waits for a
result, the CPU works on another. A tuple has one element for each group, and the functions recurse
over it, so compiled code has no loop and no index of groups.
"""

import sys
from typing import Any, NamedTuple

import numpy as np

from rigidmc.engine.compiler.compose import inline_all
from rigidmc.engine.compiler.intrinsics import cast_like, in_precision
from rigidmc.engine.compiler.memory import group_of, of_body, of_effects, put_rows, without_tangents
from rigidmc.engine.compiler.trees import (
    noise_of,
    tree_size,
    tree_unflatten,
    tree_unpack,
    with_noise,
)
from rigidmc.engine.kernel import layout
from rigidmc.engine.kernel.member import next_attitude
from rigidmc.engine.kernel.noise import normal_deviates
from rigidmc.physics.dynamics.functions import as_word
from rigidmc.physics.dynamics.so3 import concat, first_three, taken, value_of
from rigidmc.physics.effects.present import in_memory, states_of
from rigidmc.physics.integrators.protocol import precompute, step


def march(
    tree, numbers, substeps, count, state, work, trace, traced, key, second_key, streams, rounds,
    first, last,
):  # fmt: skip
    """Make the steps from `first` to `last` of a round, each of `count` - 1 substeps.

    trace, traced : target of the state at the start and after each step, `layout.traced` rows each,
        unless traced is 0
    key, second_key, streams : the two words of the seed, and the stream of each random effect
    rounds : the number of the round; with the number of the step it makes each step's noise unique
    """
    parts = tree_unpack(tree, numbers)
    integrator, effects, attitude, compensated, work_flags, groups, several, paired = parts
    extra = layout.extra_flags(integrator, effects, work_flags)
    row = layout.extra_row(integrator, effects)
    states = load_groups(groups, groups, 0, compensated, extra, row, state)
    known = integrator, effects, work_flags
    fixed = make_constants(known, substeps, states, groups, 0, state, work)
    the_substep = substep_at(1, substeps)
    if traced != 0:
        trace_groups(groups, groups, 0, effects, states, trace, 0)
    for s in range(first, last):
        # Steps of a round count from 0: for members with their own steps, counts in the rounds
        # before differ.
        number = (np.uint64(rounds) << np.uint64(32)) | np.uint64(s)
        drawn = draw_groups(fixed, (key, second_key), number, streams, paired)
        for i in range(1, row_count(several, count)):
            fractions, when = read_substep(several, the_substep, i, substeps)
            states = step_groups(integrator, attitude, drawn, s + when, fractions, states)
        if traced != 0:
            target = layout.traced(effects) * (s - first + 1)
            trace_groups(groups, groups, 0, effects, states, trace, target)
    store_groups(groups, groups, 0, states, compensated, row, state)
    return 0


def row_count(several, rows):
    """Return `rows`, the rows of a StepScheme, or the constant 2 if a step has one substep.

    Row 0 opens, and row 1 is that substep. With the constant the loop over substeps vanishes, and
    the state stays in registers: 6 % of a step of rk4 without effects.
    """
    if len(several) == 0:
        return 2
    return rows


def substep_at(i, substeps):
    """Return (fractions, when) of substep i: its times and the time of its torque, in steps."""
    return (substeps[4 * i], substeps[4 * i + 1], substeps[4 * i + 2]), substeps[4 * i + 3]


def read_substep(several, the_substep, i, substeps):
    """Return (fractions, when) of substep i; of a single one, `the_substep`, read before the loop.

    In the loop it would be reread after each write to the trace: LLVM cannot know that the trace
    does not overlap it.
    """
    if len(several) == 0:
        return the_substep
    return substep_at(i, substeps)


class StepConstants(NamedTuple):
    """Constants of a group of members through the steps of a call.

    round_start, length : when the round began, and the length of a step [s]
    h : the length in the precision of the run
    index : the bits of the members' index
    constants : precomputed by the integrator
    """

    body: Any
    effects: Any
    round_start: Any
    length: Any
    h: Any
    index: Any
    constants: Any


def make_constants(known, substeps, states, groups, i, state, work):
    """Return the StepConstants of each group; known : integrator, effects, work flags."""
    if len(states) == 0:
        return ()
    integrator, effects, work_flags = known
    rows, member = group_of(state, groups, i), without_tangents(group_of(work, groups, i))
    length, began = member[layout.STEP_LENGTH], member[layout.ROUND_START]
    body, h = layout.body_at(of_body(rows), layout.BODY_AT), cast_like(length, rows)
    substep = substeps[4] * h, substeps[5] * h, substeps[6] * h
    precomputed = precompute(integrator, body, substep, states[0][1])
    given = tree_unflatten(effects, of_effects(rows), layout.EFFECTS_AT)
    row = layout.EFFECTS_AT + tree_size(effects)
    present = in_memory(given, layout.memories_at(effects, work_flags, rows, row))
    first = StepConstants(body, present, began, length, h, member[layout.INDEX], precomputed)
    rest = make_constants(known, substeps, states[1:], groups, i + 1, state, work)
    return (first,) + rest


def load_groups(left, groups, i, compensated, extra, row, state):
    """Return (q, L) of each group, from the rows of the state; `left` counts the groups to come."""
    if len(left) == 0:
        return ()
    first = layout.state_at(group_of(state, groups, i), compensated, extra, row)
    return (first,) + load_groups(left[1:], groups, i + 1, compensated, extra, row, state)


def draw_groups(fixed, key, number, streams, paired):
    """Return the StepConstants of each group, with the deviates of a step in the random effects.

    paired : ON if a step has the noise of two steps of half its length
    """
    if len(fixed) == 0:
        return ()
    body, effects, began, length, h, index, precomputed = fixed[0]
    drawn = with_deviates(effects, key, index, number, streams, 0, h, paired)
    first = StepConstants(body, drawn, began, length, h, index, precomputed)
    return (first,) + draw_groups(fixed[1:], key, number, streams, paired)


def step_groups(integrator, attitude, fixed, when, fractions, states):
    """Return (q, L) of each group after a substep.

    when : the time of the torque, in steps
    fractions : the times of the substep, in steps
    """
    if len(fixed) == 0:
        return ()
    group, (q, l), length, h = fixed[0], states[0], fixed[0].length, fixed[0].h
    # In float64, then rounded once: a float32 time of 1e5 s would have no digits for a step.
    drift, kick, gradient = fractions
    drift, kick = cast_like(drift * length, h), cast_like(kick * length, h)
    substep = drift, kick, cast_like(gradient * length, h)
    t = cast_like(group.round_start + when * length, h)
    body, effects = group.body, group.effects
    new_q, l = step(integrator, body, effects, t, h, substep, q, l, group.constants)
    rest = step_groups(integrator, attitude, fixed[1:], when, fractions, states[1:])
    return ((next_attitude(attitude, new_q, q), l),) + rest


def trace_groups(left, groups, i, effects, states, trace, row):
    """Write the states of all groups to the trace."""
    if len(left) == 0:
        return 0
    q, l = value_of(states[0][0]), value_of(states[0][1])
    moved = concat(first_three(l), taken(states_of(effects), l[3:]))
    put_rows(q + moved, group_of(trace, groups, i), row)
    return trace_groups(left[1:], groups, i + 1, effects, states[1:], trace, row)


def store_groups(left, groups, i, states, compensated, row, state):
    """Write the states of all groups to their rows."""
    if len(left) == 0:
        return 0
    layout.put_state(states[0][0], states[0][1], group_of(state, groups, i), compensated, row)
    return store_groups(left[1:], groups, i + 1, states[1:], compensated, row, state)


def with_deviates(effects, key, member, number, streams, i, state, paired):
    """Return the effects, with the deviates of a member for a step in the random ones.

    The deviates are a function of (seed, stream, member, step) and of nothing else.
    """
    if len(effects) == 0:
        return ()
    if len(noise_of(effects[0])) == 0:
        others = with_deviates(effects[1:], key, member, number, streams, i, state, paired)
        return effects[:1] + others
    others = with_deviates(effects[1:], key, member, number, streams, i + 1, state, paired)
    three = normal_deviates(paired, key, as_word(member), number, streams[i])
    return (with_noise(effects[0], in_precision(three, state)),) + others


inline_all(sys.modules[__name__])
