"""Steps of another length: in a last interval that is shorter than the others, and in the parts of
a step that effects cut.

The count of steps goes on; only the rows STEP_LENGTH and ROUND_START change, between two steps. Two
things depend on the length and change with it: the state, if an integrator keeps it one substep
further on, and sums over steps, which are means over time only if each step counts by its length.
The kernels are like the kernels of `rigidmc.engine.kernel.member`.
"""

import sys

from rigidmc.engine.compiler.compose import inline_all
from rigidmc.engine.compiler.intrinsics import cast_like, in_precision
from rigidmc.engine.compiler.memory import put_rows, tuple_at, without_tangents
from rigidmc.engine.compiler.trees import tree_size, tree_unpack
from rigidmc.engine.kernel import layout
from rigidmc.engine.kernel.member import state_in_double
from rigidmc.engine.kernel.running import put_states, states_at
from rigidmc.physics.dynamics.so3 import concat, first_three
from rigidmc.physics.effects.present import in_memory
from rigidmc.physics.integrators.protocol import from_stepping, to_stepping
from rigidmc.physics.observables.compiled import reweighed


def change_length(
    tree, numbers, substeps, state, work, slot, new_slot, round_start, h, member_steps
):
    """Convert a state after `slot` steps to stepping form for steps of another length.

    new_slot : steps of that length since `round_start` until now
    round_start, h, member_steps : as in `rigidmc.engine.kernel.member.gather`, for these steps
    """
    integrator, effects, compensated, work_flags = tree_unpack(tree, numbers)
    body, given = layout.body_and_effects(effects, work)
    row = layout.EFFECTS_AT + tree_size(effects)
    memories = in_precision(layout.memories_at(effects, work_flags, state, row), work)
    present = in_memory(given, memories)
    row = layout.extra_row(integrator, effects)
    q, l = state_in_double(state, work, compensated)
    extra = tuple_at(layout.extra_flags(integrator, effects, work_flags), state, row)
    l = concat(l, in_precision(extra, work))
    times = without_tangents(work)
    old_h, steps_done = times[layout.STEP_LENGTH], min(times[layout.MEMBER_STEPS], slot)
    t = times[layout.ROUND_START] + (steps_done + substeps[3]) * old_h
    opening = layout.opening_substep(substeps, old_h)
    q, l = from_stepping(integrator, body, present, t, opening, q, l)
    new_h = member_length(times, h, member_steps)
    first_step = min(times[layout.MEMBER_STEPS], new_slot)
    # The opening substep is undone with the old length and redone with the new one.
    t = cast_like(round_start, times) + (first_step + substeps[3]) * new_h
    q, l = to_stepping(integrator, body, present, t, layout.opening_substep(substeps, new_h), q, l)
    put_rows(in_precision(q + first_three(l), state), state, layout.ATTITUDE)
    put_rows(in_precision(l[3:], state), state, row)
    clear_remainders(compensated, state)
    return 0


def clear_remainders(compensated, state):
    """Set the remainders of sums to 0, if any: `state_in_double` has added them."""
    if len(compensated) > 0:
        put_rows((0.0,) * 7, state, layout.EXTRA)
    return 0


def member_length(work, h, member_steps):
    """Return the length of a member's step: h, or its fraction of a round of length h."""
    return h / work[layout.MEMBER_STEPS] if member_steps != 0 else cast_like(h, work)


def reweigh(tree, numbers, work, row, longer):
    """Count each step so far as `longer` steps of the last interval in all sums over steps."""
    effects, events, running = tree_unpack(tree, numbers)
    row = layout.running_row(row, events, effects)
    put_states(reweigh_states(running, states_at(running, work, row), longer), work, row)
    return 0


def reweigh_states(running, totals, longer):
    """Return the states of running observables after `reweigh`."""
    if len(running) == 0:
        return ()
    first = reweighed(running[0][0], totals[0], longer)
    return (first,) + reweigh_states(running[1:], totals[1:], longer)


inline_all(sys.modules[__name__])
