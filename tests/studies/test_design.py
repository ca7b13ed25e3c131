"""Designs of measurements, beside closed forms, SciPy, brute force, and beside fits themselves."""

import numpy as np
import pytest
from scipy import stats

import rigidmc as rm
from bench import fits
from bench.fit_peers import END, MOMENTS, NOISE, OMEGA, rates
from rigidmc.errors import OptionError, SceneError
from rigidmc.studies.design.information import make_pairs, problem_of, read_sensors
from rigidmc.studies.design.study import table as lines_of
from rigidmc.studies.fit.setup import make_problem, records_of
from rigidmc.studies.fit.solve import minimise
from rigidmc.studies.propagate.covariance import at_means
from tests.studies.test_fit import scipy_fit
from tests.tools.commands import invoke

FREE = "body.moments,start.omega"
RATIO = "body.moments.1/body.moments.3"
TOP = rm.Scene(rm.Body((1.0, 1.0, 1.6)), start=rm.Start(omega=(0.7, -0.4, 2.0)))


def deviation(study, quantity=None):
    """Return the deviations of the first start: (sensors, durations)."""
    return study.deviation.sel(quantity=quantity or study.attrs["of"]).values[0]


def test_the_bound_of_a_symmetric_body_is_the_closed_form():
    """omega_1 + i omega_2 = (a + i b) exp(i k w t), k = (I_3 - I_1)/I_1, and omega_3 = w."""
    a, b, w, k = 0.7, -0.4, 2.0, 0.6
    t = np.arange(0.0, 3.0 + 1e-9, 0.02)
    turn = np.exp(1j * k * w * t)
    of_plane = np.stack([turn, 1j * turn, 1j * k * t * (a + 1j * b) * turn])
    slopes = np.concatenate([of_plane.real, of_plane.imag, np.outer([0, 0, 1], t**0)], axis=1)
    expected = np.sqrt(np.diag(np.linalg.inv(slopes @ slopes.T / 0.01**2)))
    study = rm.design(TOP, "start.omega", "omega=0.01@50", [3.0], "start.omega.3")
    found = study.deviation.values[:, 0, 0, 0]
    np.testing.assert_allclose(found, expected, rtol=1e-10)  # measured 3e-13
    np.testing.assert_array_equal(found, study.deviation_low.values[:, 0, 0, 0])


def test_the_bound_of_ratios_is_that_of_scipy():
    scene = rm.Scene(rm.Body(tuple(MOMENTS)), start=rm.Start(omega=tuple(OMEGA)))
    study = rm.design(scene, FREE, f"omega={NOISE}@100", [1.0, END], RATIO)
    t = np.arange(0.0, END + 1e-9, 0.01)
    _, covariance = scipy_fit(t, rates(MOMENTS[:2], OMEGA, t))
    expected = NOISE * np.sqrt(np.diag(covariance))
    names = [RATIO, "body.moments.2/body.moments.3", *(f"start.omega.{i}" for i in (1, 2, 3))]
    found = study.deviation.sel(quantity=names).values[:, 0, 0, 1]
    np.testing.assert_allclose(found, expected, rtol=1e-6)  # measured 5e-8
    assert np.isinf(study.deviation.sel(quantity="body.moments.1")).all()
    assert "before" not in study.attrs


def test_deviations_fall_with_rate_and_duration():
    sensors, times = ["omega=0.01@10", "omega=0.01@40", "omega=0.03@10"], [80.0, 160.0, 320.0]
    study = rm.design(TOP, FREE, sensors, times, RATIO)
    found = deviation(study)
    np.testing.assert_allclose(found[0] / found[1], 2.0, rtol=2e-3)  # measured 5e-4: ends
    np.testing.assert_allclose(found[2] / found[0], 3.0, rtol=1e-8)  # measured 8e-11
    # a frequency, here k w, is a phase over the time
    study = rm.design(TOP, "start.omega", sensors[0], times, "start.omega.3")
    found = deviation(study)[0]
    np.testing.assert_allclose(found[:-1] / found[1:], 2.0**1.5, rtol=6e-3)  # measured 4e-3


def information(text):
    (sensors,) = read_sensors(text, "sensor").values()
    problem = problem_of(TOP, sensors, 2.0, FREE.split(","), (), 1)
    return problem.sums(problem.parameters.coordinates({})[None]).matrix[0]


def test_information_of_sensors_adds():
    rates_alone, attitudes = information("omega=0.01@50"), information("attitude=0.002@10")
    both = information("omega=0.01@50+attitude=0.002@10")
    np.testing.assert_allclose(both, rates_alone + attitudes, atol=1e-12 * both.max())


def test_sensors_are_read():
    text = "omega=0.1 deg/s@1.16e-5+attitude = .01 @ 2e+1"
    assert read_sensors([text, "energy=1e-3@3."], "sensor") == {
        text: {"omega": ("0.1 deg/s", 1.16e-5), "attitude": (".01", 20.0)},
        "energy=1e-3@3.": {"energy": ("1e-3", 3.0)},
    }


def test_a_bias_widens_and_belongs_to_its_own_sensor():
    sensors = ["omega=0.01@50", "attitude=0.002@10"]
    body = rm.Scene(rm.Body((1.0, 2.0, 2.5)), start=rm.Start(omega=(0.5, 2.0, 0.4)))
    plain = rm.design(body, FREE, sensors, [5.0], RATIO)
    biased = rm.design(body, FREE, sensors, [5.0], RATIO, nuisances="omega.bias")
    ratio = deviation(biased)[:, 0] / deviation(plain)[:, 0]
    assert 2.0 < ratio[0] < 10.0 and ratio[1] == 1.0  # measured 4.3


def test_a_spin_about_a_principal_axis_shows_nothing_of_the_body():
    body = rm.Scene(rm.Body((1.0, 2.0, 2.5)), start=rm.Start(omega=(0.0, 0.0, 2.0)))
    starts = ["start.omega=[0.5, 2, 0.4]", "start.omega=[0,0,2]"]
    study = rm.design(body, FREE, "omega=0.01@50", [2.0], RATIO, starts)
    tumbling, steady = study.deviation.sel(quantity=RATIO).values[:, 0, 0]
    assert tumbling < 0.02 and np.isinf(steady)
    texts = study.unseen.values[:, 0, 0]
    assert "only ratios of the principal moments" in texts[0]
    assert all(f"do not show body.moments.{i}" in texts[1] for i in (1, 2, 3))
    lines = lines_of(study)
    assert lines[3].endswith("not shown") and lines[4].startswith("  best: ")
    assert "only ratios" in lines[5]
    lines = lines_of(study.isel(start=[1]))
    assert lines[3] == "  no measurement shows it"
    study = rm.design(body, FREE, "omega=0.01@50", [2.0], RATIO)
    assert not any("--start" in line for line in lines) and "by --start" in lines_of(study)[3]
    assert sum("the data do not show body.moments" in line for line in lines) == 3


def test_steps_follow_a_rotor_and_a_start_at_rest():
    """A rotor nutates faster than the rates say, and a pendulum falls from rest."""
    body = rm.Body((0.0702, 0.1391, 0.1902))
    wheel = rm.Scene(body, rm.Rotor((0.0, 0.2, 0.0)), rm.Start(omega=(0.02, 0.05, -0.03)))
    (each,) = read_sensors("omega=0.002@1", "sensor").values()
    found = problem_of(wheel, each, 100.0, FREE.split(","), (), 1)
    assert found.run.scene.run.every < 1.1  # the rates alone give 4 s, and flagged motions
    study = rm.design(wheel, FREE, "omega=0.002@1", [100.0], "body.moments.1")
    names = study["quantity"].values[:6]
    run = {"dt": 0.05, "every": 1.0, "t_end": 100.0, "members": 1, "save": "omega"}
    slopes = rm.simulate(wheel, "rk8", wrt=tuple(names), **run).d_omega.values.reshape(6, -1)
    expected = 0.002 * np.sqrt(np.diag(np.linalg.inv(slopes @ slopes.T)))
    np.testing.assert_allclose(
        study.deviation.values[:6, 0, 0, 0], expected, rtol=1e-5
    )  # measured 1e-6
    pendulum = rm.Scene(
        rm.Body.from_moments((0.02, 0.02, 0.001), mass=1.0, centre=(0.0, 0.0, -0.1)),
        rm.Gravity(9.81), rm.Start(omega=(0.0, 0.0, 0.0), attitude=(0.96, 0.28, 0.0, 0.0)),
    )  # fmt: skip
    study = rm.design(
        pendulum, "effects.gravity.g", "attitude=0.01@50", [1.0, 2.0, 4.0], "effects.gravity.g"
    )
    free = "effects.gravity.g,start.attitude"
    turned = rm.design(pendulum, free, "omega=0.1@50", [1.0], "effects.gravity.g")
    # about the vertical, by two numbers that are 0
    assert "start.attitude.3 +0.00" in turned.unseen.item()
    found = deviation(study)[0]
    assert (found[:-1] / found[1:] > 2.0).all() and found[-1] < 0.05


def accelerated(spin, torque):
    """Return a disc whose omega_3 is spin + torque t/2."""
    body, start = rm.Body((1.0, 1.0, 2.0)), rm.Start(omega=(0.0, 0.0, spin))
    scene = rm.Scene(body, rm.BodyTorque((0.0, 0.0, torque)), start=start)
    return scene.with_run(integrator="rk4", dt=0.05, t_end=4.0, every=4.0)


LINEAR = accelerated(rm.normal(1.0, 0.3), rm.normal(0.5, 0.2))
TOGETHER = accelerated(rm.common(1.0, 0.3), rm.common(0.5, -0.1, 0.15))
PUSHED, LAST = "start.omega,effects.body_torque.size", "mean(omega_last[3])"


@pytest.mark.parametrize(("scene", "of", "nuisances"), [
    (LINEAR, LAST, ""), (LINEAR, LAST, "bias"), (LINEAR, "p(omega_last[3] >= 2.3)", ""),
    (TOGETHER, LAST, ""), (TOGETHER, "p(omega_last[3] >= 2.3)", "bias"),
])  # fmt: skip
def test_what_is_left_of_a_linear_motion_is_the_closed_form(scene, of, nuisances):
    """omega_3 = w + N t/I_3, with normal w and N, at 4 s."""
    study = rm.design(
        scene, PUSHED, "omega=0.3@10", [0.5, 4.0], of, nuisances=nuisances, pairs=4000
    )
    prior = np.diag([0.09, 0.04]) if scene is LINEAR else np.array([[0.09, -0.03], [-0.03, 0.0325]])
    h = np.array([1.0, 2.0])
    all_of_it = h @ prior @ h
    threshold = (2.3 - 2.0) / np.sqrt(all_of_it)
    for k, time in enumerate((0.5, 4.0)):
        t = np.arange(0.0, time + 1e-9, 0.1)
        slopes = np.stack([np.ones_like(t), 0.5 * t]) / 0.3
        information = slopes @ slopes.T
        if nuisances:  # of the mean of the readings
            apart = slopes.sum(1) * 0.3
            information -= np.outer(apart, apart) / (t.size * 0.3**2)
        variance = h @ np.linalg.inv(np.linalg.inv(prior) + information) @ h
        if of[0] == "p":
            alike = 1.0 - variance / all_of_it
            both = stats.multivariate_normal(cov=[[1.0, alike], [alike, 1.0]])
            variance = stats.norm.sf(threshold) - both.cdf([-threshold, -threshold])
        ends = (
            study[f"deviation_{end}"].sel(quantity=of).values[0, 0, k] for end in ("low", "high")
        )
        low, high = ends
        half = 0.5 * (high - low)  # of 95 %, so twice: measured off by 1.0 of it at most
        assert low - half < np.sqrt(variance) < high + half
        assert half < 0.05 * np.sqrt(variance) * (2.0 if of[0] == "p" else 1.0)
    share = stats.norm.sf(threshold)
    before = np.sqrt(all_of_it if of[0] == "m" else share * (1.0 - share))
    assert study.attrs["before"] == pytest.approx(before, rel=0.03)  # measured .01


@pytest.mark.parametrize("nuisances", [(), ("bias",)])
def test_the_mean_of_partners_is_that_of_the_posterior(nuisances):
    """Without its random part, z' = (1 - (1 + L^T F L)^-1) z."""
    mean, (sensors,) = at_means(TOGETHER), read_sensors("omega=0.8@10", "sensor").values()
    pairs = make_pairs(LAST, TOGETHER, mean, 20)
    problem = problem_of(mean, sensors, 2.0, PUSHED.split(","), nuisances, 1)
    t = np.arange(0.0, 2.0 + 1e-9, 0.1)
    of = {"start.omega.3": np.ones_like(t), "effects.body_torque.size.3": 0.5 * t}
    slopes = np.stack([of[name] for name in pairs.names]) / 0.8
    if nuisances:
        slopes -= slopes.mean(1, keepdims=True)
    information = pairs.factor.T @ slopes @ slopes.T @ pairs.factor
    known = np.eye(2) - np.linalg.inv(np.eye(2) + information)
    found = pairs._replace(e=np.zeros_like(pairs.e)).partners(problem)
    np.testing.assert_allclose(found, pairs.z @ known, rtol=1e-10)  # measured 1e-13
    # and with it, they spread like all members
    many = make_pairs(LAST, TOGETHER, mean, 4000)
    spread = np.cov(many.partners(problem).T)
    np.testing.assert_allclose(spread, np.eye(2), atol=0.08)  # measured .03, of 4,000


def uncertain_body():
    """Return a body whose size is known to 10 %, and its ratios to 2 %."""
    mean = np.array([1.0, 2.0, 2.5])
    spread = np.diag([0.02, 0.04, 0.05]) ** 2 + 0.01 * np.outer(mean, mean)
    body = rm.Body(rm.Correlated(tuple(mean), tuple(map(tuple, spread))))
    scene = rm.Scene(body, start=rm.Start(omega=(0.5, 2.0, 0.4)))
    return scene.with_run(integrator="rk8", dt=0.02, t_end=6.0, every=6.0)


def test_partners_have_moments_by_the_derivatives_of_a_run():
    scene = uncertain_body()
    mean, (sensors,) = at_means(scene), read_sensors("omega=0.05@20", "sensor").values()
    pairs = make_pairs("mean(omega_last[1])", scene, mean, 20)
    problem = problem_of(mean, sensors, 2.0, FREE.split(","), (), 1)
    near = pairs._replace(z=1e-6 * pairs.z, e=np.zeros_like(pairs.e))  # one information for all
    names = [*pairs.names, *(f"start.omega.{i}" for i in (1, 2, 3))]
    run = {"dt": 0.01, "every": 0.05, "t_end": 2.0, "members": 1, "save": "omega"}
    slopes = rm.simulate(mean, "rk8", wrt=tuple(names), **run).d_omega.values.reshape(6, -1) / 0.05
    whole = slopes @ slopes.T
    whole = whole[:3, :3] - whole[:3, 3:] @ np.linalg.inv(whole[3:, 3:]) @ whole[3:, :3]
    known = np.eye(3) - np.linalg.inv(np.eye(3) + pairs.factor.T @ whole @ pairs.factor)
    assert 0.1 < np.linalg.eigvalsh(known)[-1] < 0.99
    found = near.partners(problem)
    largest = np.abs(found).max()
    np.testing.assert_allclose(found, near.z @ known, 0.0, 2e-6 * largest)  # measured 3e-7


def test_a_perfect_sensor_leaves_nothing_and_a_useless_one_everything():
    """Rates hide the size of the moments, on which no rate depends."""
    scene = uncertain_body()
    of, sensors = "mean(omega_last[1])", ["omega=1e-7@20", "omega=1e4@20"]
    study = rm.design(scene, FREE, sensors, [2.0], of)
    perfect, useless = deviation(study)[:, 0]
    members = rm.simulate(scene, members=20000, save="omega").omega.sel(axis=1).isel(time=-1)
    assert perfect < 1e-5  # measured 2.8e-6
    assert useless == pytest.approx(float(members.std()), rel=0.07)  # measured .014 of .781
    assert "only ratios" in study.unseen.values[0, 0, 0]


def test_what_is_left_of_a_flip_is_that_of_brute_force():
    """Data are simulated from members, and all members weighed by their likelihood."""
    start = rm.Start(omega=(rm.normal(0.0, 0.05), rm.normal(6.0, 0.1), rm.normal(0.0, 0.05)))
    scene = rm.Scene(rm.Body((0.00121, 0.01638, 0.01748)), start=start)
    scene = scene.with_run(integrator="rk4", dt=0.005, t_end=1.2, seed=3, members=10000)
    of, sigma = "p(flips >= 1)", 0.1
    study = rm.design(scene, "start.omega", f"omega={sigma}@20", [0.25, 0.5], of, pairs=4000)
    ds = rm.simulate(scene, save=("omega", "flips"), every=0.05, keep="full")
    omega = ds.omega.transpose("member", "time", "axis").values
    flips = (ds.flips.values >= 1).astype(float)
    random = np.random.default_rng(5)
    for k, readings in enumerate((6, 11)):
        motions = omega[:, :readings].reshape(len(omega), -1) / sigma
        left = []
        for j in range(300):
            data = motions[j] + random.normal(size=motions.shape[1])
            fit = -0.5 * ((motions - data) ** 2).sum(1)
            fit[j] = -np.inf  # the member that made the data would explain them too well
            weight = np.exp(fit - fit.max())
            share = weight @ flips / weight.sum()
            left.append(share * (1.0 - share))
        expected, error = np.mean(left), np.std(left) / np.sqrt(len(left))
        found = study.deviation.sel(quantity=of).values[0, 0, k] ** 2
        own = np.diff(
            [study[f"deviation_{e}"].sel(quantity=of).values[0, 0, k] ** 2 for e in ("low", "high")]
        )
        # measured off by .2 and 1.6 of it
        assert abs(found - expected) < 3.0 * np.hypot(error, own.item() / 3.92)
    assert study.attrs["before"] == pytest.approx(0.49, abs=0.01)


def test_another_throw_teaches_about_the_body_alone():
    """Its own start is another one than that of the members; a noiseless sensor leaves this."""
    scene, of = accelerated(rm.normal(1.0, 0.3), rm.normal(0.5, 0.01)), LAST
    ways = [], ["start.omega=[0, 0, 5]"]
    own, other = (
        rm.design(scene, PUSHED, "omega=1e-6@10", [1.0], of, start, pairs=2000) for start in ways
    )
    assert deviation(own)[0, 0] < 1e-5
    low, high = (other[f"deviation_{e}"].sel(quantity=of).item() for e in ("low", "high"))
    assert low < 0.3 < high and high - low < 0.02  # the spin that each member starts with


@pytest.mark.parametrize(("change", "rule"), [
    ({"sensor": "omega"}, "expected OBSERVABLE=NOISE@RATE"),
    ({"sensor": "omega=0.1@-3"}, "expected OBSERVABLE=NOISE@RATE"),
    ({"sensor": "omga=0.1@10"}, "did you mean 'omega'"),
    ({"sensor": "omega=zero@10"}, "expected OBSERVABLE=NUMBER above 0"),
    ({"sensor": "omega=0.1@0.1"}, "makes no second reading in 2 s"),
    ({"duration": "0"}, "expected times above 0"),
    ({"duration": ""}, "expected numbers|expected times"),
    ({"of": "body.moment.1"}, "did you mean 'body.moments.1'"),
    ({"of": "quantile(omega_last[3], 0.5)"}, "is not a mean over members"),
    ({"of": LAST, "free": "body.moments"}, "is random, but a record"),
    ({"start": "body.moments=[1, 2, 3]"}, "expected a setting of the start"),
    ({"start": "start.omega=[0, 1]"}, "start"),
    ({"nuisances": "attitude.bias"}, "did you mean|no such observable"),
    ({"nuisances": "jitter"}, "only readings show its size"),
    ({"nuisances": "bia"}, "did you mean 'bias'"),
    ({"free": "body.moments.1"}, "fit body.moments"),
])  # fmt: skip
def test_what_cannot_be_designed_is_refused(change, rule):
    asked = {"free": FREE, "sensor": "omega=0.1@10", "duration": "1,2", "of": RATIO, **change}
    with pytest.raises((OptionError, SceneError), match=rule):
        rm.design("tennis_racket", **asked)
    words = [word for key, value in asked.items() for word in (f"--{key}", value)]
    assert invoke("design", "tennis_racket", *words).exit_code == 3


def test_priors_other_than_normal_and_noise_are_refused():
    free, of = "start.omega", LAST
    uniform = rm.Scene(LINEAR.body, start=rm.Start(omega=(0.0, 0.0, rm.uniform(0.0, 1.0))))
    with pytest.raises(SceneError, match="needs a normal distribution"):
        rm.design(uniform, free, "omega=0.1@10", [1.0], of)
    assert np.isfinite(deviation(rm.design(uniform, free, "omega=0.1@10", [1.0], "start.omega.3")))
    certain = rm.Scene(LINEAR.body, start=rm.Start(omega=(0.0, 0.0, 1.0)))
    with pytest.raises(SceneError, match="draws nothing that the measurement shows"):
        rm.design(certain, free, "omega=0.1@10", [1.0], of)
    with pytest.raises(SceneError, match="noise separates any two motions"):
        rm.design("brownian_rotor", free, "omega=0.1@10", [1.0], "start.omega.3")
    turned = rm.Scene(LINEAR.body, start=rm.Start(omega=(0.0, 0.0, 1.0), attitude="uniform"))
    with pytest.raises(SceneError, match="without a mean"):
        rm.design(turned, free, "omega=0.1@10", [1.0], "start.omega.3")


def test_the_table_names_the_shortest_duration_that_suffices():
    sensors = ["omega=0.02@100", "omega=0.002@100"]
    start = "start.omega=[0.1, 6, 0.1]"
    study = rm.design("tennis_racket", FREE, sensors, "4,1,2", RATIO, start, reach=2e-3)
    found, lines = deviation(study), lines_of(study)
    np.testing.assert_array_equal(study.duration, [1.0, 2.0, 4.0])
    way = "omega=0.002@100"
    assert (found[1] <= 2e-3).argmax() == 1 and found[0].min() > found[1].min()
    assert f"  0.002 is reached first by {way}, in 2 s" in lines
    assert any(line.startswith(f"  best: {found[1, 2]:.2g} by {way}, in 4 s") for line in lines)
    study.deviation.values[:, 0, 1, 2] = np.nan  # of a measure that no member has
    assert any(line.startswith(f"  best: {found[1, 1]:.2g}") for line in lines_of(study))
    study.attrs["reach"] = 1e-9
    assert "  none reaches 1e-09: measure longer, or with less noise" in lines_of(study)


@pytest.mark.slow
def test_fits_scatter_as_predicted():
    """100 records: their mean squared distance from the truth, in the predicted covariance."""
    t = np.arange(0.0, 2.0 + 1e-9, 0.01)
    true = rates(MOMENTS[:2], OMEGA, t)
    scene = rm.Scene(rm.Body(tuple(MOMENTS)), start=rm.Start(omega=tuple(OMEGA)))
    study = rm.design(scene, FREE, f"omega={NOISE}@100", [2.0], RATIO, nuisances="bias")
    names = [RATIO, "body.moments.2/body.moments.3", *(f"start.omega.{i}" for i in (1, 2, 3))]
    off = []
    for seed in range(100):
        read = true + NOISE * np.random.default_rng(seed).normal(size=true.shape)
        records = records_of(scene, fits.table_of(t, read), {}, None, None, ())
        problem = make_problem(
            scene, ["body.moments", "start.omega"], (), records, {"omega": NOISE}, ["bias"], 1
        )
        solution = minimise(problem, problem.parameters.coordinates({})[None])
        x = problem.parameters.values(solution.x[0])
        off.append([x[0] / x[2] - MOMENTS[0], x[1] / x[2] - MOMENTS[1], *(x[3:6] - OMEGA)])
    predicted = study.deviation.sel(quantity=names).values[:, 0, 0, 0]
    ratio = np.sqrt(np.mean(np.square(off), axis=0)) / predicted
    np.testing.assert_allclose(ratio, 1.0, atol=0.2)  # measured .10 at most; of 100: 7 % each
