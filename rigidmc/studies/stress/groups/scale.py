"""Very large and very small numbers, other units, zeros, denormal numbers, and steps backwards."""

import math
from collections.abc import Iterator

import numpy as np

from rigidmc.physics.effects.gravity import Gravity
from rigidmc.scene.body import Body
from rigidmc.scene.scene import Scene
from rigidmc.scene.start import Start
from rigidmc.studies.stress.case import Case, makes_steps, only, reversible
from rigidmc.studies.stress.motions import GRAVITY, constant, direction, leaning, tops
from rigidmc.studies.stress.truths import (
    against_closed,
    against_turn,
    scaled_alike,
    there_and_back,
)

TITLE = "scale"

MOMENTS, MOMENTUM = np.array((1.0, 1.4, 2.0)), np.array((0.3, 0.9, 0.7))
CENTRE = (0.1, 0.2, 0.3)
# moments [kg m2], momentum [kg m2/s], why
BODIES = {
    "a molecule": (
        np.array((1.0, 1.9, 2.9)) * 1e-47,
        np.array((1.0, 2.0, -1.0)) * 1e-34,
        "water: moments 1e-47 kg m2, 1e13 rad/s",
    ),
    "a dust grain": (
        np.array((1.0, 1.4, 2.0)) * 1e-28,
        np.array((0.3, 0.9, 0.7)) * 1e-24,
        "a tenth of a micrometre: 1e-28 kg m2",
    ),
    "the Earth": (
        np.array((8.008, 8.010, 8.036)) * 1e37,
        np.array((1e27, 0.0, 5.86e33)),
        "8e37 kg m2, moments equal to 3e-4, almost on its axis",
    ),
}


def cases() -> Iterator[Case]:
    yield from _sizes()
    yield from _zeros()
    yield from _backwards()
    yield from _units()


def _sizes() -> Iterator[Case]:
    for exponent in (-300, -150, 150, 300):
        size = 10.0**exponent
        yield Case(
            f"|L| = 1e{exponent}",
            "squares of the momentum overflow or vanish",
            "closed form",
            against_closed(tops(MOMENTS, MOMENTUM * size), 10.0 / size),
            quick=exponent == -300,
        )
    for word, (i, l, why) in BODIES.items():
        end = 100.0 * float(np.min(i) / np.linalg.norm(l))
        error = against_closed(tops(i, l), end)
        yield Case(word, why, "closed form", error, quick=word == "a molecule")
    i, l, _ = BODIES["a molecule"]
    end = 100.0 * float(np.min(i) / np.linalg.norm(l))
    yield Case(
        "a molecule in float32",
        "moments of 1e-47 kg m2 are 0 in single precision",
        "closed form",
        against_closed(tops(i, l), end, turn=0.05, dtype="float32"),
        claims=only("rk4", "exact", "strang", "rotations"),
    )


def _zeros() -> Iterator[Case]:
    signs = np.array([(a, 1.0, b) for a in (1.0, -1.0) for b in (1.0, -1.0)])
    yield Case(
        "1e-165 off the middle axis",
        "the squares that decide about which axis L circles are 0: decided anew at each end"
        " of a step, they would turn the body over",
        "a rotation at constant rate",
        against_turn(tops((0.3, 1.0, 1.3), signs * (1e-165, 1.0, 1e-175)), 20.0, 1.0),
        quick=True,
    )
    yield Case(
        "at rest",
        "L = 0: formulas must not divide by |L|",
        "L = 0 to the bit",
        constant(tops(MOMENTS, (0.0, 0.0, 0.0)), 10.0, direction),
        asked=0.0,
    )
    body = Body.from_moments(tuple(MOMENTS), centre=CENTRE)
    weightless = Scene(body, (Gravity(0.0),), Start(momentum=tuple(MOMENTUM)))
    yield Case(
        "g = 0",
        "gravity is compiled in and must change nothing",
        "closed form",
        against_closed(weightless, 10.0),
        effects=GRAVITY,
    )


def _backwards() -> Iterator[Case]:
    free = tops(tuple(MOMENTS), tuple(MOMENTUM))
    yield Case(
        "there and back",
        "the same steps with h < 0",
        "its own start",
        there_and_back(free, 20.0),
        asked=1e-13,
        claims=reversible,
        quick=True,
    )
    yield Case(
        "there and back, heavy",
        "the same steps with h < 0",
        "its own start",
        there_and_back(_heavy(), 20.0),
        asked=1e-12,
        effects=GRAVITY,
        claims=reversible,
    )
    half = math.sqrt(0.5)
    attitude = (0.0, -half, 1e-311, half)
    swinging = tops((0.3, 1.0, 1.3), (0.0, 0.0, 0.0), attitude, (0.0, 0.0, 1.0))
    yield Case(
        "a pendulum 1e-311 off its plane",
        "components of the attitude that are denormal numbers",
        "its own start",
        there_and_back(swinging, 20.0),
        effects=GRAVITY,
        claims=reversible,
    )


def _units() -> Iterator[Case]:
    for power_of_two, word in ((True, "powers of 2"), (False, "powers of 10")):
        mass, length, time = (2.0**-90, 2.0**-30, 2.0**-20) if power_of_two else (1e-27, 1e-9, 1e-6)
        unit = mass * length**2
        centre = (0.1 * length, 0.2 * length, 0.3 * length)
        small = Scene(
            Body.from_moments(tuple(MOMENTS * unit), mass=mass, centre=centre),
            (Gravity(1.0 * length / time**2),),
            Start(momentum=tuple(MOMENTUM * unit / time), attitude=leaning(1.0)),
        )
        yield Case(
            f"units by {word}",
            "mass, length and time in other units: a dust grain moves as a wheel does",
            "the same scene in the first units",
            scaled_alike(_heavy(), small, 10.0, time, unit / time, power_of_two),
            asked=0.0 if power_of_two else 1e-12,
            effects=GRAVITY,
            claims=makes_steps,
        )


def _heavy() -> Scene:
    return tops(tuple(MOMENTS), tuple(MOMENTUM), leaning(1.0), CENTRE)
