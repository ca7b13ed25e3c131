"""The bits of a member depend on scene, seed and index: not on vector width or processor.

Draws and events included. `python -m bench bits` runs all cases.
"""

import numpy as np
import pytest

from bench.bits import elsewhere, sums
from rigidmc.dynamics import functions
from rigidmc.scene.laws.vectors import lower_factor

# steps too long for what is watched
pytestmark = pytest.mark.filterwarnings("ignore::rigidmc.errors.SceneWarning")


def test_widths_change_no_bit():
    for case, each in sums((1, 16), ("strang",)).items():
        assert len(set(each)) == 1, case


def test_another_processor_with_other_libraries_changes_no_bit():
    assert elsewhere("haswell, plain libraries", (0,), ("rk4",)) == sums((0,), ("rk4",))


def test_the_comparison_sees_one_bit(monkeypatch):
    here = sums((0,), ("exact",))
    quantile = functions.normal_quantile
    monkeypatch.setattr(
        "rigidmc.scene.quantities.normal_quantile", lambda u: np.nextafter(quantile(u), 9.0)
    )
    assert sums((0,), ("exact",)) != here


def test_a_cholesky_factor_is_one():
    c = np.array([[2.0, 0.3, -0.4], [0.3, 1.0, 0.2], [-0.4, 0.2, 0.5]])
    root = np.array([row + (0.0,) * (3 - len(row)) for row in lower_factor(c.tolist())])
    assert np.abs(root @ root.T - c).max() < 1e-15  # measured 4.4e-16
