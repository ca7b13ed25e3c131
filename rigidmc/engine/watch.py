"""What is kept of every step without being saved: events (`rigidmc.engine.events`), running observables, a neighbour.

The loops over lanes stand in the kernel: one in a function of its own is unrolled before it is vectorised, and half as fast.

All of it are rows of a block after those of the effects and their works: EVENT rows for each event, as many as it has marks for each running
observable, SHADOW rows for the neighbour. They are updated in a loop of their own after a step, so that no step depends on them.
"""

import math

from rigidmc.dynamics.euler import MassProperties
from rigidmc.dynamics.so3 import difference, difference4, dot, select, whole
from rigidmc.engine.compose import inline, read, read_all
from rigidmc.engine.events import EVENT, stopped
from rigidmc.engine.layout import BODY_AT, EFFECTS_AT, LANES, clock, four_at, keep, put, state_at, three_at, tuple_at
from rigidmc.engine.noise import logarithm
from rigidmc.integrators.verbs import closed
from rigidmc.observables.chaos import NEAR, OFTEN  # noqa: F401
from rigidmc.observables.verbs import begin, update

# rows of the neighbour: its state; sums of ln growth, of the same by number of looks, of Y; 1/|L|^2 of the motion
SUMS, WEIGHT, SHADOW = 7, 10, 11
_BODY = MassProperties(*[0.0] * 9)


def watched(integrator, effects, compensated, own, when, state, k):
    """(body, effects, q, L, time, step) of lane k at the end of a step, as they truly are.

    when : start of the round, slot in it, time of the opening torque in steps, end of the step, step, shares of the opening; see `clock`
    """
    start, slot, lead, t, h, shares = when
    body, present = read(_BODY, state, BODY_AT, k, LANES), read_all(effects, state, EFFECTS_AT, k, LANES)
    t, by, part = clock(own, state, k, start, slot, 1.0, t, h, shares)
    q, l = state_at(state, k, compensated, (), 0)
    q, l = closed(integrator, body, present, t + lead * by, part, whole(q), whole(l))
    return body, present, q, l, t, by


def begin_running(running, body, effects, t, q, l, work, k, row):
    """The rows of running observables at the start."""
    if len(running) == 0:
        return 0
    put(begin(running[0][0], body, effects, t, q, l), work, row * LANES + k, LANES)
    return begin_running(running[1:], body, effects, t, q, l, work, k, row + len(running[0][1]))


def look_at_running(running, events, events_at, own, slot, body, effects, t, q, l, state, k, row):
    """The rows of running observables a step further on; those of a member that an event has stopped stay."""
    if len(running) == 0:
        return 0
    kept = tuple_at(running[0][1], state, k, row)
    new = update(running[0][0], kept, body, effects, t, q, l)
    keep(own, slot, chosen_of(events, stopped(events, state, k, events_at), kept, new), state, k, row)
    return look_at_running(running[1:], events, events_at, own, slot, body, effects, t, q, l, state, k, row + len(running[0][1]))


def chosen_of(events, halted, kept, new):
    """What is kept, or where there is no event or none stopped the member, what is new."""
    if len(events) == 0 or len(new) == 0:
        return new
    return (select(halted > 0.0, kept[0], new[0]),) + chosen_of(events, halted, kept[1:], new[1:])


def watch_rows(events, running, shadow):
    """How many rows of a block all of it takes."""
    return EVENT * len(events) + all_marks(running) + SHADOW * len(shadow)


def all_marks(running):
    """How many rows running observables take."""
    if len(running) == 0:
        return 0
    return len(running[0][1]) + all_marks(running[1:])


def begin_shadow(weight, q, l, work, k, row):
    """The neighbour of a state at the distance NEAR, in a direction that no body singles out."""
    root = NEAR / math.sqrt(weight)
    a, b, c = 0.5 * NEAR * 0.31, 0.5 * NEAR * 0.43, 0.5 * NEAR * 0.38
    turned = (
        q[0] - q[1] * a - q[2] * b - q[3] * c,
        q[1] + q[0] * a + q[2] * c - q[3] * b,
        q[2] + q[0] * b + q[3] * a - q[1] * c,
        q[3] + q[0] * c + q[1] * b - q[2] * a,
    )
    moved = l[0] + 0.54 * root, l[1] + 0.47 * root, l[2] + 0.25 * root
    put(turned + moved + (0.0, 0.0, 0.0, weight), work, row * LANES + k, LANES)
    return 0


def look_at_shadow(number, q, l, state, k, row):
    """Book how far the neighbour has gone since look `number` - 1, and bring it back."""
    p, m, weight = four_at(state, k, row), three_at(state, k, row + 4), state[(row + WEIGHT) * LANES + k]
    dq, dl = difference4(p, q), difference(m, l)
    square = 4.0 * (dq[0] * dq[0] + dq[1] * dq[1] + dq[2] * dq[2] + dq[3] * dq[3]) + weight * dot(dl, dl)
    grown = 0.5 * logarithm(square * (1.0 / (NEAR * NEAR)))
    back = NEAR / math.sqrt(square)
    put((q[0] + back * dq[0], q[1] + back * dq[1], q[2] + back * dq[2], q[3] + back * dq[3]), state, row * LANES + k, LANES)
    put((l[0] + back * dl[0], l[1] + back * dl[1], l[2] + back * dl[2]), state, (row + 4) * LANES + k, LANES)
    booked = state[(row + SUMS + 1) * LANES + k] + (number - 0.5) * grown
    state[(row + SUMS) * LANES + k] += grown
    state[(row + SUMS + 1) * LANES + k] = booked
    state[(row + SUMS + 2) * LANES + k] += 2.0 * booked / number
    return 0


for _function in (watched, begin_running, look_at_running, chosen_of, all_marks, begin_shadow, look_at_shadow):
    inline(_function)
