"""Principal axes in lanes: reconstruction, orthonormality, choice of axes, degenerate tensors."""

import mpmath as mp
import numpy as np
import pytest

from rigidmc.physics.dynamics.principal_axes import principal

RNG = np.random.default_rng(20)


def axes_of(tensor):
    (xx, xy, zx), (_, yy, yz), (_, _, zz) = tensor
    values = principal(xx, yy, zz, yz, zx, xy)
    return np.array(values[:3]), np.array(values[3:]).reshape(3, 3).T


def turned(moments):
    b = np.linalg.qr(RNG.normal(size=(3, 3)))[0]
    tensor = (b * moments) @ b.T
    return 0.5 * (tensor + tensor.T)


CASES = [
    turned(np.array([1.0, 1.0 + split, third]))
    for split in (0.0, 1e-15, 1e-12, 1e-6, 0.3)
    for third in (1.0, 1.0 + 1e-13, 1.9, 0.1)
]
CASES += [turned(np.array([1e-6, 1.0, 1.0])) for _ in range(5)] + [
    turned(RNG.uniform(0.5, 1.0, 3)) for _ in range(20)
]


@pytest.mark.parametrize("tensor", CASES)
def test_reconstructs_the_tensor_with_right_handed_orthonormal_axes(tensor):
    moments, b = axes_of(tensor)
    # 5.1e-16; 2.2e-15 of a million tensors
    assert np.abs((b * moments) @ b.T - tensor).max() < 3e-15 * np.abs(tensor).max()
    assert np.abs(b.T @ b - np.eye(3)).max() < 3e-15  # 6.7e-16; 2.7e-15 of a million
    assert np.linalg.det(b) > 0.0


@pytest.mark.parametrize("tensor", CASES[-20:])
def test_moments_are_the_eigenvalues_in_ascending_order(tensor):
    moments, b = axes_of(tensor)
    with mp.workdps(40):
        truth = sorted(mp.eigsy(mp.matrix(tensor.tolist()), eigvals_only=True))
        # 1.7e-16
        assert max(abs(float(a - t)) for a, t in zip(moments, truth, strict=True)) < 2e-15
    for axis in b.T[:2]:
        assert axis[np.abs(axis).argmax()] > 0.0


def test_diagonal_tensor_keeps_its_axes_and_their_order():
    moments, b = axes_of(np.diag([3.0, 1.0, 2.0]))
    assert moments.tolist() == [3.0, 1.0, 2.0]
    assert (b == np.eye(3)).all()
    nearly, beyond = np.diag([3.0, 1.0, 2.0]), np.diag([3.0, 1.0, 2.0])
    nearly[0, 1], beyond[0, 1] = 3.0 * 4e-15, 3.0 * 5e-15
    assert (axes_of(nearly)[1] == np.eye(3)).all() and (axes_of(beyond)[1] != np.eye(3)).any()


@pytest.mark.parametrize("scale", [1e-150, 1e-46, 1e37, 1e150])
def test_any_unit_of_inertia_works(scale):
    tensor = CASES[-1]
    moments, b = axes_of(scale * tensor)
    assert np.abs((b * (moments / scale)) @ b.T - tensor).max() < 3e-15  # 3.3e-16
