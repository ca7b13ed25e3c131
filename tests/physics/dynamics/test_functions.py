"""Functions that members are drawn with, and those that effects may call."""

import mpmath as mp
import numpy as np
import pytest
from scipy.special import ndtri, ndtri_exp

from rigidmc.physics.dynamics import functions
from rigidmc.physics.dynamics.functions import normal_quantile
from tests.tools.reference import apart


@pytest.mark.parametrize(
    ("u", "true"),
    [
        pytest.param(u := np.linspace(0.075, 0.925, 2000), ndtri(u), id="middle"),
        pytest.param(u := np.exp(-np.linspace(2.6, 24.9, 2000)), ndtri(u), id="tail"),
        pytest.param(u := 1.0 - np.exp(-np.linspace(2.6, 12.0, 2000)), ndtri(u), id="other tail"),
        pytest.param(np.exp(x := -np.linspace(25.1, 700.0, 2000)), ndtri_exp(x), id="far tail"),
        pytest.param(u := np.random.default_rng(1).uniform(size=5000), ndtri(u), id="deviates"),
    ],
)
def test_the_normal_quantile_is_scipys(u, true):
    """Relative errors of at most 9e-16; with any coefficient of Wichura's fits 1 % off, 9e-11 or
    more."""
    assert apart(normal_quantile(u) / true, 1.0) < 2e-15
    assert normal_quantile(np.array([0.5]))[0] == 0.0


def test_functions_of_arrays_are_those_of_numbers():
    x = np.random.default_rng(2).uniform(-3.0, 3.0, 200)
    for name in ("sine", "exponential_of", "hyperbolic_tangent", "arctangent", "hyperbolic_sine"):
        function = getattr(functions, name)
        assert function(x).tolist() == [function(float(one)) for one in x]


def test_the_logarithm_of_one_and_a_little():
    x = np.random.default_rng(2).uniform(-3e-3, 3e-3, 200)
    found = functions.logarithm_of_one_and(x)
    assert np.abs(found - np.log1p(x)).max() < 1e-18  # measured 4e-19
    tiny = np.array([0.0, 5e-324, 1e-300, -1e-20, 1.1e-16, -5e-17])  # 1 + x rounds to 1
    assert functions.logarithm_of_one_and(tiny).tolist() == tiny.tolist()


RNG = np.random.default_rng(5)
SMALL = RNG.choice([-1.0, 1.0], 500) * 10.0 ** RNG.uniform(-8.0, 0.0, 500)
WIDE = np.concatenate([RNG.uniform(-20.0, 20.0, 500), SMALL])
TURNS = np.concatenate([RNG.uniform(-1e6, 1e6, 500), RNG.uniform(-10.0, 10.0, 500)])
# name: (true function, arguments, the bound of the docstring and the worst of 400,000 arguments, in
# units of 1e-16); the errors of sine and cosine, 1.8e-16, are absolute
ERRORS = {
    "sine": (mp.sin, TURNS, 1.8, 1.72),
    "cosine": (mp.cos, TURNS, 1.8, 1.76),
    "exponential_of": (mp.exp, RNG.uniform(-700.0, 700.0, 1000), 1.5, 1.47),
    "logarithm_of": (mp.log, 10.0 ** RNG.uniform(-300.0, 300.0, 1000), 1.5, 1.44),
    "arctangent": (mp.atan, RNG.uniform(-3.0, 3.0, 1000), 4.0, 3.2),
    "arcsine": (mp.asin, np.concatenate([RNG.uniform(-1.0, 1.0, 500), SMALL]), 4.0, 3.8),
    "arccosine": (mp.acos, RNG.uniform(-1.0, 1.0, 1000), 4.0, 3.95),
    "hyperbolic_sine": (mp.sinh, WIDE, 13.0, 12.8),
    "hyperbolic_cosine": (mp.cosh, WIDE, 2.2, 2.198),
    "hyperbolic_tangent": (mp.tanh, WIDE, 11.0, 10.5),
}
ABSOLUTE = "sine", "cosine"


def worst(function, true, x, absolute=False):
    """The largest error of a function of an array, in units of 1e-16."""
    with mp.workdps(30), np.errstate(over="ignore"):
        there = [true(mp.mpf(float(one))) for one in x]
        pairs = zip(function(x), there, strict=True)
        off = [abs(mp.mpf(float(a)) - b) / (1 if absolute else abs(b)) for a, b in pairs]
        return 1e16 * float(max(off))


@pytest.mark.parametrize("name", ERRORS)
def test_the_errors_of_functions_are_what_the_docstring_says(name):
    true, x, bound, _ = ERRORS[name]
    found = worst(getattr(functions, name), true, x, name in ABSOLUTE)
    assert 0.5 * bound < found <= bound, found


def test_the_errors_of_expm1_and_arctan2():
    """Of expm1 1e-15 below 0 and 1.4e-14 to 20, of 400,000 arguments 9.4e-16 and 1.33e-14."""
    below = -np.concatenate([RNG.uniform(0.0, 44.0, 500), 10.0 ** RNG.uniform(-12.0, 1.0, 500)])
    assert 5.0 < worst(functions.expm1, mp.expm1, below) < 10.0
    assert 70.0 < worst(functions.expm1, mp.expm1, RNG.uniform(0.0, 20.0, 1000)) < 140.0
    # not -1 to the bit
    assert np.abs(functions.expm1(np.array([-44.1, -1e3])) + 1.0).max() < 1.2e-16
    y, x = RNG.normal(size=(2, 1000))
    found = functions.arctan2(y, x)
    with mp.workdps(30):
        true = [float(mp.mpf(float(a)) / mp.atan2(*map(mp.mpf, map(float, b))) - 1)
                for a, b in zip(found, zip(y, x, strict=True), strict=True)]  # fmt: skip
    assert np.abs(true).max() < 3.1e-16  # of 400,000 pairs 3.05e-16


def test_where_the_exponential_ends():
    with np.errstate(over="ignore"):
        ends = functions.exponential_of(np.array([709.78, 709.79, -745.1, -745.2]))
    assert np.isfinite(ends).tolist() == [True, False, True, True]
    assert ends[2] == 5e-324 and ends[3] == 0.0
    for n in (-1022, 1023):
        assert functions.power_of_two(float(n)) == 2.0**n
