"""Nothing of the working directory is executed or obeyed: a downloaded result may lie beside files
with the names of modules, and of settings."""

import json
import os
import re
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import pytest

import rigidmc as rm
from rigidmc.files import trial
from rigidmc.processes import helpers as processes
from tests.tools.faulty import LINUX

ROOT = Path(rm.__file__).parent
COMMAND = os.path.join(os.path.dirname(sys.executable), "rigidmc")
HELPERS = ("files.trial", "engine.compile_helper", "planning.tolerance.search",
           "studies.stress.processes")  # fmt: skip


@pytest.fixture(scope="module")
def planted(tmp_path_factory):
    """A folder with a result, a module of every name that is known here, and settings."""
    folder = tmp_path_factory.mktemp("download")
    rm.simulate(rm.Scene.load("dzhanibekov"), members=4, t_end=1.0, output=folder / "a.nc").close()
    names = {*sys.stdlib_module_names, *metadata.packages_distributions(), *sys.modules}
    for name in {name.partition(".")[0] for name in names} | {"usercustomize", "sitecustomize"}:
        if name.isidentifier():
            code = f"open({str(folder / 'EXECUTED')!r}, 'a').write('{name}, ')\n"
            (folder / f"{name}.py").write_text(code)
    (folder / ".numba_config.yaml").write_text("disable_jit: 1\n")
    (folder / "matplotlibrc").write_text("animation.ffmpeg_path: ./evil\naxes.facecolor: green\n")
    if hasattr(os, "mkfifo"):
        for name in (".ncrc", ".dodsrc", ".daprc"):
            os.mkfifo(folder / name)
    return folder


def untouched(folder):
    there = folder / "EXECUTED"
    return not there.exists() or there.read_text()


def test_helpers_are_started_in_one_way():
    """Each other call of an interpreter would have to be isolated too."""
    starts = re.compile(r"Popen\(|subprocess\.(run|call|check_)|executable|os\.(system|exec|sp)")
    texts = {str(one.relative_to(ROOT)): one.read_text() for one in ROOT.rglob("*.py")}
    found = {name for name, text in texts.items() if starts.search(text)}
    assert found == {"processes/helpers.py"}
    users = {name for name, text in texts.items() if re.search(r"\bstart_helper\(__name__", text)}
    users = {name[:-3].replace("/", ".") for name in users}
    assert users == set(HELPERS)


@LINUX
@pytest.mark.parametrize(
    "words",
    [
        pytest.param(["summary"], marks=pytest.mark.slow),  # which imports less
        ["plot", "-o", "x.png", "--force"],
    ],
)
def test_a_command_executes_nothing_of_its_folder(planted, words):
    environment = {name: x for name, x in os.environ.items() if not name.startswith("PYTHON")}
    done = subprocess.run(
        [COMMAND, words[0], "a.nc", *words[1:]], cwd=planted, capture_output=True, text=True,
        timeout=100, env=environment,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert untouched(planted) is True


@LINUX
@pytest.mark.parametrize("module", HELPERS)
def test_a_helper_executes_nothing_of_the_folder(planted, module, monkeypatch):
    monkeypatch.chdir(planted)
    monkeypatch.setattr(sys, "path", ["", str(planted), *sys.path])
    monkeypatch.setenv("PYTHONPATH", f":{planted}")
    question = [7, "netCDF", str(planted / "a.nc")]
    task = {"files.trial": json.dumps(question), "engine.compile_helper": "[]"}.get(module, "")
    with processes.start_helper(f"rigidmc.{module}") as helper:
        out, _ = helper.communicate(task, timeout=100)
    assert untouched(planted) is True
    if module == "files.trial":
        assert [json.loads(line) for line in out.split("\n") if line] == [[question, ""]]
    if task:
        assert helper.returncode == 0


@LINUX
@pytest.mark.parametrize("library", ["matplotlib", "numba"])
def test_settings_in_the_folder_are_not_obeyed(planted, library):
    """Of this process they would be: that they are read shows that the test can fail."""
    asked = {
        "matplotlib": "import matplotlib as m; print(m.rcParams['animation.ffmpeg_path'])",
        "numba": "import numba as n; n.core.config.reload_config(); print(n.config.DISABLE_JIT)",
    }[library]
    apart = "from rigidmc.cli.app import keep_apart; keep_apart(); "
    more = {"cwd": planted, "capture_output": True, "text": True}
    codes = (asked, apart + asked)
    runs = [subprocess.run([sys.executable, "-P", "-c", code], **more) for code in codes]
    told = [run.stdout.strip() for run in runs]
    assert told == {"matplotlib": ["./evil", "ffmpeg"], "numba": ["1", "0"]}[library]


def test_the_folders_of_a_helper_lack_the_working_directory(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    other = str(tmp_path / "other")
    monkeypatch.setattr(sys, "path", ["", str(tmp_path), other, "relative"])
    assert processes.folders() == [other, str(ROOT.parent)]
    monkeypatch.chdir(ROOT.parent)  # as from a clone by PYTHONPATH=.
    monkeypatch.setattr(sys, "path", [str(ROOT.parent), other])
    assert processes.folders() == [other, str(ROOT.parent)]


def test_a_helper_finds_the_package_by_its_place(planted, monkeypatch):
    """As one installed by PYTHONPATH, or beside a second one in site-packages."""
    trial._end_all()
    trial._sound.clear()
    home = str(ROOT.parent)
    monkeypatch.setattr(sys, "path", [p for p in sys.path if p not in ("", home)])
    trial.refuse_unreadable(planted / "a.nc")
    trial._end_all()


def test_a_helper_that_does_not_start_is_said_to(planted, monkeypatch):
    trial._end_all()
    trial._sound.clear()
    monkeypatch.setattr(sys, "path", [])
    monkeypatch.setattr(processes, "folders", list)
    with pytest.raises(OSError, match="does not start"):
        trial.refuse_unreadable(planted / "a.nc")
