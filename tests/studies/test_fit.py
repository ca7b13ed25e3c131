"""Fits of records with a known truth, beside SciPy and beside the bound of Cramer and Rao."""

from itertools import product

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

import rigidmc as rm
from bench import fits
from bench.fit_peers import MOMENTS, NOISE, OMEGA, bound, differences, rates, record  # fmt: skip
from rigidmc.engine import program
from rigidmc.engine.program import Program
from rigidmc.studies.fit.answers import doubts, grown, growth, merged, upright
from rigidmc.studies.fit.balance import balance, windows_of
from rigidmc.studies.fit.missing import Law, covariance_of
from rigidmc.studies.fit.parameters import PAIRS, left_jacobian
from rigidmc.studies.fit.setup import make_problem, records_of
from rigidmc.studies.fit.solve import Solution, minimise, polish
from rigidmc.studies.fit.starts import make_starts
from rigidmc.studies.fit.uncertainty import (
    ModelError,
    _basis,
    _likelihood,
    assess,
    by_channel,
    model_error,
)
from rigidmc.studies.fit.uncertainty import covariance_of as covariance_by_channel
from rigidmc.studies.fit.visible import seen

SENSORS = ("bias", "scale", "alignment", "offset", "drift")


SCENE = rm.Scene(rm.Body((0.3, 0.8, 1.0)), start=rm.Start(omega=tuple(OMEGA)))
FREE = "body.moments", "start.omega"


def problem_of(table, nuisances=(), noise=NOISE, scene=SCENE, free=FREE, split=None):
    records = records_of(scene, table, {}, None, split, ())
    sigma = None if noise is None else dict.fromkeys(records[0].times, noise)
    return make_problem(scene, free, (), records, sigma, nuisances, 1)


@pytest.fixture(scope="module")
def problem():
    return problem_of(fits.table_of(*record()))


@pytest.fixture(scope="module")
def of_two_records():
    """Rates with all nuisances and attitudes, of two records with gaps."""
    ds = fits.moved(SCENE, 1.0, 0.02, ("omega", "attitude"))
    table = {"t": np.tile(ds.time.values, 2), "toss": np.repeat([0, 1], ds.time.size)}
    for name, count in (("omega", 3), ("attitude", 4)):
        for k in range(count):
            table[f"{name}[{k + 1}]"] = np.tile(ds[name].values[:, k, 0], 2)
    table["omega[2]"][[3, 60]] = np.nan
    nuisances = [f"omega.{word}" for word in SENSORS] + [
        "attitude.offset",
        "attitude.drift",
        "attitude.alignment",
    ]
    return problem_of(table, nuisances, 0.01, split="toss")


def some_coordinates(problem, seed=1):
    random, x = np.random.default_rng(seed), problem.parameters.coordinates({})
    return x + 0.05 * random.normal(size=x.size)


def test_derivatives_of_residuals_are_those_of_central_differences(of_two_records):
    x = some_coordinates(of_two_records)
    residuals, slopes = of_two_records.jacobian(x)
    found = differences(lambda y: of_two_records.jacobian(y)[0], x)
    of_rates = residuals.size - 2 * 51 * 3
    scale = np.abs(found[:of_rates]).max(0) + 1e-9  # 0 for the clock of the attitudes
    np.testing.assert_allclose(slopes[:of_rates] / scale, found[:of_rates] / scale, atol=1e-6)
    # those of an attitude are right where it is near the data, to first order
    at = of_two_records.parameters.coordinates({})
    _, slopes = of_two_records.jacobian(at)
    found = differences(lambda y: of_two_records.jacobian(y)[0], at)[of_rates:]
    np.testing.assert_allclose(slopes[of_rates:], found, atol=1e-5 * np.abs(found).max())


def test_sums_of_trials_are_those_of_the_derivatives(of_two_records):
    x = np.stack([some_coordinates(of_two_records, seed) for seed in range(11)])
    sums = of_two_records.sums(x)
    for i in (0, 10):
        residuals, slopes = of_two_records.jacobian(x[i])
        matrix = slopes.T @ slopes
        np.testing.assert_allclose(sums.matrix[i], matrix, rtol=1e-9, atol=1e-9 * matrix.max())
        gradient = -slopes.T @ residuals
        np.testing.assert_allclose(sums.gradient[i], gradient, atol=1e-9 * np.abs(gradient).max())
        assert sums.cost[i] == pytest.approx(residuals @ residuals, rel=1e-12)
    for one, many in zip(of_two_records.sums(x[3:4]), sums, strict=True):
        np.testing.assert_array_equal(one[0], many[3])  # whatever trials lie beside it


def test_rotations_follow_from_rotation_vectors():
    for turn in ([0.3, -0.8, 1.1], [3e-3, -2e-3, 4e-3], [0.0, 0.0, 0.0], [2.0, 2.0, 0.5]):
        a = np.array(turn)

        def small(b, a=a):
            return (Rotation.from_rotvec(b) * Rotation.from_rotvec(a).inv()).as_rotvec()

        found = left_jacobian(a[None])[0]
        np.testing.assert_allclose(found, differences(small, a), atol=1e-9)


def test_all_coordinates_are_those_of_a_body(problem):
    parameters = problem.parameters
    x = parameters.coordinates({"body.moments": MOMENTS, "start.omega": OMEGA})
    np.testing.assert_allclose(parameters.values(x), [*MOMENTS, *OMEGA], rtol=1e-12)
    for seed in range(20):
        y = x + np.random.default_rng(seed).normal(0.0, 3.0, x.size)
        moments = parameters.values(y)[:3]
        assert (moments > 0.0).all() and 2.0 * moments.max() < moments.sum() * (1.0 + 1e-12)
        np.testing.assert_allclose(moments, PAIRS @ np.exp(y[:3]))
        slopes = differences(parameters.values, y)
        np.testing.assert_allclose(parameters.slopes(y), slopes, rtol=1e-6, atol=1e-7)


def scipy_fit(t, read):
    """Return (ratios and start, their covariance for unit noise) of a fit by SciPy alone."""

    def residuals(p):
        return (read - rates(p[:2], p[2:], t)).ravel()

    found = least_squares(residuals, [0.3, 0.8, *read[0]], jac="3-point", xtol=1e-12, ftol=1e-12)
    return found.x, np.linalg.inv(found.jac.T @ found.jac)


def test_a_fit_is_that_of_scipy(problem):
    t, read = record()
    expected, covariance = scipy_fit(t, read)
    study = rm.fit(SCENE, fits.table_of(t, read), FREE, noise={"omega": NOISE}, trials=20)
    found = np.array([*study.ratio.values[:2, 2], *study.value.values[0, 3:]])
    deviation = NOISE * np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(found, expected, atol=1e-3 * deviation.min())
    # residuals say how large the noise is: 1 +- 2.6 % for 747 of them
    told = np.array([*study.ratio_deviation.values[:2, 2], *study.deviation.values[3:]])
    np.testing.assert_allclose(told, deviation, rtol=0.1)
    np.testing.assert_allclose(
        told, deviation * study.attrs["reduced_chi_square"] ** 0.5, rtol=0.02
    )
    x = problem.parameters.coordinates(
        {"body.moments": [*expected[:2], 1.0], "start.omega": expected[2:]}
    )
    assert study.cost.values[0] == pytest.approx(problem.sums(x[None]).cost[0], rel=1e-7)
    assert np.isinf(study.deviation.values[:3]).all()


def test_steps_in_lockstep_end_where_scipy_ends(problem):
    x = make_starts(problem, 30, 3)
    solution = minimise(problem, x)
    assert solution.is_settled.sum() > 20
    for i in np.argsort(solution.sums.cost)[:3]:
        found = least_squares(
            lambda y: problem.jacobian(y)[0], x[i], lambda y: problem.jacobian(y)[1], x_scale="jac"
        )
        assert solution.sums.cost[i] <= 2.0 * found.cost * (1.0 + 1e-5)
    rough = merged(problem, solution)
    polished = polish(problem, rough)
    assert (polished.sums.cost <= rough.sums.cost).all()
    gradient = problem.sums(polished.x[:1])
    step = np.linalg.pinv(gradient.matrix[0]) @ gradient.gradient[0]
    assert np.sqrt(step @ gradient.matrix[0] @ step) < 1e-3  # of a standard deviation


def test_trials_do_not_depend_on_those_beside_them(problem):
    x = make_starts(problem, 9, 5)
    whole = minimise(problem, x)
    np.testing.assert_array_equal(minimise(problem, x[4:5]).x[0], whole.x[4])


def test_neither_threads_nor_vectors_change_a_bit_of_the_sums(problem, monkeypatch):
    x = make_starts(problem, 70, 3)  # three blocks
    expected, made = problem.sums(x), set()
    make = Program.__init__

    def noted(self, *given, **named):
        make(self, *given, **named)
        made.add(self.lanes)

    monkeypatch.setattr(Program, "__init__", noted)
    for threads, width in ((2, 0), (1, 1), (2, 16)):
        if width:
            monkeypatch.setattr(program, "lanes_for", lambda dtype, width=width: 2 * width)
        # a new scene: one keeps its program, in which a number has a derivative beside it
        other = problem_of(fits.table_of(*record()))
        other.threads = threads
        for a, b in zip(other.sums(x), expected, strict=True):
            np.testing.assert_array_equal(a, b)
    assert made >= {1, 16}


def long_record(kind):
    """Return (true moments, problem) of 2,000 rates with a noise of 1 % of the largest: 100 turns
    about the middle axis, or a chaotic top, of which a change of the start grows 16,000-fold."""
    if kind == "turns":
        moments, spin, end = (0.45, 0.8, 1.1), rm.Start(omega=(0.03, 5.0, -0.02)), 40.0 * np.pi
        bodies, effects = (rm.Body(moments), rm.Body((0.9, 1.0, 0.95))), ()
    else:
        effects = (rm.Gravity(9.81),)
        bodies = [
            rm.Body.from_moments(each, mass=1.0, centre=(0.1, 0.2, 0.4))
            for each in ((1.2, 1.95, 2.4), (1.5, 1.8, 2.0))
        ]
        spin, end = rm.Start(omega=(0.1, -0.5, -0.4), attitude=(1.0, 0.0, 0.0, 0.0)), 60.0
    scene, guess = (rm.Scene(body, *effects, start=spin) for body in bodies)
    ds = fits.moved(scene, end, end / 2000)
    read = ds.omega.values[:, :, 0]
    noise = 0.01 * np.abs(read).max()
    read = read + noise * np.random.default_rng(1).normal(size=read.shape)
    table = fits.table_of(ds.time.values, read)
    return np.array(scene.body.moments), problem_of(table, (), noise, guess)


@pytest.mark.parametrize("kind", ["turns", "chaos"])
def test_long_records_are_fitted_from_their_beginning(kind):
    moments, problem = long_record(kind)
    x = make_starts(problem, 30, 1)
    one, grew = minimise(problem, x), minimise(problem, *grown(problem, x))
    is_right = one.sums.cost < 1.2 * problem.residuals
    assert is_right.sum() <= 1  # of 30, in one piece: measured none
    assert grew.sums.cost.min() < 1.1 * problem.residuals  # measured 1.0006 and 0.9998
    best = grew.x[np.argmin(grew.sums.cost)]
    found = problem.parameters.values(best)[:3]
    # measured 1.8e-4 and 6e-5
    np.testing.assert_allclose(found / found[2], moments / moments[2], atol=1e-3)
    assert kind == "turns" or growth(problem, best) > 1e4  # measured 1.6e4


def turned_record(turn, effects=(), end=3.0, apart=1, moments=(0.45, 0.8, 1.1)):
    """Return (times, rates) of a body by a sensor turned by a matrix, with a noise of .02 rad/s."""
    start = rm.Start(omega=(1.0, 3.0, -2.0))
    ds = fits.moved(rm.Scene(rm.Body(moments), *effects, start=start), end, 0.01)
    read = ds.omega.values[::apart, :, 0] @ turn.T
    noise = 0.02 * np.random.default_rng(1).normal(size=read.shape)
    return fits.table_of(ds.time.values[::apart], read + noise)


def answers_of(problem, trials):
    x = make_starts(problem, trials, 1)
    solution = upright(problem, minimise(problem, *grown(problem, x)))
    return merged(problem, polish(problem, merged(problem, solution)))


@pytest.mark.parametrize(
    ("effects", "count", "trials"), [((), 25, 20), ((rm.Rotor((0.5, 0.4, 1.0)),), 5, 100)]
)
def test_a_sensor_with_any_attitude_is_found(effects, count, trials):
    """A free body, and one with a known rotor, which the balance of momentum does not know."""
    true = np.diag([0.45, 0.8, 1.1])
    guess = rm.Scene(rm.Body((0.9, 1.0, 0.95)), *effects, start=rm.Start(omega=(1.0, 1.0, 1.0)))
    for turn in Rotation.random(count, np.random.default_rng(5)).as_matrix():
        table = turned_record(turn, effects)
        problem = problem_of(table, ("alignment",), 0.02, guess)
        found = answers_of(problem, trials)
        assert len(found.x) == 1  # the 24 names of its axes are one answer
        values = problem.parameters.values(found.x[0])
        axes = Rotation.from_rotvec(values[-3:])
        if not effects:  # a rotor tells the axes apart
            assert axes.magnitude() < 1.1  # 62.8 deg: no name is nearer
        tensor = axes.as_matrix() @ np.diag(values[:3]) @ axes.as_matrix().T
        expected = turn @ true @ turn.T / (1.0 if effects else true.trace() / tensor.trace())
        np.testing.assert_allclose(tensor, expected, atol=0.01)  # measured 2e-3


def doubts_of(problem, found):
    return doubts(problem, found, assess(problem, found.x[0]))


@pytest.mark.parametrize("hand", [1.0, -1.0])
def test_a_left_handed_sensor_is_told(hand):
    turn = Rotation.from_rotvec([0.5, -0.2, 0.8]).as_matrix()
    problem = problem_of(turned_record(hand * turn), ("alignment",), 0.02)
    found = answers_of(problem, 20)
    (text,) = doubts_of(problem, found)
    other = np.array(text.split(" as ")[1].split(" : "), float)
    here = problem.parameters.values(found.x[0])[:3]
    true = np.array([0.45, 0.8, 1.1])
    for moments in [other] if hand < 0.0 else [here]:
        np.testing.assert_allclose(np.sort(moments) / moments.max(), true / 1.1, atol=0.005)
    # a known torque tells the hand
    torque = (rm.BodyTorque((0.5, -0.4, 0.6)),)
    driven = rm.Scene(SCENE.body, *torque, start=SCENE.start)
    problem = problem_of(turned_record(turn, torque), ("alignment",), 0.02, driven)
    assert not doubts_of(problem, answers_of(problem, 100))


def test_the_hand_of_a_nearly_symmetric_body_is_told():
    """The other body differs by 15 to 22 %; with its axes renamed, by 8 %."""
    true = np.array([1.0, 0.844, 0.889])
    guess = rm.Scene(rm.Body((0.98, 0.942, 1.011)), start=rm.Start(omega=(1.0, 3.0, -2.0)))
    negated = turned_record(np.diag([1.0, -1.0, 1.0]), moments=tuple(true))
    problem = problem_of(negated, (), 0.02, guess)
    (text,) = doubts_of(problem, answers_of(problem, 4))
    other = np.array(text.split(" as ")[1].split(" : "), float)
    np.testing.assert_allclose(other, true / true[2], atol=0.005)  # measured 2e-4


def test_aliased_rates_are_found():
    """Rates of 3.7 rad/s each 1.6 s: 5.9 rad between readings, nearly a turn."""
    table = turned_record(np.eye(3), end=48.0, apart=160)
    problem = problem_of(table, (), 0.02)
    found = answers_of(problem, 256)
    ratios = [v[:3] / v[2] for v in map(problem.parameters.values, found.x)]
    assert min(np.abs(one - np.array([0.45, 0.8, 1.1]) / 1.1).max() for one in ratios) < 0.01


def test_a_motion_that_no_fit_follows_is_told():
    moments, problem = long_record("chaos")
    wrong = problem.parameters.coordinates({"body.moments": moments * [1.01, 1.0, 1.0]})
    ends = np.ones(1, int)
    text = doubts_of(problem, Solution(wrong[None], problem.sums(wrong[None]), ends > 0, ends))
    assert "changes of the motion grow" in text[0] and "--between" in text[0]
    right = answers_of(problem, 30)
    assert doubts_of(problem, right) == []  # though its changes grow as much


@pytest.mark.parametrize(
    ("which", "moments"), [("problem", MOMENTS), ("of_two_records", SCENE.body.moments)]
)
def test_residuals_as_large_as_the_motion_are_told(which, moments, request):
    """Reversed spins leave 1.9 and 3 of the changes of the readings. A start that is wrong by
    .4 % leaves .03 and .02, 80 and 3.8 times the noise: a model error."""
    problem, ends = request.getfixturevalue(which), np.ones(1, int)
    for factor, is_told in ((-1.0, True), (1.004, False)):
        right = {"body.moments": moments, "start.omega": factor * OMEGA}
        x = problem.parameters.coordinates(right)[None]
        sums = problem.sums(x)
        assert sums.cost[0] > 10.0 * problem.residuals
        text = doubts_of(problem, Solution(x, sums, ends > 0, ends))
        assert any("residuals are" in one and "--trials" in one for one in text) == is_told


def test_the_balance_of_momentum_is_a_body():
    t, read = record(1e-6)
    turn = Rotation.from_rotvec([0.5, -0.2, 0.8]).as_matrix()
    (found,) = balance(windows_of([(t, read @ turn.T)]), whole=True)
    tensor = turn @ np.diag(MOMENTS) @ turn.T
    np.testing.assert_allclose(found / np.trace(found), tensor / np.trace(tensor), atol=2e-3)


def test_a_renamed_body_with_its_sensor_turned_back_is_one_answer():
    problem = problem_of(fits.table_of(*record()), ("alignment",))
    names = {"body.moments": MOMENTS, "start.omega": OMEGA}
    x = problem.parameters.coordinates({**names, "omega.alignment": np.array([0.02, 0.01, -0.03])})
    trials = []
    for g in Rotation.create_group("O"):
        turn = Rotation.from_rotvec([0.02, 0.01, -0.03]) * g
        renamed = {"body.moments": MOMENTS @ np.abs(g.as_matrix()),
                   "start.omega": OMEGA @ g.as_matrix()}  # fmt: skip
        trials.append(
            problem.parameters.coordinates({**renamed, "omega.alignment": turn.as_rotvec()})
        )
    sums = problem.sums(np.array(trials))
    np.testing.assert_allclose(sums.cost, sums.cost[0], rtol=1e-6)
    many = Solution(np.array(trials), sums, np.ones(24, bool), np.ones(24, int))
    one = upright(problem, many)
    np.testing.assert_allclose(one.x, np.tile(x, (24, 1)), atol=1e-9)
    # to the last digit, so that a moment at its limit stays there
    np.testing.assert_array_equal(np.sort(one.x[:, :3]), np.sort(np.array(trials)[:, :3]))
    assert merged(problem, one).ends.tolist() == [24]


def test_the_error_of_residuals_has_the_likelihood_of_dense_matrices():
    random, t = np.random.default_rng(2), np.sort(np.random.default_rng(3).uniform(0, 3, 40))
    jacobian, residuals = random.normal(size=(80, 3)), random.normal(size=80)
    times, channel = np.repeat(t, 2), np.tile([0, 1], 40)
    index = np.tile(np.arange(3), (2, 1))
    channels = by_channel(times, channel, index, residuals, jacobian)
    shown = seen(jacobian.T @ jacobian)
    basis = _basis(shown)

    def dense(ratio, time):
        same = (np.arange(80)[:, None] - np.arange(80)) % 2 == 0
        lasting = ratio * np.exp(-np.abs(times[:, None] - times) / time) * same
        return np.eye(80) + lasting

    def likelihood(ratio, time):
        inverse, design = np.linalg.inv(dense(ratio, time)), jacobian @ basis
        matrix = design.T @ inverse @ design
        left = residuals @ inverse @ residuals
        right = design.T @ inverse @ residuals
        whole = 80 * np.log(left / 80) + np.linalg.slogdet(dense(ratio, time))[1]
        left -= right @ np.linalg.solve(matrix, right)
        terms = 77 * np.log(left / 77) + np.linalg.slogdet(dense(ratio, time))[1]
        return -0.5 * (terms + np.linalg.slogdet(matrix)[1]), left / 77, -0.5 * whole

    for ratio, time in ((0.0, 1.0), (0.7, 0.3), (20.0, 5.0)):
        np.testing.assert_allclose(
            _likelihood(channels, basis, ratio, time), likelihood(ratio, time), rtol=1e-9
        )
    found = model_error(channels, shown)
    assert found.gain >= 0.0 and not found.is_seen
    error = ModelError(0.8, 0.5, 0.4, 9.0)
    middle = jacobian.T @ (0.8 * dense(0.5 / 0.8, 0.4)) @ jacobian
    inverse = np.linalg.inv(jacobian.T @ jacobian)
    np.testing.assert_allclose(
        covariance_by_channel(channels, shown, error), inverse @ middle @ inverse, rtol=1e-9
    )


def lasting_channels(seed):
    """300 residuals about an unknown mean: white noise and an error that lasts 10 samples."""
    random, t = np.random.default_rng(seed), 0.01 * np.arange(300)
    lasting = np.zeros(300)
    for k in range(1, 300):
        lasting[k] = 0.9 * lasting[k - 1] + 0.44 * random.normal()
    residuals = 0.5 * random.normal(size=300) + lasting
    jacobian = np.ones((300, 1))
    of_one = np.zeros(300, int), np.zeros((1, 1), int)
    return by_channel(t, *of_one, residuals, jacobian), seen(jacobian.T @ jacobian)


def test_lasting_residuals_are_seen():
    found = model_error(*lasting_channels(4))
    assert found.is_seen
    assert 0.4 < found.white / 0.25 < 2.0 and 0.4 < found.lasting < 2.5
    assert 0.04 < found.time < 0.25  # 10 samples


@pytest.mark.parametrize("seed", [1, 2])
def test_the_error_of_residuals_is_the_likeliest(seed):
    channels, shown = lasting_channels(seed)
    basis = _basis(shown)
    white = _likelihood(channels, basis, 0.0, 1.0)[0]
    grid = product(np.exp(np.arange(-4.0, 4.1, 0.25)), 0.01 * np.exp(np.arange(0.0, 5.1, 0.25)))
    most = max(_likelihood(channels, basis, *at)[0] for at in grid) - white
    # measured 0.02 above the grid; a search that keeps the ratio of 1: 0.7 and 5.2 below
    assert model_error(channels, shown).gain > most - 0.1


def test_the_covariance_is_the_mean_over_laws():
    one, two = np.diag([1.0, 4.0]), np.diag([2.0, 2.0])
    found = covariance_of(
        [Law(0.25, np.zeros(2), one), Law(0.75, np.array([1.0, 0.0]), two)],
        lambda x: (3.0 * x, 3.0 * np.eye(2)),
    )
    np.testing.assert_allclose(found, 9.0 * np.diag([0.25 + 0.75 * (2.0 + 1.0), 2.5]))


def test_deviations_are_at_the_bound_of_cramer_and_rao():
    """A phone that flips three times: 2 mrad/s at 100 Hz."""
    least, (t, _) = bound(), record()
    assert (np.diff(np.sign(rates(MOMENTS[:2], OMEGA, t)[:, 1])) != 0).sum() >= 3
    off, told = [], []
    for seed in range(40):
        table = fits.table_of(*record(seed=seed))
        study = rm.fit(SCENE, table, FREE, noise={"omega": NOISE}, trials=4)
        off.append((study.ratio.values[:2, 2] - MOMENTS[:2]) / least)
        told.append(study.ratio_deviation.values[:2, 2])
    # a chance torque or correlation widens one in thirty
    np.testing.assert_allclose(np.median(told, axis=0), least, rtol=0.1)
    assert np.mean(np.array(told) < 1.1 * least) > 0.9
    # of 80 errors of which two and two are correlated, the mean square is 1 +- .2
    assert 0.5 < np.mean(np.square(off)) < 1.6


@pytest.mark.parametrize("name", fits.GAUGES)
def test_what_the_data_show_is_told(name):
    row = fits.gauge_of(name)
    assert row["right"], row


@pytest.mark.slow
@pytest.mark.parametrize(("law", "least"), [(fits.LAWS[0], 0.92), (fits.LAWS[1], 0.88)])
def test_intervals_cover_the_truth(law, least):
    """40 records of 11 parameters, correlated: +- 2.5 %; `python -m bench fits` has 200."""
    rows = [fits.fit_one(seed, law, trials=30) for seed in range(40)]
    inside = np.abs([row["off"] for row in rows]) < 1.96
    assert least < inside.mean() < 0.995
    assert np.mean([row["is_listed"] for row in rows]) >= (0.97 if law == fits.LAWS[0] else 0.9)
    told = np.mean([row["told"] for row in rows])
    assert told < 0.15 if law == fits.LAWS[0] else told > 0.8
