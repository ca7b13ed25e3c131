"""Run directories: whatever ends them, resume completes them to the bytes of an unbroken run.

Damage is found.
"""

import contextlib
import hashlib
import json
import math
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from unittest.mock import patch

import numpy as np
import pytest

import rigidmc as rm
from bench.bits import PROCESSORS, environment
from rigidmc.errors import FileError, NoRoom, OptionError, OutputExists, SceneWarning
from rigidmc.files.locks import lock
from rigidmc.files.netcdf import read
from rigidmc.files.outputs import PartialFile, content_of
from rigidmc.runs.directory import cluster, gather, resume
from rigidmc.runs.directory import folder as run_directory
from rigidmc.runs.directory.create import create
from rigidmc.runs.directory.dataset import open_run
from rigidmc.runs.directory.facts import facts_text
from rigidmc.runs.directory.folder import RunDirectory
from tests.tools import torture
from tests.tools.commands import ALONE_COMMAND, COMMAND, invoke, words_of
from tests.tools.faulty import LINUX
from tests.tools.same import assert_same
from tests.tools.scenes import FREE as SCENE
from tests.tools.scenes import WITH_HISTOGRAM
from tests.tools.torture import sums

MEMBERS, SIZE = 1000, 40_000  # five shards of 192 members, the last of them partial


def changed(path, **facts):
    """Change facts of a run and its checksum."""
    known = json.loads((path / "run.json").read_text())
    del known["check"]
    (path / "run.json").write_text(facts_text({**known, **facts}))


def started(path, **run):
    """A run directory of the scene, nothing computed; blocks of 32 members, so that their order can
    go wrong.
    """
    create(SCENE.with_run(**run), path, SIZE)
    changed(path, block=32, shard=192)
    return RunDirectory(path)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    path = tmp_path_factory.mktemp("runs") / "whole"
    started(path)
    resume.resume(path, threads=2)
    return path


def test_a_run_equals_a_file(whole, tmp_path):
    ds, direct = gather.consolidate(whole, tmp_path / "one.nc"), rm.simulate(SCENE)
    assert_same(direct, ds)
    assert ds.attrs["scene"] == direct.attrs["scene"] and set(ds.data_vars) == set(direct.data_vars)
    assert run_directory.status(whole)["done"] == 6 and gather.verify(whole) == []
    assert "differs" not in rm.rerun(ds, 777).attrs["rerun"]
    ds.close()


@pytest.mark.parametrize(
    ("threads", "block", "order"),
    [(1, 32, (range(6),)), (2, 96, (range(3, 6), range(3))), (5, 64, (range(1, 2), range(6)))],
)
def test_no_byte_depends_on_threads_blocks_or_order(whole, tmp_path, threads, block, order):
    started(tmp_path / "run")
    for part in order:
        resume.resume(tmp_path / "run", threads=threads, block=block, only=part)
    assert sums(tmp_path / "run") == sums(whole)
    files = tmp_path / "one.nc", tmp_path / "two.nc"
    for path, file in zip((tmp_path / "run", whole), files, strict=True):
        gather.consolidate(path, file).close()
    assert files[0].read_bytes() == files[1].read_bytes()


@pytest.mark.slow  # 18 s; tests/engine/test_bits.py has the widths
def test_another_processor_goes_on_with_the_same_bytes(whole, tmp_path):
    started(tmp_path / "run")
    resume.resume(tmp_path / "run", only=range(2))
    cache = {"RIGIDMC_CACHE_DIR": str(tmp_path / "cache")}
    other = {**environment(list(PROCESSORS)[-1]), **cache}
    words = [*ALONE_COMMAND, "resume", str(tmp_path / "run")]
    done = subprocess.run(words, env=other, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert sums(tmp_path / "run") == sums(whole)


def test_an_extended_run_is_one_of_that_size(whole, tmp_path):
    started(tmp_path / "run", members=500)
    resume.resume(tmp_path / "run")
    early = sums(tmp_path / "run")
    resume.extend(tmp_path / "run", MEMBERS)
    resume.resume(tmp_path / "run")
    assert sums(tmp_path / "run") == sums(whole)
    assert {name: s for name, s in early.items() if name < "00000002"}.items() <= sums(
        whole
    ).items()
    with pytest.raises(OptionError, match="already"):
        resume.extend(tmp_path / "run", MEMBERS)


def test_a_run_is_opened_without_reading_it(whole, tmp_path):
    ds, direct = rm.open(str(whole)), rm.simulate(SCENE)
    assert all(
        name in ("time", "axis", "quat", "member") or ds[name].chunks is not None
        for name in ds.variables
    )
    assert_same(direct, ds)
    assert "equal to the bit" in ds.rigid.rerun(500).attrs["rerun"]
    started(tmp_path / "part")
    resume.resume(tmp_path / "part", only=range(2, 4))
    with pytest.warns(SceneWarning, match="384 of"):
        part = rm.open(str(tmp_path / "part"))
    assert np.array_equal(part.member.values, np.arange(384, 768))
    assert np.array_equal(part.omega_max.values, direct.omega_max.values[:, 384:768])


def test_histograms_are_summed(tmp_path):
    scene = SCENE.with_run(save=WITH_HISTOGRAM)
    directory = create(scene, tmp_path / "run", SIZE)
    resume.resume(directory.path)
    assert np.array_equal(
        rm.open(directory.path).histogram.values, rm.simulate(scene).histogram.values
    )
    with gather.consolidate(directory.path, tmp_path / "one.nc") as ds:
        assert np.array_equal(ds.histogram.values, rm.simulate(scene).histogram.values)


def test_damage_is_found_and_computed_again(whole, tmp_path):
    """As `python tests/tools/torture.py --corrupt 40`."""
    shutil.copytree(whole, tmp_path / "run")
    told = torture.corrupt(40, str(tmp_path), random.Random(7), str(tmp_path / "run"))
    assert told.pop("crashes of verify") == 0 and set(told.values()) == {40}
    assert sums(tmp_path / "run") == sums(whole)


STUDIES = (
    *("sensitivity", "section", "frequencies", "basins", "ftle", "rare", "multilevel"),
    *("lyapunov", "fit"),
)


@LINUX
@pytest.mark.slow
@pytest.mark.parametrize("kind", ["table", "adaptive", *STUDIES])
def test_twenty_kills(kind, tmp_path):
    """As `python tests/tools/torture.py --kills 20 --kinds section`."""
    told = torture.kills(20, str(tmp_path), random.Random(9), names=[kind])
    assert told["kills"] == 20 and told["torn shards seen"] == 0
    assert told["other exit codes"] == told["partial files left"] == 0
    assert told["sha256 equal"] == told["runs resumed to the end"] == told["runs"] >= 1
    assert told["studies equal"] == told["studies"] == told["runs"] * (kind in STUDIES)


@LINUX
@pytest.mark.filterwarnings("ignore:.*damaged lines are ignored")  # of a journal that was torn
@pytest.mark.parametrize(
    "command", ["run", *(pytest.param(one, marks=pytest.mark.slow) for one in ("extend", "merge"))]
)
def test_a_fault_of_every_kind(tmp_path, command):
    """As `python tests/tools/torture.py --faults all`."""
    told = torture.faults(1, str(tmp_path), random.Random(6), (command,))
    assert told["faults"] >= 10 and told["wrong shards seen"] == 0
    assert (
        told["faults"]
        == told["completed, sha256 equal"]
        == told["exit 74, one message"] + told["no harm done, exit 0"]
    )


BESIDE = """
import gc, sys, threading
import rigidmc as rm
from rigidmc.runs.directory import gather, resume
from rigidmc.runs.directory.create import create
from rigidmc.scene.scene import Scene
from rigidmc.runs.directory import folder as run_directory
folder, run = sys.argv[1], dict(members=60000, t_end=1.0, every=0.5, save=("omega",))
scene = Scene.load("tennis_racket").with_run(**run)
for i in range(60):
    rm.simulate(scene, members=50, output=f"{folder}/{i}.nc").close()
kept = [rm.open(f"{folder}/{i}.nc") for i in range(60)]
create(scene, f"{folder}/run", 100_000)
run = threading.Thread(target=resume.resume, args=(f"{folder}/run", 2))
run.start()
while run.is_alive():
    dropped = [kept.pop() if kept else None, rm.open(f"{folder}/0.nc"), rm.open(f"{folder}/0.nc")]
    dropped.append(dropped)  # freed by the collector, in whichever thread it runs
    del dropped
    gc.collect()
run.join()
assert run_directory.status(f"{folder}/run")["members_done"] == 60000
assert gather.verify(f"{folder}/run") == []
"""


FULL = """
import gc, sys
import netCDF4
import rigidmc as rm
from rigidmc.scene.scene import Scene
from rigidmc.results.writer import write_columns
from tests.tools.torture import limited
folder, run, told = sys.argv[1], dict(members=3000, t_end=1.0, every=0.5, save=("omega",)), 0
scene = Scene.load("tennis_racket").with_run(**run)
whole = rm.simulate(scene).omega.values
def one():
    rm.simulate(scene, output=f"{folder}/one.nc", force=True).close()
for i in range(40):
    for size, made in ((20_000 * i, one),
                       (4_000 * i, lambda: write_columns(f"{folder}/{i}.nc", {"x": whole}))):
        try:
            with limited(size):
                made()
        except OSError as error:
            told += f"{folder}/" in str(error) and "GB are free" in str(error)
gc.collect()
left = sum(isinstance(one, netCDF4.Dataset) for one in gc.get_objects())
assert 20 < left <= told < 80, (left, told)  # 61 of 61
"""


@pytest.mark.parametrize("script", [FULL, pytest.param(BESIDE, marks=pytest.mark.slow)])  # 16 s
def test_the_library_of_netcdf_survives(tmp_path, script):
    """A full disk: it frees a file whose close fails; a later run crashed when the collector closed
    that file once more. Results opened and dropped beside a run: it is not thread-safe, and crashed
    without the lock of writers, and with strings in files opened twice.
    """
    words = [sys.executable, "-X", "faulthandler", "-c", script, tmp_path]
    done = subprocess.run(words, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr[-2000:]
    assert not list(tmp_path.glob(".part-*"))


@pytest.mark.parametrize(
    ("number", "code"),
    [
        (signal.SIGUSR1, 5),
        # 3 s each; tests/cli/test_commands.py sends them to a run with one file
        pytest.param(signal.SIGTERM, 143, marks=pytest.mark.slow),
        pytest.param(signal.SIGINT, 130, marks=pytest.mark.slow),
    ],
)
def test_a_run_that_is_asked_to_stop_says_so(tmp_path, number, code):
    text = "run tennis_racket --members 2000000 --every 0.5 --save omega --shard-size 2 -o"
    words = words_of(text, f"{tmp_path}/run/")
    # tests in the background ignore SIGINT, and so would the processes they start
    heard = {"preexec_fn": lambda: signal.signal(signal.SIGINT, signal.SIG_DFL)}
    child = subprocess.Popen(
        [*COMMAND, *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **heard
    )
    while child.poll() is None and not list((tmp_path / "run").glob("shards/*.nc")):
        time.sleep(0.01)
    child.send_signal(number)
    _, told = child.communicate(timeout=60)
    assert child.returncode == code and "Traceback" not in told and told.count("rigidmc:") == 1
    assert not [p for p in (tmp_path / "run").rglob("*") if ".part-" in p.name]
    assert invoke("status", f"{tmp_path}/run").exit_code == 5


def test_a_new_run_belongs_to_its_maker(tmp_path):
    """A resume beside a writer that had not locked its new run yet computed all of it."""

    def is_free(name):
        with open(tmp_path / name / "lock", "ab+") as other:
            try:
                lock(other, "lock")
            except BlockingIOError:
                return False
            return True

    directory = create(SCENE, tmp_path / "run")
    assert not is_free("run")
    assert f"process {os.getpid()} of" in (tmp_path / "run" / "lock").read_text()
    with directory.locked():
        assert not is_free("run")
    assert is_free("run")
    abandoned = create(SCENE, tmp_path / "other")
    assert not is_free("other")
    del abandoned  # as after Ctrl-C in a notebook
    assert is_free("other")


def test_a_run_with_other_inputs_is_refused(whole, tmp_path):
    started(tmp_path / "run")
    facts = RunDirectory(tmp_path / "run").facts
    changed(tmp_path / "run", versions={**facts["versions"], "numba": "0.1"})
    with pytest.raises(FileError, match=r"numba 0\.1 there"):
        resume.resume(tmp_path / "run")
    assert resume.resume(tmp_path / "run", accept=True)[1]["ok"] == MEMBERS
    text = (tmp_path / "run" / "scene.toml").read_text()
    (tmp_path / "run" / "scene.toml").write_text(text.replace("seed = 4", "seed = 5"))
    with pytest.raises(FileError, match="is not the scene"):
        resume.resume(tmp_path / "run", accept=True)
    with pytest.raises(OutputExists, match="resume"):
        create(SCENE, tmp_path / "run")
    with pytest.raises(FileError, match="not a run directory"):
        resume.resume(tmp_path)
    for text in (
        "",
        "[1]",
        "{",
        '{"format": 1}',
        json.dumps({**facts, "seed": 7}),
        json.dumps({**facts, "format": 9}),
    ):
        (tmp_path / "run" / "run.json").write_text(text)
        with pytest.raises(FileError, match=r"run\.json"):
            resume.resume(tmp_path / "run")


def test_two_writers_are_one_too_many(tmp_path):
    directory = started(tmp_path / "run")
    with directory.locked(), pytest.raises(OutputExists, match="writing to it"):
        resume.resume(tmp_path / "run")
    assert resume.resume(tmp_path / "run")[1]["ok"] == MEMBERS


def test_a_run_changed_by_another_process_is_refused(whole, tmp_path):
    shutil.copytree(whole, tmp_path / "run")
    early = RunDirectory(tmp_path / "run")
    resume.extend(tmp_path / "run", 2 * MEMBERS)
    resume.resume(tmp_path / "run")
    with (
        patch.object(gather, "RunDirectory", lambda path: early),
        pytest.raises(OutputExists, match="changed by another"),
    ):
        gather.repair(tmp_path / "run")  # to which the new shards are none
    assert run_directory.status(tmp_path / "run")["members_done"] == 2 * MEMBERS


def test_parts_of_running_writers_stay(tmp_path):
    directory = started(tmp_path / "run")
    gone = subprocess.Popen([sys.executable, "-c", ""])
    gone.wait()
    # this process writes nothing now
    names = {os.getpid(): False, os.getppid(): True, gone.pid: False}
    some = PartialFile(tmp_path / "x")
    some.discard()
    here = os.path.basename(some.path).rsplit("-", 2)[0]
    for process in names:
        (tmp_path / "run" / "shards" / f"{here}-{process}-7").touch()
    late, old = (tmp_path / "run" / f".part-elsewhere-{n}-7" for n in (1, 2))
    late.touch(), old.touch()
    os.utime(old, (0.0, 0.0))
    directory.clear()
    assert {process: bool(list(tmp_path.rglob(f"*-{process}-7"))) for process in names} == names
    assert late.exists() and not old.exists()


def test_a_pipe_among_the_shards_is_a_stray(tmp_path):
    """tests/files/test_opening.py has links and pipes in all places."""
    started(tmp_path / "run")
    os.mkfifo(tmp_path / "run" / "shards" / "00000000-0-0000000000000000.nc")
    told = run_directory.status(tmp_path / "run")
    assert told["strays"] == 1 and told["done"] == 0
    assert gather.repair(tmp_path / "run") == 1


def test_what_bears_the_name_of_a_shard(tmp_path):
    """A folder is told, and the shard no longer goes to a file beside it; links and pipes are
    replaced."""
    directory = started(tmp_path / "run")
    resume.resume(tmp_path / "run")
    last = directory.shards()[directory.count - 1]
    names = sorted(os.listdir(tmp_path / "run" / "shards"))
    for make in (os.mkdir, os.mkfifo, lambda name: os.symlink("mine", name)):
        os.unlink(last)
        make(last)
        if make is os.mkdir:
            with pytest.raises(FileError, match=rf"shard = {directory.count - 1}: a folder has"):
                resume.resume(tmp_path / "run")
            assert sorted(os.listdir(tmp_path / "run" / "shards")) == names
            os.rmdir(last)
        resume.resume(tmp_path / "run")
        assert directory.shards()[directory.count - 1] == last


def test_a_run_whose_reader_has_gone_goes_on(tmp_path):
    words = ["run", "tennis_racket", "--members", "20000", "--t-end", "1", "-o", f"{tmp_path}/run/"]
    read, write = os.pipe()
    os.close(read)
    lines = (
        "from rigidmc.processes import progress; progress._LINE_SECONDS = 0.0; from rigidmc.cli "
        "import main; main()"
    )
    made = subprocess.run([sys.executable, "-c", lines, *words], stderr=write, stdout=write)
    os.close(write)
    assert made.returncode == 0 and run_directory.status(tmp_path / "run")["members_done"] == 20000


@LINUX
@pytest.mark.slow  # 17 s: five processes that import all
def test_a_cluster_that_loses_a_worker_makes_the_same_bytes(tmp_path):
    """Two local processes, one of them killed."""
    told = torture.lost(1, str(tmp_path), random.Random(8), 200_000)
    assert told == {"workers killed": 1, "runs": 1, "runs that ended well": 1, "sha256 equal": 1}


@LINUX
def test_a_cluster_makes_the_same_bytes(whole, tmp_path):
    """A local process; and a worker that does not see the run directory."""
    started(tmp_path / "run")
    resume.resume(tmp_path / "run", cluster="local:1")
    assert sums(tmp_path / "run") == sums(whole)
    texts = tuple(content_of(str(whole), name) for name in cluster.FILES)
    i, found, name, data = cluster.shard(5, str(tmp_path / "elsewhere"), texts, cluster.Resume())
    assert (i, found["ok"]) == (5, 40) and hashlib.sha256(data).hexdigest() == sums(whole)[name]
    for where in ("here:2", "local:0", "tcp"):
        with pytest.raises(OptionError, match="cluster = "):
            resume.resume(started(tmp_path / where.replace("/", "")), cluster=where)


def test_the_parts_of_a_job_array_are_one_run(whole, tmp_path):
    parts = [tmp_path / f"part{k}" for k in range(3)]
    for k, part in enumerate(parts):
        started(part)
        resume.resume(part, only=range(2 * k, 2 * k + 2))
    assert gather.merge(tmp_path / "all", parts[:2])[1] == 4
    assert gather.merge(tmp_path / "all", parts)[1] == 2
    assert sums(tmp_path / "all") == sums(whole) and gather.verify(tmp_path / "all") == []
    started(tmp_path / "other", seed=5)
    with pytest.raises(FileError, match="seed"):
        gather.merge(tmp_path / "all", [tmp_path / "other"])
    shard = min((parts[0] / "shards").iterdir())
    shard.write_bytes(shard.read_bytes()[:-1])
    with pytest.raises(FileError, match="its checksum"):
        gather.merge(tmp_path / "new", parts)


def test_rows_of_their_own_go_with_the_run(tmp_path):
    some = np.random.default_rng(1)
    start = rm.Start(omega=(some.normal(size=MEMBERS), 1.0, rm.normal(0.0, 0.1)))
    scene = rm.Scene(
        rm.Body.from_moments((some.uniform(1.0, 1.2, MEMBERS), 2.0, 3.0)), start=start
    ).with_run(**SCENE.run.model_dump(exclude={"turn"}))
    directory = create(scene.with_run(members=600), tmp_path / "run", SIZE)
    resume.resume(directory)
    resume.extend(directory.path, MEMBERS)
    resume.resume(directory.path)
    made, direct = rm.open(directory.path), rm.simulate(scene)
    assert_same(direct, made)
    assert gather.verify(directory.path) == []
    with pytest.raises(OptionError, match="rows for 1,000"):
        resume.extend(directory.path, MEMBERS + 1)
    data = bytearray((tmp_path / "run" / "columns.nc").read_bytes())
    data[len(data) // 2] ^= 1
    (tmp_path / "run" / "columns.nc").write_bytes(data)
    with pytest.raises(FileError, match=r"columns\.nc"):
        gather.verify(directory.path)


def test_a_run_killed_before_it_began_leaves_nothing(tmp_path):
    with (
        patch("rigidmc.runs.directory.create.facts_text", side_effect=KeyboardInterrupt),
        pytest.raises(KeyboardInterrupt),
    ):
        create(SCENE, tmp_path / "run")
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "scene.toml").write_text("mine")
    with pytest.raises(OutputExists):
        create(SCENE, tmp_path / "mine")
    assert (tmp_path / "mine" / "scene.toml").read_text() == "mine"


def test_no_path_leads_out_of_a_run(whole, tmp_path):
    """Names of shards are numbers and sums; a run.json changed by hand has another sum, and
    contains no path anyway.
    """
    started(tmp_path / "run")
    outside = tmp_path / "outside.nc"
    shutil.copy(min((whole / "shards").iterdir()), outside)
    for name in (
        "00000000-0-../../outside.nc",
        "..%2Foutside.nc",
        "00000000-0-ABCDEF0123456789.nc",
        "99999999-0-0123456789abcdef.nc",
        "x",
    ):
        with contextlib.suppress(OSError):
            (tmp_path / "run" / "shards" / name).write_bytes(b"")
    (tmp_path / "run" / "shards" / "00000000-0-0123456789abcdef.nc").symlink_to(outside)
    assert RunDirectory(tmp_path / "run").shards() == {}
    resume.resume(tmp_path / "run")
    assert sums(whole).items() <= sums(tmp_path / "run").items()
    assert outside.read_bytes() == min((whole / "shards").iterdir()).read_bytes()


def test_shards_are_those_of_their_numbers(whole, tmp_path):
    """Swapped, duplicated, beyond the run, misnamed: verify finds it, other commands refuse it,
    repair mends it.
    """

    def shard(path, i):
        return RunDirectory(path).shards()[i]

    def swapped(path):
        one, two = shard(path, 1), shard(path, 2)
        os.rename(one, one.replace("00000001", "00000002"))
        os.rename(two, two.replace("00000002", "00000001"))

    def beyond(path):
        shutil.copy(shard(path, 1), shard(path, 1).replace("00000001", "00000009"))

    def doubled(path):
        shutil.copy(shard(path, 1), path / "shards" / "00000001-7-deadbeefdeadbeef.nc")

    def misnamed(path):
        os.rename(shard(path, 3), shard(path, 3).replace("00000003-0-", "00000003-5-"))

    for spoil in (swapped, beyond, doubled, misnamed):
        path = tmp_path / spoil.__name__
        shutil.copytree(whole, path)
        spoil(path)
        assert gather.verify(path, spot=0), spoil
        with pytest.raises(FileError):
            gather.consolidate(path, tmp_path / "one.nc")
        if spoil is not misnamed:
            with pytest.raises(FileError):
                open_run(path).load()
        assert gather.repair(path) >= 1
        resume.resume(path)
        assert sums(path) == sums(whole) and gather.verify(path, spot=0) == []
    beyond(path)
    with pytest.raises(FileError, match="not a shard of this run"):
        resume.extend(path, 2 * MEMBERS)


def test_a_shard_of_another_run_is_refused(whole, tmp_path):
    started(tmp_path / "other", seed=5)
    resume.resume(tmp_path / "other")
    started(tmp_path / "run")
    resume.resume(tmp_path / "run", only=range(5))
    shutil.copy(RunDirectory(tmp_path / "other").shards()[5], tmp_path / "run" / "shards")
    assert run_directory.status(tmp_path / "run")["done"] == 6  # by its name
    (found,) = gather.verify(tmp_path / "run", spot=0)
    assert "another run" in found
    opened = rm.open(tmp_path / "run")
    assert opened.omega_max.isel(member=slice(0, 960)).values.shape == (3, 960)
    for use in (
        opened.load,
        lambda: gather.consolidate(tmp_path / "run", tmp_path / "one.nc"),
        lambda: gather.merge(tmp_path / "new", [tmp_path / "run"]),
    ):
        with pytest.raises(FileError, match="another run"):
            use()
    made = invoke("resume", f"{tmp_path}/run", "--repair")
    assert made.exit_code == 0
    assert "1 damaged" in made.stdout
    assert sums(tmp_path / "run") == sums(whole)
    shutil.copy(
        min((whole / "shards").iterdir()),
        tmp_path / "run" / "shards" / "00000001-0-0000000000000000.nc",
    )
    told = invoke("status", f"{tmp_path}/run")
    assert told.exit_code == 3 and "not belong to this run" in told.stderr


def test_part_of_a_run_is_told_as_part(tmp_path):
    started(tmp_path / "run")
    resume.resume(tmp_path / "run", only=range(4, 99))
    with pytest.warns(SceneWarning, match="232 of 1,000 members exist"):
        rm.open(tmp_path / "run")
    told = invoke("summary", f"{tmp_path}/run")
    assert told.exit_code == 0
    assert "232 of 1,000 members" in told.stdout
    assert "232 of 1,000" in told.stderr
    assert run_directory.status(tmp_path / "run")["rate"] == pytest.approx(
        232 / journal(tmp_path / "run")[-1]["seconds"]
    )


def journal(path):
    return RunDirectory(path).journal()


def test_bad_arguments(whole, tmp_path):
    scene = SCENE.with_run(members=100)
    for bad in (
        lambda: create(scene, tmp_path / "run", 0),
        lambda: create(scene, tmp_path / "run", math.nan),
        lambda: create(scene, tmp_path / "run", only=range(7, 9)),
        lambda: resume.resume(whole, only=1), lambda: resume.resume(whole, threads=-1),
        lambda: resume.resume(whole, threads=0), lambda: resume.resume(whole, block=0),
        lambda: resume.resume(whole, max_wall="soon"),
        lambda: resume.resume(whole, max_wall=math.nan), lambda: resume.extend(whole, 6000.5),
        lambda: resume.extend(whole, "9000"),
        lambda: gather.verify(whole, spot=-1), lambda: gather.merge(tmp_path / "new", []),
        lambda: gather.merge(tmp_path / "new", str(whole)),
    ):  # fmt: skip
        with pytest.raises(OptionError):
            bad()
    with pytest.raises(FileNotFoundError, match="no such folder"):
        gather.consolidate(whole, tmp_path / "no" / "one.nc")
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "empty").mkdir()
    os.symlink(tmp_path / "empty", tmp_path / "link")
    assert create(scene, tmp_path / "link").path == str(tmp_path / "empty")
    assert invoke("run tennis_racket -o", f"{tmp_path}/x/", "--shards", "90:99").exit_code == 3
    assert "names a folder" in invoke("run tennis_racket --plot", f"{tmp_path}/x/").stderr
    assert not (tmp_path / "x").exists()


def test_bad_input_is_refused_before_anything_changes(whole, tmp_path):
    shutil.copytree(whole, tmp_path / "run")
    before = {p: p.read_bytes() for p in (tmp_path / "run").rglob("*") if p.is_file()}
    for members, error in (
        (19 * 10**8, NoRoom),
        (9 * 10**12, OptionError),
        (10**30, OptionError),
        (MEMBERS, OptionError),
    ):
        with pytest.raises(error):
            resume.extend(tmp_path / "run", members)
    with pytest.raises(OptionError, match="0 to 5"):
        resume.resume(tmp_path / "run", only=range(6, 7))
    assert {p: p.read_bytes() for p in (tmp_path / "run").rglob("*") if p.is_file()} == before
    for words in (
        ["--max-wall", "soon"],
        ["--shards", "5"],
        ["--shards", "\u00b2:3"],
        ["--cluster", "here"],
        ["--shard-size", "inf"],
    ):
        made = invoke("run tennis_racket -o", f"{tmp_path}/no/", *words)
        assert made.exit_code == 3 and not (tmp_path / "no").exists(), made.output
    with pytest.raises(FileError, match="no shard exists yet"):
        rm.open(started(tmp_path / "new").path)
    (tmp_path / "run" / "notes.part-2.txt").write_text("mine")
    shutil.rmtree(tmp_path / "run" / "shards")
    (tmp_path / "run" / "journal.jsonl").unlink()
    (tmp_path / "run" / "journal.jsonl").mkdir()
    resume.resume(tmp_path / "run")
    assert sums(tmp_path / "run") == sums(whole)
    assert (tmp_path / "run" / "notes.part-2.txt").read_text() == "mine"


def test_two_readers_of_a_run_do_not_mix(whole, tmp_path):
    shutil.copytree(whole, tmp_path / "run")
    hidden = RunDirectory(tmp_path / "run").shards()[1]
    os.rename(hidden, tmp_path / "hidden")
    with pytest.warns(SceneWarning, match="808 of"):
        early = rm.open(tmp_path / "run")
    assert "equal to the bit" in rm.rerun(early, 500).attrs["rerun"]
    with (
        pytest.warns(SceneWarning, match="808 of"),
        pytest.raises(OptionError, match="808 of its 1,000 members, not this one"),
    ):
        rm.rerun(tmp_path / "run", 300)
    os.rename(tmp_path / "hidden", hidden)
    late = rm.open(tmp_path / "run")
    import dask

    one, two = dask.compute(early.omega.data, late.omega.data)
    assert np.array_equal(two, rm.simulate(SCENE).omega.values)
    assert np.array_equal(one, np.delete(two, np.s_[192:384], axis=2))


def test_a_shard_that_cannot_be_read_is_named(whole, tmp_path):
    shutil.copytree(whole, tmp_path / "run")
    opened, path = rm.open(tmp_path / "run"), RunDirectory(tmp_path / "run").shards()[2]
    with open(path, "rb") as file:
        data = file.read()
    values = read(path, "omega_max")["omega_max"].tobytes()
    at = data.index(values[:64]) if values[:64] in data else len(data) // 2
    for bad in (
        data[:at] + bytes([data[at] ^ 1]) + data[at + 1 :],
        data[: len(data) // 3],
        b"nothing",
    ):
        with open(path, "wb") as file:
            file.write(bad)
        with pytest.raises(FileError, match=r"00000002.*cannot be read"):
            opened.omega_max.values  # noqa: B018
    os.unlink(path)
    with pytest.raises(FileError, match=r"00000002.*cannot be read"):
        opened.omega_max.values  # noqa: B018
    assert opened.omega_max.isel(member=slice(0, 300)).shape == (3, 300)


def test_the_process_that_ends_a_run_reports_flagged_members(tmp_path):
    started(tmp_path / "run", turn_limit=0.051)
    resume.resume(tmp_path / "run", only=range(3))
    assert invoke("resume", f"{tmp_path}/run", "--shards", "3:5").exit_code == 4
    assert invoke("resume", f"{tmp_path}/run").exit_code == 4
    assert invoke("status", f"{tmp_path}/run").exit_code == 4
    assert "none; in all: 369" in invoke("resume", f"{tmp_path}/run").stdout
    assert invoke("consolidate", f"{tmp_path}/run", "-o", f"{tmp_path}/one.nc").exit_code == 4


def test_nothing_saved_over_time_and_notes(tmp_path):
    with pytest.warns(SceneWarning, match="dt reduced"):
        directory = create(SCENE.with_run(save=("flips", "omega_max"), dt=0.06), tmp_path / "run")
    resume.resume(directory)
    assert rm.open(directory.path).omega_max.shape == (3, MEMBERS)


def test_commands(tmp_path):
    run = f"{tmp_path}/run/"
    few = "tennis_racket --members 20000 --save omega"
    words = f"run {few} --shard-size 0.5 -o", run
    task = invoke(*words, "--shards", "0:1")
    assert task.exit_code == 0 and "shards 0:1 are done; 4 shards of other jobs" in task.stdout
    assert "(1:5); `rigidmc merge`" in task.stdout
    assert invoke(*words).exit_code == 6
    assert invoke(*words, "--force").exit_code == 3
    assert "--force" in invoke(*words, "--force").stderr
    assert "not writable" in invoke(*words[:-1], "/proc/run/").stderr
    count = int(invoke(f"show {few}").stdout.split("directory")[1].split()[0])
    # the size of a shard is another there
    assert count == math.ceil(20000 / RunDirectory(run).facts["shard"] * 0.5e6 / 2**26)
    assert invoke("consolidate", run, "-o", tmp_path / "one.nc").exit_code == 3
    assert invoke("status", run).exit_code == 5 and "1 of" in invoke("status", run).stdout
    assert invoke("resume", run, "--max-wall", "1e-9s").exit_code == 5
    assert invoke("resume", run, "--max-wall", "soon").exit_code == 3
    assert invoke("resume", run).exit_code == 0
    assert invoke("status", run).exit_code == 0
    assert invoke("verify", run).exit_code == 0
    assert invoke("consolidate", run, "-o", tmp_path / "one.nc").exit_code == 0
    assert invoke("extend", run, "--members", 30000).exit_code == 0
    assert "30,000 members" in invoke("status", run).stdout
    sorted((tmp_path / "run" / "shards").iterdir())[1].write_bytes(b"nothing")
    assert invoke("verify", run).exit_code == 3
    assert "1 damaged" in invoke("resume", run, "--repair").stdout
    assert invoke("verify", run).exit_code == 0
    assert invoke("resume", tmp_path).exit_code == 3
