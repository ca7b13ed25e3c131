"""Means and squares of groups of members: against exact fractions, in any blocks."""

from fractions import Fraction

import numpy as np
import pytest

from rigidmc.statistics import sums
from rigidmc.statistics.sums import GROUP, Moments, OrderedSums, moments_of_groups


def numbers(count):
    """Return numbers with a spread far below their mean, of which every tenth is missing."""
    draw = np.random.default_rng(7)
    x, there = draw.normal(6.28, 1e-6, count), draw.random(count) > 0.1
    x[~there] = np.nan
    return x, there


def summed(x, there, size, order=None):
    """Return the Moments of numbers in blocks of `size` that end in an order."""
    total = OrderedSums(1)
    starts = list(range(0, x.size, size))
    for i in order or range(len(starts)):
        part = slice(starts[i], starts[i] + size)
        total.add(starts[i] // GROUP, [moments_of_groups(x[part], there[part])])
    return total.totals()[0]


def test_sums_against_fractions():
    x, there = numbers(1001)
    exact = [Fraction(v) for v in x[there].tolist()]
    mean = sum(exact) / len(exact)
    found = summed(x, there, 1024)
    assert found.count == len(exact)
    assert abs(found.mean - float(mean)) <= 2e-15  # two bits of 6.28; measured 0
    squares = float(sum((v - mean) ** 2 for v in exact))
    assert found.squares == pytest.approx(squares, rel=3e-9)  # bits of 6.28 / 1e-6; measured 6e-11


def test_bits_do_not_depend_on_blocks_or_their_order(monkeypatch):
    monkeypatch.setattr(sums, "BATCH", 5)
    x, there = numbers(2000)
    wanted = summed(x, there, 2016)
    blocks = 2000 // 96 + 1
    for order in None, [*range(1, blocks), 0], [*reversed(range(blocks))]:
        assert summed(x, there, 96, order) == wanted
    assert summed(x, there, 32) == wanted
    monkeypatch.setattr(sums, "BATCH", 6)
    assert summed(x, there, 32) != wanted  # the order of sums decides their last bits


def test_whole_groups_are_summed_as_groups_with_gaps():
    x = np.random.default_rng(1).normal(size=96)
    everywhere = np.ones(96, bool)
    whole, short = moments_of_groups(x, everywhere), moments_of_groups(x[:95], everywhere[:95])
    assert np.array_equal(whole[:, :2], short[:, :2]) and short[0, 2] == 31.0


def test_nothing_and_a_single_number():
    assert OrderedSums(2).totals() == [Moments(), Moments()]
    none = np.full(40, np.nan), np.zeros(40, bool)
    assert summed(*none, 64) == Moments()
    assert summed(np.array([3.0]), np.array([True]), 32) == Moments(1.0, 3.0, 0.0)
