"""Euler angles of the 12 sequences, against scipy, and against mpmath near gimbal lock."""

import itertools

import mpmath as mp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rigidmc.errors import SceneError
from rigidmc.mechanics import euler_angles as E
from rigidmc.mechanics import rotation
from tests.mechanics import oracles

RNG = np.random.default_rng(48)


def scipys(sequence):
    return sequence.translate(str.maketrans("123", "XYZ"))


def parted(angle):
    """Return an angle by its distance from the nearest whole turn."""
    return np.abs(np.angle(np.exp(1j * angle)))


@pytest.mark.parametrize("sequence", E.SEQUENCES)
def test_both_ways_are_scipys(sequence):
    angles = RNG.uniform(-3.0, 3.0, (500, 3))
    q = E.quaternions_of_angles(sequence, *angles.T)
    other = Rotation.from_euler(scipys(sequence), angles)
    assert rotation.attitude_error(q.T, other).max() < 4e-15  # measured 7.9e-16
    found = E.angles_of_quaternions(sequence, q)
    true = other.as_euler(scipys(sequence)).T
    near = E.distance_from_lock(sequence, true[1])
    assert (parted(found - true) * near).max() < 6e-15  # measured 1.4e-15
    back = E.quaternions_of_angles(sequence, *found)
    assert np.minimum(np.abs(back - q), np.abs(back + q)).max() < 3e-15  # measured 5.6e-16
    wrong = E.quaternions_of_angles(sequence, *found[::-1])
    assert rotation.attitude_error(wrong.T, other).max() > 0.5
    assert (np.abs(found[[0, 2]]) <= np.pi).all()


def mp_product(sequence, angles):
    """Return the quaternion of three rotations, in 40 digits."""
    q = [mp.mpf(1), mp.mpf(0), mp.mpf(0), mp.mpf(0)]
    for axis, angle in zip(sequence, angles, strict=True):
        p = [mp.cos(angle / 2), mp.mpf(0), mp.mpf(0), mp.mpf(0)]
        p[int(axis)] = mp.sin(angle / 2)
        q = oracles.multiply(q, p)
    return q


def mp_angles(sequence, q):
    """Return the first and third angle of a quaternion, in 40 digits, from its matrix."""
    w, *v = (mp.mpf(float(part)) for part in q)
    size = w * w + mp.fdot(v, v)
    hat = mp.matrix([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
    a = (mp.eye(3) + (2 * w * hat + 2 * hat * hat) / size).tolist()
    i, j, k = (int(axis) - 1 for axis in sequence)
    sign = 1 if (j - i) % 3 == 1 else -1
    if i == k:  # A_ii = cos second, A_ji = sin first sin second, A_ij = sin second sin third
        n = 3 - i - j
        return mp.atan2(a[j][i], -sign * a[n][i]), mp.atan2(a[i][j], sign * a[i][n])
    return mp.atan2(-sign * a[j][k], a[k][k]), mp.atan2(-sign * a[i][j], a[i][i])


def locks(sequence):
    """Return the second angles at gimbal lock."""
    return (0.0, np.pi) if sequence in E.PROPER else (-np.pi / 2, np.pi / 2)


NEAR = 1e-2, 1e-5, 1e-8, 1e-12, 1e-15, 1e-18, 1e-300


@pytest.mark.parametrize("sequence", E.SEQUENCES)
def test_near_gimbal_lock_the_angles_are_those_of_the_quaternion(sequence):
    with mp.workdps(40):
        for end, distance in itertools.product(locks(sequence), NEAR):
            second = end + (distance if end == locks(sequence)[0] else -distance)
            q = np.array([float(x) for x in mp_product(sequence, (0.7, second, -1.9))])
            found = E.angles_of_quaternions(sequence, q)
            if distance > 1e-13:  # measured 2.2e-16: the components near 0 are exact
                first, third = (float(x) for x in mp_angles(sequence, q))
                assert max(parted(found[0] - first), parted(found[2] - third)) < 1e-15
            assert (np.abs(found) <= np.pi).all()
            back = E.quaternions_of_angles(sequence, *found)
            assert rotation.attitude_error(back, q) < 3e-15  # measured 5.6e-16


@pytest.mark.parametrize("sequence", E.SEQUENCES)
def test_at_gimbal_lock_the_third_angle_is_0(sequence):
    for end in locks(sequence):
        q = E.quaternions_of_angles(sequence, 0.7, end, -1.9)
        found = E.angles_of_quaternions(sequence, q)
        assert found[2] == 0.0 and abs(found[1] - end) < 1e-15  # measured 2.2e-16
        back = E.quaternions_of_angles(sequence, *found)
        assert rotation.attitude_error(back, q) < 3e-15  # measured 6.0e-16


def test_nan_stays_in_its_place():
    q = np.array([[1.0, np.nan], [0.0, 0.0], [0.0, 0.0], [0.0, 0.0]])
    for sequence in E.SEQUENCES:
        found = E.angles_of_quaternions(sequence, q)
        assert found[:, 0].tolist() == [0.0, 0.0, 0.0]
        assert np.isnan(found[[0, 2], 1]).all()


def test_words_for_a_sequence():
    assert E.check_sequence("ZYX") == E.check_sequence(321) == E.check_sequence("321") == "321"
    for wrong in ("331", "32", "", "3211", "abc", None, 3.0, True, ("3", "2", "1")):
        with pytest.raises(SceneError, match="one of 121"):
            E.check_sequence(wrong)
    with pytest.raises(SceneError, match='the angles \\(c, b, a\\) of "123"'):
        E.check_sequence("zyx")
    a, b, c = 0.3, 0.5, -0.9  # and the message is right
    q = E.quaternions_of_angles("123", c, b, a)
    assert rotation.attitude_error(q, Rotation.from_euler("zyx", (a, b, c))) < 1e-15


def test_tait_bryan_angles_have_the_names_of_their_axes():
    assert E.angle_names("123") == ("roll", "pitch", "yaw")
    assert E.angle_names("231") == ("pitch", "yaw", "roll")
    assert {E.angle_names(sequence) for sequence in E.PROPER} == {("phi", "theta", "psi")}


def test_rotation_takes_every_sequence():
    angles = RNG.uniform(-1.0, 1.0, (4, 5, 3))
    for sequence in E.SEQUENCES:
        q = rotation.from_euler(angles, sequence)
        other = Rotation.from_euler(scipys(sequence), angles.reshape(-1, 3))
        assert rotation.attitude_error(q.reshape(-1, 4), other).max() < 3e-15  # 5.5e-16
        again = rotation.from_euler(rotation.euler(q, sequence), sequence)
        assert rotation.attitude_error(again, q).max() < 4e-15  # 8.1e-16
    assert np.array_equal(rotation.from_euler(angles, "313"), rotation.from_euler(angles))
