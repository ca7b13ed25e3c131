"""gbs12 in plain Python, most of it in 40 digits: its errors are below the digits of a float."""

import math
from fractions import Fraction

import mpmath
import pytest

from rigidmc.physics.dynamics.euler import MassProperties
from rigidmc.physics.effects import Gravity, ViscousDamping
from rigidmc.physics.integrators import gbs12

SECONDS = 2
DIGITS = 40


def end(steps):
    """State of a heavy top with damping after SECONDS, as a vector of mpmath."""
    some = [[mpmath.mpf(x) / 10 for x in row] for row in ((6, 8, 10), (1, 2, 3), (18, 4, -9))]
    body = MassProperties.of(some[0], some[1])
    effects = Gravity(mpmath.mpf(1)), ViscousDamping(mpmath.mpf(1) / 10)
    q, l, h = (mpmath.mpf(1), *[mpmath.mpf(0)] * 3), tuple(some[2]), mpmath.mpf(SECONDS) / steps
    for i in range(steps):
        q, l = gbs12.GBS12().step(body, effects, i * h, h, q, l)
    return mpmath.matrix([*q, *l])


@pytest.fixture
def exact(monkeypatch):
    """Weights and spans in 40 digits."""
    spans = [Fraction(2, n) for n in gbs12.SUBSTEPS]
    full = [1 / math.prod(1 - (s / other) ** 2 for other in spans if other != s) for s in spans]
    rates = [w / s for w, s in zip(full, spans, strict=True)]
    with mpmath.workdps(DIGITS):
        for name, table in (("_SPANS", spans), ("_B", full), ("_C", rates)):
            full_table = tuple(mpmath.mpf(x.numerator) / x.denominator for x in table)
            pairs = zip(full_table, getattr(gbs12, name), strict=True)
            assert all(abs(a - b) < 1e-14 for a, b in pairs)
            monkeypatch.setattr(gbs12, name, full_table)
        yield


def measured_order():
    few, more, most = (end(steps) for steps in (5, 10, 20))
    return float(mpmath.log(mpmath.norm(few - more) / mpmath.norm(more - most), 2))


def test_the_order_is_12(exact):
    assert abs(measured_order() - 12.0) < 0.3


@pytest.mark.parametrize("table", ["_B", "_C"])
def test_a_wrong_weight_spoils_the_order(exact, monkeypatch, table):
    true = getattr(gbs12, table)
    monkeypatch.setattr(gbs12, table, (*true[:3], true[3] * (1 + mpmath.mpf("1e-7")), *true[4:]))
    assert measured_order() < 9.0


def test_a_constant_rate_is_integrated_to_the_last_digit():
    """Without the correction of the first weight, the sums differ from 1 by 1e-15."""
    for power, weights in ((1, gbs12._B), (2, gbs12._C)):
        parts = zip(weights, gbs12._SPANS, gbs12.SUBSTEPS, strict=True)
        total = sum(Fraction(w) * Fraction(span) ** power * n / 2 for w, span, n in parts)
        assert abs(total - 1) < 1e-19
