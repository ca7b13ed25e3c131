"""Sobol indices: Ishigami's function, a top that is linear in Gaussian numbers, scipy, coverage."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from scipy import stats

import rigidmc as rm
from bench.coverage import FIRST, GROUP, LINEAR, TOTAL, ishigami, shares
from rigidmc.errors import OptionError
from rigidmc.planning.initial import uncertain_numbers
from rigidmc.runs.directory.create import create
from rigidmc.runs.directory.resume import resume
from rigidmc.scene.sampling import Saltelli
from rigidmc.statistics.intervals import resolution
from rigidmc.studies.sensitivity.bounds import poincare_constant
from rigidmc.studies.sensitivity.picture import sensitivity_bars
from rigidmc.studies.sensitivity.study import indices, table
from tests.tools.plans import starts


def test_ishigami():
    first, total = indices(ishigami(1, 2**16))
    # measured 0.004 and 0.008
    assert np.abs(first.value - FIRST).max() < 0.01 and np.abs(total.value - TOTAL).max() < 0.01
    swapped = ishigami(1, 2**16)[:, [0, 1, 3, 2, 4]]  # another number's members
    assert np.abs(indices(swapped)[0].value - FIRST).max() > 0.1


def test_indices_are_those_of_scipy():
    y = ishigami(3, 1024)
    given = {"f_A": y[None, :, 0], "f_B": y[None, :, 1], "f_AB": y[:, 2:].T[:, None, :]}
    theirs = stats.sobol_indices(func=given, n=1024)
    first, total = indices(y, controls=False)
    assert np.abs(first.value - theirs.first_order).max() < 1e-13  # measured 2e-16
    assert np.abs(total.value - theirs.total_order).max() < 1e-13


def test_intervals_cover():
    """Of 1,000 studies, each of six intervals: 93 to 97 %; `tests/statistics/test_intervals.py` has
    more of them."""
    found = shares("Sobol indices, Ishigami, 1,024 families")
    assert (found >= 0.93).all() and (found <= 0.97).all()  # measured 0.936 to 0.955
    narrow = [indices(ishigami(seed, 1024), 0.9)[1] for seed in range(100)]
    covered = np.mean([(one.low <= TOTAL) & (one.high >= TOTAL) for one in narrow])
    assert covered < 0.93  # measured 0.89


def test_ends_are_where_students_test_says_so():
    """And there are none where the test rejects no ratio."""
    y = ishigami(3, 64)
    total = indices(y, controls=False)[1]
    y = y - y[:, :2].mean()
    above, below = 0.5 * (y[:, :1] - y[:, 2:]) ** 2, 0.5 * (y[:, :2] ** 2).sum(axis=1)
    for ends in (total.low, total.high):
        found = stats.ttest_1samp(above - ends * below[:, None], 0.0).pvalue
        assert found == pytest.approx(0.05, rel=1e-12)  # measured 2e-15
    assert np.isnan(indices(ishigami(3, 2))[1].low).all()


def test_the_second_member_and_one_group_differ():
    words = Saltelli(5, GROUP).words("x", 3, 12, 0, (0, 1, 2))[:3]  # from member 3 on
    whole = Saltelli(5, GROUP).words("x", 0, 20, 0, (0, 1, 2))[:3]
    assert np.array_equal(words, whole[:, 3:15])
    families = whole.reshape(3, 4, 5)
    for k in range(3):
        like_first = families[:, :, 2 + k] == families[:, :, 0]
        assert (like_first == (np.arange(3) != k)[:, None]).all()
        assert np.array_equal(families[k, :, 2 + k], families[k, :, 1])


def test_a_linear_top():
    """The mean spin over 2 s is omega + N/2: shares 0.36 and 0.04 of a variance of 0.4."""
    study = rm.sensitivity(LINEAR, "mean(omega_mean[3])", 5000, threads=1)
    assert study.number.values.tolist() == ["effects.body_torque.size.3", "start.omega.3"]
    for name in ("first", "total"):
        one = study.isel(measure=0)
        off = np.abs(one[name].values - (0.1, 0.9))
        assert (off < one[f"{name}_high"] - one[f"{name}_low"]).all()
        assert off.max() < 0.04  # measured 0.013
    assert float(study["mean"][0]) == pytest.approx(1.0, abs=0.03)
    assert float(study.variance[0]) == pytest.approx(0.4, abs=0.02)
    assert study.units.values.tolist() == ["rad s-1"]


def test_laws_and_attitudes_are_groups():
    start = rm.Start(omega=rm.Cone(2, 1.0, 0.1), attitude=(0.0, rm.normal(0.4, 0.1), 0.0))
    scene = rm.Scene(rm.Body((1.0, rm.uniform(1.2, 1.4), 2.0)), rm.Gravity(9.81), start)
    names = ["body.moments.2", "start.attitude.theta", "start.omega"]
    assert uncertain_numbers(scene.model)[0] == names
    drawn = scene.with_run(points="saltelli")
    made = starts(drawn, 0, 10, True)[1]
    omega = made["start_omega"].reshape(3, 2, 5)
    assert (omega[:, :, [2, 3]] == omega[:, :, :1]).all()  # moments and attitude change there
    assert (omega[:, :, 4] == omega[:, :, 1]).all()


def test_a_run_directory_tells_the_same_also_in_part(tmp_path):
    text = "p(omega_mean[3] > 1)"
    whole = rm.sensitivity(LINEAR, text, 10_000)
    scene = LINEAR.with_run(points="saltelli", members=40_000, save=("omega_mean",))
    path = tmp_path / "run"
    create(scene, path, size=200_000)
    resume(path, only=range(2))
    with pytest.warns(rm.SceneWarning, match="of 40,000 members"):
        part = rm.sensitivity.of(rm.open(path), text)
    assert 0 < int(part.families[0]) < 10_000
    resume(path)
    again = rm.sensitivity.of(rm.open(path), text)
    assert again["first"].equals(whole["first"]) and again.total_high.equals(whole.total_high)
    assert "10,000 families of 4 members" in "\n".join(table(again))
    assert "sampling noise" not in "\n".join(table(again.assign(total=again["first"] + 0.01)))
    assert "sampling noise" in "\n".join(table(again.assign(total=again["first"] - 0.01)))
    label = sensitivity_bars(again).axes[0].get_xlabel()
    assert label.startswith("p(mean ω₃ > 1)")


class Brake(NamedTuple):
    """An effect of a user's own."""

    size: float

    def torque(self, l):
        return (-self.size * l[0], -self.size * l[1], -self.size * l[2])


def test_a_study_of_code_needs_the_code(tmp_path):
    """A result of this process leads to its classes; a file does not, whoever wrote it."""
    scene = replace(LINEAR, effects=(Brake(0.1),)).with_run(save=("omega_mean",))
    result, text = rm.simulate(scene, points="saltelli", members=300), "mean(omega_mean[3])"
    result.to_netcdf(tmp_path / "a.nc")
    with rm.open(tmp_path / "a.nc") as stored, pytest.raises(rm.SceneError, match="allow-code"):
        rm.sensitivity.of(stored, text)
    study = rm.sensitivity.of(result, text)
    assert study.number.values.tolist() == ["start.omega.3"]
    assert study.total.values == pytest.approx(1.0, abs=0.3)  # measured 1.12: nothing else is drawn


def test_what_is_no_study_is_refused():
    with pytest.raises(OptionError, match="use mean"):
        rm.sensitivity(LINEAR, "median(omega_mean[3])", 10)
    plain = rm.simulate(LINEAR, members=4, save=("omega_mean",))
    with pytest.raises(OptionError, match="saltelli"):
        rm.sensitivity.of(plain, "mean(omega_mean[3])")
    fixed = rm.Scene(rm.Body((1.0, 1.0, 2.0)), start=rm.Start(omega=(0.0, 0.0, 1.0)))
    with pytest.raises(rm.SceneError, match="nothing in the scene is drawn"):
        rm.sensitivity(fixed, "mean(energy_drift_max)", 10, t_end=1.0)


def threshold(c, families, rng):
    """Members of families of y = 1 if x_1 + x_2/2 > c, of normal numbers x."""
    a, b = x = rng.standard_normal((2, families, 2))
    swapped = [np.where(np.arange(2) == k, b, a) for k in range(2)]
    return np.stack([(u @ (1.0, 0.5) > c).astype(float) for u in (*x, *swapped)], axis=1)


def threshold_indices(c):
    """(first, total) of `threshold`, by quadrature over one number."""
    x = np.linspace(-9.0, 9.0, 20001)
    weight = stats.norm.pdf(x) * (x[1] - x[0])
    p = stats.norm.sf(c / 1.25**0.5)
    means = stats.norm.sf((c - x) / 0.5), stats.norm.sf(c - 0.5 * x)
    first = [((weight * one**2).sum() - p * p) / (p * (1.0 - p)) for one in means]
    return np.array(first), 1.0 - np.array(first[::-1])


def test_intervals_of_small_probabilities_cover():
    """With controls they covered 3 to 60 % of the time, of probabilities below 5 %."""
    for families, p in ((512, 0.05), (512, 0.02), (1024, 0.005), (4096, 0.01)):
        c, rng = stats.norm.isf(p) * 1.25**0.5, np.random.default_rng(1)
        first, total = threshold_indices(c)
        hits = np.zeros((2, 2))
        for _ in range(200):
            found = indices(threshold(c, families, rng))
            for hit, one, true in zip(hits, found, (first, total), strict=True):
                hit += np.isnan(one.low) | ((one.low <= true) & (true <= one.high))
        assert hits.min() >= 0.88 * 200  # measured 0.90 to 1


def test_what_hardly_differs_has_no_indices():
    """A constant is decided by rounding, a probability of a few members by these."""
    rng = np.random.default_rng(2)
    constant = 0.1 + 1e-17 * rng.standard_normal((600, 4))
    constant += np.spacing(0.1) * rng.integers(-3, 4, constant.shape)
    seldom = np.zeros((600, 4))
    seldom[:9, 1] = 1.0
    for values in (constant, seldom, np.full((600, 4), np.nan), np.empty((0, 4))):
        for one in indices(values):
            assert np.isnan(one).all() and one.value.shape == (2,)
    seldom[9, 1] = 1.0
    assert np.isfinite(indices(seldom)[1].value).all()
    single = 0.1 + 1e-8 * rng.standard_normal((600, 4))  # of float32
    assert np.isnan(indices(single, resolved=resolution("float32"))[0].value).all()


@pytest.mark.slow
def test_the_moment_about_the_spin_counts():
    """The spin about axis 3 is the smaller the larger the moment there; nothing else matters."""
    spread = np.diag([1e-4, 1e-4, 1e-2, 1e-5, 1e-5, 1e-5])
    body = rm.Body.from_tensor(rm.UncertainInertia(np.diag([1.0, 1.5, 2.0]), spread))
    start = rm.Start(momentum=(0.0, 0.0, rm.normal(1.0, 0.02)))
    scene = rm.Scene(body, start=start).with_run(dt=0.1, t_end=0.1)
    study = rm.sensitivity(scene, ["mean(omega_max[3])", "p(omega_max[3] >= 9)"], 300)
    names = [f"body.tensor.{one}" for one in ("1.1", "2.2", "3.3", "2.3", "3.1", "1.2")]
    assert study.number.values.tolist() == [*names, "start.momentum.3"]
    # (dI/I)^2 is 0.0025 and (dL/L)^2 0.0004
    total = study.total.values[0]
    assert total[[2, 6]] == pytest.approx((0.862, 0.138), abs=0.1)  # measured 0.002
    assert np.abs(np.delete(total, [2, 6])).max() < 1e-3  # measured 1.8e-6
    assert study.differing.values.tolist() == [300, 0] and np.isnan(study.total.values[1]).all()
    assert "indices require 10" in "\n".join(table(study))
    sensitivity_bars(study)
    never = rm.sensitivity(scene.with_run(save=("flips",)), "mean(flip_wait)", 20)
    assert "no family has a value" in table(never)[1] and int(never.families[0]) == 0


def test_zero_is_written_without_a_sign():
    study = rm.sensitivity(LINEAR, "mean(omega_mean[3])", 50, threads=1)
    for name in ("first", "first_low", "first_high"):
        study[name][:] = -1e-5
    assert "-0.000" not in "\n".join(table(study)) and "0.000 (0.000 to" in table(study)[3]


def test_each_independent_element_of_a_tensor_has_an_index():
    """Spin about (1, 1, 0)/sqrt(2): E = w^2 (I11 + I22 + 2 I12)/4, so that the variances of the
    elements count as 1 : 1 : 4."""
    variances = [4e-6, 1e-6, 0.0, 0.0, 0.0, 1e-6]
    law = rm.UncertainInertia(np.diag([2.0, 2.5, 3.0]), np.diag(variances))
    scene = rm.Scene(rm.Body.from_tensor(law), start=rm.Start(omega=(1.0, 1.0, 0.0)))
    ds = rm.sensitivity(scene, of="mean(energy_mean)", families=8192, dt=0.05, t_end=0.1)
    names = ["body.tensor.1.1", "body.tensor.2.2", "body.tensor.1.2"]
    assert ds.number.values.tolist() == names
    # measured 0.0048 with 8,192 families
    assert ds["first"].values[0] == pytest.approx(np.array([4.0, 1.0, 4.0]) / 9.0, abs=0.02)


def test_correlated_elements_of_a_tensor_have_one_index_together():
    both = np.diag([4e-6, 1e-6, 0.0, 0.0, 0.0, 1e-6])
    both[0, 1] = both[1, 0] = 1e-6
    law = rm.UncertainInertia(np.diag([2.0, 2.5, 3.0]), both)
    assert set(law.names_of_draws()) == {"tensor.1.1+tensor.2.2", "tensor.1.2"}
    full = rm.UncertainInertia(np.diag([2.0, 2.5, 3.0]), np.eye(6) * 0.01 + 1e-4)
    assert set(full.names_of_draws()) == {"tensor"}


def precessing(lean):
    """A symmetric top with omega_1 = a cos(omega_3 t) at t = 1, where omega_3, its rate of
    precession in the body, turns it by 0 to pi."""
    start = rm.Start(omega=(lean, 0.0, rm.uniform(0.0, np.pi)))
    return rm.Scene(rm.Body((1.0, 1.0, 2.0)), start=start)


def test_bounds_by_derivatives_of_a_precessing_top():
    """Var_a = s^2 <cos^2> of V = (m^2 + s^2)/2, and the phase alone or with a has all of V. Both
    bounds equal the total index: omega_1 is linear in the normal a, and the cosine over half a
    period is the function whose variance is Poincare's constant times its mean squared slope."""
    mean, deviation = 0.6, 0.8
    study = rm.sensitivity(
        precessing(rm.normal(mean, deviation)), "mean(omega_last[1])", 4000, bounds=True,
        integrator="exact", t_end=1.0, dt=0.5,
    ).isel(measure=0)  # fmt: skip
    assert study.number.values.tolist() == ["start.omega.1", "start.omega.3"]
    for name in ("total", "bound"):
        off = np.abs(study[name].values - (deviation**2, 1.0))  # m^2 + s^2 is 1
        assert (off < study[f"{name}_high"] - study[f"{name}_low"]).all()
        assert off.max() < 0.05
    twice = 2.0 * study.bound  # a constant for the standard deviation in place of the variance
    assert (np.abs(twice - (deviation**2, 1.0)) > study.bound_high - study.bound_low).all()
    lines = table(study.expand_dims("measure"))
    assert "at most" in lines[2] and len(lines) == 5
    bars = sensitivity_bars(study.expand_dims("measure")).axes[0]
    assert "at most, by derivatives" in [text.get_text() for text in bars.get_legend().texts]


@pytest.mark.parametrize(
    ("law", "constant"),
    [
        (rm.normal(3.0, 0.5), 0.25),
        (rm.uniform(1.0, 3.0), 4.0 / np.pi**2),
        (rm.distribution("expon", scale=0.5), 1.0),
        (rm.distribution("laplace", scale=0.5), 1.0),
        (rm.distribution("norm", loc=1.0, scale=0.5), 0.25),
        (rm.normal(0.0, 0.5).between(0.0, np.inf), 0.25),
        (rm.normal(0.0, 9.0).between(0.0, 2.0), 4.0 / np.pi**2),
        (rm.distribution("gamma", a=2.0), np.nan),
        (rm.mixture((1.0, rm.normal(0.0, 1.0)), (1.0, rm.normal(9.0, 1.0))), np.nan),
    ],
)
def test_poincare_constants(law, constant):
    """And no function of a few has a larger variance for its slope."""
    found = poincare_constant(law)
    assert found == pytest.approx(constant, rel=1e-15, nan_ok=True)
    if constant == constant:
        x = law.ppf((np.arange(10**5) + 0.5) / 10**5)
        trials = ((x, 1.0), (np.cos(0.7 * x), 0.7 * np.sin(0.7 * x)), (x * x, 2.0 * x))
        assert all(y.var() <= found * np.mean(slope**2 + 0.0 * x) * 1.001 for y, slope in trials)


def test_what_has_no_bound_is_refused():
    scene = precessing(0.5)
    for text in ("p(omega_last[1] > 0)", "mean(flips)", "mean(omega_last[1] | flips >= 1)"):
        with pytest.raises(OptionError, match="use the mean of a smooth quantity"):
            rm.sensitivity(scene, text, 10, bounds=True, t_end=1.0)
    cone = replace(scene, start=rm.Start(omega=rm.Cone(2, 1.0, 0.1)))
    with pytest.raises(OptionError, match="no uncertain parameter has a bound"):
        rm.sensitivity(cone, "mean(omega_last[1])", 10, bounds=True, t_end=1.0)
    plain = rm.simulate(LINEAR, points="saltelli", members=40, save=("omega_mean",))
    with pytest.raises(OptionError, match="--wrt effects"):
        rm.sensitivity.of(plain, "mean(omega_mean[3])", bounds=True)
