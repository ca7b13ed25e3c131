"""The last interval between saves, if it is shorter than the others: its steps have a length of
their own.

Numbers of steps go on; only the rows LENGTH and BEGAN change, between two steps. What depends on
the length changes with them: the state, if an integrator keeps it a part of a step further on, and
sums over steps, which are means over time only if each step counts by its length. Pieces as those
of `rigidmc.engine.kernel.member`.
"""

import sys

from rigidmc.engine.compiler.compose import inline_all
from rigidmc.engine.compiler.intrinsics import in_precision, like
from rigidmc.engine.compiler.memory import put, tuple_at
from rigidmc.engine.compiler.trees import filled, parts_of, row_count
from rigidmc.engine.kernel.layout import (  # fmt: skip
    ATTITUDE,
    BEGAN,
    BODY,
    EACH,
    EFFECTS,
    EFFECTS_AT,
    EVENT,
    KNOWN,
    LENGTH,
    REST,
    body_at,
    more_of,
    more_row,
)
from rigidmc.engine.kernel.member import seen
from rigidmc.engine.kernel.monitoring import kept_at, put_kept
from rigidmc.physics.dynamics.so3 import first_three, joined
from rigidmc.physics.integrators.protocol import closed, keeps, opened
from rigidmc.physics.observables.protocol import reweighed


def reopen(kinds, numbers, parts, state, work, slot, began, h, member_steps):
    """Close a state after `slot` steps and open it for steps of another length.

    began, h, member_steps : as `enter` of `rigidmc.engine.kernel.member` takes them, of the last
        interval
    """
    integrator, effects, compensated, ledger = parts_of(kinds, numbers)
    body, present = body_at(work, KNOWN + BODY), filled(effects, work, KNOWN + EFFECTS)
    row = more_row(keeps(integrator), EFFECTS_AT + row_count(effects))
    q, l = seen(state, work, compensated)
    l = joined(l, in_precision(tuple_at(more_of(keeps(integrator), ledger), state, row), work))
    before, done = work[LENGTH], min(work[EACH], slot)
    t = work[BEGAN] + (done + parts[3]) * before
    q, l = closed(integrator, body, present, t, shares(parts, before), q, l)
    after = length(work, h, member_steps)
    first = 0.0 if member_steps != 0 else slot  # each round begins with step 0
    t = like(began, work) + (first + parts[3]) * after
    q, l = opened(integrator, body, present, t, shares(parts, after), q, l)
    put(in_precision(q + first_three(l), state), state, ATTITUDE)
    put(in_precision(l[3:], state), state, row)
    forget(compensated, state)
    return 0


def forget(compensated, state):
    """Set the remainders of sums to 0, if they are kept: `seen` has added them."""
    if len(compensated) > 0:
        put((0.0,) * 7, state, REST)
    return 0


def shares(parts, h):
    """The times of the part that opens a state, of a step h."""
    return parts[0] * h, parts[1] * h, parts[2] * h


def length(work, h, member_steps):
    """The length of a member's step: h, or its share of a round of length h."""
    return h / work[EACH] if member_steps != 0 else like(h, work)


def reweigh(kinds, numbers, work, row, longer):
    """Count each step so far as `longer` steps of the last interval in all sums over steps."""
    events, running = parts_of(kinds, numbers)
    row += EVENT * len(events)
    put_kept(all_reweighed(running, kept_at(running, work, row), longer), work, row)
    return 0


def all_reweighed(running, kept, longer):
    """The numbers of running observables after `reweigh`."""
    if len(running) == 0:
        return ()
    first = reweighed(running[0][0], kept[0], longer)
    return (first,) + all_reweighed(running[1:], kept[1:], longer)


inline_all(sys.modules[__name__])
