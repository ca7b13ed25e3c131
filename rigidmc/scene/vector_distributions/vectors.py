"""Distributions of any vector: cones, spheres and correlated normal vectors; and the uniform
directions and attitudes that they use.
"""

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from rigidmc.errors import SceneError
from rigidmc.inputs.arrays import Array, floats
from rigidmc.inputs.labelled import Wanted
from rigidmc.physics.dynamics.dual_arrays import square_root
from rigidmc.physics.dynamics.functions import cosine, sine
from rigidmc.physics.dynamics.so3 import sincos
from rigidmc.scene.distributions import Common, Distribution, uniform
from rigidmc.scene.quantities import Source, draw
from rigidmc.scene.vector_distributions.protocol import (
    MemberFacts,
    VectorDistribution,
    number,
    numbers,
)

AROUND = Distribution("uniform", (0.0, 2.0 * math.pi))


@dataclass(frozen=True)
class Cone(VectorDistribution):
    """A vector of given size at a given angle from an axis of the body.

    Components along the axis, the next axis, and the one after it::

        size (cos angle, sin angle cos azimuth, sin angle sin azimuth)

    Parameters
    ----------
    axis : int
        1, 2, 3, or -1, -2, -3 for the other end of the axis
    size : quantity [rad/s or kg m^2/s]
        length of the vector, an angular velocity or an angular momentum
    angle : quantity [rad]
        angle from the axis
    azimuth : quantity, optional [rad]
        angle about the axis, from the next axis; by default uniform

    Examples
    --------
    >>> start = rm.Start(omega=rm.Cone(axis=3, size=10.0, angle=rm.uniform(0.0, 0.1)))
    >>> start.spin_name
    'omega'
    """

    axis: int
    size: Any
    angle: Any
    azimuth: Any = AROUND

    name = "cone"
    variables = ("omega", "momentum")
    scaling = {"size": 1}
    units = {"angle": "rad", "azimuth": "rad"}

    def check(self, at: str) -> "Cone":
        if isinstance(self.axis, bool) or self.axis not in (1, 2, 3, -1, -2, -3):
            rule = "expected 1, 2 or 3, or -1, -2, -3 for the other end of the axis"
            raise SceneError(rule, at=f"{at}.axis", value=self.axis)
        return Cone(
            int(self.axis),
            number(self.size, f"{at}.size", least=0.0),
            number(self.angle, f"{at}.angle"),
            number(self.azimuth, f"{at}.azimuth"),
        )

    def sample(
        self, sampler: Source, name: str, first: int, count: int, facts: MemberFacts | None
    ) -> Array:
        quantities = (self.size, self.angle, self.azimuth)
        size, angle, azimuth = draw(quantities, sampler, f"{name}.cone", first, count)
        parts = (
            math.copysign(1.0, self.axis) * size * cosine(angle),
            size * sine(angle) * cosine(azimuth),
            size * sine(angle) * sine(azimuth),
        )
        first_place = abs(self.axis) - 1
        return np.stack([parts[(i - first_place) % 3] for i in range(3)])


@dataclass(frozen=True)
class Sphere(VectorDistribution):
    """A vector of given size in a uniform random direction.

    For `momentum` this is the momentum sphere `|L|` = size.

    Parameters
    ----------
    size : quantity [rad/s or kg m^2/s]
        length of the vector, an angular velocity or an angular momentum

    Examples
    --------
    >>> start = rm.Start(momentum=rm.Sphere(2.0))
    >>> name, l = start.sample_spin(0, 0, 5, None)
    >>> np.linalg.norm(l, axis=0).round(12).tolist()
    [2.0, 2.0, 2.0, 2.0, 2.0]
    """

    size: Any

    name = "sphere"
    variables = ("omega", "momentum")
    scaling = {"size": 1}

    def check(self, at: str) -> "Sphere":
        return Sphere(number(self.size, f"{at}.size", least=0.0))

    def sample(
        self, sampler: Source, name: str, first: int, count: int, facts: MemberFacts | None
    ) -> Array:
        size = draw((self.size,), sampler, f"{name}.size", first, count)
        return size * directions(sampler, name, first, count)


@dataclass(frozen=True)
class Correlated(VectorDistribution):
    """A normal vector of given mean and covariance.

    With z standard normal::

        v = mean + C z,  C C^T = covariance, C lower triangular (Cholesky)

    For moments, these are measured moments with their covariance. Members with impossible moments
    are flagged invalid_input, and a note counts them.

    Parameters
    ----------
    mean : array_like (3,) [rad/s, kg m^2/s or kg m^2]
        mean of the vector, or of the moments
    covariance : array_like (3, 3) [square of that unit]
        covariance, symmetric and positive definite

    Examples
    --------
    >>> covariance = [[1e-4, 5e-5, 0.0], [5e-5, 1e-4, 0.0], [0.0, 0.0, 1e-4]]
    >>> body = rm.Body.from_moments(rm.Correlated((2.0, 2.5, 3.0), covariance))
    """

    mean: Any
    covariance: Any

    name = "correlated"
    variables = ("omega", "momentum", "moments")
    scaling = {"mean": 1, "covariance": 2}

    def check(self, at: str) -> "Correlated":
        return Correlated(
            numbers(self.mean, f"{at}.mean", 3), _covariance(self.covariance, f"{at}.covariance")
        )

    def sample(
        self, sampler: Source, name: str, first: int, count: int, facts: MemberFacts | None
    ) -> Array:
        normal = (Distribution("normal", (0.0, 1.0)),) * 3
        z = draw(normal, sampler, f"{name}.normal", first, count)
        factor = lower_factor(self.covariance)
        return np.stack(
            [self.mean[i] + sum(factor[i][j] * z[j] for j in range(i + 1)) for i in range(3)]
        )


@dataclass(frozen=True)
class CorrelatedPart(Common):
    """A component of a Correlated vector that is a parameter of an effect.

    Its parameters are its mean and its row of C. The three components of a vector are drawn from
    the three words of one draw.
    """

    stream: ClassVar[str] = ""  # its own draw
    whole: Correlated
    index: int

    def times(self, by: float) -> "CorrelatedPart":
        law = self.whole
        covariance = tuple(tuple(by * by * x for x in row) for row in law.covariance)
        return parts_of(Correlated(tuple(by * x for x in law.mean), covariance))[self.index]

    def as_table(self) -> dict[str, Any]:
        raise SceneError("is one component of a correlated vector: give the whole vector")


def parts_of(law: Correlated) -> tuple[CorrelatedPart, ...]:
    """Return the three components of a checked Correlated vector of plain numbers."""
    rows = enumerate(zip(law.mean, lower_factor(law.covariance), strict=True))
    return tuple(CorrelatedPart("correlated", (mean, *row), law, i) for i, (mean, row) in rows)


def whole_of(value: Any) -> Correlated | None:
    """Return the Correlated vector of three components, None for other values."""
    if not (isinstance(value, tuple) and len(value) == 3):
        return None
    law = getattr(value[0], "whole", None)
    is_one = all(isinstance(x, CorrelatedPart) and x.whole == law for x in value)
    return law if is_one else None


def lower_factor(c: Any) -> tuple[tuple[float, ...], ...]:
    """Return the rows of the lower Cholesky factor of a symmetric 3x3 matrix."""
    # written out, not by LAPACK: its digits differ between machines, and tangents pass through
    a = square_root(c[0][0])
    b, d = c[1][0] / a, c[2][0] / a
    e = square_root(c[1][1] - b * b)
    f = (c[2][1] - d * b) / e
    return (a,), (b, e), (d, f, square_root(c[2][2] - d * d - f * f))


def _covariance(value: Any, at: str) -> tuple[tuple[float, ...], ...]:
    """Return a symmetric positive definite 3x3 matrix as a tuple of rows; SceneError."""
    rule = "expected a symmetric matrix of 3x3 finite numbers"
    matrix = floats(value, at, rule=rule, wanted=Wanted((3,), is_matrix=True))
    if matrix.shape != (3, 3) or not np.isfinite(matrix).all():
        raise SceneError(rule, at=at, value=matrix.tolist())
    if np.abs(matrix - matrix.T).max() > 1e-9 * np.abs(matrix).max():
        raise SceneError(rule, at=at, value=matrix.tolist())
    if np.linalg.eigvalsh(matrix).min() <= 0.0:
        rule = "expected a positive definite matrix: all variances must be positive"
        raise SceneError(rule, at=at, value=matrix.tolist())
    return tuple(map(tuple, matrix.tolist()))


def uniform_attitudes(u: Array, v: Array, w: Array) -> Array:
    """Return unit quaternions (4, n), uniform on SO(3), from numbers (n,) uniform in (0, 1).

    Source: Shoemake, Graphics Gems III (1992) 124.
    """
    a, b = np.sqrt(1.0 - u), np.sqrt(u)
    (sine_v, cosine_v), (sine_w, cosine_w) = sincos(2.0 * np.pi * v), sincos(2.0 * np.pi * w)
    return np.stack([b * cosine_w, a * sine_v, a * cosine_v, b * sine_w])


def directions(sampler: Source, name: str, first: int, count: int) -> Array:
    """Draw unit vectors (3, n), uniform on the sphere: the cosine of the polar angle and the
    azimuth are uniform."""
    laws = (uniform(-1.0, 1.0), uniform(0.0, 2.0 * math.pi))
    z, phi = draw(laws, sampler, f"{name}.direction", first, count)
    # 1 - z^2 would lose digits near the poles
    r, (y, x) = np.sqrt((1.0 - z) * (1.0 + z)), sincos(phi)
    return np.stack([r * x, r * y, z])
