"""A shadow trajectory for each member, which makes the same steps and measures their divergence.

At each renormalisation the growth of the distance is added up and the shadow is brought back to
SHADOW_DISTANCE: every RENORMALISE_EVERY steps, at first more often, and after the last step. Its
rows are the SHADOW_ROWS of `rigidmc.engine.kernel.layout`, from `row` of the member's state on.
While steps are made, its state is in `shadow`. The kernels are like the kernels of
`rigidmc.engine.kernel.member`.
"""

import math
import sys

from rigidmc.engine.compiler.compose import inline_all
from rigidmc.engine.compiler.intrinsics import cast_like, in_precision
from rigidmc.engine.compiler.memory import four_at, put_rows, three_at
from rigidmc.engine.compiler.trees import tree_unpack
from rigidmc.engine.kernel.layout import (  # fmt: skip
    ATTITUDE,
    GOOD_STATE,
    MEMBER_ROWS,
    MEMBER_STEPS,
    ROUND_START,
    STEP_LENGTH,
    SUMS,
    WEIGHT,
    body_and_effects,
    momentum_at,
    opening_substep,
    put_stepping,
)
from rigidmc.physics.dynamics.euler import kinetic_energy
from rigidmc.physics.dynamics.functions import logarithm
from rigidmc.physics.dynamics.so3 import difference, difference4, dot, select
from rigidmc.physics.effects.sums import total_energy_scale, total_torque
from rigidmc.physics.integrators.protocol import from_stepping, to_stepping
from rigidmc.physics.observables.chaos import SHADOW_DISTANCE, TORQUE_TRIALS


def begin_shadow(tree, numbers, substeps, state, work, shadow, row, duration):
    """Put the shadow at SHADOW_DISTANCE, in a direction that is special for no body.

    duration : of the run [s]
    """
    _, effects = tree_unpack(tree, numbers)
    body, present = body_and_effects(effects, work)
    q, l = four_at(work, MEMBER_ROWS + GOOD_STATE), three_at(work, MEMBER_ROWS + GOOD_STATE + 4)
    lightest = min(min(body.i1, body.i2), body.i3)
    weight = 0.5 * lightest / energy_measure(present, body, lightest, q, l, duration)
    size = SHADOW_DISTANCE / math.sqrt(weight)
    half = 0.5 * SHADOW_DISTANCE
    # A unit vector of attitude and momentum whose components no symmetry singles out: its squares
    # add up to 1.
    a, b, c = half * 0.31, half * 0.43, half * 0.38
    new_q = (
        q[0] - q[1] * a - q[2] * b - q[3] * c,
        q[1] + q[0] * a + q[2] * c - q[3] * b,
        q[2] + q[0] * b + q[3] * a - q[1] * c,
        q[3] + q[0] * c + q[1] * b - q[2] * a,
    )
    zero = 0.0 * weight
    new_l = l[0] + 0.54 * size, l[1] + 0.47 * size, l[2] + 0.25 * size
    set_shadow(tree, numbers, substeps, work, 0.0, new_q, new_l, shadow, state)
    put_rows(in_precision((zero, zero, zero, weight), state), state, row + SUMS)
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


def renormalise_shadow(tree, numbers, substeps, state, work, shadow, row, slot, now, before):
    """Add up how far the shadow has moved away since the last renormalisation, and bring it back.

    slot : steps made so far
    now, before : the times of this and of the last renormalisation, in steps of the first length

    Between the two the distance is assumed to grow at one rate: the integrals over it are exact.
    """
    integrator, effects = tree_unpack(tree, numbers)
    body, present = body_and_effects(effects, work)
    t, substep = opening_after(substeps, work, slot)
    q, l = from_stepping(integrator, body, present, t, substep, *to_double(integrator, state, work))
    p, m = from_stepping(
        integrator, body, present, t, substep, *to_double(integrator, shadow, work)
    )
    sums = in_precision(three_at(state, row + SUMS), work)
    weight = cast_like(state[row + WEIGHT], work)
    dq, dl = difference4(p, q), difference(m, l)
    # fmt: off
    square = (
        4.0 * (dq[0] * dq[0] + dq[1] * dq[1] + dq[2] * dq[2] + dq[3] * dq[3])
        + weight * dot(dl, dl)
    )
    # fmt: on
    growth = 0.5 * logarithm(square * (1.0 / (SHADOW_DISTANCE * SHADOW_DISTANCE)))
    f = SHADOW_DISTANCE / math.sqrt(square)
    new_q = q[0] + f * dq[0], q[1] + f * dq[1], q[2] + f * dq[2], q[3] + f * dq[3]
    new_l = l[0] + f * dl[0], l[1] + f * dl[1], l[2] + f * dl[2]
    set_shadow(tree, numbers, substeps, work, slot, new_q, new_l, shadow, state)
    # S = int (d'/d) s ds and int 2 S/s ds, in steps
    midpoint = 0.5 * (now + before)
    log_ratio = logarithm(cast_like(now / max(before, 1.0), growth))
    rest = sums[1] - growth * (0.5 * before * before / (now - before))
    mean_growth = sums[2] + 2.0 * rest * log_ratio + midpoint * growth
    new = sums[0] + growth, sums[1] + midpoint * growth, mean_growth
    put_rows(in_precision(new, state), state, row + SUMS)
    return 0


def opening_after(substeps, work, slot):
    """Return (time of the torque, times of row 0) for a state after `slot` steps of a round."""
    h, done = work[STEP_LENGTH], min(work[MEMBER_STEPS], slot)
    return work[ROUND_START] + (done + substeps[3]) * h, opening_substep(substeps, h)


def to_double(integrator, state, work):
    """Return (q, L) of a state in float64, with the extra state of the integrator."""
    q = in_precision(four_at(state, ATTITUDE), work)
    return q, in_precision(momentum_at(integrator, state), work)


def set_shadow(tree, numbers, substeps, work, slot, q, l, shadow, state):
    """Make (q, L) the state of the shadow, in stepping form."""
    integrator, effects = tree_unpack(tree, numbers)
    body, present = body_and_effects(effects, work)
    t, substep = opening_after(substeps, work, slot)
    q, l = to_stepping(integrator, body, present, t, substep, q, l)
    put_stepping(in_precision(q, state), in_precision(l, state), shadow)
    return 0


inline_all(sys.modules[__name__])
