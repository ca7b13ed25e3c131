"""Compilation is announced before it begins; if all code is there, nothing is said or compiled."""

import logging
import os
import re
import shlex
from importlib import metadata
from typing import NamedTuple

import pytest
import scipy

import rigidmc as rm
from rigidmc.cli import doctor
from rigidmc.engine import compile_time, machine
from rigidmc.engine.compile_time import list_kernels, seconds, summary
from rigidmc.engine.machine import this_machine
from rigidmc.physics.integrators import INTEGRATORS
from rigidmc.runs import simulate as warm
from rigidmc.runs.directory import folder as run_directory
from rigidmc.runs.directory.facts import facts_text
from rigidmc.scene.sampling import drawn_through
from tests.tools.commands import ALONE, invoke, python

compiles = pytest.mark.skipif(
    os.environ.get("NUMBA_DISABLE_JIT") == "1", reason="nothing is compiled"
)
END = "\0"
# Commands one after the other, the outputs of each after END: a process takes 2 s to import.
SEVERAL = f"""
import shlex, sys
{ALONE}
from rigidmc.cli import app
for line in sys.argv[1:]:
    for stream in sys.stdout, sys.stderr:
        print({END!r}, end="", file=stream, flush=True)
    app(shlex.split(line), standalone_mode=False)
"""
BODY = rm.Body.from_moments((1.0, 2.0, 2.8), mass=1.0, centre=(0.0, 0.0, 0.1))
RUN = {"dt": 0.01, "t_end": 0.1, "members": 32, "save": ("omega",)}


@compiles
def test_nothing_is_compiled_after_warm(tmp_path):
    """With an empty disk cache `warm` announces and compiles; `run` and `show` find all of it."""

    def ran(*words):
        """The outputs of commands in one process: [(stdout, stderr)]."""
        both = python(SEVERAL, *map(shlex.join, words), cache=tmp_path / "cache")
        return list(zip(*(one.split(END)[1:] for one in both), strict=True))

    [(out, told)] = ran(["warm", "nasa_brick"])
    assert told.startswith("compiling rk4, first use: about ")
    assert out.split()[0] == "nasa_brick" and out.endswith(" s for rk4\n")
    # measured 0.96: the time on this machine, relative to the table
    assert 0.2 < float((tmp_path / "cache" / "rigidmc-kernels" / "pace").read_text()) < 5.0

    plain = ["run", "nasa_brick", "--t-end", "1"]
    more = [*plain, "--save", "omega,attitude,energy"]
    (out, told), (_, plainly), (_, first) = ran(["show", "nasa_brick"], plain, more)
    assert "code         nothing to compile\n" in out and "compiling" not in told + plainly
    assert "compiling saves of rk4, first use: about " in first
    [(_, again)] = ran(more)
    assert "compiling" not in again


def own_scene():
    """A scene with an effect of its own, which no disk cache has."""

    class Push(NamedTuple):
        size: float

    exec("def torque(self): return self.size, 0.0, 0.0", names := {"__name__": __name__})
    Push.torque = names["torque"]  # code without a source
    return rm.Scene(BODY, (Push(0.1),), rm.Start(omega=(0.1, 1.0, 0.0))).with_run(**RUN)


@compiles
def test_compilation_is_announced_if_progress_is_shown(capfd, caplog):
    caplog.set_level(logging.INFO, "rigidmc")
    scene = own_scene()
    rm.simulate(scene)
    assert capfd.readouterr() == ("", "")
    assert caplog.messages[0].startswith("compiling rk4 + Push, first use: about ")

    scene = scene.with_run(save=("momentum",))
    rm.simulate(scene, progress=True)
    assert capfd.readouterr().err.startswith("compiling saves of rk4 + Push, first use: about ")
    rm.simulate(scene, progress=True)
    assert "compiling" not in capfd.readouterr().err


def test_the_message_names_what_is_compiled():
    watched = "begin_monitors monitor_steps"
    every = f"gather scatter initialise march assess record {watched} refine_event advance"
    for of, pieces, words in (
        ("rk8 + gravity", every, "rk8 + gravity + events"),
        ("rk4", f"march {watched} begin_growth record_growth",
         "rk4 + running observables + growth of a tangent"),
        ("rk4", f"record {watched} refine_event", "events, saves of rk4"),
        ("rk4", "assess", "assess of rk4"),
        ("formulas", "formulas", "formulas"),
    ):  # fmt: skip
        assert summary(of, pieces.split()) == words
    listed = list_kernels("rk8 + gravity", ["initialise", "march", "assess"])
    assert listed == "march of rk8 + gravity, initialise, assess"


def test_seconds_follow_the_machine_and_what_is_compiled(tmp_path, monkeypatch):
    monkeypatch.setenv("RIGIDMC_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(compile_time, "compiled", [])
    one = seconds("rk4", ["march", "assess"])
    bare = compile_time.OTHERS + compile_time.KERNELS["assess"]
    assert one == pytest.approx(compile_time.FIRST + bare)
    heavy = seconds("rk4 + gravity", ["march", "assess"], (rm.Gravity(1.0),))
    assert one < min(heavy, seconds("rk8", ["march", "assess"]))
    paces = ("2.0\n", 2.0), ("1e9", 5.0), ("nan", 1.0), ("fast", 1.0), ("\xff", 1.0), ("", 1.0)
    for text, factor in paces:
        (tmp_path / "rigidmc-kernels" / "pace").write_text(text, encoding="latin-1")
        assert seconds("rk4", ["march", "assess"]) == pytest.approx(factor * one)
    compile_time.compiled.append("rk4")
    assert seconds("rk4", ["march", "assess"]) == pytest.approx(compile_time.LATER * bare)


def test_integrators_that_cannot_run_a_scene_are_skipped(monkeypatch):
    some = {name: INTEGRATORS[name] for name in ("rk4", "exact", "closed")}
    monkeypatch.setattr(warm, "INTEGRATORS", some)
    made = rm.precompile(rm.Scene.load("kapitza_top"), all_integrators=True)
    found = {one.integrator: one for one in made}
    assert set(found) == set(some) and not found["rk4"].skipped
    assert "takes no torque" in found["exact"].skipped and "closed form" in found["closed"].skipped
    skipped = rm.precompile(own_scene())[0].skipped
    assert "Push is compiled in every process: " in skipped and "torque has no source" in skipped


def test_warm_refuses_bad_scenes_with_exit_code_3():
    for words, message in (
        (("warm", "nasa_brik"), "did you mean 'nasa_brick'"),
        (("warm", "nasa_brick", "heavy_top", "--set", "run.integrator=exact"), "takes no torque"),
    ):
        found = invoke(*words)
        assert found.exit_code == 3 and message in found.output, found.output


def scipy_scene():
    start = rm.Start(omega=(rm.distribution("gamma", a=2.0, scale=0.1), 1.0, 0.0))
    return rm.Scene(BODY, (), start).with_run(**RUN)


def test_a_scene_drawn_through_scipy_tells_its_version(tmp_path):
    through = f"through scipy {scipy.__version__}: other versions may give other bits"
    scene = scipy_scene()
    assert rm.simulate(scene).attrs["drawn"] == through
    plain = rm.Scene(BODY, (), rm.Start(omega=(rm.normal(0.1, 0.1), 1.0, 0.0))).with_run(**RUN)
    assert "drawn" not in rm.simulate(plain).attrs
    assert rm.simulate(plain.with_run(points="sobol")).attrs["drawn"] == through
    fisher = rm.Start(omega=(0.1, 1.0, 0.0), attitude=rm.Fisher((1.0, 0.0, 0.0, 0.0), 10.0))
    drawn = rm.Scene(BODY, (), fisher)
    assert drawn_through(drawn.model, drawn.run) == through

    file = tmp_path / "s.toml"
    file.write_text(scene.dumps())
    assert f"drawn        {through}\n" in invoke("show", file).output
    assert "drawn " not in invoke("show nasa_brick").output


def test_a_run_tells_what_its_code_is_generated_for(tmp_path):
    for name, scene in (
        ("plain", rm.Scene.load("nasa_brick").with_run(t_end=0.1)),
        ("drawn", scipy_scene()),
    ):
        file, run = tmp_path / f"{name}.toml", f"{tmp_path / name}/"
        file.write_text(scene.dumps())
        assert invoke("run", file, "-o", run).exit_code == 0
        facts = run_directory.RunDirectory(run).facts
        assert facts["machine"] == this_machine()[1]
        assert facts["versions"].get("scipy") == (scipy.__version__ if name == "drawn" else None)
        told = invoke("status", run).output
        assert f"code generated for {this_machine()[1]} by rigidmc {rm.__version__}" in told
        assert ("scipy" in told) == (name == "drawn")
    assert f"generated for {this_machine()[1]}" in invoke("doctor").output


def test_a_source_tree_that_is_not_installed_tells_its_version(monkeypatch):
    def missing(name):
        if name == "rigidmc":
            raise metadata.PackageNotFoundError(name)
        return "1.0"

    monkeypatch.setattr(machine, "version", missing)
    monkeypatch.setattr(doctor, "version", missing)
    assert this_machine()[0]["rigidmc"] == rm.__version__
    shown = invoke("doctor")
    assert shown.exit_code == 0
    assert re.search(rf"^rigidmc +{re.escape(rm.__version__)}$", shown.output, re.M)


def test_a_run_drawn_through_scipy_goes_on_with_that_version_alone(tmp_path):
    (tmp_path / "s.toml").write_text(scipy_scene().dumps())
    run = f"{tmp_path / 'run'}/"
    assert invoke("run", tmp_path / "s.toml", "-o", run).exit_code == 0
    facts = run_directory.RunDirectory(run).facts
    other = {**facts, "versions": {**facts["versions"], "scipy": "0.1"}}
    (tmp_path / "run" / "run.json").write_text(facts_text(other))
    found = invoke("resume", run)
    assert found.exit_code == 3 and f"scipy 0.1 there, {scipy.__version__} here" in found.output
    assert invoke("resume", run, "--accept").exit_code == 0
