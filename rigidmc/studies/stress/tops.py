"""The scenes of the hard cases: tops from plain numbers, and some attitudes and bodies."""

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rigidmc.effects.damping import ViscousDamping
from rigidmc.effects.gravity import Gravity
from rigidmc.scene.body import Body
from rigidmc.scene.scene import Scene
from rigidmc.scene.start import Start

GRAVITY = (Gravity(1.0),)
UPRIGHT, HANGING = (1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0)


def tops(
    moments: ArrayLike,
    momentum: ArrayLike,
    attitude: ArrayLike = (1.0, 0.0, 0.0, 0.0),
    weight: ArrayLike = (0.0, 0.0, 0.0),
    damping: float = 0.0,
    g: float = 1.0,
) -> Scene:
    """A Scene of tops: each argument is a tuple of numbers, or an array with one row per member.

    weight : m g r [N m];  damping : rate of viscous damping [1/s]
    """
    columns = [np.asarray(x, dtype=float) for x in (moments, momentum, attitude, weight)]
    members = max(len(c) if c.ndim == 2 else 0 for c in columns)
    if members:
        columns = [np.array(np.broadcast_to(c, (members, c.shape[-1]))) for c in columns]
    given: list[Any] = [c if members else tuple(c.tolist()) for c in columns]
    effects: tuple[Any, ...] = (Gravity(g),) if np.any(columns[3]) else ()
    effects += (ViscousDamping(damping),) if damping else ()
    body = Body.from_moments(given[0], centre=given[3])
    return Scene(body, effects, Start(momentum=given[1], attitude=given[2]))


def leaning(theta: float) -> tuple[float, float, float, float]:
    """The attitude whose third axis leans by theta [rad] from the vertical."""
    return math.cos(0.5 * theta), math.sin(0.5 * theta), 0.0, 0.0


def rotated(axis: NDArray[np.float64], angle: float) -> NDArray[np.float64]:
    """The quaternion of a rotation by an angle [rad] about an axis of any length."""
    vector = math.sin(0.5 * angle) * axis / np.linalg.norm(axis)
    return np.array([math.cos(0.5 * angle), *vector])


def random_tops(count: int = 32, seed: int = 1) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(moments, momenta) of random bodies of unit size and spin, one row each."""
    random = np.random.default_rng(seed)
    second = random.uniform(0.1, 1.0, (count, 3))
    moments = (second.sum(1, keepdims=True) - second) / second.sum(1, keepdims=True)
    momentum = random.normal(size=(count, 3))
    return moments, momentum / np.linalg.norm(momentum, axis=1, keepdims=True) * 0.5
