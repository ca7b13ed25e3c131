"""Distributions of the principal moments of inertia, and of the inertia tensor of a body."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import product
from typing import Any

import numpy as np

from rigidmc.errors import SceneError
from rigidmc.inputs.arrays import Array
from rigidmc.mechanics.impossible import causes_text
from rigidmc.mechanics.inertia import elements, symmetric
from rigidmc.mechanics.log_cholesky import cholesky_factor, numbers_of, parameters_of, rates_of
from rigidmc.physics.dynamics.dual_arrays import as_array, has_tangents, plain_numbers, with_values
from rigidmc.scene.distributions import Distribution
from rigidmc.scene.quantities import Source, draw, is_shared
from rigidmc.scene.vector_distributions.protocol import (
    MemberFacts,
    VectorDistribution,
    check_semidefinite,
    numbers,
)


@dataclass(frozen=True)
class SecondMoments(VectorDistribution):
    """Principal moments of inertia from the second moments of mass, TdC (3.15).

    From the second moments a, b, c::

        I1 = b + c,  I2 = c + a,  I3 = a + b

    A body with these moments exists for any positive a, b, c.

    Parameters
    ----------
    values : quantities (3,) [kg m^2]
        (a, b, c)

    Examples
    --------
    >>> distribution = rm.SecondMoments((1.0, 2.0, rm.uniform(0.5, 1.5)))
    >>> moments, mass, centre = rm.Body.from_moments(distribution).sample(0, 0, 1000)
    >>> bool((moments.max(0) <= moments.sum(0) - moments.max(0)).all())
    True
    """

    values: Any

    name = "second_moments"
    variables = ("moments",)
    scaling = {"values": 1}

    def check(self, at: str) -> "SecondMoments":
        return SecondMoments(numbers(self.values, f"{at}.values", 3))

    def sample(
        self, sampler: Source, name: str, first: int, count: int, facts: MemberFacts | None
    ) -> Array:
        a, b, c = draw(self.values, sampler, f"{name}.second", first, count)
        return np.stack([b + c, c + a, a + b])


class TensorDistribution(VectorDistribution):
    """Inertia tensors that differ between members, each with principal axes of its own."""

    def mean_tensor(self, mass: Any) -> Array:
        """Return the tensor (3, 3) whose axes label the axes of the members."""
        raise NotImplementedError

    def resized(self, mass: float, length: float) -> "TensorDistribution":
        """Return the distribution in units that multiply masses and lengths by these factors."""
        raise NotImplementedError

    def bodies(
        self, sampler: Source, name: str, first: int, count: int, mass: Any, centre: Sequence[Any]
    ) -> Array:
        """Return parameters (10, count) of the members, see `rigidmc.mechanics.log_cholesky`."""
        raise NotImplementedError

    def check_body(self, mass: Any, centre: Sequence[Any]) -> None:
        """Raise SceneError for a mass or a centre of mass that the distribution excludes."""
        raise NotImplementedError


# the parameters of a body in the order of a covariance, as scenes name them
ELEMENTS = (
    *(f"tensor.{i}.{j}" for i, j in ((1, 1), (2, 2), (3, 3), (2, 3), (3, 1), (1, 2))),
    *(f"centre.{i}" for i in (1, 2, 3)),
    "mass",
)


@dataclass(frozen=True)
class UncertainInertia(TensorDistribution):
    """An inertia tensor, optionally with centre of mass and mass, with a given covariance.

    The log-Cholesky numbers of the body are normal (`rigidmc.mechanics.log_cholesky`); the given
    covariance, propagated to first order, is their covariance. Every draw is therefore a possible
    body. For a compact body with moments known to 5 %, the drawn means are off by at most 0.01
    standard deviations, the standard deviations by 2 % and the correlations by 0.03. The small
    moment of a slender body spreads more, because it is at least the difference of the other two:
    for moments (10, 56, 60) known to 2 %, its standard deviation is too large by 1 % if the errors
    of the large two have the correlation 0.9, and by half if they are independent
    (`tests/scene/test_uncertain_inertia.py`). Draw a sample, `body.sample(0, 0, 10000)`, and
    compare.
    Source: Rucker & Wensing, IEEE Robotics and Automation Letters 7 (2022) 2771.

    The members share the axes of the tensor: the start, the body-fixed vectors of effects and
    results are in these. The principal axes differ between members, and each has the number of the
    nearest axis of the tensor; `principal_axes` of the result has their attitude, and
    `ds.rigid.principal("omega")` transforms to them. With `Body.from_tensor(..., axes="principal")`
    starts and effects are in the principal axes of the mean tensor, and results in the principal
    axes of each member.

    Parameters
    ----------
    mean : array_like (3, 3) [kg m^2]
        inertia tensor about the fixed point
    covariance : array_like (6, 6), (9, 9) or (10, 10)
        covariance of the elements xx, yy, zz, yz, zx, xy [kg m^2]; then of the components of the
        centre of mass [m] and of the mass [kg], whose means are `centre` and `mass` of the body. A
        product of inertia is an element of the tensor: I_xy = -int x y dm. Zeros mark exact values
    centre : array_like (3,), optional [m]
        mean centre of mass from the origin of the tensor, for a body that rotates about its centre
        of mass, such as a satellite: the tensor I of each draw about the origin becomes
        I - m (c^2 1 - c c^T), with the m and c of the draw. `Body.with_pivot_at_centre` makes this
        distribution

    Examples
    --------
    >>> distribution = rm.UncertainInertia(np.diag([2.0, 2.5, 3.0]), 0.01 * np.eye(6))
    >>> moments, mass, centre = rm.Body.from_tensor(distribution).sample(0, 0, 1000)
    >>> bool((moments.max(0) <= moments.sum(0) - moments.max(0)).all())
    True
    """

    mean: Any
    covariance: Any
    centre: Any = None

    name = "uncertain_inertia"
    variables = ("tensor",)
    units = {"mean": "kg m2", "covariance": "kg2 m4", "centre": "m"}

    def check(self, at: str) -> "UncertainInertia":
        mean = check_semidefinite(self.mean, f"{at}.mean", (3,))
        covariance = check_semidefinite(self.covariance, f"{at}.covariance", (6, 9, 10))
        centre = self.centre if self.centre is None else numbers(self.centre, f"{at}.centre", 3)
        if centre is not None and not all(isinstance(x, float) for x in centre):
            raise SceneError("expected plain numbers, the mean", at=f"{at}.centre")
        return UncertainInertia(mean, covariance, centre)

    def check_body(self, mass: Any, centre: Sequence[Any]) -> None:
        for key, value in (("mass", mass), ("centre", tuple(centre))):
            if not is_shared(value):
                rule = "must be plain numbers, the mean, if the tensor is uncertain"
                raise SceneError(rule, at=f"body.{key}")
        if self.centre is not None and any(centre):
            rule = (
                "omit this: the uncertain tensor has its own centre, and the body rotates about it"
            )
            raise SceneError(rule, at="body.centre", value=list(centre))

    def mean_tensor(self, mass: float) -> Array:
        """Return the mean tensor (3, 3) about the fixed point of the body.

        mass : mean mass
        """
        if self.centre is None:
            return np.array(self.mean)
        six = about_centre(elements(self.mean), self.centre, mass)
        tensor: Array = symmetric(np.array(six)[:, None])[0]
        return tensor

    def with_exact_centre(self) -> "UncertainInertia":
        """Return the distribution without the uncertainty of the centre of mass, as for a tensor
        about the centre of mass that is also the fixed point."""
        free = range(6, 9)
        covariance = tuple(
            tuple(0.0 if i in free or j in free else x for j, x in enumerate(row))
            for i, row in enumerate(self.covariance)
        )
        return replace(self, covariance=covariance)

    def names_of_draws(self) -> tuple[str, ...]:
        """Return the name of the uncertain number behind each normal deviate.

        An element that is independent of all others has a name of its own, such as "tensor.1.2",
        "centre.3" or "mass". Correlated elements have one name together, such as
        "tensor.1.1+tensor.2.2", or "tensor" if this is all: no index belongs to one of them alone.
        Exact elements, whose deviates change nothing, have the name of the first uncertain ones.
        """
        size = len(self.covariance)
        groups = list(range(size))
        for i, j in product(range(size), repeat=2):
            if i < j and self.covariance[i][j] != 0.0:
                old, new = groups[j], groups[i]
                groups = [new if group == old else group for group in groups]
        uncertain = [i for i in range(size) if self.covariance[i][i] > 0.0]
        names = {
            group: "+".join(ELEMENTS[i] for i in uncertain if groups[i] == group)
            for group in dict.fromkeys(groups[i] for i in uncertain)
        }
        if len(names) == 1 and len(uncertain) > 1:
            names = dict.fromkeys(names, "tensor")
        first = next(iter(names.values()), "tensor")
        return tuple(names.get(group, first) for group in groups)

    def resized(self, mass: float, length: float) -> "UncertainInertia":
        """Return the distribution in units that multiply masses and lengths by these factors."""
        inertia = mass * length * length
        by = ((inertia,) * 6 + (length,) * 3 + (mass,))[: len(self.covariance)]
        return UncertainInertia(
            tuple(tuple(inertia * x for x in row) for row in self.mean),
            tuple(
                tuple(a * b * x for b, x in zip(by, row, strict=True))
                for a, row in zip(by, self.covariance, strict=True)
            ),
            self.centre if self.centre is None else tuple(length * x for x in self.centre),
        )

    def bodies(
        self, sampler: Source, name: str, first: int, count: int, mass: Any, centre: Sequence[Any]
    ) -> Array:
        """Return parameters (10, count) of the members, see `rigidmc.mechanics.log_cholesky`.

        mass, centre : means. If the body rotates about its centre of mass, the returned tensor is
            about the centre of mass, and the returned centre is 0
        """
        turns = self.centre is not None
        normal = (Distribution("normal", (0.0, 1.0)),) * len(self.covariance)
        z = draw(normal, sampler, f"{name}.normal", first, count)
        middle, ways = _spread_of(self, mass, tuple(self.centre if turns else centre))
        drawn = parameters_of(
            np.stack(
                [
                    at + sum(way[i] * deviate for way, deviate in zip(ways, z, strict=True))
                    for i, at in enumerate(middle)
                ]
            )
        )
        if turns:
            drawn[:6], drawn[6:9] = about_centre(drawn[:6], drawn[6:9], drawn[9]), 0.0
        return drawn


def about_centre(six: Any, centre: Any, mass: Any) -> tuple[Any, ...]:
    """Return xx, yy, zz, yz, zx, xy of I - m (c^2 1 - c c^T), TdC (3.28), element by element, so
    that no bit depends on a library."""
    xx, yy, zz, yz, zx, xy = six
    x, y, z = centre
    return (
        xx - mass * (y * y + z * z),
        yy - mass * (z * z + x * x),
        zz - mass * (x * x + y * y),
        yz + mass * (y * z),
        zx + mass * (z * x),
        xy + mass * (x * y),
    )


def _spread_of(
    distribution: UncertainInertia, mass: Any, centre: tuple[Any, ...]
) -> tuple[Any, Any]:
    """Return `_spread`, with tangents if its arguments have any."""
    arguments = distribution.mean, distribution.covariance, mass, centre
    if not has_tangents(arguments):
        return _spread(distribution, mass, centre)
    mean, covariance, *others = plain_numbers(arguments)
    values = _spread(replace(distribution, mean=mean, covariance=covariance, centre=None), *others)
    # Python may sum its floats more exactly than NumPy its arrays
    spread: tuple[Any, Any] = with_values(_spread.__wrapped__(distribution, mass, centre), values)
    return spread


@lru_cache(maxsize=8)
def _spread(
    distribution: UncertainInertia, mass: float, centre: tuple[float, ...]
) -> tuple[Any, Any]:
    """Return (log-Cholesky numbers of the mean body, their change per standard normal deviate);
    SceneError if the mean body cannot exist."""
    parameters = (*elements(distribution.mean), *centre, mass)
    try:
        middle = numbers_of(parameters)
    except (ValueError, ZeroDivisionError):
        rule = "no body can have this tensor, mass and centre of mass, or the body is flat"
        raise SceneError(
            rule + causes_text(distribution.mean, mass, centre),
            at="body.tensor",
            value=[list(row) for row in distribution.mean],
        ) from None
    columns = zip(*cholesky_factor(distribution.covariance), strict=True)
    rest = [0.0] * (len(parameters) - len(distribution.covariance))
    ways = [rates_of(parameters, [*column, *rest]) for column in columns]
    # Half of this second difference shifts the means: of moments known to 10 % by 0.2 to 0.3
    # standard deviations, of which the correction leaves 0.004.
    around = [
        [m + sign * w for m, w in zip(middle, way, strict=True)]
        for way in ways
        for sign in (1.0, -1.0)
    ]
    bent = parameters_of(as_array(around).T) - as_array(parameters)[:, None]
    moved = [0.5 * sum(row) for row in bent.tolist()]
    back = rates_of(parameters, moved)
    return [m - b for m, b in zip(middle, back, strict=True)], ways
