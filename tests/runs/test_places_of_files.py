"""Where the files of runs are: nothing of others in a run directory, nothing of a run beside it."""

import json
import os
import subprocess
import sys

import pytest

import rigidmc as rm
from rigidmc.errors import FileError, OutputExists
from rigidmc.runs.directory import gather, resume
from rigidmc.runs.directory.create import create
from rigidmc.runs.directory.folder import RunDirectory
from rigidmc.runs.price import price
from tests.tools.commands import invoke
from tests.tools.scenes import FREE
from tests.tools.torture import sums

FEW = FREE.with_run(members=40)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    path = tmp_path_factory.mktemp("places") / "run"
    create(FEW, path, 1.0)
    resume.resume(path)
    return path


def test_no_output_goes_to_a_run_directory(whole, tmp_path):
    """`consolidate RUN -o RUN/shards/x.nc` was taken, and `resume --repair` deleted the result."""
    (whole / "new" / "below").mkdir(parents=True)
    (tmp_path / "link").symlink_to(whole)
    before = sorted(whole.rglob("*"))
    for path in (f"{whole}/x", f"{tmp_path}/link/shards/x", f"{whole}/new/below/x"):
        for words in (
            ["consolidate", whole, "-o", f"{path}.nc"],
            ["run", "tennis_racket", "-o", f"{path}.nc"],
            ["run", "tennis_racket", "-o", f"{path}.zarr"],
            ["run", "tennis_racket", "-o", f"{path}/"],
            ["run", "tennis_racket", "--plot", f"{path}.png"],
            ["map", "sleeping_top", "-o", f"{path}/"],
            ["rare", "heavy_top", "--of", "p(nutation_max >= 3)", "-o", f"{path}/"],
            ["merge", f"{path}/", whole],
            ["plot", whole, "-o", f"{path}.png"],
            ["view", whole, "-o", f"{path}.html"],
            ["rerun", whole, "--member", "1", "-o", f"{path}.nc"],
        ):
            told = invoke(*words)
            assert told.exit_code == 6 and "choose a place outside" in told.stderr, told.output
        with pytest.raises(OutputExists, match="choose a place outside"):
            rm.simulate(FEW, output=f"{path}.csv")
    assert sorted(whole.rglob("*")) == before and gather.verify(whole, 0) == []
    with rm.simulate(FEW, output=tmp_path / "run.json.nc"):
        pass  # the name of a file makes no run directory


def test_the_price_of_a_study_leaves_nothing_beside_a_run(tmp_path):
    """What a kill left beside the run stayed there; in the run `resume` deletes it."""
    directory, seen = create(FEW, tmp_path / "run", 1.0), []

    def studied(_):
        seen.append(([one.name for one in tmp_path.iterdir()], os.listdir(directory.path)))

    price(FEW, studied, 1, directory.path)
    assert seen and all(beside == ["run"] for beside, _ in seen)
    assert all(any(".part-" in name for name in inside) for _, inside in seen)
    assert not any(".part-" in name for name in os.listdir(directory.path))


UNCOMPILED = """
import json, sys, warnings
import rigidmc as rm
from rigidmc.runs.directory import resume
from rigidmc.runs.directory.create import create
path, told = sys.argv[1], []
try:
    resume.resume(path)
except rm.FileError as error:
    told.append(str(error))
from tests.runs.test_places_of_files import FEW
with warnings.catch_warnings(record=True) as found:
    warnings.simplefilter("always")
    made = rm.simulate(FEW, members=2, t_end=0.1, every=0.1)
    directory = create(FEW.with_run(t_end=0.1, every=0.1), path + "-plain", 1.0)
resume.resume(directory)
told += [made.attrs.get("compiled"), *(str(one.message) for one in found)]
print(json.dumps(told))
"""


def test_uncompiled_steps_say_so_and_do_not_mix(whole, tmp_path):
    """NUMBA_DISABLE_JIT changes last bits, and did so in the second half of a run."""
    create(FEW, tmp_path / "run", 1.0)
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
    done = subprocess.run(
        [sys.executable, "-c", UNCOMPILED, tmp_path / "run"],
        env=environment,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    refused, about, *notes = json.loads(done.stdout)
    assert "compiled yes there, no (NUMBA_DISABLE_JIT) here" in refused and about.startswith("no")
    assert [note[:24] for note in notes] == ["NUMBA_DISABLE_JIT is set"] * 2
    with pytest.raises(FileError, match=r"compiled no \(NUMBA_DISABLE_JIT\) there, yes here"):
        resume.resume(f"{tmp_path}/run-plain")
    assert "compiled" not in RunDirectory(whole).facts["versions"]
    resume.resume(tmp_path / "run")
    assert sums(tmp_path / "run") == sums(whole)
