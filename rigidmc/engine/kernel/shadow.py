"""A neighbour of each member, which makes the same steps: how fast it moves away.

At each meeting the growth of its distance is noted and it is brought back to the distance NEAR:
every OFTEN steps, after each of the first OFTEN, and after the last.
Its rows are those up to SHADOW of `rigidmc.engine.kernel.layout`, from `row` of the member's state
on; while steps are made its state is in `near`. Pieces as those of `rigidmc.engine.kernel.member`.
"""

import math
import sys

from rigidmc.engine.compiler.compose import inline_all
from rigidmc.engine.compiler.intrinsics import in_precision, like
from rigidmc.engine.compiler.memory import four_at, put, three_at
from rigidmc.engine.compiler.trees import filled, parts_of
from rigidmc.engine.kernel.layout import (  # fmt: skip
    ATTITUDE,
    BEGAN,
    BODY,
    EACH,
    EFFECTS,
    GOOD,
    KNOWN,
    LENGTH,
    SUMS,
    WEIGHT,
    body_at,
    momentum_at,
    put_opened,
)
from rigidmc.physics.dynamics.euler import kinetic_energy
from rigidmc.physics.dynamics.functions import logarithm
from rigidmc.physics.dynamics.so3 import difference, difference4, dot, select
from rigidmc.physics.effects.sums import total_energy_scale, total_torque
from rigidmc.physics.integrators.protocol import closed, opened
from rigidmc.physics.observables.chaos import NEAR, TRIED


def begin_near(kinds, numbers, parts, state, work, near, row, span):
    """Put the neighbour at the distance NEAR, in a direction that is special for no body.

    span : of the run [s]
    """
    _, effects = parts_of(kinds, numbers)
    body, present = body_at(work, KNOWN + BODY), filled(effects, work, KNOWN + EFFECTS)
    q, l = four_at(work, KNOWN + GOOD), three_at(work, KNOWN + GOOD + 4)
    lightest = min(min(body.i1, body.i2), body.i3)
    weight = 0.5 * lightest / in_play(present, body, lightest, q, l, span)
    root = NEAR / math.sqrt(weight)
    a, b, c = 0.5 * NEAR * 0.31, 0.5 * NEAR * 0.43, 0.5 * NEAR * 0.38
    turned = (
        q[0] - q[1] * a - q[2] * b - q[3] * c,
        q[1] + q[0] * a + q[2] * c - q[3] * b,
        q[2] + q[0] * b + q[3] * a - q[1] * c,
        q[3] + q[0] * c + q[1] * b - q[2] * a,
    )
    moved, zero = (l[0] + 0.54 * root, l[1] + 0.47 * root, l[2] + 0.25 * root), 0.0 * weight
    settle(kinds, numbers, parts, work, 0.0, turned, moved, near, state)
    put(in_precision((zero, zero, zero, weight), state), state, row + SUMS)
    return 0


def in_play(effects, body, lightest, q, l, span):
    """The energy [J] by which the momentum of a motion is measured, of the largest of these:

    the kinetic energy at the start and the bounds on those of the effects; for effects without an
    energy the largest torque on the body at the start, at TRIED times of the run, over 1 rad. A
    body that nothing moves is measured by 1 rad in the run. lightest : 1/(largest moment)
    """
    energy, most = kinetic_energy(body, l) + total_energy_scale(effects, body), 0.0 * lightest
    for k in range(TRIED):
        # the golden section of the run goes through no period of a torque
        t = span * (k * 0.6180339887498949 % 1.0)
        torque = total_torque(effects, body, like(t, most), q, l)
        most = max(most, dot(torque, torque))
    energy = max(energy, math.sqrt(most))
    return select(energy > 0.0, energy, 0.5 / (lightest * span * span))


def meet(kinds, numbers, parts, state, work, near, row, slot, now, before):
    """Note how far the neighbour has moved away since the last meeting, and bring it back.

    slot : steps made so far;  now, before : the times of this and of the last meeting, in steps of
        the first length

    Between two meetings the distance is taken to grow at one rate: the integrals over it are exact.
    """
    integrator, effects = parts_of(kinds, numbers)
    body, present = body_at(work, KNOWN + BODY), filled(effects, work, KNOWN + EFFECTS)
    t, part = opening(parts, work, slot)
    q, l = closed(integrator, body, present, t, part, *in_double(integrator, state, work))
    p, m = closed(integrator, body, present, t, part, *in_double(integrator, near, work))
    sums, weight = in_precision(three_at(state, row + SUMS), work), like(state[row + WEIGHT], work)
    dq, dl = difference4(p, q), difference(m, l)
    # fmt: off
    square = (
        4.0 * (dq[0] * dq[0] + dq[1] * dq[1] + dq[2] * dq[2] + dq[3] * dq[3])
        + weight * dot(dl, dl)
    )
    # fmt: on
    grown = 0.5 * logarithm(square * (1.0 / (NEAR * NEAR)))
    back = NEAR / math.sqrt(square)
    turned = q[0] + back * dq[0], q[1] + back * dq[1], q[2] + back * dq[2], q[3] + back * dq[3]
    moved = l[0] + back * dl[0], l[1] + back * dl[1], l[2] + back * dl[2]
    settle(kinds, numbers, parts, work, slot, turned, moved, near, state)
    # S = int (d'/d) s ds and int 2 S/s ds, in steps
    middle = 0.5 * (now + before)
    longer = logarithm(like(now / max(before, 1.0), grown))
    rest = sums[1] - grown * (0.5 * before * before / (now - before))
    new = (
        sums[0] + grown, sums[1] + middle * grown, sums[2] + 2.0 * rest * longer + middle * grown
    )  # fmt: skip
    put(in_precision(new, state), state, row + SUMS)
    return 0


def opening(parts, work, slot):
    """(time of the torque, times) of the part that opens a state after `slot` steps of a round."""
    h, done = work[LENGTH], min(work[EACH], slot)
    return work[BEGAN] + (done + parts[3]) * h, (parts[0] * h, parts[1] * h, parts[2] * h)


def in_double(integrator, state, work):
    """(q, L) of a state in float64, with what the integrator keeps."""
    q = in_precision(four_at(state, ATTITUDE), work)
    return q, in_precision(momentum_at(integrator, state), work)


def settle(kinds, numbers, parts, work, slot, q, l, near, state):
    """Make (q, L) the state of the neighbour, as the integrator keeps it."""
    integrator, effects = parts_of(kinds, numbers)
    body, present = body_at(work, KNOWN + BODY), filled(effects, work, KNOWN + EFFECTS)
    t, part = opening(parts, work, slot)
    q, l = opened(integrator, body, present, t, part, q, l)
    put_opened(in_precision(q, state), in_precision(l, state), near)
    return 0


inline_all(sys.modules[__name__])
