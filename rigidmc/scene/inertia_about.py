"""The point of an inertia: tensors and moments about the centre of mass, moved to the fixed point.

CAD programs, robot descriptions and data sheets give the inertia about the centre of mass; a body
has it about its fixed point. With c from the fixed point to the centre of mass, TdC (3.26):

    I = I_centre + m (c^2 1 - c c^T)
"""

from typing import Any

import numpy as np

from rigidmc.errors import SceneError, unknown
from rigidmc.inputs.arrays import Array, floats
from rigidmc.inputs.labelled import Wanted
from rigidmc.mechanics import inertia
from rigidmc.mechanics.impossible import causes_text
from rigidmc.scene.quantities import is_shared, quantity, vector
from rigidmc.scene.units import in_si, size_units, vector_in_si
from rigidmc.scene.vector_distributions.bodies import UncertainInertia

ABOUT = ("pivot", "centre")  # the fixed point; the centre of mass
ASSUMED_MASS = 1.0  # kg, of a body without a given mass: free motion depends on moments alone


def is_about_centre(about: Any) -> bool:
    """Return whether the word of `about` is "centre"; SceneError unless it is one of ABOUT."""
    if about not in ABOUT:
        raise unknown("point", ABOUT, at="body.about", value=about)
    return bool(about == "centre")


def mass_and_centre(mass: Any, centre: Any) -> tuple[Any, tuple[Any, ...]]:
    """Return a mass, ASSUMED_MASS for None, and a centre of mass in SI units; SceneError."""
    c = vector(vector_in_si(centre, "m", "body.centre"), "body.centre")
    in_kg = ASSUMED_MASS if mass is None else in_si(mass, "kg", "body.mass")
    return quantity(in_kg, "body.mass"), c


def tensor_about_pivot(tensor: Any, mass: Any, centre: Any) -> Any:
    """Return a tensor (3, 3) or UncertainInertia about the fixed point, from one about the centre
    of mass.

    mass, centre : of the body, from the fixed point

    An uncertain tensor is moved to first order: its mean by the mean mass and centre, and its
    covariance S becomes J S J^T with the derivatives J of the moved elements. SceneError for a mass
    or a centre that differs between members, and for no mass (None) beside a centre.
    """
    m, c = mass_and_centre(mass, centre)
    check_mass_given(mass is not None, c)
    if not is_shared(m, c):
        rule = (
            'must be plain numbers with about = "centre"; if they are uncertain, give the tensor'
            " as rm.UncertainInertia, whose covariance includes them"
        )
        raise SceneError(rule, at="body.mass" if not is_shared(m) else "body.centre")
    if isinstance(tensor, UncertainInertia):
        return _moved(tensor.check("body.tensor"), m, np.array(c))
    return inertia.about_point(tensor, m, np.array(c))


def check_mass_given(has_mass: bool, *vectors: Any) -> None:
    """Raise SceneError for a body without a given mass that moves between its centre of mass and
    another fixed point.

    vectors : from the old and the new fixed point to the centre of mass
    """
    if not has_mass and any(not is_shared(v) or np.any(v) for v in vectors):
        rule = "give the mass: moments about another point are I_centre + m (c^2 1 - c c^T)"
        raise SceneError(rule, at="body.mass")


def _moved(distribution: UncertainInertia, mass: float, centre: Array) -> Any:
    """Implement `tensor_about_pivot` for a distribution."""
    if distribution.centre is not None:
        rule = (
            "omit this: an uncertain tensor with a centre of its own is about the origin of this"
            " centre"
        )
        raise SceneError(rule, at="body.about", value="centre")
    mean = inertia.about_point(distribution.mean, mass, centre)
    covariance = np.array(distribution.covariance)
    by = _derivatives(mass, centre)[: len(covariance), : len(covariance)]
    moved = by @ covariance @ by.T
    # a sum of products is symmetric only to rounding
    moved = 0.5 * (moved + moved.T)
    return UncertainInertia(tuple(map(tuple, mean.tolist())), tuple(map(tuple, moved.tolist())))


def _derivatives(mass: float, centre: Array) -> Array:
    """Return the derivatives (10, 10) of xx, yy, zz, yz, zx, xy about the fixed point, of the
    centre and of the mass, by those about the centre of mass."""
    x, y, z = centre.tolist()
    by = np.eye(10)
    by[:6, 6:9] = mass * np.array(
        [
            [0.0, 2.0 * y, 2.0 * z],
            [2.0 * x, 0.0, 2.0 * z],
            [2.0 * x, 2.0 * y, 0.0],
            [0.0, -z, -y],
            [-z, 0.0, -x],
            [-y, -x, 0.0],
        ]
    )
    by[:6, 9] = inertia.elements(inertia.shift(centre))
    return by


def checked_tensor(tensor: Any) -> Array:
    """Return a tensor as an array (3, 3); SceneError."""
    tensor = in_si(tensor, "kg m2", "body.tensor")
    wanted = "expected 3x3 finite numbers, not"
    cure = (
        "; bodies that differ have one tensor each, (members, 3, 3), or rm.UncertainInertia;"
        " moments are an argument of Body.from_moments"
    )
    of_tensor = Wanted((3,), is_matrix=True)
    matrix = floats(
        tensor, "body.tensor", rule=f"{wanted} distributions or text{cure}", wanted=of_tensor
    )
    if matrix.shape != (3, 3):
        rule = f"{wanted} {matrix.shape or 'one number'}{cure}"
        raise SceneError(rule, at="body.tensor")
    return matrix


def principal_axes_of(
    matrix: Array, mass: Any, centre: Any, frame: str = "described"
) -> tuple[Array, Array]:
    """Return moments and axes of a tensor (3, 3); SceneError with the likely causes of an
    impossible one."""
    find = inertia.principal_axes if frame == "principal" else inertia.nearest_axes
    try:
        return find(matrix)
    except SceneError as error:
        m, c = mass_and_centre(mass, centre)
        causes = causes_text(matrix, m, c) if is_shared(m, c) else ""
        rule = error.rule + causes
        raise SceneError(rule, at="body.tensor", value=matrix.tolist()) from None


def has_rows(tensor: Any) -> bool:
    """Return whether a value has three dimensions, as one tensor for each member."""
    if not isinstance(tensor, (list, tuple)):
        return getattr(tensor, "ndim", 0) == 3
    try:
        return np.ndim(tensor) == 3
    except (ValueError, TypeError, AttributeError):  # rows of different lengths, or other objects
        return False


def positive_number(value: Any, at: str) -> float:
    """Return a positive plain number; SceneError."""
    number = quantity(in_si(value, size_units(at.rpartition(".")[2]), at), at)
    if not isinstance(number, float):
        rule = "must be a plain number; for bodies that differ give moments instead"
        raise SceneError(rule, at=at)
    if not number > 0:
        raise SceneError("must be positive", at=at, value=number)
    return number
