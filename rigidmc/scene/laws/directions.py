"""Uniform directions and uniform attitudes."""

import math

import numpy as np

from rigidmc.dynamics.so3 import sincos
from rigidmc.scene.distributions import uniform
from rigidmc.scene.laws.protocol import Array
from rigidmc.scene.quantities import Source, draw


def uniform_attitudes(u: Array, v: Array, w: Array) -> Array:
    """Unit quaternions (4, n), uniform on SO(3), from numbers (n,) uniform in (0, 1).

    Source: Shoemake, Graphics Gems III (1992) 124.
    """
    a, b = np.sqrt(1.0 - u), np.sqrt(u)
    (sine_v, cosine_v), (sine_w, cosine_w) = sincos(2.0 * np.pi * v), sincos(2.0 * np.pi * w)
    return np.stack([b * cosine_w, a * sine_v, a * cosine_v, b * sine_w])


def directions(source: Source, name: str, first: int, count: int) -> Array:
    """Unit vectors (3, n), uniform on the sphere: the cosine of the polar angle and the azimuth are
    uniform."""
    laws = (uniform(-1.0, 1.0), uniform(0.0, 2.0 * math.pi))
    z, phi = draw(laws, source, f"{name}.direction", first, count)
    r, (y, x) = np.sqrt((1.0 - z) * (1.0 + z)), sincos(phi)
    return np.stack([r * x, r * y, z])
