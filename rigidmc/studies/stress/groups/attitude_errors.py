"""The measure of attitude errors itself, at very small angles."""

import math
from collections.abc import Iterator

import numpy as np

from rigidmc.mechanics.rotation import attitude_error
from rigidmc.physics.dynamics.so3 import multiply
from rigidmc.studies.stress.case import Case, only

TITLE = "attitude errors"


def error(integrator: str, share: float) -> float:
    """Largest error of the angle between q and q rotated by 0.1 to 1e-15 rad, with either sign."""
    q, angles = np.array((0.1, -0.5, 0.7, 0.5)), 10.0 ** -np.arange(1.0, 16.0)
    q /= np.linalg.norm(q)
    half = [(math.cos(0.5 * a), 0.0, math.sin(0.5 * a), 0.0) for a in angles]
    rotated = np.array([multiply(tuple(q), step) for step in half])
    measured = attitude_error(np.concatenate([rotated, -rotated]), q)
    return float(np.abs(measured - np.tile(angles, 2)).max())


def cases() -> Iterator[Case]:
    yield Case(
        "angles of 0.1 to 1e-15 rad",
        "2 arccos |p.q| is 0 for all angles below 1e-8; q and -q are one attitude",
        "the angle of the rotation",
        error,
        asked=1e-15,
        claims=only("exact"),
        quick=True,
    )
