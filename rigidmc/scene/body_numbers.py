"""The numbers of a body: fields, their checks, and the bodies of members.

`rigidmc.scene.body.Body` has more: `body_makers`, `body_changes` and `body_readers` build on each
other.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from rigidmc.errors import Renamed, SceneError, unknown
from rigidmc.inputs.arrays import Array, floats
from rigidmc.mechanics import inertia
from rigidmc.physics.dynamics.dual_arrays import as_array
from rigidmc.scene.inertia_about import ASSUMED_MASS
from rigidmc.scene.quantities import Source, draw, is_shared, is_variable, quantity, vector
from rigidmc.scene.shape import Shape
from rigidmc.scene.stated import Stated
from rigidmc.scene.units import in_si, vector_in_si
from rigidmc.scene.vector_distributions import check_distribution
from rigidmc.scene.vector_distributions.bodies import TensorDistribution
from rigidmc.scene.vector_distributions.protocol import VectorDistribution, flat_parameters

FRAMES = ("described", "principal")
IDENTITY = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@dataclass(frozen=True, eq=False)
class BodyNumbers(Renamed):
    """Moments, mass and centre of mass of a body, see `rigidmc.scene.body.Body`."""

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
        is_drawn = isinstance(self.moments, VectorDistribution)
        uncertain = isinstance(self.moments, TensorDistribution)
        check = check_distribution if is_drawn else vector
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
        if not is_drawn:
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
        fixed = [m for m in self.moments if not is_variable(m)]
        if not all(np.min(m) > 0 for m in fixed):
            raise SceneError("principal moments must be positive", at="body.moments", value=shown)
        if len(fixed) < 3:
            return
        bad = np.flatnonzero(inertia.violates_triangle(self.moments))
        if bad.size:
            values = np.array([float(m if is_shared(m) else m[bad[0]]) for m in self.moments])
            row = "" if is_shared(self.moments) else f"row {bad[0]}: "
            rule = row + inertia.why_impossible(values)
            raise SceneError(rule, at="body.moments", value=shown)

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
