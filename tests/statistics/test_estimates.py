"""Measures of results that exist: against NumPy and scipy, with conditions, and of groups."""

import numpy as np
import pytest
import xarray as xr
from scipy import stats

import rigidmc as rm
from rigidmc.errors import OptionError
from rigidmc.statistics import estimates
from rigidmc.statistics.intervals import correlation
from rigidmc.statistics.measures import measure

pytestmark = pytest.mark.filterwarnings("ignore::rigidmc.errors.SceneWarning")
SCENE = rm.Scene(
    rm.Body.from_moments((0.5, 1.0, 1.4)),
    start=rm.Start(omega=(rm.normal(0.0, 0.3), 1.0, rm.normal(0.0, 0.3))),
).with_run(integrator="rk8", dt=0.5, t_end=60.0)
SAVE = "flips", "omega_max"  # of all tests of measures, whose code is compiled once


@pytest.fixture(scope="module")
def result():
    ds = rm.simulate(SCENE, members=3000, save=SAVE)
    status = ds.status.values.copy()
    status[::100] = 3  # left out
    return ds.assign(status=ds.status.copy(data=status))


def test_a_condition_asks_some_members(result):
    good = result.status.values == 0
    some = good & (result.flips.values >= 3)
    wait = result.flip_wait.values[some]
    found = result.rigid.measure("mean(flip_wait | flips >= 3)")
    low, high = stats.t.interval(0.95, some.sum() - 1, wait.mean(), stats.sem(wait))
    assert found == pytest.approx((wait.mean(), low, high), rel=1e-12)
    assert found.value < float(result.rigid.measure("mean(flip_wait)").value)
    late = (result.omega_max.values[2] > 1.0)[some]
    exact = stats.binomtest(int(late.sum()), int(some.sum()))
    found = result.rigid.measure("p(omega_max[3] > 1 | flips >= 3)", confidence=0.9)
    low, high = exact.proportion_ci(0.9, method="wilson")
    assert found == pytest.approx((late.mean(), low, high), rel=1e-12)
    median = result.rigid.measure("median(flip_wait | flips >= 3)").value
    assert median == pytest.approx(np.median(wait), rel=1e-3)


def test_a_correlation_is_that_of_scipy(result):
    good = result.status.values == 0
    a, b = result.start_omega.values[0], result.flip_wait.values
    some = good & np.isfinite(b)
    for condition, chosen in (("", some), (" | flips >= 3", some & (result.flips.values >= 3))):
        text = f"correlation(start_omega[1], flip_wait{condition})"
        exact = stats.pearsonr(a[chosen], b[chosen])
        ends = exact.confidence_interval(0.9)
        found = result.rigid.measure(text, None, 0.9)
        assert found == pytest.approx((exact.statistic, *ends), rel=1e-12)
    with pytest.raises(OptionError, match="three components"):
        result.rigid.measure("correlation(flips, omega_max)")


def test_the_interval_of_a_correlation_covers_as_promised():
    draws = np.random.default_rng(3).normal(size=(2, 20_000, 12))
    one, other = draws[0], 0.6 * draws[0] + 0.8 * draws[1]
    _, low, high = correlation(one, other, 0.9)
    covered = np.mean((low < 0.6) & (high > 0.6))
    assert covered == pytest.approx(0.9, abs=0.01)  # measured 0.907; standard error 0.002
    assert np.isnan(correlation(one[0, :3], other[0, :3]).low)
    assert np.isnan(correlation(np.ones(5), one[0, :5]).value)


@pytest.mark.parametrize("text", ["mean(flip_first)", "correlation(flip_first, omega_max[3])"])
def test_groups_are_the_members_with_the_same_number(result, text):
    found, good = result.rigid.measure(text, by="flips"), result.status.values == 0
    assert int(found.members.sum()) == good.sum()
    for count in found.flips.values:
        chosen, row = good & (result.flips.values == count), found.sel(flips=count)
        alone = result.isel(member=chosen).rigid.measure(text)
        assert int(row.members) == chosen.sum()
        one = float(row.value), float(row.low), float(row.high)
        assert one == pytest.approx(tuple(alone), rel=1e-12, nan_ok=True)
    unit = "s" if text.startswith("mean") else "1"
    assert found.value.units == found.low.units == unit and found.without.units == "1"
    assert result.rigid.measure("p(flip_first > 9)", by="flips").value.units == "1"


def test_what_cannot_be_measured_is_told(result, monkeypatch):
    with pytest.raises(OptionError, match=r"no such variable with one value per member.*flips"):
        result.rigid.measure("p(flips >= 1)", by="flip")
    with pytest.raises(OptionError, match=r"no such variable with one value .*saves more"):
        result.rigid.measure("mean(megno)")
    monkeypatch.setattr(estimates, "MOST_GROUPS", 2)
    with pytest.raises(OptionError, match="at most 2 groups"):
        result.rigid.measure("p(flips >= 1)", by="flips")
    sobol = rm.simulate(SCENE, members=64, points="sobol", save=SAVE)
    value, low, high = sobol.rigid.measure("p(flips >= 1)")
    assert 0.0 < value <= 1.0 and np.isnan([low, high]).all()


CORRELATION = "correlation(flips, omega_max[3])"


def test_a_map_takes_a_condition():
    sides = ("body.moments.1", 0.45, 0.9), ("start.omega.2", 0.5, 1.5)
    texts = "mean(flip_wait | flips >= 3)", "p(flips >= 4 | flips >= 3)", CORRELATION
    ds = rm.stability_map(SCENE, *sides, texts, (3, 2), 40)
    pixels = rm.simulate(rm.Scene.loads(ds.attrs["scene"]))
    good, flips = pixels.status.values == 0, pixels.flips.values
    for p in range(6):
        mine = (np.arange(flips.size) % 6 == p) & good & (flips >= 3)
        row = ds.isel(y=p // 3, x=p % 3)
        mean, share, r = (row[text.replace(" ", "")].item() for text in texts)
        assert mean == pytest.approx(pixels.flip_wait.values[mine].mean(), rel=1e-14)
        assert share == pytest.approx((flips[mine] >= 4).mean(), rel=1e-14)
        mine = (np.arange(flips.size) % 6 == p) & good
        both = flips[mine], pixels.omega_max.values[2, mine]
        assert r == pytest.approx(np.corrcoef(*both)[0, 1], rel=1e-12, nan_ok=True)


def test_numbers_of_a_measure_have_units():
    known = {
        "wait": xr.Variable("member", [0.0], {"units": "s"}),
        "spin": xr.Variable(("axis", "member"), [[0.0]], {"units": "rad s-1"}),
    }
    found = measure("p(wait < 1.5 h | spin[2] >= 90 deg/s)", known, False)
    assert found.number == 5400.0 and found.given.number == pytest.approx(np.pi / 2.0)
    with pytest.raises(OptionError, match="mm is a length"):
        measure("p(wait < 1 mm)", known, False)
