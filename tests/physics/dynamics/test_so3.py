"""Sine, cosine and exponentials against 40 digits; quaternions against matrices.

In plain Python and in the form that compiled code uses.
"""

import math
from fractions import Fraction
from typing import NamedTuple

import mpmath as mp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigidmc.engine.formulas import evaluate
from rigidmc.physics.dynamics import so3
from tests.tools.reference import apart, hat, rodrigues, rotation, unit


class Formula(NamedTuple):
    """What compiled code computes of a vector: an exponential, and functions of its x."""

    x: float
    y: float
    z: float

    def values(self):
        sine, cosine = so3.sincos(self.x)
        return (*so3.exponential((self.x, self.y, self.z)), sine, cosine, so3.expm1(self.x))


def compiled(part):
    """A function of so3 that is compiled; `part` of all that is."""

    def function(x):
        given = x if isinstance(x, tuple) else (x, 0.0, 0.0)
        found = evaluate(Formula, 7, [[one] for one in given])[:, 0][part]
        return found if isinstance(part, int) else tuple(found.tolist())

    return function


def both(function, part):
    """A test of a function in plain Python and compiled."""
    each = [function, compiled(part)]
    return pytest.mark.parametrize("function", each, ids=["python", "compiled"])


BOTH_SINCOS, BOTH_EXPM1 = both(so3.sincos, slice(4, 6)), both(so3.expm1, 6)
number = st.floats(-1.0, 1.0)
vector = st.tuples(number, number, number)
quaternion = (
    st.tuples(number, number, number, number)
    .filter(lambda q: sum(x * x for x in q) > 1e-4)
    .map(unit)
)


def sincos_error(function, xs):
    with mp.workdps(40):
        return max(
            max(abs(mp.sin(x) - function(x)[0]), abs(mp.cos(x) - function(x)[1]))
            for x in map(float, xs)
        )


@BOTH_SINCOS
def test_sincos_is_right_to_rounding_up_to_a_million(function):
    some = np.random.default_rng(1)
    wide, tiny = some.uniform(-1e6, 1e6, 1500), 10.0 ** some.uniform(-300, 0, 200)
    xs = np.concatenate([some.uniform(-8, 8, 1500), wide, tiny, [0.0, -0.0]])
    assert sincos_error(function, xs) < 2e-16  # measured 1.6e-16 over 120,000 angles


@BOTH_SINCOS
def test_sincos_at_and_beside_multiples_of_a_quarter_turn(function):
    far = np.random.default_rng(2).integers(-600_000, 600_000, 500)
    xs = np.concatenate([np.arange(-40, 41), far]) * (math.pi / 2)
    xs = np.concatenate([xs, np.nextafter(xs, np.inf), np.nextafter(xs, -np.inf)])
    # measured 2e-20: the small one of the two is right in all its digits
    assert sincos_error(function, xs) < 1e-19


def test_sincos_without_the_three_parts_of_a_quarter_turn_is_caught():
    def one_part(x):
        n = round(x * 2 / math.pi)
        r = x - n * (math.pi / 2)
        s, c = math.sin(r), math.cos(r)
        return ((s, c), (c, -s), (-s, -c), (-c, s))[n % 4]

    error = sincos_error(one_part, np.random.default_rng(3).uniform(-1e6, 1e6, 200))
    assert error > 1e-12  # measured 9e-11


@BOTH_SINCOS
def test_sincos_of_huge_angles_errs_like_the_rounded_angle(function):
    for size in 10.0 ** np.arange(6, 13):
        error = sincos_error(function, np.random.default_rng(4).uniform(size / 2, size, 100))
        assert error < 2e-16 * size  # measured 9e-17 in Python, 1e-22 with fused multiply-add


def test_sincos_is_odd_and_even_and_exact_at_zero():
    assert so3.sincos(0.0) == (0.0, 1.0)
    for x in (1e-300, 1e-9, 0.3, 2.0, 5.5, 1e5):
        assert so3.sincos(-x) == (-so3.sincos(x)[0], so3.sincos(x)[1])


def expm1_error(function, xs):
    with mp.workdps(40):
        return max(abs(function(x) / mp.expm1(x) - 1) for x in map(float, xs))


@BOTH_EXPM1
def test_expm1_is_right_relative_to_its_size(function):
    some = np.random.default_rng(5)
    small = 10.0 ** some.uniform(-300, 0, 500)
    assert expm1_error(function, -small) < 1.5e-15  # measured 7e-16
    assert expm1_error(function, some.uniform(-44, 0, 1000)) < 1.5e-15  # measured 7e-16
    assert expm1_error(function, small) < 2e-15  # measured 1.0e-15
    # measured 9e-15: the eight squarings magnify
    assert expm1_error(function, some.uniform(0, 20, 1000)) < 2e-14
    assert function(0.0) == 0.0
    assert abs(function(-1e300) + 1.0) < 2e-16  # measured 1.1e-16: a top damped for ever is at rest
    assert expm1_error(lambda x: math.exp(x) - 1.0, -small[small > 1e-9]) > 1e-9  # what it is for


@both(so3.exponential, slice(4))
def test_exponential_turns_by_its_length_about_itself(function):
    some = np.random.default_rng(6)
    worst = 0
    tiny, turns = (0.0, 1e-310, 1e-160, 1e-100, 1e-20, 1e-8, 1e-3), (math.pi, 2 * math.pi)
    for size in (*tiny, 1.0, 3.0, *turns, 50.0, 1e3):
        for axis in some.normal(size=(20, 3)):
            u = tuple(float(x) for x in size * axis)
            q = function(u)
            with mp.workdps(40):
                angle = mp.sqrt(sum(mp.mpf(x) ** 2 for x in u))
                r = mp.sin(angle / 2) / angle if angle else mp.mpf("0.5")
                true = mp.cos(angle / 2), *(r * x for x in u)
                length = max(1, angle)  # the rounding of |u| itself
                worst = max(worst, *(abs(a - b) / length for a, b in zip(q, true, strict=True)))
                if size < 1e-20:
                    assert q == (1.0, *(0.5 * x for x in u))
    assert worst < 2e-16  # measured 9e-17


@given(vector)
def test_exponential_is_the_matrix_exponential(u):
    assert apart(rotation(so3.exponential(u)), rodrigues(np.array(u))) < 2e-15  # measured 4e-16


@given(vector, number, number)
def test_turns_about_one_axis_add_up(u, a, b):
    along = so3.multiply(so3.exponential([a * x for x in u]), so3.exponential([b * x for x in u]))
    assert np.allclose(along, so3.exponential([(a + b) * x for x in u]), rtol=0, atol=1e-15)


@given(quaternion, quaternion, quaternion)
def test_quaternion_algebra(p, q, r):
    for one, other in (  # measured 7e-16
        (so3.multiply(so3.multiply(p, q), r), so3.multiply(p, so3.multiply(q, r))),
        (so3.multiply(q, (q[0], -q[1], -q[2], -q[3])), (1, 0, 0, 0)),
        (rotation(so3.multiply(p, q)), rotation(p) @ rotation(q)),  # q turns first, then p
    ):
        assert apart(one, other) <= 2e-15
    assert math.isclose(sum(x * x for x in so3.multiply(p, q)), 1.0, rel_tol=1e-15)


def test_the_product_does_not_commute():
    i, j, k = (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1)
    assert so3.multiply(i, j) == k
    assert so3.multiply(j, i) == (0, 0, 0, -1)
    assert so3.multiply(i, i) == so3.multiply(j, j) == so3.multiply(k, k) == (-1, 0, 0, 0)


@given(quaternion)
def test_up_is_the_last_row_of_the_attitude(q):
    assert apart(so3.vertical(q), rotation(q)[2]) <= 1e-15
    assert so3.vertical(q) == so3.vertical([-x for x in q])  # q and -q are one attitude


def test_up_and_not_its_mirror():
    quarter = math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0  # about x: the body's y axis points up
    assert np.allclose(so3.vertical(quarter), (0, 1, 0), atol=1e-15)


@given(quaternion, quaternion, vector)
def test_turned_adds_the_product_with_the_half_turn(q, p, w):
    half = np.add(q, so3.multiply(p, (0.0, *w)))
    assert apart(so3.advance_attitude(q, p, w), half) <= 2e-15  # measured 4e-16


@given(vector, vector)
def test_vectors(a, b):
    assert np.allclose(so3.cross(a, b), hat(a) @ b, rtol=0, atol=4e-16)  # measured 1.1e-16
    assert math.isclose(so3.dot(a, b), float(np.dot(a, b)), rel_tol=0, abs_tol=1e-15)
    assert so3.add(a, b) == so3.axpy(a, 1.0, b) == tuple(np.add(a, b))
    assert so3.scale(2.0, a) == so3.add(a, a)
    assert so3.difference(a, b) == tuple(np.subtract(a, b))
    one, two, sum4 = (1.0, *a), (2.0, *b), (3.0, *so3.add(a, b))
    assert so3.difference4(one, two) == (-1.0, *so3.difference(a, b))
    assert so3.add4(one, two) == so3.axpy4(one, 1.0, two) == sum4
    # trailing numbers, of one vector or of both
    assert so3.axpy((*a, 5.0), 1.0, b) == (*so3.add(a, b), 5.0)
    assert so3.axpy((*a, 5.0), 2.0, (*b, 1.0)) == (*so3.axpy(a, 2.0, b), 7.0)


def test_sums_with_remainders_lose_nothing():
    """two_sum to the bit against rational numbers; gain, gain4 and moved pairs against 40
    digits.
    """
    some = np.random.default_rng(7)
    for a, b in some.normal(size=(200, 2)) * 10.0 ** some.integers(-12, 12, (200, 2)):
        s, e = so3.two_sum(a, b)
        assert s == a + b
        assert Fraction(s) + Fraction(e) == Fraction(a) + Fraction(b)
    l, q = tuple(some.normal(size=3)), so3.normalised(tuple(some.normal(size=4)))
    turn = so3.normalised((1.0, 1e-3, -2e-3, 5e-4))
    pair, quat, exact, true = (l, (0.0,) * 3), (q, (0.0,) * 4), [Fraction(x) for x in l], q
    plain, step = q, tuple(1e-9 * some.normal(size=3))
    with mp.workdps(40):
        true, by = (tuple(mp.mpf(float(x)) for x in p) for p in (q, turn))
        size = mp.sqrt(sum(x * x for x in by))
        by = tuple(x / size for x in by)
        for _ in range(300):
            pair, true = so3.add_compensated(pair, step), so3.multiply(true, by)
            plain, quat = (so3.apply_rotation(x, turn) for x in (plain, quat))
        size = mp.sqrt(sum(x * x for x in true))
        true = [x / size for x in true]
        found = [mp.mpf(float(a)) + mp.mpf(float(b)) for a, b in zip(*quat, strict=True)]
        # measured 1.1e-16: each turn of 1e-3 is rounded to 1e-19; without remainders 1.3e-15
        assert apart(found, true) < 4e-16 and apart(plain, true) > 1e-15
    for a, b, x, d in zip(*pair, exact, step, strict=True):
        assert abs(Fraction(a) + Fraction(b) - x - 300 * Fraction(d)) < 1e-25


@pytest.mark.parametrize("turn", [(0.6, 0.0, 0.64, 0.48), (-0.6, 0.48, -0.64, 0.0)])
def test_a_pair_turns_as_the_sum_of_its_parts(turn):
    """By a large turn, also one by more than half a circle, and with a remainder that counts: the
    sign of an attitude is free."""
    q, rest = so3.normalised((0.5, -0.3, 0.7, 0.2)), (2e-9, 1e-9, -3e-9, 5e-9)
    value, left = so3.apply_rotation((q, rest), turn)
    true = so3.multiply([a + b for a, b in zip(q, rest, strict=True)], turn)
    size = np.sqrt(np.square(true).sum())
    off = np.add(value, left) - np.copysign(1.0, turn[0]) * np.array(true) / size
    # measured 1.1e-16; with the remainder on the wrong side 9e-9
    assert np.abs(off).max() < 1e-15


def test_a_pair_comes_back_to_the_sphere():
    """gain4 brings |q| = 1.00001 back: what is left is 5/2 of the cube of 2e-5."""
    q = so3.normalised((0.5, -0.3, 0.7, 0.2))
    value, rest = so3.add_compensated4((q, (0.0,) * 4), so3.scale4(1e-5, q))
    assert abs(np.dot(value, value) + 2.0 * np.dot(value, rest) - 1.0) < 1e-13  # measured 4e-14
    assert apart(value, q) < 1e-13


def test_selects_take_each_component_from_its_own_place():
    a, b = (1.0, 2.0, 3.0, 4.0), (5.0, 6.0, 7.0, 8.0)
    assert so3.select_all(True, a, b) == a
    assert so3.select_all(False, a, b) == b


def test_components_in_the_body():
    q, v = so3.normalised((0.5, -0.3, 0.7, 0.2)), (0.3, -1.2, 2.0)
    assert apart(np.array(rotation(q)).T @ v, so3.into_body(q, v)) < 1e-15
    assert apart(so3.into_body(q, (0.0, 0.0, 1.0)), so3.vertical(q)) < 1e-15


def test_remainders_of_an_attitude_are_carried_component_by_component():
    """The part of a (value, remainder) pair across q stays, to 1e-29; only the part along q is
    normalised.
    """
    q = so3.normalised((0.5, -0.3, 0.7, 0.2))
    for rest in (
        (0.3e-18, 0.5e-18, 0.0, 0.0),
        (-0.7e-18, 0.0, 0.5e-18, 0.0),
        (0.0, 0.0, -0.2e-18, 0.7e-18),
        (-0.2e-18, 0.0, 0.0, 0.5e-18),
    ):
        value, left = so3.add_compensated4((q, rest), (0.0, 1e-19, 0.0, 0.0))
        a, b, c, d = (np.array([Fraction(x) for x in part]) for part in (value, left, q, rest))
        off = a + b - c - d - [0, Fraction(1e-19), 0, 0]
        along = (off @ c) / (c @ c)
        assert apart(off, along * c) < 1e-29
        assert abs(along) < 1e-15
