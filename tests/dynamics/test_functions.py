"""Functions that members are drawn with."""

import numpy as np
import pytest
from scipy.special import ndtri, ndtri_exp

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
