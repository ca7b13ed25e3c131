"""Times of events that have not come of all members: against complete samples, scipy's estimator of
Kaplan and Meier, closed forms, and longer runs of the same members."""

import math
import warnings
from typing import NamedTuple

import numpy as np
import pytest
import xarray as xr
from scipy import stats

import rigidmc as rm
from bench.coverage import CENSORED, WAIT, of_censored_quantile, shares
from rigidmc.errors import OptionError
from rigidmc.files.netcdf import read
from rigidmc.physics.observables.saving import event_times
from rigidmc.protocols import event, running, select
from rigidmc.results.variables import NEWER
from rigidmc.statistics import censored, intervals
from rigidmc.studies.stability_map.picture import stability_map as drawn
from tests.statistics.test_estimates import SAVE, SCENE

pytestmark = pytest.mark.filterwarnings("ignore::rigidmc.errors.SceneWarning")


def samples(seed=0, cases=60):
    """Signed times of all kinds: one end and several, few and many, ties, none or all censored."""
    some = np.random.default_rng(seed)
    for case in range(cases):
        n = int(some.choice([1, 2, 3, 10, 60, 400]))
        unit = 10.0 ** some.integers(-6, 7)
        times = some.exponential(size=n) * unit
        ends = np.full(n, some.choice([0.2, 0.8, 2.0, 100.0]) * unit)
        if case % 2:
            ends = np.minimum(ends, some.exponential(size=n) * unit)
        if case % 3 == 0:  # as times known at saves alone
            times, ends = (unit * 0.1 * np.ceil(x / unit / 0.1) for x in (times, ends))
        yield np.where(times <= ends, times, -ends)


def test_the_share_without_the_event_is_that_of_scipy():
    for times in samples():
        late = np.signbit(times)
        found = censored.survival(times)
        if late.all():
            assert found.s.tolist() == [1.0]
            continue
        data = stats.CensoredData(uncensored=times[~late], right=-times[late])
        theirs = stats.ecdf(data).sf.evaluate(found.times)
        assert found.s[1:] == pytest.approx(theirs, abs=1e-12)  # measured 2e-16
        s, size = found.s[1:], found.size[1:]
        some = s > 1e-9
        variance = (s * (1.0 - s) / size)[some]
        # scipy gives the interval of Greenwood's variance only
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)
            ends = stats.ecdf(data).sf.confidence_interval(0.95, method="linear")
        width = ends.high.evaluate(found.times) - ends.low.evaluate(found.times)
        inner = (width > 0.0) & (ends.low.evaluate(found.times) > 0.0)
        inner &= ends.high.evaluate(found.times) < 1.0
        half = stats.norm.isf(0.025) * np.sqrt(variance)
        assert (0.5 * width)[some & inner] == pytest.approx(half[inner[some]], rel=1e-9)


def test_with_one_end_all_is_that_of_the_complete_sample():
    """What came by the end, and the order of the rest, is all that these estimates need."""
    for i in range(200):
        some = np.random.default_rng(i)
        x = some.exponential(size=int(some.choice([5, 30, 300])))
        end = float(some.choice([0.1, 0.7, 3.0]))
        times = np.where(x <= end, x, -end)
        for t in (0.05, 0.1, 0.7, 3.0):
            if t > end:
                continue
            for relation, k in ((">=", (x >= t).sum()), ("<", (x < t).sum())):
                found = censored.censored_probability(times, relation, t, 0.9)
                assert found.each(float) == pytest.approx(counted(k, x.size, 0.9))
        for q in (0.1, 0.5, 0.9):
            found, whole = censored.censored_quantile(times, q, 0.9), intervals.quantile(x, q, 0.9)
            assert np.isinf(found.value) == ((x <= end).mean() < q)
            if np.sort(x)[math.ceil(q * (x.size - 1))] <= end:
                assert found.value == whole.value
            assert found.low == min(max(whole.low, 0.0), end)
            assert found.high == (whole.high if whole.high <= end else math.inf)
            assert found.without == (x > end).mean()
        # the way of Kaplan and Meier finds the same ends
        ends = censored._by_survival(censored.survival(times), 0.5, 0.05)[1:]
        mine = censored.censored_quantile(times, 0.5, 0.9)[1:]
        if (x > end).any() and (x <= end).any():
            assert ends == tuple(mine)


def counted(k, n, confidence):
    """(value, low, high) of k of n members, by scipy."""
    ends = stats.binomtest(int(k), int(n)).proportion_ci(confidence, "wilson")
    return k / n, ends.low, ends.high


def test_few_members():
    for times in ([], [np.nan], [-3.0], [-0.0], [2.0], [2.0, -3.0]):
        times = np.array(times)
        found = censored.censored_quantile(times, 0.5, 0.95)
        assert np.isnan(found.value) == (np.isnan(times).all())
        assert not found.value < 0.0 and not found.low < 0.0
    none = censored.censored_quantile(np.array([-3.0, -3.0]), 0.5, 0.95)
    assert tuple(none) == (np.inf, 0.0, np.inf)
    assert censored.censored_quantile(np.full(400, -3.0), 0.5, 0.95).words() == (
        "beyond 3, 95 % above 3; no event by 3 s in 100 % of the members"
    )


@pytest.fixture(scope="module")
def runs():
    """The same tops to t = 5, and to 60, when all have flipped."""
    return [rm.simulate(SCENE, members=2000, t_end=t, save=SAVE) for t in (5.0, 60.0)]


def test_short_runs_tell_what_long_ones_do(runs):
    short, long = runs
    first = long.flip_first.values
    never = np.isnan(short.flip_first.values)
    assert 0.2 < never.mean() < 0.8 and (never == ~(first <= 5.0)).all()
    assert (short.followed_until.values == 5.0).all()
    whole = np.where(np.isnan(first), np.inf, first)
    for t in (1.5, 3.0, 5.0):
        for text, k in ((f"p(flip_first >= {t})", whole >= t), (f"p(flip_first < {t})", whole < t)):
            found = short.rigid.measure(text)
            assert found == pytest.approx(counted(k.sum(), k.size, 0.95))
            assert found.without == never.mean()
    q = 0.5 * (1.0 - never.mean())
    text = f"quantile(flip_first, {q:.3f})"
    assert tuple(short.rigid.measure(text)) == tuple(long.rigid.measure(text))
    beyond = short.rigid.measure(f"quantile(flip_first, {1.0 - 0.5 * never.mean():.3f})")
    assert (beyond.value, beyond.low, beyond.until) == (math.inf, 5.0, 5.0)
    assert "beyond 5, 95 % above 5" in beyond.words()


def test_the_mean_of_what_is_not_known_is_refused(runs):
    short, _ = runs
    for text in (
        "mean(flip_first)", "flip_first", "correlation(flip_first, start_omega[1])",
        "correlation(start_omega[1], flip_first)",
    ):  # fmt: skip
        with pytest.raises(OptionError, match=r"% of the members have no flip_first .*median"):
            short.rigid.measure(text)
    some = short.rigid.measure("mean(flip_first | flip_first <= 5)").value
    assert some == pytest.approx(np.nanmean(short.flip_first.values), rel=1e-14)
    with pytest.raises(OptionError, match=r"followed only until 5 s, not until 30 s"):
        short.rigid.measure("p(flip_first >= 30)")
    # waits are no times of events: they are of the members that have them, and say so
    has = np.isfinite(short.flip_wait.values)
    found = short.rigid.measure("p(flip_wait >= 0)")
    assert found.value == 1.0 and found.without == pytest.approx(1.0 - has.mean())
    assert "of the members have no value" in found.words()
    for text, words in (
        ("mean(flip_wait | flips <= 1)", "no member has a value"),
        ("mean(flip_wait | flips < 0)", "no member is selected"),
    ):
        assert short.rigid.measure(text).words() == words
        assert short.rigid.summary(of=text).endswith(f"{text}: {words}")
    groups = short.rigid.measure("mean(flip_first)", by="flips")
    assert groups.without.values.tolist() == [float(n == 0) for n in groups.flips.values]
    assert np.isnan(groups.value.values[0]) and np.isfinite(groups.value.values[1:]).all()


def test_a_summary_tells_what_has_not_come(runs):
    short, _ = runs
    lines = {line.split()[0]: line for line in short.rigid.summary().splitlines()}
    missing = int(np.isnan(short.flip_first.values).sum())
    assert f"not by 5 s for {missing:,} of 2,000 members" in lines["flip_first"]
    assert "to beyond 5 s" in lines["flip_first"] and "+-" not in lines["flip_first"]
    waits = int(np.isnan(short.flip_wait.values).sum())
    assert f"no value for {waits:,} of 2,000 members" in lines["flip_wait"]
    still = short.isel(member=np.isnan(short.flip_first.values))
    lines = {line.split()[0]: line for line in still.rigid.summary().splitlines()}
    assert lines["flip_first"].endswith(f" not by 5 s for {missing:,} of {missing:,} members")
    assert lines["flip_wait"].endswith(f" no value in any of {missing:,} members")


def test_results_of_earlier_versions_and_of_others(runs, tmp_path):
    """Without the variable and the attribute, as such a result has it; through a file; joined."""
    short, long = runs
    text = "median(flip_first)"
    wanted = tuple(long.rigid.measure(text))
    old = long.drop_vars("followed_until")
    old.flip_first.attrs.pop("censored_at")
    assert tuple(old.rigid.measure(text)) == wanted
    short.to_netcdf(tmp_path / "new.nc")
    old.to_netcdf(tmp_path / "old.nc")
    for name in ("new", "old"):
        with rm.open(tmp_path / f"{name}.nc") as there:
            source = short if name == "new" else long
            assert there.flip_first.attrs["censored_at"] == "followed_until"
            assert tuple(there.rigid.measure(text)) == tuple(source.rigid.measure(text))
    stored = read(str(tmp_path / "old.nc"), "flips", "followed_until", newer=NEWER)
    assert np.isnan(stored["followed_until"]).all() and stored["flips"].max() > 1.0
    with pytest.raises(rm.RigidmcError, match="followed_until"):
        read(str(tmp_path / "old.nc"), "followed_until")
    # members that were followed for different times, put together by xarray
    some = zip(runs, (slice(1000), slice(1000, 1200)), strict=True)
    both = xr.concat([one.drop_vars("time").isel(member=part) for one, part in some], "member")
    found = both.rigid.measure(text)
    truth = np.median(long.flip_first.fillna(math.inf).values)
    assert found.low < truth < found.high
    assert np.nanmedian(both.flip_first.values) < found.low  # of those that had it: wrong


@event(outputs={"fast_at": ("s", "when omega_1 passes 1 rad/s", ())})
class FastAt(NamedTuple):
    """Nothing says that it is the time of an event but its results."""

    def level(self, body, l):
        return body.i1 * l[0] - 1.0

    def results(self, record):
        return {"fast_at": record.first}


@pytest.fixture(scope="module")
def flagged():
    """Balls of which torques turn one axis to 1 rad/s, and another until they are flagged: both
    times in closed form, and independent of each other."""
    torque = rm.BodyTorque((rm.uniform(0.05, 0.5), 0.0, rm.uniform(10.0, 100.0)))
    scene = rm.Scene(rm.Body.from_moments((1.0, 1.0, 1.0)), torque, rm.Start(omega=(0.0, 0.0, 0.0)))
    ds = rm.simulate(
        scene, members=3000, integrator="rk4", dt=0.01, t_end=10.0, save=(FastAt(),),
    )  # fmt: skip
    return ds, 1.0 / ds.body_torque_size.values[0]


def test_flagged_members_are_followed_until_then(flagged):
    ds, true = flagged
    ends, bad = ds.followed_until.values, ds.status.values > 0
    assert 0.3 < bad.mean() < 0.9 and (ends[~bad] == 10.0).all()
    assert (ends[bad] < 10.0).all() and (ends[bad] <= ds.status_time.values[bad]).all()
    assert (ds.status_time.values[bad] - ends[bad]).max() < 0.641  # 64 steps to the last look
    come = true <= ends
    assert (np.isfinite(ds.fast_at.values) == come).all()
    assert np.abs(ds.fast_at.values - true)[come].max() < 1e-12  # measured 4e-15
    assert ds.fast_at.attrs["censored_at"] == "followed_until"
    data = stats.CensoredData(uncensored=true[come], right=ends[~come])
    sf = stats.ecdf(data).sf
    for t in (3.0, 6.0, 9.0):
        truth = (1.0 / t - 0.05) / 0.45
        found = ds.rigid.measure(f"p(fast_at >= {t})")
        assert found.value == pytest.approx(float(sf.evaluate(t)), abs=1e-9)
        assert found.low < truth < found.high
    median = ds.rigid.measure("median(fast_at)")
    assert median.low < 1.0 / 0.275 < median.high
    with pytest.raises(OptionError, match="have no fast_at"):
        ds.rigid.measure("mean(fast_at)")


def test_a_member_that_stops_is_followed_until_then():
    """Of tops that stop when axis 3 nears L, the flip of those that stopped first is not known."""
    fall = rm.Passage(axis=3, angle=0.9, way="reaches", about="momentum", stop=True)
    ds = rm.simulate(SCENE, members=500, t_end=5.0, save=("flips", fall))
    stopped = np.isfinite(ds.passage_first.values)
    assert 10 < stopped.sum() < 490
    until, step = ds.followed_until.values, 0.5
    late = until[stopped] - ds.passage_first.values[stopped]
    assert late.min() >= -1e-9 and late.max() <= step + 1e-9
    assert until[~stopped] == pytest.approx(5.0, rel=1e-12)
    times = censored.signed_times(ds, "flip_first", ds.flip_first.values)
    none = np.isnan(ds.flip_first.values)
    assert (times[none] == -until[none]).all() and none[stopped].any()


@running(state_size=1, outputs={
    "slow_at": ("s", "when", ()), "turns": ("1", "turns", ()), "axes": ("s", "each", ("axis",)),
})  # fmt: skip
class SlowAt(NamedTuple):
    def begin(self, q):
        return (-1.0,)

    def update(self, state, t, l):
        return (select(l[0] > 1.0, t, state[0]),)

    def results(self, state, steps):
        return {"slow_at": state[0], "turns": state[0], "axes": np.stack([state[0]] * 3)}


def test_which_outputs_are_times_of_events():
    assert event_times("flips", rm.Flips()) == {"flip_first": 0.0}
    hold = rm.Passage(axis=3, angle=0.5, hold=7.0)
    assert event_times("passage_2", hold) == {"passage_first_2": 7.0}
    assert event_times("fast_at", FastAt()) == {"fast_at": 0.0}
    assert event_times("slow_at", SlowAt()) == {"slow_at": 0.0}
    stated = type("Stated", (SlowAt,), {"event_times": ()})
    assert event_times("slow_at", stated()) == {}
    (_, statistic), *_ = SCENE.with_run(save=("omega_max",)).recording.monitored
    assert event_times("omega_max", statistic) == {}
    wrong = type("Wrong", (SlowAt,), {"event_times": ("other",)})
    with pytest.raises(rm.SceneError, match=r"event_times: is .*expected a tuple of names"):
        rm.prepare(SCENE.with_run(save=(wrong(),)))


def test_negative_numbers_are_no_times_of_events(runs):
    """Such as a lag in seconds, which a class did not say to be no time of an event."""
    ds = runs[0].rename(flip_first="lag")
    ds["lag"] = ds.lag - 3.0  # the attributes stay with xr.set_options(keep_attrs=True) alone
    ds.lag.attrs["censored_at"] = "followed_until"
    with pytest.raises(OptionError, match=r"lag.* has negative values.*event_times=\(\)"):
        ds.rigid.measure("median(lag)")
    ds.lag.attrs["censored_at"] = "no"
    assert ds.rigid.measure("p(lag < 0)").without == pytest.approx(np.isnan(ds.lag).mean())


def until(text):
    return rm.simulate_until(SCENE, text, t_end=5.0)


def test_studies_take_a_time_that_has_not_come_for_later():
    text, count, mean = "p(flip_first >= 4.5)", 512, "mean(flip_first)"
    for refused, words in (
        (lambda: rm.sensitivity(SCENE, mean, count, t_end=5.0), "have no flip_first"),
        (lambda: until(f"{mean} +- 1 %"), "have no flip_first"),
        (lambda: until("quantile(flip_first, 0.99) +- 1 %"), "is later than 5 s"),
        (lambda: until("p(flip_first >= 6) +- 0.1"), "not until 6 s"),
    ):
        with pytest.raises(OptionError, match=words):
            refused()
    found = rm.sensitivity(SCENE, text, count, t_end=5.0)
    long = rm.sensitivity(SCENE, text, count, t_end=60.0)
    assert found.total.values.tolist() == long.total.values.tolist()
    assert int(found.families[0]) == count and found["mean"] > 0.2
    ends = rm.basins(SCENE, text, 64, t_end=5.0)
    assert ends.attrs["left_out"] == 0 and set(ends.basin.values.tolist()) == {0, 1}
    _, reached = until("quantile(flip_first, 0.1) +- 5 %")
    assert reached.half <= 0.05 * reached.value and reached.without > 0.2


def test_maps_take_a_time_that_has_not_come_for_later():
    sides = ("body.moments.1", 0.45, 0.9), ("start.omega.2", 0.5, 1.5)
    texts = ("median(flip_first)", "mean(flip_first)", "p(flip_first >= 4.5)", "mean(flip_wait)")
    ds = rm.stability_map(SCENE, *sides, texts, (3, 2), 40, t_end=5.0)
    pixels = rm.simulate(rm.Scene.loads(ds.attrs["scene"]))
    first = np.where(np.isnan(pixels.flip_first), np.inf, pixels.flip_first).reshape(40, 2, 3)
    good = pixels.status.values.reshape(40, 2, 3) == 0
    for at in np.ndindex(2, 3):
        mine = first[:, *at][good[:, *at]]
        middle, mean, share = (ds[text.replace(" ", "")].values[at] for text in texts[:3])
        late = np.sort(mine)[mine.size // 2] == np.inf
        assert middle == (np.inf if late else pytest.approx(np.median(mine), rel=1e-14))
        assert np.isnan(mean) if np.isinf(mine).any() else mean == pytest.approx(mine.mean())
        assert share == pytest.approx((mine >= 4.5).mean())
        without = ds["median(flip_first)_without"].values[at]
        assert without == pytest.approx(np.isinf(mine).mean())
    assert np.isinf(ds["median(flip_first)"]).any() and "mean(flip_wait)_without" in ds
    legend = drawn(ds, "median(flip_first)").axes[0].get_legend().get_texts()
    assert "not in all members by the end" in [text.get_text() for text in legend]


def test_rare_counts_no_member_as_flagged_for_a_time_that_has_not_come():
    late = rm.rare(SCENE, "p(flip_first >= 4.5)", members=200, repetitions=4, t_end=5.0)
    assert int(late.flagged.sum()) == 0
    plain = rm.simulate(SCENE, members=4000, t_end=5.0, save=SAVE)
    share = plain.rigid.measure("p(flip_first >= 4.5)")
    assert late.p_low < share.high and share.low < late.p_high and share.value > 0.2
    with pytest.raises(OptionError, match="ends at t_end = 5 s"):
        rm.rare(SCENE, "p(flip_first >= 6)", members=200, repetitions=4, t_end=5.0)


@pytest.mark.parametrize("name", [name for name in CENSORED if "their ends" in name])
def test_intervals_of_censored_times_cover(name):
    """200 studies of the rows with several ends; `python -m bench coverage` and a slow test take
    1,000 of all rows, which cover in 95.0 to 96.6 %."""
    covered = shares(name, 200)
    assert covered.min() > 0.91 and covered.max() < 0.99  # a standard error is 1.5 %


@pytest.mark.parametrize(("members", "saved", "several"), [(10, 0.0, True), (40, 0.1, False)])
def test_few_members_and_ties_cover_no_less(members, saved, several):
    """Ranks are whole, and an interval has the ties at its ends: both make it wider."""
    covered, count = of_censored_quantile(WAIT, 0.5, 0.2, members, 300, several, saved)
    assert covered / count > 0.94  # measured 0.97, 0.98
