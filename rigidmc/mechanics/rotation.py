"""Rotations for users: quaternions, matrices, Euler angles, rotation vectors, angular velocity.

A maps body to space components, x = A x'; its columns are the body axes in space, TdC (3.1)-(3.5).
Quaternions (w, x, y, z) represent the same rotation, scalar first; q and -q are the same attitude.
omega has body components unless a name ends in _space: dA/dt = A hat(omega). Arrays have components
last and any leading shape. An `attitude` consists of quaternions (..., 4), matrices (..., 3, 3), a
scipy Rotation, or one triple of Euler angles (phi, theta, psi), z-x-z.
"""

from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rigidmc.errors import SceneError, warn
from rigidmc.inputs.arrays import Array, check_rows, floats
from rigidmc.inputs.labelled import Wanted
from rigidmc.inputs.measured import euler_degrees_note, is_foreign, numbers_in
from rigidmc.mechanics.euler_angles import (
    TEXTBOOK,
    angles_of_quaternions,
    check_sequence,
    quaternions_of_angles,
    wrapped,
)
from rigidmc.physics.dynamics.functions import sincos
from rigidmc.physics.dynamics.quaternions import multiply

_EYE = np.eye(3)
_Numbers = float | Array


@runtime_checkable
class Rotations(Protocol):
    """The method of scipy's Rotation that this module uses."""

    def as_quat(self, *, scalar_first: bool) -> Any: ...


Attitude = ArrayLike | Rotations


def quaternion(attitude: Attitude) -> Array:
    """Return the unit quaternions (..., 4) of an attitude; three numbers are Euler angles z-x-z.

    SceneError for a wrong shape, a norm of 0, or a matrix that is not a rotation (with its
    deviation from one). If only some elements are bad, these become nan and a SceneWarning counts
    them. Another warns of Euler angles that look like degrees.
    """
    if isinstance(attitude, Rotations):
        return np.asarray(attitude.as_quat(scalar_first=True))
    if is_foreign(attitude) or (isinstance(attitude, (list, tuple)) and len(attitude) == 3):
        attitude = numbers_in("rad", attitude, "attitude")
    array = floats(attitude, "attitude", wanted=Wanted((4,), by_member=False))
    if array.shape[-2:] == (3, 3):
        return quaternion_from_matrix(array)
    if array.shape == (3,):
        if note := euler_degrees_note(array, "attitude: an Euler angle of", 'write "30 deg"'):
            warn(note)
        return from_euler(array)
    if array.shape[-1:] != (4,):
        allowed = (
            "quaternions (..., 4), matrices (..., 3, 3), a scipy Rotation, or three Euler angles"
            " z-x-z"
        )
        raise SceneError(f"has shape {array.shape}: give {allowed}", at="attitude")
    norm = np.linalg.norm(array, axis=-1, keepdims=True)
    bad = ~(norm[..., 0] > 0.0) | ~np.isfinite(norm[..., 0])
    check_rows(bad, "a quaternion must be finite and nonzero")
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(bad[..., None], np.nan, array / norm)


def rotation(attitude: Attitude) -> Any:
    """Return the scipy Rotation of an attitude, for the leading shapes that scipy supports."""
    from scipy.spatial.transform import Rotation

    if isinstance(attitude, Rotations):
        return attitude
    return Rotation.from_quat(quaternion(attitude), scalar_first=True)


def matrix(attitude: Attitude) -> Array:
    """Return the matrices A (..., 3, 3), body to space, of an attitude, TdC (3.1)."""
    w, x, y, z = np.moveaxis(quaternion(attitude), -1, 0)
    rows = (
        (w * w + x * x - y * y - z * z, 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)),
        (2.0 * (x * y + w * z), w * w - x * x + y * y - z * z, 2.0 * (y * z - w * x)),
        (2.0 * (x * z - w * y), 2.0 * (y * z + w * x), w * w - x * x - y * y + z * z),
    )
    return np.stack([np.stack(row, -1) for row in rows], -2)


def quaternion_from_matrix(matrix: ArrayLike, at: str = "matrix") -> Array:
    """Return the quaternions (..., 4) of rotation matrices (..., 3, 3).

    A matrix is bad if A A^T differs from 1 by more than 1e-9, or if its determinant is negative.

    at : place of the matrix, for the message
    """
    from scipy.spatial.transform import Rotation

    array = floats(matrix, "matrix")
    flat = array.reshape(-1, 3, 3)
    defect = np.abs(flat @ np.swapaxes(flat, -1, -2) - _EYE).max(axis=(-2, -1))
    mirrored = np.linalg.det(flat) < 0.0
    bad = ~(defect < 1e-9) | mirrored
    if bad.any():
        worst = defect[bad].max() if not np.isnan(defect).any() else np.nan
        how = (
            f"A A^T differs from 1 by {worst:.2g}"
            if not (defect[bad] < 1e-9).all()
            else "its determinant is -1, a mirror image"
        )
        check_rows(bad, f"not a rotation: {how}", at)
    q = np.full((len(flat), 4), np.nan)
    if not bad.all():
        q[~bad] = Rotation.from_matrix(flat[~bad]).as_quat(scalar_first=True)
    return q.reshape(*array.shape[:-2], 4)


def quaternion_from_euler(phi: _Numbers, theta: _Numbers, psi: _Numbers) -> Array:
    """Return quaternions (4, ...), components FIRST, of A = Rz(phi) Rx(theta) Rz(psi), TdC (3.36).

    The angles [rad] have any common shape.
    """
    plus, minus, half = 0.5 * (phi + psi), 0.5 * (phi - psi), 0.5 * theta
    s, c = sincos(half)
    sin_plus, cos_plus = sincos(plus)
    sin_minus, cos_minus = sincos(minus)
    return np.stack([c * cos_plus, s * cos_minus, s * sin_minus, c * sin_plus])


def from_euler(angles: ArrayLike, sequence: str = TEXTBOOK) -> Array:
    """Return the quaternions (..., 4) of Euler angles (..., 3) [rad], in order of the rotations.

    sequence : of `rigidmc.mechanics.euler_angles`; "313" is A = Rz(phi) Rx(theta) Rz(psi),
        TdC (3.36), "321" is A = Rz(yaw) Ry(pitch) Rx(roll)
    """
    phi, theta, psi = np.moveaxis(floats(angles, "angles", 3), -1, 0)
    sequence = check_sequence(sequence)
    if sequence == TEXTBOOK:
        return np.moveaxis(quaternion_from_euler(phi, theta, psi), 0, -1)
    return np.moveaxis(quaternions_of_angles(sequence, phi, theta, psi), 0, -1)


def euler(attitude: Attitude, sequence: str = TEXTBOOK) -> Array:
    """Return the Euler angles (..., 3) [rad] of an attitude, in order of the rotations.

    sequence : as for `from_euler`

    For "313", 0 <= theta <= pi, and phi and psi lie in (-pi, pi]. The angles reproduce the attitude
    to rounding everywhere. If sin(theta) = 0, only phi + psi (theta = 0) or phi - psi (theta = pi)
    is determined, and psi is 0; near these poles psi is as accurate as the attitude allows.
    """
    q = np.moveaxis(quaternion(attitude), -1, 0)
    sequence = check_sequence(sequence)
    if sequence != TEXTBOOK:
        return np.moveaxis(angles_of_quaternions(sequence, q), 0, -1)
    w, x, y, z = q
    # arccos of w^2 + z^2 - x^2 - y^2 would be 1.5e-8 rad off near the poles
    theta = 2.0 * np.arctan2(np.hypot(x, y), np.hypot(w, z))
    plus, minus = np.arctan2(z, w), np.arctan2(y, x)  # (phi + psi)/2, (phi - psi)/2
    upright, inverted = (x == 0.0) & (y == 0.0), (w == 0.0) & (z == 0.0)
    plus, minus = np.where(inverted, minus, plus), np.where(upright, plus, minus)
    return np.stack([wrapped(plus + minus), theta, wrapped(plus - minus)], -1)


def from_rotation_vector(vector: ArrayLike) -> Array:
    """Return the quaternions (..., 4) of rotation vectors (..., 3) [rad], whose length is the
    angle."""
    v = floats(vector, "vector", 3)
    half = 0.5 * np.linalg.norm(v, axis=-1, keepdims=True)
    return np.concatenate([np.cos(half), 0.5 * np.sinc(half / np.pi) * v], -1)


def rotation_vector(attitude: Attitude) -> Array:
    """Return the rotation vectors (..., 3) [rad] of an attitude, of length 0 to pi."""
    q = quaternion(attitude)
    q = np.where(q[..., :1] < 0.0, -q, q)
    size = np.linalg.norm(q[..., 1:], axis=-1, keepdims=True)
    # q and -q are one attitude: w >= 0 chooses the turn by at most pi
    angle = 2.0 * np.arctan2(size, q[..., :1])
    # the limit at size 0 is 2; the divisor 1 keeps the unused quotient finite
    return np.where(size > 0.0, angle / np.where(size > 0.0, size, 1.0), 2.0) * q[..., 1:]


def to_space(attitude: Attitude, vector: ArrayLike) -> Array:
    """Return space components x = A x' (..., 3) of vectors in body components x', TdC (3.3)."""
    vector = floats(vector, "vector", 3)
    components: Array = np.einsum("...ij,...j->...i", matrix(attitude), vector)
    return components


def to_body(attitude: Attitude, vector: ArrayLike) -> Array:
    """Return body components x' = A^T x (..., 3) of vectors in space components x.

    TdC (3.4), (3.5).
    """
    vector = floats(vector, "vector", 3)
    components: Array = np.einsum("...ji,...j->...i", matrix(attitude), vector)
    return components


def product(p: ArrayLike, q: ArrayLike) -> Array:
    """Return Hamilton products p q (..., 4): the rotation q first, then p."""
    p, q = np.moveaxis(floats(p, "p", 4), -1, 0), np.moveaxis(floats(q, "q", 4), -1, 0)
    return np.stack(multiply(p, q), -1)


def attitude_error(p: Attitude, q: Attitude) -> Array:
    """Return the angle (...) [rad] between two attitudes.

    Uses 4 arcsin(|p -+ q|/2), not arccos |p.q|, which loses half the digits.
    """
    p, q = quaternion(p), quaternion(q)
    chord = np.minimum(np.linalg.norm(p - q, axis=-1), np.linalg.norm(p + q, axis=-1))
    angle: Array = 4.0 * np.arcsin(np.minimum(0.5 * chord, 1.0))
    return angle


def angular_velocity(matrix: Array, rate: Array) -> Array:
    """Return omega (..., 3) [rad/s] of A (..., 3, 3) and dA/dt from hat(omega) = A^T dA/dt.

    TdC (3.7)-(3.9); TdC's A'^T A is the transpose of this. Only the antisymmetric part counts: the
    part of dA/dt that leaves the group of rotations is ignored.
    """
    return vee(np.swapaxes(matrix, -1, -2) @ rate)


def angular_velocity_space(matrix: Array, rate: Array) -> Array:
    """Return omega (..., 3) [rad/s] in space components: hat(omega_space) = dA/dt A^T."""
    return vee(rate @ np.swapaxes(matrix, -1, -2))


def angular_velocity_of_series(
    t: ArrayLike, attitude: Attitude, space: bool = False, points: int = 7
) -> Array:
    """Return omega (n, ..., 3) [rad/s] at the times t (n,) of sampled attitudes (n, ...).

    The components are body components unless `space`. At each time, the neighbouring attitudes
    become rotation vectors from the attitude at that time, whose derivative there is omega. The
    derivative of the polynomial through `points` of them has order points - 1, even at the ends and
    for uneven times. Neighbours within half the stencil must be less than half a revolution apart.

    SceneError for fewer than 2 samples, or times that do not ascend.
    """
    t, q = floats(t, "t"), quaternion(attitude)
    if t.ndim != 1 or t.size < 2 or q.shape[0] != t.size or not np.all(np.diff(t) > 0):
        rule = (
            "give at least 2 ascending times and the same number of attitudes, "
            f"not shapes {t.shape} and {q.shape}"
        )
        raise SceneError(rule, at="t")
    # 7 points: 1e-7 of omega at 50 samples a turn, where 3 points leave 1e-3. 11 points span more
    # than half a turn from the ends, and fail there at 25 samples a turn.
    points = min(points, t.size)
    first = np.clip(np.arange(t.size) - points // 2, 0, t.size - points)
    stencil = first[:, None] + np.arange(points)
    apart = t[stencil] - t[:, None]
    # powers of times as fractions of the stencil: condition 200 in the middle and 4e4 at the ends,
    # where times in s have 1e11 for samples every 0.01 s
    scale = np.abs(apart).max(axis=1, keepdims=True)
    # the weights give the derivative of every power below `points` exactly
    powers = (apart / scale)[:, None, :] ** np.arange(points)[:, None]
    derivatives = np.broadcast_to(np.eye(points)[:, 1:2], (t.size, points, 1))
    weights = np.linalg.solve(powers, derivatives)[..., 0] / scale
    inverse = q[:, None] * np.array([1.0, -1.0, -1.0, -1.0])
    vectors = rotation_vector(product(inverse, q[stencil]))
    omega: Array = np.einsum("np,np...->n...", weights, vectors)
    return to_space(q, omega) if space else omega


def hat(v: ArrayLike) -> NDArray[Any]:
    """Return the matrices hat(v) (..., 3, 3) with hat(v) w = v x w, complex for complex v."""
    x, y, z = np.moveaxis(floats(v, "v", 3, kinds="fiuc"), -1, 0)
    zero = 0.0 * x
    rows = (zero, -z, y), (z, zero, -x), (-y, x, zero)
    return np.stack([np.stack(row, -1) for row in rows], -2)


def vee(m: Array) -> Array:
    """Return the vectors v (..., 3) whose hat(v) is the antisymmetric part of matrices."""
    one, two = m[..., 2, 1] - m[..., 1, 2], m[..., 0, 2] - m[..., 2, 0]
    vector: Array = 0.5 * np.stack([one, two, m[..., 1, 0] - m[..., 0, 1]], -1)
    return vector
