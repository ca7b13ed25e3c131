"""A run refuses custom code that reads something else than at its start: a prepared run, and each
command that continues or repeats a run directory."""

import json

import pytest

import rigidmc as rm
from rigidmc.engine.compiler.contents import UNKNOWN, changes, contents_of
from rigidmc.errors import FileError, PartError
from rigidmc.runs.directory.create import create
from rigidmc.runs.directory.facts import facts_text
from rigidmc.runs.directory.load import scene_of_run
from tests.tools.commands import invoke

MINE = """
import functools
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import rigidmc as rm
from rigidmc.protocols import VectorDistribution, event, observable, sample

from strength import HALF

GAIN = float(Path(__file__).with_name("gain.txt").read_text())
TABLE, LISTED, NAMED = GAIN * np.ones(2), [1.0, GAIN], {"a": (GAIN,)}
half = functools.partial(lambda x, y: x * GAIN, 0.5)


class Settings:
    gain = GAIN


@dataclass(frozen=True)
class Ring(VectorDistribution):
    size: Any
    variables = ("omega",)
    scale = GAIN

    def sample(self, sampler, name, first, count, facts):
        (size,) = sample((self.size,), sampler, name, first, count)
        return np.stack([size * READS, size, size])


@event(outputs={"rises": ("1", "rises", ())})
class Rises(NamedTuple):
    def level(self, q):
        return q[1]

    def results(self, record):
        return {"rises": record.count * READS}
"""
SCENE = """
[body]
moments = [1.0, 2.0, 2.8]
[start]
omega = { ring = { size = 0.5 }, module = "mine.py" }
[observables.rises]
module = "mine.py"
[run]
integrator = "rk4"
dt = 0.02
t_end = 0.2
members = 4
save = ["rises"]
"""
READS = {  # how code reads what the file `gain.txt` has, and how the message names it
    "GAIN": "reads GAIN",
    "TABLE[0]": "reads TABLE",
    "LISTED[1]": "reads LISTED",
    "NAMED['a'][0]": "reads NAMED",
    "half(1.0)": "reads GAIN",
    "Settings.gain": "Settings.gain",
    "(lambda: GAIN)()": "reads GAIN",
    "Ring.scale": "Ring.scale",
}


@pytest.fixture
def scene_file(tmp_path):
    def written(reads, gain=1.0):
        (tmp_path / "mine.py").write_text(MINE.replace("READS", reads))
        (tmp_path / "strength.py").write_text("HALF = 0.5\n")
        (tmp_path / "gain.txt").write_text(str(gain))
        (tmp_path / "scene.toml").write_text(SCENE)
        return str(tmp_path / "scene.toml")

    return written


@pytest.mark.parametrize("reads", READS)
def test_a_run_directory_refuses_code_that_reads_another_value(reads, scene_file, tmp_path):
    scene = rm.Scene.load(scene_file(reads), allow_code=True)
    directory = create(scene, tmp_path / "run")
    scene_of_run(directory, allow_code=True)
    scene_file(reads, gain=2.0)  # the Python file stays as it is
    (tmp_path / "mine.py").touch()
    with pytest.raises(FileError, match="has changed since the run was started") as caught:
        scene_of_run(directory, allow_code=True)
    assert READS[reads] in str(caught.value)
    scene_file(reads)
    scene_of_run(directory, allow_code=True)


def test_an_old_run_directory_has_no_contents_and_is_accepted(scene_file, tmp_path):
    scene = rm.Scene.load(scene_file("GAIN"), allow_code=True)
    directory = create(scene, tmp_path / "run")
    path = tmp_path / "run" / "run.json"
    facts = json.loads(path.read_text())
    del facts["contents"], facts["check"]
    path.write_text(facts_text(facts))
    scene_file("GAIN", gain=2.0)
    scene_of_run(type(directory)(tmp_path / "run"), allow_code=True)


def test_a_prepared_run_refuses_code_that_has_changed(scene_file, tmp_path):
    scene = rm.Scene.load(scene_file("GAIN"), allow_code=True)
    run, names = rm.prepare(scene, save=["omega"]), scene.start.omega.sample.__globals__
    names["GAIN"] = 2.0
    with pytest.raises(PartError, match=r"Ring.sample reads GAIN.*prepare it again"):
        run.run()
    with pytest.raises(PartError, match="prepare it again"):
        run.compile()
    names["GAIN"] = 1.0
    assert run.run().sizes["member"] == 4


def test_commands_refuse_another_file(scene_file, tmp_path):
    """Also a file beside it, of which it takes a number alone."""
    run = f"{tmp_path}/run/"
    assert invoke("run", scene_file("HALF"), "--allow-code", "-o", run).exit_code == 0
    assert invoke("extend", run, "--members", "8", "--allow-code").exit_code == 0
    for name in ("mine.py", "strength.py"):
        file = tmp_path / name
        text = file.read_text()
        file.write_text(f"{text}# changed\n")
        made = invoke("extend", run, "--members", "12", "--allow-code")
        assert made.exit_code == 3 and "is not the file" in made.stderr and name in made.stderr
        file.write_text(text)
    file.unlink()
    assert invoke("resume", run).exit_code == 3


class Opaque:
    """An object whose content nothing tells."""

    __slots__ = ()


THING = Opaque()


class Reads:
    def value(self):
        return THING


def test_what_cannot_be_compared_is_unknown_and_no_change():
    before = contents_of([Reads])
    assert before["Reads.value reads THING"] == UNKNOWN
    assert not changes(before, contents_of([Reads]))
    assert changes(before, {**before, "Reads.value": "other"}) == ["Reads.value"]
    assert not changes(before, {"Python": "another"})
