"""What a body is: mass, centre of mass, principal moments about the fixed point, and their axes."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rigidmc.arrays import floats
from rigidmc.errors import SceneError
from rigidmc.mechanics import inertia, rotation
from rigidmc.scene.body_changes import BodyChanges
from rigidmc.scene.quantities import Source, draw, is_shared, is_variable, quantity, vector
from rigidmc.scene.shape import Shape
from rigidmc.scene.vector_distributions import check_distribution
from rigidmc.scene.vector_distributions.bodies import UncertainInertia
from rigidmc.scene.vector_distributions.protocol import VectorDistribution, flat_parameters

Array = NDArray[np.float64]
IDENTITY = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))

_Turn = TypeVar("_Turn", bound=Callable[..., Array])


def _between_axes(source: str, target: str, example: str) -> Callable[[_Turn], _Turn]:
    """Complete the docstring of a method that takes a vector or an attitude from the one axes to
    the other ones."""

    def completed(method: _Turn) -> _Turn:
        (name,) = (word for word in method.__annotations__ if word != "return")
        many, size = ("components in", 3) if name == "vector" else ("quaternions of", 4)
        method.__doc__ = f"""{method.__doc__}

        Parameters
        ----------
        {name} : array_like (..., {size})
            {many} the {source} axes

        Returns
        -------
        numpy.ndarray (..., {size})
            {many} the {target} axes

        Examples
        --------
        {example}
        """
        return method

    return completed


@dataclass(frozen=True, eq=False)
class Body(BodyChanges):
    """A rigid body that turns about a fixed point, the origin of the axes in which it is described.

    A quantity is a number, a distribution, a grid, or an array with one row per member.

    Parameters
    ----------
    moments : quantities (3,), array_like (members, 3) or distribution [kg m^2]
        principal moments (I1, I2, I3) about the fixed point. The distributions are SecondMoments,
        whose bodies always exist, Correlated, measured moments with their covariance, and
        UncertainInertia, a measured tensor with its covariance
    mass : quantity, optional [kg]
        of the body
    centre : quantities (3,), optional [m]
        centre of mass from the fixed point, in the described axes
    axes : tuple (3, 3), optional
        its columns are the principal axes in the described axes, right-handed; the identity unless
        the body was given by a tensor, by particles or by a shift
    shape : tuple of Part, optional
        the solids that pictures draw; makers of bodies know them, no motion depends on them

    Raises
    ------
    SceneError
        for moments that are not positive or break the triangle inequality I_i <= I_j + I_k

    Examples
    --------
    >>> body = rm.Body((1.0, 2.0, rm.normal(2.5, 0.01)), mass=3.0, centre=(0.0, 0.0, 0.1))
    >>> rm.Body((1.0, 2.0, 4.0))  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    rigidmc.errors.SceneError: [body] moments = [1.0, 2.0, 4.0]: the triangle inequality is...
    """

    _OLD_NAMES = {
        "about_centre": "with_pivot_at_centre",
        "given": "inertia_key",
        "joined": "join",
        "own_attitude": "reference_attitude",
        "pivoted_at": "with_pivot",
        "to_own": "to_reference",
        "without": "subtract",
    }

    moments: Any
    mass: Any = 1.0
    centre: Any = (0.0, 0.0, 0.0)
    axes: tuple[tuple[float, ...], ...] = IDENTITY
    shape: Shape = ()

    def __post_init__(self) -> None:
        whole = isinstance(self.moments, VectorDistribution)
        uncertain = isinstance(self.moments, UncertainInertia)
        check = check_distribution if whole else vector
        object.__setattr__(self, "moments", check(self.moments, f"body.{self.inertia_key}"))
        object.__setattr__(self, "mass", quantity(self.mass, "body.mass"))
        object.__setattr__(self, "centre", vector(self.centre, "body.centre"))
        if isinstance(self.moments, UncertainInertia):
            self._check_uncertain(self.moments)
        else:
            object.__setattr__(self, "axes", _checked_axes(self.axes))
        if not uncertain and self.axes != IDENTITY and not is_shared(self.centre):
            rule = "a body given by a tensor takes plain numbers; give principal moments instead"
            raise SceneError(rule, at="body.centre")
        if not is_variable(self.mass) and not np.min(self.mass) > 0:
            shown = self.mass if is_shared(self.mass) else None
            raise SceneError("the mass must be positive", at="body.mass", value=shown)
        if not whole:
            self._check_moments()

    @property
    def inertia_key(self) -> str:
        """The key of a scene file by which its inertia is given, "moments" or "tensor".

        Examples
        --------
        >>> rm.Body((1.0, 2.0, 2.5)).inertia_key
        'moments'
        """
        return "tensor" if isinstance(self.moments, UncertainInertia) else "moments"

    def _check_uncertain(self, distribution: UncertainInertia) -> None:
        """Take the axes of the mean tensor; SceneError for a mean body that cannot be."""
        for key in ("mass", "centre"):
            if not is_shared(getattr(self, key)):
                rule = "beside an uncertain tensor it is a plain number, the mean"
                raise SceneError(rule, at=f"body.{key}")
        if distribution.centre is not None and any(self.centre):
            rule = "the tensor has a centre of its own, about which the body turns: leave this out"
            raise SceneError(rule, at="body.centre", value=list(self.centre))
        distribution.bodies(0, "body.tensor", 0, 1, self.mass, self.centre)
        _, axes = inertia.principal_axes(distribution.mean_tensor(self.mass))
        object.__setattr__(self, "axes", tuple(map(tuple, axes.tolist())))

    def _check_moments(self) -> None:
        """SceneError for moments that no body can have; distributions are checked when drawn."""
        shown = list(self.moments) if is_shared(self.moments) else None
        known = [m for m in self.moments if not is_variable(m)]
        if not all(np.min(m) > 0 for m in known):
            raise SceneError("principal moments must be positive", at="body.moments", value=shown)
        if len(known) < 3:
            return
        moments = np.array(np.broadcast_arrays(*self.moments)).reshape(3, -1)
        bad = np.flatnonzero(inertia.violates_triangle(moments))
        if bad.size:
            values = moments[:, bad[0]].tolist()
            large, rest = max(values), sum(values) - max(values)
            row = "" if is_shared(self.moments) else f"row {bad[0]}: "
            rule = (
                f"{row}the triangle inequality is broken: {large:g} exceeds the sum of the other"
                f" two, {rest:g}; no rigid body has these moments"
            )
            raise SceneError(rule, at="body.moments", value=shown)

    @_between_axes(
        "described",
        "principal",
        """>>> body = rm.Body.from_tensor([[2.0, 0.5, 0.0], [0.5, 2.0, 0.0], [0.0, 0.0, 3.0]])
        >>> body.to_principal((0.0, 0.0, 1.0)).round(12).tolist()
        [0.0, 0.0, 1.0]""",
    )
    def to_principal(self, vector: ArrayLike) -> Array:
        """Resolve vectors in the principal axes, as in results."""
        components: Array = floats(vector, "vector", 3) @ np.array(self.axes)
        return components

    @_between_axes(
        "principal",
        "described",
        """>>> body = rm.Body.from_tensor([[2.0, 0.5, 0.0], [0.5, 2.0, 0.0], [0.0, 0.0, 3.0]])
        >>> body.to_reference((0.0, 0.0, 1.0)).round(12).tolist()
        [0.0, 0.0, 1.0]""",
    )
    def to_reference(self, vector: ArrayLike) -> Array:
        """Resolve vectors, such as omega and momentum of a result, in the described axes."""
        components: Array = floats(vector, "vector", 3) @ np.array(self.axes).T
        return components

    @_between_axes(
        "principal",
        "described",
        """>>> rm.Body((1.0, 2.0, 2.5)).reference_attitude((0.6, 0.8, 0.0, 0.0)).round(12).tolist()
        [0.6, 0.8, 0.0, 0.0]""",
    )
    def reference_attitude(self, attitude: ArrayLike) -> Array:
        """Turn attitudes of the principal axes, as in results, into those of the described axes."""
        inverse = rotation.quaternion(np.array(self.axes)) * np.array([1.0, -1.0, -1.0, -1.0])
        return rotation.product(rotation.quaternion(attitude), inverse)

    @_between_axes(
        "described",
        "principal",
        """>>> rm.Body((1.0, 2.0, 2.5)).principal_attitude((0.6, 0.8, 0.0, 0.0)).round(12).tolist()
        [0.6, 0.8, 0.0, 0.0]""",
    )
    def principal_attitude(self, attitude: ArrayLike) -> Array:
        """Turn attitudes of the described axes into those of the principal axes, for `Start`."""
        axes = rotation.quaternion(np.array(self.axes))
        return rotation.product(rotation.quaternion(attitude), axes)

    def angular_momentum(self, omega: ArrayLike) -> Array:
        """Angular momentum, TdC (3.25).

        In the described axes::

            L = I omega

        Parameters
        ----------
        omega : array_like (..., 3) [rad/s]
            angular velocity in the described axes

        Returns
        -------
        numpy.ndarray (..., 3) [kg m^2/s]
            angular momentum in the described axes

        Examples
        --------
        >>> rm.Body((1.0, 2.0, 2.5)).angular_momentum((1.0, 1.0, 2.0)).tolist()
        [1.0, 2.0, 5.0]
        """
        return inertia.angular_momentum(self.tensor, omega)

    def kinetic_energy(self, omega: ArrayLike) -> Array:
        """Kinetic energy, TdC (3.16).

        In the described axes::

            T = 1/2 omega . I omega

        Parameters
        ----------
        omega : array_like (..., 3) [rad/s]
            angular velocity in the described axes

        Returns
        -------
        numpy.ndarray (...) [J]
            T

        Examples
        --------
        >>> float(rm.Body((1.0, 2.0, 2.5)).kinetic_energy((1.0, 1.0, 2.0)))
        6.5
        """
        return inertia.kinetic_energy(self.tensor, omega)

    @property
    def tensor(self) -> Array:
        """Inertia tensor (3, 3) about the fixed point in the described axes [kg m^2].

        Raises
        ------
        ValueError
            unless the moments are plain numbers

        Examples
        --------
        >>> rm.Body((1.0, 2.0, 2.5)).tensor.diagonal().tolist()
        [1.0, 2.0, 2.5]
        """
        if not is_shared(self.moments):
            raise ValueError("a body that differs from member to member has no single tensor")
        axes = np.array(self.axes)
        tensor: Array = (axes * np.array(self.moments)) @ axes.T
        return tensor

    def quantities(self) -> tuple[Any, ...]:
        """All quantities of the body, in one flat tuple.

        Returns
        -------
        tuple
            moments (a distribution of a vector before its numbers), mass, components of the centre

        Examples
        --------
        >>> rm.Body((1.0, 2.0, 2.5)).quantities()
        (1.0, 2.0, 2.5, 1.0, 0.0, 0.0, 0.0)
        """
        moments = self.moments
        if isinstance(moments, VectorDistribution):
            moments = (moments, *flat_parameters(moments))
        return (*moments, self.mass, *self.centre)

    def sample(self, sampler: Source, first: int, count: int) -> tuple[Array, Array, Array]:
        """Moments, mass and centre of mass of members first ... first + count - 1.

        Parameters
        ----------
        sampler : int or point set
            the seed, or the points from which numbers are drawn
        first : int
            index of the first member
        count : int
            number of members

        Returns
        -------
        moments : numpy.ndarray (3, count) [kg m^2]
            principal moments
        mass : numpy.ndarray (count,) [kg]
            masses
        centre : numpy.ndarray (3, count) [m]
            centres of mass in principal axes

        Examples
        --------
        >>> moments, mass, centre = rm.Body((1.0, 2.0, rm.uniform(2.0, 3.0))).sample(0, 0, 5)
        >>> moments.shape, mass.shape, centre.shape
        ((3, 5), (5,), (3, 5))
        """
        return self.sample_turned(sampler, first, count)[:3]

    def sample_turned(
        self, sampler: Source, first: int, count: int
    ) -> tuple[Array, Array, Array, Array | None]:
        """Moments, mass, centre of mass, and principal axes of members first ... first + count - 1.

        Parameters
        ----------
        sampler : int or point set
            the seed, or the points from which numbers are drawn
        first : int
            index of the first member
        count : int
            number of members

        Returns
        -------
        moments, mass, centre : numpy.ndarray
            as of `sample`
        turn : numpy.ndarray (3, 3, count) or None
            its columns are the principal axes in those of the mean tensor; None if all members
            have the same axes

        Examples
        --------
        >>> rm.Body((1.0, 2.0, 2.5)).sample_turned(0, 0, 5)[3] is None
        True
        """
        if isinstance(self.moments, UncertainInertia):
            return self._turned(self.moments, sampler, first, count)
        if isinstance(self.moments, VectorDistribution):
            moments = self.moments.sample(sampler, "body.moments", first, count, None)
        else:
            moments = draw(self.moments, sampler, "body.moments", first, count)
        mass = draw((self.mass,), sampler, "body.mass", first, count)[0]
        centre = draw(self.centre, sampler, "body.centre", first, count)
        if self.axes != IDENTITY:
            centre = self._along_axes(centre)
        return moments, mass, centre, None

    def _along_axes(self, vectors: Array) -> Array:
        """Vectors (3, n) of the described axes, along the principal ones."""
        # written out: a BLAS product may round differently with the number of members
        return np.stack([sum(self.axes[j][i] * vectors[j] for j in range(3)) for i in range(3)])

    def _turned(
        self, distribution: UncertainInertia, sampler: Source, first: int, count: int
    ) -> tuple[Array, Array, Array, Array]:
        """`sample_turned` of a distribution of tensors."""
        *six, x, y, z, mass = distribution.bodies(
            sampler, "body.tensor", first, count, self.mass, self.centre
        )
        moments, axes = inertia.principal_axes(inertia.symmetric(six))
        moments, turn = inertia.match_axes(moments, axes, self.axes)
        centre = self._along_axes(np.stack([x, y, z]))
        return moments, mass, inertia.vectors_into(turn, centre), turn


def _checked_axes(axes: Any) -> tuple[tuple[float, ...], ...]:
    """Axes as a tuple of rows; SceneError unless they are a right-handed set of unit vectors."""
    if isinstance(axes, tuple) and axes == IDENTITY:
        return IDENTITY
    columns = floats(axes, "body.axes", last=3)
    square = columns.shape == (3, 3) and np.isfinite(columns).all()
    # as of `rotation.quaternion_from_matrix`, without an import of scipy
    if not square or np.abs(columns @ columns.T - np.eye(3)).max() > 1e-9:
        rule = "expected 3x3 numbers whose columns are unit vectors at right angles"
        raise SceneError(rule, at="body.axes")
    if np.linalg.det(columns) < 0.0:
        raise SceneError("are left-handed: turn one of them round", at="body.axes")
    return tuple(map(tuple, columns.tolist()))
