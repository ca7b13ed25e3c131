"""Steps that are long against the rotation: a result is right or flagged."""

from collections.abc import Iterator

from rigidmc.studies.stress.case import Case
from rigidmc.studies.stress.motions import tops
from rigidmc.studies.stress.truths import flagged_or_close

TITLE = "fast spin"

# {angle of a step [rad]: {integrator: why it claims the case and fails it}}
WEAK = {
    1.0: {
        name: "a step of 1 rad is too long: one digit is left after 32 turns"
        for name in ("rk4", "rkmk4", "cf4", "rotations")
    },
    0.1: {"midpoint": "order 2: a step of 0.1 rad is too long over 32 turns"},
}


def cases() -> Iterator[Case]:
    scene = tops((1.0, 1.4, 2.0), (3.0, 0.2, 1.0))
    for angle in (0.1, 1.0, 3.0):
        yield Case(
            f"|omega| h = {angle:g}",
            "a step as long as a turn: aliased motion looks like slow motion, so it must be"
            " right or flagged",
            "closed form, or a flag",
            flagged_or_close(scene, 200.0 / 3.05, steps=max(8, round(200.0 / angle))),
            asked=0.5,
            weak=WEAK.get(angle, {}),
        )
