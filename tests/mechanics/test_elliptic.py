"""Elliptic functions against mpmath, up to the modulus where scipy's fail."""

import mpmath as mp
import numpy as np
import pytest
from scipy.special import ellipj

from rigidmc.mechanics import textbook
from tests.tools.reference import apart

MODULI = [1.0, 0.7, 1e-2, 1e-6, 1e-10, 1e-14, 1e-40]
RNG = np.random.default_rng(41)


def truth(name, u, mc):
    with mp.workdps(60):
        return np.array([float(mp.ellipfun(name, mp.mpf(x), m=1 - mp.mpf(mc))) for x in u])


@pytest.mark.parametrize("mc", MODULI)
def test_sn_cn_dn_at_every_modulus(mc):
    """2e-15 to K and 4e-16 |u| more beyond: measured 1.5e-15, and 3.1e-16 |u| to 40 K."""
    for span, more in ((1.0, 0.0), (4.0, 4e-16), (40.0, 4e-16)):
        u = RNG.uniform(-span, span, 60) * textbook.elliptic_k(mc=mc)
        found = textbook.elliptic_functions(u, mc=mc)
        for name in ("sn", "cn", "dn"):
            error = np.abs(getattr(found, name) - truth(name, u, mc))
            assert (error < 2e-15 + more * np.abs(u)).all()
        assert span > 4.0 or apart(np.sin(found.am), found.sn) < 1e-13  # 5.6e-16
        assert (np.diff(found.am[np.argsort(u)]) >= 0.0).all()


def test_a_complement_below_the_least_counts_as_that():
    u = np.linspace(0.0, 200.0, 50)
    least = textbook.elliptic_functions(u, mc=1e-120)
    assert np.array_equal(least, textbook.elliptic_functions(u, mc=1e-130))
    assert not np.array_equal(least, textbook.elliptic_functions(u, mc=1e-119))


@pytest.mark.parametrize("mc", MODULI)
def test_the_quarter_period(mc):
    with mp.workdps(60):
        whole = float(mp.ellipk(1 - mp.mpf(mc)))
    assert textbook.elliptic_k(mc=mc) == pytest.approx(whole, rel=1e-15)


def test_scipys_are_wrong_next_to_the_separatrix():
    """scipy's sn is off by 2, and its cn by 3e15; m has two digits of mc = 1e-14."""
    u = np.linspace(0.0, 4.0, 40) * textbook.elliptic_k(mc=1e-14)
    sn, cn = ellipj(u, 1.0 - 1e-14)[:2]
    assert np.abs(sn - truth("sn", u, 1e-14)).max() == pytest.approx(2.0, abs=0.1)
    assert np.abs(cn - truth("cn", u, 1e-14)).max() > 2.0
    assert abs((1.0 - (1.0 - 1e-14)) / 1e-14 - 1.0) < 1e-2  # measured 8e-4


def test_separatrix_itself_is_hyperbolic():
    u = np.array([-300.0, -5.0, 0.0, 0.3, 30.0])
    found = textbook.elliptic_functions(u, m=1.0)
    assert np.abs(found.sn - np.tanh(u)).max() < 1e-15  # 2.2e-16
    assert np.abs(found.cn - 1.0 / np.cosh(u)).max() < 1e-15  # 3.8e-17


def test_a_bad_modulus_is_nan_and_its_neighbours_stay():
    u, m = np.array([0.3, 0.4, np.inf, 0.5]), np.array([0.2, 1.5, 0.3, 0.4])
    found, good = textbook.elliptic_functions(u, m=m).sn, [0, 3]
    assert np.isnan(found).tolist() == [False, True, True, False]
    assert (found[good] == textbook.elliptic_functions(u[good], m=m[good]).sn).all()
    with pytest.raises(ValueError, match="either the parameter m or its complement"):
        textbook.elliptic_functions(0.3)
