"""The life of one member: gathered, initialised, assessed, saved, scattered.

Between two assessments the member makes steps (`rigidmc.engine.kernel.march`). These functions are
written for one number and compiled for vectors (`rigidmc.engine.compiler.vector_types`), so several
members go through them side by side; uncompiled they run on floats. `gather`, `scatter`,
`initialise`, `assess` and `record` are kernels: each is compiled by itself and called by
`rigidmc.engine.kernel.block` through its address, so another observable recompiles only `record`.

Arguments of all kernels:

tree, numbers : the types that the kernel is compiled for, and its numbers, see
    `rigidmc.engine.compiler.trees`
substeps : rows of a StepScheme (`rigidmc.physics.integrators.protocol`), one after the other
state, work : rows of the members, see `rigidmc.engine.kernel.layout`
"""

import math
import sys

from rigidmc.engine.compiler.compose import inline_all
from rigidmc.engine.compiler.intrinsics import any_of, cast_like, in_precision
from rigidmc.engine.compiler.memory import (
    four_at,
    load_lanes,
    put_rows,
    store_lanes,
    store_rows,
    three_at,
    tuple_at,
    without_tangents,
)
from rigidmc.engine.compiler.trees import tree_size, tree_unflatten, tree_unpack
from rigidmc.engine.kernel import layout
from rigidmc.physics.dynamics.euler import angular_velocity, kinetic_energy
from rigidmc.physics.dynamics.so3 import (
    add,
    add4,
    concat,
    dot,
    first_three,
    inverse,
    left_after,
    logical_not,
    maximum,
    scale,
    select,
    select_all,
    vertical,
)
from rigidmc.physics.effects.present import in_memory, in_state, memories_of, states_of
from rigidmc.physics.effects.sums import (
    corrected_by_work,
    has_untracked,
    total_abs_work,
    total_energy,
    total_energy_scale,
    untracked_work,
)
from rigidmc.physics.integrators.protocol import from_stepping, to_stepping
from rigidmc.physics.observables.compiled import observed

UNLIMITED = 1e300  # steps of a round, for members without their own number


def gather(tree, numbers, block, rows, members, low, member_steps, h, round_start, state, work):
    """Copy the rows of the members from `low` on from a block (rows, members) to `state` and
    `work`.

    member_steps : whether members have their own steps, which then divide a round of length h
    round_start : when the round began [s]
    """
    member = layout.member_rows(work)
    for row in range(rows):
        x = load_lanes(work, block, row * members + low)
        member[row] = x
        if row < layout.START:
            state[row] = cast_like(x, state)
        if row >= layout.BODY:
            state[layout.BODY_AT + row - layout.BODY] = cast_like(x, state)
    own = member_steps != 0
    place = layout.STEPS * members + low
    steps = load_lanes(work, block, place) if own else cast_like(UNLIMITED, work)
    # Without its own steps a member never finishes its round, so `march` needs no branch for it.
    work[layout.MEMBER_STEPS] = steps
    work[layout.STEP_LENGTH] = h / steps if own else cast_like(h, work)
    work[layout.ROUND_START] = cast_like(round_start, work)
    work[layout.IS_STOPPED] = cast_like(0.0, work)
    return 0


def scatter(tree, numbers, block, rows, members, low, trailing, row_after, done, state, work):
    """Copy the rows of the members from `low` on back to the block; finally the last good state.

    trailing : count of the numbers after L, in the rows from `row_after` of the block on, followed
        by the last good ones
    """
    member = layout.member_rows(work)
    for row in range(rows):
        place = row * members + low
        if row < layout.START:
            last = done != 0 and row < layout.EXTRA
            x = member[layout.GOOD_STATE + row] if last else cast_like(state[row], work)
            store_lanes(block, place, x)
        elif row < layout.BODY or row >= row_after + trailing:
            store_lanes(block, place, member[row])
        elif row >= row_after:
            now = cast_like(state[layout.BODY_AT + row - layout.BODY], work)
            store_lanes(block, place, member[row + trailing] if done != 0 else now)
    return 0


def initialise(tree, numbers, substeps, state, work):
    """Record energy and momentum of the start, classify it, and convert it to stepping form."""
    integrator, effects, limits, work_flags = tree_unpack(tree, numbers)
    body, given = layout.body_and_effects(effects, work)
    present = in_memory(given, memories_of(given))
    member, times = layout.member_rows(work), without_tangents(work)
    (q, l), h = layout.pose_at(member, layout.ATTITUDE), times[layout.STEP_LENGTH]
    kinetic, l2 = kinetic_energy(body, l), dot(l, l)
    energy = kinetic + total_energy(present, body, q)
    # a custom potential may state no bound
    energy_in_play = maximum(kinetic + total_energy_scale(present, body), abs(energy))
    # A total energy near 0, as for a pendulum on the separatrix, is not a scale: below 1e-3 of the
    # energies in play, a drift is relative to 1e-3 of these.
    energy_scale = maximum(abs(energy), 1e-3 * energy_in_play)
    # T >= L^2/(2 I) for the largest I: no energy in play allows a longer L
    max_l2 = 2.0 * energy_in_play / min(min(body.i1, body.i2), body.i3)
    start = energy, energy_scale, l2, energy_in_play, dot(vertical(q), l), max_l2
    put_rows(start, member, layout.START)
    # and MAX_KINETIC, the row after it
    put_rows((0.0 * kinetic, 0.0 * kinetic), member, layout.PLANNED_KINETIC)

    fault = classify_state(limits, member, work_flags, (), 0.0, body, q, l, h, energy, l2)
    status = select(member[layout.STATUS] == 0.0, fault, member[layout.STATUS])
    healthy = status == 0.0
    # nan marks unmeasured drifts, and inf the minimum of no drifts.
    drift, smallest = select(healthy, 0.0, math.nan), select(healthy, math.inf, math.nan)
    # also the last good step, 0, and the step of flagging: -1 if healthy, 0 for a bad start
    put_rows((drift, drift, status, 0.0, select(healthy, -1.0, 0.0)), member, layout.DRIFT)
    put_rows((drift, drift, smallest, smallest), member, layout.EARLY_DRIFT)
    put_rows(q + l, member, layout.GOOD_STATE)

    row, states, memories = (
        layout.EFFECTS + tree_size(effects),
        states_of(given),
        memories_of(given),
    )
    saved = tuple_at(work_flags, member, row + len(states))
    l, after = concat(l, concat(states, saved)), concat(concat(states, saved), memories)
    put_rows(after, member, row + len(after))
    row = layout.EFFECTS_AT + tree_size(effects) + len(states) + len(saved)
    put_rows(in_precision(memories, state), state, row)
    t, substep = times[layout.ROUND_START] + substeps[3] * h, layout.opening_substep(substeps, h)
    q, l = to_stepping(integrator, body, present, t, substep, q, l)
    put_rows(in_precision(q + first_three(l), state), state, layout.ATTITUDE)
    row = layout.extra_row(integrator, effects)
    put_rows(in_precision(l[3:], state), state, row)
    return 0


def assess(tree, numbers, substeps, state, work, rounds_done, slot, late, planned):
    """Assess the state after `slot` steps of a round, `rounds_done` of which are done.

    late : 1 in the second half of the run, else 0
    planned : 0 if only a save requested the assessment, else 1

    This updates the drifts and the status. A member that is no longer ok returns to its last good
    state and stays there. If works are saved, the drift of the energy is the excess over the work
    of effects without an energy.

    Return 0 if all members are stopped or frozen, else 1.
    """
    integrator, effects, attitude, compensated, limits, work_flags = tree_unpack(tree, numbers)
    body, given = layout.body_and_effects(effects, work)
    trailing, row_after = (
        layout.trailing(effects, work_flags),
        layout.EFFECTS_AT + tree_size(effects),
    )
    memories = in_precision(layout.memories_at(effects, work_flags, state, row_after), work)
    present = in_memory(given, memories)
    good_row = layout.EFFECTS + tree_size(effects) + len(trailing)
    member, times = layout.member_rows(work), without_tangents(work)
    # A member that has made its own steps waits for the slowest of its round: its time stands.
    h, steps_done = times[layout.STEP_LENGTH], min(times[layout.MEMBER_STEPS], slot)
    # In float64, whatever the precision of the steps: in float32 the energy itself is rounded by
    # 6e-8, more than the drifts to be seen.
    q, l = state_in_double(state, work, compensated)
    extra = layout.extra_flags(integrator, effects, work_flags)
    row = layout.extra_row(integrator, effects)
    l = concat(l, in_precision(tuple_at(extra, state, row), work))
    t = times[layout.ROUND_START] + (steps_done + substeps[3]) * h
    q, l = from_stepping(integrator, body, present, t, layout.opening_substep(substeps, h), q, l)
    # The lane of a stopped member goes on with the others: its state is that of its last step.
    after, stopped = concat(l[3:], memories), work[layout.IS_STOPPED] > 0.0
    works, present = left_after(states_of(effects), l[3:]), in_state(present, after)
    q = next_attitude(attitude, q, four_at(member, layout.GOOD_STATE))
    stopped_q, stopped_l = layout.pose_at(work, layout.STOPPED_STATE)
    q, l = select_all(stopped, stopped_q, q), select_all(stopped, stopped_l, first_three(l))
    energy, l2 = kinetic_energy(body, l) + total_energy(present, body, q), dot(l, l)
    put_rows(q + l + (energy, l2), work, layout.CHECKED_STATE)

    kinetic = kinetic_energy(body, l)
    # Saved drifts use only the maximum over planned assessments: including saves, it would depend
    # on how often something else is saved.
    untracked = has_untracked(work_flags)
    planned_max = largest_kinetic_energy(untracked, member, layout.PLANNED_KINETIC, kinetic)
    max_kinetic = largest_kinetic_energy(untracked, member, layout.MAX_KINETIC, kinetic)
    planned_max = select(planned > 0.0, planned_max, member[layout.PLANNED_KINETIC])
    member[layout.PLANNED_KINETIC] = planned_max
    member[layout.MAX_KINETIC] = max_kinetic
    start = start_values(member, work_flags, works, max_kinetic, l2)
    fault = classify_state(
        limits, member, work_flags, works, max_kinetic, body, q, l, h, energy, l2
    )
    steps = rounds_done * times[layout.MEMBER_STEPS] + steps_done
    good = update_status(fault, start, energy, l2, steps, q, l, member, late)
    frozen = member[layout.STATUS] > 0.0
    last_good = tuple_at(trailing, member, good_row)
    keep_good(frozen, last_good, after, member, good_row, state, row_after)
    # The true state, in rows for the stepping form: whatever steps make of it, the next assessment
    # resets it, and nothing else reads it.
    restore_good(frozen | stopped, good, state)
    return 1 if any_of(logical_not(frozen | stopped)) else 0


def record(tree, numbers, work, axes_row, out, at, width, t, skips_cache, tangent, apart):
    """Write the values of all observables in the last good state to `out`, from `at` on.

    width : from one value to the next
    skips_cache, tangent, apart : as in `store_rows`
    """
    observables, effects, work_flags, axes = tree_unpack(tree, numbers)
    body, given = layout.observed_body_and_effects(effects, axes, work, axes_row)
    member, trailing = layout.member_rows(work), layout.trailing(effects, work_flags)
    row = layout.EFFECTS + tree_size(effects) + len(trailing)
    after = tuple_at(layout.moving(effects, work_flags), member, row)
    memories = layout.memories_at(effects, work_flags, member, row)
    works, present = (
        left_after(states_of(effects), after),
        in_state(in_memory(given, memories), after),
    )
    q, l = layout.pose_at(member, layout.GOOD_STATE)
    untracked, kinetic = has_untracked(work_flags), kinetic_energy(body, l)
    max_kinetic = largest_kinetic_energy(untracked, member, layout.PLANNED_KINETIC, kinetic)
    start = start_values(member, work_flags, works, max_kinetic, dot(l, l))
    target = out, at, width, skips_cache, tangent, apart
    write_values(observables, body, present, t, q, l, start, works, work, target)
    return 0


def next_attitude(attitude, new, q):
    """Return the attitude after a step: the new one if the attitude is integrated, else q."""
    if len(attitude) == 0:
        return q
    return new


def is_finite(q, l, energy, l2):
    """Return whether all numbers of a state are finite."""
    # 0 times inf or nan is nan, which equals nothing. LLVM may not fold this: it has no promise of
    # "nnan" or "ninf".
    return 0.0 * (energy + l2 + q[0] + q[1] + q[2] + q[3]) == 0.0


def largest_kinetic_energy(untracked, member, row, kinetic):
    """Return the largest kinetic energy so far if it counts among the energies in play, else 0.

    It counts for bodies that start with no energies in play, and where drifts are corrected for
    works.

    untracked : ON if an effect has no energy
    row : PLANNED_KINETIC or MAX_KINETIC
    """
    largest = maximum(member[row], kinetic)
    if len(untracked) == 0:
        return select(member[layout.ENERGY_IN_PLAY] == 0.0, largest, 0.0)
    return largest


def start_values(member, work_flags, works, max_kinetic, l2):
    """Return (E, 1/scale of E, |L|^2, 1/|L|^2) at the start, corrected by the works since.

    max_kinetic : lower bound on the scale of E, see `largest_kinetic_energy`
    l2 : |L|^2 now, which is the scale for a body that starts at rest

    A drift is thus a pure number in every unit. 0 stands for 1/0: there is no scale.
    """
    energy, energy_scale, first_l2 = three_at(member, layout.START)
    scale = inverse(maximum(energy_scale, max_kinetic))
    start = energy, scale, first_l2, inverse(select(first_l2 > 0.0, first_l2, l2))
    return corrected_by_work(start, work_flags, works)


def classify_state(limits, member, work_flags, works, max_kinetic, body, q, l, h, energy, l2):
    """Return the status of a state: 1 if it is not finite, else the limit that it exceeds, or 0.

    limits : of `rigidmc.engine.program.ProgramSpec`
    max_kinetic : from `largest_kinetic_energy`
    """
    not_finite = select(is_finite(q, l, energy, l2), 0.0, 1.0)
    if len(limits) == 0:
        return not_finite
    energy_in_play = maximum(member[layout.ENERGY_IN_PLAY], max_kinetic) + total_abs_work(works)
    expected = member[layout.START_ENERGY] + untracked_work(work_flags, works)
    turn, rise = scale(h, angular_velocity(body, l)), dot(vertical(q), l) - member[layout.START_LZ]
    max_rise2 = limits[2] * limits[2] * maximum(member[layout.MAX_L2], l2)
    first_l2 = member[layout.START_L2]
    # Later lines win, because their status explains more: a step too large explains a drift, and a
    # quaternion off the unit sphere explains both. Squares are compared, to save roots.
    status = select(abs(l2 - first_l2) > limits[1] * first_l2, 4.0, 0.0)
    status = select(rise * rise > max_rise2, 4.0, status)
    status = select(abs(energy - expected) > limits[0] * energy_in_play, 3.0, status)
    status = select(dot(turn, turn) > limits[3] * limits[3], 5.0, status)
    off_unit = abs(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3] - 1.0)
    status = select(off_unit > limits[4], 6.0, status)
    return select(not_finite == 0.0, status, 1.0)


def update_status(fault, start, energy, l2, steps, q, l, member, late):
    """Update drifts, status and last good state after an assessment; return the last good state."""
    status = member[layout.STATUS]
    was_ok = status == 0.0
    # The drift that flags a member counts, too; the drift of a non-finite state would be nan.
    counted = was_ok & (fault != 1.0)
    healthy, faulty = was_ok & (fault == 0.0), was_ok & (fault > 0.0)
    drifts = abs((energy - start[0]) * start[1]), abs((l2 - start[2]) * start[3])
    largest = tuple_at(drifts, member, layout.DRIFT)
    new = max(largest[0], drifts[0]), max(largest[1], drifts[1])
    put_rows(select_all(counted, new, largest), member, layout.DRIFT)
    # Two halves distinguish a drift that grows from one that returns, see `rigidmc.scene.drifts`.
    if late == 0.0:
        put_rows(select_all(counted, new, largest), member, layout.EARLY_DRIFT)
    else:
        smallest = tuple_at(drifts, member, layout.LATE_DRIFT)
        lower = min(smallest[0], drifts[0]), min(smallest[1], drifts[1])
        put_rows(select_all(counted, lower, smallest), member, layout.LATE_DRIFT)
    member[layout.STATUS] = select(was_ok, fault, status)
    member[layout.GOOD_STEP] = select(healthy, steps, member[layout.GOOD_STEP])
    member[layout.FAULT_STEP] = select(faulty, steps, member[layout.FAULT_STEP])
    last = layout.pose_at(member, layout.GOOD_STATE)
    good = select_all(healthy, q, last[0]) + select_all(healthy, l, last[1])
    put_rows(good, member, layout.GOOD_STATE)
    return good


def state_in_double(state, work, compensated):
    """Return (q, L) of a state in float64, with the remainders of sums if there are any."""
    q, l = layout.precise_pose_at(state, layout.ATTITUDE, work)
    if len(compensated) == 0:
        return q, l
    q_remainder, l_remainder = layout.precise_pose_at(state, layout.EXTRA, work)
    return add4(q, q_remainder), add(l, l_remainder)


def restore_good(frozen, good, state):
    """Reset the state of a frozen member to its last good one, with remainders of 0."""
    now = tree_unflatten(good, state, layout.ATTITUDE)
    extra = tree_unflatten(good, state, layout.EXTRA)
    put_rows(select_all(frozen, in_precision(good, state), now), state, layout.ATTITUDE)
    put_rows(select_all(frozen, (0.0,) * 7, extra), state, layout.EXTRA)
    return 0


def keep_good(frozen, good, after, member, row, state, at):
    """Record the numbers after L as the last good ones; for a frozen member, restore these."""
    put_rows(select_all(frozen, good, after), member, row)
    now = tree_unflatten(good, state, at)
    put_rows(select_all(frozen, in_precision(good, state), now), state, at)
    return 0


def write_values(observables, body, effects, t, q, l, start, works, work, target):
    """Write the values of observables, one after the other; return the place after them.

    target : arguments of `store_rows`
    """
    out, at, width, skips_cache, tangent, apart = target
    if len(observables) == 0:
        return at
    values = observed(observables[0], body, effects, t, q, l, start, works)
    at = store_rows(values, work, out, at, width, skips_cache, tangent, apart)
    target = out, at, width, skips_cache, tangent, apart
    return write_values(observables[1:], body, effects, t, q, l, start, works, work, target)


inline_all(sys.modules[__name__])
