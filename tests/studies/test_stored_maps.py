"""Maps in run directories and in files: the same numbers, whatever ended the run, and refusals."""

import json

import netCDF4
import numpy as np
import pytest

import rigidmc as rm
from rigidmc.errors import FileError, OptionError
from rigidmc.runs.directory import resume
from rigidmc.runs.directory.facts import facts_text, read_facts
from rigidmc.runs.directory.folder import RunDirectory
from rigidmc.studies.stability_map.compute import prepare_map
from rigidmc.studies.stability_map.question import make_request, read_stored_request
from rigidmc.studies.stability_map.stored import create_map, is_map, members_of_pixels, open_map
from tests.tools.commands import invoke

# of long steps, which maps take on purpose
pytestmark = pytest.mark.filterwarnings("ignore::rigidmc.errors.SceneWarning")
OMEGA = rm.normal(0.0, 0.05), 1.0, rm.normal(0.0, 0.05)
SCENE = rm.Scene(rm.Body((0.5, 1.0, 1.4)), start=rm.Start(omega=OMEGA))
# I1 <= I2 + I3 does not hold on the right
SIDES = ("body.moments.1", 0.2, 2.6), ("start.omega.2", 0.5, 1.5)
OF = ("p(flips >= 1)", "median(flip_wait)")
RUN = {"integrator": "rk8", "dt": 0.5, "t_end": 30.0}
SHAPE, REPLICAS = (60, 40), 8  # 19,200 members: 5 blocks


def in_memory(replicas=REPLICAS):
    return rm.stability_map(SCENE, *SIDES, OF, SHAPE, replicas, **RUN)


@pytest.fixture(scope="module")
def whole():
    return in_memory()


def started(path, replicas=REPLICAS):
    request = make_request(*SIDES, OF, SHAPE, replicas)
    return create_map(prepare_map(request, SCENE, **RUN), path, 1.0)


def mapped(*words):
    return invoke("map", *words)


def test_a_map_in_a_directory_is_the_one_in_memory(whole, tmp_path):
    directory = started(tmp_path / "map")
    assert directory.count == 5
    resume.resume(tmp_path / "map")
    found = rm.open(tmp_path / "map")
    assert found.identical(whole.drop_attrs(deep=False).assign_attrs(found.attrs))
    assert set(whole.attrs) - set(found.attrs) == {"seconds"}
    assert all(found.attrs[name] == whole.attrs[name] for name in ("asked", "members", "title"))
    assert bool((found.none > 0).any())  # bodies that cannot be are on the map
    assert is_map(tmp_path / "map")


def test_shards_in_any_order_are_replicas_of_every_pixel(whole, tmp_path):
    started(tmp_path / "map")
    resume.resume(tmp_path / "map", only=range(3, 5))
    part = rm.open(tmp_path / "map")
    there = part.good + part.failed + part.none
    # shards 3 and 4 are members 12,192 to 19,199: 2.9 replicas of 2,400 pixels
    assert part.attrs["missing"] == 19_200 - int(there.sum()) == 12_192
    assert int(there.min()) == 2 and int(there.max()) == 3
    resume.resume(tmp_path / "map", only=range(4))
    found = rm.open(tmp_path / "map")
    assert found.drop_attrs().identical(whole.drop_attrs())


def test_more_replicas_are_those_of_a_larger_map(whole, tmp_path):
    started(tmp_path / "map", 3)
    resume.resume(tmp_path / "map")
    resume.extend(tmp_path / "map", members_of_pixels(tmp_path / "map", REPLICAS))
    resume.resume(tmp_path / "map")
    found = rm.open(tmp_path / "map")
    assert found.drop_attrs().identical(whole.drop_attrs())
    assert found.attrs["members"] == REPLICAS


def test_pixels_in_parts_are_the_same(whole, monkeypatch):
    for chunk in (1000, 2400, 5000):  # some pixels, all of one replica, of two
        monkeypatch.setattr("rigidmc.studies.stability_map.compute.CHUNK", chunk)
        assert in_memory().drop_attrs().identical(whole.drop_attrs()), chunk


def test_a_map_in_a_file_is_read_back(whole, tmp_path):
    whole.to_netcdf(tmp_path / "map.nc")
    found = rm.open(tmp_path / "map.nc")
    assert found.identical(whole) and is_map(tmp_path / "map.nc")
    rm.simulate(SCENE, members=4, t_end=1.0, output=tmp_path / "run.nc").close()
    assert not is_map(tmp_path / "run.nc")
    with pytest.raises(FileError, match="contains no readable map"):
        open_map(tmp_path / "run.nc")
    assert rm.open(tmp_path / "run.nc").sizes["member"] == 4


def asking(file, **other):
    file.asked = json.dumps({**json.loads(file.asked), **other})


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda f: f.renameVariable("good", "bad"), "good"),
        (lambda f: f.renameVariable("p(flips>=1)_low", "low"), "flips>=1.*_low"),
        (lambda f: f.setncattr("asked", "[]"), "contains no readable map"),
        (lambda f: f.setncattr("scene", "[body]"), "start: is missing"),
        (lambda f: f.setncattr("seconds", "long"), "expected a number"),
        (lambda f: asking(f, columns=65), "expected .* numbers"),
        (lambda f: asking(f, columns=10**9), "contains no readable map"),
        (lambda f: asking(f, replicas=0), "contains no readable map"),
        (lambda f: asking(f, of=["mean(tilt)"]), "tilt"),
        (lambda f: asking(f, x=["body.moments.1", 2.0, 1.0, False]), "low < high"),
    ],
)
def test_a_file_that_is_no_map_is_refused(whole, tmp_path, change, words):
    whole.to_netcdf(tmp_path / "map.nc")
    with netCDF4.Dataset(tmp_path / "map.nc", "a") as file:
        change(file)
    with pytest.raises(rm.RigidmcError, match=words):
        rm.open(tmp_path / "map.nc")


def test_directories_that_are_no_map_are_refused(tmp_path):
    started(tmp_path / "map")
    with pytest.raises(FileError, match="no shard is finished yet"):
        rm.open(tmp_path / "map")
    facts = read_facts(str(tmp_path / "map" / "run.json"))
    facts["attributes"]["map"] = "{}"
    (tmp_path / "map" / "run.json").write_text(facts_text(facts))
    with pytest.raises(FileError, match="contains no readable map"):
        rm.open(tmp_path / "map")
    del facts["attributes"]["map"]
    (tmp_path / "map" / "run.json").write_text(facts_text(facts))
    with pytest.raises(FileError, match="is the run of a scene, not a map"):
        open_map(tmp_path / "map")
    with pytest.raises(FileError, match="contains no readable map"):
        read_stored_request(json.dumps({"columns": 10**9}), "map")
    with pytest.raises(OptionError, match="at most"):
        members_of_pixels(tmp_path / "map", 10**12)


def test_the_command_line_keeps_a_map_in_a_directory(tmp_path):
    path, words = tmp_path / "map", ("sleeping_top", "--resolution", 46, "--members", 2)
    told = mapped(*words, "-o", f"{path}/", "--shards", "0:1", "--shard-size", 0.01)
    assert told.exit_code == 0 and "of other jobs are missing" in told.stdout
    told = mapped(path, "--plot", tmp_path / "part.png")
    assert told.exit_code == 5 and "% of the members are done" in told.stdout
    assert invoke("resume", path).exit_code == 0
    assert invoke("verify", path).exit_code == 0
    assert mapped(path, "-o", tmp_path / "one.nc").exit_code == 0
    assert mapped(*words, "-o", tmp_path / "two.nc").exit_code == 0
    one, two = (rm.open(tmp_path / f"{name}.nc") for name in ("one", "two"))
    assert one.identical(two.drop_attrs(deep=False).assign_attrs(one.attrs))
    assert mapped(tmp_path / "one.nc", "--plot", tmp_path / "one.png").exit_code == 0
    assert RunDirectory(path).count > 1
    for more in (("--resolution", 32), ("--x", "a=0:1"), ("--dt", 0.1), ("--shards", "0:1")):
        told = mapped(path, *more)
        assert told.exit_code == 3 and "is for a new map" in told.stderr
    assert mapped(*words, "-o", f"{path}/").exit_code != 0  # it exists
    assert invoke("extend", path, "--members", "3").exit_code == 0
    assert int(rm.open(path).good.min()) == 3
    assert mapped(path, "--force").exit_code == 0  # nothing is written
    assert np.isfinite(rm.open(path)["p(passages>=1)"]).all()


def test_a_result_is_a_scene_for_a_map(tmp_path):
    rm.simulate(SCENE, members=4, t_end=1.0, output=tmp_path / "run.nc").close()
    sides = ("--x", "body.moments.1=0.4:0.6", "--y", "start.omega.2=0.9:1.1", "--of", OF[0])
    words = ("--resolution", 2, "--members", 2, "--t-end", 2)
    told = mapped(tmp_path / "run.nc", *sides, *words)
    assert told.exit_code == 0 and "2 x 2 pixels of 2 members" in told.stdout


def test_a_part_of_a_map_is_a_map_of_that_part(whole, tmp_path):
    ends = (0.4, 0.9), (0.8, 1.2)
    sides = [(name, *pair) for (name, _, _), pair in zip(SIDES, ends, strict=True)]
    expected = rm.stability_map(SCENE, *sides, OF, SHAPE, REPLICAS, **RUN)
    found = rm.zoom_map(whole, *ends)
    assert found.drop_attrs().identical(expected.drop_attrs())
    assert found.attrs["scene"] == expected.attrs["scene"]
    finer = rm.stability_map(SCENE, *sides, OF, (3, 2), REPLICAS, **RUN)
    assert rm.zoom_map(whole, *ends, resolution=(3, 2)).drop_attrs().identical(finer.drop_attrs())
    whole.to_netcdf(tmp_path / "map.nc")
    started(tmp_path / "map")  # no shard of it is needed
    for source in (tmp_path / "map.nc", tmp_path / "map"):
        told = mapped(source, "--zoom", "0.4:0.9,0.8:1.2", "-o", tmp_path / "part.nc", "--force")
        assert told.exit_code == 0, told.stderr
        assert rm.open(tmp_path / "part.nc").drop_attrs().identical(expected.drop_attrs())
    told = mapped(tmp_path / "map.nc", "--zoom", "0.4:0.9,0.8:1.2", "-o", f"{tmp_path}/part/")
    assert told.exit_code == 0
    assert rm.open(tmp_path / "part").drop_attrs().identical(expected.drop_attrs())


def test_parts_that_are_none_are_refused(whole, tmp_path):
    whole.to_netcdf(tmp_path / "map.nc")
    for words, rule in (
        ((tmp_path / "map.nc", "--zoom", "0.4:0.9"), "LOW:HIGH,LOW:HIGH"),
        ((tmp_path / "map.nc", "--zoom", "0.9:0.4,0.8:1.2"), "low < high"),
        ((tmp_path / "map.nc", "--zoom", "0.4:0.9,0.8:1.2", "--members", 8), "is for a new map"),
        ((tmp_path / "map.nc", "--zoom", "0.4:2.7,0.8:1.2"), "ranges from 0.2 to 2.6"),
        ((tmp_path / "map.nc", "--zoom", "0.4:0.9,0.4:1.2"), "ranges from 0.5 to 1.5"),
    ):
        told = mapped(*words)
        assert told.exit_code == 3 and rule in " ".join(told.stderr.split()), told.stderr
    with pytest.raises(OptionError, match=r"\(low, high\)"):
        rm.zoom_map(whole, 0.4, (0.8, 1.2))
    with pytest.raises(FileError, match="contains no readable map"):
        rm.zoom_map(whole.drop_attrs(), (0.4, 0.9), (0.8, 1.2))
