"""What users write and read: counts, times, idle settings, mistakes, file endings, names."""

import json
import subprocess
import sys

import numpy as np
import pytest

import rigidmc as rm
from rigidmc.inputs.amounts import read_count, read_count_text, read_seconds
from rigidmc.physics.effects import EFFECTS
from rigidmc.physics.integrators import INTEGRATORS
from rigidmc.physics.observables import saveable_names
from rigidmc.scene.library import shipped_names
from rigidmc.scene.parameters import parameter_names
from rigidmc.scene.settings import Run, idle
from rigidmc.studies.stability_map.cases import MAPS
from rigidmc.studies.stability_map.question import make_request
from tests.tools.commands import invoke
from tests.tools.plans import notes_of, plan_of

BODY = rm.Body((1.0, 2.0, 2.5))
HEAVY = rm.Body((1.0, 2.0, 2.5), mass=2.0, centre=(0.0, 0.0, 0.1))
SPUN = rm.Start(omega=(0.0, 1.0, 0.0))
TEXT = "[body]\nmoments = [1.0, 2.0, 2.5]\n[start]\nomega = [0.0, 1.0, 0.0]\n[run]\n"


def noted(scene):
    return notes_of(scene)


# counts and times


@pytest.mark.parametrize(("given", "wanted"), [
    ("3h", 10800.0), ("1h30m", 5400.0), ("90m", 5400.0), ("2 min", 120.0), ("90 s", 90.0),
    ("250 ms", 0.25), ("3ms", 0.003), ("1 d 1 s", 86401.0),
    ("2.5", 2.5), ("1e-9s", 1e-9), ("1e3", 1e3), ("5us", 5e-6), (7, 7.0), (np.float32(0.5), 0.5),
    (np.int64(3), 3.0),
])  # fmt: skip
def test_times_are_read_to_the_bit(given, wanted):
    assert read_seconds(given, "t_end") == wanted


@pytest.mark.parametrize(
    "bad",
    ["soon", "", "1m1h", "1h30", "1 m s", "inf", "1e400", np.nan, 10**400, True, None, "-1h", 0],
)
def test_what_is_no_time_is_told(bad):
    with pytest.raises(rm.OptionError, match=r"t_end.*(number of seconds|greater than 0)"):
        read_seconds(bad, "t_end")


def test_whole_floats_are_counts_and_others_are_refused():
    counts = [read_count(v, "n") for v in (1e6, 3, np.int8(3), np.float64(1e3))]
    assert counts == [1_000_000, 3, 3, 1000]
    texts = "1e6", "20_000", "9007199254740993"
    assert [read_count_text(v, "n") for v in texts] == [1_000_000, 20_000, 9007199254740993]
    for bad in (1.5, True, np.True_, None, "3", 0, np.inf):
        with pytest.raises(rm.OptionError, match="expected an integer of at least 1"):
            read_count(bad, "n")
    with pytest.raises(rm.OptionError, match="64 bits"):
        read_count(1e300, "n")


def test_counts_and_times_are_taken_in_files_in_python_and_on_the_command_line():
    text = 'members = 1e3\nt_end = "1h30m"\nevery = "2 min"\ndt = "250 ms"\nseed = 7.0'
    scene = rm.Scene.loads(TEXT + text)
    run = scene.run
    assert (run.members, run.t_end, run.every, run.dt, run.seed) == (1000, 5400.0, 120.0, 0.25, 7)
    assert Run(members=2e3, t_end="1 min").members == 2000
    assert scene.with_run(members=np.float64(64.0), t_end="90 s").run.t_end == 90.0
    sides = ("body.moments.1", 0.8, 1.0), ("body.moments.2", 1.8, 2.0)
    assert make_request(*sides, "p(flips >= 1)", 8.0, 1e0).of_scene(scene).run.members == 64
    bins = rm.Scene(BODY, observables=(rm.Histogram("energy", 0.0, 1.0, bins=1e2),))
    assert bins.observables[0].bins == 100
    ds = rm.simulate(scene, members=4e0, dt="10 ms", t_end="0.1 s", every="50ms")
    assert ds.sizes["member"] == 4 and ds.time.values.tolist() == [0.0, 0.05, 0.1]
    checked = invoke("check dzhanibekov --set run.members=2e3 --set", "run.t_end=1 min").stdout
    assert "valid, 2,000 members x 6,000 steps" in checked
    assert "1,000,000 in blocks" in invoke("show dzhanibekov --members 1e6 --t-end", "1 min").stdout
    assert "member 0" in invoke("exact dzhanibekov --at -1s --members 1e1").stdout
    with pytest.raises(rm.SceneError, match=r"\[run\] members = 1.5: expected an integer"):
        rm.simulate(scene, members=1.5)


# settings without effect


def test_a_tolerance_without_an_integrator_means_auto():
    file = rm.Scene.loads(TEXT + "tolerance = 1e-6")
    python = rm.Scene(BODY, start=SPUN, run=Run(tolerance=1e-6))
    top = rm.Scene.load("heavy_top")
    set_ = rm.Scene.load("heavy_top", [("run.tolerance", "1e-6")])
    made = [file, python, top.with_run(tolerance=1e-6), set_]
    for scene in made:
        assert (scene.run.integrator, scene.run.dt, scene.run.tolerance) == ("auto", 0.01, 1e-6)
        assert idle(scene.run) == {}
    assert top.with_run(tolerance=1e-6).with_run(integrator="rk4").run.tolerance is None
    assert rm.Scene.loads(file.dumps()).run.integrator == "auto"


def test_a_tolerance_that_no_integrator_keeps_is_refused():
    scene = rm.Scene.loads(TEXT + 'integrator = "rk4"\ntolerance = 1e-6')
    with pytest.raises(rm.SceneError, match=r'tolerance = 1e-06: integrator = "rk4" ignores a tol'):
        rm.prepare(scene)
    for both in ("dt = 0.1\nturn = 0.1", 'turn = 0.2\ndt = "1 s"'):
        with pytest.raises(rm.SceneError, match="give dt or turn, not both"):
            rm.Scene.loads(TEXT + both)


@pytest.mark.parametrize(("settings", "effects", "key"), [
    ({"integrator": "auto", "tolerance": 1e-6, "dt": 0.1}, (), "dt"),
    ({"integrator": "auto", "tolerance": 1e-6, "turn": 0.1}, (), "turn"),
    ({"integrator": "auto", "tolerance": 1e-6, "dtype": "float32"}, (), "dtype"),
    ({"integrator": "closed", "turn": 0.1}, (), "turn"),
    ({"integrator": "closed", "energy_limit": 0.1}, (), "energy_limit"),
    ({"turn_rate": 1.0}, (), "turn_rate"), ({"strata": 8}, (), "strata"),
    ({"checks": False, "turn_limit": 1.0}, (), "turn_limit"), ({"thin": 3}, (), "thin"),
    ({"keep": {"energy": "final"}}, (), "keep.energy"),
    ({"every": 20.0}, (), "every"), ({"anti_damping": True}, (), "anti_damping"),
    ({"energy_limit": 1e-3}, (rm.ViscousDamping(0.1),), "energy_limit"),
    ({"momentum_limit": 1e-3}, (rm.ViscousDamping(0.1),), "momentum_limit"),
])  # fmt: skip
def test_settings_without_effect_are_noted(settings, effects, key):
    scene = rm.Scene(BODY, effects, SPUN, Run(**settings))
    plan = plan_of(scene if scene.run.integrator != "auto" else scene.with_run(integrator="rk8"))
    found = [note for note in notes_of(scene, plan) if note.startswith(f"[run] {key} = ")]
    assert len(found) == 1
    stored = rm.Scene.loads(scene.dumps())  # with all keys
    assert idle(stored.run) == idle(scene.run)


def test_an_override_drops_settings_that_it_makes_idle():
    run = Run(turn=0.2, energy_limit=0.01, keep={"omega": "thinned"}, thin=5)
    scene = rm.Scene(BODY, start=SPUN, run=run)
    assert scene.with_run(integrator="closed").run.energy_limit is None
    assert scene.with_run(integrator="closed").run.turn is None
    assert scene.with_run(checks=False).run.energy_limit is None
    assert scene.with_run(keep="full").run.thin == 10
    assert scene.with_run(save=("energy",)).run.keep == {}
    assert scene.with_run(dt=0.1).run.turn is None
    # all of it still has an effect
    assert scene.with_run(integrator="rk8").run == run.model_copy(update={"integrator": "rk8"})
    # the user asked for both: a note says so
    assert scene.with_run(checks=False, energy_limit=0.1).run.energy_limit == 0.1


def test_good_scenes_give_no_note(tmp_path):
    for name in shipped_names():
        scene = rm.Scene.load(name)
        assert noted(scene) == () and noted(rm.Scene.loads(scene.dumps())) == (), name
    for name, make in MAPS.items():
        case = make()
        asked = make_request(case.x, case.y, case.of, 64, 1)
        scene = asked.of_scene(case.scene).with_run(**case.settings)
        assert notes_of(scene, plan_of(scene)._replace(notes=())) == (), name
    # warnings are errors here: neither the run nor any of its other members warns
    path = str(tmp_path / "a.nc")
    scene = rm.Scene(HEAVY, (rm.Gravity(9.81),), SPUN).with_run(members=32, t_end=0.1, every=0.05)
    rm.simulate(scene, output=path).close()
    assert rm.prepare(rm.Scene.load(path)).scene.run.every == 0.05
    assert rm.rerun(path, 7.0).attrs["rerun"].startswith("equal to the bit")


@pytest.mark.parametrize("degrees", [
    lambda t: rm.analyse_lagrange_top((1.0, 1.0, 0.5), 1.0, (0.0, 0.0, 4.0), (0.0, t, 0.0)),
    lambda t: rm.solve_free_top((1.0, 2.0, 3.0), (1.0, 2.0, 3.0), (0.0, t, 0.0), [0.0]),
    lambda t: rm.steady_precession((1.0, 1.0, 0.5), 1.0, 20.0, t),
    lambda t: rm.least_spin((1.0, 1.0, 0.5), 1.0, t),
])  # fmt: skip
def test_closed_forms_note_degrees_as_scenes_do(degrees):
    with pytest.warns(rm.SceneWarning, match="23 is more than pi: angles are in rad"):
        degrees(23)
    degrees(1.0)  # warnings are errors here
    degrees("23 deg")


TOP = "[body]\nmoments = [1, 2, 2.5]\n[start]\nomega = [0.5, { normal = [1, 0.1] }, 0]\n"


@pytest.mark.parametrize(("more", "settings", "words"), [
    ("", {"start.omega.1.standard_deviation": "0.1"},
     r"omega.1 is 0.5, a number without a distribution: .*omega.1=\{ normal = \[0.5, 0.1\] \}"),
    ("", {"start.omega.2.standard_deviation": "0.1"},
     r"a component is set as a whole, as in start.omega.2={"),
    ("", {"start.omega.4.standard_deviation": "0.1"}, r"a list, .*components are 1 to 3"),
    ("[gravity]\ng = 9.81\n", {}, r"gravity: is not a table of a scene: write \[effects.gravity\]"),
    ("[passage]\naxis = 3\n", {}, r"write \[observables.passage\]"),
    ("[run]\nsave = 3\n", {}, r"save = 3: expected names in brackets, or one name"),
])  # fmt: skip
def test_misplaced_keys_name_the_right_place(tmp_path, more, settings, words):
    (tmp_path / "top.toml").write_text(TOP + more)
    with pytest.raises(rm.SceneError, match=words):
        rm.Scene.load(tmp_path / "top.toml", settings)


@pytest.mark.parametrize("save", ["omega", "omega, flips", ["omega", "flips"], ("omega",)])
def test_names_are_read_from_one_text_or_many(save):
    names = ("omega", "flips") if "flips" in save or "," in save else ("omega",)
    text = f"{TOP}[run]\nsave = {list(save) if isinstance(save, tuple) else save!r}\n"
    assert rm.Scene.loads(text).run.save == rm.Run(save=save).save == names
    assert rm.Scene.loads(TOP).with_run(save=save).run.save == names


# mistakes that run all the same


def test_a_map_notes_centres_too_far_for_the_moments():
    sides = ("start.omega.2", 1.0, 2.0), ("body.centre.3", 0.0, 1.0)
    scene = make_request(*sides, "status", 64, 1).of_scene(rm.Scene(HEAVY, rm.Gravity(9.81), SPUN))
    # c^2 <= S_3/m = (1 + 2 - 2.5)/2/2 = 0.125: of 64 rows those above 0.354, 41 of 64, cannot exist
    (note,) = (note for note in noted(scene) if "[body]" in note)
    assert note.startswith("[body] centre: 2,624 of 4,096 bodies spread over the grid cannot exist")


def test_kelvin_are_no_joules():
    grain = rm.Body.solid("ball", mass=1e-15, radius=5e-7)
    for kT, count in ((300.0, 1), (4.14e-21, 0)):
        scene = rm.Scene(grain, (rm.Bath(1e3, kT),), rm.Start(omega=(0.0, 0.0, 0.0))).with_run(
            integrator="strang", dt=1e-6, t_end=1e-5
        )
        assert [note[:21] for note in noted(scene)] == ["[effects.bath] kT = 3"] * count


def test_run_show_and_check_print_the_same_notes(tmp_path):
    file = tmp_path / "a.toml"
    run = "members = 32\nt_end = 0.1\nevery = 3.0\nthin = 4\n"
    file.write_text(f"{TEXT}{run}[effects.gravity]\ng = -9.81\n")
    told = [invoke(command, file) for command in ("run", "show", "check")]
    each = [[x for x in (t.stdout + t.stderr).splitlines() if "note" in x[:14]] for t in told]
    lines = [sorted(x.split("note")[-1].strip(": ") for x in one) for one in each]
    assert len(lines[0]) == 4 and lines[0] == lines[1] == lines[2], lines


# files and names


def test_a_scene_in_the_place_of_a_result_is_told(tmp_path):
    file = tmp_path / "a.toml"
    file.write_text(TEXT)
    for words in (("animate", file, "-o", "x.gif", "--member", 0), ("summary", "dzhanibekov")):
        told = invoke(*words)
        assert told.exit_code == 3 and "is a scene, not a result" in told.stderr
        assert f"rigidmc view {words[1]}" in told.stderr


def test_files_with_other_endings_are_refused_in_python(tmp_path):
    for make in (
        rm.simulate,
        lambda scene, output: rm.simulate_until(scene, "p(flips >= 1) +- 0.1", output=output),
    ):
        with pytest.raises(rm.OptionError, match=r"results ends in .nc, .* not in '.txt'"):
            make(rm.Scene.load("dzhanibekov"), output=tmp_path / "x.txt")


@pytest.mark.parametrize("code", [
    ("import rigidmc, sys; assert 'xarray' not in sys.modules and 'numpy' not in "
        "sys.modules; import xarray as xr"),
    "import xarray as xr, rigidmc",
    "import rigidmc; import xarray.core.dataset; import xarray as xr",
])  # fmt: skip
def test_the_accessor_is_there_on_import_in_either_order(code):
    more = (
        "; xr.Dataset().rigid; import sys; assert not any('rigidmc' in repr(f) for f in "
        "sys.meta_path), sys.meta_path; assert 'matplotlib' not in sys.modules"
    )
    words = [sys.executable, "-W", "error", "-c", code + more]
    done = subprocess.run(words, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_missing_files_are_reported_without_error_numbers(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "dzhani.nc").touch()
    for words in (
        ("plot", "dzhan.nc", "-o", "x.png"),
        ("summary", "dzhan.nc"),
        ("rerun", "dzhan.nc", "--member", "1"),
        ("show", "dzhan.nc"),
    ):
        made = invoke(*words)
        words = "dzhan.nc: no such file", "did you mean 'dzhani.nc'"
        assert made.exit_code == 74 and all(word in made.stderr for word in words), made.stderr
        assert "Errno" not in made.stderr


def test_unknown_names_get_a_hint():
    for name, words in (
        ("cone", r"Body.solid\('cone', mass=..., radius=..., height=...\)"),
        ("coen", "cone"),
        ("from_mseh", "Body.from_mesh"),
    ):
        with pytest.raises(AttributeError, match=words):
            getattr(rm.Body, name)
    with pytest.raises(AttributeError, match="did you mean 'simulate'"):
        rm.simluate  # noqa: B018
    assert not hasattr(rm.Body, "__wrapped__") and not hasattr(rm, "__wrapped__")


def test_every_name_is_explained():
    """`effects rotor` and `effects potential`, whose defaults are vectors, once ended in a
    traceback."""
    words = [("effects", name) for name in EFFECTS]
    words += [("integrators", name) for name in INTEGRATORS]
    words += [("observables", name) for name in saveable_names()]
    for command, name in words:
        made = invoke(command, name)
        assert made.exit_code == 0 and "in a scene" in made.stdout, (name, made.exception)
        assert ">>>" not in made.stdout and "----" not in made.stdout  # of numpydoc
    assert "motor = [0, 0, 0]" in invoke("effects rotor").stdout
    # the list ended in mid-sentence
    assert "for a body described in other axes. [rad/s]" in invoke("observables").stdout


@pytest.mark.parametrize(("words", "parts"), [
    (("effects", "gravity"),
    ("tau = -g m r x u(q)", "[effects.gravity] with g", "g [m/s²]", "TdC Example 3.7")),
    (("observables", "passage"),
    ("angle : half the opening", "[observables.passage] axis, angle, way = leaves",
    "passage_first [s]")),
    (("observables", "omega_max"), ("over all steps of omega", "[rad/s]")),
    (("observables", "omega"), ("omega = I^-1 L", "[rad/s]")),
    (("integrators", "rk8"), ("Dormand & Prince", "order 8, 12 torques per step")),
    (("map", "list", "kapitza"), ("Kapitza 1951", "[effects.moving_pivot]")),
])  # fmt: skip
def test_listing_one_name_explains_it(words, parts):
    made = invoke(*words)
    assert made.exit_code == 0 and all(part in made.stdout for part in parts), made.output
    wrong = invoke(*words[:-1], words[-1][:-1])
    assert wrong.exit_code == 3 and f"did you mean '{words[-1]}'" in wrong.stderr


# measured inertia


def test_correlated_moments_have_their_covariance_and_tails_are_flagged(tmp_path):
    covariance = np.array([[0.01, 0.004, 0.0], [0.004, 0.02, 0.0], [0.0, 0.0, 0.01]])
    start = (
        "[start]\nomega = [0.0, 1.0, 0.0]\n[run]\nmembers = 4096\nt_end = 0.1\n"
        "integrator = 'exact'\ndt = 0.05\n"
    )
    law = f"correlated = {{ mean = [1.0, 2.0, 2.7], covariance = {covariance.tolist()} }}"
    scene = rm.Scene.loads(f"[body]\nmoments = {{ {law} }}\n{start}")
    assert rm.Scene.loads(scene.dumps()).dumps() == scene.dumps()
    assert parameter_names(scene.model)[:3] == [f"body.moments.mean.{i}" for i in (1, 2, 3)]
    with pytest.warns(
        rm.SceneWarning, match=r"\[body\] moments: 347 of the first 4,096 bodies cannot exist"
    ):
        ds = rm.simulate(scene, output=str(tmp_path / "a.nc"))
    moments = ds.moments.values
    none = (2.0 * moments.max(0) > moments.sum(0)) | (moments.min(0) <= 0.0)
    assert none.sum() == 347
    assert np.array_equal(ds.status.values == 2, none)
    assert (ds.status.values[~none] == 0).all()
    # 4 sigma of the largest: 0.02 sqrt(2/4096) = 4.4e-4
    assert np.abs(np.cov(moments) - covariance).max() < 1.5e-3
    told = invoke("show", tmp_path / "a.nc").stdout
    assert "correlated(mean = (1, 2, 2.7)" in told and "body.moments.mean.1" in told
    few = rm.Scene(rm.Body(rm.Correlated((1.0, 2.0, 4.0), covariance.tolist())), start=SPUN)
    with pytest.raises(rm.SceneError, match="sampled bodies are impossible"):
        rm.prepare(few)


def test_a_covariance_is_checked_relative_to_its_size():
    even = np.array([[1.0, 0.1, 0.0], [0.1, 1.0, 0.0], [0.0, 0.0, 1.0]]) * 1e-14
    rm.Body(rm.Correlated((1e-6, 2e-6, 2.5e-6), even.tolist()))
    even[0, 1] = 0.0
    with pytest.raises(rm.SceneError, match="symmetric matrix"):
        rm.Body(rm.Correlated((1e-6, 2e-6, 2.5e-6), even.tolist()))


# results


def test_the_summary_of_a_driven_body_has_the_note_of_its_run():
    start = rm.Start(omega=(rm.normal(0.0, 0.1), 1.0, 0.0))
    scene = rm.Scene(BODY, rm.ViscousDamping(0.1), start).with_run(members=40, t_end=1.0)
    ds = rm.simulate(scene)
    line = next(line for line in ds.rigid.summary().splitlines() if "energy_drift_max" in line)
    assert line.endswith("(not conserved: viscous_damping changes the energy)")


def test_a_rerun_saves_at_the_nearest_whole_number_of_steps(tmp_path):
    path = str(tmp_path / "a.nc")
    scene = rm.Scene(HEAVY, (rm.Gravity(1.0),), SPUN).with_run(members=40, t_end=2.0)
    rm.simulate(scene, dt=0.03, output=path).close()  # 67 steps of 0.029850746: no note below 1 %
    with pytest.warns(
        rm.SceneWarning,
        match=(
            r"every = 0.3 s is not a whole number of steps of 0.02985074627 s: saves are "
            r"0.2985074627 s apart, 10 steps"
        ),
    ):
        made = rm.rerun(path, 17, every=0.3)
    assert made.sizes["time"] == 8
    assert abs(made.time.values[1] - 20.0 / 67.0) < 1e-15
    assert made.attrs["rerun"].startswith("equal to the bit")
    # a whole number: no note
    assert rm.rerun(path, 17, every="29.850746268656717 ms").sizes["time"] == 68


def test_a_run_that_is_too_large_names_memory_or_disk():
    scene = rm.Scene.load("dzhanibekov")
    with pytest.raises(
        OSError, match=r"GB of memory.*\(-o FILE\), which needs .*B of memory and .* GB of disk"
    ):
        rm.simulate(scene, members=2e9, every=None, save=("omega",), keep="final")


def test_body_says_that_a_body_cannot_exist(tmp_path):
    """A tensor about the centre of mass, as CAD gives it, beside the place of that centre."""
    text = "[body]\ntensor = [[0.4, 0, 0], [0, 0.2, 0], [0, 0, 0.4]]\nmass = 20.0\n"
    text += "centre = [C, 0, 0]\n"
    for c, words in (("0.16", 1), ("0.05", 0)):
        (tmp_path / "leg.toml").write_text(text.replace("C", c) + "[start]\nomega = [0, 0, 0]\n")
        told = invoke("body", tmp_path / "leg.toml")
        assert told.exit_code == 0 and told.output.count("the body cannot exist") == words
        told = invoke("body", tmp_path / "leg.toml", "--json")
        assert json.loads(told.stdout)["exists"] == (words == 0)
