"""Functions that members are drawn with, and those that effects may call."""

import numpy as np
import pytest
from scipy.special import ndtri, ndtri_exp

from rigidmc.dynamics import functions
from rigidmc.dynamics.functions import normal_quantile

LOGARITHMS = -np.linspace(25.1, 700.0, 2000)


@pytest.mark.parametrize(
    "u",
    [
        pytest.param(np.linspace(0.075, 0.925, 2000), id="middle"),
        pytest.param(np.exp(-np.linspace(2.6, 24.9, 2000)), id="tail"),
        pytest.param(1.0 - np.exp(-np.linspace(2.6, 12.0, 2000)), id="other tail"),
    ],
)
def test_the_normal_quantile_is_scipys(u):
    """Relative errors of at most 7e-16; with any coefficient of Wichura's fits 1 % off, 7e-10 or
    more."""
    assert np.abs(normal_quantile(u) / ndtri(u) - 1.0).max() < 4e-15


def test_the_normal_quantile_is_scipys_in_the_far_tail():
    """As above; with any coefficient 1 % off, 9e-11 or more."""
    found = normal_quantile(np.exp(LOGARITHMS))
    assert np.abs(found / ndtri_exp(LOGARITHMS) - 1.0).max() < 4e-15


def test_quantiles_of_normal_deviates():
    u = np.concatenate(
        [np.random.default_rng(1).uniform(size=5000), 10.0 ** -np.linspace(0.1, 300.0, 5000)]
    )
    assert np.abs(normal_quantile(u) / ndtri(u) - 1.0).max() < 2e-15  # measured 8.9e-16
    assert normal_quantile(np.array([0.5]))[0] == 0.0


def test_functions_of_arrays_are_those_of_numbers():
    x = np.random.default_rng(2).uniform(-3.0, 3.0, 200)
    for function in (
        functions.sine,
        functions.exponential_of,
        functions.hyperbolic_tangent,
        functions.arctangent,
        functions.hyperbolic_sine,
    ):
        assert function(x).tolist() == [function(float(one)) for one in x]


def test_the_logarithm_of_one_and_a_little():
    x = np.random.default_rng(2).uniform(-3e-3, 3e-3, 200)
    found = functions.logarithm_of_one_and(x)
    assert np.abs(found - np.log1p(x)).max() < 1e-18  # measured 4e-19
    tiny = np.array([0.0, 5e-324, 1e-300, -1e-20, 1.1e-16, -5e-17])  # 1 + x rounds to 1
    assert functions.logarithm_of_one_and(tiny).tolist() == tiny.tolist()
