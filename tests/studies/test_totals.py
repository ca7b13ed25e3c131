"""Totals of runs against `simulate` and numpy, and what they refuse."""

import numpy as np
import pytest

import rigidmc as rm
from rigidmc.errors import OptionError
from rigidmc.statistics.estimates import estimate
from rigidmc.studies import totals

HISTOGRAM = rm.Histogram("omega[1]", -0.2, 0.2, 8)
MEASURES = (
    "mean(omega_last[1])",
    "p(omega_last[2] > 0)",
    "mean(energy_drift_max)",
    "p(omega_last[1] > 0 | omega_last[2] > 0)",
)


@pytest.fixture(scope="module")
def scene():
    return rm.Scene.load("dzhanibekov").with_run(
        members=20_000, t_end=0.5, every=0.5, save=(HISTOGRAM, "omega_last")
    )


@pytest.fixture(scope="module")
def whole(scene):
    return rm.simulate(scene)


def test_totals_are_those_of_the_members(scene, whole):
    found = rm.simulate_totals(scene, MEASURES)
    for i, text in enumerate(MEASURES):
        one, wanted = found.isel(measure=i), estimate(whole, text)
        numbers = [float(one[name]) for name in ("value", "low", "high", "without")]
        assert numbers == pytest.approx([*wanted, wanted.without], rel=1e-12), text
    assert found.units.values.tolist() == ["rad s-1", "1", "1", "1"]
    for name in ("histogram", "histogram_below", "histogram_above"):
        assert np.array_equal(found[name].values, whole[name].values)
    assert found.members.values.tolist() == [20_000, 0, 0, 0, 0, 0, 0]
    assert found.attrs["scene"] and "member" not in found.dims


def test_bits_do_not_depend_on_threads_or_blocks(scene, monkeypatch):
    run = {"members": 3000, "momentum_limit": 1e-13}  # some flagged, the last group not whole
    found = rm.simulate_totals(scene, MEASURES, threads=1, **run)
    for threads, more in (3, 1), (2, 7):  # blocks of 256 and 2,688 members, not of all
        monkeypatch.setattr(totals, "MORE", more)
        assert found.identical(rm.simulate_totals(scene, MEASURES, threads=threads, **run))


def test_flagged_members_are_counted_and_left_out(scene):
    run = {"members": 500, "momentum_limit": 1e-13}
    whole, found = rm.simulate(scene, **run), rm.simulate_totals(scene, MEASURES, **run)
    flagged = int((whole.status != 0).sum())
    assert 0 < flagged < 500 and int(found.members[0]) == 500 - flagged
    assert float(found.value[0]) == pytest.approx(estimate(whole, MEASURES[0]).value, rel=1e-12)


def test_no_measures_and_one_member(scene):
    found = rm.simulate_totals(scene, members=1)
    assert found.sizes["measure"] == 0 and int(found.histogram.sum()) <= found.sizes["time"]
    one = rm.simulate_totals(scene, "mean(omega_last[1])", members=1)
    assert np.isfinite(one.value) and np.isnan(one.low)


def test_an_event_that_some_members_lack_has_no_mean(scene):
    texts = ["mean(flip_first)", "p(flip_first <= 0.2)"]
    found = rm.simulate_totals(scene, texts, members=64)
    assert np.isnan(found.value[0]) and float(found.without[0]) > 0.0
    assert float(found.value[1]) == 0.0


@pytest.mark.parametrize(
    "text", ["median(omega_last[1])", "correlation(l2_drift_max, energy_drift_max)"]
)
def test_what_needs_all_members_is_refused(scene, text):
    with pytest.raises(OptionError, match="needs the numbers of all members"):
        rm.simulate_totals(scene, text)
