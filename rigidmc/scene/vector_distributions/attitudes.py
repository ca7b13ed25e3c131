"""Distributions of the attitude: about a mean attitude, and about a direction in space."""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from rigidmc.inputs.arrays import Array
from rigidmc.mechanics.rotation import product, quaternion, quaternion_from_euler
from rigidmc.physics.dynamics.body_axes import body_axes
from rigidmc.physics.dynamics.dual_arrays import DualArray, with_partials
from rigidmc.physics.dynamics.functions import (
    arcsine,
    cosine,
    exponential_of,
    hyperbolic_sine,
    hypotenuse,
    logarithm_of,
    logarithm_of_one_and,
    sine,
)
from rigidmc.physics.dynamics.so3 import arctan2, expm1, multiply
from rigidmc.scene.distributions import Distribution
from rigidmc.scene.quantities import Source, draw
from rigidmc.scene.vector_distributions.protocol import (
    MemberFacts,
    VectorDistribution,
    concentration,
    fixed_vector,
)
from rigidmc.scene.vector_distributions.vectors import directions


@dataclass(frozen=True)
class Fisher(VectorDistribution):
    """Attitudes about a mean attitude: Fisher's distribution of rotation matrices.

    Density (Mardia & Jupp, Directional Statistics, 13.2.3)::

        density ~ exp(kappa tr(M^T R)) = exp(kappa (1 + 2 cos angle))

    For large kappa, each of the three small angles is normal with variance 1/(2 kappa).

    Parameters
    ----------
    attitude : array_like (4,)
        the mean M as a quaternion (w, x, y, z)
    kappa : float
        concentration, 0 (uniform) or more

    Examples
    --------
    >>> distribution = rm.Fisher(attitude=(1.0, 0.0, 0.0, 0.0), kappa=5000.0)
    >>> q = rm.Start(omega=(0.0, 0.0, 1.0), attitude=distribution).sample_attitude(0, 0, 1000)
    >>> bool((2.0 * np.arccos(abs(q[0])) < 0.06).all())  # rad from the mean
    True
    """

    attitude: Any
    kappa: float

    name = "fisher"
    variables = ("attitude",)
    uses_scipy = True  # scipy integrates its distribution function

    def check(self, at: str) -> "Fisher":
        mean = fixed_vector(self.attitude, f"{at}.attitude", 4)
        return Fisher(mean, concentration(self.kappa, f"{at}.kappa"))

    def sample(
        self, sampler: Source, name: str, first: int, count: int, facts: MemberFacts | None
    ) -> Array:
        laws = (Distribution("uniform", (0.0, 1.0)),)
        u = draw(laws, sampler, f"{name}.angle", first, count)[0]
        half = 0.5 * np.interp(u, *_rotation_angles(self.kappa))
        axis = directions(sampler, name, first, count)
        rotation = np.stack([cosine(half), *(sine(half) * axis)], axis=-1)
        return product(quaternion(self.attitude), rotation).T

    def log_density(self, x: Array, moments: Array) -> Array:
        from scipy.special import ive

        twice = 2.0 * self.kappa
        # 1 - cos(angle) = 2 (1 - <q, M>^2); the mean of the density is I0(2 kappa) - I1(2 kappa)
        away = 2.0 * (1.0 - np.square(quaternion(self.attitude) @ x))
        return np.asarray(-twice * away - np.log(ive(0, twice) - ive(1, twice)))


@dataclass(frozen=True)
class Pointing(VectorDistribution):
    """Attitudes with axis 3 about a direction in space: the von Mises-Fisher distribution.

    Density (Mardia & Jupp, Directional Statistics, 9.3.2)::

        density ~ exp(kappa cos angle)

    The cosine c has the distribution function
    (exp(kappa c) - exp(-kappa)) / (exp(kappa) - exp(-kappa)). The rotation about axis 3 is uniform.

    Parameters
    ----------
    direction : array_like (3,)
        (x, y, z) in space
    kappa : float
        concentration, 0 (uniform) or more

    Examples
    --------
    >>> distribution = rm.Pointing(direction=(0.0, 0.0, 1.0), kappa=500.0)
    >>> q = rm.Start(omega=(0.0, 0.0, 1.0), attitude=distribution).sample_attitude(0, 0, 1000)
    >>> bool((q[0] ** 2 + q[3] ** 2 - q[1] ** 2 - q[2] ** 2 > 0.9).all())  # z of axis 3
    True
    """

    direction: Any
    kappa: float

    name = "pointing"
    variables = ("attitude",)

    def check(self, at: str) -> "Pointing":
        direction = fixed_vector(self.direction, f"{at}.direction", 3)
        return Pointing(direction, concentration(self.kappa, f"{at}.kappa"))

    def sample(
        self, sampler: Source, name: str, first: int, count: int, facts: MemberFacts | None
    ) -> Array:
        turn = Distribution("uniform", (0.0, 2.0 * math.pi))
        laws = (Distribution("uniform", (0.0, 1.0)), turn, turn)
        u, azimuth, psi = draw(laws, sampler, f"{name}.pointing", first, count)
        # from 1 - cos theta: the arccosine of tilts of 1e-6 rad (kappa = 1e12) is up to 12 % off
        theta = 2.0 * arcsine(np.sqrt(np.clip(0.5 * _one_less_cosine(self.kappa, u), 0.0, 1.0)))
        x, y, z = self.direction
        tip = quaternion_from_euler(arctan2(x, -y), arctan2(hypotenuse(x, y), z), np.zeros(()))
        return np.stack(multiply(tuple(tip), tuple(quaternion_from_euler(azimuth, theta, psi))))

    def log_density(self, x: Array, moments: Array) -> Array:
        axis = np.array(self.direction) / math.sqrt(sum(c * c for c in self.direction))
        away = 1.0 - axis @ np.stack([row[2] for row in body_axes(tuple(x))[1:]])
        mean = -math.expm1(-2.0 * self.kappa) / (2.0 * self.kappa) if self.kappa else 1.0
        return np.asarray(-self.kappa * away - math.log(mean))


def _one_less_cosine(kappa: Any, u: Array) -> Any:
    """Return 1 - cos angle with distribution function 1 - u, for a concentration that may have
    tangents.

    w = -ln(A)/kappa,  A = 1 - (1 - u) (1 - e^(-2 kappa)),
    dw/dkappa = (2 (1 - u) e^(-2 kappa)/A - w)/kappa, and -2 u (1 - u) at kappa = 0
    """
    if not isinstance(kappa, DualArray):
        if kappa > 0.0:
            return -logarithm_of_one_and((1.0 - u) * expm1(-2.0 * kappa)) / kappa
        return 2.0 * (1.0 - u)
    k = float(kappa.value)
    w, rate = _one_less_cosine(k, u), -2.0 * u * (1.0 - u)
    if k > 0.0:
        inside = 1.0 + (1.0 - u) * expm1(-2.0 * k)
        rate = (2.0 * (1.0 - u) * exponential_of(-2.0 * k) / inside - w) / k
    return with_partials(w, [(kappa, rate)])


@lru_cache(maxsize=64)
def _rotation_angles(kappa: float) -> tuple[Array, Array]:
    """Return (distribution function, angle) of Fisher's distribution at 20,001 angles, dense where
    the density is large.

        density ~ (1 - cos angle) exp(2 kappa cos angle)
    """
    from scipy.integrate import cumulative_simpson

    # Angles at even steps of arsinh(angle/width): interpolation is at most 4e-5 of the standard
    # deviation off up to kappa = 1e8; with even angles 5e-3 at 1e4, and twice it at 1e8.
    width = min(1.0, 1.0 / math.sqrt(2.0 * kappa + 1.0))
    s = np.linspace(0.0, 1.0, 20_001)
    end = logarithm_of(1.0 / width + math.sqrt(1.0 / (width * width) + 1.0))  # arsinh(1/width)
    angle = np.pi * hyperbolic_sine(s * end) * width
    # relative to its size at 0: exp(2 kappa) itself overflows from kappa = 355 on
    density = (1.0 - cosine(angle)) * exponential_of(2.0 * kappa * (cosine(angle) - 1.0))
    total = cumulative_simpson(density, x=angle, initial=0.0)
    return total / total[-1], angle
