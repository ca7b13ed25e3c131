"""The ledger of work: how much energy each effect has given to the body.

A run that saves `work` carries one number for each effect behind the three components of L.
"""

from rigidmc.dynamics.euler import angular_velocity
from rigidmc.dynamics.so3 import add, dot, scale
from rigidmc.effects.protocol import torque


def worked(effects, body, t, h, q, l, w, works):
    """The work of each effect, increased by h torque(t, q, L) . w; works = () counts as 0 each."""
    if len(effects) == 0:
        return ()
    done = h * dot(torque(effects[0], body, t, q, l), w)
    if len(works) == 0:
        return (done,) + worked(effects[1:], body, t, h, q, l, w, works)
    return (works[0] + done,) + worked(effects[1:], body, t, h, q, l, w, works[1:])


def worked_along(effect, body, t, h, q, before, after, work):
    """The work of one effect whose flow over h takes L from `before` to `after`.

    By the torque at the middle of the two: order 2.
    """
    middle = scale(0.5, add(before, after))
    return work + h * dot(torque(effect, body, t, q, middle), angular_velocity(body, middle))


def booked(start, ledger, works):
    """The start's (E, 1/scale of E, ...), corrected by the works done since.

    E grows by the work of the effects without an energy; the scale grows by the sum of all |work|.
    ledger : for each effect () if it has an energy, else (0.0,)
    """
    if len(works) == 0:
        return start
    return (start[0] + spent(ledger, works), start[1] / (1.0 + start[1] * gross(works))) + start[2:]


def marked(ledger):
    """(0.0,) if an effect of the ledger has no energy, else ()."""
    if len(ledger) == 0:
        return ()
    return either(ledger[0], marked(ledger[1:]))


def either(marks, others):
    """Marks, or others if there are none."""
    if len(marks) == 0:
        return others
    return marks


def spent(ledger, works):
    """The sum of the works of those effects that have no () in `ledger`."""
    if len(works) == 0:
        return 0.0
    return spent_first(ledger[0], works[0], spent(ledger[1:], works[1:]))


def spent_first(mark, work, others):
    """others + work, or others alone if the mark is ()."""
    if len(mark) == 0:
        return others
    return work + others


def gross(works):
    """The sum of all |work|."""
    if len(works) == 0:
        return 0.0
    return abs(works[0]) + gross(works[1:])
