"""One of each kind is added to a copy of the package: one file and one line, and the generic tests,
the command line and scene files know it. And one of each kind of a user's own, as the documentation
shows them: a script and a scene file take them without a change of the package."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import rigidmc as rm
from rigidmc.physics.dynamics.euler import MassProperties
from rigidmc.runs.directory.gather import verify
from rigidmc.runs.directory.resume import resume

ROOT = Path(__file__).parents[2]

PAGE = (ROOT / "docs/contributing.md").read_text("utf-8")


def recipe(title, place=0):
    """One of the Python texts below a title of the page."""
    section = PAGE.split(f"## {title}\n")[1].split("\n## ")[0]
    return re.findall(r"```python\n(.*?)```", section, re.S)[place]


# kind: (file, its text, file of the registry, line there before which the new line goes, new line)
NEW = {
    "effect": (
        "physics/effects/torsion.py",
        recipe("Add an effect"),
        "physics/effects/__init__.py",
        "from rigidmc.physics.effects.field import UniformField",
        "from rigidmc.physics.effects.torsion import TorsionSpring as TorsionSpring",
    ),
    "integrator": (
        "physics/integrators/cash_karp.py",
        recipe("Add an integrator"),
        "physics/integrators/__init__.py",
        '"lie", ',
        '"cash_karp", ',
    ),
    "observable": (
        "physics/observables/vertical.py",
        recipe("Add an observable or an event"),
        "physics/observables/__init__.py",
        "from rigidmc.physics.observables.state import Work",
        "from rigidmc.physics.observables.vertical import VerticalMomentum as VerticalMomentum",
    ),
    "event": (
        "physics/observables/horizontal.py",
        recipe("Add an observable or an event", 1),
        "physics/observables/__init__.py",
        "from rigidmc.physics.observables.passage import Passage",
        "from rigidmc.physics.observables.horizontal import Horizontal as Horizontal",
    ),
    "law": (
        "scene/vector_distributions/ring.py",
        recipe("Add a distribution of starts"),
        "scene/vector_distributions/__init__.py",
        "from rigidmc.scene.vector_distributions.attitudes import Fisher",
        "from rigidmc.scene.vector_distributions.ring import Ring as Ring",
    ),
    "subcommand": (
        "cli/hello.py",
        recipe("Add a command"),
        "cli/commands.py",
        '    "doctor": Entry(',
        '    "hello": Entry("hello", REFERENCE, "Say hello."),',
    ),
}


# hard cases and a map are no files: (file, line that the new text comes before, new text)
INSERTED = (
    (
        "studies/stress/free_cases.py",
        "FLAT_AND_THIN = {",
        """
@group("H16", "a new group")
def new_group():
    scene = tops((1.0, 1.4, 2.0), (0.3, 0.9, 0.7))
    yield HardCase("a new case", "to show how", largest_change(scene, 10.0, invariants), 1e-3)


""",
    ),
    (
        "studies/stability_map/cases.py",
        "MAPS: ",
        """
def new_map() -> MapCase:
    scene = Scene(Body.from_moments((1.0, 2.0, 3.0)), start=Start(omega=(0.0, 1.0, 0.01)))
    return MapCase(
        title="A new map",
        scene=scene,
        x=("body.moments.1", 0.9, 1.1),
        y=("body.moments.2", 1.9, 2.1),
        of=("p(flips >= 1)",),
        members=1,
        shown="p(flips>=1)",
        labels=("I1", "I2", "share that flips"),
        settings={"integrator": "exact", "dt": 0.1, "t_end": 20.0},
    )


""",
    ),
    ("studies/stability_map/cases.py", '    "growth": growth,', '    "new_map": new_map,'),
)


def insert(path, before, text):
    """Write a text before the one place that reads so: an item of a line, or a line."""
    file = path.read_text()
    assert file.count(before) == 1, (path, before)
    text = text if text.endswith(" ") else f"{text}\n"
    path.write_text(file.replace(before, text + before))


@pytest.fixture(scope="module")
def extended(tmp_path_factory):
    """A copy of package and tests, with what Python has compiled of them, with one of each kind
    added."""
    folder = tmp_path_factory.mktemp("extended")
    for name in ("rigidmc", "tests"):
        shutil.copytree(ROOT / name, folder / name)
    shutil.copy(ROOT / "pyproject.toml", folder)
    for file, text, registry, before, line in NEW.values():
        (folder / "rigidmc" / file).write_text(text.lstrip())
        insert(folder / "rigidmc" / registry, before, line)
    for file, before, text in INSERTED:
        insert(folder / "rigidmc" / file, before, text)
    return folder


def run(folder, *arguments, jit=False):
    environment = {**os.environ, "PYTHONPATH": str(folder), "RIGIDMC_CACHE_DIR": str(folder / "c")}
    environment |= {} if jit else {"NUMBA_DISABLE_JIT": "1"}
    command = [sys.executable, *arguments]
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)


COMMANDS = """
import json, sys
from typer.testing import CliRunner
from rigidmc.cli import app
ended = [CliRunner().invoke(app, words) for words in json.loads(sys.argv[1])]
assert all(one.exit_code == 0 for one in ended), [one.output for one in ended]
print(json.dumps([one.output for one in ended]))
"""


@pytest.mark.slow
def test_the_generic_tests_take_what_is_new(extended):
    files = [
        "tests/physics/effects/test_effects.py", "tests/physics/integrators/test_steps.py",
        "tests/physics/integrators/test_tables.py", "tests/physics/observables/test_observables.py",
    ]  # fmt: skip
    new = "torsion_spring or cash_karp or vertical_momentum or horizontal"
    ended = run(
        extended, "-m", "pytest", "-q", "-n", "0", "-p", "no:cacheprovider", "-k", new, *files
    )
    assert ended.returncode == 0, ended.stdout[-3000:]
    name, only = "tests/physics/integrators/test_integrators.py", "cash_karp and free_body"
    compiled = run(extended, "-m", "pytest", "-q", "-n", "0", "-k", only, name, jit=True)
    assert compiled.returncode == 0, compiled.stdout[-3000:]
    passed = int(ended.stdout.split(" passed")[0].split()[-1])
    assert passed >= 12, ended.stdout  # measured 18


@pytest.mark.slow  # 20 s
def test_all_tests_are_found_beside_what_is_new(extended):
    """A list of all parts in a test module, filled by hand, would stop here."""
    for name in (".github", "docs", "bench", "README.md", "CITATION.cff", "CHANGELOG.md"):
        (extended / name).symlink_to(ROOT / name)
    ended = run(extended, "-m", "pytest", "-q", "-n", "0", "--collect-only", "tests")
    assert ended.returncode == 0, ended.stdout[-3000:]


def test_scene_files_and_python_take_what_is_new(extended):
    (extended / "new.toml").write_text(
        "[body]\nmoments = [1.0, 1.4, 2.0]\n[effects.torsion_spring]\nstiffness = 3.0\n"
        "[start]\nmomentum = { ring = 0.5 }\n[run]\nintegrator = 'cash_karp'\ndt = 0.05\n"
        "t_end = 0.5\nevery = 0.1\nmembers = 4\n"
        "save = ['vertical_momentum', 'horizontal', 'energy']\n"
    )
    code = (
        "import numpy as np, rigidmc as rm\n"
        "rm.TorsionSpring, rm.Ring\n"
        "ds = rm.simulate(rm.Scene.load('new.toml'))\n"
        "assert ds.vertical_momentum.shape == (6, 4) and ds.rises.shape == (4,)\n"
        "assert (ds.start_momentum.values[2] == 0.0).all()\n"
        "assert ds.status.values.tolist() == [0] * 4\n"
        "print(ds.energy_drift_max.values.max())\n"
    )
    ended = run(extended, "-c", code)
    assert ended.returncode == 0, ended.stderr
    assert 0.0 < float(ended.stdout) < 2e-9  # measured 4.0e-10: it is integrated


def test_the_command_line_takes_what_is_new(extended):
    expected = {
        "effects": "torsion_spring",
        "effects torsion_spring": "torsion_spring",
        "integrators": "cash_karp",
        "integrators cash_karp": "cash_karp",
        "observables": "vertical_momentum",
        "observables vertical_momentum": "vertical_momentum",
        "observables horizontal": "horizontal",
        "map list": "A new map",
        "hello --dt 500ms": "hello, {'dt': 0.5}",
        "--help": "hello",
        "stress --group H16 --integrator cash_karp --threads 1": "a new case",
        "map new_map --resolution 2 --members 1": "2 x 2 pixels",
    }
    ended = run(extended, "-c", COMMANDS, json.dumps([words.split() for words in expected]))
    assert ended.returncode == 0, ended.stderr
    told = dict(zip(expected, json.loads(ended.stdout.splitlines()[-1]), strict=True))
    for words, word in expected.items():
        assert word in told[words], words
    assert "horizontal" in told["observables"]
    assert "1 good" in told["stress --group H16 --integrator cash_karp --threads 1"]


@pytest.fixture(scope="module")
def recurrence(extended):
    """The copy with the files of docs/contributing.md to the letter, which make a study."""
    study, picture = (recipe("Add a study", place) for place in range(2))
    (entry,) = re.findall(r"```\n( {4}\"recurrence.*?)\n```", PAGE, re.S)
    folder = extended / "rigidmc" / "studies" / "recurrence"
    folder.mkdir()
    for name, text in (("__init__", ""), ("study", study), ("picture", picture)):
        (folder / f"{name}.py").write_text(text)
    insert(extended / "rigidmc" / "studies" / "__init__.py", '    "section":', entry)
    return extended


def test_the_recipe_of_a_study_makes_a_command(recurrence):
    told = run(recurrence, "-c", COMMANDS, json.dumps([["--help"], ["recurrence", "--help"]]))
    assert "returns to its start" in told.stdout and "How near counts" in told.stdout


@pytest.mark.slow  # 16 s: it compiles what the package does
def test_the_tests_over_all_studies_take_that_of_the_recipe(recurrence):
    files = "tests/studies/test_framework.py", "tests/whole/test_docstrings.py"
    ended = run(recurrence, "-m", "pytest", "-q", "-n", "0", "-k", "recurrence", *files, jit=True)
    assert ended.returncode == 0, ended.stdout[-3000:]
    assert int(ended.stdout.split(" passed")[0].split()[-1]) == 10, ended.stdout


def blocks(language):
    """The blocks of a language on the page about parts of one's own."""
    page = (ROOT / "docs/how_to/own_parts.md").read_text("utf-8")
    return re.findall(rf"```{language}\n(.*?)```", page, re.S)


@pytest.fixture
def own(tmp_path):
    """A folder with mine.py and scene.toml as the page has them."""
    *parts, _ = blocks("python")
    (tmp_path / "mine.py").write_text("\n\n".join(parts))
    (scene,) = blocks("toml")
    (tmp_path / "scene.toml").write_text(scene)
    return tmp_path


def test_each_part_of_ones_own_takes_fifteen_lines_and_five_of_a_scene_file():
    _, *parts, _ = blocks("python")
    assert len(parts) == 8 and max(len(part.splitlines()) for part in parts) <= 15
    tables = blocks("toml")[0].split("\n\n")
    assert max(len(table.splitlines()) for table in tables) <= 8


@pytest.mark.slow
def test_a_script_and_a_scene_file_run_the_same_parts(own, monkeypatch):
    """One of each kind: compiled from the script, uncompiled from the file and the command line."""
    monkeypatch.chdir(own)
    names = {"__name__": "mine"}
    code = "\n\n".join(blocks("python"))
    (own / "script.py").write_text(code)
    exec(compile(code, str(own / "script.py"), "exec"), names)
    ds = names["ds"]
    ends = names["TorsionSpring"](3.0)
    assert ds.energy_drift_max.max() < 1e-9  # measured 2.5e-10: torque and energy are of one effect
    assert type(names["scene"].effects[0]) is type(ends)
    assert (ds.height.values <= 2.0).all() and ds.height.attrs["units"] == "m"
    assert (ds.fastest.values >= np.abs(ds.omega.sel(axis=1)).max("time").values).all()
    assert np.abs((ds.start_omega**2).sum("axis") - 0.25).max() < 1e-15  # measured 5.6e-17

    captured = names["Captured"](stay=1.0)
    state, seen, body = captured.begin(), [], MassProperties(*[1.0] * 9)
    # too short a stay, a fall that does not count, a stay, a tilt that is no fall, and a fall
    for t, tilt in ((0.5, 0.0), (1.0, 2.0), (1.5, 0.2), (2.5, 0.2), (3.0, 1.0), (3.5, 2.0)):
        state = captured.update(state, body, t, (np.cos(0.5 * tilt), np.sin(0.5 * tilt), 0.0, 0.0))
        seen.append(state[2:])
    assert seen == [(-1.0, 0.0)] * 3 + [(2.5, 0.0)] * 2 + [(2.5, 1.0)]
    assert ds.lost.dims == ("member",)

    commands = (
        "run scene.toml --allow-code -o own.nc",
        "run scene.toml --allow-code -o own/ --members 1 --t-end 0.02 --every 0.02",
        "integrators --scene scene.toml --allow-code",
    )
    ended = run_in(own, *commands)
    assert ended.returncode == 0, ended.stderr
    assert "kutta38" in json.loads(ended.stdout.splitlines()[-1])[2]
    with rm.open(own / "own.nc") as again:  # without the code
        for name in ("omega", "height", "height_max", "rises", "fastest"):
            assert again[name].dims == ds[name].dims
            assert np.abs(again[name] - ds[name]).max() < 5e-15, name  # measured 1.2e-15
        assert again.height.attrs == ds.height.attrs
        with pytest.raises(rm.SceneError, match="is code, and scene files execute nothing"):
            rm.rerun(again, 2)
        told = rm.open(own / "own", allow_code=True)
        assert told.rigid.scene().known_integrators()["kutta38"].order == 4  # asks no second time
        (own / "mine.py").write_text((own / "mine.py").read_text() + "# changed\n")
        with rm.open(own / "own") as bare:
            for name in told.variables:
                assert bare[name].dims == told[name].dims and bare[name].dtype == told[name].dtype
                assert bare[name].values.tobytes() == told[name].values.tobytes(), name
                assert bare[name].attrs.get("units") == told[name].attrs.get("units"), name
            assert bare.attrs == told.attrs
            assert "fastest" in bare.rigid.summary()
            with pytest.raises(rm.SceneError, match="is code, and scene files execute nothing"):
                bare.rigid.scene()
        assert verify(own / "own", spot=0) == []
        with pytest.raises(rm.FileError, match="is not the file that the run was started with"):
            resume(own / "own", allow_code=True, accept=True)  # it was not compiled there
        (own / "mine.py").unlink()
        with pytest.raises(rm.SceneError, match=r"there is no file .*mine\.py"):
            rm.rerun(again, 2, allow_code=True)


def run_in(folder, *commands):
    """Commands of rigidmc in a folder, uncompiled."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "NUMBA_DISABLE_JIT": "1"}
    words = json.dumps([command.split() for command in commands])
    command = [sys.executable, "-c", COMMANDS, words]
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)


@pytest.mark.parametrize(("old", "new", "words"), [
    ("[integrators.kutta38]\nmodule", "[integrators.kutta83]\nmodule",
     r"\[integrators.kutta83\] module = 'mine.py': has no class kutta83.*did you mean 'Kutta38'"),
    ('[observables.rises]\nmodule = "mine.py"', "[observables.rises]",
     "rises: no such observable.*a custom observable needs module"),
    ("at = 2.0", "to = 2.0", r"\[observables.height\] to: no such key; known: at, module"),
    ('integrator = "kutta38"', 'integrator = "kutta39"', "no such integrator.*'kutta38'"),
    ("ring = {", "rings = {", "has no class rings.*did you mean 'Ring'"),
    ('{ size = 0.5 }, module = "mine.py" }', "{ size = 0.5 } }", "custom distribution needs"),
    ('"rises", ', '"risen", ', r"save = 'risen': no such observable.*did you mean 'rises'"),
    ("[observables.rises]", "[observables.kutta38]", "Kutta38.*or a custom observable, with"),
    ("[integrators.kutta38]", "[integrators.ring]", "Ring is not a NamedTuple, as an integrator"),
    ("ring = { size", "fastest = { size", "Fastest must be a frozen dataclass"),
])  # fmt: skip
def test_mistakes_about_parts_of_ones_own_are_named(own, old, new, words):
    text = (own / "scene.toml").read_text()
    assert old in text
    (own / "scene.toml").write_text(text.replace(old, new))
    with pytest.raises(rm.SceneError, match=words):
        rm.Scene.load(own / "scene.toml", allow_code=True)


def test_no_part_of_ones_own_runs_unless_it_is_allowed(own):
    for table in ("effects", "observables", "integrators", "start"):
        text = (own / "scene.toml").read_text()
        others = re.sub(rf"\[(?!{table})(effects|observables|integrators)\.[^[]*", "", text)
        if table != "start":
            others = re.sub("omega = .*", "omega = [0.0, 0.5, 0.0]", others)
        others = re.sub(r"\[run\].*", "", others, flags=re.S)
        with pytest.raises(rm.SceneError, match=rf"{table}.*is code.*--allow-code"):
            rm.Scene.loads(others)
