"""Rotations for users, against scipy, mpmath and finite differences.

All conversions both ways, frames, angular velocity.
"""

import mpmath as mp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from rigidmc.errors import SceneError, SceneWarning
from rigidmc.mechanics import rotation as R
from rigidmc.mechanics.free_top import solve_free_top
from tests.tools.reference import apart

RNG = np.random.default_rng(31)
Q = RNG.normal(size=(200, 4))
Q /= np.linalg.norm(Q, axis=1, keepdims=True)
OMEGA = RNG.normal(size=(200, 3))
UNIT = st.tuples(*[st.floats(-1.0, 1.0)] * 4).filter(lambda q: sum(x * x for x in q) > 1e-3)


def test_matrix_quaternion_and_rotation_vector_are_scipys():
    scipys = Rotation.from_quat(Q, scalar_first=True)
    assert apart(R.matrix(Q), scipys.as_matrix()) < 1e-15  # 4.4e-16
    assert apart(R.rotation_vector(Q), scipys.as_rotvec()) < 2e-15  # 6.7e-16
    for made, q in (  # measured 7.9e-16, 4.6e-16, 5.1e-16
        (R.from_rotation_vector(scipys.as_rotvec()), Q),
        (R.quaternion(scipys.as_matrix()), Q),
        (R.rotation(Q), scipys),
    ):
        assert R.attitude_error(made, q).max() < 3e-15


def test_third_column_under_3_36_has_the_mathematics_sign_not_the_scans():
    angles = phi, theta, _ = np.array([0.7, 1.1, -0.4])
    column = R.matrix(R.from_euler(angles))[:, 2]
    right = np.array([np.sin(theta) * np.sin(phi), -np.sin(theta) * np.cos(phi), np.cos(theta)])
    assert np.abs(column - right).max() < 1e-15  # 2.2e-16
    assert np.abs(column - right * [1, -1, 1]).max() > 0.5


@given(UNIT, UNIT, UNIT)
@settings(max_examples=100, deadline=None)
def test_group_laws(p, q, r):
    a, b, c = (R.matrix(x) for x in (p, q, r))
    assert apart(a @ a.T, np.eye(3)) < 1e-14  # 8.9e-16
    assert np.linalg.det(a) == pytest.approx(1.0, abs=1e-14)
    assert apart((a @ b) @ c, a @ (b @ c)) < 1e-14  # 2.2e-16
    product = Rotation.from_matrix(a) * Rotation.from_matrix(b)
    assert R.attitude_error(R.quaternion(a @ b), product) < 1e-14  # 6.4e-16


def test_components_in_both_frames():
    v = OMEGA
    space = R.to_space(Q, v)
    assert apart(np.linalg.norm(space, axis=1), np.linalg.norm(v, axis=1)) < 2e-15  # 1.8e-15
    assert apart(R.to_body(Q, space), v) < 3e-15  # 2.2e-15
    quarter = R.from_euler((np.pi / 2, 0, 0))  # active, body to space
    assert apart(R.to_space(quarter, (1.0, 0, 0)), [0, 1, 0]) < 1e-15


@pytest.mark.parametrize("angle", ["1e-15", "1e-12", "1e-8", "0.3", "3.1", "3.14159265358979"])
def test_attitude_error_keeps_its_digits(angle):
    with mp.workdps(40):
        half = mp.mpf(angle) / 2
        q = float(mp.cos(half)), 0.0, float(mp.sin(half)), 0.0
    assert R.attitude_error((1, 0, 0, 0), q) == pytest.approx(float(angle), rel=1e-14)
    with np.errstate(invalid="ignore"):
        if float(angle) < 1e-9:  # for input that is not an attitude
            assert 2.0 * np.arccos(min(q[0], 1.0)) == 0.0


def test_angular_velocity_of_a_turn_about_z():
    phi, rate = 0.8, 2.5
    s, c, a = np.sin(phi), np.cos(phi), R.matrix(R.from_euler((phi, 0.0, 0.0)))
    da = rate * np.array([[-s, -c, 0], [c, -s, 0], [0, 0, 0]])
    assert apart(R.angular_velocity(a, da), [0, 0, rate]) < 1e-15  # 0.0e+00
    assert apart(R.angular_velocity_space(a, da), [0, 0, rate]) < 1e-15  # 0.0e+00
    # the wrong version with the transposed rate is caught
    assert apart(R.angular_velocity(a, da.T), [0, 0, rate]) > 1.0


def test_angular_velocity_in_both_frames_is_one_vector():
    a, omega = R.matrix(Q), OMEGA
    rate = a @ R.hat(omega)
    assert np.abs(R.angular_velocity(a, rate) - omega).max() < 2e-15  # 1.3e-15
    assert np.abs(R.angular_velocity_space(a, rate) - R.to_space(Q, omega)).max() < 3e-15  # 8.9e-16


def test_angular_velocity_of_a_series_converges_with_order_6_whatever_the_signs():
    errors = []
    for n in (100, 200, 400):
        t = np.linspace(0.0, 10.0, n) + 0.2 * 10.0 / n * np.sin(np.arange(n))  # uneven
        motion = solve_free_top((1.0, 2.0, 3.0), (0.3, 2.0, 0.4), (1.0, 0, 0, 0), t)
        signs = RNG.choice([-1.0, 1.0], n)[:, None]
        found = R.angular_velocity_of_series(t, signs * motion.attitude)
        errors.append(apart(found, motion.omega))
        space = R.angular_velocity_of_series(t, motion.attitude, space=True)
        back = apart(R.to_body(motion.attitude, space), motion.omega)
        assert back == pytest.approx(errors[-1], rel=1e-3)
    assert errors[0] / errors[1] > 2.0**5.5 and errors[1] / errors[2] > 2.0**5.5


def test_what_is_no_rotation_is_refused_with_how_far():
    with pytest.raises(SceneError, match=r"differs from 1 by 0\.21"):
        R.quaternion(1.1 * np.eye(3))
    with pytest.raises(SceneError, match="mirror"):
        R.quaternion(np.diag([1.0, 1.0, -1.0]))
    with pytest.raises(SceneError, match=r"shape \(5,\)"):
        R.quaternion(np.ones(5))
    good = R.matrix(Q[:3])
    spoilt = good.copy()
    spoilt[1] *= 1.5
    with pytest.warns(SceneWarning, match="1 of 3"):
        found = R.quaternion(spoilt)
    assert np.isnan(found[1]).all()
    assert (found[[0, 2]] == R.quaternion(good)[[0, 2]]).all()
