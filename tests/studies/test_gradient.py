"""Derivatives of means, quantiles and probabilities against closed forms, and what is refused."""

import dataclasses
import math
from typing import NamedTuple

import numpy as np
import pytest
from scipy import stats

import rigidmc as rm
from rigidmc.errors import OptionError, SceneError
from rigidmc.physics.dynamics.euler import MassProperties
from rigidmc.physics.observables import saveable_names
from rigidmc.physics.observables.protocol import observable
from rigidmc.physics.observables.saving import is_event_time
from rigidmc.results.variables import member_derivatives, saved_variables, variables_of
from rigidmc.statistics.intervals import probability
from rigidmc.studies import load_study
from rigidmc.studies.gradient.estimators import growth_of, of_mean, of_quantile, of_score
from rigidmc.studies.gradient.scores import scores_of, scores_of_model

STUDY = load_study("gradient")
MEAN, SD = 1.0, 0.1
LAW = rm.normal(MEAN, SD)
MOMENT = 2.0
DISC = rm.Scene(rm.Body((1.0, 1.0, MOMENT)), start=rm.Start(omega=(0.0, 0.0, LAW)))
BY_MEAN, BY_SD = NAMES = ("start.omega.3.mean", "start.omega.3.standard_deviation")
FAMILIES = {
    "expon": {"loc": 0.5, "scale": 2.0},
    "gamma": {"a": 2.5, "scale": 0.7},
    "laplace": {"loc": 0.3, "scale": 0.7},
    "logistic": {"loc": 0.3, "scale": 0.7},
    "lognorm": {"s": 0.4, "scale": 2.0},
    "norm": {"loc": 0.3, "scale": 0.7},
    "rayleigh": {"scale": 0.7},
}


def log_density(law, x):
    if law.name == "truncated":
        return law.parameters[0].frozen().logpdf(x) - math.log(law.acceptance())
    if law.name == "mixture":
        parts = [w * np.exp(log_density(part, x)) for w, part in law.parameters]
        return np.log(sum(parts) / sum(w for w, _ in law.parameters))
    return law.frozen().logpdf(x)


def check_score(make, at, name, x):
    step = 1e-5 * max(1.0, abs(at))
    low, high = (log_density(make(at + d), x) for d in (-step, step))
    found = scores_of(make(at))[name](x)
    np.testing.assert_allclose(found, (high - low) / (2.0 * step), rtol=1e-6, atol=1e-8)


def test_scores_are_derivatives_of_log_densities():
    x = np.linspace(0.6, 2.4, 13)
    check_score(lambda p: rm.normal(p, 0.7), 0.3, "mean", x)
    check_score(lambda p: rm.normal(0.3, p), 0.7, "standard_deviation", x)
    check_score(lambda p: rm.normal(p, 0.7).between(0.5, 2.5), 0.3, "mean", x)
    check_score(lambda p: rm.normal(0.3, p).between(0.5, math.inf), 0.7, "standard_deviation", x)

    def two(weight, mean=2.0):
        return rm.mixture((weight, rm.uniform(0.0, 3.0)), (2.0, rm.normal(mean, 0.5)))

    check_score(two, 1.5, "1.weight", x)
    check_score(lambda mean: two(1.5, mean), 2.0, "2.mean", x)
    for name, given in FAMILIES.items():
        law = rm.distribution(name, **given)
        able = [key for key, score in scores_of(law).items() if callable(score)]
        assert able
        for key in able:
            known = {"loc": 0.0, "scale": 1.0, **given}
            make = lambda p, n=name, k=key, g=known: rm.distribution(n, **{**g, k: p})  # noqa: E731
            check_score(make, known[key], key, x)
    assert "end of the support" in scores_of(rm.uniform(0.0, 1.0))["high"]
    assert "end of the support" in scores_of(rm.distribution("expon"))["loc"]
    assert "has no score here" in scores_of(rm.distribution("weibull_min", c=2.0))["c"]


def test_scores_of_a_scene_have_the_names_of_derivatives():
    full = np.diag([1.0, 2.0, 3.0]) + 0.5
    start = rm.Start(omega=rm.Correlated((1.0, 2.0, 3.0), full), attitude=(0.0, LAW, 0.0))
    scene = rm.Scene(rm.Body((1.0, 1.1, 2.0)), rm.Gravity(rm.normal(9.81, 0.1)), start)
    found = scores_of_model(scene.model)
    assert "start.attitude.theta.mean" in found
    assert "effects.gravity.g.standard_deviation" in found
    drawn, score = found["start.omega.mean.2"]
    assert drawn == tuple(f"start.omega.{i}" for i in (1, 2, 3))
    x = np.array([[1.5], [2.5], [2.0]])

    def log(mean):
        return stats.multivariate_normal(mean, full).logpdf(x[:, 0])

    assert score(x)[0] == pytest.approx((log([1.0, 2.001, 3.0]) - log([1.0, 1.999, 3.0])) / 0.002)


def test_intervals_of_the_estimators_cover():
    """Y = exp(X) of X = m + s z: dY/dm = Y, so the derivative of a quantile is the quantile."""
    rng, level, trials, n = np.random.default_rng(3), 0.8, 300, 1000
    quantile, middle = math.exp(0.5 * stats.norm.ppf(level)), math.exp(0.125)
    covered = np.zeros(3)
    for _ in range(trials):
        z = rng.standard_normal(n)
        y = np.exp(0.5 * z)
        rates = y * (1.0 + rng.normal(0.0, 0.5, n))
        by_quantile, by_score = of_quantile(y + 0.0, rates, level, 0.95), of_score(y, z / 0.5, 0.95)
        found = (of_mean(y, 0.95), middle), (by_quantile, quantile), (by_score, middle)
        covered += [one.low <= true <= one.high for one, true in found]
    low, high = 0.915, 0.985  # 95 % less and more 2.5 and 3 errors
    assert ((covered / trials > low) & (covered / trials < high)).all(), covered / trials


def test_a_condition_counts_in_the_likelihood_ratio():
    """<X | X > 0> of X from N(m, 1) has the derivative 1 - 2/pi at m = 0."""
    x = np.random.default_rng(5).standard_normal(100_000)
    found = of_score(np.where(x > 0.0, x, np.nan), x, 0.95)
    assert found.low < 1.0 - 2.0 / math.pi < found.high
    assert found.half < 0.02


def test_special_cases_of_the_estimators():
    none, few = np.array([]), np.arange(5.0)
    assert math.isnan(of_quantile(few, few, 0.5, 0.95).value)
    assert math.isnan(of_score(np.full(5, np.nan), few, 0.95).value)
    assert math.isnan(of_score(np.ones(5), few, 0.95).value)  # an event that all members have
    assert math.isnan(of_mean(none, 0.95).value)
    one = of_mean(np.array([2.0]), 0.95)
    assert one.value == 2.0
    assert math.isnan(one.low)
    nearly = np.append(np.arange(100.0), np.nan)
    assert of_quantile(nearly, np.ones(101), 0.01, 0.95).value == pytest.approx(1.0)
    assert math.isnan(growth_of(np.zeros(3), np.zeros(3), np.zeros(3)).exponent)


def test_growth_tells_chaos_from_shear():
    rates = np.random.default_rng(1).standard_normal(1000)
    shear = growth_of(np.full(9, 5.0), np.full(9, 10.0), rates)
    assert shear.exponent == pytest.approx(1.386, 1e-3)
    chaos = growth_of(np.full(9, math.exp(20.0)), np.full(9, math.exp(40.0)), rates)
    assert chaos.exponent == pytest.approx(40.0)
    assert chaos.carriers == pytest.approx(2000.0 / math.pi, rel=0.1)
    assert growth_of(rates, rates, np.array([1e300, 1.0, 1.0])).carriers == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("of", "wrt", "more", "words"),
    [
        ("p(omega_last[3] >= 1)", "start.omega.3", {}, "members jump.*start.omega.3.mean"),
        ("p(omega_last[3] >= 1)", "body.moments.3", {}, "requires a parameter of a distribution"),
        ("mean(flips)", "start.omega.3", {}, "flips has no derivative of a member"),
        ("mean(energy_last | flips >= 1)", "start.omega.3", {}, "jump across the condition"),
        ("median(flips)", BY_MEAN, {}, "requires a mean or p"),
        ("median(energy_last)", BY_MEAN, {"method": "score"}, "requires a mean or p"),
        ("p(flips >= 1)", BY_MEAN, {"method": "path"}, "members jump"),
        ("mean(energy_last)", "start.omga.3", {}, "did you mean"),
        ("mean(energy_last)", BY_MEAN, {"method": "pth"}, "did you mean 'path'"),
        ("mean(energi_last)", BY_MEAN, {}, "no such variable"),
        ("mean(omega_last)", BY_MEAN, {}, "three components"),
        ("correlation(flips, flips)", BY_MEAN, {}, "correlation is not a mean"),
        ("mean(energy_last)", None, {}, "needs parameters"),
    ],
)
def test_what_has_no_derivative_is_refused_with_the_way_out(of, wrt, more, words):
    with pytest.raises((OptionError, SceneError), match=words):
        rm.gradient(DISC, of, wrt, t_end=1.0, **more)


@observable(units="1", long_name="height of axis 3", dims=())
class Upward(NamedTuple):
    """A custom observable, the vertical component of the axis 3."""

    power: float = 1.0

    def value(self, q):
        return ((q[0] * q[0] - q[1] * q[1] - q[2] * q[2] + q[3] * q[3]) * self.power,)


def saving_all(scene):
    others = ("orbit_angles", "noise_score", "histogram")
    names = saveable_names(scene.observables)
    return scene.with_run(save=tuple(name for name in names if not name.startswith(others)))


def measures_of(scene):
    """{variable over members: measure of its mean} of all that a scene can monitor or save."""
    every = saving_all(scene)
    found = {**variables_of(every), **saved_variables(every.effects, every.recording)}
    single = {name: one.dims for name, one in found.items() if not name.startswith("start_")}
    axes = {("member",): "", ("axis", "member"): "[2]"}
    made = {name: f"mean({name}{axes[d]})" for name, d in single.items() if d in axes}
    timed = {("time", *dims): axis for dims, axis in axes.items()}
    last = {name: f"mean({name}_last{timed[d]})" for name, d in single.items() if d in timed}
    return made | {f"{name}_last": text for name, text in last.items()}


def test_every_observable_that_wrt_differentiates_has_a_path():
    points = rm.PointingAngle(axis=(0.0, 0.0, 1.0))
    given = points, Upward(), rm.Passage(3, 0.1)
    scene = dataclasses.replace(DISC, observables=given)
    every = saving_all(scene).with_run(wrt=(BY_MEAN,))
    recording, known = every.recording, variables_of(every)
    able = {*member_derivatives(known, recording, ("s",))}
    able |= {f"d_{name}_last" for name in recording.names}
    jump = {name for name, one in known.items() if is_event_time(name, one.attrs)}
    measures = measures_of(scene)
    assert len(measures) > 50  # 53
    for name, measure in measures.items():
        path = f"d_{name}" in able and name not in jump
        try:
            is_path = STUDY.design(scene, measure, BY_MEAN).run.wrt == (BY_MEAN,)
        except OptionError as error:
            assert "derivative" in str(error) or "no such variable" in str(error), name
            is_path = False
        assert is_path == path, name


def test_the_path_of_an_observable_with_parameters():
    points = rm.PointingAngle(axis=(0.0, 0.6, 0.8))
    start = rm.Start(omega=(rm.normal(0.0, 0.1), 0.3, 2.0), attitude=(0.0, 0.4, 0.0))
    body = rm.Body((1.0, 2.0, 2.5), mass=1.0, centre=(0.0, 0.0, 0.1))
    scene = rm.Scene(body, rm.Gravity(9.81), start, observables=(points,))
    run = {"integrator": "rk4", "dt": 0.01, "t_end": 0.5, "members": 20}
    by, names = "effects.gravity.g", ("pointing_angle_last", "energy_mean", "nutation_max")
    ds = rm.simulate(scene, wrt=(by,), save=(*names[:2], "nutation"), **run)
    found = rm.gradient(scene, [f"mean({name})" for name in names], by, **run)
    means = [float(ds[f"d_{name}"].mean()) for name in names]
    assert np.abs(found.derivative[:, 0] - means).max() < 1e-14  # measured 2e-17
    assert (found.method == "path").all()
    assert np.isfinite(found.growth).values.ravel().tolist() == [True, False, False]


def test_uniform_ends_have_no_likelihood_ratio_but_a_path():
    start = rm.Start(omega=(0.0, 0.0, rm.uniform(0.0, 1.0)))
    scene = dataclasses.replace(DISC, start=start)
    with pytest.raises(OptionError, match="moves an end of the support"):
        rm.gradient(scene, "p(omega_last[3] >= 0.5)", "start.omega.3.high")
    wrt = STUDY.design(scene, "mean(energy_last)", "start.omega.3.high").run.wrt
    assert wrt == ("start.omega.3.high",)


@pytest.mark.parametrize("h", [1e-3, 0.3, 5.0])
def test_the_score_of_a_bath_is_the_derivative_of_its_log_density(h):
    """Of the normal density of L after the noise, at a fixed L, by central differences."""
    body, l = MassProperties.of((1.0, 2.0, 2.5), (0.0, 0.0, 0.0)), (0.7, -1.3, 0.4)
    bath = rm.Bath(0.9, 0.4, (0.5, -1.7, 1.1))
    after = np.array(bath.add_noise(body, h, l))

    def log_density(gamma, kT):
        left = math.exp(-gamma * h)
        spread = kT * np.array([1.0, 2.0, 2.5]) * (1.0 - left * left)
        return stats.norm.logpdf(after, left * np.array(l), np.sqrt(spread)).sum()

    found = bath.noise_score(body, h, l)
    for i, step in enumerate(((1e-5, 0.0), (0.0, 1e-5))):
        ahead, behind = (log_density(0.9 + s * step[0], 0.4 + s * step[1]) for s in (1, -1))
        # measured 6e-9
        assert found[i] == pytest.approx((ahead - behind) / 2e-5, rel=1e-6)


def probability_in_a_bath(gamma, kT, t, first, level):
    """p(omega > level) of a sphere with moment 2, which spins with `first` at t = 0: omega is an
    Ornstein-Uhlenbeck process, with any step."""
    left = math.exp(-gamma * t)
    return stats.norm.sf(level, first * left, math.sqrt(0.5 * kT * (1.0 - left * left)))


def test_a_probability_by_temperature_and_friction():
    """Of a sphere in a bath, against the closed form; and together with the path."""
    gamma, kT, t, first, level = 0.8, 0.5, 1.0, 1.0, 0.7
    names = ("effects.bath.gamma", "effects.bath.kT")
    start = rm.Start(omega=(0.0, 0.0, first))
    scene = rm.Scene(rm.Body((MOMENT, MOMENT, MOMENT)), rm.Bath(gamma, kT), start)
    found = rm.gradient(
        scene, [f"p(omega_last[3] > {level})", "mean(omega_last[3])"], names, method="score",
        integrator="strang", t_end=t, dt=0.25, members=40_000,
    )  # fmt: skip

    def slope(of, i, step=1e-5):
        ends = [of(gamma + s * step * (i == 0), kT + s * step * (i == 1)) for s in (1, -1)]
        return (ends[0] - ends[1]) / (2.0 * step)

    of_p = [slope(lambda g, k: probability_in_a_bath(g, k, t, first, level), i) for i in (0, 1)]
    true = np.array([of_p, [-t * first * math.exp(-gamma * t), 0.0]])
    off = np.abs(found.derivative.values - true)
    half = 0.5 * (found.derivative_high - found.derivative_low).values
    assert (off < 2.0 * half).all()
    assert (half[0] < 0.15 * np.abs(true[0])).all()  # measured 0.042 and 0.115
    for wrong in (-found.derivative.values[0], 2.0 * found.derivative.values[0]):
        assert (np.abs(wrong - true[0]) > 4.0 * half[0]).all()
    assert found.noise_steps.values.tolist() == [4, 4]
    words = "\n".join(STUDY.table(found))
    assert "uncertain in sign: the noise of 4 steps" in words  # of the last derivative, which is 0
    assert words.count("uncertain") == 1


def test_a_probability_by_the_temperatures_of_start_and_bath():
    """Of a sphere with momenta in equilibrium, whose variance at t is that of the start times
    exp(-2 gamma t), plus that of the bath."""
    gamma, kT, t, level = 0.8, 0.5, 1.0, 0.7
    names = ("start.momentum.kT", "effects.bath.kT")
    start = rm.Start(momentum=rm.GibbsMomentum(kT))
    scene = rm.Scene(rm.Body((MOMENT, MOMENT, MOMENT)), rm.Bath(gamma, kT), start)
    run = {"integrator": "strang", "t_end": t, "dt": 0.25, "members": 40_000}
    found = rm.gradient(scene, f"p(omega_last[3] > {level})", names, **run).isel(measure=0)
    x, left = level / math.sqrt(kT / MOMENT), math.exp(-2.0 * gamma * t)
    true = stats.norm.pdf(x) * x / (2.0 * kT) * np.array([left, 1.0 - left])
    half = 0.5 * (found.derivative_high - found.derivative_low).values
    assert (np.abs(found.derivative.values - true) < 2.0 * half).all()
    assert (half < 0.25 * true).all()
    drawn, score = scores_of_model(scene.model)[names[0]]
    assert drawn[::5] == ("start.momentum.1", "body.moments.3")
    l = np.array([[0.5], [-1.0], [2.0]])
    of_start = stats.norm(scale=math.sqrt(MOMENT * kT)).logpdf(l).sum()
    hotter = stats.norm(scale=math.sqrt(MOMENT * (kT + 1e-6))).logpdf(l).sum()
    numbers = np.concatenate([l, np.full((3, 1), MOMENT)])
    assert score(numbers)[0] == pytest.approx((hotter - of_start) / 1e-6, rel=1e-5)
    under = dataclasses.replace(start, attitude="ensemble")
    held = dataclasses.replace(scene, start=under, effects=(rm.Gravity(9.81), *scene.effects))
    assert "drawn by rejection" in scores_of_model(held.model)[names[0]][1]
    cold = dataclasses.replace(scene, start=rm.Start(momentum=rm.GibbsMomentum(0.0)))
    assert scores_of_model(cold.model)[names[0]][1] == "is 0: nothing is drawn"
    result = rm.simulate(scene, **{**run, "members": 4}, save=("omega", "noise_score"))
    lacking = result.drop_vars("kT_score")
    with pytest.raises(OptionError, match="run it with --save noise_score"):
        rm.gradient.of(lacking, "p(energy_drift_max > 1)", names[1])


BATHED = rm.Scene(
    rm.Body((1.0, 1.5, 2.0), mass=1.0, centre=(0.0, 0.0, 0.1)),
    (rm.Gravity(9.81), rm.ViscousDamping(0.1), rm.Bath(0.8, 0.5)),
    rm.Start(omega=(0.0, 0.0, 1.0)),
)  # fmt: skip


@pytest.mark.parametrize(
    ("effects", "name", "words"),
    [
        ({}, "effects.gravity.g", "effects.gravity.g also moves the attitude in a step"),
        ({}, "body.moments.1", "body.moments.1 also moves the attitude"),
        ({}, "start.omega.1", "start.omega.1 also moves the attitude"),
        ({}, "effects.viscous_damping.rate", "by effects.bath.gamma and effects.bath.kT alone$"),
        ({2: rm.Bath(0.8, 0.0)}, "effects.bath.gamma", "no noise at kT = 0"),
    ],
)
def test_parameters_without_a_score_of_the_noise(effects, name, words):
    changed = tuple(effects.get(i, one) for i, one in enumerate(BATHED.effects))
    scene = dataclasses.replace(BATHED, effects=changed)
    with pytest.raises(OptionError, match=words):
        rm.gradient(scene, "p(omega_last[3] >= 1)", name, integrator="strang", t_end=1.0)


def test_scores_of_noise_need_a_bath_and_equal_steps():
    run = {"integrator": "strang", "t_end": 1.0, "dt": 0.1, "members": 2, "save": "noise_score"}
    with pytest.raises(SceneError, match="needs the noise of a bath"):
        rm.simulate(DISC, **run)
    with pytest.raises(SceneError, match="not available with work"):
        rm.simulate(BATHED, **{**run, "save": ("noise_score", "work")})
    stops = dataclasses.replace(BATHED, observables=(rm.Passage(3, 0.5, stop=True),))
    with pytest.raises(SceneError, match="an event that stops"):
        rm.simulate(stops, **run)
    with pytest.raises(SceneError, match="steps of equal length"):
        rm.simulate(BATHED, **run, every=0.3141592)  # does not divide 1


@pytest.mark.slow  # pytest -m slow tests/studies/test_gradient.py: 60 s
def test_energies_of_a_disc_in_closed_form():
    """E = I omega^2/2 with omega from N(m, s^2), so that dq/dm = I omega_q for a quantile."""
    run = {"integrator": "exact", "t_end": 1.0, "members": 20_000}
    of = ["mean(energy_last)", "quantile(energy_last, 0.9)"]
    found = rm.gradient(DISC, of, NAMES, **run)
    z = stats.norm.ppf(0.9)
    at = MEAN + SD * z
    true = np.array([[MOMENT * MEAN, MOMENT * SD], [MOMENT * at, MOMENT * at * z]])
    far = (found.derivative.values - true) / (found.derivative_high - found.derivative_low).values
    assert np.abs(far).max() < 1.0  # two half-widths, 4 errors
    assert (found.method == "path").all()
    wrong = true[::-1]  # the interval excludes other numbers
    assert (np.abs(found.derivative.values - wrong) > 0.1 * true).all()
    of = ["mean(energy_last)", "p(omega_last[3] >= 1.1)"]
    found = rm.gradient(DISC, of, NAMES, method="score", **run)
    true[1] = stats.norm.pdf(-1.0) / SD
    far = (found.derivative.values - true) / (found.derivative_high - found.derivative_low).values
    assert np.abs(far).max() < 1.0
    assert (found.method == "score").all()


@pytest.mark.slow
def test_the_energy_of_a_heavy_top_by_gravity():
    """Energy is conserved: dE/dg = m z of the centre at the start, for every member."""
    scene = rm.Scene.load("heavy_top")
    run = {"integrator": "rk8", "dt": 1e-3, "t_end": 2.0, "members": 200}
    found = rm.gradient(scene, "mean(energy_last)", "effects.gravity.g", **run)
    true = scene.body.mass * 0.04 * math.cos(0.4)
    assert float(found.derivative.squeeze()) == pytest.approx(true, rel=1e-9)


@pytest.mark.slow
def test_the_likelihood_ratio_agrees_with_differences_of_large_ensembles():
    """The probability that a top beside its intermediate axis flips within 4 s, by the width of the
    distribution of its start: against two ensembles with the widths s (1 +- 0.1)."""
    body, of = rm.Body((1.0, 2.0, 3.0)), "p(flips >= 1)"
    run = {"integrator": "rk4", "dt": 0.05, "t_end": 4.0, "members": 200_000}

    def scene(width):
        omega = rm.normal(0.0, width), 2.0, rm.normal(0.0, 0.05)
        return rm.Scene(body, start=rm.Start(omega=omega))

    ends = []
    for width in (0.045, 0.055):
        flips = rm.simulate(scene(width), save=("flips",), **run).flips.values
        ends.append(probability((flips >= 1).sum(), flips.size))
    slope = (ends[1].value - ends[0].value) / 0.01
    error = math.hypot(ends[0].half, ends[1].half) / 0.01
    found = rm.gradient(scene(0.05), of, "start.omega.1.standard_deviation", **run)
    value, low = (float(found[key].squeeze()) for key in ("derivative", "derivative_low"))
    assert abs(value - slope) < 2.0 * math.hypot(error, value - low)
    assert abs(value) > 5.0 * (value - low)  # a derivative of 0 would be told apart


@pytest.mark.slow
def test_chaos_is_told_in_words():
    """A driven pendulum without damping has a Lyapunov exponent of 0.19/s."""
    scene = rm.Scene.load("driven_pendulum")
    scene = dataclasses.replace(scene, effects=scene.effects[:2])
    ask = ("mean(omega_last[1])", "start.omega.1")
    found = {t: rm.gradient(scene, *ask, t_end=t, members=300) for t in (5.0, 50.0, 400.0)}
    words = {t: "\n".join(STUDY.table(one)) for t, one in found.items()}
    assert "useless" not in words[5.0]
    assert "doubtful" in words[50.0]
    assert "useless: the motion is chaotic" in words[400.0]
    assert float(found[400.0].growth.squeeze()) / 400.0 == pytest.approx(0.195, rel=0.1)
