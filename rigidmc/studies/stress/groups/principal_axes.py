"""Spins about principal axes: steady rotations in which rounding must not grow."""

from collections.abc import Iterator

import numpy as np

from rigidmc.studies.stress.case import Case, makes_steps
from rigidmc.studies.stress.motions import GRAVITY, UPRIGHT, constant, direction, tops

TITLE = "principal axes"

BODIES = {
    "generic": (1.0, 2.0, 2.5),
    "needle": (1e-6, 1.0, 1.0000005),
    "nearly symmetric": (1.0, 1.0 + 1e-12, 2.0),
    "flat plate": (1.0, 2.0, 3.0),
}


def cases() -> Iterator[Case]:
    for word, moments in BODIES.items():
        spins = np.array([sign * axis for axis in np.eye(3) for sign in (1.0, -1.0)])
        scene = tops(np.tile(moments, (6, 1)), spins)
        steps = 1_000_000 if word == "generic" else 100_000
        end = steps * 0.05 / (1.0 / min(moments))
        yield Case(
            f"axis spins of a {word} body",
            f"{steps:,} steps of spin about each axis in both directions, the unstable one"
            " included: rounding errors across the axis would grow",
            "L is constant in the body",
            constant(scene, end, direction, steps=steps),
            asked=1e-15,
            claims=makes_steps,
            quick=word == "needle",
        )
    heavy = tops((1.0, 1.0, 0.7), (0.0, 0.0, 3.0), UPRIGHT, (0.0, 0.0, 1.3))
    yield Case(
        "sleeping top, 1e5 steps",
        "fast and exactly upright: the torque of gravity must vanish to the bit"
        " at every rotation about the vertical",
        "L and the vertical are constant in the body",
        constant(heavy, 1e3, direction, steps=100_000),
        effects=GRAVITY,
        claims=makes_steps,
    )
