"""Inertia tensors of arrays of bodies: particles, parallel axes, principal axes, L = I omega.

Components come last, leading shapes are arbitrary. `match_axes` labels the principal axes of many
bodies after the nearest axes of a reference body: the columns of a turn (3, 3, n) are the axes of a
body in the axes of the reference, v' = turn^T v. Products are computed element by element, so that
no bit depends on a library or on the number of bodies.
"""

from itertools import permutations, product
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rigidmc.errors import SceneError
from rigidmc.inputs.arrays import Array, Bools, check_rows, floats
from rigidmc.inputs.labelled import Wanted
from rigidmc.mechanics.axes_rates import axes_rates
from rigidmc.physics.dynamics.dual_arrays import DualArray, as_array
from rigidmc.physics.dynamics.principal_axes import Principal

SIX = ((0, 0), (1, 1), (2, 2), (1, 2), (2, 0), (0, 1))  # xx, yy, zz, yz, zx, xy of a tensor
SLACK = 1e-12  # relative: a flat plate obeys I3 = I1 + I2 only to rounding


def elements(tensor: Any) -> tuple[Any, ...]:
    """Return xx, yy, zz, yz, zx, xy of a symmetric tensor given by its rows."""
    return tuple(tensor[i][j] for i, j in SIX)


def symmetric(six: Any) -> Array:
    """Return the tensors (n, 3, 3) with elements (6, n)."""
    xx, yy, zz, yz, zx, xy = six
    return np.stack([np.stack(row, -1) for row in ((xx, xy, zx), (xy, yy, yz), (zx, yz, zz))], -2)


# with what every refusal and every note of impossible moments says
TRIANGLE = "the triangle inequality I_i <= I_j + I_k"


def violates_triangle(moments: Any) -> Any:
    """Return whether (...) no body can have the moments (3, ...).

    Then a moment is not positive, or exceeds the sum of the other two.
    """
    one, two, three = moments
    total = (one + two + three) * (1 + SLACK)
    positive = np.minimum(np.minimum(one, two), three) > 0
    return ~(positive & (2 * np.maximum(np.maximum(one, two), three) <= total))


TOO_FAR = (
    "the centre of mass is too far from the fixed point for these moments and this mass"
    " (m sum c_i^2/(I_j + I_k - I_i) must be <= 1/2)"
)


def too_far(moments: Any, mass: Any, centre: Any) -> Any:
    """Return whether (...) no body can have the moments (3, ...), the mass (...) and the centre of
    mass c (3, ...) in the principal axes, although a body can have the moments.

    The second moments about the centre of mass are

        diag(S) - m c c^T,  S_i = (I_j + I_k - I_i)/2

    and this matrix has no negative eigenvalue iff m sum c_i^2/S_i <= 1.
    """
    second = 0.5 * moments.sum(0) - moments
    with np.errstate(all="ignore"):
        share = mass * np.where(centre == 0.0, 0.0, centre**2 / second).sum(0)
        return share > 1.0 + 1e-9


def shift(r: Array) -> Array:
    """Return r^2 1 - r r^T (..., 3, 3) of vectors r (..., 3): the tensor of a unit mass at r."""
    square = np.einsum("...i,...i", r, r)[..., None, None]
    tensor: Array = square * np.eye(3) - r[..., :, None] * r[..., None, :]
    return tensor


def of_particles(masses: ArrayLike, positions: ArrayLike) -> Array:
    """Return I_ij = sum m (r^2 delta_ij - x_i x_j) (..., 3, 3), TdC (3.15).

    masses (..., N) [kg];  positions (..., N, 3) [m]. SceneError if their shapes do not fit.
    """
    masses = floats(masses, "masses")
    positions = floats(positions, "positions", wanted=Wanted((3,), by_member=False))
    vectors = positions.ndim >= 2 and positions.shape[-1] == 3
    if not vectors or masses.shape[-1:] != positions.shape[-2:-1]:
        count = masses.shape[-1] if masses.ndim else 1
        wanted = f"masses {masses.shape} need positions of shape (..., {count}, 3)"
        raise SceneError(f"{wanted}, not {positions.shape}", at="positions")
    tensor: Array = np.einsum("...n,...nij->...ij", masses, shift(positions))
    return tensor


def about_point(tensor: ArrayLike, mass: ArrayLike, offset: ArrayLike) -> Array:
    """Return the tensor about a point from the tensor about the centre of mass.

    TdC (3.26), (3.27):

        I + m (d^2 1 - d d^T)

    tensor (..., 3, 3) about the centre of mass;  mass (...)
    offset : d (..., 3) between the two points, with either sign
    """
    return floats(tensor, "tensor") + _of_point_mass(mass, offset)


def about_centre(tensor: ArrayLike, mass: ArrayLike, offset: ArrayLike) -> Array:
    """Return the tensor about the centre of mass from the tensor about a point, TdC (3.28).

    The inverse of `about_point`.
    """
    return floats(tensor, "tensor") - _of_point_mass(mass, offset)


def _of_point_mass(mass: ArrayLike, offset: ArrayLike) -> Array:
    """Return m (d^2 1 - d d^T) (..., 3, 3)."""
    tensor: Array = floats(mass, "mass")[..., None, None] * shift(floats(offset, "offset", 3))
    return tensor


def angular_momentum(tensor: ArrayLike, omega: ArrayLike) -> Array:
    """Return L = I omega (..., 3), TdC (3.25), parallel to omega only on a principal axis."""
    tensor, omega = floats(tensor, "tensor", 3), floats(omega, "omega", 3)
    momentum: Array = np.einsum("...ij,...j->...i", tensor, omega)
    return momentum


def kinetic_energy(tensor: ArrayLike, omega: ArrayLike) -> Array:
    """Return T = 1/2 omega I omega (...), TdC (3.16)."""
    product = floats(omega, "omega") * angular_momentum(tensor, omega)
    energy: Array = 0.5 * product.sum(-1)
    return energy


def survives(axis: ArrayLike, offset: ArrayLike, relative: float = 1e-12) -> Bools:
    """Return whether principal axes about the centre of mass are also principal about a point.

    The shift adds m (d^2 1 - d d^T). An axis e is an eigenvector of this matrix iff e is parallel
    or perpendicular to d, TdC Example 3.4.

    axis : e (..., 3);  offset : d of the point (..., 3);  relative : tolerance
    """
    axis, offset = floats(axis, "axis", 3), floats(offset, "offset", 3)
    size = np.linalg.norm(axis, axis=-1) * np.linalg.norm(offset, axis=-1)
    along, across = np.abs((axis * offset).sum(-1)), np.linalg.norm(np.cross(axis, offset), axis=-1)
    either: Bools = (along <= relative * size) | (across <= relative * size)
    return either


def principal_axes(tensor: ArrayLike) -> tuple[Array, Array]:
    """Return (moments (..., 3), axes B (..., 3, 3)) of inertia tensors I (..., 3, 3).

    TdC (3.19)-(3.23):

        I = B diag(moments) B^T,   det B = +1

    The columns of B are the axes. Moments ascend, the largest components of the first two axes are
    positive, and the third axis completes a right-handed set. A tensor that is diagonal to 4e-15
    keeps its axes and their order. If two or three moments are equal, Jacobi's rotations, starting
    from the tensor as given, choose the axes in their plane: the same tensor gives the same bits
    (tests/physics/dynamics/test_principal_axes.py).

    A tensor that is not symmetric, not positive or violates the triangle inequality gives nan, and
    a SceneWarning counts these tensors. If all are bad, a SceneError states the reason.
    """
    if isinstance(tensor, DualArray):
        return _principal_axes_with_tangents(tensor)
    tensor = floats(tensor, "tensor")
    if tensor.shape[-2:] != (3, 3):
        rule = f"has shape {tensor.shape}; its last two axes must be 3 and 3"
        raise SceneError(rule, at="tensor")
    if not tensor.size:
        return np.empty(tensor.shape[:-1]), np.empty(tensor.shape)
    flat = tensor.reshape(-1, 3, 3)
    size = np.abs(flat).max((1, 2))
    infinite = ~np.isfinite(size)
    check_rows(infinite, "an inertia tensor must have finite components")
    skew = skew_of(flat)
    bad = infinite | ~(skew <= 1e-9)
    worst = np.max(skew, where=~infinite, initial=0.0)
    rule = (
        f"an inertia tensor must be symmetric; I_ij and I_ji differ by {worst:.2g} of its largest"
        " element"
    )
    check_rows(bad & ~infinite, rule)
    symmetric = 0.5 * (flat + np.swapaxes(flat, 1, 2))
    values = _principal(symmetric[:, *np.transpose(SIX)])
    values[:, bad] = np.nan
    moments = values[:3]
    # particles on a line along no coordinate axis leave a moment of +-6e-17 of the others
    impossible = (violates_triangle(moments) | (moments.min(0) <= 1e-14 * moments.max(0))) & ~bad
    check_rows(
        impossible, why_impossible(moments[:, np.argmax(impossible)]) if impossible.any() else ""
    )
    values[:, impossible] = np.nan
    shape = tensor.shape[:-2]
    axes = np.moveaxis(values[3:].reshape(3, 3, -1), -1, 0).swapaxes(1, 2)
    return values[:3].T.reshape(*shape, 3), axes.reshape(*shape, 3, 3)


def skew_of(tensors: Array) -> Array:
    """Return |I_ij - I_ji| of tensors (n, 3, 3), relative to the largest element of each."""
    size = np.abs(tensors).max((1, 2))
    with np.errstate(invalid="ignore"):
        apart: Array = np.abs(tensors - np.swapaxes(tensors, 1, 2)).max((1, 2))
        # a zero tensor has skew 0
        return apart / np.where(size > 0.0, size, 1.0)


def _principal_axes_with_tangents(tensor: DualArray) -> tuple[Any, Any]:
    """Return `principal_axes` of tensors (n, 3, 3) as DualArrays."""
    moments, axes = principal_axes(tensor.value)
    rates = zip(*(axes_rates(moments, axes, change) for change in tensor.tangents), strict=True)
    moving, turning = map(np.stack, rates)
    return DualArray(moments, moving), DualArray(axes, turning)


def why_impossible(moments: Array) -> str:
    """Return why no rotating body can have these moments (3,)."""
    example = ", ".join(f"{m:.6g}" for m in moments)
    low, middle, high = np.sort(moments)
    if high == low == 0.0:
        return "all moments are 0: all mass lies at the fixed point, or the body has no mass"
    if abs(low) <= 1e-9 * high and high - middle <= 1e-9 * high:
        return (
            f"principal moments must be positive, but are ({example}): all mass lies on a line"
            " through the fixed point, and rotation about this line has no inertia; give the body"
            " a thickness, such as the radius of a rod"
        )
    excess = f"{high - low - middle:.3g}"
    return (
        f"principal moments must be positive and obey {TRIANGLE}, but in ({example}) one exceeds"
        f" the sum of the others by {excess}: no mass distribution has these moments"
    )


def _principal(six: Array) -> Array:
    """Return the 12 values of `Principal` (12, n) for tensors with the elements (n, 6)."""
    if len(six) == 1:  # does not import the compiler
        return np.array([Principal(*t).values() for t in six.tolist()]).T
    from rigidmc.engine.formulas import evaluate

    values: Array = evaluate(Principal, 12, six.T)
    return values


def growth_rate(moments: ArrayLike) -> Array:
    """Return lambda/omega (...), the growth rate of a disturbed spin about the middle axis.

        lambda = omega sqrt((I2 - I1)(I3 - I2)/(I1 I3)),   I1 <= I2 <= I3

    moments (..., 3) in any order. The rate is 0 if two moments are equal.
    """
    one, two, three = np.moveaxis(np.sort(floats(moments, "moments", 3), axis=-1), -1, 0)
    rate: Array = np.sqrt((two - one) / one * ((three - two) / three))
    return rate


def _names() -> tuple[tuple[tuple[int, ...], tuple[float, ...]], ...]:
    """Return the 24 right-handed labellings of the axes of a body: (axes, signs) of each."""
    ways = []
    for places, signs in product(permutations(range(3)), product((1.0, -1.0), repeat=3)):
        frame = np.eye(3)[:, places] * signs
        if np.linalg.det(frame) > 0.0:
            ways.append((places, signs))
    return tuple(ways)


NAMES = _names()


def match_axes(moments: ArrayLike, axes: ArrayLike, mean: ArrayLike) -> tuple[Array, Array]:
    """Return (moments (3, n), turn (3, 3, n)) of bodies, axes labelled after the nearest axes.

    moments (n, 3), axes (n, 3, 3) : from `rigidmc.mechanics.inertia.principal_axes`
    mean (3, 3) : axes of the reference body

    Of the 24 right-handed labellings, the one with the smallest turn is used: less than 63 deg
    (tests/scene/test_uncertain_inertia.py).
    """
    values, columns, middle = as_array(moments).T, as_array(axes), as_array(mean)
    turn = np.stack(
        [
            np.stack([sum(middle[k, i] * columns[:, k, j] for k in range(3)) for j in range(3)])
            for i in range(3)
        ]
    )
    traces = np.stack(
        [sum(s * turn[i, p] for i, (p, s) in enumerate(zip(*way, strict=True))) for way in NAMES]
    )
    best = traces.argmax(0)
    places, signs = (np.array([way[k] for way in NAMES])[best].T for k in (0, 1))
    members = np.arange(values.shape[1])
    return values[places, members], np.stack([row[places, members] * signs for row in turn])


def nearest_axes(tensor: ArrayLike) -> tuple[Array, Array]:
    """Return (moments (3,), axes (3, 3)) of a tensor (3, 3), as `principal_axes` but not sorted.

    Each principal axis has the number of the axis of the tensor that is nearest to it: a product
    of inertia of 1e-9 changes an axis by 1e-9, and no number.
    """
    moments, axes = principal_axes(tensor)
    named, turn = match_axes(moments[None], axes[None], np.eye(3))
    return named[:, 0], turn[:, :, 0]


def quaternions(turn: Array) -> tuple[Array, ...]:
    """Return the unit quaternions (w, x, y, z) of turns (3, 3, n).

    Turns from `match_axes` are far from 180 deg. Axes given by a user may be near it: there w is a
    small difference, and the largest of the other components comes first.
    """
    skew = turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]
    xx, yy, zz = turn[0, 0], turn[1, 1], turn[2, 2]
    square = 1.0 + xx + yy + zz  # (2 w)^2
    is_far = square > 0.5
    w = 0.5 * np.sqrt(np.where(is_far, square, 1.0))  # where it is 1, w is unused
    by = 0.25 / w
    q: tuple[Array, ...] = (w, by * skew[0], by * skew[1], by * skew[2])
    if is_far.all():
        return q
    squares = np.stack([1.0 + xx - yy - zz, 1.0 - xx + yy - zz, 1.0 - xx - yy + zz])
    best = squares.argmax(0)
    for i in range(3):
        here = ~is_far & (best == i)
        of = 0.5 * np.sqrt(np.where(here, squares[i], 1.0))
        near = [of if k == i else 0.25 / of * (turn[i, k] + turn[k, i]) for k in range(3)]
        near.insert(0, 0.25 / of * skew[i])
        q = tuple(np.where(here, close, other) for close, other in zip(near, q, strict=True))
    return q


def vectors_into(turn: Array, vectors: Any) -> Array:
    """Return turn^T v (3, n) of vectors v (3, n)."""
    return np.stack([sum(turn[k, i] * vectors[k] for k in range(3)) for i in range(3)])


def vectors_from(turn: Array, vectors: Any) -> Array:
    """Return turn v (3, n) of vectors v (3, n)."""
    return np.stack([sum(turn[i, k] * vectors[k] for k in range(3)) for i in range(3)])


def tensors_into(turn: Array, six: Any) -> Array:
    """Return turn^T C turn of tensors C, given and returned as xx, yy, zz, yz, zx, xy (6, n)."""
    xx, yy, zz, yz, zx, xy = six
    rows = (xx, xy, zx), (xy, yy, yz), (zx, yz, zz)
    half = [vectors_into(turn, row) for row in rows]  # (C turn)[row][i]
    turned = [vectors_into(turn, [row[i] for row in half]) for i in range(3)]
    return np.stack([turned[j][i] for i, j in SIX])
