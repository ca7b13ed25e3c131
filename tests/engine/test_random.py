"""Random numbers: numpy's Philox at the documented counters, whatever the partition, uniform in the open interval."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from rigidmc.engine.random import stream_of, uniforms


def test_numbers_are_philox_at_counter_member_plus_one():
    """One member at a time: numpy adds one to the counter before it draws."""
    key = np.random.SeedSequence(7).generate_state(2, np.uint64)
    for member in (0, 1, 999_999, 2**40):
        for draw in (0, 3):
            counter = np.array([member, draw, stream_of("omega"), 0], np.uint64)
            raw = np.random.Generator(np.random.Philox(key=key, counter=counter)).bit_generator.random_raw(4)
            expected = [((int(r) >> 11) + 0.5) / 2**53 for r in raw]
            assert uniforms(7, "omega", member, 1, draw)[:, 0].tolist() == expected


def test_the_first_number_has_not_changed_since_the_first_release():
    assert uniforms(7, "omega", 0, 1)[:, 0].tolist() == FIRST


@given(st.integers(0, 2**32), st.integers(0, 10**9), st.lists(st.integers(1, 40), min_size=1, max_size=5))
def test_partition_does_not_matter(seed, first, sizes):
    whole = uniforms(seed, "x", first, sum(sizes))
    starts = first + np.cumsum([0, *sizes[:-1]])
    parts = [uniforms(seed, "x", int(start), size) for start, size in zip(starts, sizes, strict=True)]
    assert np.concatenate(parts, axis=1).tobytes() == whole.tobytes()


def test_seed_name_draw_and_member_all_matter():
    base = uniforms(1, "omega", 0, 100)
    for other in (uniforms(2, "omega", 0, 100), uniforms(1, "attitude", 0, 100), uniforms(1, "omega", 0, 100, 1), uniforms(1, "omega", 1, 100)):
        assert not (base == other).any()
    assert uniforms(1, "omega", 1, 99).tobytes() == base[:, 1:].tobytes()


def test_numbers_are_uniform_and_independent():
    u = uniforms(7, "omega", 0, 200_000)
    assert u.shape == (4, 200_000)
    assert (0.0 < u).all() and (u < 1.0).all()
    for row in u:
        assert stats.kstest(row, "uniform").pvalue > 0.01  # measured MMM
    assert stats.kstest(u.ravel() ** 1.01, "uniform").pvalue < 1e-6  # what is not uniform is found out
    assert np.abs(np.corrcoef(u) - np.eye(4)).max() < 0.01  # measured MMM
    assert abs(np.corrcoef(u[0, 1:], u[0, :-1])[0, 1]) < 0.01  # neighbours


def test_the_open_interval_is_open_at_its_ends():
    """The smallest and the largest of the 2^53 numbers."""
    assert (0 + 0.5) * 2.0**-53 > 0.0
    assert (2**53 - 1 + 0.5) * 2.0**-53 < 1.0


def test_streams_have_names_and_no_numbers():
    names = ["omega", "omega.0", "omega.1", "momentum", "attitude", "body.moments"]
    assert len({stream_of(n) for n in names}) == len(names)
    assert all(0 <= stream_of(n) < 2**64 for n in names)
