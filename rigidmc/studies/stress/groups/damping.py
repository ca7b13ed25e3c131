"""Damped free bodies, whose closed form is the undamped motion at another time."""

from collections.abc import Iterator

from rigidmc.studies.stress.case import Case
from rigidmc.studies.stress.motions import tops
from rigidmc.studies.stress.truths import against_closed

TITLE = "damping"


def cases() -> Iterator[Case]:
    slow = tops((1.0, 1.4, 2.0), (0.3, 0.9, 0.7), damping=0.2)
    yield Case(
        "damped asymmetric body",
        "L' = L x omega - rate L: every integrator must place the damping right within its step",
        "closed form at another time",
        against_closed(slow, 20.0),
        effects=slow.effects,
    )
    fast = tops((1.0, 1.4, 2.0), (3.0, 9.0, 7.0), damping=5.0)
    yield Case(
        "to rest in 30 e-foldings",
        "the step is short against the first spin and long against the last",
        "closed form at another time",
        against_closed(fast, 6.0),
        effects=fast.effects,
    )
