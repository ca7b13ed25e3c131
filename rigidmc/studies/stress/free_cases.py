"""Hard cases of a free body: groups H1 to H6.

A group is a function with `@group` that yields its `HardCase`s.
"""

import math
from collections.abc import Iterator

import numpy as np

from rigidmc.physics.integrators import INTEGRATORS
from rigidmc.studies.stress.case import HardCase, group
from rigidmc.studies.stress.motions import UPRIGHT, direction, invariants, largest_change, tops
from rigidmc.studies.stress.problems import HARD
from rigidmc.studies.stress.truths import (
    distance_to_closed_form,
    flagged_or_close,
    flips,
    over_members,
)

AXIS_BODIES = {
    "generic": (1.0, 2.0, 2.5),
    "needle": (1e-6, 1.0, 1.0000005),
    "nearly symmetric": (1.0, 1.0 + 1e-12, 2.0),
    "flat plate": (1.0, 2.0, 3.0),
}


@group("H1", "principal axes")
def principal_axes() -> Iterator[HardCase]:
    """Yield spins about principal axes: steady rotations in which rounding must not grow."""
    for word, moments in AXIS_BODIES.items():
        spins = np.array([sign * axis for axis in np.eye(3) for sign in (1.0, -1.0)])
        scene = tops(np.tile(moments, (6, 1)), spins)
        steps = 1_000_000 if word == "generic" else 100_000
        end = steps * 0.05 / (1.0 / min(moments))
        yield HardCase(
            f"axis spins of a {word} body",
            f"{steps:,} steps of spin about each axis in both directions, including the unstable"
            " axis: rounding errors across the axis would grow",
            largest_change(scene, end, direction, steps=steps),
            truth="L is constant in the body",
            asked=1e-15,
            quick=word == "needle",
        )
    heavy = tops((1.0, 1.0, 0.7), (0.0, 0.0, 3.0), UPRIGHT, (0.0, 0.0, 1.3))
    yield HardCase(
        "sleeping top, 1e5 steps",
        "fast and exactly upright: the torque of gravity must vanish to the bit"
        " at every rotation about the vertical",
        largest_change(heavy, 1e3, direction, steps=100_000),
        truth="L and the vertical are constant in the body",
    )


FLIPPING_MOMENTS = (1.0, 2.0, 3.0)


@group("H2", "Dzhanibekov")
def dzhanibekov() -> Iterator[HardCase]:
    """Yield flips of a body that spins about its middle axis (Dzhanibekov effect)."""
    for eps in (1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12, 1e-13, 1e-15):
        yield HardCase(
            f"first flip, eps = {eps:g}",
            f"the time of the first flip after a disturbance of {eps:g}: an absolute error"
            f" of 1e-16 is {1e-16 / eps:.0e} of the disturbance",
            flips(FLIPPING_MOMENTS, (eps, 2.0, 0.0), 1),
            asked=lambda name: 1e-10 if INTEGRATORS[name].order >= 6 else None,
            quick=eps in (1e-4, 1e-13),
        )
    for eps in (1e-2, 1e-3, 1e-4):
        yield HardCase(
            f"ten flips, eps = {eps:g}",
            "each passage of the unstable axis starts from components of size 1: a rounding error"
            " of 1e-16 changes the modulus, and so the time, by 1e-16/eps^2",
            flips(FLIPPING_MOMENTS, (eps, 2.0, 0.0), 10),
        )
    scene, interval = tops(FLIPPING_MOMENTS, (1e-4, 2.0, 0.0)), 36.707819410833642463
    yield HardCase(
        "invariants over 1e3 flips",
        "4e4 s with a thousand passages of the unstable axis: energy and |L|^2 must not"
        " follow the flips",
        largest_change(scene, 1e3 * interval, invariants, saves=100, steps=600_000),
    )


@group("H3", "separatrix")
def separatrix() -> Iterator[HardCase]:
    """Yield free motions on and near the separatrix, where the modulus is 1 to rounding."""
    for word in ("separatrix", "separatrix_below", "separatrix_above", "near_middle_axis_13"):
        moments, momentum = HARD[word]
        yield HardCase(
            word.replace("_", " "),
            "the modulus is 1 to rounding: formulas with m, K(m) and inverse sines lose all"
            " digits, and errors grow as exp(0.6 t)",
            distance_to_closed_form(tops(moments, momentum), 12.0),
            quick=word == "separatrix",
        )
    near = tops((1.0, 2.0, 3.0), (1.0 - 1e-15, 1.0, math.sqrt(3.0)))
    yield HardCase(
        "invariants on the separatrix",
        "1e5 steps along the separatrix and back past the middle axis, on the side chosen by"
        " rounding",
        largest_change(near, 1e4, invariants, steps=100_000),
    )


SYMMETRIC_MOMENTUM = (0.3, 0.2, 0.1)
SYMMETRIC_BODIES = {
    "sphere": (1.0, 1.0, 1.0),
    "oblate": (1.0, 1.0, 2.0),
    "prolate": (1.0, 2.0, 2.0),
    "symmetric about 2": (1.0, 0.6, 1.0),
}


@group("H4", "symmetric limits")
def symmetric_limits() -> Iterator[HardCase]:
    """Yield bodies with equal and nearly equal moments, where formulas change their form."""
    for word, moments in SYMMETRIC_BODIES.items():
        yield HardCase(
            word,
            "two equal moments: a coefficient of Euler's equations vanishes, and formulas"
            " must not divide by it",
            distance_to_closed_form(tops(moments, SYMMETRIC_MOMENTUM), 50.0),
        )
    for split in (1e-4, 1e-8, 1e-12, 1e-15):
        for word, moments in (
            ("I1 = I2", (1.0, 1.0 + split, 2.0)),
            ("I2 = I3", (1.0, 2.0, 2.0 * (1.0 + split))),
        ):
            yield HardCase(
                f"{word} to {split:g}",
                "between the symmetric and the asymmetric formulas: no jump is allowed where they"
                " meet",
                distance_to_closed_form(tops(moments, SYMMETRIC_MOMENTUM), 50.0),
            )
    splits = (0.0, 1e-15, 3e-15, 1e-14)
    for word, at in (("I1 = I2", 1), ("I2 = I3", 2)):
        base = (1.0, 1.0, 2.0) if at == 1 else (1.0, 2.0, 2.0)
        rows = np.array([[x * (1.0 + s * (i == at)) for i, x in enumerate(base)] for s in splits])
        yield HardCase(
            f"continuous across {word}",
            "bodies that differ by a rounding error must move alike: a formula that switches at"
            " equality fails here",
            over_members(tops(rows, SYMMETRIC_MOMENTUM), 20.0),
            asked=1e-12,
        )


FLAT_AND_THIN = {
    "flat_plate": "I3 = I1 + I2 to rounding, the edge of the triangle inequality",
    "flat_disc": "flat and symmetric at once",
    "needle": "moments differ by 1e6: a step is short for one axis and long for the others",
    "needle_on_edge": "spin across a needle, 1e-7 along it",
    "rod": "moments differ by 1e9",
}


@group("H5", "plates and needles")
def plates_and_needles() -> Iterator[HardCase]:
    """Yield bodies at the edge of the triangle inequality, and bodies with very unequal moments."""
    for word, why in FLAT_AND_THIN.items():
        moments, momentum = HARD[word]
        yield HardCase(
            word.replace("_", " "),
            why,
            distance_to_closed_form(tops(moments, momentum), 10.0),
            quick=word == "needle",
        )


# {angle of a step [rad]: {integrator: why it claims the case and fails it}}
TOO_LONG_STEPS = {
    1.0: {
        name: "a step of 1 rad is too long: one digit is left after 32 turns"
        for name in ("rk4", "rkmk4", "cf4", "rotations")
    },
    0.1: {"midpoint": "order 2: a step of 0.1 rad is too long over 32 turns"},
}


@group("H6", "fast spin")
def fast_spin() -> Iterator[HardCase]:
    """Yield steps that are long compared to the rotation: a result must be right or flagged."""
    scene = tops((1.0, 1.4, 2.0), (3.0, 0.2, 1.0))
    for angle in (0.1, 1.0, 3.0):
        yield HardCase(
            f"|omega| h = {angle:g}",
            "a step comparable to a turn: aliased motion looks like slow motion, so it must be"
            " right or flagged",
            flagged_or_close(scene, 200.0 / 3.05, steps=max(8, round(200.0 / angle))),
            asked=0.5,
            weak=TOO_LONG_STEPS.get(angle, {}),
        )
