"""Random numbers: numpy's Philox at the documented counters, uniform in the open interval.

The same for any partition of the members.
"""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from rigidmc.engine.streams import stream_of, uniforms
from tests.tools.reference import apart


def test_numbers_are_philox_at_counter_member_plus_one():
    """One member at a time: numpy adds one to the counter before it draws."""
    key = np.random.SeedSequence(7).generate_state(2, np.uint64)
    for member in (0, 1, 999_999, 2**40):
        for draw in (0, 3):
            counter = np.array([member, draw, stream_of("omega"), 0], np.uint64)
            raw = np.random.Philox(key=key, counter=counter).random_raw(4)
            wanted = [int(r) / 2**64 for r in raw]
            assert apart(uniforms(7, "omega", member, 1, draw)[:, 0], wanted) < 2.0**-51


def test_the_first_number_has_not_changed_since_the_first_release():
    first = [0.39157076099386684, 0.8385248453570198, 0.8273566694620507, 0.10753482707530299]
    assert np.abs(uniforms(7, "omega", 0, 1)[:, 0] - first).max() < 2.0**-51


SIZES = st.lists(st.integers(1, 40), min_size=1, max_size=5)


@given(st.integers(0, 2**32), st.integers(0, 10**9), SIZES)
def test_partition_does_not_matter(seed, first, sizes):
    whole = uniforms(seed, "x", first, sum(sizes))
    starts = (first + np.cumsum([0, *sizes[:-1]])).tolist()
    parts = [uniforms(seed, "x", at, size) for at, size in zip(starts, sizes, strict=True)]
    assert np.concatenate(parts, axis=1).tobytes() == whole.tobytes()


def test_seed_name_draw_and_member_all_matter():
    base = uniforms(1, "omega", 0, 100)
    for other in (
        uniforms(2, "omega", 0, 100),
        uniforms(1, "attitude", 0, 100),
        uniforms(1, "omega", 0, 100, 1),
        uniforms(1, "omega", 1, 100),
    ):
        assert not (base == other).any()
    assert uniforms(1, "omega", 1, 99).tobytes() == base[:, 1:].tobytes()


def test_numbers_are_uniform_and_independent():
    u = uniforms(7, "omega", 0, 200_000)
    assert u.shape == (4, 200_000)
    assert (u > 0.0).all() and (u < 1.0).all()
    for row in u:
        assert stats.kstest(row, "uniform").pvalue > 0.05  # measured 0.33 to 0.93
    # measured 7e-8: numbers that are not uniform are detected
    assert stats.kstest(u.ravel() ** 1.01, "uniform").pvalue < 1e-5
    assert np.abs(np.corrcoef(u) - np.eye(4)).max() < 0.01  # measured 0.004
    assert abs(np.corrcoef(u[0, 1:], u[0, :-1])[0, 1]) < 0.01  # measured 0.0016


def test_the_open_interval_is_open_at_its_ends(monkeypatch):
    """The smallest and the largest raw number, once in 2^53 draws: 1.0 would make a normal deviate
    infinite.
    """

    class Ends:
        def __init__(self, **_):
            pass

        def random_raw(self, count):
            return np.array([0, 2**64 - 1, 2**64 - 2**11, 2**63] * (count // 4), np.uint64)

    monkeypatch.setattr(np.random, "Philox", Ends)
    u = uniforms(7, "omega", 0, 2)
    assert (u > 0.0).all() and (u < 1.0).all()
    assert u[0, 0] < 2.0**-52 and u[1, 0] > 1.0 - 2.0**-51


def test_streams_have_names_and_no_numbers():
    names = ["omega", "omega.0", "omega.1", "momentum", "attitude", "body.moments"]
    assert len({stream_of(n) for n in names}) == len(names)
    assert all(0 <= stream_of(n) < 2**64 for n in names)
