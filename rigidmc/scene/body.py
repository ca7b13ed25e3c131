"""A body: mass, centre of mass, principal moments about the fixed point, and principal axes."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rigidmc.errors import SceneError, unknown
from rigidmc.inputs.arrays import check_quaternion_rows, floats, member_vectors
from rigidmc.inputs.labelled import is_labelled
from rigidmc.mechanics import inertia, rotation
from rigidmc.physics.dynamics.dual_arrays import as_array
from rigidmc.scene.body_changes import BodyChanges
from rigidmc.scene.inertia_about import ASSUMED_MASS
from rigidmc.scene.quantities import Source, draw, is_shared, is_variable, quantity, vector
from rigidmc.scene.shape import Shape
from rigidmc.scene.stated import Stated
from rigidmc.scene.units import in_si, vector_in_si
from rigidmc.scene.vector_distributions import check_distribution
from rigidmc.scene.vector_distributions.bodies import TensorDistribution
from rigidmc.scene.vector_distributions.protocol import VectorDistribution, flat_parameters

Array = NDArray[np.float64]
FRAMES = ("described", "principal")
IDENTITY = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))

_Turn = TypeVar("_Turn", bound=Callable[..., Array])


def _between_axes(source: str, target: str, example: str) -> Callable[[_Turn], _Turn]:
    """Complete the docstring of a method that transforms a vector or an attitude from source axes
    to target axes."""

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
    """A rigid body that rotates about a fixed point, the origin of its described axes.

    The described axes are the axes in which the user gives the body. By default they are the body
    axes: starts, effects, observables and results are in them. A quantity is a number, a
    distribution, a grid, or an array with one row per member.

    Parameters
    ----------
    moments : quantities (3,), array_like (members, 3) or distribution [kg m^2]
        principal moments (I1, I2, I3) about the fixed point. Distributions are SecondMoments, which
        draws only possible bodies, Correlated, for measured moments with their covariance, and
        UncertainInertia, for a measured tensor with its covariance
    mass : quantity, optional [kg]
        mass of the body; 1 kg if not given, and where the motion depends on it a note says so
    centre : quantities (3,), optional [m]
        centre of mass from the fixed point, in the described axes
    axes : tuple (3, 3), optional
        its columns are the principal axes in the described axes, right-handed; the identity unless
        the body comes from a tensor, from particles or from a shift
    shape : tuple of ShapePart, optional
        solids that pictures draw; set by the makers of bodies, without effect on the motion
    frame : str, optional
        the axes of everything else in the scene, and of results: "described", the axes in which
        the body is given, or "principal", its principal axes
    has_mass : bool, optional
        whether a mass was given; set by the body, and kept by `dataclasses.replace`
    stated : Stated or str, optional
        the numbers by which the scene states a body whose inertia moved to the fixed point; or why
        a body has no derivative by its stated mass and centre. Set by the makers of bodies, and
        dropped where the body differs from it

    Raises
    ------
    SceneError
        for moments that are not positive or violate the triangle inequality I_i <= I_j + I_k

    Examples
    --------
    >>> body = rm.Body((1.0, 2.0, rm.normal(2.5, 0.01)), mass=3.0, centre=(0.0, 0.0, 0.1))
    >>> rm.Body((1.0, 2.0, 4.0))  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    rigidmc.errors.SceneError: [body] moments = [1.0, 2.0, 4.0]: principal moments must be...
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
    mass: Any = None
    centre: Any = (0.0, 0.0, 0.0)
    axes: tuple[tuple[float, ...], ...] = IDENTITY
    shape: Shape = ()
    frame: str = "described"
    has_mass: bool = True
    stated: Stated | str | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "moments", vector_in_si(self.moments, "kg m2", "body.moments"))
        whole = isinstance(self.moments, VectorDistribution)
        uncertain = isinstance(self.moments, TensorDistribution)
        check = check_distribution if whole else vector
        object.__setattr__(self, "moments", check(self.moments, f"body.{self.inertia_key}"))
        mass = ASSUMED_MASS if self.mass is None else in_si(self.mass, "kg", "body.mass")
        centre = vector_in_si(self.centre, "m", "body.centre")
        # a replaced mass is given; `replace` of other fields hands on that none is
        assumed = self.mass is None or (
            not self.has_mass and is_shared(mass) and mass == ASSUMED_MASS
        )
        object.__setattr__(self, "has_mass", not assumed)
        object.__setattr__(self, "mass", quantity(mass, "body.mass"))
        object.__setattr__(self, "centre", vector(centre, "body.centre"))
        if isinstance(self.moments, TensorDistribution):
            self._check_uncertain(self.moments)
        else:
            object.__setattr__(self, "axes", _checked_axes(self.axes))
        if self.frame not in FRAMES:
            raise unknown("axes", FRAMES, at="body.axes", value=self.frame)
        if not uncertain and self.axes != IDENTITY and not is_shared(self.centre):
            rule = "must be plain numbers for a body given by a tensor; give principal moments"
            raise SceneError(rule, at="body.centre")
        if not is_variable(self.mass) and not np.min(self.mass) > 0:
            shown = self.mass if is_shared(self.mass) else None
            raise SceneError("the mass must be positive", at="body.mass", value=shown)
        if not whole:
            self._check_moments()
        if isinstance(self.stated, Stated):
            numbers = self.moments, self.mass, self.centre
            if not is_shared(*numbers) or not self.stated.is_of(self.tensor, *numbers[1:]):
                object.__setattr__(self, "stated", None)

    @property
    def inertia_key(self) -> str:
        """Key for the inertia in a scene file, "moments" or "tensor".

        Examples
        --------
        >>> rm.Body((1.0, 2.0, 2.5)).inertia_key
        'moments'
        """
        return "tensor" if isinstance(self.moments, TensorDistribution) else "moments"

    def _check_uncertain(self, distribution: TensorDistribution) -> None:
        """Set the axes to the axes of the mean tensor; SceneError for an impossible mean body."""
        distribution.check_body(self.mass, self.centre)
        distribution.bodies(0, "body.tensor", 0, 1, self.mass, self.centre)
        find = inertia.principal_axes if self.frame == "principal" else inertia.nearest_axes
        _, axes = find(distribution.mean_tensor(self.mass))
        object.__setattr__(self, "axes", tuple(map(tuple, axes.tolist())))

    def _check_moments(self) -> None:
        """Raise SceneError for impossible moments; distributions are checked when drawn."""
        shown = list(self.moments) if is_shared(self.moments) else None
        known = [m for m in self.moments if not is_variable(m)]
        if not all(np.min(m) > 0 for m in known):
            raise SceneError("principal moments must be positive", at="body.moments", value=shown)
        if len(known) < 3:
            return
        bad = np.flatnonzero(inertia.violates_triangle(self.moments))
        if bad.size:
            values = np.array([float(m if is_shared(m) else m[bad[0]]) for m in self.moments])
            row = "" if is_shared(self.moments) else f"row {bad[0]}: "
            rule = row + inertia.why_impossible(values)
            raise SceneError(rule, at="body.moments", value=shown)

    @_between_axes(
        "described",
        "principal",
        """>>> body = rm.Body.from_tensor([[2.0, 0.5, 0.0], [0.5, 2.0, 0.0], [0.0, 0.0, 3.0]])
        >>> body.to_principal((0.0, 0.0, 1.0)).round(12).tolist()
        [0.0, 0.0, 1.0]""",
    )
    def to_principal(self, vector: ArrayLike) -> Array:
        """Resolve vectors in the principal axes, of the mean for an uncertain tensor."""
        components: Array = member_vectors(vector, "vector", 3) @ np.array(self.axes)
        return components

    @_between_axes(
        "principal",
        "described",
        """>>> body = rm.Body.from_tensor([[2.0, 0.5, 0.0], [0.5, 2.0, 0.0], [0.0, 0.0, 3.0]])
        >>> body.to_reference((0.0, 0.0, 1.0)).round(12).tolist()
        [0.0, 0.0, 1.0]""",
    )
    def to_reference(self, vector: ArrayLike) -> Array:
        """Resolve vectors of the principal axes in the described axes."""
        components: Array = member_vectors(vector, "vector", 3) @ np.array(self.axes).T
        return components

    @_between_axes(
        "principal",
        "described",
        """>>> rm.Body((1.0, 2.0, 2.5)).reference_attitude((0.6, 0.8, 0.0, 0.0)).round(12).tolist()
        [0.6, 0.8, 0.0, 0.0]""",
    )
    def reference_attitude(self, attitude: ArrayLike) -> Array:
        """Convert attitudes of the principal axes to attitudes of the described axes."""
        inverse = rotation.quaternion(np.array(self.axes)) * np.array([1.0, -1.0, -1.0, -1.0])
        return rotation.product(_member_attitudes(attitude), inverse)

    @_between_axes(
        "described",
        "principal",
        """>>> rm.Body((1.0, 2.0, 2.5)).principal_attitude((0.6, 0.8, 0.0, 0.0)).round(12).tolist()
        [0.6, 0.8, 0.0, 0.0]""",
    )
    def principal_attitude(self, attitude: ArrayLike) -> Array:
        """Convert attitudes of the described axes to attitudes of the principal axes."""
        axes = rotation.quaternion(np.array(self.axes))
        return rotation.product(_member_attitudes(attitude), axes)

    def angular_momentum(self, omega: ArrayLike) -> Array:
        """Compute the angular momentum, TdC (3.25).

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
        return inertia.angular_momentum(self.tensor, member_vectors(omega, "omega", 3))

    def kinetic_energy(self, omega: ArrayLike) -> Array:
        """Compute the kinetic energy, TdC (3.16).

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
        return inertia.kinetic_energy(self.tensor, member_vectors(omega, "omega", 3))

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
            raise ValueError("a body that differs between members has no single tensor")
        axes = np.array(self.axes)
        tensor: Array = (axes * np.array(self.moments)) @ axes.T
        return tensor

    @property
    def is_turned(self) -> bool:
        """Whether the axes of the scene differ from the principal axes of some member.

        Examples
        --------
        >>> rm.Body((1.0, 2.0, 2.5)).is_turned
        False
        """
        if isinstance(self.moments, TensorDistribution):
            return True
        return self.frame == "described" and self.axes != IDENTITY

    def quantities(self) -> tuple[Any, ...]:
        """Return all quantities of the body, in one flat tuple.

        Returns
        -------
        tuple
            moments (a vector distribution followed by its parameters), mass, components of the
            centre

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
        """Draw moments, mass and centre of mass of members first ... first + count - 1.

        Parameters
        ----------
        sampler : int or point set
            the seed, or the points that replace random numbers
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
        """Draw the bodies of members first ... first + count - 1, with their principal axes.

        Parameters
        ----------
        sampler : int or point set
            the seed, or the points that replace random numbers
        first : int
            index of the first member
        count : int
            number of members

        Returns
        -------
        moments, mass, centre : numpy.ndarray
            as for `sample`
        turn : numpy.ndarray (3, 3, count) or None
            its columns are the principal axes, in the axes of the scene: the described axes or, for
            the frame "principal", the principal axes of the mean tensor; None if the members' axes
            are the axes of the scene

        Examples
        --------
        >>> rm.Body((1.0, 2.0, 2.5)).sample_turned(0, 0, 5)[3] is None
        True
        """
        if isinstance(self.moments, TensorDistribution):
            return self._turned(self.moments, sampler, first, count)
        if isinstance(self.moments, VectorDistribution):
            moments = self.moments.sample(sampler, "body.moments", first, count, None)
        else:
            moments = draw(self.moments, sampler, "body.moments", first, count)
        mass = draw((self.mass,), sampler, "body.mass", first, count)[0]
        centre = draw(self.centre, sampler, "body.centre", first, count)
        if self.axes == IDENTITY:
            return moments, mass, centre, None
        centre = self._along_axes(centre)
        if self.frame == "principal":
            return moments, mass, centre, None
        return moments, mass, centre, as_array(self.axes)[:, :, None] + np.zeros(count)

    def _along_axes(self, vectors: Array) -> Array:
        """Resolve vectors (3, n) of the described axes along the principal axes."""
        # explicit sums: the rounding of a BLAS product may depend on the number of members
        return np.stack([sum(self.axes[j][i] * vectors[j] for j in range(3)) for i in range(3)])

    def _turned(
        self, distribution: TensorDistribution, sampler: Source, first: int, count: int
    ) -> tuple[Array, Array, Array, Array]:
        """Implement `sample_turned` for a distribution of tensors."""
        *six, x, y, z, mass = distribution.bodies(
            sampler, "body.tensor", first, count, self.mass, self.centre
        )
        moments, axes = inertia.principal_axes(inertia.symmetric(six))
        centre = np.stack([x, y, z])
        if self.frame == "described":
            moments, turn = inertia.match_axes(moments, axes, IDENTITY)
            return moments, mass, inertia.vectors_into(turn, centre), turn
        moments, turn = inertia.match_axes(moments, axes, self.axes)
        return moments, mass, inertia.vectors_into(turn, self._along_axes(centre)), turn


def _member_attitudes(attitude: Any) -> Array:
    """Return the quaternions (..., 4) of attitudes, perhaps one for each member; SceneError for
    four rows that may be components."""
    q = rotation.quaternion(attitude)
    if q.ndim == 2 and len(q) == 4 and np.shape(attitude) == (4, 4) and not is_labelled(attitude):
        check_quaternion_rows(floats(attitude, "attitude"), "attitude")
    return q


def _checked_axes(axes: Any) -> tuple[tuple[float, ...], ...]:
    """Return axes as a tuple of rows; SceneError unless right-handed and orthonormal."""
    if isinstance(axes, tuple) and axes == IDENTITY:
        return IDENTITY
    columns = floats(axes, "body.axes", last=3)
    square = columns.shape == (3, 3) and np.isfinite(columns).all()
    # as in `rotation.quaternion_from_matrix`, without importing scipy
    if not square or np.abs(columns @ columns.T - np.eye(3)).max() > 1e-9:
        rule = "expected 3x3 numbers whose columns are orthonormal"
        raise SceneError(rule, at="body.axes")
    if np.linalg.det(columns) < 0.0:
        raise SceneError("are left-handed: reverse one of them", at="body.axes")
    return tuple(map(tuple, columns.tolist()))
