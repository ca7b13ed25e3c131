"""Rates of Euler angles and omega: all sequences, against the derivative of the attitude."""

import numpy as np
import pytest

import rigidmc as rm
from rigidmc.errors import SceneError, SceneWarning
from rigidmc.mechanics import rotation as R
from rigidmc.mechanics.euler_angles import PROPER, SEQUENCES

RNG = np.random.default_rng(37)


@pytest.mark.parametrize("sequence", SEQUENCES)
def test_both_ways(sequence):
    second = RNG.uniform(0.3, 2.8, 50) if sequence in PROPER else RNG.uniform(-1.2, 1.2, 50)
    angles = np.stack([RNG.uniform(-3, 3, 50), second, RNG.uniform(-3, 3, 50)], -1)
    rates, h = RNG.normal(size=(50, 3)), 1e-5
    omega = rm.omega_from_euler_rates(angles, rates, sequence)
    before, after = (R.matrix(R.from_euler(angles + s * h * rates, sequence)) for s in (-1, 1))
    a = R.matrix(R.from_euler(angles, sequence))
    assert np.abs(R.angular_velocity(a, (after - before) / (2 * h)) - omega).max() < 1e-8  # 1.4e-09
    assert np.abs(rm.euler_rates(angles, omega, sequence) - rates).max() < 1e-13  # 3e-15
    wrong = rm.omega_from_euler_rates(angles, rates * [1, -1, 1], sequence)
    assert np.abs(wrong - omega).max() > 0.1


@pytest.mark.parametrize(("sequence", "locked"), [("313", 0.0), ("313", np.pi), ("321", np.pi / 2)])
def test_rates_at_gimbal_lock_are_nan_and_counted(sequence, locked):
    angles = np.array([[0.1, 0.5, 0.2], [0.1, locked, 0.2], [0.3, 1.0, 0.1]])
    with pytest.warns(SceneWarning, match="1 of 3"):
        rates = rm.euler_rates(angles, (0.1, 0.2, 0.3), sequence)
    assert np.isnan(rates[1, [0, 2]]).all() and np.isfinite(rates[1, 1])
    good = rm.euler_rates(angles[[0, 2]], (0.1, 0.2, 0.3), sequence)
    assert (rates[[0, 2]] == good).all()
    with pytest.raises(SceneError, match="gimbal lock"):
        rm.euler_rates(angles[1], (0.1, 0.2, 0.3), sequence)


def test_words_of_scipy_name_the_same_sequence():
    angles, rates = (0.3, 0.4, -0.2), (1.0, 2.0, 3.0)
    one, other = (rm.omega_from_euler_rates(angles, rates, word) for word in ("ZYX", "321"))
    assert (one == other).all()
    with pytest.raises(SceneError, match="about the axes of space"):
        rm.euler_rates(angles, rates, "zxz")


def test_angles_that_look_like_degrees_are_noted():
    """As by the closed forms of tops: a lean of 30 gave a spin without a word."""
    for function in (rm.omega_from_euler_rates, rm.euler_rates):
        with pytest.warns(SceneWarning, match='a second angle of 30 .* write "30 deg"'):
            function((0.0, 30.0, 0.0), (3.0, 0.0, 150.0))
