"""The study of what accuracy costs: correct rows, the cheapest choice, predictions.

The predictions hold for other members.
"""

import numpy as np
import pytest
from matplotlib.colors import to_rgb

import rigidmc as rm
from rigidmc.inputs.amounts import two_digits
from rigidmc.physics.integrators import INTEGRATORS
from rigidmc.planning.tolerance.deviation import drift_along, errors
from rigidmc.planning.tolerance.pilot import integrate_pilot, pilot
from rigidmc.planning.tolerance.truth import make_reference
from rigidmc.studies.accuracy import drift, picture
from rigidmc.studies.accuracy import work_precision as accuracy
from rigidmc.views.figures import STYLES
from tests.tools.axes import faults
from tests.tools.scenes import LAGRANGE, TILTED

SCENE = LAGRANGE.with_run(t_end=3.0, every=0.5, save=("omega", "attitude"))
CHOSEN = ("rk4", "rk8", "chin4", "closed")
ORDERS = {"rk4": 4, "rk8": 8, "chin4": 4}


@pytest.fixture(scope="module")
def study():
    told = list[str]()
    found = rm.accuracy(SCENE, CHOSEN, (1e-3, 1e-5, 1e-8, 1e-15), members=64, progress=told.append)
    # how far it is, before the first wait and after each ladder
    assert told[0].startswith("first the truth for 64 members")
    assert all(f"; {k} of 5, about" in line for k, line in enumerate(told[2:], 1)) and len(told) > 6
    return found


def rows(study, name, dtype="float64"):
    return study.isel(row=(study.integrator.values == name) & (study["dtype"].values == dtype))


def test_every_integrator_has_its_ladder(study):
    assert set(study.integrator.values) == set(CHOSEN)
    for name, order in ORDERS.items():
        found = rows(study, name)
        error, steps = found.error_state_median.values, found.steps.values
        assert (np.diff(steps) > 0).all()
        seen = (error < 1e-3) & (error > 1e-11)
        slope = np.polyfit(np.log(steps[seen]), np.log(error[seen]), 1)[0]
        assert slope == pytest.approx(-order, abs=0.3)  # -4.00, -7.96, -4.01
    assert rows(study, "rk4", "float32").sizes["row"] > 0
    assert (rows(study, "rk4", "float32").error_state_worst.values > 1e-7).all()


def test_errors_are_ordered_and_of_what_they_say(study):
    for quantity in ("state", "momentum", "attitude", "energy", "l2", "lz"):
        median, p99, upper, worst = (
            study[f"error_{quantity}_{word}"].values for word in ("median", "p99", "upper", "worst")
        )
        # a closed form conserves energy to a rounding that nobody measured here
        known = ~np.isnan(median)
        assert known.all() or set(study.integrator.values[~known]) == {"closed"}
        assert (median <= p99)[known].all()
        assert (p99 <= worst)[known].all()
        assert (upper <= worst)[known].all()
    both = np.maximum(study.error_momentum_worst, study.error_attitude_worst)
    assert np.array_equal(study.error_state_worst, both)
    found = pilot(SCENE, 64)
    states = integrate_pilot(found, "rk4", int(rows(study, "rk4").steps[2]))
    apart = errors(found, states, make_reference(found).states)["state"]
    assert rows(study, "rk4").error_state_median.values[2] == np.median(apart)
    assert (rows(study, "chin4").error_lz_worst.values < 1e-12).all()  # a kick by gravity keeps L_z


def test_the_cheapest_is_the_cheapest(study):
    upper, cost = study.error_state_upper.values, study.ns_per_member.values
    for tolerance, row in zip(study.tolerance.values, study.cheapest.values, strict=True):
        able = np.flatnonzero(upper <= tolerance)
        assert row == (able[np.argmin(cost[able])] if len(able) else -1)
    assert study.cheapest.values[-1] == -1  # 1e-15: nobody
    assert np.allclose(study.members_per_second * study.ns_per_member, 1e9 * study.attrs["threads"])


def test_the_table_says_it(study):
    lines = accuracy.ladder_table(study)
    words = "truth: closed form of the Lagrange top, which rk8 confirms, known to "
    assert lines[0].startswith(words)
    assert lines[1].startswith("for 1e-03: ")
    assert lines[2].startswith("for 1e-05: ")
    assert "members/s" in lines[2]
    assert lines[4].startswith("for 1e-15: none; the best reaches ")
    assert "in no member exponentially" in lines[5]


def test_predictions_of_error_hold_for_others(study):
    """The 99 % error of 64 members and that of 600 others agree within a factor of 2."""
    others = pilot(SCENE, 600, first=1000)
    true = make_reference(others)
    for name, steps in (("rk4", 192), ("rk8", 48), ("chin4", 96)):
        found = rows(study, name)
        near = int(np.argmin(np.abs(found.steps.values - steps)))
        states = integrate_pilot(others, name, int(found.steps[near]))
        apart = errors(others, states, true.states)["state"]
        # 0.69, 0.96, 1.21
        assert 0.5 < np.quantile(apart, 0.99) / found.error_state_p99.values[near] < 2.0


@pytest.mark.slow
def test_members_of_different_speed_step_on_their_own():
    start = rm.Start(omega=(rm.normal(0.0, 2.0), 0.1, 0.1), attitude="uniform")
    wide = rm.Scene(SCENE.body, SCENE.effects, start)
    found = rm.accuracy(wide.with_run(t_end=3.0), ("rk4",), (1e-3, 1e-6), members=64)
    assert np.isfinite(found.turn.values).all()
    assert " at turn " in accuracy.ladder_table(found)[2]
    order = np.polyfit(np.log(found.turn), np.log(found.error_state_median), 1)[0]
    assert order > 2.0  # rows of float32 bend it


def test_gains_are_over_what_was_tried(study):
    """Of 1e-8: rk4 reaches it, does not (in one step), or was not tried."""
    fast = int(np.flatnonzero(study.integrator.values == "rk8")[0])
    assert "x cheaper than rk4" in accuracy._gain(study, fast, 1e-5)
    assert accuracy._gain(study, fast, 1e-15) == "; rk4 does not reach it"
    without = study.isel(row=study.integrator.values != "rk4")
    assert accuracy._gain(without, 0, 1e-5) == ""


def test_failed_steps_have_errors_of_inf():
    for statistic in (np.median, np.max, lambda errors: np.quantile(errors, 0.99)):
        with np.errstate(invalid="ignore"):
            assert accuracy._finite_or_inf(statistic, np.array([1.0, np.inf, np.inf])) == np.inf
    assert accuracy._finite_or_inf(np.max, np.array([1.0, 3.0])) == 3.0


def test_counts_in_words():
    numbers = (0.5, 3.0, 99.4, 100.0, 999.0, 1e3, 1.26e3, 1e5, 3.4e6)
    words = ("0.5", "3", "99", "100", "999", "1 k", "1.3 k", "100 k", "3.4 M")
    assert tuple(map(two_digits, numbers)) == words


def test_what_cannot_be_studied(monkeypatch):
    fails = lambda first: pytest.fail("the truth takes seconds")  # noqa: E731
    monkeypatch.setattr(accuracy, "make_reference", fails)
    with pytest.raises(rm.OptionError, match=r"no such integrator; known: rk4, .*rk8"):
        rm.accuracy(SCENE, ("rk5",))
    effects = rm.Gravity(3.0), rm.ViscousDamping(0.1)
    damped = rm.Scene(SCENE.body, effects, TILTED).with_run(t_end=1.0)
    with pytest.raises(rm.OptionError, match=r"chin4.*viscous_damping"):
        rm.accuracy(damped, ("chin4",))


def test_growth_laws():
    steps = 2 ** np.arange(4, 21)
    some = np.random.default_rng(0)
    wobble = np.exp(0.1 * some.normal(size=steps.size))
    laws = {"bounded": 0.0, "sqrt": 0.5, "linear": 1.0, "faster than linear": 2.0}
    for law, power in laws.items():
        found, fitted = drift.growth_law(steps, 1e-12 * steps**power * wobble)
        assert found == law
        assert fitted == pytest.approx(power, abs=0.1)
    # rounding that does not matter
    assert drift.growth_law(steps, 1e-16 * steps**0.2)[0] == "bounded"
    assert drift.growth_law(steps, np.append(np.ones(16), np.inf))[0] == "failed"


def test_horizons():
    regular = accuracy._horizon(10.0, np.full(100, 1e3), np.zeros(100))
    assert regular["horizon_median"] == pytest.approx(10.0 / (accuracy.ROUNDING * 1e3))
    chaotic = accuracy._horizon(10.0, np.full(100, 1e3), np.full(100, 0.7))
    late = np.log(1.0 / (accuracy.ROUNDING * 1e3)) / 0.7
    assert chaotic["horizon_p01"] == pytest.approx(10.0 + late)


@pytest.fixture(scope="module")
def drifts():
    return drift.long_drift(SCENE, ("rk4", "chin4"), 40_000, 0.05, members=16)


def test_drift_over_many_steps(drifts):
    laws = dict(zip(drifts.integrator.values, drifts.energy_law.values, strict=True))
    assert laws == {"rk4": "linear", "chin4": "bounded"}
    assert (np.diff(drifts.energy_drift.values, axis=1) >= 0).all()  # the largest so far
    chin4 = drifts.energy_drift.values[1]
    assert chin4[-1] < 1.5 * chin4[8]  # no trend
    assert drifts.attrs["lz_conserved"] == "yes"
    assert drifts.attrs["l2_conserved"].startswith("no")
    lines = drift.long_table(drifts)
    assert lines[1].startswith("rk4 ")
    assert "(linear, power 1.0" in lines[1]
    assert "|L|^2" not in lines[1]


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["strang", "rotations", "chin4", "suzuki4", "srkn6", "srkn11", "aba864", "aba1064"]
)
def test_the_energy_of_splittings_is_bounded_over_ten_million_steps(name):
    found = drift.long_drift(rm.Scene.load("heavy_top"), (name,), 10_000_000, members=8)
    energy = found.energy_drift.values[0]
    early = energy[np.searchsorted(found.step.values, 2**17)]
    assert energy[-1] < 1.5 * early + 1e-16 * 1e7  # what each rounding can add


def test_every_integrator_has_its_own_style():
    assert list(STYLES) == list(INTEGRATORS)
    assert len(set(STYLES.values())) == len(INTEGRATORS)
    markers = {style[1] for style in STYLES.values()}  # also in grey
    assert len(markers) == len(INTEGRATORS), "add to MARKERS of rigidmc/views/figures.py"


def test_pictures(study, drifts):
    figure = picture.work_precision(study)
    assert faults(figure) == []
    (axes,) = figure.axes
    labels = axes.get_legend_handles_labels()[1]
    assert {"rk4", "rk8", "chin4", "closed", "rk4 in float32", "frontier"} <= set(labels)
    assert "members to the end per second" in axes.get_ylabel()
    assert "[rad]" in axes.get_xlabel() and axes.xaxis_inverted()
    (frontier,) = (line for line in axes.lines if line.get_label() == "frontier")
    assert np.ptp(to_rgb(frontier.get_color())) < 0.05  # grey
    figure = picture.long_drift(drifts)
    assert faults(figure) == []
    assert [a.get_xlabel() for a in figure.axes] == ["steps", "steps"]
    assert "rk4: linear" in figure.axes[0].get_legend_handles_labels()[1]


@pytest.mark.parametrize("unit", [2.0**-66, 2.0**66])
def test_errors_of_a_body_from_rest_are_pure_numbers(unit):
    """L_z of a pendulum that starts at rest is compared with the |L| of its swing, not with 1."""

    def found(unit):
        body = rm.Body((unit, unit, 0.5 * unit), mass=unit, centre=(0.0, 0.0, -0.3))
        scene = rm.Scene(body, rm.Gravity(9.81), rm.Start(omega=(0.0,) * 3, attitude=(0.3, 1.0, 0)))
        one = pilot(scene.with_run(t_end=3.0, members=4), 4, 0)
        return drift_along(one, "rk4", 64, [1, 8, 64], 3.0 / 64)

    one, two = found(1.0), found(unit)
    for name, values in one.items():
        assert np.array_equal(values, two[name]), name
    assert 1e-18 < one["lz"].max() < 1e-3  # measured 1e-16: of the |L| that the energies allow


def test_noise_has_no_accuracy():
    with pytest.raises(rm.SceneError, match="bath is random, so no single path is exact"):
        rm.accuracy(rm.Scene.load("brownian_rotor"))
