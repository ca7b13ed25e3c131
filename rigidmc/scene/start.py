"""Initial conditions: angular velocity or angular momentum, and attitude."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigidmc.arrays import as_plain_arrays, floats
from rigidmc.errors import Renamed, SceneError, unknown
from rigidmc.mechanics.rotation import quaternion_from_euler, quaternion_from_matrix
from rigidmc.scene.quantities import (
    Source,
    count_rows,
    draw,
    draw_uniforms,
    is_shared,
    is_variable,
    vector,
)
from rigidmc.scene.units import START, angles_in_si, vector_in_si
from rigidmc.scene.vector_distributions import check_distribution
from rigidmc.scene.vector_distributions.ensembles import attitudes_of_ensemble
from rigidmc.scene.vector_distributions.protocol import (
    EquilibriumEnsemble,
    MemberFacts,
    VectorDistribution,
    flat_parameters,
)
from rigidmc.scene.vector_distributions.vectors import uniform_attitudes

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Start(Renamed):
    """Initial conditions of the members. Each component is a number, a distribution, a grid, or an
    array with one row per member.

    Parameters
    ----------
    omega : quantities (3,) or distribution, optional [rad/s]
        angular velocity in body axes; give either omega or momentum
    momentum : quantities (3,) or distribution, optional [kg m^2/s]
        angular momentum in body axes
    attitude : quantities (3,) or (4,), array_like (3, 3), Rotation, str or distribution, optional
        a quaternion (w, x, y, z), normalised here; a 3x3 matrix; Euler angles z-x-z
        (phi, theta, psi) [rad], TdC (3.36); a scipy Rotation; "uniform" on SO(3); Fisher or
        Pointing; or "ensemble", whose density follows from the distribution of the momentum:
        exp(-V/kT) with GibbsMomentum (canonical ensemble), sqrt(E - V) with Shell (microcanonical
        ensemble). By default the body axes are parallel to the space axes

    Raises
    ------
    SceneError
        for a wrong shape, a non-finite number, a quaternion of norm 0, a matrix that is not a
        rotation, and for both or neither of omega and momentum

    Examples
    --------
    >>> start = rm.Start(omega=(rm.normal(0.0, 1e-3), 1.0, 0.0), attitude="uniform")
    >>> rm.Start()
    Traceback (most recent call last):
    rigidmc.errors.SceneError: [start] omega: give either omega or momentum
    """

    _OLD_NAMES = {
        "by_euler_angles": "has_euler_angles",
        "quaternions": "sample_attitude",
        "spin": "sample_spin",
        "which": "spin_name",
    }

    omega: Any = None
    momentum: Any = None
    attitude: Any = (1.0, 0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        if (self.omega is None) == (self.momentum is None):
            raise SceneError("give either omega or momentum", at="start.omega")
        name = self.spin_name
        given = vector_in_si(self._given, START[name], f"start.{name}")
        object.__setattr__(self, "attitude", angles_in_si(self.attitude, "start.attitude"))
        whole = isinstance(given, VectorDistribution)
        put = (check_distribution if whole else vector)(given, f"start.{self.spin_name}")
        object.__setattr__(self, self.spin_name, put)
        whole = isinstance(self.attitude, VectorDistribution)
        attitude = (
            check_distribution(self.attitude, "start.attitude")
            if whole
            else _attitude(self.attitude)
        )
        object.__setattr__(self, "attitude", attitude)
        if self.attitude == "ensemble" and not (
            isinstance(given, EquilibriumEnsemble) and given.direction is None
        ):
            rule = (
                "follows from the distribution of the momentum: give momentum = { gibbs = kT }, or"
                " { shell = { energy = E } } without a direction"
            )
            raise SceneError(rule, at="start.attitude", value=self.attitude)

    @property
    def spin_name(self) -> str:
        """Name of the given quantity, "omega" or "momentum".

        Examples
        --------
        >>> rm.Start(momentum=(0.0, 0.0, 1.0)).spin_name
        'momentum'
        """
        return "omega" if self.momentum is None else "momentum"

    @property
    def has_euler_angles(self) -> bool:
        """Whether Euler angles give the attitude.

        Examples
        --------
        >>> rm.Start(omega=(0.0, 0.0, 1.0), attitude=(0.0, 0.3, 0.0)).has_euler_angles
        True
        """
        return isinstance(self.attitude, tuple) and len(self.attitude) == 3

    @property
    def _given(self) -> Any:
        return getattr(self, self.spin_name)

    def quantities(self) -> tuple[Any, ...]:
        """Return all quantities of the start, in one flat tuple.

        Returns
        -------
        tuple
            components of omega or momentum, then of the attitude unless it is a string

        Examples
        --------
        >>> rm.Start(omega=(0.0, 0.0, 1.0), attitude="uniform").quantities()
        (0.0, 0.0, 1.0)
        """
        attitude = () if isinstance(self.attitude, str) else self.attitude
        return tuple(
            part
            for value in (self._given, attitude)
            for part in (
                (value, *flat_parameters(value)) if isinstance(value, VectorDistribution) else value
            )
        )

    def sample_spin(
        self, sampler: Source, first: int, count: int, facts: MemberFacts | None
    ) -> tuple[str, Array]:
        """Draw omega or momentum of members first ... first + count - 1.

        Parameters
        ----------
        sampler : int or point set
            the seed, or the points that replace random numbers
        first : int
            index of the first member
        count : int
            number of members
        facts : MemberFacts or None
            facts of the members, which only equilibrium ensembles need

        Returns
        -------
        name : str
            "omega" or "momentum"
        values : numpy.ndarray (3, count) [rad/s or kg m^2/s]
            in body axes; for an equilibrium ensemble, in the principal axes of the member

        Examples
        --------
        >>> start = rm.Start(omega=(0.0, rm.uniform(1.0, 2.0), 0.0))
        >>> name, values = start.sample_spin(0, 0, 5, None)
        >>> name, values.shape
        ('omega', (3, 5))
        """
        name, given = f"start.{self.spin_name}", self._given
        if isinstance(given, VectorDistribution):
            return self.spin_name, given.sample(sampler, name, first, count, facts)
        return self.spin_name, draw(given, sampler, name, first, count)

    def sample_attitude(
        self, sampler: Source, first: int, count: int, facts: MemberFacts | None = None
    ) -> Array:
        """Draw the attitudes of members first ... first + count - 1.

        Parameters
        ----------
        sampler : int or point set
            the seed, or the points that replace random numbers
        first : int
            index of the first member
        count : int
            number of members
        facts : MemberFacts or None, optional
            facts of the members, which only attitude = "ensemble" needs

        Returns
        -------
        numpy.ndarray (4, count)
            unit quaternions, from body to space components

        Examples
        --------
        >>> q = rm.Start(omega=(0.0, 0.0, 1.0), attitude="uniform").sample_attitude(0, 0, 5)
        >>> (q**2).sum(0).round(12).tolist()
        [1.0, 1.0, 1.0, 1.0, 1.0]
        """
        name = "start.attitude"
        if self.attitude == "ensemble":
            share = self.momentum.acceptance(sampler, first, count, facts)
            return attitudes_of_ensemble(share, sampler, first, count)
        if self.attitude == "uniform":
            return uniform_attitudes(
                *draw_uniforms(sampler, name, first, count, used=(0, 1, 2))[:3]
            )
        if isinstance(self.attitude, VectorDistribution):
            return self.attitude.sample(sampler, name, first, count, None)
        values = draw(self.attitude, sampler, name, first, count)
        if len(values) == 3:
            return quaternion_from_euler(*values)
        square = values[0] ** 2 + values[1] ** 2 + values[2] ** 2 + values[3] ** 2
        # a normalised quaternion keeps its bits, so that stored starts can be rerun identically
        values /= np.where(np.abs(square - 1.0) < 1e-15, 1.0, np.sqrt(square))
        return values


def _attitude(value: Any) -> Any:
    """Return an attitude that is not a distribution, with its numbers checked."""
    if isinstance(value, str):
        if value not in ("uniform", "ensemble"):
            raise unknown("attitude", ["uniform", "ensemble"], at="start.attitude", value=value)
        return value
    if hasattr(value, "as_quat"):  # scipy's Rotation
        value = np.asarray(value.as_quat(scalar_first=True))
        value = value if value.ndim == 2 else tuple(value.tolist())
    value = as_plain_arrays(value, "start.attitude")
    if not hasattr(value, "__len__"):
        rule = (
            'expected "uniform", "ensemble", a quaternion (w, x, y, z), Euler angles (phi, theta,'
            " psi), or a 3x3 matrix"
        )
        raise SceneError(rule, at="start.attitude", value=value)
    shape = _shape(value)
    if shape in ((3, 3), (len(value), 3, 3)) and not _is_columns(value):
        matrices = floats(value, "start.attitude")
        q = quaternion_from_matrix(matrices, "start.attitude")
        value = tuple(q.tolist()) if q.ndim == 1 else q
    by_member = isinstance(value, np.ndarray) and len(shape) == 2
    if by_member and shape[0] == 4:
        _refuse_turned(value)
    size = 3 if (shape[1] if by_member else len(value)) == 3 else 4
    parts = vector(value, "start.attitude", size)
    if size == 4:
        _check_quaternion(parts, value)
    return parts


def _refuse_turned(value: Any) -> None:
    """Raise SceneError for four rows that hold components of quaternions instead of members."""
    rows, columns = (np.abs((value.astype(float) ** 2).sum(axis) - 1.0).max() for axis in (1, 0))
    if columns < 1e-6 and (value.shape[1] != 4 or rows >= 1e-6):
        rule = (
            f"has the shape {value.shape}, and its columns are quaternions: an array must have one"
            " row per member; give its transpose"
        )
        raise SceneError(rule, at="start.attitude")


def _is_columns(value: Any) -> bool:
    """Return whether a value is Euler angles, each an array with one row per member, and not a
    matrix; SceneError if three arrays of three numbers could be either."""
    if not isinstance(value, (list, tuple)) or not all(isinstance(x, np.ndarray) for x in value):
        return False
    if np.ndim(value[0]) != 1:
        return False
    columns = np.array(value, dtype=float)
    if np.abs(columns @ columns.T - np.eye(3)).max() < 0.1:
        rule = (
            "three arrays of three numbers may be the rows of a matrix or the Euler angles of three"
            " members: give a matrix as one array, np.array(rows), and Euler angles as quaternions,"
            " rigidmc.mechanics.rotation.from_euler(np.column_stack(angles))"
        )
        raise SceneError(rule, at="start.attitude")
    return True


def _check_quaternion(parts: tuple[Any, ...], value: Any) -> None:
    """Raise SceneError for a quaternion of norm 0, or one that mixes arrays and distributions."""
    if is_variable(parts):
        if count_rows(*parts) is not None:
            rule = "components of a quaternion must be distributions or arrays, not both"
            raise SceneError(rule, at="start.attitude")
    # pure: components of a quaternion
    elif np.min(sum(p * p for p in parts)) < 1e-200:
        shown = value if is_shared(parts) else None
        raise SceneError("a quaternion must be nonzero", at="start.attitude", value=shown)


def _shape(value: Any) -> tuple[int, ...]:
    try:
        return np.shape(value)
    except ValueError:
        return (len(value),)
