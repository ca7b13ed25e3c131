"""Drift of invariants over a million steps and more: rounding, and the law by which it grows."""

from collections.abc import Iterator

from rigidmc.studies.stress.case import (
    Case,
    keeps_free_invariants,
    loses_free_invariants,
    only,
)
from rigidmc.studies.stress.motions import conserved, constant, random_tops, tops, walk

TITLE = "very many steps"

STEPS = 1_000_000


def cases() -> Iterator[Case]:
    scene = tops(*random_tops())
    yield Case(
        "free invariants, 1e6 steps",
        "rounding alone: a bias of 1e-17 per step would show",
        "invariants",
        constant(scene, 0.1 * 1e6, conserved, saves=16, steps=STEPS),
        claims=keeps_free_invariants,
    )
    yield Case(
        "free invariants, 1e6 steps, compensated",
        "compensated sums remove the rounding of the state and leave that of the increments",
        "invariants",
        constant(scene, 0.1 * 1e6, conserved, saves=16, steps=STEPS, compensated=True),
        claims=only("exact", "midpoint", "strang", "srkn6"),
    )
    yield Case(
        "rounding walks, it does not march",
        "32 tops over 1e6 steps: the rms drift grows as sqrt(n), not as n",
        "random walk",
        walk(scene, 0.1, STEPS),
        asked=3.0,
        claims=only("exact", "midpoint", "strang"),
    )
    yield Case(
        "rounding over 1e7 steps",
        "ten times as long",
        "random walk",
        walk(scene, 0.1, 10 * STEPS),
        asked=3.0,
        claims=only("exact"),
    )
    yield Case(
        "drift of Runge-Kutta methods, 1e6 steps",
        "1e6 steps of 0.02 rad: energy and |L|^2 drift as h^(order + 1) t",
        "invariants",
        constant(scene, 0.02 * 1e6 / 3.0, conserved, saves=16, steps=STEPS),
        claims=loses_free_invariants,
    )
