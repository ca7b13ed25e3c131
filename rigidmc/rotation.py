"""Rotations for users: quaternions (w, x, y, z) that turn body to space components, matrices, Euler angles z-x-z."""

import numpy as np

from rigidmc.errors import SceneError


def quaternion_from_euler(phi, theta, psi):
    """Quaternions (4, ...) of A = Rz(phi) Rx(theta) Rz(psi), TdC (3.36). Angles [rad] of any one shape."""
    plus, minus, half = 0.5 * (phi + psi), 0.5 * (phi - psi), 0.5 * theta
    c, s = np.cos(half), np.sin(half)
    return np.stack([c * np.cos(plus), s * np.cos(minus), s * np.sin(minus), c * np.sin(plus)])


def quaternion_from_matrix(matrix, table="", key="matrix"):
    """Quaternions (..., 4) of rotation matrices (..., 3, 3); SceneError where A A^T or det A is off by more than 1e-9."""
    from scipy.spatial.transform import Rotation

    defect = np.abs(matrix @ np.swapaxes(matrix, -1, -2) - np.eye(3)).max()
    if not defect < 1e-9:
        raise SceneError(table, key, None, f"no rotation: A A^T differs from 1 by {defect:.2g}")
    if not (np.linalg.det(matrix) > 0).all():
        raise SceneError(table, key, None, "no rotation: its determinant is -1, a mirror image")
    return Rotation.from_matrix(matrix).as_quat(scalar_first=True)


def matrix_from_quaternion(q):
    """Matrices (..., 3, 3) of quaternions (..., 4), body to space, TdC (3.1)."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_quat(np.asarray(q, dtype=float), scalar_first=True).as_matrix()
