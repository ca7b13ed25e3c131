"""A body: mass, centre of mass, principal moments about the fixed point, and principal axes."""

from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from rigidmc.inputs.arrays import Array, check_quaternion_rows, floats, member_vectors
from rigidmc.inputs.labelled import is_labelled
from rigidmc.mechanics import inertia, rotation
from rigidmc.scene.body_numbers import IDENTITY as IDENTITY
from rigidmc.scene.body_readers import BodyReaders

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


class Body(BodyReaders):
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


def _member_attitudes(attitude: Any) -> Array:
    """Return the quaternions (..., 4) of attitudes, perhaps one for each member; SceneError for
    four rows that may be components."""
    q = rotation.quaternion(attitude)
    if q.ndim == 2 and len(q) == 4 and np.shape(attitude) == (4, 4) and not is_labelled(attitude):
        check_quaternion_rows(floats(attitude, "attitude"), "attitude")
    return q
