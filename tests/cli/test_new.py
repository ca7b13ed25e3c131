"""rigidmc new: what it writes can be checked, run and shown; questions; what it refuses."""

import warnings

import numpy as np
import pytest

import rigidmc as rm
from rigidmc.cli import new
from rigidmc.cli.new import read_numbers, read_sizes
from rigidmc.errors import OptionError
from rigidmc.mechanics.solids import SOLIDS
from rigidmc.views.new_scene import SIZES
from tests.tools.commands import invoke
from tests.tools.plans import notes_of, plan_of


def written(folder, *words, **more):
    file = folder / "my.toml"
    done = invoke("new", file, "--force", *words, **more)
    assert done.exit_code == 0, done.output
    return rm.Scene.load(file)


def test_every_solid_has_sizes():
    assert list(SIZES) == list(SOLIDS)


@pytest.mark.parametrize("solid", SOLIDS)
def test_a_scene_of_each_solid_is_valid_and_runs(tmp_path, solid):
    scene = written(tmp_path, "--solid", solid, "--members", 8, "--pivot", "0,0,-0.05")
    file = tmp_path / "my.toml"
    text = file.read_text("utf-8")
    lines = [line for line in text.splitlines() if "=" in line]
    assert all("#" in line for line in lines) and solid in text
    assert "valid, 8 members" in invoke("check", file).output
    plan = plan_of(scene)
    assert plan.notes == () and notes_of(scene, plan) == ()
    assert plan.angle < 0.4
    ds = rm.simulate(scene, threads=1)
    assert (ds.status == 0).all()
    assert float(ds.energy_drift_max.max()) < 1e-12  # measured 1.4e-13
    with warnings.catch_warnings():  # omega dt may exceed 1
        warnings.simplefilter("ignore", rm.SceneWarning)
        rough = rm.simulate(scene, threads=1, dt=8 * plan.grid.dt, every=scene.run.t_end)
    assert float(rough.energy_drift_max.max()) > 5e-11  # measured 9.1e-11 and more


def test_the_default_is_a_heavy_top_and_show_says_so(tmp_path):
    """Without a terminal nothing is asked: the command ends though nobody answers."""
    file = tmp_path / "top.toml"
    done = invoke("new", file)
    assert done.exit_code == 0 and f"wrote {file}" in done.stdout, done.output
    scene = rm.Scene.load(file)
    assert scene.title == "top" and scene.effects == (rm.Gravity(9.81),)
    assert np.allclose(scene.body.centre, (0.0, 0.0, 0.04))
    shown = invoke("show", file).output
    assert "effects: gravity(g = 9.81)" in shown and "omega (0, 0, normal(" in shown


def test_numbers_of_options_are_those_of_the_scene(tmp_path):
    words = ("--solid", "hollow_cylinder", "--size", "inner=0.02,outer=0.03,height=0.05")
    words += ("--mass", 0.3, "--pivot", "0,0,-0.1", "--spin", "1,-2,50", "--spread", 0)
    words += ("--lean", "uniform", "--gravity", 1.62, "--t-end", "3s", "--title", 'a "b"')
    scene = written(tmp_path, *words)
    body = rm.Body.solid("hollow_cylinder", mass=0.3, inner=0.02, outer=0.03, height=0.05)
    assert scene.body.moments == body.with_pivot((0.0, 0.0, -0.1)).moments
    assert scene.start.omega == (1.0, -2.0, 50.0) and scene.start.attitude == "uniform"
    assert scene.effects == (rm.Gravity(1.62),)
    assert (scene.run.t_end, scene.title) == (3.0, 'a "b"')
    box = written(tmp_path, "--solid", "box", "--size", "size=0.1,0.2,0.3", "--mass", 2)
    assert box.body.moments == rm.Body.box(2.0, (0.1, 0.2, 0.3)).moments and box.effects == ()
    free = written(tmp_path, "--moments", "1,3,2", "--members", "2e3")
    assert free.body.moments == (1.0, 3.0, 2.0) and free.run.members == 2000
    assert free.start.omega[2].parameters[0] == 6.28  # the middle axis
    heavy = written(tmp_path, "--moments", "1,1,0.3", "--centre", "0,0,0.1", "--mass", 4)
    assert heavy.effects == (rm.Gravity(9.81),) and heavy.body.mass == 4.0


def test_the_step_follows_from_the_spin(tmp_path):
    steps = []
    for spin in (1.0, 1000.0):
        scene = written(tmp_path, "--solid", "ball", "--spin", f"0,0,{spin}")
        turns = scene.run.t_end * spin / (2.0 * np.pi)
        assert 49.9 < turns < 130.0 and 0.1 < scene.run.dt * spin < 0.4
        steps.append(scene.run.dt)
    assert steps[0] == pytest.approx(1000.0 * steps[1])


def test_names_and_existing_files(tmp_path):
    done = invoke("new", tmp_path / "x.txt")
    assert done.exit_code == 3 and "ends in .toml" in done.output
    file = tmp_path / "x.toml"
    file.write_text("precious")
    assert invoke("new", file).exit_code == 6
    assert file.read_text() == "precious"
    assert invoke("new", file, "--force").exit_code == 0
    assert rm.Scene.load(file).title == "x"


def test_questions_at_a_terminal(tmp_path, monkeypatch):
    """A wrong answer is asked again; an empty one is the default."""
    monkeypatch.setattr(new, "at_terminal", lambda: True)
    answers = ["cone", "radius=-1,height=1", "mass=0.1,radius=0.02,height=0.05"]
    answers += ["", "", "1,2", "0,0,300", "", "20"]
    scene = written(tmp_path, input="\n".join(answers) + "\n")
    assert scene.body.moments == rm.Body.solid("cone", mass=0.1, radius=0.02, height=0.05).moments
    assert scene.start.omega[2].parameters[0] == 300.0 and scene.run.members == 20
    asked_again = invoke("new", tmp_path / "my.toml", "--force", input="\n".join(answers) + "\n")
    assert "must be positive" in asked_again.output and "expected 3 numbers" in asked_again.output
    stopped = invoke("new", tmp_path / "other.toml", input="cone\n")
    assert stopped.exit_code == 130 and not (tmp_path / "other.toml").exists()
    # options are answers: nothing is asked
    ball = rm.Body.solid("ball", **SIZES["ball"])
    assert written(tmp_path, "--solid", "ball").body.moments == ball.moments


def test_options_have_units():
    """A unit after the last number alone is the unit of all."""
    assert read_numbers("10,0,90 deg/s", "spin", 3) == (np.pi / 18.0, 0.0, np.pi / 2.0)
    assert read_numbers("1 m,2 cm,3", "pivot", 3) == (1.0, 0.02, 3.0)
    sizes = {"mass": 0.012, "radius": 0.03, "height": 0.008}
    assert read_sizes("mass=12 g,radius=3cm,height=0.008") == sizes
    with pytest.raises(OptionError, match="mm is a length"):
        read_numbers("1,2,3 mm", "spin", 3)
