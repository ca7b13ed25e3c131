"""The formulas of free bodies as the chapter writes them.

G. F. Torres del Castillo, An Introduction to Hamiltonian Mechanics, 2018, ch. 3. Its theory is in
the tests of each module, its examples of tensors in tests/scene/test_body.py.
"""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rigidmc.mechanics import textbook
from rigidmc.mechanics.free_top import solve_free_top
from rigidmc.mechanics.textbook import jacobi_omega, symmetric_omega
from tests.tools import reference

RNG = np.random.default_rng(34)
A = Rotation.random(rng=RNG).as_matrix()


def test_chapter_example_3_5_as_the_chapter_writes_it():
    moments, omega = np.array([1.0, 1.0, 1.6]), np.array([0.4, -0.3, 2.0])
    t = np.linspace(-9.0, 9.0, 7)
    true = solve_free_top(moments, moments * omega, (1, 0, 0, 0), t).omega
    assert np.abs(symmetric_omega(moments, omega, t) - true).max() < 2e-14
    with pytest.raises(ValueError, match="I1 = I2"):
        symmetric_omega((1, 2, 2.5), omega, t)


# on either side of the separatrix
@pytest.mark.parametrize("start", [(0.7, 0.0, 0.9), (1.5, 0.0, 0.2)])
def test_chapter_example_3_6_as_the_chapter_writes_it(start):
    moments, t = np.array([1.0, 2.0, 3.0]), np.linspace(-9.0, 9.0, 7)
    l = moments * start
    omega = jacobi_omega(moments, 0.5 * (l * start).sum(), (l * l).sum(), t)
    assert np.abs(omega - solve_free_top(moments, l, (1, 0, 0, 0), t).omega).max() < 2e-14


def test_chapter_example_3_6_loses_half_the_digits_next_to_the_separatrix():
    """From T and L^2 of a body that begins beside its middle axis, where p t = -K."""
    moments, start, t = np.array([1.0, 2.0, 3.0]), np.array([1e-4, -1.0, 0.0]), 60.0
    l = moments * start
    mc = start[0] ** 2 / (1.0 + start[0] ** 2)  # 1 - B/A, A = 2 (1 + omega_1^2) and B = 2
    assert mc == pytest.approx(1e-8, rel=1e-6)
    rate = np.sqrt((1.0 + start[0] ** 2) / 3.0)
    later = t - float(textbook.elliptic_k(mc=mc)) / rate
    plain = jacobi_omega(moments, 0.5 * (l * start).sum(), (l * l).sum(), later)
    kept = solve_free_top(moments, l, (1, 0, 0, 0), t).omega
    true = np.array(reference.taylor(moments, l, t)[1], float) / moments
    assert 1e-10 < np.abs(plain - true).max() < 1e-8  # measured 8e-10
    assert np.abs(kept - true).max() < 4e-15  # measured 3.5e-16
