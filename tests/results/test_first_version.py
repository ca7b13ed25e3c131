"""Files that rigidmc 0.1.0 wrote open, and their members have the same bits when they are rerun.

`first_version` has a netCDF file and a run directory of
`rigidmc run dzhanibekov --members 8 --t-end 1 --every 0.5`, written by that version, and run
directories of four bodies with a product of inertia of 0.5, by a tensor and by an uncertain one.
"""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

import rigidmc as rm
from rigidmc.errors import FileError
from rigidmc.runs.directory.facts import FORMAT, facts_text
from tests.tools.commands import invoke

FOLDER = Path(__file__).parent / "first_version"


@pytest.mark.parametrize("name", ["result.nc", "run"])
def test_a_result_of_the_first_version_opens_and_repeats(name, tmp_path):
    copy = shutil.copy if name == "result.nc" else shutil.copytree
    copy(FOLDER / name, tmp_path / name)
    with rm.open(tmp_path / name) as old:
        assert old.attrs["version"] == "0.1.0" and old.sizes["member"] == 8
        assert (old.status == 0).all()
        new = rm.simulate(rm.Scene.load(tmp_path / name))
        for variable in ("omega", "start_omega", "energy_drift_max"):
            assert np.array_equal(old[variable].values, new[variable].values), variable
        other = rm.simulate(rm.Scene.load(tmp_path / name).with_run(seed=2))
        assert not np.array_equal(old.omega.values, other.omega.values)


@pytest.mark.parametrize("name", ["run_tensor", "run_uncertain"])
def test_run_directories_of_tensors_keep_their_principal_axes(name, tmp_path):
    """Until 0.1 starts and results were in principal axes; new members are, too."""
    shutil.copytree(FOLDER / name, tmp_path / name)
    with rm.open(tmp_path / name) as old:
        kept = old.load()
    scene = rm.Scene.load(tmp_path / name)
    assert scene.body.frame == "principal" and kept.attrs.get("body_axes") in (None, "principal")
    assert np.array_equal(rm.simulate(scene).omega.values, kept.omega.values)
    assert kept.rigid.principal("omega").identical(kept.omega)
    turned = abs(kept.rigid.described("start_omega").isel(member=0) - [0.2, 0.3, 1.0]).max()
    assert turned > 0.1  # the start was given in principal axes, 45 degrees away
    for words in (
        ["verify", str(tmp_path / name)],
        ["extend", f"{tmp_path / name}", "--members", "6"],
    ):
        assert invoke(*words).exit_code == 0
    with rm.open(tmp_path / name) as more:
        assert more.sizes["member"] == 6
        assert np.array_equal(more.omega.values[..., :4], kept.omega.values)
    text = (tmp_path / name / "scene.toml").read_text("utf-8")
    (tmp_path / name / "scene.toml").write_text(text.replace("0.3", "0.4"), "utf-8")
    with pytest.raises(FileError, match="is not the scene with which the run was started"):
        rm.open(tmp_path / name)


def test_a_run_directory_of_a_later_format_is_refused(tmp_path):
    shutil.copytree(FOLDER / "run", tmp_path / "run")
    path = tmp_path / "run" / "run.json"
    facts = json.loads(path.read_text("utf-8"))
    del facts["check"]
    path.write_text(facts_text({**facts, "format": FORMAT + 1}), "utf-8")
    with pytest.raises(FileError, match=f"this version reads format {FORMAT}"):
        rm.open(tmp_path / "run")


def test_a_key_of_a_later_version_is_refused(tmp_path):
    shutil.copytree(FOLDER / "run", tmp_path / "run")
    path = tmp_path / "run" / "run.json"
    facts = json.loads(path.read_text("utf-8"))
    path.write_text(json.dumps({**facts, "colour": "red"}), "utf-8")
    with pytest.raises(FileError, match="colour"):
        rm.open(tmp_path / "run")
