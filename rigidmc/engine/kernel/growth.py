"""The growth of a tangent of each member: how fast nearby trajectories diverge.

The tangent is the derivative of the state along one direction, and moves with it: `march` makes the
steps of both, exactly. At each record the growth of its length is added up, and its length is made
1 again, so that no number overflows: every RECORD_EVERY steps, at first more often, and after the
last step. Its rows are the GROWTH_ROWS of `rigidmc.engine.kernel.layout`. While steps are made, the
tangent is the last derivative of the state, and to these kernels the only one. The kernels are like
the kernels of `rigidmc.engine.kernel.member`.
"""

import math
import sys

from rigidmc.engine.compiler.compose import inline_all
from rigidmc.engine.compiler.derivatives import changes_of, first_values, moving_each
from rigidmc.engine.compiler.intrinsics import cast_like, in_precision
from rigidmc.engine.compiler.memory import four_at, put_rows, three_at, tuple_at
from rigidmc.engine.compiler.trees import tree_unpack
from rigidmc.engine.kernel import layout
from rigidmc.physics.dynamics.euler import kinetic_energy
from rigidmc.physics.dynamics.functions import logarithm
from rigidmc.physics.dynamics.so3 import dot, first_three, scale, select
from rigidmc.physics.effects.sums import total_energy_scale, total_torque
from rigidmc.physics.integrators.protocol import from_stepping, to_stepping
from rigidmc.physics.observables.chaos import TORQUE_TRIALS

_STATE = (0.0,) * layout.START  # marks of the numbers of a state that steps move


def begin_growth(tree, numbers, substeps, state, work, row, duration):
    """Give each member a tangent of length 1, in a direction that is special for no body.

    row : first of the rows of growth in `work`;  duration : of the run [s]
    """
    integrator, effects = tree_unpack(tree, numbers)
    body, present = layout.body_and_effects(effects, work)
    q, l = layout.good_pose(work)
    lightest = min(min(body.i1, body.i2), body.i3)
    weight = 0.5 * lightest / energy_measure(present, body, lightest, q, l, duration)
    size = 1.0 / math.sqrt(weight)
    # A unit vector of attitude and momentum whose components no symmetry singles out: its squares
    # add up to 1. Here half of the angles.
    a, b, c = 0.155, 0.215, 0.19
    dq = (
        -q[1] * a - q[2] * b - q[3] * c,
        q[0] * a + q[2] * c - q[3] * b,
        q[0] * b + q[3] * a - q[1] * c,
        q[0] * c + q[1] * b - q[2] * a,
    )
    dl = 0.54 * size, 0.47 * size, 0.25 * size
    t, substep = opening_after(substeps, work, 0.0)
    q, l = to_stepping(
        integrator, body, present, t, substep, moving_each(q, dq), moving_each(l, dl)
    )
    layout.put_stepping(in_precision(q, state), in_precision(l, state), state)
    put_rows((0.0 * weight, 0.0 * weight, 0.0 * weight), work, row + layout.SUMS)
    put_rows((0.0 * weight, weight), work, row + layout.RECORDED)
    return 0


def energy_measure(effects, body, lightest, q, l, duration):
    """Return the energy scale of a motion, which weighs its momentum [J].

    It is the larger of two: the kinetic energy at the start plus the bounds on the energies of the
    effects, and the largest torque on the body in its initial state, at TORQUE_TRIALS times of the
    run, times 1 rad. A body that nothing moves gets the energy of 1 rad in the run.

    lightest : 1/(largest moment)
    """
    energy, largest = kinetic_energy(body, l) + total_energy_scale(effects, body), 0.0 * lightest
    for k in range(TORQUE_TRIALS):
        # Multiples of the golden section, modulo 1, spread over the run out of step with every
        # period of a torque.
        t = duration * (k * 0.6180339887498949 % 1.0)
        torque = total_torque(effects, body, cast_like(t, largest), q, l)
        largest = max(largest, dot(torque, torque))
    energy = max(energy, math.sqrt(largest))
    return select(energy > 0.0, energy, 0.5 / (lightest * duration * duration))


def record_growth(tree, numbers, substeps, state, work, row, slot, is_planned):
    """Add up how much the tangent has grown since the last record, and give it the length 1.

    slot : steps of the round made so far
    is_planned : 1 to record all members, 0 those that have made all their own steps of the round

    Between two records the length is assumed to grow at one rate: the integrals over it are exact.
    """
    integrator, effects = tree_unpack(tree, numbers)
    body, present = layout.body_and_effects(effects, work)
    t, substep = opening_after(substeps, work, slot)
    q = in_precision(four_at(state, layout.ATTITUDE), work)
    l = in_precision(layout.momentum_at(integrator, state), work)
    q, l = from_stepping(integrator, body, present, t, substep, q, l)
    dq, dl = changes_of(q), changes_of(first_three(l))
    weight, before = work[row + layout.WEIGHT], work[row + layout.RECORDED]
    square = 4.0 * (dq[0] * dq[0] + dq[1] * dq[1] + dq[2] * dq[2] + dq[3] * dq[3])
    square = square + weight * dot(dl, dl)
    now = work[layout.ROUND_START] + min(work[layout.MEMBER_STEPS], slot) * work[layout.STEP_LENGTH]
    # A member that waits for others to end the round has its record already.
    is_due = (now > before) & (select(work[layout.MEMBER_STEPS] <= slot, 1.0, is_planned) > 0.0)
    growth = select(is_due, 0.5 * logarithm(square), 0.0)
    shrink = cast_like(select(is_due, 1.0 / math.sqrt(square), 1.0), state)
    rows = tuple_at(_STATE, state, layout.ATTITUDE)
    shrunk = moving_each(first_values(rows), scale(shrink, changes_of(rows)))
    put_rows(shrunk, state, layout.ATTITUDE)
    sums, midpoint = three_at(work, row + layout.SUMS), 0.5 * (now + before)
    # With the rate r since `before`, int (d'/d) s ds = S + r (s^2 - before^2)/2, and its integral
    # of 2/s is 2 (S - r before^2/2) ln(now/before) + r (now^2 - before^2)/2.
    has_records, since = before > 0.0, select(is_due, now - before, 1.0)
    # 1 s avoids 0/0 before the first record
    log_ratio = logarithm(select(has_records, now / select(has_records, before, 1.0), 1.0))
    rest = sums[1] - growth * (0.5 * before * before / since)
    mean_growth = sums[2] + select(is_due, 2.0 * rest * log_ratio + midpoint * growth, 0.0)
    put_rows((sums[0] + growth, sums[1] + midpoint * growth, mean_growth), work, row + layout.SUMS)
    work[row + layout.RECORDED] = select(is_due, now, before)
    return 0


def opening_after(substeps, work, slot):
    """Return (time of the torque, times of row 0) for a state after `slot` steps of a round."""
    h, done = work[layout.STEP_LENGTH], min(work[layout.MEMBER_STEPS], slot)
    return work[layout.ROUND_START] + (done + substeps[3]) * h, layout.opening_substep(substeps, h)


inline_all(sys.modules[__name__])
