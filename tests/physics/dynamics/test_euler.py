"""Euler's equations and their conserved quantities, against matrices and 40-digit numbers."""

import math

import mpmath as mp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigidmc.physics.dynamics import euler
from rigidmc.physics.dynamics.so3 import dot
from tests.tools.reference import apart

# products must not underflow
number = st.floats(-1.0, 1.0, allow_subnormal=False).filter(lambda x: x == 0.0 or abs(x) > 1e-150)
vector = st.tuples(number, number, number)
positive = st.floats(0.1, 10.0)
moments = st.tuples(positive, positive, positive)


@given(moments, vector)
def test_rates_are_those_of_the_matrix_form(i, l):
    body, tensor = euler.MassProperties.of(i, (0.0, 0.0, 0.0)), np.diag(i)
    omega = np.linalg.solve(tensor, l)
    assert np.allclose(euler.angular_velocity(body, l), omega, rtol=1e-15, atol=0)
    assert np.allclose(euler.free_rate(body, l), np.cross(l, omega), rtol=0, atol=5e-15)
    assert math.isclose(
        euler.kinetic_energy(body, l), 0.5 * omega @ tensor @ omega, rel_tol=1e-15, abs_tol=1e-300
    )


@given(moments, vector)
def test_the_free_rate_changes_neither_energy_nor_momentum(i, l):
    body = euler.MassProperties.of(i, (0.0, 0.0, 0.0))
    rate = euler.free_rate(body, l)
    assert abs(dot(l, rate)) < 2e-14  # measured 1.8e-15
    assert abs(dot(euler.angular_velocity(body, l), rate)) < 2e-13  # measured 1.8e-15


def test_a_free_rate_of_the_wrong_sign_in_one_axis_would_change_both():
    body, l = euler.MassProperties.of((1.0, 2.0, 3.0), (0.0, 0.0, 0.0)), (0.3, 0.4, 0.5)
    wrong = euler.free_rate(body, l)[0], -euler.free_rate(body, l)[1], euler.free_rate(body, l)[2]
    assert abs(dot(l, wrong)) > 0.01
    assert abs(dot(euler.angular_velocity(body, l), wrong)) > 0.01


@given(moments, vector, vector, number)
def test_scaled_rates_are_a_time_times_both_equations(i, l, onto, h):
    body = euler.MassProperties.of(i, (0.0, 0.0, 0.0))
    rates = euler.scaled(body, h)
    turn = np.multiply(0.5 * h, euler.angular_velocity(body, l))
    assert apart(euler.half_rotation(rates, l), turn) <= 5e-15
    change = np.multiply(h, euler.free_rate(body, l))
    assert apart(euler.add_free_change(rates, onto, l), np.add(onto, change)) <= 5e-15


@pytest.mark.parametrize("size", [1e-35, 1.0, 8e37])  # a virus, a top, the Earth
@pytest.mark.parametrize("split", [0.5, 1e-4, 1e-9, 1e-13])
def test_coefficients_keep_their_digits_where_moments_are_nearly_equal(size, split):
    moments = tuple(size * x for x in (1.1, 1.1 * (1.0 + split), 1.8))
    body = euler.MassProperties.of(moments, (0.0, 0.0, 0.0))
    with mp.workdps(40):
        i = [mp.mpf(x) for x in moments]
        true = [(i[j] - i[k]) / (i[j] * i[k]) for j, k in ((1, 2), (2, 0), (0, 1))]
        error = max(abs(a / b - 1) for a, b in zip((body.a1, body.a2, body.a3), true, strict=True))
    assert error < 4e-16  # measured 1.0e-16
    cancelled = abs((1 / moments[1] - 1 / moments[0]) / float(true[2]) - 1)
    # measured 2e-8: why the difference of moments comes first
    assert cancelled > 1e-9 or split > 1e-9


def test_one_body_per_member():
    moments = np.random.default_rng(1).uniform(1, 2, (3, 5))
    together = euler.MassProperties.of(moments, np.zeros((3, 5)))
    for m in range(5):
        alone = euler.MassProperties.of(moments[:, m], (0.0, 0.0, 0.0))
        assert tuple(field[m] for field in together[:9]) == alone[:9]
