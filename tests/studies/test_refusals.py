"""Studies that move, copy or pair members, and the counts that studies take: what is refused before
the first step."""

import tomllib

import numpy as np
import pytest

import rigidmc as rm
from rigidmc.errors import NoRoom, OptionError, SceneError
from rigidmc.scene.sampling import is_sample, is_sample_of
from rigidmc.studies.accuracy import drift

BODY = rm.Body((1.0, 1.0, 2.0))
LAW = rm.normal(0.0, 1.0)
OF, GOAL = "p(omega_max[3] >= 2)", "mean(omega_max[3]) +- 0.1"
BATH = rm.Bath(0.5, 1.0)
STUDIES = {
    "multilevel": (BATH, lambda scene: rm.multilevel(scene, GOAL, integrator="strang")),
    "sensitivity": (None, lambda scene: rm.sensitivity(scene, "mean(omega_max[3])")),
    "basins": (None, lambda scene: rm.basins(scene, OF)),
    "until": (None, lambda scene: rm.simulate_until(scene, GOAL)),
}


def places(values):
    """(table and key, scene) for each place that may take numbers by the index of a member."""
    yield "body.moments", {"body": rm.Body((1.0, values, 2.0))}
    yield "body.mass", {"body": rm.Body((1.0, 1.0, 2.0), mass=values)}
    yield "start.omega", {"start": rm.Start(omega=(LAW, 0.0, values))}
    yield "start.momentum", {"start": rm.Start(momentum=(LAW, values, 0.0))}
    yield "start.attitude", {"start": rm.Start(omega=(LAW, 0, 0), attitude=(0.1, values, 0.2))}
    yield "effects.body_torque.size", {"effects": (rm.BodyTorque((0.0, 0.0, values)),)}


@pytest.mark.parametrize("study", STUDIES)
def test_what_goes_by_the_index_of_a_member_is_refused(study):
    more, ask = STUDIES[study]
    for values in (np.linspace(1.05, 1.5, 2000), rm.grid(1.05, 1.5, 50)):
        tables = isinstance(values, np.ndarray)
        if study == "until" and tables:
            continue  # its members are the first rows, and none is moved
        for name, parts in places(values):
            effects = parts.get("effects", ()) + ((more,) if more else ())
            start = parts.get("start", rm.Start(omega=(0.0, 0.0, LAW)))
            scene = rm.Scene(parts.get("body", BODY), effects, start)
            with pytest.raises(SceneError, match="is a table" if tables else "is a grid") as error:
                ask(scene)
            assert f"{error.value.table}.{error.value.key}" == name


def test_what_is_a_sample():
    """What is drawn, noise and tables are; a grid by itself and copies of one member are none."""
    drawn, rows = rm.Start(omega=(0.0, 0.0, LAW)), rm.Start(omega=(0.0, 0.0, np.arange(1.0, 5.0)))
    grid, one = rm.Start(omega=(0.0, 0.0, rm.grid(0.0, 1.0, 4))), rm.Start(omega=(0.0, 0.0, 1.0))
    for start, effects, sample in (
        (drawn, (), True),
        (rows, (), True),
        (grid, (), False),
        (one, (), False),
        (one, (BATH,), True),
        (grid, (rm.Gravity(LAW),), True),
        (rm.Start(omega=(0.0, 0.0, 1.0), attitude="uniform"), (), True),
        (rm.Start(omega=rm.Sphere(1.0)), (), True),
    ):
        scene = rm.Scene(BODY, effects, start)
        assert is_sample(scene.model) == sample == is_sample_of(tomllib.loads(scene.dumps()))
    with pytest.raises(rm.RigidmcError, match="nothing in the scene is drawn"):
        rm.simulate_until(rm.Scene(BODY, (), grid), GOAL)


def test_a_grid_has_no_intervals():
    """p of ten members of a grid was 0.5 (0.24 to 0.76)."""
    scene = rm.Scene(BODY, (), rm.Start(omega=(0.0, 0.0, rm.grid(0.0, 1.0, 10))))
    run = {"dt": 0.1, "t_end": 0.1, "save": ("omega_max",)}
    of = "p(omega_max[3] >= 0.5)"
    result = rm.simulate(scene, members=10, **run)
    for text, value in ((of, 0.5), ("mean(omega_max[3])", 0.5), ("median(omega_max[3])", 0.5)):
        found = result.rigid.measure(text)
        assert found.value == pytest.approx(value) and np.isnan(found[1:]).all()
    words = result.rigid.summary(of=of)
    assert "0.5" in words and "between" not in words
    summary = result.rigid.summary()
    assert "+-" not in summary and "members are not a sample" in summary
    part = result.isel(member=slice(2, 7))  # without some of its rows
    assert np.isnan(part.rigid.measure(of).low)
    drawn = rm.Scene(BODY, rm.BodyTorque((0.0, 0.0, LAW)), scene.start)
    assert np.isfinite(rm.simulate(drawn, members=40, **run).rigid.measure(of).low)
    axes = {"x": ("start.omega.3", 0, 1), "y": ("start.omega.1", 0, 1), "resolution": 4}
    for start, known in ((0.1, False), (LAW, True)):
        scene = rm.Scene(BODY, (), rm.Start(omega=(0.0, start, 0.0)))
        mapped = rm.stability_map(scene, **axes, of=of, members=2, dt=0.1, t_end=0.1)
        name = of.replace(" ", "")
        assert np.isfinite(mapped[name]).all()
        assert bool(np.isfinite(mapped[f"{name}_high"]).any()) == known


SCENE = rm.Scene(BODY, (), rm.Start(omega=(0.0, 0.0, LAW))).with_run(dt=0.1, t_end=0.1)
MANY = 10**12
COUNTS = {
    "rare": lambda: rm.rare(SCENE, OF, repetitions=MANY),
    "rare, members": lambda: rm.rare(SCENE, OF, members=MANY),
    "section": lambda: rm.section(SCENE, "omega[3] = 0", members=MANY),
    "frequencies": lambda: rm.frequencies(SCENE, "omega[3]", members=MANY),
    "sensitivity": lambda: rm.sensitivity(SCENE, "mean(omega_max[3])", MANY),
    "basins": lambda: rm.basins(SCENE, OF, MANY),
    "ftle": lambda: rm.ftle(SCENE, MANY),
    "lyapunov": lambda: rm.lyapunov(SCENE, members=MANY),
    "multilevel": lambda: rm.multilevel(
        rm.Scene(BODY, BATH), GOAL, batch=MANY, integrator="strang"
    ),
    "randomised": lambda: rm.estimate_rqmc(SCENE, OF, 8, MANY),
    "accuracy": lambda: rm.accuracy(SCENE, members=MANY),
    "drift": lambda: drift.long_drift(SCENE, members=MANY),
}


@pytest.mark.parametrize("study", COUNTS)
def test_counts_without_room_are_refused_before_the_first_step(study, monkeypatch):
    """rare took 19 GB for 1e9 repetitions before a word."""
    monkeypatch.setattr("rigidmc.runs.resources.free_memory", lambda: 2 * 10**12)
    with pytest.raises(NoRoom, match=r"1,000,000,000,000 .* of which 2000\.00 GB are free: use"):
        COUNTS[study]()


def test_a_run_directory_has_a_file_for_each_task(tmp_path, monkeypatch):
    monkeypatch.setattr("rigidmc.runs.resources.free_memory", lambda: None)
    design = rm.rare.design(SCENE, OF, 1e-9, 100, 2 * 10**7)
    with pytest.raises(OptionError, match="20,000,000 tasks are too many"):
        rm.rare.work.create("rare", design, None, tmp_path / "run")
    assert not (tmp_path / "run").exists()
