"""Series of the dynamics and what they leave out, against mpmath."""

import mpmath as mp
import numpy as np
import pytest

from rigidmc.dynamics import arc, elementary


def exact_s(h, x, y):
    """S of `arc`, by Jacobi's sn for x >= y."""
    return mp.ellipfun("sn", mp.sqrt(x) * h, m=y / x) / mp.sqrt(x)


@pytest.mark.parametrize("y", [1.0, 0.5, 0.0])
def test_what_the_series_of_an_arc_leaves_out(y):
    """0.0036 h^12 of S on the separatrix, x = y = 1, and less elsewhere: 4e-15 at 0.1.

    It was 3.0e-13 at 0.1 with a wrong coefficient of h^10, 71280 for 132624.
    """
    with mp.workdps(40):
        h = mp.mpf(1) / 10
        left = abs(arc.arc(h, mp.mpf(1), mp.mpf(y)).s / exact_s(h, mp.mpf(1), mp.mpf(y)) - 1)
    assert left < 1.02 * 0.0036 * 0.1**12 + 3e-16  # float coefficients; measured 3.58e-15, 4.6e-16
    if y == 1.0:
        assert left > 0.9 * 0.0036 * 0.1**12
