"""Bodies: tensors and principal axes, against the chapter; and impossible ones."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import rigidmc as rm
from rigidmc.mechanics.inertia import principal_axes, violates_triangle


def test_four_particles_of_the_chapter():
    """TdC Example 3.2: moments 1, 3, 4 (m a^2), axes (1, 1, 0), (1, -1, 0), (0, 0, 1)."""
    m, a = 0.3, 0.7
    body = rm.Body.from_particles([m] * 4, [(a, 0, 0), (0, a, 0), (a, a, 0), (0, 0, 0)])
    # measured 3.3e-16
    assert np.allclose(
        body.tensor, m * a * a * np.array([[2, -1, 0], [-1, 2, 0], [0, 0, 4]]), rtol=0, atol=1e-15
    )
    assert np.allclose(body.moments, m * a * a * np.array([1, 3, 4]), rtol=1e-15)
    axes = np.array(body.axes)
    assert np.allclose(
        np.abs(axes), np.array([[1, 1, 0], [1, 1, 0], [0, 0, np.sqrt(2)]]) / np.sqrt(2), atol=1e-15
    )
    assert axes[0, 0] * axes[1, 0] > 0 > axes[0, 1] * axes[1, 1]
    assert body.mass == pytest.approx(4 * m)
    assert body.centre == pytest.approx((a / 2, a / 2, 0))


def test_cylinder_on_the_edge_of_its_base():
    """Theory: M/12 [[3a^2+4h^2, 0, -6ah], [0, 15a^2+4h^2, 0], [-6ah, 0, 18a^2]]; with h = sqrt(3)
    a: 9/4, 9/4, 1/2 (M a^2)."""
    mass, a = 1.7, 0.2
    for h in (0.1, 0.3, np.sqrt(3) * a):
        body = rm.Body.cylinder(mass, a, h).with_pivot((a, 0, -h / 2))
        off = 6 * a * h
        direct = np.diag([3 * a * a + 4 * h * h, 15 * a * a + 4 * h * h, 18 * a * a])
        direct = mass / 12 * (direct + [[0, 0, off], [0, 0, 0], [off, 0, 0]])
        # x points from the axis to the edge here, so I13 changes sign
        assert np.allclose(body.tensor, direct, rtol=0, atol=1e-16)
        root = np.sqrt(225 * a**4 + 24 * a * a * h * h + 16 * h**4)
        half = 21 * a * a + 4 * h * h
        expected = np.array([2 * (15 * a * a + 4 * h * h), half + root, half - root])
        assert np.allclose(sorted(body.moments), sorted(mass / 24 * expected), rtol=1e-14)
    assert np.allclose(sorted(body.moments), mass * a * a * np.array([0.5, 2.25, 2.25]), rtol=1e-14)
    along = np.array(body.axes)[:, int(np.argmin(body.moments))]
    assert np.allclose(np.abs(along), np.array([2, 0, np.sqrt(3)]) / np.sqrt(7), atol=1e-14)


clouds = st.integers(0, 2**32 - 1).map(np.random.default_rng)


@given(clouds, st.sampled_from(["general", "two equal", "three equal"]))
def test_principal_axes(rng, kind):
    """TdC (3.19)-(3.23): I = B diag B^T with det B = +1, also with equal moments."""
    moments = {
        "general": rng.uniform(0.5, 1, 3),
        "two equal": np.array([0.7, 0.7, 1.0]),
        "three equal": np.full(3, 0.9),
    }[kind]
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    tensor = (turn * moments) @ turn.T
    tensor = 0.5 * (tensor + tensor.T)
    found, axes = principal_axes(tensor)
    assert np.allclose((axes * found) @ axes.T, tensor, rtol=0, atol=5e-15)  # measured 2.0e-15
    assert np.linalg.det(axes) == pytest.approx(1.0, abs=1e-14)  # measured 2e-15
    assert np.allclose(sorted(found), sorted(moments), rtol=0, atol=5e-15)  # measured 1.2e-15


def test_a_diagonal_tensor_keeps_its_axes():
    body = rm.Body.from_tensor(np.diag([3.0, 1.0, 2.5]))
    assert body.moments == (3.0, 1.0, 2.5)
    assert np.array_equal(body.axes, np.eye(3))


def test_impossible_bodies():
    good = [(1, 2, 3), (1, 1, 1), (1, 1, 2), (0.1 + 0.2, 0.1, 0.2)]
    bad = [(1, 2, 3.0001), (0, 1, 1), (-1, 1, 1), (np.nan, 1, 1)]
    assert not violates_triangle(np.array(good, float).T).any()
    assert violates_triangle(np.array(bad, float).T).all()
