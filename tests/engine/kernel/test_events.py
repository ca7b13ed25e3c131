"""The search for the time of an event within a step, uncompiled."""

import pytest

from rigidmc.engine.kernel.events import interpolate_root, shrink_bracket


def searched(level, low, high, times):
    """The shares of a step that are tried, by the method of Illinois."""
    ends, tried = (low, level(low), high, level(high)), []
    for _ in range(times):
        share = interpolate_root(ends)
        tried.append(share)
        ends = shrink_bracket(ends, share, level(share))
    return tried


def test_the_search_is_that_of_illinois():
    """x^2 = 1/2: the shares of regula falsi in which an end that stays has its level halved.

    Dowell & Jarratt, BIT 11 (1971) 168. By hand: 1/2, then (1/2, 1) gives 2/3; both lie below the
    root, so the level 1/2 at 1 is halved: 2/3 + (1/3) (1/18)/(1/18 + 1/4) = 8/11.
    """
    tried = searched(lambda x: x * x - 0.5, 0.0, 1.0, 9)
    assert tried[:3] == pytest.approx([1 / 2, 2 / 3, 8 / 11], rel=1e-15)
    assert tried[-1] == pytest.approx(0.5**0.5, rel=1e-15)


def test_a_level_that_is_the_same_at_both_ends_gives_the_older_end():
    assert interpolate_root((0.25, 0.5, 1.0, 0.5)) == 0.25
