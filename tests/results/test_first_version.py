"""Files that rigidmc 0.1.0 wrote open, and their members have the same bits when they are rerun.

`first_version` has a netCDF file and a run directory of
`rigidmc run dzhanibekov --members 8 --t-end 1 --every 0.5`, written by that version.
"""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

import rigidmc as rm
from rigidmc.errors import FileError
from rigidmc.results.run_directory import FORMAT, facts_text

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
