"""Initial conditions: angular velocity or angular momentum, and attitude."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from rigidmc.errors import Renamed, SceneError, unknown
from rigidmc.inputs.arrays import Array, as_plain_arrays, check_quaternion_rows, floats
from rigidmc.inputs.labelled import Wanted, has_dims, is_labelled, two_ways
from rigidmc.mechanics.euler_angles import TEXTBOOK, check_sequence, quaternions_of_angles
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
from rigidmc.scene.start_tables import check_relative, is_start_table, read_start_table
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


@dataclass(frozen=True, eq=False)
class Start(Renamed):
    """Initial conditions of the members. Each component is a number, a distribution, a grid, or an
    array with one row per member.

    Whole vectors may also be arrays (members, 3) or (members, 4). Labels of pandas and xarray name
    members and components (docs/how_to/tables.md); a shape that reads two ways, such as (3, 3),
    needs them.

    Parameters
    ----------
    omega : quantities (3,) or distribution, optional [rad/s]
        angular velocity in body axes; give either omega or momentum
    momentum : quantities (3,) or distribution, optional [kg m^2/s]
        angular momentum in body axes
    attitude : quantities (3,) or (4,), array_like (3, 3), Rotation, dict, str or distribution
        a quaternion (w, x, y, z), normalised here; a 3x3 matrix; three Euler angles of `sequence`
        [rad], in the order of the rotations; a scipy Rotation, one or one per member; "uniform" on
        SO(3); Fisher or Pointing; or "ensemble", whose density follows from the distribution of the
        momentum: exp(-V/kT) with GibbsMomentum (canonical ensemble), sqrt(E - V) with Shell
        (microcanonical ensemble); or the table of a scene file as a dict, which may state sequence,
        unit and order. By default the body axes are parallel to the space axes
    sequence : str, optional
        sequence of three Euler angles, each about an axis of the body: by default "313", z-x-z
        with (phi, theta, psi), TdC (3.36); "321" has (yaw, pitch, roll). scipy writes "ZYX" for it
    relative_to_orbit : str or sequence of str, optional
        "omega", "attitude" or both: relative to the local frame of the orbit of the scene's
        GravityGradient, the frame of `OrbitAngles`, which turns with the true anomaly

    Raises
    ------
    SceneError
        for a wrong shape or one that reads two ways, for labels that do not name components or
        members, for a non-finite number, a quaternion of norm 0, a matrix that is not a rotation,
        and for both or neither of omega and momentum

    Examples
    --------
    >>> start = rm.Start(omega=(rm.normal(0.0, 1e-3), 1.0, 0.0), attitude="uniform")
    >>> tilt = {"euler": "321", "angles": (0.0, rm.normal(0.0, 5.0), 0.0), "unit": "deg"}
    >>> start = rm.Start(omega=(0.0, 0.0, 1.0), attitude=tilt)
    >>> start.sequence
    '321'
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
    sequence: str = TEXTBOOK
    relative_to_orbit: Any = ()

    def __post_init__(self) -> None:
        self._read_tables()
        if (self.omega is None) == (self.momentum is None):
            raise SceneError("give either omega or momentum", at="start.omega")
        name = self.spin_name
        spin = vector_in_si(self._given, START[name], f"start.{name}")
        object.__setattr__(self, "attitude", angles_in_si(self.attitude, "start.attitude"))
        is_drawn = isinstance(spin, VectorDistribution)
        put = (check_distribution if is_drawn else vector)(spin, f"start.{self.spin_name}")
        object.__setattr__(self, self.spin_name, put)
        if isinstance(self.attitude, VectorDistribution):
            attitude: Any = check_distribution(self.attitude, "start.attitude")
        elif self.sequence != TEXTBOOK and self.has_euler_angles:  # even if they look like a matrix
            attitude = vector(self.attitude, "start.attitude")
        else:
            attitude = _attitude(self.attitude)
        object.__setattr__(self, "attitude", attitude)
        sequence = check_sequence(self.sequence, "start.sequence")
        object.__setattr__(self, "sequence", sequence if self.has_euler_angles else TEXTBOOK)
        relative = check_relative(self.relative_to_orbit, self.spin_name, attitude)
        object.__setattr__(self, "relative_to_orbit", relative)
        if self.attitude == "ensemble" and not (
            isinstance(spin, EquilibriumEnsemble) and spin.direction is None
        ):
            rule = (
                "follows from the distribution of the momentum: give momentum = { gibbs = kT }, or"
                " { shell = { energy = E } } without a direction"
            )
            raise SceneError(rule, at="start.attitude", value=self.attitude)

    def _read_tables(self) -> None:
        """Replace tables by the values that they contain."""
        for key in ("omega", "momentum", "attitude"):
            if not is_start_table(key, getattr(self, key)):
                continue
            content = read_start_table(key, getattr(self, key))
            object.__setattr__(self, key, content.value)
            if content.sequence is not None:
                object.__setattr__(self, "sequence", content.sequence)
            if content.relative:
                relative = self.relative_to_orbit
                relative = tuple(relative) if isinstance(relative, (list, tuple)) else (relative,)
                object.__setattr__(self, "relative_to_orbit", (*relative, key))

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
        name, spin = f"start.{self.spin_name}", self._given
        if isinstance(spin, VectorDistribution):
            return self.spin_name, spin.sample(sampler, name, first, count, facts)
        return self.spin_name, draw(spin, sampler, name, first, count)

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
            unit quaternions, from body to space components, or to components in the frame of the
            orbit if the attitude is relative to it

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
        if len(values) == 3 and self.sequence != TEXTBOOK:
            return quaternions_of_angles(self.sequence, *values)
        if len(values) == 3:
            return quaternion_from_euler(*values)
        one, two, three, four = np.square(values)
        square = one + two + three + four
        # a normalised quaternion keeps its bits, so that stored starts can be rerun identically
        is_unit = np.abs(square - 1.0) < 1e-15
        return values if is_unit.all() else values / np.where(is_unit, 1.0, np.sqrt(square))


def _attitude(value: Any) -> Any:
    """Return an attitude that is not a distribution, with its numbers checked."""
    if isinstance(value, str):
        if value not in ("uniform", "ensemble"):
            words = ["uniform", "ensemble", "3 Euler angles", "a quaternion", "a matrix"]
            raise unknown("attitude", words, at="start.attitude", value=value)
        return value
    if hasattr(value, "as_quat"):  # scipy's Rotation
        value = _components_of(np.asarray(value.as_quat(scalar_first=True)))
    elif is_labelled(value):
        value = _components_of(as_plain_arrays(value, "start.attitude", wanted=Wanted((4, 3))))
    else:
        value = _members_first(value)
    size = 3 if len(value) == 3 else 4
    parts = vector(value, "start.attitude", size)
    if size == 4:
        _check_quaternion(parts, value)
    return parts


def _components_of(array: Array) -> tuple[Any, ...]:
    """Return the components of attitudes whose axes are known, (k,) or (members, k)."""
    if array.ndim > 2:
        rule = f"has the shape {array.shape}: expected one attitude, or one for each member"
        raise SceneError(rule, at="start.attitude")
    return tuple(array.tolist()) if array.ndim == 1 else tuple(np.ascontiguousarray(array.T))


def _members_first(value: Any) -> Any:
    """Return an attitude without labels as its components, or as an array with one row per member;
    SceneError for a shape that reads two ways."""
    settled = isinstance(value, tuple) or (isinstance(value, list) and any(map(has_dims, value)))
    value = as_plain_arrays(value, "start.attitude")
    if not hasattr(value, "__len__"):
        rule = (
            'expected "uniform", "ensemble", a quaternion (w, x, y, z), Euler angles (phi, theta,'
            ' psi), a 3x3 matrix, or a table such as { euler = "321", angles = [0, 0.1, 0] }'
        )
        raise SceneError(rule, at="start.attitude", value=value)
    shape = _shape(value)
    if shape in ((3, 3), (len(value), 3, 3)) and not _is_columns(value):
        q = quaternion_from_matrix(floats(value, "start.attitude"), "start.attitude")
        return _components_of(q)
    if len(shape) != 2:
        return tuple(value) if settled else value
    is_nested = len(value) > 0 and all(isinstance(part, (list, tuple)) for part in value)
    columns = not isinstance(value, np.ndarray) and not is_nested
    if columns and shape[0] in (3, 4):
        if not settled and shape[1] in (3, 4):
            raise two_ways(shape, "start.attitude", "quat")
        return tuple(value)
    array = floats(value, "start.attitude")
    check_quaternion_rows(array, "start.attitude")
    if shape[1] not in (3, 4):
        turned = "; give its transpose" if shape[0] in (3, 4) else ""
        rule = f"has the shape {shape}: expected (members, 4) or, for Euler angles, (members, 3)"
        raise SceneError(f"{rule}{turned}", at="start.attitude")
    return _components_of(array)


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
    elif (zeros := np.flatnonzero(np.asarray(sum(p * p for p in parts)) < 1e-200)).size:
        shown, row = (value, "") if is_shared(parts) else (None, f"row {zeros[0]}: ")
        raise SceneError(f"{row}a quaternion must be nonzero", at="start.attitude", value=shown)


def _shape(value: Any) -> tuple[int, ...]:
    try:
        return np.shape(value)
    except ValueError:
        return (len(value),)
