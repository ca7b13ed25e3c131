"""Other units change no pure number: of functions that take a scene, observables and closed forms.

The quick tests take powers of 2, under which not a bit may change. All functions for 32 scenes with
moments, masses and torques times 1e-20 and 1e20, and times times 1e-6 and 1e6 (an hour)::

    pytest -n 0 -m slow tests/whole/test_units.py
"""

import numpy as np
import pytest

import rigidmc as rm
from tests import units
from tests.units import BINARY, KINDS, OTHERS, PLAIN, answer, apart, asked, in_units

# to rounding, which grows with the motion by a little; of a neighbour at 1e-8 of it by 1e8, and
# what a tolerance chooses may be another step
LOOSE = {"lyapunov": 1e-5, "megno": 1e-5, "simulate(tolerance)": 1e-5, "rigid.measure": 1e-5}
QUICK = ("section", "rare, event")


@pytest.mark.parametrize("name", QUICK)
def test_powers_of_two_change_no_bit(name):
    one = units.scene("free", 1)
    plain = answer(asked(one, PLAIN)[name], PLAIN)
    assert not plain.error and plain.numbers
    for other in BINARY:
        found = answer(asked(in_units(one, other), other)[name], other)
        assert apart(plain, found) == (0.0, ""), other


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("kind", KINDS)
def test_all_functions_of_a_scene(kind, seed):
    one, worst = units.scene(kind, seed), {}
    for name, function in asked(one, PLAIN).items():
        plain = answer(function, PLAIN)
        for other in OTHERS:
            found = answer(asked(in_units(one, other), other)[name], other)
            off, where = apart(plain, found)
            if off > LOOSE.get(name, LOOSE.get(where, 1e-9)):
                worst[name, other] = off, where
    assert worst == {}


@pytest.mark.parametrize("mass", [1e-20, 1e20])
@pytest.mark.parametrize("time", [1e-6, 1e6])
def test_closed_forms(mass, time):
    """free_top, free_motion, lagrange_top and lagrange_motion of 30 bodies each."""
    some = np.random.default_rng(3)
    second = some.uniform(0.3, 0.9, (30, 3))
    moments = second.sum(axis=1, keepdims=True) - second
    tops = np.stack([moments[:, 0], moments[:, 0], second[:, 2]], axis=1)
    momentum, t = some.normal(size=(30, 3)), np.linspace(0.0, 5.0, 4)[:, None]
    attitude = some.normal(size=(30, 4))
    attitude /= np.linalg.norm(attitude, axis=1, keepdims=True)
    weight = some.uniform(0.5, 2.0, 30)
    one, two = (
        {
            "free_top": rm.free_top(m * moments, m / s * momentum, attitude, s * t),
            "free_motion": rm.free_motion(m * moments, m / s * momentum),
            "lagrange_top": rm.lagrange_top(
                m * tops, m / s**2 * weight, m / s * momentum, attitude, s * t
            ),
            "lagrange_motion": rm.lagrange_motion(
                m * tops, m / s**2 * weight, m / s * momentum, attitude
            ),
        }
        for m, s in ((1.0, 1.0), (mass, time))
    )
    of = {"momentum": mass / time, "p_phi": mass / time, "p_psi": mass / time}
    of |= {"energy": mass / time**2, "period": time, "flip_interval": time}
    of |= dict.fromkeys(("omega", "rate"), 1.0 / time)
    for name, motion in one.items():
        for field in motion._fields:
            a, b = (np.asarray(getattr(x[name], field)) for x in (one, two))
            if a.dtype.kind == "f":
                b = b / of.get(field, 1.0)
                assert np.array_equal(np.isfinite(a), np.isfinite(b)), (name, field)
                ends = np.isfinite(a)
                # measured 4e-14
                off = np.abs(a[ends] - b[ends]).max() / np.abs(a[ends]).max()
                assert off < 1e-12, (name, field)
            else:
                assert np.array_equal(a, b), (name, field)
