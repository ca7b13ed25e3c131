"""Vectors of numbers against the same functions of plain numbers, and against 40 digits.

Products are fused as the rule says.
"""

import math
from typing import NamedTuple

import mpmath as mp
import numpy as np
import pytest

from rigidmc.engine.formulas import evaluate

some = np.random.default_rng(3)
TENTH = 0.1


class Sums(NamedTuple):
    """Sums whose last bits tell which product is fused."""

    a: float
    b: float
    c: float
    d: float

    def values(self):
        a, b, c, d = self.a, self.b, self.c, self.d
        mixed = (a + b) * (c - d) - a, -a * b + c, a * 3.0 - d, TENTH * 3.0 + a
        return (a * b + c * d, a * b - c * d, c - a * b, *mixed)


class Choices(NamedTuple):
    """Comparisons, and numbers chosen by them."""

    a: float
    b: float

    def values(self):
        a, b = self.a, self.b
        both, one = (a > 0.0) & (b > 0.0), (a > 0.0) | (b > 0.0)
        found = chosen(both, a, b), chosen(one, 1.0, 0.0), chosen(a != a, 1.0, b)
        return (max(a, b), min(a, b), abs(a), math.copysign(a, b), *found)


class Others(NamedTuple):
    """What else numbers and masks can do, in the words of Python."""

    a: float
    b: float

    def values(self):
        a, b = self.a, self.b
        above, below, equal = a > b, a < b, a == b
        return (
            math.floor(a) + 0.0, math.ceil(a) + 0.0, math.trunc(a) + 0.0, math.fabs(a), +a, -a,
            chosen(math.isnan(b), 1.0, 0.0),
            chosen(a >= b, 1.0, 0.0), chosen(a <= b, 1.0, 0.0), chosen(a != b, 1.0, 0.0),
            chosen(equal, 1.0, 0.0), chosen(above == below, 1.0, 0.0),
            chosen(above != equal, 1.0, 0.0), chosen(logical_not(above), 1.0, 0.0),
            chosen(above ^ (b > 0.0), 1.0, 0.0), chosen(chosen(above, below, equal), 1.0, 0.0),
            1.0 - a, 1.0 / b, b / 3.0, chosen(True & above, 1.0, 0.0),
        )  # fmt: skip


class Functions(NamedTuple):
    """Library functions that a user's effect may call, of one number and of a positive one."""

    x: float
    y: float

    def values(self):
        x, y = self.x, self.y
        return (
            math.sin(x), math.cos(x), math.tan(x), math.atan(x), math.asin(x / 4.0),
            math.acos(x / 4.0), math.exp(x), math.expm1(x), math.log(y),
            math.tanh(x), math.sinh(x), math.cosh(x), math.atan2(x, y), math.pow(y, x),
            math.hypot(x, y), x**3, y**-2, y**0.5,
        )  # fmt: skip


def chosen(condition, a, b):
    return select(condition, a, b)


from rigidmc.engine.compiler.compose import inline  # noqa: E402
from rigidmc.physics.dynamics.so3 import logical_not, select  # noqa: E402

inline(chosen)


def fused(a, b, c):
    """a b + c with one rounding."""
    with mp.workdps(60):
        return float(mp.mpf(a) * mp.mpf(b) + mp.mpf(c))


def test_of_two_products_the_left_one_is_fused():
    columns = some.normal(size=(4, 200))
    found = evaluate(Sums, 7, columns)
    for e in range(200):
        a, b, c, d = map(float, columns[:, e])
        given = (a, b, c * d), (a, b, -(c * d)), (-a, b, c), (a + b, c - d, -a), (-a, b, c)
        # the last: a product that all members share and no float equals, 0.3 and a little more
        more = (a, 3.0, -d), (TENTH, 3.0, a)
        assert found[:, e].tolist() == [fused(*three) for three in (*given, *more)]
    # unfused products have other bits
    assert (found[0] != columns[0] * columns[1] + columns[2] * columns[3]).any()


@pytest.mark.parametrize("side", [1, 2, 4, 8, 16])
def test_the_width_changes_no_bit(side):
    columns = some.normal(size=(4, 37))
    for formula, count, given in ((Sums, 7, columns), (Functions, 18, np.abs(columns[:2]))):
        here, there = (evaluate(formula, count, given, side=n).tobytes() for n in (side, 8))
        assert here == there


ZEROS_AND_NAN = [[0.0, -0.0, np.nan, np.nan, 1.0], [-0.0, 0.0, 1.0, -1.0, np.nan]]
ENDS = [[1.5, -1.5, 2.0, 0.5, 1.0], [1.5, 1.5, -2.0, np.inf, 0.5]]


@pytest.mark.parametrize(
    ("formula", "count", "more"), [(Choices, 7, ZEROS_AND_NAN), (Others, 20, ENDS)]
)
def test_operations_are_those_of_python(formula, count, more):
    columns = np.concatenate([some.normal(0.0, 2.0, (2, 50)), more], axis=1)
    plain = np.array([formula(*map(float, column)).values() for column in columns.T]).T
    assert evaluate(formula, count, columns).tobytes() == plain.astype(float).tobytes()


def test_nan_is_neither_ordered_nor_equal():
    found = evaluate(Others, 20, np.array([[np.nan, 1.0], [1.0, np.nan]]))
    assert found[6].tolist() == [0.0, 1.0]
    assert not found[[7, 8, 10]].any()
    assert found[9].tolist() == [1.0, 1.0]


def test_functions_of_analysis():
    x, y = some.uniform(-3.0, 3.0, 400), np.exp(some.uniform(-20.0, 20.0, 400))
    found, worst = evaluate(Functions, 18, np.array([x, y])), np.zeros(18)
    with mp.workdps(40):
        for e in range(400):
            one, two = mp.mpf(float(x[e])), mp.mpf(float(y[e]))
            true = (
                mp.sin(one), mp.cos(one), mp.tan(one), mp.atan(one), mp.asin(one / 4),
                mp.acos(one / 4), mp.exp(one), mp.expm1(one), mp.log(two), mp.tanh(one),
                mp.sinh(one), mp.cosh(one), mp.atan2(one, two), mp.power(two, one),
                mp.hypot(one, two), one**3, two**-2, mp.sqrt(two),
            )  # fmt: skip
            for i, exact in enumerate(true):
                size = exact if i > 2 else max(abs(exact), 1)
                worst[i] = max(worst[i], abs(float((mp.mpf(float(found[i, e])) - exact) / size)))
    assert worst[[0, 1, 2, 3, 4, 5, 6, 8]].max() < 6e-16, worst  # measured 2.9e-16
    assert worst[[9, 10, 11, 12, 14, 15, 16, 17]].max() < 2e-15, worst  # measured 8.8e-16, of sinh
    assert worst[7] < 9e-15, worst  # measured 1.7e-15, of expm1 at 3
    assert worst[13] < 2e-14, worst  # measured 3.4e-15: of a power |y log x| roundings


def test_functions_at_the_ends_of_their_range():
    x = np.nan, np.inf, -np.inf, 0.0, -745.0, 709.7, 711.0
    ends = np.array([x, (np.nan, np.inf, -1.0, 0.0, 5e-324, 1.0, 1e-310)])
    found = evaluate(Functions, 18, ends)
    with np.errstate(all="ignore"):
        assert np.allclose(found[6], np.exp(ends[0]), rtol=1e-15, atol=0.0, equal_nan=True)
        assert np.allclose(found[8], np.log(ends[1]), rtol=1e-15, atol=0.0, equal_nan=True)
