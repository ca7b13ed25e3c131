"""Input is checked before it is used: every way in which a file can lie, and the message."""

import errno
import json
import os
import pathlib
import subprocess
import sys
import time
import warnings

import netCDF4
import numpy as np
import pytest

import rigidmc as rm
from rigidmc.errors import FileError, SceneError, SceneWarning
from rigidmc.files.outputs import PartialFile
from rigidmc.files.reading import DEPTH, toml
from rigidmc.files.trial import refuse_unreadable
from rigidmc.runs.directory import folder as run_directory
from rigidmc.runs.directory import resume
from rigidmc.runs.directory.create import create
from rigidmc.runs.directory.facts import facts_text
from rigidmc.runs.directory.folder import RunDirectory
from rigidmc.studies.stress.hard_cases import load_bounds
from tests.tools import hostile
from tests.tools.commands import invoke
from tests.tools.faulty import within

fcntl = pytest.importorskip("fcntl", reason="locks, pipes and limits are those of POSIX")
resource = pytest.importorskip("resource")

SCENE = rm.Scene(
    rm.Body.from_moments((1.0, 2.0, 3.0)), start=rm.Start(omega=(0.1, 1.0, rm.normal(0.0, 0.1)))
)
RUN = {"dt": 0.05, "t_end": 0.5, "every": 0.1, "save": ("omega",)}


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    path = tmp_path_factory.mktemp("border") / "good.nc"
    rm.simulate(SCENE, members=40, output=str(path), **RUN).close()
    return path


@pytest.fixture
def directory(tmp_path):
    return RunDirectory(create(SCENE.with_run(members=40, **RUN), tmp_path / "run").path)


def changed(result, path, change):
    """A copy of a result with one thing changed."""
    made = hostile.Stored(result)
    change(made)
    made.write(path)
    return str(path)


def with_facts(directory, **facts):
    """Change facts of a run and its checksum."""
    known = {k: v for k, v in directory.facts.items() if k != "check"}
    (pathlib.Path(directory.path) / "run.json").write_text(facts_text({**known, **facts}))


@pytest.mark.parametrize(
    "text",
    [
        "a = " + "[" * 50_000 + "]" * 50_000,
        "a = " + "{ a = " * 50_000,
        "a" + ".a" * 50_000 + " = 1",
        "[" + "a." * 50_000 + "a]",
    ],
)
def test_toml_is_nested_a_hundred_deep_at_most(text, tmp_path):
    began = time.process_time()
    with pytest.raises(SceneError, match="nested more than 100 deep"):
        toml(text)
    # measured 0.01 s; Python's reader takes minutes for the third
    assert time.process_time() - began < 1.0
    assert toml(f"a = {'[' * DEPTH}{']' * DEPTH}") and toml(
        'a = "' + "[" * 1000 + '"  # ' + "[" * 1000
    )
    (tmp_path / "deep.toml").write_text(text)
    assert invoke("check", tmp_path / "deep.toml").exit_code == 3


CHANGES = {
    "scene is a number": (
        lambda f: f.attrs.update(scene=3.5),
        "no attribute 'scene' with the text",
    ),
    "scene is no TOML": (lambda f: f.attrs.update(scene="[[["), "scene in this result"),
    "scene of other effects": (
        lambda f: f.attrs.update(scene=f.attrs["scene"].replace("[effects]", "[effects.klingon]")),
        "klingon",
    ),
    "units are dates": (
        lambda f: f.variables["time"][2].update(units="days since 2000-01-01"),
        "units of 'days since",
    ),
    "axis is 99 long": (lambda f: f.dims.update(axis=99), "is 99 long along axis, expected 3"),
    "times go back": (
        lambda f: f.variables["time"].__setitem__(3, -f.variables["time"][3]),
        "expected ascending times",
    ),
    "a member twice": (
        lambda f: f.variables["member"].__setitem__(3, np.zeros(40)),
        "has duplicate indices",
    ),
    "a member it has not": (
        lambda f: f.variables["member"].__setitem__(3, np.arange(1, 41)),
        "has the members 0 to 39",
    ),
    "a status that is none": (
        lambda f: f.variables["status"].__setitem__(3, np.full(40, 77)),
        "status",
    ),
    "a variable is gone": (lambda f: f.variables.pop("moments"), "moments.*is missing"),
    "words for numbers": (lambda f: f.variables["omega"].__setitem__(1, "S1"), "omega.*of type"),
    "packed": (lambda f: f.variables["omega"][2].update(scale_factor=2.0), "packed"),
    "another seed": (lambda f: f.attrs.update(seed=5), "contradicts the scene"),
    "dt is text": (lambda f: f.attrs.update(dt="x"), "contradicts the scene"),
}


def renamed(file):
    file.dims = {"Member" if k == "member" else k: v for k, v in file.dims.items()}
    for one in file.variables.values():
        one[0] = tuple("Member" if d == "member" else d for d in one[0])


@pytest.mark.parametrize("name", [*CHANGES, "dimensions are renamed"])
def test_a_result_must_match_its_scene(result, tmp_path, name):
    change, words = CHANGES.get(name, (renamed, "member"))
    path = changed(result, tmp_path / "bad.nc", change)
    kind = SceneError if words in ("scene in this result", "klingon") else FileError
    with pytest.raises(kind, match=words) as error:
        rm.open(path)
    assert path in str(error.value)
    for command in (["summary", path], ["show", path], ["rerun", path, "--member", "1"]):
        done = invoke(*command)
        assert done.exit_code == 3 and len(done.stderr.splitlines()) == 1, done.output


# each takes 3 s: 30 attributes and 3 commands
SELDOM = [pytest.param(one, marks=pytest.mark.slow) for one in (3.5, np.zeros(0))]


@pytest.mark.parametrize("value", ["x", np.arange(2), *SELDOM], ids=repr)
def test_any_attribute_may_be_anything(result, tmp_path, value):
    """An array in place of a number once ended in a traceback: its truth value is ambiguous."""
    for name in hostile.Stored(result).attrs:
        path = changed(result, tmp_path / "x.nc", lambda f, n=name: f.attrs.update({n: value}))
        for command in (["summary", path], ["show", path], ["rerun", path, "--member", "1"]):
            done = invoke(*command)
            told = f"{name} {done.output} {done.exception}"
            assert done.exit_code == 0 or (
                done.exit_code == 3 and done.stderr.splitlines()[-1].startswith("rigidmc: ")
            ), told


def test_encodings_in_a_result_are_not_decoded(result, tmp_path):
    def change(file):
        file.variables["quat"][2].update(_Encoding="klingon")
        file.variables["omega"][2].update(
            _FillValue=0.0, coordinates="nowhere", calendar="lunar", long_name="$\\frac{"
        )

    with rm.open(changed(result, tmp_path / "odd.nc", change)) as odd, rm.open(str(result)) as good:
        assert odd.identical(good) and list(odd.quat.values) == ["w", "x", "y", "z"]


def test_variables_that_a_user_added_are_kept(result, tmp_path):
    """Of any type and dimensions, decoded as xarray decodes them."""
    with rm.open(str(result)) as ds:
        mine = ds.load().assign(
            tip=("member", np.arange(40.0)),
            good=("member", np.arange(40) % 3 == 0),
            tag=("member", [f"run {i}" for i in range(40)]),
            when=("member", np.datetime64("2026-01-01") + np.arange(40).astype("m8[D]")),
            sensor=("sensor", [1.0, np.nan, 3.0]),
            counts=(("time", "member"), np.ones((ds.sizes["time"], 40), int)),
        )
        mine = mine.assign_coords(site=("sensor", [5, 6, 7]), batch=7)
        packed = {"dtype": "i2", "scale_factor": 0.5, "_FillValue": -99}
        mine.to_netcdf(tmp_path / "mine.nc", encoding={"tip": packed})
        mine.drop_vars(["tag", "quat"]).to_zarr(tmp_path / "mine.zarr", consolidated=False)
    for name in ("mine.nc", "mine.zarr"):
        with rm.open(tmp_path / name) as found:
            for added in {"tip", "good", "tag", "when", "sensor", "counts", "site", "batch"} - (
                {"tag"} if name == "mine.zarr" else set()
            ):
                wanted = mine[added].reset_coords(drop=True)
                assert found[added].reset_coords(drop=True).equals(wanted), (name, added)
            assert found.rigid.rerun(3).attrs["rerun"].startswith("equal to the bit")


def test_what_cannot_be_decoded_is_left_out(result, tmp_path):
    def change(file):
        about = {"units": "days since the flood", "calendar": "lunar"}
        file.variables["mine"] = [("member",), "f8", about, np.zeros(40)]

    with (
        pytest.warns(SceneWarning, match="ignored.*mine"),
        rm.open(changed(result, tmp_path / "more.nc", change)) as ds,
    ):
        assert "mine" not in ds


def test_a_file_that_claims_a_terabyte_is_refused_by_its_header(result, tmp_path):
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for name in ("member", "omega", "extra"):
        path = changed(
            result,
            tmp_path / f"{name}.nc",
            lambda f, n=name: (
                f.variables.update({n: [("huge",), "f8", {}, np.zeros(1)]})
                or f.dims.update(huge=2**40)
            ),
        )
        with pytest.raises(FileError, match="more than the file can hold"):
            rm.open(path)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 1e5  # kB; measured 0


def test_a_file_that_crashes_the_library_is_refused(result, tmp_path):
    """An entry of HDF5's global heap is -16 bytes long: the library searches on for ever."""
    data, path = bytearray(result.read_bytes()), tmp_path / "endless.nc"
    at = data.index(b"GCOL") + 16
    data[at + 8 : at + 16] = (2**64 - 16).to_bytes(8, "little")
    path.write_bytes(data)
    with within(20.0), pytest.raises(FileError, match="crashes on it or takes too long"):
        rm.open(str(path))
    with rm.open(str(result)) as ds:  # and the next is opened by another helper
        assert ds.sizes["member"] == 40


def test_a_result_with_code_is_opened_without_running_it(tmp_path):
    text = (
        "from typing import NamedTuple\nclass Wind(NamedTuple):\n    size: float\n"
        "    def torque(self, t, l):\n        return self.size, 0.0, 0.0\n"
    )
    (tmp_path / "wind.py").write_text(text)
    (tmp_path / "scene.toml").write_text(
        '[body]\nmoments = [1.0, 2.0, 3.0]\n[effects.Wind]\nmodule = "wind.py"\nsize = { '
        "uniform = [0.1, 0.2] }\n[start]\nomega = [0.0, 1.0, 0.0]\n"
    )
    out = str(tmp_path / "r.nc")
    rm.simulate(
        rm.Scene.load(tmp_path / "scene.toml", allow_code=True),
        members=5,
        dt=0.05,
        t_end=0.5,
        output=out,
    ).close()
    with rm.open(out) as ds:
        assert ds.Wind_size.size == 5
        assert "equal to the bit" in rm.rerun(ds, 2, allow_code=True).attrs["rerun"]
        with pytest.raises(SceneError, match="allow-code"):
            ds.rigid.scene()


@pytest.mark.parametrize("axis", [0, 4, 99, -1, True, 1.0, [1]])
def test_rows_of_a_result_are_asked_for_by_name_and_axis(axis, tmp_path):
    rows = {"omega": np.zeros((3, 5))}
    text = (
        "[body]\nmoments = [1.0, 2.0, 3.0]\n[start]\n"
        f"omega = [{{ stored = 'omega', axis = {str(axis).lower()} }}, 0.0, 0.0]\n"
    )
    from rigidmc.scene.scene import loads

    with pytest.raises(SceneError, match="axis between 1 and 3"):
        loads(text, stored=rows.get)
    with pytest.raises(SceneError, match="rows that the result does not have"):
        loads(text.replace("'omega'", "'x'"), stored=rows.get)


@pytest.mark.parametrize(
    "facts", [{"members": 2**53}, {"seed": 2**64}, {"block": 2**40, "shard": 2**40}]
)
def test_a_run_of_too_many_members_is_refused_before_it_is_counted(directory, facts):
    with_facts(directory, **{"shard": 32, "block": 32, **facts})
    before, began = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.process_time()
    for command in ("status", "resume", "verify"):
        done = invoke(command, directory.path)
        assert (
            done.exit_code == 3
            and done.stderr.count("rigidmc:") == 1
            and "is damaged" in done.stderr
        ), done.output
    # measured 0, 0.02 s
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 1e5
    assert time.process_time() - began < 1.0


def test_the_status_of_ten_million_shards_is_quick(directory):
    with_facts(directory, members=2**53, shard=2**30, block=2**20)
    before, began = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.process_time()
    assert invoke("status", directory.path).exit_code == 5
    # so much memory is not free
    assert invoke("resume", directory.path).exit_code == 74
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 3e5
    assert time.process_time() - began < 2.0


def test_damaged_lines_of_the_journal_are_left_out(directory):
    resume.resume(directory)
    journal = pathlib.Path(directory.path) / "journal.jsonl"
    lines = ['{"time": 1e308, "event": "begun"}', "[" * 100_000, '{"a": ' * 100_000, "9" * 5000,
        '{"time": 1' + "0" * 400 + "}", '{"time": NaN, "event": "begun"}',
             '{"time": 9e10, "event": "ended", "members": ' + "9" * 400 + ', "seconds": 1.0}',
             "null", "1", "[]", '"x"', "true", "", "{}", '{"event": "begun"}', "\x00\xff",
             '{"time": 9e10, "event": "ended", "members": 5, "seconds": 1e-320}']  # fmt: skip
    journal.write_text("\n".join(lines) + "\n", encoding="latin-1")
    # in the last line, which is well formed, 5/1e-320 overflows
    with pytest.warns(SceneWarning, match=f"{len(lines) - 1} damaged lines are ignored"):
        assert run_directory.status(directory.path)["rate"] is None
    for command in ("status", "resume", "verify", "summary"):
        told = invoke(command, directory.path)
        assert told.exit_code == 0 and "Traceback" not in told.output, told.output
        assert ("damaged lines" in told.stderr) == (command != "summary")
    lines.append("x" * 2_000_000 + '\n{"time": 9.05e10, "event": "begun"}')
    good = {"time": 9.1e10, "event": "ended", "members": 50, "seconds": 2.0, "flagged": {}}
    journal.write_text("\n".join([*lines, json.dumps(good)]) + "\n", encoding="latin-1")
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # the first line of the part that is read is cut
        assert run_directory.status(directory.path)["rate"] == 25.0


def test_a_part_of_a_process_that_does_not_exist_is_deleted(directory):
    some = PartialFile(os.path.join(directory.path, "shards", "00000000"))
    some.discard()
    part = pathlib.Path(some.path)
    part = part.with_name(part.name.replace(f"-{os.getpid()}-", f"-{'9' * 20}-"))
    part.write_text("")
    assert invoke("resume", directory.path).exit_code == 0 and not part.exists()


def test_a_pipe_in_place_of_a_file_is_not_waited_for(result, tmp_path):
    """tests/files/test_opening.py has those in run directories."""
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    for name in ("p.nc", "p.toml", "p.csv", "p.stl"):
        (tmp_path / name).symlink_to(pipe)
    scene = (
        "[body]\nmoments = [1.0, 2.0, 3.0]\n[start]\n"
        'omega = [{ table = "p.csv", column = "a" }, 0.0, 0.0]\n'
    )
    (
        (tmp_path / "scene.toml").write_text(scene),
        (tmp_path / "other.toml").write_text(scene.replace("p.csv", "p.nc")),
    )
    with within(20.0):
        for words in (
            ["check", "p.toml"],
            ["show", "p.nc"],
            ["summary", "p.nc"],
            ["body", "p.stl"],
            ["check", "scene.toml"],
            ["check", "other.toml"],
        ):
            done = invoke(words[0], tmp_path / words[1])
            assert done.exit_code == 3 and "is a pipe" in done.stderr, (words, done.output)
        with pytest.raises(FileError, match="is a pipe"):
            load_bounds(str(pipe))
        refuse_unreadable(result)


def test_devices_folders_and_binary_files_are_named(tmp_path):
    (
        (tmp_path / "zero.toml").symlink_to("/dev/zero"),
        (tmp_path / "latin.toml").write_bytes(b'title = "\xe9"'),
        (tmp_path / "x.nc").write_text("x"),
    )
    (tmp_path / "long.toml").write_text("a = 1\n" * 3_000_000)
    for name, words in (
        ("zero.toml", "is a device"),
        ("latin.toml", "not UTF-8 text"),
        ("x.nc", "not a netCDF file"),
        ("long.toml", "larger than 4 MB"),
    ):
        done = invoke("show", tmp_path / name)
        assert done.exit_code == 3 and words in done.stderr and name in done.stderr, done.output


@pytest.mark.parametrize("code", [errno.ENOLCK, errno.EOPNOTSUPP])
def test_without_locks_nothing_is_written_and_the_remedy_is_named(monkeypatch, tmp_path, code):
    def flock(*_):
        raise OSError(code, os.strerror(code))

    monkeypatch.setattr(fcntl, "flock", flock)
    (tmp_path / "scene.toml").write_text(SCENE.with_run(members=40, **RUN).dumps())
    for out in ("run/", "one.nc"):
        done = invoke("run", tmp_path / "scene.toml", "-o", f"{tmp_path}/{out}")
        assert (
            done.exit_code == 74
            and "HDF5_USE_FILE_LOCKING=FALSE" in done.stderr
            and str(tmp_path) in done.stderr
        ), done.output
    assert os.listdir(tmp_path) == ["scene.toml"]
    monkeypatch.setenv("HDF5_USE_FILE_LOCKING", "FALSE")
    for out in ("run/", "one.nc"):
        done = invoke("run", tmp_path / "scene.toml", "-o", f"{tmp_path}/{out}")
        assert done.exit_code == 0, done.output
    assert run_directory.status(tmp_path / "run")["done"] == 1


def test_a_lock_of_another_process_is_detected(directory):
    code = (
        "import fcntl, sys; file = open(sys.argv[1], 'ab'); fcntl.flock(file, "
        "fcntl.LOCK_EX); print(1, flush=True); sys.stdin.read()"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code, f"{directory.path}/lock"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    ) as other:
        other.stdout.readline()
        assert invoke("resume", directory.path).exit_code == 6
        other.stdin.close()


@pytest.mark.parametrize("word", ["table", "key", "value", "make", "name"])
def test_parameters_of_a_law_may_have_any_name(word):
    """Before, they went to Python as they stood, and some were taken for its own parameters."""
    scene = (
        f"[body]\nmoments = [1.0, 2.0, {{ beta = {{ a = 2.0, b = 3.0, {word} = 1.0 }} }}]\n"
        "[start]\nomega = [0.0, 1.0, 0.0]\n"
    )
    with pytest.raises(SceneError, match="keys a, b, loc, scale"):
        rm.Scene.loads(scene)


def test_a_dimension_twice_is_refused(tmp_path):
    with netCDF4.Dataset(tmp_path / "twice.nc", "w") as file:
        file.createDimension("member", 2)
        file.createVariable("status", "i1", ("member", "member"))
    with pytest.raises(FileError, match="status has the same dimension twice"):
        refuse_unreadable(tmp_path / "twice.nc")
