"""Rotations for users: attitudes as quaternions, matrices, Euler angles and rotation vectors, and the rates that go with them.

Conventions: A maps body to space components, x = A x', its columns are the body axes in space, TdC
(3.1)-(3.5). Quaternions (w, x, y, z) are the same rotation, scalar first; q and -q are one
attitude. omega has body components unless a name ends in _space: dA/dt = A hat(omega). Arrays have
components last and any leading shape. Whatever takes an `attitude` takes quaternions (..., 4),
matrices (..., 3, 3) or a scipy Rotation.
"""

import numpy as np

from rigidmc.dynamics.so3 import multiply, sincos
from rigidmc.errors import SceneError, flag

CONVENTIONS = ("zxz", "zyz")
_EYE = np.eye(3)


def quaternion(attitude):
    """Unit quaternions (..., 4) of an attitude. SceneError for a wrong shape, a norm of 0, a matrix that is no rotation and how far it
    is from one; where some elements of many are bad they are nan, and a SceneWarning counts them.
    """
    if hasattr(attitude, "as_quat"):
        return np.asarray(attitude.as_quat(scalar_first=True))
    array = np.asarray(attitude, dtype=float)
    if array.shape[-2:] == (3, 3):
        return quaternion_from_matrix(array)
    if array.shape[-1:] != (4,):
        rule = f"has shape {array.shape}: give quaternions (..., 4), matrices (..., 3, 3) or a scipy Rotation"
        raise SceneError("", "attitude", None, rule)
    norm = np.linalg.norm(array, axis=-1, keepdims=True)
    bad = ~(norm[..., 0] > 0.0) | ~np.isfinite(norm[..., 0])
    flag(bad, "a quaternion must be finite and have a norm")
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(bad[..., None], np.nan, array / norm)


def rotation(attitude):
    """The scipy Rotation of attitudes, for the leading shapes that scipy takes."""
    from scipy.spatial.transform import Rotation

    return (
        attitude
        if hasattr(attitude, "as_quat")
        else Rotation.from_quat(quaternion(attitude), scalar_first=True)
    )


def matrix(attitude):
    """Matrices A (..., 3, 3), body to space, TdC (3.1)."""
    w, x, y, z = np.moveaxis(quaternion(attitude), -1, 0)
    rows = (
        (w * w + x * x - y * y - z * z, 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)),
        (2.0 * (x * y + w * z), w * w - x * x + y * y - z * z, 2.0 * (y * z - w * x)),
        (2.0 * (x * z - w * y), 2.0 * (y * z + w * x), w * w - x * x - y * y + z * z),
    )
    return np.stack([np.stack(row, -1) for row in rows], -2)


def quaternion_from_matrix(matrix, table="", key="matrix"):
    """Quaternions (..., 4) of rotation matrices (..., 3, 3); bad is what A A^T or det A is off in by more than 1e-9."""
    from scipy.spatial.transform import Rotation

    array = np.asarray(matrix, dtype=float)
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
        flag(bad, f"no rotation: {how}", table, key)
    q = np.full((len(flat), 4), np.nan)
    if not bad.all():
        q[~bad] = Rotation.from_matrix(flat[~bad]).as_quat(scalar_first=True)
    return q.reshape(*array.shape[:-2], 4)


def quaternion_from_euler(phi, theta, psi):
    """Quaternions (4, ...), components FIRST, of A = Rz(phi) Rx(theta) Rz(psi), TdC (3.36). Angles [rad] of any one shape."""
    plus, minus, half = 0.5 * (phi + psi), 0.5 * (phi - psi), 0.5 * theta
    (s, c), (sine, cosine), (other, more) = sincos(half), sincos(plus), sincos(minus)
    return np.stack([c * cosine, s * more, s * other, c * sine])


def from_euler(angles, convention="zxz"):
    """Quaternions (..., 4) of Euler angles (phi, theta, psi) (..., 3) [rad]: A = Rz(phi) Rx(theta) Rz(psi), TdC (3.36), or with "zyz"
    Rz(phi) Ry(theta) Rz(psi)."""
    phi, theta, psi = np.moveaxis(np.asarray(angles, dtype=float), -1, 0)
    w, x, y, z = quaternion_from_euler(phi, theta, psi)
    return np.stack((w, x, y, z) if _is_zxz(convention) else (w, -y, x, z), -1)


def euler(attitude, convention="zxz"):
    """Euler angles (phi, theta, psi) (..., 3) [rad] of an attitude, 0 <= theta <= pi, the others in (-pi, pi].

    They give the attitude back to rounding everywhere. Where sin(theta) = 0 only phi + psi (theta =
    0) or phi - psi (theta = pi) is determined: there psi is 0; near it psi is as good as the
    attitude allows.
    """
    w, x, y, z = np.moveaxis(quaternion(attitude), -1, 0)
    if not _is_zxz(convention):
        x, y = y, -x
    theta = 2.0 * np.arctan2(np.hypot(x, y), np.hypot(w, z))
    plus, minus = np.arctan2(z, w), np.arctan2(y, x)  # (phi + psi)/2, (phi - psi)/2
    upright, inverted = (x == 0.0) & (y == 0.0), (w == 0.0) & (z == 0.0)
    plus, minus = np.where(inverted, minus, plus), np.where(upright, plus, minus)
    return np.stack([_wrapped(plus + minus), theta, _wrapped(plus - minus)], -1)


def from_rotation_vector(vector):
    """Quaternions (..., 4) of rotation vectors (..., 3) [rad]: a turn by their length about them."""
    v = np.asarray(vector, dtype=float)
    half = 0.5 * np.linalg.norm(v, axis=-1, keepdims=True)
    return np.concatenate([np.cos(half), 0.5 * np.sinc(half / np.pi) * v], -1)


def rotation_vector(attitude):
    """Rotation vectors (..., 3) [rad] of an attitude, of length 0 to pi."""
    q = quaternion(attitude)
    q = np.where(q[..., :1] < 0.0, -q, q)
    size = np.linalg.norm(q[..., 1:], axis=-1, keepdims=True)
    angle = 2.0 * np.arctan2(size, q[..., :1])
    return np.where(size > 0.0, angle / np.where(size > 0.0, size, 1.0), 2.0) * q[..., 1:]


def to_space(attitude, vector):
    """Space components x = A x' (..., 3) of vectors given in the body, TdC (3.3)."""
    return np.einsum("...ij,...j->...i", matrix(attitude), np.asarray(vector, dtype=float))


def to_body(attitude, vector):
    """Body components x' = A^T x (..., 3) of vectors given in space, TdC (3.4), (3.5)."""
    return np.einsum("...ji,...j->...i", matrix(attitude), np.asarray(vector, dtype=float))


def product(p, q):
    """Hamilton products p q (..., 4): the turn q first, then p."""
    return np.stack(
        multiply(np.moveaxis(np.asarray(p), -1, 0), np.moveaxis(np.asarray(q), -1, 0)), -1
    )


def attitude_error(p, q):
    """The angle (...) [rad] between two attitudes: 4 arcsin(|p -+ q|/2), never arccos |p.q|, which loses half the digits."""
    p, q = quaternion(p), quaternion(q)
    chord = np.minimum(np.linalg.norm(p - q, axis=-1), np.linalg.norm(p + q, axis=-1))
    return 4.0 * np.arcsin(np.minimum(0.5 * chord, 1.0))


def angular_velocity(matrix, rate):
    """omega (..., 3) [rad/s] of A (..., 3, 3) and dA/dt: hat(omega) = A^T dA/dt, TdC (3.7)-(3.9) (the chapter's A'^T A is its transpose).

    Only the antisymmetric part counts: what of dA/dt leaves the rotations is dropped.
    """
    return _vee(np.swapaxes(matrix, -1, -2) @ rate)


def angular_velocity_space(matrix, rate):
    """The same in space components: hat(omega_space) = dA/dt A^T."""
    return _vee(rate @ np.swapaxes(matrix, -1, -2))


def angular_velocity_of_series(t, attitude, space=False, points=7):
    """omega (n, ..., 3) [rad/s] at the times t (n,) of sampled attitudes (n, ...), body components unless `space`.

    At each time the neighbours are taken as rotation vectors from it, of which omega is the
    derivative there; that of the polynomial through `points` of them has order points - 1, also at
    the ends and for uneven times. Neighbours within half the stencil must be less than half a turn
    apart. SceneError for fewer than 2 samples, or times that do not ascend.
    """
    t, q = np.asarray(t, dtype=float), quaternion(attitude)
    if t.ndim != 1 or t.size < 2 or q.shape[0] != t.size or not np.all(np.diff(t) > 0):
        rule = f"give at least 2 ascending times and as many attitudes, not shapes {t.shape} and {q.shape}"
        raise SceneError("", "t", None, rule)
    points = min(points, t.size)
    first = np.clip(np.arange(t.size) - points // 2, 0, t.size - points)
    stencil = first[:, None] + np.arange(points)
    apart = t[stencil] - t[:, None]
    scale = np.abs(apart).max(axis=1, keepdims=True)
    powers = (apart / scale)[:, None, :] ** np.arange(points)[
        :, None
    ]  # weights reproduce the derivative of every power up to the last
    weights = (
        np.linalg.solve(powers, np.broadcast_to(np.eye(points)[:, 1:2], (t.size, points, 1)))[
            ..., 0
        ]
        / scale
    )
    own = q[:, None]
    turns = rotation_vector(product(own * np.array([1.0, -1.0, -1.0, -1.0]), q[stencil]))
    omega = np.einsum("np,np...->n...", weights, turns)
    return to_space(q, omega) if space else omega


def euler_rate_matrix(angles, convention="zxz"):
    """M (..., 3, 3) with omega = M (phi', theta', psi'), TdC (3.37); complex angles pass through it."""
    _, theta, psi = np.moveaxis(np.asarray(angles), -1, 0)
    zero, one = 0.0 * theta, 1.0 + 0.0 * theta
    s, c, sp, cp = np.sin(theta), np.cos(theta), np.sin(psi), np.cos(psi)
    first, second = (
        ((s * sp, cp), (s * cp, -sp)) if _is_zxz(convention) else ((-s * cp, sp), (s * sp, cp))
    )
    return np.stack(
        [np.stack([*first, zero], -1), np.stack([*second, zero], -1), np.stack([c, zero, one], -1)],
        -2,
    )


def omega_from_euler_rates(angles, rates, convention="zxz"):
    """omega (..., 3) of Euler angles and their rates, TdC (3.37): omega_1 = phi' sin theta sin psi + theta' cos psi and so on."""
    return np.einsum(
        "...ij,...j->...i", euler_rate_matrix(angles, convention), np.asarray(rates, dtype=float)
    )


def euler_rates(angles, omega, convention="zxz"):
    """(phi', theta', psi') (..., 3) of Euler angles and omega, TdC (3.38); nan, with a SceneWarning, where sin(theta) = 0: phi' and psi'
    are not determined there."""
    angles, omega = np.broadcast_arrays(
        np.asarray(angles, dtype=float), np.asarray(omega, dtype=float)
    )
    one, two, three = np.moveaxis(omega, -1, 0)
    if not _is_zxz(convention):
        one, two = two, -one
    _, theta, psi = np.moveaxis(angles, -1, 0)
    bad = np.sin(theta) == 0.0
    flag(bad, "Euler rates need sin(theta) other than 0")
    with np.errstate(all="ignore"):
        phi = np.where(bad, np.nan, (one * np.sin(psi) + two * np.cos(psi)) / np.sin(theta))
    return np.stack([phi, one * np.cos(psi) - two * np.sin(psi), three - phi * np.cos(theta)], -1)


def kinetic_energy_of_euler_rates(moments, angles, rates, convention="zxz"):
    """T = 1/2 sum I_i omega_i^2 [J] in Euler angles and rates, TdC (3.39)."""
    return 0.5 * (
        np.asarray(moments, dtype=float) * omega_from_euler_rates(angles, rates, convention) ** 2
    ).sum(-1)


def hat(v):
    """The matrices (..., 3, 3) with hat(v) x = v x x; complex v too."""
    x, y, z = np.moveaxis(np.asarray(v), -1, 0)
    zero = 0.0 * x
    return np.stack(
        [np.stack([zero, -z, y], -1), np.stack([z, zero, -x], -1), np.stack([-y, x, zero], -1)], -2
    )


def _vee(m):
    return 0.5 * np.stack(
        [m[..., 2, 1] - m[..., 1, 2], m[..., 0, 2] - m[..., 2, 0], m[..., 1, 0] - m[..., 0, 1]], -1
    )


def _wrapped(angle):
    """An angle of (-2 pi, 2 pi] in (-pi, pi]."""
    return np.where(
        angle > np.pi, angle - 2.0 * np.pi, np.where(angle <= -np.pi, angle + 2.0 * np.pi, angle)
    )


def _is_zxz(convention):
    if convention not in CONVENTIONS:
        raise ValueError(f"convention = {convention!r}: expected one of {', '.join(CONVENTIONS)}")
    return convention == "zxz"
