"""Multilevel Monte Carlo: its formulas, its coupling, and means that are known.

A free body in a bath, where no step has an error in |L|^2; and a heavy one that starts in thermal
equilibrium and stays there, where every step has one in the energy.
"""

import math

import numpy as np
import pytest
from scipy import stats

import rigidmc as rm
from bench.multilevel import equilibrium
from rigidmc.errors import OptionError
from rigidmc.runs.prepare import prepare_scene
from rigidmc.studies.framework import tasks
from rigidmc.studies.framework.variables import describe
from rigidmc.studies.multilevel import levels as levels_module
from rigidmc.studies.multilevel.corrections import (
    SAMPLING,
    Level,
    cheapest_plain,
    estimate_levels,
    interval_cost,
    members_for_goal,
)
from rigidmc.studies.multilevel.levels import APART, TASKS, state_after, sums, task_number
from rigidmc.studies.multilevel.picture import multilevel_levels
from rigidmc.studies.multilevel.study import dataset, make_setup, multilevel, plain_members, table

SCENE, TRUTH = equilibrium()
MEASURE = "mean(energy_final)"


def made(means, variances, members=1e4, steps=10):
    each = enumerate(zip(means, variances, strict=True))
    return [Level(i, steps << i, members, 0.0, m, v * (members - 1.0)) for i, (m, v) in each]


def falling(order, count=4):
    """Levels of paths whose error is 1 at first and falls with an order; the truth is 2."""
    errors = 2.0 ** (-order * np.arange(count))
    return made([3.0, *np.diff(errors)], 4.0 ** -np.arange(count)), errors[-1]


def test_the_error_of_the_step_is_taken_out_or_told():
    levels, left = falling(2.0)
    found = estimate_levels(levels, 2.0, 0.95)
    assert found.value == pytest.approx(2.0, abs=1e-14) and found.bias < 1e-14
    assert found.order == pytest.approx(2.0) and found.variance_order == pytest.approx(2.0)
    assert sum(one.mean for one in levels) == pytest.approx(2.0 + left)
    for order in (0.5, 1.0, 1.5):  # a measure that is not smooth
        levels, _ = falling(order)
        found = estimate_levels(levels, 2.0, 0.95)
        assert found.order == pytest.approx(order)
        assert found.bias == pytest.approx(1.96 * abs(found.value - 2.0), rel=1e-4)


@pytest.mark.parametrize("unit", [1e-20, 1.0, 1e20])
def test_corrections_of_rounding_tell_no_order(unit):
    """Of an exact integrator, whose corrections grew: 1.4e-17 and -6.4e-17 of 1.78."""
    variances = [unit**2 * x for x in (1e-3, 1e-36, 1e-36)]
    rounded = made([unit * x for x in (1.78, 1.4e-17, -6.4e-17)], variances)
    found = estimate_levels(rounded, 2.0, 0.95)
    assert np.isnan(found.order) and found.bias < 1e-15 * found.value
    seen = made([unit * x for x in (1.78, 1e-9, 4e-9)], variances)
    assert estimate_levels(seen, 2.0, 0.95).bias == np.inf  # which no rounding makes


def with_members(levels, counts):
    each = zip(levels, counts, strict=True)
    return [one._replace(members=n, squares=one.variance * (n - 1.0)) for one, n in each]


def test_members_are_those_that_cost_least():
    levels, half = falling(2.0)[0], 0.01
    wanted = members_for_goal(levels, 2.0, half / SAMPLING, 0.95)
    assert list(wanted) == sorted(wanted, reverse=True)  # few make short steps
    enough = with_members(levels, wanted)
    assert estimate_levels(enough, 2.0, 0.95).sampling == pytest.approx(half, rel=1e-3)
    some = np.random.default_rng(1)
    for _ in range(20):  # others cost more for the same interval
        moved = with_members(levels, wanted * some.uniform(0.5, 2.0, 4))
        more = (estimate_levels(moved, 2.0, 0.95).sampling / half) ** 2
        assert sum(one.cost for one in moved) * more > sum(one.cost for one in enough)


def test_what_plain_members_cost():
    """V = 1 and an error of h^2 / 100: the least of (n + 24) z^2 / (w^2 - (z / n^2)^2)."""
    levels, half = falling(2.0)[0], 0.001
    n = np.arange(10, 10_000)
    off = 1.95996 * (10.0 / n) ** 2
    best = ((n + 24.0) * 1.95996**2 / np.maximum(half**2 - off**2, 1e-99)).min()
    assert cheapest_plain(levels, 2.0, half, 0.95).cost == pytest.approx(best, rel=1e-3)
    orders = np.log10([cheapest_plain(levels, 2.0, 1e-6 * f, 0.95).cost for f in (1.0, 10.0)])
    assert orders[0] - orders[1] == pytest.approx(2.5, abs=0.01)
    costs = [interval_cost(levels, 2.0, half, 0.95) for half in (1e-6, 1e-5)]
    assert costs[0] / costs[1] == pytest.approx(100)


def test_the_width_covers_errors_of_the_step():
    """As the formula of the width promises, for a normal estimate that is off by b errors."""
    for off in np.arange(0.0, 3.0, 0.1):
        half = 1.95996 * math.hypot(1.0, off)
        share = stats.norm.cdf(half - off) - stats.norm.cdf(-half - off)
        assert share > 0.9495  # measured 0.9499
        assert off > 0.5 or share < 0.955


def test_batches_add_up_to_the_whole():
    values = np.random.default_rng(2).normal(5.0, 0.1, (7, 100))
    level = Level(1, 10)
    for part in values:
        level = level.with_more(100.0, 0.0, part.mean(), ((part - part.mean()) ** 2).sum())
    assert level.mean == pytest.approx(values.mean(), rel=1e-14)
    assert level.variance == pytest.approx(values.var(ddof=1), rel=1e-12)


def request(batch=512, text=f"{MEASURE} +- 0.1", scene=SCENE, most=10**12, **settings):
    scene, words = multilevel.design(scene, text, most, batch, **settings)
    return make_setup(prepare_scene(scene), **words)


def same(one, other):
    return all(a[k] == b[k] for a, b in zip(one, other, strict=True) for k in a)


def test_a_task_depends_on_its_number_alone():
    numbers = [task_number(1, 2), task_number(1, 3), task_number(0, 0), task_number(1, 5)]
    one = [sums(request(), [number], 1)[0] for number in numbers]
    assert same(one, sums(request(), numbers, 2))
    assert not same(one, sums(request(seed=2), numbers, 1))


@pytest.mark.filterwarnings("ignore::rigidmc.errors.SceneWarning")  # of long steps
def test_fine_paths_are_members_of_the_scene_and_levels_share_none():
    settings = {"dt": 0.4, "every": 4.0, "save": ("energy",), "keep": "final"}
    fine = rm.simulate(SCENE, members=range(APART, APART + 512), **settings).energy_final.values
    first = rm.simulate(SCENE, members=512, **settings).energy_final.values
    assert abs(np.corrcoef(fine, first)[0, 1]) < 3.0 / math.sqrt(512)
    settings["dt"] = 0.8
    coarse = rm.simulate(SCENE, members=range(APART, APART + 512), **settings).energy_final.values
    (found,) = sums(request(), [task_number(1, 0)], 1)
    assert found["mean"] == pytest.approx(fine.mean() - coarse.mean(), abs=0.2)
    assert found["squares"] / 511 < 0.2 < (fine - coarse).var()  # measured 0.17 and 1.9


def spreads(levels=(0, 1, 2, 3)):
    each = sums(request(4096), [task_number(level, 0) for level in levels], 1)
    return np.array([one["squares"] / 4095 for one in each])


@pytest.mark.slow
def test_the_coupling_makes_corrections_small(monkeypatch):
    v = spreads()
    assert v[1] < 0.2 * v[0]  # measured 0.15
    assert (v[1:-1] / v[2:] > 3.4).all()  # measured 4.2 and 3.9

    # coarse paths with noise of their own
    monkeypatch.setattr(levels_module.PreparedRun, "with_paired_noise", lambda run: run)
    broken = spreads((2, 3))
    assert (broken > v[0]).all()  # measured 1.8 times: paths that share no more than their start


@pytest.mark.slow  # 12 s; below is a mean without an error of the step
def test_a_mean_in_thermal_equilibrium():
    """Which the first level alone misses by far."""
    found = rm.multilevel(SCENE, f"{MEASURE} +- 0.01")
    assert found.attrs["reached"] == 1 and float(found.half[-1]) <= 0.01
    assert abs(float(found.value) - TRUTH) < 0.01  # measured 0.0012
    assert abs(float(found["mean"][0]) - TRUTH) > 10.0 * float(found.error[0])  # measured 22 times
    assert found.value.attrs["units"] == "J" and found.variance.attrs["units"] == "J2"
    again = rm.multilevel(SCENE, f"{MEASURE} +- 0.01", threads=2)
    assert again.equals(found)


# steps so short that all levels have the same two programs
FREE = rm.Scene(
    SCENE.body, (rm.Gravity(0.0), rm.Bath(0.5, 0.7)), rm.Start(omega=(1.0, 2.0, 0.5))
).with_run(integrator="strang", dt=0.1, t_end=4.0, seed=1)


@pytest.mark.filterwarnings("ignore::rigidmc.errors.SceneWarning")  # of no gravity
def test_a_free_body_in_a_bath():
    """<|L|^2> = |L_0|^2 e^(-2 gamma t) + kT (I_1 + I_2 + I_3)(1 - e^(-2 gamma t)) for any step."""
    found = rm.multilevel(FREE, "mean(l2_final) +- 0.05")
    left = math.exp(-2.0 * 0.5 * 4.0)
    truth = (1.0 + 2.8**2 + 1.0) * left + 0.7 * 4.4 * (1.0 - left)
    assert abs(float(found.value) - truth) < 0.05  # measured 0.029
    assert (np.abs(found["mean"][1:]) < 3.5 * found.error[1:]).all()  # measured 0.33


def driven(known, means, spread=1.0):
    """(how far a study is at the end, the numbers of its tasks, its lines) by corrections."""
    found, numbers, lines = {}, [], []
    while (now := state_after(known, found)).next:
        numbers += now.next
        lines.append(now.line)
        for number in now.next:
            level = number // TASKS
            squares = 512.0 * (spread if level == 0 else 0.01 * spread * 0.25**level)
            some = {"members": 512.0, "flagged": 0.0, "without": 0.0, "squares": squares}
            found[number] = {**some, "mean": means(level)}
    return now, numbers, lines


def test_levels_are_added_until_the_error_of_the_step_is_small():
    known = request(text=f"{MEASURE} +- 1e-2")
    now, numbers, _ = driven(known, lambda level: 0.5**level * 0.1)  # of order 1
    assert len(now.levels) > 4 and now.estimate.bias < 0.01
    assert len(set(numbers)) == len(numbers)
    with pytest.raises(OptionError, match=r"order 0\.5 .*extremes"):
        driven(known, lambda level: 0.5 ** (0.5 * level))


def test_what_a_goal_costs_is_told_by_the_pilot():
    _, _, lines = driven(request(text=f"{MEASURE} +- 0.02"), lambda level: 0.25**level)
    assert lines[0] == "" and "by sampling" in lines[1] and "members" in lines[1]
    with pytest.raises(OptionError, match=r"needs about .* more than the limit of 1e"):
        driven(request(text=f"{MEASURE} +- 1e-6", most=10**9), lambda level: 0.25**level)
    late = request(text=f"{MEASURE} +- 0.01", most=3 * 10**6)
    now, _, _ = driven(late, lambda level: 0.5**level)
    assert now.short.startswith("needs about") and not now.next
    assert dataset(late, now, now.estimate).attrs["reached"] == 0


@pytest.mark.filterwarnings("ignore::rigidmc.errors.SceneWarning")  # of no gravity
def test_run_directory(tmp_path):
    """The same study from a run directory whose tasks are computed in two goes."""
    text = "mean(l2_final) +- 0.03"
    design = multilevel.design(FREE, text)
    directory = multilevel.work.create("multilevel", design, None, tmp_path / "run")
    with pytest.raises(rm.RigidmcError, match="no task is finished"):
        multilevel.of(directory.path)
    directory, done = tasks.resume_study(directory, threads=1, only=range(2))
    assert done["ok"] == 2
    with pytest.raises(rm.RigidmcError, match="1 task of the first round is missing"):
        multilevel.of(directory.path)
    directory, done = tasks.resume_study(directory, threads=2)
    assert tasks.verify_study(directory.path, spot=1) == []
    found, plain = multilevel.of(directory.path), rm.multilevel(FREE, text, threads=1)
    assert done["ok"] > 2 and found.identical(plain)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"text": "p(energy_final > 0) +- 0.1"}, "corrections that do not become small"),
        ({"text": "mean(energy_final | l2_final > 1) +- 0.1"}, "energy_final"),
        ({"text": "mean(energy_final)"}, "half the width"),
        ({"turn": 0.1, "scene": SCENE.with_run(dt=None)}, "a fixed step"),
        ({"points": "sobol"}, "independent"),
        ({"integrator": "auto", "tolerance": 1e-3}, "name it"),
        ({"batch": 1}, "batch"),
    ],
)
def test_what_is_no_study_is_refused(settings, words):
    with pytest.raises(rm.RigidmcError, match=words):
        request(**settings)


@pytest.mark.filterwarnings("ignore::rigidmc.errors.SceneWarning")  # of no gravity
def test_flagged_pairs_are_refused():
    with pytest.raises(rm.SceneError, match="flagged because their steps are too long"):
        rm.multilevel(FREE, "mean(l2_final) +- 0.1", batch=512, turn_limit=0.01)


def test_table_and_picture():
    known = request(text=f"{MEASURE} +- 0.02")
    now, _, _ = driven(known, lambda level: 0.25**level)
    found = describe(dataset(known, now, now.estimate), SCENE)
    lines = table(found)
    assert lines[1].startswith("  mean(energy_final) = ") and "order 2.00" in lines[-2]
    assert "times as much" in lines[-1]
    assert plain_members(found, 0.02).steps > 5
    figure = multilevel_levels(found)
    assert [axes.get_xlabel()[:5] for axes in figure.axes] == ["level", "level", "cost:"]
