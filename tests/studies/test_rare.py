"""Rare events: a Gaussian tail, a chain whose law is known by quadrature, run directories."""

import functools

import numpy as np
import pytest
from scipy.stats import norm

import rigidmc as rm
from bench.problems.rare_truths import LEVEL, bathed, passed, spun
from rigidmc.errors import FileError, NoRoom, OptionError, SceneWarning
from rigidmc.runs.prepare import prepare_scene
from rigidmc.runs.segments import SegmentedRun
from rigidmc.studies.framework import tasks
from rigidmc.studies.framework.variables import describe
from rigidmc.studies.rare import methods
from rigidmc.studies.rare.picture import rare_curve
from rigidmc.studies.rare.score import make_score
from rigidmc.studies.rare.study import RareOptions, rare, reduce, table

# the steps of the chain are those of its quadrature, however long
pytestmark = pytest.mark.filterwarnings("ignore::rigidmc.errors.SceneWarning")


def test_gaussian_tail():
    p = 1e-9
    found = rare(spun(), f"p(omega_max[3] >= {norm.isf(p):.17g})", 1e-12, 1000, 16)
    assert found.p_low < p < found.p_high
    assert abs(float(found.p) / p - 1.0) < 0.4  # measured 0.01
    assert float(found.gain) > 1e5  # measured 4e5
    low = rare(spun(), f"p(omega_min[3] <= {-norm.isf(1e-4):.17g})", 1e-9, 400, 8)
    assert low.p_low < 1e-4 < low.p_high


def test_walks_keep_the_condition(monkeypatch):
    """Walks that take every step leave the event again, and the tail comes out too thin."""
    found = rare(spun(), f"p(omega_max[3] >= {norm.isf(1e-6):.17g})", 1e-12, 400, 4)
    assert 3e-7 < float(found.p) < 3e-6  # measured 1.1e-6

    def taken(made, z, scores, level, members, pace, number):
        z = made.normals(members, "broken", number)
        return z, made.scores(z), pace

    monkeypatch.setattr(methods, "_walked", taken)
    broken = rare(spun(), f"p(omega_max[3] >= {norm.isf(1e-6):.17g})", 1e-12, 400, 4)
    assert not 1e-7 < float(broken.p) < 1e-5


SELDOM = [pytest.param(one, marks=pytest.mark.slow) for one in ("first", "grid", "splitting")]


@pytest.mark.parametrize("place", ["last", *SELDOM])
def test_rows_of_tables_and_grids(place):
    """Members walk and branch with the row that they have, in whatever order the rows are."""
    thrown = rm.Start(momentum=(0.0, 0.0, rm.normal(0.0, 1.0)))
    if place == "splitting":  # most of those that pass began as the fourth
        spin = np.tile([0.0, -0.3, -0.3, 0.6], 50)
        bath = rm.Scene(rm.Body((1.0, 1.0, 2.0)), rm.Bath(0.7, 1.0), rm.Start(omega=(0, 0, spin)))
        scene = bath.with_run(integrator="strang", dt=0.1, t_end=4.0, checks=False)
        level = 4.0 * 0.5**0.5
        truth = np.mean([passed(level, start=s) for s in spin[:4]])
    else:
        moments = np.full(1000, 1.9)
        moments[slice(100) if place == "first" else slice(900, 1000)] = 1.4
        of_grid = rm.grid(1.4, 1.9, 50)
        body = rm.Body((1.0, 1.0, of_grid if place == "grid" else moments))
        scene, level = rm.Scene(body, start=thrown).with_run(dt=0.1, t_end=0.1), 3.0
        truth = norm.sf(level * (of_grid.values() if place == "grid" else moments)).mean()
    found = rare(scene, f"p(omega_max[3] >= {level:.17g})", 1e-9, 400, 16)
    assert found.p_low < truth < found.p_high
    assert abs(float(found.p) / truth - 1.0) < 0.5  # measured 0.1


@pytest.mark.slow
def test_the_mean_of_many_repetitions():
    """15 s: the bias of subsets is far below their spread."""
    found = rare(spun(), f"p(omega_max[3] >= {norm.isf(1e-6):.17g})", 1e-12, 1000, 800)
    error = float(found.probability.std(ddof=1)) / 800**0.5
    # measured 1.03 and 0.015 of 1e-6
    assert abs(float(found.p) - 1e-6) < 3.0 * error
    assert error < 0.03e-6


@pytest.mark.slow
def test_tables_of_any_order():
    """30 s: of 36 tables of 1,000 bodies, with a share of 0.1 to 50 % that is nearer, in three
    orders, intervals of 95 % cover 33 or more."""
    rng, covered = np.random.default_rng(5), 0
    for share in (0.5, 0.1, 0.03, 0.01, 0.003, 0.001):
        for order in ("first", "last", "random"):
            for level in (2.5, 3.0):
                near = np.where(np.arange(1000) < 1000 * share, 0.5, 0.0)
                near = {"first": near, "last": near[::-1].copy(), "random": rng.permutation(near)}
                torque = rm.BodyTorque((0.0, 0.0, rm.normal(0.0, 1.0)))
                start = rm.Start(omega=(0.0, 0.0, near[order]))
                scene = rm.Scene(rm.Body((1.0, 1.0, 2.0)), torque, start)
                run = {"dt": 0.1, "t_end": 1.0, "seed": int(rng.integers(10**6))}
                found = rm.rare(scene, f"p(omega_max[3] >= {level})", **run)
                truth = norm.sf(2.0 * (level - near[order])).mean()
                covered += bool(found.p_low <= truth <= found.p_high)
    assert covered >= 33  # measured 35


def test_nothing_found_is_no_zero():
    """Members that all score the same are plain ones, none of which has the event."""
    scene = rm.Scene(
        rm.Body((1.0, 2.0, 3.0)), start=rm.Start(omega=(1.0, rm.normal(0.0, 0.0675), 0.0))
    ).with_run(integrator="exact", dt=0.25, t_end=20.0)
    truth = 2.0 * norm.sf(12**-0.5 / 0.0675)  # it turns if |L_2| is above |L|/2 at the start
    with pytest.warns(SceneWarning, match="found no path to the event: all members score"):
        found = rare(scene, "p(flips >= 1)", 1e-9, 100, 4)
    assert float(found.p) == 0.0 and found.stuck.all()
    assert round(400.0 * float(found.p_high), 1) == 3.7 and truth < float(found.p_high)
    assert "no path to the event" in table(found)[2]
    # all repetitions end at the target
    deep = rare(spun(), "p(omega_max[3] >= 7)", 1e-5, 100, 4)
    assert deep.below_target.all() and float(deep.p_high) == 1e-5
    # members that die out above the event: an end of 0, with levels
    one = {"p": 0.0, "levels": np.array([1.0]), "shares": np.array([0.25]), "steps": 1.0}
    gone = {i: {**one, "flagged": 0, "deep": False} for i in range(4)}
    designed, request = rare.design(spun(), "p(omega_max[3] >= 4)", 1e-9, 100, 4)
    designed = prepare_scene(designed)
    died = describe(reduce(designed, request, gone, RareOptions(), 1), designed.scene)
    assert float(died.p_high) > 3.0 / 400.0 and "came no nearer" in table(died)[2]
    gone[0] = {**gone[0], "p": 1e-3}
    some = describe(reduce(designed, request, gone, RareOptions(), 1), designed.scene)
    assert "3 of 4 repetitions found no path" in table(some)[2]


def test_splitting(monkeypatch):
    p = passed()
    assert p == pytest.approx(5.4721e-6, rel=1e-4)
    of = f"p(omega_max[3] >= {LEVEL:.17g})"
    found = rare(bathed(), of, 1e-9, 300, 8)
    assert found.p_low < p < found.p_high
    assert float(found.gain) > 100.0  # measured 300 and more

    def copies(self, ended, parents, level):  # without noise of their own
        self.states[:, ended] = self.states[:, parents]
        self.scores[:, ended] = self.scores[:, parents]

    monkeypatch.setattr(methods.SplittingPaths, "branch", copies)
    broken = rare(bathed(), of, 1e-9, 300, 8)
    assert float(broken.p) == 0.0 or not broken.p_low < p < broken.p_high


@pytest.mark.slow  # 8 s, half of it to compile
def test_events():
    """How often and when an event happens are one question; its score leads there."""
    cone = rm.Passage(axis=3, angle=0.6)
    scene = rm.Scene(
        rm.Body((1.0, 1.6, 2.0), mass=1.0, centre=(0.0, 0.0, -0.5)),
        (rm.Gravity(9.81), rm.Bath(1.0, 0.3)),
        rm.Start(omega=(0.0, 0.0, 0.0)),
        observables=(cone,),
    ).with_run(integrator="strang", dt=0.05, t_end=4.0, save=("passage",))
    often = rare(scene, "p(passages >= 1)", 1e-9, 300, 4)
    first = rare(scene, "p(passage_first < 4)", 1e-9, 300, 4)
    widest = rare(scene, "p(nutation_max >= 0.6)", 1e-9, 300, 4)
    assert often.probability.values.tolist() == first.probability.values.tolist()
    assert often.p_low < widest.p_high and widest.p_low < often.p_high
    plain = rm.simulate(scene, members=20_000).passages.values
    assert abs((plain >= 1).mean() - float(often.p)) < 3.0 * float(often.p_high - often.p_low)
    with pytest.raises(OptionError, match="the run ends at t_end"):
        make_score(scene, "p(passage_first < 5)")


def test_run_directory(tmp_path):
    """The repetitions of a run directory are those of a study now, to the bit, on any threads."""
    scene, of = bathed(), "p(omega_max[3] >= 2.2)"
    now = rare(scene, of, 1e-6, 100, 3, threads=2)
    designed, request = rare.design(scene, of, 1e-6, 100, 3)
    directory = rare.work.create("rare", (designed, request), None, tmp_path / "run")
    with pytest.raises(FileError, match="no task is finished yet"):
        rare.of(directory.path)
    directory, done = tasks.resume_study(directory, threads=1, only=range(2))
    assert done["ok"] == 2 and rare.of(directory.path).sizes["repetition"] == 2
    assert "1 repetition is missing" in table(rare.of(directory.path))[-1]
    directory, done = tasks.resume_study(directory, threads=2)
    assert done["ok"] == 1 and tasks.verify_study(directory.path, spot=1) == []
    assert rare.of(directory.path).identical(now)
    with pytest.raises(FileError, match="rigidmc rare"):
        rm.open(directory.path)
    shard = next(iter(directory.shards().values()))
    with open(shard, "r+b") as file:
        file.seek(2000)
        file.write(b"torn")
    assert "was changed: its checksum" in tasks.verify_study(directory.path)[0]


def test_what_is_no_event():
    for of, rule in (
        ("mean(omega_max[3])", "is not an event"),
        ("p(omega_max[3] >= 1 | omega_min[3] >= 0)", "is not an event"),
        ("p(energy_drift_max >= 1)", "is not monitored"),
    ):
        with pytest.raises(OptionError, match=rule):
            make_score(spun(), of)
    with pytest.raises(OptionError, match="a quantity that only grows"):
        make_score(bathed(), "p(omega_mean[3] >= 1)")
    still = rm.Scene(rm.Body((1.0, 1.0, 2.0)), start=rm.Start(omega=(0.0, 0.0, 1.0)))
    with pytest.raises(OptionError, match="nothing is random"):
        rare(still, "p(omega_max[3] >= 1)")
    with pytest.raises(OptionError, match="between 0 and 1"):
        rare(spun(), "p(omega_max[3] >= 1)", 2.0)


def test_table_and_picture():
    found = rare(spun(), "p(omega_max[3] >= 4)", 1e-9, 100, 4)
    assert "subset simulation: 4 repetitions of 100 members" in table(found)[2]
    figure = rare_curve(found)
    assert figure.axes[0].get_yscale() == "log" and len(figure.axes[0].lines) >= 4
    deep = rare(spun(), "p(omega_max[3] >= 7)", 1e-5, 100, 4)
    assert "is less than 1e-05, the target" in table(deep)[1] and float(deep.p) == 0.0


def test_members_without_room_are_refused():
    """129 states of each member, and a copy, of some 50 rows: 100 kB a member."""
    with pytest.raises(NoRoom, match="use fewer members"):
        rare(bathed(), f"p(omega_max[3] >= {LEVEL:.17g})", 1e-9, 10**9, 2)


def test_members_may_branch_at_the_end():
    """Parents that pass a level in the last part of the run: their copies have nothing to go."""
    scene, score = make_score(bathed(), f"p(omega_max[3] >= {LEVEL:.17g})")
    paths = methods.SplittingPaths(SegmentedRun(scene.with_run(seed=1), 8, 1), score, 40)
    paths.scores[:-1], paths.scores[-1] = -1.0, 1.0
    paths.branch(np.array([0, 1]), np.array([5, 6]), 0.5)
    assert np.array_equal(paths.states[:, :2], paths.states[:, 5:7])


@functools.cache
def flips_of(unit):
    """The study of flips of a body of about `unit` kg m2."""
    body = rm.Body((unit, 2.0 * unit, 3.0 * unit))
    start = rm.Start(omega=(rm.normal(0.0, 1e-3), 1.0, 0.0))
    run = {"integrator": "exact", "dt": 0.2, "t_end": 8.0}
    return rare(rm.Scene(body, start=start), "p(flips >= 1)", 1e-9, 60, 2, **run)


@pytest.mark.parametrize("unit", [pytest.param(2.0**-66, marks=pytest.mark.slow), 2.0**66])
def test_the_unit_of_a_level_decides_nothing(unit):
    """The level of a flip is a momentum: bodies of 1e-20 and 1e20 kg m2 have the same scores."""
    one, two = flips_of(1.0), flips_of(unit)
    for name in ("p", "probability", "score", "share", "member_steps"):
        assert np.array_equal(one[name], two[name], equal_nan=True), name
    assert one.score.max() < 1.0  # no member has flipped: measured 0.52
    assert float(one.p) == 0.0  # at 5 standard deviations a flip takes more than 8 s


def test_near_the_event_is_not_the_event():
    """A level of 1e-17 of the scale rounds to the next count, which only the event may reach."""
    _, score = make_score(rm.Scene.load("dzhanibekov"), "p(flips >= 1)")
    sized = score.sized(np.array([np.inf, 2.0, 1e-17]))
    scores = sized.graded(np.array([0.0, 0.0, 1.0]), np.array([np.inf, 1e-17, np.inf]))
    assert sized.scale == 2.0 and sized.reached(scores).tolist() == [False, False, True]
