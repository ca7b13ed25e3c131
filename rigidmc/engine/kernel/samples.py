"""Samples: effects with a memory read the state at given times, and write their memory.

All effects that sample at one time read the numbers before it, and are then written together, so
their order does not matter. The motion goes on in the same state; in the stepping form of a
splitting, which holds part of a kick, the part by the old memory is taken back.
"""

import sys

import numpy as np

from rigidmc.engine.compiler.compose import inline_all
from rigidmc.engine.compiler.intrinsics import cast_like, in_precision
from rigidmc.engine.compiler.memory import put_rows, tuple_at, without_tangents
from rigidmc.engine.compiler.trees import tree_size, tree_unpack
from rigidmc.engine.kernel import layout
from rigidmc.engine.kernel.last_interval import clear_remainders
from rigidmc.engine.kernel.member import state_in_double
from rigidmc.engine.kernel.noise import normal_deviates
from rigidmc.physics.dynamics.functions import as_word
from rigidmc.physics.dynamics.methods import OFF
from rigidmc.physics.dynamics.so3 import concat, first_three, select_all
from rigidmc.physics.effects.present import in_memory, in_state, memories_of
from rigidmc.physics.effects.protocol import sample
from rigidmc.physics.integrators.protocol import from_stepping, to_stepping


def take_samples(
    tree, numbers, substeps, state, work, slot, cuts, place, key, second_key, streams
):  # fmt: skip
    """Let effects sample after `slot` steps of a round.

    cuts, place : from cuts[place] on the time [s], then for each effect with a memory the number of
        its sample, -1 if it does not sample now
    key, second_key, streams : the two words of the seed, and the stream of each of these effects
    """
    integrator, effects, compensated, work_flags, first_stream = tree_unpack(tree, numbers)
    body, given = layout.body_and_effects(effects, work)
    row_after, row = layout.EFFECTS_AT + tree_size(effects), layout.extra_row(integrator, effects)
    old = in_precision(layout.memories_at(effects, work_flags, state, row_after), work)
    present, times = in_memory(given, old), without_tangents(work)
    q, l = state_in_double(state, work, compensated)
    extra = tuple_at(layout.extra_flags(integrator, effects, work_flags), state, row)
    l = concat(l, in_precision(extra, work))
    h = times[layout.STEP_LENGTH]
    t, substep = (
        times[layout.ROUND_START] + (slot + substeps[3]) * h,
        layout.opening_substep(substeps, h),
    )
    q, l = from_stepping(integrator, body, present, t, substep, q, l)
    noise = (key, second_key), as_word(times[layout.INDEX]), streams
    at = cast_like(cuts[place], work)
    seen = in_state(present, l[3:])
    new = sample_each(
        seen, body, at, q, first_three(l), noise, cuts, place + 1, len(first_stream), work
    )
    # a frozen member stays as it was when it was last ok
    moves = (layout.member_rows(work)[layout.STATUS] == 0.0) & (work[layout.IS_STOPPED] <= 0.0)
    new = select_all(moves, new, old)
    put_rows(in_precision(new, state), state, row_after + len(layout.moving(effects, work_flags)))
    q, l = to_stepping(integrator, body, in_memory(given, new), t, substep, q, l)
    put_rows(in_precision(q + first_three(l), state), state, layout.ATTITUDE)
    put_rows(in_precision(l[3:], state), state, row)
    clear_remainders(compensated, state)
    return 0


def sample_each(effects, body, t, q, l, noise, cuts, place, stream, work):
    """Return the memories of all effects after the samples.

    noise : key, index of the member, streams;  stream : of the first of these effects
    """
    if len(effects) == 0:
        return ()
    old = memories_of(effects[:1])
    first = sampled(effects[0], old, body, t, q, l, noise, cuts[place], stream, work)
    own = 1 if len(old) > 0 else 0
    others = sample_each(effects[1:], body, t, q, l, noise, cuts, place + own, stream + own, work)
    return concat(first, others)


def sampled(effect, old, body, t, q, l, noise, number, stream, work):
    """Return the memory of an effect after its sample of this number, `old` if it is below 0."""
    key, member, streams = noise
    word = np.uint64(2.0 * max(number, 0.0))
    # two triples of deviates; those that `sample` does not read are not computed
    one = normal_deviates(OFF, key, member, word, streams[stream])
    two = normal_deviates(OFF, key, member, word + np.uint64(1), streams[stream])
    new = cast_each(sample(effect, body, t, q, l, one + two), work)
    return select_all(number < 0.0, old, new)


def cast_each(values, rows):
    """Return numbers with the type of the numbers in rows."""
    if len(values) == 0:
        return ()
    return (cast_like(values[0], rows),) + cast_each(values[1:], rows)


inline_all(sys.modules[__name__])
