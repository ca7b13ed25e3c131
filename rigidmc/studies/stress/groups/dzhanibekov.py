"""Flips of a body that spins about its middle axis (Dzhanibekov effect)."""

from collections.abc import Callable, Iterator

from rigidmc.physics.integrators import INTEGRATORS
from rigidmc.studies.stress.case import Case, makes_steps
from rigidmc.studies.stress.motions import conserved, constant, tops
from rigidmc.studies.stress.truths import flips

TITLE = "Dzhanibekov"

MOMENTS = (1.0, 2.0, 3.0)


def high_order(bound: float) -> Callable[[str], float | None]:
    """A bound that mathematics sets for integrators of order 6 and above."""
    return lambda name: bound if INTEGRATORS[name].order >= 6 else None


def cases() -> Iterator[Case]:
    for eps in (1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12, 1e-13, 1e-15):
        yield Case(
            f"first flip, eps = {eps:g}",
            f"the time of the first flip after a disturbance of {eps:g}: an absolute error"
            f" of 1e-16 would be {1e-16 / eps:.0e} of the disturbance",
            "K(m)/lambda, Jacobi",
            flips(MOMENTS, (eps, 2.0, 0.0), 1),
            asked=high_order(1e-10),
            quick=eps in (1e-4, 1e-13),
        )
    for eps in (1e-2, 1e-3, 1e-4):
        yield Case(
            f"ten flips, eps = {eps:g}",
            "each passage by the unstable axis starts from components of size 1: a rounding"
            " of 1e-16 changes the modulus, and so the time, by 1e-16/eps^2",
            "(2 k + 1) K(m)/lambda, Jacobi",
            flips(MOMENTS, (eps, 2.0, 0.0), 10),
        )
    scene, interval = tops(MOMENTS, (1e-4, 2.0, 0.0)), 36.707819410833642463
    yield Case(
        "invariants over 1e3 flips",
        "4e4 s with a thousand passages by the unstable axis: energy and |L|^2 must not"
        " follow the flips",
        "invariants",
        constant(scene, 1e3 * interval, conserved, saves=100, steps=600_000),
        claims=makes_steps,
    )
