"""The noise of a fit: jitter of time stamps, outliers, and noise found from residuals."""

import warnings
from itertools import pairwise

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

import rigidmc as rm
from bench import fits
from bench.fit_peers import MOMENTS, NOISE, OMEGA, rates, record
from rigidmc.errors import OptionError
from rigidmc.studies.fit.problem import LOSSES, FitProblem
from rigidmc.studies.fit.streams import ATTITUDE, VECTOR, Jitter, Stream, high_frequency_noise
from rigidmc.studies.fit.table import table as lines_of
from rigidmc.studies.fit.uncertainty import pseudo_residuals
from tests.studies.test_fit import FREE, SCENE, problem_of, some_coordinates

TAU = 2e-3  # [s]: .3 rad/s of the fastest rates, 150 times their noise


def jittered(seed, tau=TAU):
    """Return the times that are read, and the rates at times with errors."""
    t, _ = record()
    random = np.random.default_rng(seed)
    fine = np.linspace(0.0, t[-1] + 0.02, 4001)
    at = np.maximum(0.0, t + tau * random.normal(size=t.size))
    omega = CubicSpline(fine, rates(MOMENTS[:2], OMEGA, fine))(at)
    return t, omega + NOISE * random.normal(size=omega.shape)


def off_of(study, truth=MOMENTS[:2]):
    """Return the errors of the ratios I1/I3 and I2/I3 over their standard deviations."""
    return (study.ratio.values[:2, 2] - truth) / study.ratio_deviation.values[:2, 2]


def shaken(loss="linear"):
    """A fit of jittered rates whose jitter is known."""
    problem = problem_of(fits.table_of(*jittered(0)))
    x, (stream,) = some_coordinates(problem), problem.streams
    rate = problem.compared(x[None])[0][..., 1, 0] * NOISE / problem.every
    streams = [stream._replace(jitter=Jitter(TAU, 1e-4), rates=rate)]
    return FitProblem(problem.run, problem.parameters, streams, 2, loss), x, rate


def test_the_jitter_has_the_likelihood_of_the_whole_covariance():
    problem, x, rate = shaken()
    left = problem.residuals_of(x[None], is_white=False).reshape(-1, 3)
    change = rate.reshape(-1, 3) * TAU / NOISE
    covariance = np.eye(3) + change[:, :, None] * change[:, None]
    expected = np.einsum("kc,kcd,kd", left, np.linalg.inv(covariance), left)
    assert np.abs(change).max() > 20.0
    white, slopes = problem.jacobian(x)
    sums = problem.sums(x[None])
    assert white @ white == pytest.approx(expected, rel=1e-9)
    assert sums.cost[0] == pytest.approx(expected, rel=1e-9)
    matrix = slopes.T @ slopes
    np.testing.assert_allclose(sums.matrix[0], matrix, rtol=1e-9, atol=1e-9 * matrix.max())
    # at the truth, white residuals are noise: of 1,203 of them the mean square is 1 +- .04
    truth = problem.parameters.coordinates({"body.moments": MOMENTS, "start.omega": OMEGA})
    (stream,) = problem.streams
    raw = problem.compared(truth[None], is_white=False)[0]
    rate = raw[..., 1, 0] * NOISE / problem.every
    right = FitProblem(problem.run, problem.parameters, [stream._replace(rates=rate)], 1)
    assert np.mean(right.jacobian(truth)[0] ** 2) == pytest.approx(1.0, abs=0.15)  # measured 0.975
    assert np.mean(raw[..., 0, 0] ** 2) > 100.0  # measured 271


@pytest.mark.parametrize("loss", LOSSES)
def test_sums_have_the_cost_of_scipy(loss):
    problem, x, _ = shaken(loss)
    white, slopes = problem.jacobian(x)
    found = least_squares(lambda y: white, x, lambda y: slopes, loss=loss,
                          f_scale=LOSSES[loss][1], max_nfev=1)  # fmt: skip
    sums = problem.sums(x[None])
    assert sums.cost[0] == pytest.approx(2.0 * found.cost, rel=1e-9)
    np.testing.assert_allclose(sums.gradient[0], -found.grad, rtol=1e-7)


@pytest.mark.parametrize("loss", LOSSES)
def test_pseudo_residuals_are_slopes_of_the_cost(loss):
    """psi = 1/2 of the derivative of the cost, over the mean of its derivative."""
    r = np.linspace(-8.0, 8.0, 4001)
    c = LOSSES[loss][1]
    z = (r / c) ** 2
    cost = c**2 * {"linear": z, "huber": np.where(z <= 1, z, 2 * np.sqrt(z) - 1),
                   "cauchy": np.log1p(z)}[loss]  # fmt: skip
    psi = 0.5 * np.gradient(cost, r)
    expected = psi / max(0.05, np.mean(np.gradient(psi, r)))
    np.testing.assert_allclose(pseudo_residuals(loss, r)[2:-2], expected[2:-2], atol=2e-2)


def test_the_jitter_of_time_stamps_is_found():
    table = fits.table_of(*jittered(4))
    plain = rm.fit(SCENE, table, FREE, trials=4)
    study = rm.fit(SCENE, table, FREE, nuisances="jitter", trials=4)
    size, deviation = float(study.jitter[0]), float(study.jitter_deviation[0])
    # each of 401 times has an error of its own: 1/sqrt(2*401) = 3.5 %
    assert deviation == pytest.approx(0.035 * TAU, rel=0.15)
    assert abs(size - TAU) < 3.0 * deviation  # measured 0.4
    np.testing.assert_allclose(study.noise.values[:3], NOISE, rtol=0.15)
    assert np.abs(off_of(study)).max() < 3.0  # measured 0.8
    assert plain.noise.values.min() > 8.0 * NOISE  # measured 12.5
    # across their changes, the rates are as certain as without jitter
    gain = plain.ratio_deviation.values[:2, 2] / study.ratio_deviation.values[:2, 2]
    assert gain.min() > 3.0  # measured 4.8
    assert any("omega.jitter" in line for line in lines_of(study))
    # data less model is what it was: the errors of times are not taken out
    spread = [float(np.std(one.data - one.model)) for one in (study, plain)]
    assert spread[0] == pytest.approx(spread[1], rel=0.05)


def test_a_lasting_error_lasts_between_the_times_without_jitter():
    """Between their stamps, samples of 6.5 ms with errors of 5 ms look like a random walk."""
    random, t, lasts = np.random.default_rng(2), 6.5e-3 * np.arange(101), 0.15
    at = np.clip(t + 5e-3 * random.normal(size=101), 0.0, 0.72)
    lasting, order = random.normal(size=(101, 3)), np.argsort(at)
    for before, k in pairwise(order):
        rho = np.exp(-(at[k] - at[before]) / lasts)
        lasting[k] = rho * lasting[before] + np.sqrt(1.0 - rho**2) * lasting[k]
    fine, truth = np.linspace(0.0, 0.72, 721), (0.82, 0.2)
    omega = CubicSpline(fine, rates(truth, (18.5, 7.5, 1.5), fine))(at) + 0.15 * lasting
    scene = rm.Scene(rm.Body((*truth, 1.0)), start=rm.Start(omega=(18.0, 7.0, 1.0)))
    table = fits.table_of(t, omega + 0.02 * random.normal(size=omega.shape))
    study = rm.fit(scene, table, FREE, nuisances="jitter", trials=2)
    # measured 0.71, 1.03 and 0.0043; at the times of the stamps 33, 6.0 and 0.036
    assert study.attrs["lasting"] < 2.0
    assert 0.5 < study.attrs["lasting_time"] / lasts < 2.0
    assert study.ratio_deviation.values[:2, 2].max() < 0.01
    assert np.abs(off_of(study, truth)).max() < 3.0  # measured 0.5


def test_no_jitter_is_found_where_there_is_none():
    study = rm.fit(SCENE, fits.table_of(*record()), FREE, nuisances="jitter", trials=4)
    assert float(study.jitter[0]) < 0.03 * TAU  # measured 0.011
    np.testing.assert_allclose(study.noise.values[:3], NOISE, rtol=0.1)
    plain = rm.fit(SCENE, fits.table_of(*record()), FREE, trials=4)
    np.testing.assert_allclose(
        study.ratio_deviation.values[:2, 2], plain.ratio_deviation.values[:2, 2], rtol=0.1
    )


def test_a_given_noise_stays():
    noise = {"omega": 2.0 * NOISE}
    study = rm.fit(SCENE, fits.table_of(*jittered(2)), FREE, noise=noise, nuisances="jitter",
                   trials=4)  # fmt: skip
    assert (study.noise.values == 2.0 * NOISE).all()
    assert study.attrs["reduced_chi_square"] == pytest.approx(0.25, rel=0.15)
    assert float(study.jitter[0]) == pytest.approx(2.0 * TAU, rel=0.1)  # in units of that noise


@pytest.mark.slow
def test_intervals_with_jitter_cover():
    """30 records: of 150 errors of which five are correlated, 95 +- 3 %."""
    off, tau = [], []
    for seed in range(30):
        study = rm.fit(SCENE, fits.table_of(*jittered(seed)), FREE, nuisances="jitter", trials=4)
        start = study.sel(parameter=[f"start.omega.{i}" for i in (1, 2, 3)])
        off.append([*off_of(study), *(start.value.values[0] - OMEGA) / start.deviation.values])
        tau.append((float(study.jitter[0]) - TAU) / float(study.jitter_deviation[0]))
    assert 0.87 < np.mean(np.abs(off) < 1.96) <= 1.0  # measured 0.893, with .5 ms 0.92
    assert np.abs(np.mean(off, axis=0)).max() < 0.6  # measured 0.32: no bias
    assert 0.6 < np.sqrt(np.mean(np.square(tau))) < 1.4  # measured 1.11
    assert abs(np.mean(tau)) < 0.6  # measured -0.06


def with_outliers(drag, seed=0):
    """Return a table with 2 % of outliers, 60 times the noise and above the truth."""
    effects = (rm.QuadraticDrag(drag),) if drag else ()
    scene = rm.Scene(rm.Body(tuple(MOMENTS)), *effects, start=SCENE.start)
    ds = fits.moved(scene, 4.0, 0.01)
    random = np.random.default_rng(seed)
    read = ds.omega.values[:, :, 0] + NOISE * random.normal(size=(401, 3))
    read += 60.0 * NOISE * (random.random(read.shape) < 0.02)
    return fits.table_of(ds.time.values, read)


@pytest.mark.parametrize("loss", ["huber", "cauchy"])
def test_outliers_do_not_move_a_robust_fit(loss):
    table = with_outliers(0.0)
    plain = rm.fit(SCENE, table, FREE, trials=4, nuisances="bias")
    robust = rm.fit(SCENE, table, FREE, trials=4, nuisances="bias", loss=loss)
    bias = plain.sel(parameter=["omega.bias.1", "omega.bias.2", "omega.bias.3"])
    assert (bias.value.values[0] / bias.deviation.values).max() > 2.0
    assert np.abs(off_of(robust)).max() < 2.5
    bias = robust.sel(parameter=bias.parameter)
    assert np.abs(bias.value.values[0] / bias.deviation.values).max() < 3.5
    np.testing.assert_allclose(robust.noise.values[:3], NOISE, rtol=0.15)
    # as certain as without outliers, up to the loss of 5 % of the information
    clean = rm.fit(SCENE, fits.table_of(*record()), FREE, trials=4, nuisances="bias")
    np.testing.assert_allclose(
        robust.ratio_deviation.values[:2, 2], clean.ratio_deviation.values[:2, 2], rtol=0.2
    )
    assert (plain.ratio_deviation.values[:2, 2] > 3.0 * clean.ratio_deviation.values[:2, 2]).all()


@pytest.mark.parametrize("loss", ["huber", "cauchy"])
def test_a_missing_torque_is_told_in_spite_of_outliers(loss):
    table = with_outliers(3e-7)
    assert rm.fit(SCENE, table, FREE, trials=4).gain.values.max() < 3.0  # measured 0.8
    study = rm.fit(SCENE, table, FREE, trials=4, loss=loss)
    assert float(study.gain[0]) > 5.0  # measured 13, 35
    assert study.attrs["lasting_gain"] > 10.0  # measured 36, 35
    assert np.abs(off_of(study)).max() < 3.0  # measured 1.9, 2.5


def test_lasting_errors_of_a_sensor_are_no_torque():
    """Errors of .04 rad/s over .1 s, twice the white noise, in a record of the right model: with a
    likelihood of white residuals, a torque fixed in the body would gain 35."""
    _, _, table = fits.record_of(4, fits.LAWS[0])
    random = np.random.default_rng([4, 7])
    rho = np.exp(-fits.EVERY / (0.05 * 4.0 ** random.random()))
    lasting = random.normal(size=(len(table["t"]), 3))
    for k in range(1, len(lasting)):
        lasting[k] = rho * lasting[k - 1] + np.sqrt(1.0 - rho**2) * lasting[k]
    table = fits.table_of(table["t"], np.stack([table[f"omega[{k}]"] for k in (1, 2, 3)], axis=1)
                          + 0.04 * lasting)  # fmt: skip
    guess = rm.Scene(rm.Body((0.9, 1.0, 0.95)), start=rm.Start(omega=(1.0, 1.0, 1.0)))
    study = rm.fit(guess, table, FREE, nuisances="bias,alignment", trials=30)
    assert study.attrs["lasting_gain"] > 20.0 and study.sizes["torque"] == 5
    assert study.gain.values.max() < 0.0  # measured -2.9


def test_an_unknown_loss_is_refused():
    with pytest.raises(OptionError, match="huber"):
        rm.fit(SCENE, fits.table_of(*record()), FREE, loss="hubert")


def test_a_fast_motion_between_readings_is_no_noise():
    """At 1 Hz, third differences of a body that turns by 1.6 rad between two show motion."""
    scene = rm.Scene(rm.Body((1.0, 2.0, 2.5)), start=rm.Start(omega=(0.3, 1.5, 0.4)))
    ds = fits.moved(scene, 60.0, 1.0)
    read = ds.omega.values[:, :, 0] + 0.01 * np.random.default_rng(0).normal(size=(61, 3))
    table = fits.table_of(ds.time.values, read)
    first = problem_of(table, noise=None, scene=scene).streams[0].noise
    assert first.min() > 0.03  # measured 0.050
    guess = rm.Scene(rm.Body((1.1, 2.0, 2.4)), start=rm.Start(omega=(1.0, 1.0, 1.0)))
    study = rm.fit(guess, table, FREE, trials=20)
    np.testing.assert_allclose(study.noise.values[:3], 0.01, rtol=0.3)  # 1/sqrt(60) = 13 %
    assert study.attrs["reduced_chi_square"] == pytest.approx(1.0, abs=0.25)
    assert np.abs(off_of(study, np.array([0.4, 0.8]))).max() < 3.0


def test_noise_of_channels_with_readings_at_other_times():
    random, t = np.random.default_rng(0), 0.01 * np.arange(3000)
    t[1000:] += 5.0  # a gap
    t[2000:] += 0.04 * np.arange(1000)  # and a slower part
    x = np.sin(2.0 * t)[:, None] + [0.01, 0.02, 0.03] * random.normal(size=(3000, 3))
    x[1::2, 0] = x[::2, 1] = np.nan  # two channels in turn
    noise = high_frequency_noise(Stream("omega", VECTOR, t[None], x[None], np.empty(0)))
    np.testing.assert_allclose(noise, [0.01, 0.02, 0.03], rtol=0.1)


def test_noise_of_attitudes_is_that_of_a_rotation_vector():
    random, t = np.random.default_rng(0), 0.01 * np.arange(2000)
    turn = Rotation.from_rotvec(np.outer(t, [0.3, 0.5, 0.2]))
    read = turn * Rotation.from_rotvec(0.01 * random.normal(size=(2000, 3)))
    values = read.as_quat(scalar_first=True)
    flips = np.append(False, (values[1:] * values[:-1]).sum(1) < 0.0)
    values[np.cumsum(flips) % 2 == 1] *= -1.0
    noise = high_frequency_noise(Stream("attitude", ATTITUDE, t[None], values[None], np.empty(0)))
    # the vector part of a unit quaternion has up to a fifth less
    np.testing.assert_allclose(noise, 0.01, rtol=0.25)


def test_outliers_are_no_noise():
    random, t = np.random.default_rng(0), 0.01 * np.arange(2000)
    x = np.sin(2.0 * t)[:, None] + 0.01 * random.normal(size=(2000, 3))
    x[random.random(x.shape) < 0.02] += 0.6
    stream = Stream("omega", VECTOR, t[None], x[None], np.empty(0))
    assert high_frequency_noise(stream).min() > 0.05
    np.testing.assert_allclose(high_frequency_noise(stream, is_robust=True), 0.01, rtol=0.1)


@pytest.fixture(autouse=True)
def quiet():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield
