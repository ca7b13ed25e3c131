"""Posteriors of fits beside closed forms, integrals on grids, and simulated truths."""

import sys

import numpy as np
import pytest
import xarray as xr
from scipy import stats

import rigidmc as rm
from bench import fits
from rigidmc.errors import OptionError
from rigidmc.studies.fit.draws import draw, groups_of
from rigidmc.studies.fit.posterior import SAMPLERS, Density, climb, package
from rigidmc.studies.fit.prior import Prior
from rigidmc.studies.fit.records import read_columns_option
from rigidmc.studies.fit.setup import make_problem, records_of
from rigidmc.studies.fit.table import table as lines_of
from rigidmc.studies.fit.uncertainty import ModelError
from rigidmc.studies.fit.visible import seen
from tests.tools.commands import invoke

BALL = rm.Scene(rm.Body((1.0, 1.0, 1.0)), start=rm.Start(omega=(1.0, 2.0, 3.0)))
RATE = "effects.viscous_damping.rate"
SLOWED = rm.Scene(rm.Body((1.0, 1.0, 1.0)), rm.ViscousDamping(0.1), start=BALL.start)
WORDS = {"trials": 2, "noise": {"omega": 0.1}}
WHITE = ModelError(1.0, 0.0, 0.1, 0.0)
LASTING = ModelError(0.7, 1.9, 0.06, 9.0)


def readings(t, omega, noise=0.1, seed=0):
    return fits.table_of(t, omega + noise * np.random.default_rng(seed).normal(size=(t.size, 3)))


def of_rates(table):
    return np.stack([table[f"omega[{k + 1}]"] for k in range(3)], axis=1)


def problem_of(scene, table, free, noise=0.1, own=(), split=None):
    records = records_of(scene, table, {}, None, split, ())
    return make_problem(scene, free, own, records, {"omega": noise}, (), 1)


def prior_of(problem, x, pooled=()):
    shown = seen(problem.sums(x[None]).matrix[0], problem.parameters.slopes(x))
    return Prior(problem.parameters, x, shown, pooled)


def drawn_of(study, name):
    return study.drawn.sel(quantity=name).values.ravel()


@pytest.fixture(scope="module")
def still():
    """Readings of a ball whose rates are constant, and their posterior by emcee."""
    t = np.arange(0.0, 1.0, 0.05)
    table = readings(t, np.tile([1.0, 2.0, 3.0], (t.size, 1)))
    return table, rm.fit(BALL, table, "start.omega", posterior="emcee", **WORDS)


def closed_form(table):
    """Return (mean, standard deviation) of the constant rates of a ball; noise from residuals."""
    omega = of_rates(table)
    left = omega - omega.mean(0)
    return omega.mean(0), np.sqrt(np.sum(left**2) / (left.size - 3) / len(left))


@pytest.mark.parametrize("sampler", ["emcee", "nuts"])
def test_a_linear_problem_has_the_normal_posterior(still, sampler):
    table, study = still
    if sampler == "nuts":
        words = {"posterior": "nuts", "chains": 2, "draws": 600}
        study = rm.fit(BALL, table, "start.omega", **words, **WORDS)
    mean, deviation = closed_form(table)
    assert study.attrs["converged"] == 1, (study.r_hat, study.effective)
    for k in range(3):
        z = (drawn_of(study, f"start.omega.{k + 1}") - mean[k]) / deviation
        # standard errors of 2,000 draws: .02 and .03; measured .03, .03, .02
        assert abs(z.mean()) < 0.08 and abs(z.std() - 1.0) < 0.08
        assert abs(np.mean(z < 1.0) - stats.norm.cdf(1.0)) < 0.04


def test_the_same_seed_has_the_same_draws(still):
    table, study = still
    words = {"posterior": "emcee", **WORDS}
    again = rm.fit(BALL, table, "start.omega", **words)
    np.testing.assert_array_equal(again.drawn, study.drawn)
    other = rm.fit(BALL.with_run(seed=5), table, "start.omega", **words)
    assert not np.array_equal(other.drawn, study.drawn)
    one, two = (
        rm.fit(BALL, table, "start.omega", posterior="nuts", draws=20, trials=2) for _ in range(2)
    )
    np.testing.assert_array_equal(one.drawn, two.drawn)


def test_a_limit_is_respected_as_on_a_grid():
    """Damping near 0: the posterior is that of an integral over the rate, half of it cut off."""
    t = np.arange(0.0, 1.0, 0.05)
    table = readings(t, np.tile([1.0, 2.0, 3.0], (t.size, 1)), seed=3)
    study = rm.fit(SLOWED, table, f"start.omega,{RATE}", posterior="emcee", **WORDS)
    assert study.attrs["converged"] == 1
    omega, v = of_rates(table), study.attrs["white"] * 0.1**2
    # with a rate k, each start is normal: its integral is closed, and the rest is a sum over k
    k = np.linspace(0.0, 0.3, 3001)
    shape = np.exp(-k[:, None] * t)
    size = (shape**2).sum(1)
    best = shape @ omega / size[:, None]
    cost = np.sum((omega - shape[:, :, None] * best[:, None]) ** 2, axis=(1, 2))
    weight = np.exp(-0.5 * (cost - cost.min()) / v) * size**-1.5
    weight /= weight.sum()
    drawn = drawn_of(study, RATE)
    assert drawn.min() > 0.0 and weight[0] > 0.3 * weight.max()  # the limit cuts the posterior
    for level in (0.1, 0.3, 0.5, 0.7, 0.9):
        assert np.mean(drawn < np.interp(level, weight.cumsum(), k)) == pytest.approx(
            level, abs=0.04
        )
    start = drawn_of(study, "start.omega.3")
    mean = weight @ best[:, 2]
    deviation = np.sqrt(weight @ (v / size + (best[:, 2] - mean) ** 2))
    assert abs(start.mean() - mean) < 0.08 * deviation
    assert start.std() == pytest.approx(deviation, rel=0.08)


def test_a_ridge_along_a_limit_is_filled_as_on_a_grid():
    """Moments near those of a plate: ln J of the least is far from normal, and bends the ridge."""
    scene, table = fits.free_body(np.random.default_rng([24, 7]))[1:]
    words = {"posterior": "emcee", "chains": 2, "trials": 8, "noise": {"omega": 0.2}}
    study = rm.fit(scene, table, "body.moments", **words)
    # by stretches of ln J: 269 effective
    assert study.attrs["converged"] == 1 and study.effective.min() > 1000  # measured 1,655
    drawn = study.drawn.values.reshape(-1, 5)
    problem = problem_of(scene, table, ("body.moments",), noise=0.2).still()
    # I2 has a straight line over I1: shares of the moments on a grid along it
    one, two = 1.0 - drawn[:, 0], 1.0 - drawn[:, 1]
    slope, middle = np.polyfit(one, two, 1)
    off = two - slope * one - middle
    a, b = np.meshgrid(
        np.linspace(0.0, 0.02, 402)[1:-1], 1.5 * np.abs(off).max() * np.linspace(-1, 1, 101)
    )
    share = np.stack([a, middle + slope * a + b, 1.0 - a - middle - slope * a - b], axis=-1)
    rows = [problem.residuals_of(np.log(each)) for each in share]
    cost = np.stack([(row**2).sum(1) for row in rows])
    weight = np.exp(-0.5 * (cost - cost.min()) / study.attrs["white"]).sum(0)
    weight /= weight.sum()
    assert weight[0] > 0.05 * weight.max() and weight[-1] < 1e-3 * weight.max()
    for level in (0.05, 0.1, 0.3, 0.5, 0.7, 0.9):
        x = np.interp(level, weight.cumsum() - 0.5 * weight, a[0])
        # standard error .016, from eight seeds; measured .030
        assert np.mean(one < x) == pytest.approx(level, abs=0.05)


@pytest.fixture(scope="module")
def two_records():
    """Two records of a damped ball, of different lengths and with a gap."""
    t = np.concatenate([np.arange(0.0, 0.6, 0.04), np.arange(0.0, 0.5, 0.05)])
    table = readings(t, np.exp(-0.1 * t)[:, None] * np.array([1.0, 2.0, 3.0]))
    table["toss"] = np.repeat([0, 1], [15, 10])
    table["omega[2]"][[4, 5, 6]] = np.nan
    problem = problem_of(SLOWED, table, ("start.omega", RATE), own=(RATE,), split="toss")
    return problem, problem.parameters.coordinates({})


@pytest.mark.parametrize("error", [WHITE, LASTING])
def test_the_likelihood_is_that_of_the_whole_covariance(two_records, error):
    problem, x = two_records
    prior = prior_of(problem, x)
    density, z = Density(problem, error, prior), prior.inverse(x)
    t, _, noise, channel, record, _ = problem.samples_in_order()
    same = (np.array(channel)[:, None] == np.array(channel)) & (record[:, None] == record)
    covariance = error.lasting * same * np.exp(-np.abs(t[:, None] - t) / error.time)
    covariance += error.white * np.eye(t.size)
    law = stats.multivariate_normal(cov=covariance)
    both = np.stack([z, z + 0.02])
    some, of_prior = prior.of(both)
    residuals, jacobian = problem.jacobian(some[0])
    stated = law.logpdf(problem.jacobian(some[1])[0]) - law.logpdf(residuals)
    found = density(both) - of_prior
    assert found[1] - found[0] == pytest.approx(stated, rel=1e-9)
    (value, _), (gradient, _) = density.slopes(both)
    assert value == pytest.approx(density(both)[0], rel=1e-12)
    slopes, more = prior.slopes(z)
    stated = more - slopes.T @ jacobian.T @ np.linalg.solve(covariance, residuals)
    np.testing.assert_allclose(gradient, stated, rtol=1e-8, atol=1e-8)
    whole = density.of_records(both)[0]
    assert whole.shape == (2,)
    assert whole.sum() == pytest.approx(law.logpdf(residuals) - np.log(noise).sum(), rel=1e-10)


@pytest.mark.parametrize("error", [WHITE, LASTING])
def test_a_flagged_motion_has_no_density(two_records, error):
    """A member that is flagged saves its last good state: its residuals were as good as any."""
    problem, x = two_records
    prior = prior_of(problem, x)
    density, z = Density(problem, error, prior), prior.inverse(x)
    z[problem.parameters.places_of(RATE)[1]] = 700.0  # a rate of 1e304
    assert density(z[None])[0] == -np.inf
    (value,), (gradient,) = density.slopes(z[None])
    assert value == -np.inf and not gradient.any()


@pytest.mark.parametrize("error", [WHITE, LASTING])
def test_a_climb_ends_at_the_maximum_of_a_flat_body(error):
    """A body without thickness: the best second moment is at its limit, its logarithm is not."""
    flat = rm.Scene(rm.Body((1.0, 2.0, 3.0)), start=rm.Start(omega=(1.5, 4.0, 1.0)))
    ds = fits.moved(flat, 2.0, 0.02)
    problem = problem_of(
        flat, readings(ds.time.values, ds.omega.values[:, :, 0]), ("body.moments",)
    )
    x = problem.parameters.coordinates({"body.moments": np.array([1.0, 2.0, 3.0 - 1e-9])})
    x[2] = problem.parameters.low[2]  # where the fit ends
    density = Density(problem, error, prior_of(problem, x))
    mode = climb(density, 0, density.prior.inverse(x))
    value, gradient = density.slopes(mode.z[None])
    assert np.abs(gradient @ mode.factor).max() < 0.01
    # the second derivatives there, by differences of the gradient along each deviation
    ends = [density.slopes(mode.z + side * 1e-3 * mode.factor.T)[0] for side in (-1.0, 1.0)]
    change = (2.0 * value - ends[0] - ends[1]) / 1e-6
    np.testing.assert_allclose(change, 1.0, atol=0.25)


def test_all_shapes_of_bodies_are_equally_likely():
    """The density of z = ln J, times dz by (shares of J, ln S), is the same everywhere."""
    ds = fits.moved(fits.FREE_BODY, 2.0, 0.05)
    problem = problem_of(fits.FREE_BODY, ds, ("body.moments", "start.omega"))
    x = problem.parameters.coordinates({})
    prior = prior_of(problem, x)
    assert prior.ln_sum == pytest.approx(np.log(2.75))

    def z_of(p):
        share = np.array([p[0], p[1], 1.0 - p[0] - p[1]])
        return np.concatenate([np.log(share * np.exp(p[2])), x[3:]])

    densities = []
    for p in ([0.2, 0.3, 1.0], [0.7, 0.01, 1.0], [0.05, 0.9, 1.0]):
        steps = 1e-6 * np.eye(3)
        slope = np.stack([(z_of(p + d) - z_of(p - d))[:3] / 2e-6 for d in steps], axis=1)
        found, ln = prior.of(z_of(np.array(p))[None])
        densities.append(ln[0] + np.log(abs(np.linalg.det(slope))))
        assert np.exp(found[0, :3]).sum() == pytest.approx(2.75)  # of the size of the scene
    assert np.ptp(densities) < 1e-7  # measured 2e-10
    # the size of a draw is not that of its body: all draws with a shape have the same readings
    density = Density(problem, WHITE, prior)
    along = np.stack([x, x + [0.05, 0.05, 0.05, 0.0, 0.0, 0.0]])
    assert np.diff(density(along))[0] == pytest.approx(np.diff(prior.of(along)[1])[0], abs=1e-6)


def test_all_attitudes_are_equally_likely():
    """The length of a quaternion has a distribution of its own; its direction has none."""
    scene = fits.HEAVY
    ds = fits.moved(scene, 1.0, 0.05, ("attitude",))
    records = records_of(scene, ds, {}, None, None, ())
    records = [
        one._replace(
            times={"attitude": one.times["attitude"]}, values={"attitude": one.values["attitude"]}
        )
        for one in records
    ]
    problem = make_problem(scene, ("start.attitude",), (), records, {"attitude": 0.01}, (), 1)
    x = problem.parameters.coordinates({})
    prior = prior_of(problem, x)
    q = np.random.default_rng(1).normal(size=(5, 4))
    q /= np.linalg.norm(q, axis=1)[:, None]
    assert np.ptp(prior.of(1.2 * q)[1]) < 1e-12
    length = np.linspace(0.3, 3.0, 20001)  # times d^4q = r^3 dr: log-normal
    density = np.exp(prior.of(length[:, None] * q[0])[1]) * length**3
    density /= np.trapezoid(density, length)
    np.testing.assert_allclose(density, stats.lognorm.pdf(length, 0.1), atol=1e-9)
    along = (
        Density(problem, WHITE, prior)(np.stack([x, 1.1 * x])) - prior.of(np.stack([x, 1.1 * x]))[1]
    )
    assert along[0] == pytest.approx(along[1], abs=1e-6)


@pytest.mark.parametrize("is_centred", [True, False])
def test_a_pool_has_the_density_that_is_stated(two_records, is_centred):
    problem, x = two_records
    prior = prior_of(problem, x, (RATE,))
    (pool,) = prior.pools
    prior.pools[0] = pool = pool._replace(is_centred=np.full(2, is_centred))
    random = np.random.default_rng(2)
    first = prior.inverse(x)
    first[pool.spread] = np.log(0.3)
    np.testing.assert_allclose(prior.of(prior.inverse(x)[None])[0][0], x, rtol=1e-12)
    free = []
    for _ in range(3):
        z = first + 0.3 * random.normal(size=first.size)
        found, ln = prior.of(z[None])
        y, spread = np.log(found[0][pool.places]), np.exp(z[pool.spread])
        stated = stats.norm.logpdf(y, z[pool.mean], spread).sum()
        stated += stats.halfnorm.logpdf(spread, scale=1.0) + z[pool.spread]
        if not is_centred:
            stated += 2.0 * z[pool.spread]  # dy = t de
        free.append(ln[0] - stated)
        slopes, of_ln = prior.slopes(z)
        for k, step in enumerate(1e-6 * np.eye(z.size)):
            ends = [prior.of((z + sign * step)[None]) for sign in (1.0, -1.0)]
            np.testing.assert_allclose(slopes[:, k], (ends[0][0] - ends[1][0])[0] / 2e-6, atol=1e-7)
            assert of_ln[k] == pytest.approx((ends[0][1] - ends[1][1])[0] / 2e-6, abs=1e-6)
    assert np.ptp(free) < 1e-9  # a constant


def test_walkers_change_between_answers():
    """Energies show a rate up to its sign; rough readings of it make one sign likelier."""
    scene = rm.Scene(rm.Body((1.0, 1.0, 1.0)), start=rm.Start(omega=(1.0, 0.0, 0.0)))
    t = np.arange(0.0, 1.0, 0.05)
    table = readings(t, np.tile([0.35, 0.0, 0.0], (t.size, 1)), noise=0.0)
    energy = 0.5 + 0.02 * np.random.default_rng(4).normal(size=t.size)
    words = ("omega=omega[1],omega[2],omega[3]", "energy=energy")
    columns = read_columns_option(words, "columns")
    records = records_of(scene, table | {"energy": energy}, columns, None, None, ())
    noise = {"omega": 3.2, "energy": 0.02}
    problem = make_problem(scene, ("start.omega.1",), (), records, noise, (), 1)
    prior = prior_of(problem, np.array([1.0]))
    answers = [np.array([1.0]), np.array([-1.0])]
    study = draw(problem, WHITE, answers, prior, "emcee", 4, 1000, 1, ["rad s-1"])
    w = np.linspace(-1.2, 1.2, 24001)
    cost = t.size * ((w - 0.35) / 3.2) ** 2 + np.sum(
        ((energy[:, None] - 0.5 * w**2) / 0.02) ** 2, 0
    )
    weight = np.exp(-0.5 * (cost - cost.min()))
    share = weight[w > 0.0].sum() / weight.sum()
    assert study.attrs["converged"] == 1 and 0.75 < share < 0.85
    assert study.answer_share.values[0] == pytest.approx(share, abs=0.03)  # measured 0.01
    assert np.mean(study.drawn > 0.0) == pytest.approx(share, abs=0.03)
    stays = draw(problem, WHITE, answers, prior, "nuts", 4, 300, 1, ["rad s-1"])
    assert stays.attrs["converged"] == 0 and float(stays.r_hat[0]) > 1.5


def test_directions_that_nothing_shows_are_refused():
    ds = fits.moved(fits.STEADY_BODY, 1.0, 0.05)
    # with the noise of exact readings, 1e-16, rounding would seem to show something
    how = {"posterior": "emcee", "noise": {"omega": 0.01}}
    with pytest.raises(OptionError, match=r"do not show body\.moments\.1: give it"):
        rm.fit(fits.STEADY_BODY, ds, "body.moments,start.omega", **how)
    ds = fits.moved(fits.FREE_BODY, 1.0, 0.05)
    words = {"nuisances": "scale", "posterior": "emcee"}
    with pytest.raises(OptionError, match=r"omega\.scale.*repeat the prior"):
        rm.fit(fits.FREE_BODY, ds, "body.moments,start.omega", **words)


def test_options_are_refused_in_words(still, monkeypatch):
    table, _ = still
    with pytest.raises(OptionError, match="did you mean 'emcee'"):
        rm.fit(BALL, table, "start.omega", posterior="emce")
    with pytest.raises(OptionError, match="needs a posterior"):
        rm.fit(BALL, table, "start.omega", pool=RATE)
    with pytest.raises(OptionError, match="no such number of --each"):
        rm.fit(SLOWED, table, f"start.omega,{RATE}", pool=RATE, posterior="nuts")
    for sampler, name in (("emcee", "emcee"), ("nuts", "nutpie")):
        monkeypatch.setitem(sys.modules, name, None)
        with pytest.raises(OptionError, match=rf"package {name}: pip install 'rigidmc\[fit\]'"):
            rm.fit(BALL, table, "start.omega", posterior=sampler)


def test_draws_that_disagree_are_no_posterior(still):
    table, _ = still
    study = rm.fit(BALL, table, "start.omega", posterior="nuts", draws=20, trials=2)
    assert study.attrs["converged"] == 0 and study.effective.max() < 400
    text = "\n".join(lines_of(study))
    worst, few = study.quantity.values[
        [np.argmax(study.r_hat.values), np.argmin(study.effective.values)]
    ]
    assert f"no posterior: chains disagree most about {worst};" in text
    assert f"; {few} has the fewest effective." in text
    assert "(" not in text.split("no post")[1]
    assert "posterior" not in groups_of(study) and "warmup_posterior" in groups_of(study)


def test_independent_draws_agree_and_a_walker_that_rests_does_not(still, monkeypatch):
    """R-hat of 64 walkers themselves is above 1.01 for 2 of these 20 sets of independent draws."""
    problem = problem_of(BALL, still[0], ("start.omega",))
    x = problem.parameters.coordinates({})
    prior, random = prior_of(problem, x), np.random.default_rng(0)

    def study_of(z):
        made = z, z[..., 0], np.zeros(z.shape[:2]), np.ones(len(z))
        monkeypatch.setitem(SAMPLERS, "given", ("numpy", lambda *more: [made]))
        return draw(problem, WHITE, [x], prior, "given", 2, 1000, 1, ["rad s-1"] * 3)

    for _ in range(20):
        z = x + 0.1 * random.normal(size=(64, 31, 3))
        assert study_of(z).attrs["converged"] == 1
    z[5] = x + [0.0, 0.0, 0.25]  # one of 64, at 2.5 deviations
    study = study_of(z)
    assert study.attrs["converged"] == 0 and np.argmin(study.effective.values) == 2
    z[5] = z[4]
    z += 0.1 * np.linspace(-1.0, 1.0, 31)[:, None]  # all walkers still move away from their starts
    assert study_of(z).r_hat.min() > 1.01


def test_arviz_reads_what_the_command_writes(still, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = (
        "tennis_racket",
        "toss",
        "--free",
        "start.omega",
        "--set",
        "body.moments=[0.07,0.94,1.0]",
    )
    words = *words, "--trials", 2, "--posterior", "emcee", "--arviz"
    done = invoke("fit", *words, "draws.nc", "-o", "fit.nc")
    assert done.exit_code == 0 and "posterior: " in done.output, done.output
    assert invoke("fit", *words, "draws.nc").exit_code != 0  # it replaces nothing
    study = xr.open_dataset("fit.nc")
    arviz = package("arviz")
    read = arviz.from_netcdf("draws.nc")
    assert {"posterior", "sample_stats", "log_likelihood", "observed_data"} <= set(read.groups())
    np.testing.assert_array_equal(
        read.posterior["start.omega.2"], drawn_of(study, "start.omega.2").reshape(study.lp.shape)
    )
    drawn = read.posterior["start.omega.2"].values
    groups = drawn.reshape(4, 32, -1).swapaxes(1, 2).reshape(4, -1)  # 32 walkers of each chain
    of_draws = study.sel(quantity="start.omega.2")
    assert arviz.rhat(groups) == pytest.approx(float(of_draws.r_hat))
    effective = min(arviz.ess(drawn), arviz.ess(drawn, method="tail"))
    assert effective == pytest.approx(float(of_draws.effective))
    assert read.posterior["start.omega.2"].attrs["units"] == "rad s-1"
    np.testing.assert_array_equal(read.observed_data["data"], study.data)
    with xr.open_datatree("draws.nc") as tree:
        assert tree.posterior.sizes["chain"] == study.sizes["chain"]
    empty = invoke("fit", *words[:-3], "--arviz", "none.nc")
    assert "none.nc was not written" in empty.output


@pytest.mark.slow
@pytest.mark.parametrize("name", fits.POSTERIORS)
def test_truths_have_uniform_ranks(name):
    """Simulation-based calibration, Talts et al., arXiv:1804.06788."""
    rows = [fits.ranks_of(seed, name) for seed in range(64)]
    assert all(row["converged"] for row in rows)
    ranks = np.array([row["ranks"] for row in rows])
    chance = fits.chi_square(ranks, 8)
    assert (chance > 1e-3).all()
    # intervals half as wide would be told: their ranks lie at the ends
    narrow = stats.norm.cdf(2.0 * stats.norm.ppf(np.clip(ranks, 1e-3, 1.0 - 1e-3)))
    assert (fits.chi_square(narrow, 8) < 1e-3).all()
