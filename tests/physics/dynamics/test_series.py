"""Series and Newton steps of the dynamics, and what they leave out, against mpmath."""

import mpmath as mp
import numpy as np
import pytest

from rigidmc.physics.dynamics import arc, quaternions
from rigidmc.physics.dynamics.methods import ON


def exact_s(h, x, y):
    """S of `arc`, by Jacobi's sn for x >= y."""
    return mp.ellipfun("sn", mp.sqrt(x) * h, m=y / x) / mp.sqrt(x)


@pytest.mark.parametrize("y", [1.0, 0.5, 0.0])
def test_what_the_series_of_an_arc_leaves_out(y):
    """0.0036 h^12 of S on the separatrix, x = y = 1, and less elsewhere: 4e-15 at 0.1.

    It was 3.0e-13 at 0.1 with a wrong coefficient of h^10, 71280 for 132624.
    """
    with mp.workdps(40):
        given = mp.mpf(1) / 10, mp.mpf(1), mp.mpf(y)
        left = abs(arc.elliptic_arc(*given).s / exact_s(*given) - 1)
    assert left < 1.02 * 0.0036 * 0.1**12 + 3e-16  # float coefficients; measured 3.58e-15, 4.6e-16
    if y == 1.0:
        assert left > 0.9 * 0.0036 * 0.1**12


def test_what_the_series_of_a_root_leaves_out():
    """0.022 z^8 of 1 - sqrt(1 - z), which is 1e-16 at 0.016."""
    with mp.workdps(40):
        for z, off in ((mp.mpf("0.016"), 0.05), (mp.mpf("0.1"), 0.1)):  # measured 1.00 and 1.06
            left = abs(arc._less_than_root(z) / (1 - mp.sqrt(1 - z)) - 1)
            assert abs(left / (mp.mpf("0.022") * z**8) - 1.0) < off
    assert 0.022 * 0.016**8 < 1e-16


def test_a_reciprocal_by_newton_steps():
    """1/(1 - u) is right to rounding for |u| < 0.1, and 6.6e-12 off at 0.2."""
    u = np.linspace(-0.1, 0.1, 2001)
    assert np.abs(arc._reciprocal(u, ON) * (1.0 - u) - 1.0).max() < 6e-16  # measured 4.4e-16
    assert 6e-12 < abs(arc._reciprocal(0.2, ON) * 0.8 - 1.0) < 7e-12


@pytest.mark.parametrize(
    ("name", "norm", "off", "error"),
    [
        ("touch_up", 1.0, 0.5e-8, None),  # |q|^2 within 1e-8 of 1
        ("touch_up", 1.0, 1e-2, 1.5e-4),
        ("renormalise", 1.0, 1e-4, None),
        ("renormalise", 1.0, 1e-3, 3.4e-12),
        ("divide_by_three", 3.0, 1e-4, None),
        ("divide_by_three", 3.0, 1e-3, 3.4e-12),
    ],
)
def test_norms_by_newton_steps(name, norm, off, error):
    """To rounding where `error` is None: measured 2.3e-16, 5.5e-16 and 5.4e-16."""
    some = np.random.default_rng(1)
    unit = some.normal(size=(4, 200))
    unit /= np.sqrt((unit * unit).sum(0))
    q = unit * norm * (1.0 + off * some.choice([-1.0, 1.0], 200))
    made = np.array(getattr(quaternions, name)(tuple(q)))
    size = np.sqrt((made**2).sum(0))
    assert np.abs(made - size * unit).max() < 1e-15  # in its direction
    worst = np.abs(size - 1.0).max()
    assert worst < 1e-15 if error is None else abs(worst / error - 1.0) < 0.05
