"""Heavy symmetric tops: equilibria, sleeping tops, cusps, loops and passages by the vertical."""

import math
from collections.abc import Iterator

import numpy as np

from rigidmc.mechanics.rotation import from_euler, omega_from_euler_rates
from rigidmc.studies.stress.case import Case, makes_steps
from rigidmc.studies.stress.motions import (
    GRAVITY,
    HANGING,
    UPRIGHT,
    conserved,
    constant,
    direction,
    leaning,
    tops,
)
from rigidmc.studies.stress.truths import against_closed

TITLE = "heavy symmetric tops"

A, C, K = 1.0, 0.7, 1.3  # moments A, A, C [kg m2] and weight times height K [N m]
MOMENTS, WEIGHT = (A, A, C), (0.0, 0.0, K)

Start = tuple[tuple[float, ...], tuple[float, ...], str]  # attitude, momentum, why


def starts() -> dict[str, Start]:
    """{name: (attitude, momentum, why it is hard)}."""
    rate, critical = math.sqrt(K / A), 2.0 * math.sqrt(A * K)
    homoclinic = np.array(MOMENTS) * omega_from_euler_rates(
        (0.0, math.pi / 3, 0.0),
        (2 * rate / math.sqrt(3), 0.0, (3 * A - C) * rate / (C * math.sqrt(3))),
    )
    return {
        "inverted, at rest": (
            UPRIGHT, (0.0, 0.0, 0.0),
            "an unstable equilibrium: any rounding error makes it fall",
        ),
        "hanging, at rest": (
            HANGING, (0.0, 0.0, 0.0),
            "an equilibrium with |L| = 0: formulas must not divide by |L|",
        ),
        "sleeping, just stable": (
            leaning(1e-3), (0.0, 0.0, critical * math.sqrt(1.001)),
            "C^2 n^2 = 4 A k (1 + 1e-3), leaning by 1e-3: it nutates slowly and far",
        ),
        "sleeping, just unstable": (
            leaning(1e-3), (0.0, 0.0, critical * math.sqrt(0.999)),
            "C^2 n^2 = 4 A k (1 - 1e-3), leaning by 1e-3",
        ),
        "homoclinic": (
            tuple(from_euler((0.0, math.pi / 3, 0.0))), tuple(homoclinic),
            "it takes for ever to reach the vertical; errors grow as the inverse of its distance",
        ),
        "cusps": (leaning(0.9), (0.0, 0.0, 3.0), "the axis stops at every upper turning point"),
        "loops": (leaning(0.9), (0.0, -0.35, 3.0), "the precession reverses"),
        "through the vertical": (
            leaning(1.0), (5.0, 0.0, 0.0), "Euler angles are singular at the vertical",
        ),
        "close by the vertical": (
            leaning(1.0), (5.0, 1e-9, 1e-9), "Euler angles change by pi within 1e-9 s",
        ),
        "pendulum from inverted": (
            leaning(1e-6), (0.0, 0.0, 0.0),
            "it falls from 1e-6 beside the unstable equilibrium, and returns to it",
        ),
        "fast": (leaning(1.0), (0.0, 0.0, 100.0), "a thousand turns in one nutation"),
    }  # fmt: skip


def cases() -> Iterator[Case]:
    for word, (attitude, momentum, why) in starts().items():
        scene = tops(MOMENTS, momentum, attitude, WEIGHT)
        error = against_closed(scene, 4.0 if word == "fast" else 12.0)
        yield Case(word, why, "closed form", error, effects=GRAVITY)
    rest = tops(np.tile(MOMENTS, (2, 1)), np.zeros((2, 3)), np.array([UPRIGHT, HANGING]), WEIGHT)
    yield Case(
        "equilibria stay, 1e5 steps",
        "torques of 1e-17 N m would make the upright top fall within 30 s",
        "L = 0 to the bit",
        constant(rest, 1e3, direction, steps=100_000),
        asked=1e-15,
        effects=GRAVITY,
        claims=makes_steps,
    )
    mixed = tops((1.0, 1.0, 0.7), (0.4, 0.3, 2.0), leaning(0.8), WEIGHT)
    yield Case(
        "energy and L_z, 1e5 steps",
        "a thousand nutations: the energy error of a splitting must stay bounded, and L_z"
        " must be conserved to rounding",
        "invariants",
        constant(mixed, 5e3, conserved, saves=50, steps=100_000),
        effects=GRAVITY,
        claims=makes_steps,
    )
