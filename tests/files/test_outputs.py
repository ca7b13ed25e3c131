"""Every output appears complete or not at all, and overwrites nothing without --force.

Nothing temporary stays behind.
"""

import contextlib
import errno
import os
import random
import shlex
import signal
import stat
import subprocess
import sys
import threading
import time
from unittest.mock import patch

import numpy as np
import pytest
import xarray as xr
from matplotlib.figure import Figure

import rigidmc as rm
from rigidmc.errors import NoRoom, OutputExists
from rigidmc.files import outputs
from rigidmc.files.netcdf import in_netcdf_thread
from rigidmc.runs import prepare
from rigidmc.runs.directory import resume
from rigidmc.runs.directory.create import create
from rigidmc.studies.accuracy import picture as accuracy_picture
from rigidmc.studies.accuracy import study as accuracy
from rigidmc.studies.stress import hard_cases, trust
from rigidmc.studies.stress import picture as stress_picture
from rigidmc.views import animation
from tests.tools import torture_outputs
from tests.tools.commands import COMMAND, invoke
from tests.tools.faulty import LINUX, limited

pytestmark = LINUX

SCENE = rm.Scene(
    rm.Body((1.0, 2.0, 3.0)), start=rm.Start(omega=(0.1, 1.0, rm.normal(0.0, 0.1)))
).with_run(integrator="rk4", dt=0.05, t_end=1.0, members=100, save=("omega",))
STUDY = xr.Dataset({"error": ("n", np.arange(3.0))})
OLD = b"precious"


def parts(folder):
    return [name for name in os.listdir(folder) if "part" in name or "rigidmc" in name]


def appearing(paths, result):
    """A function that returns a result while other processes write the same files."""

    def made(*_, **__):
        for path in paths:
            path.write_bytes(OLD)
        return result

    return made


@pytest.mark.parametrize(
    ("words", "module", "name"),
    [
        (("accuracy", "nasa_brick"), accuracy, "work_precision"),
        (("stress", "nasa_brick"), trust, "trust"),
    ],
)
def test_studies_and_pictures_overwrite_nothing_that_appears_meanwhile(
    tmp_path, words, module, name
):
    one, two = tmp_path / "s.nc", tmp_path / "s.png"
    with (
        patch.object(module, name, appearing([one, two], STUDY)),
        patch.object(accuracy, "ladder_table", lambda found: ["the table"]),
        patch.object(trust, "table", lambda found: ["the table"]),
        patch.object(trust, "has_failed", lambda found: False),
        patch.object(accuracy_picture, "work_precision", lambda found: Figure()),
        patch.object(stress_picture, "trust", lambda found: Figure()),
    ):  # fmt: skip
        told = invoke(*words, "-o", one)
        assert told.exit_code == 6 and "s.2.nc" in told.stderr and "the table" in told.stdout
        one.unlink(), two.unlink()
        assert invoke(*words, "--plot", two).exit_code == 6
    assert one.read_bytes() == two.read_bytes() == OLD
    with xr.open_dataset(tmp_path / "s.2.nc") as kept:
        assert kept.error.size == 3
    assert (tmp_path / "s.2.png").stat().st_size > 1000
    assert sorted(os.listdir(tmp_path)) == ["s.2.nc", "s.2.png", "s.nc", "s.png"]


def test_bounds_are_written_whole_and_overwrite_nothing(tmp_path):
    study = xr.Dataset(
        {"error": (("case", "integrator"), [[1e-9]]), "group": ("case", ["H1"])},
        {"case": ["needle"], "integrator": ["rk4"]},
    )
    path = tmp_path / "b.csv"
    path.write_bytes(OLD)
    with pytest.raises(OutputExists):
        hard_cases.write_bounds(study, path)
    with (
        patch.object(hard_cases, "_rounded_up", side_effect=KeyboardInterrupt),
        pytest.raises(KeyboardInterrupt),
    ):
        hard_cases.write_bounds(study, path, force=True)
    assert path.read_bytes() == OLD
    hard_cases.write_bounds(study, path, force=True)
    assert "needle,rk4,4e-09,1e-09" in path.read_text()


def test_a_result_whose_name_is_taken_at_the_end_is_kept_under_another(tmp_path):
    path, compute = tmp_path / "r.nc", prepare.compute
    taken = appearing([path], None)
    with patch.object(
        prepare, "compute", lambda *given, **more: (compute(*given, **more), taken())[0]
    ):
        told = invoke("run nasa_brick --t-end 0.1 -o", path)
    assert told.exit_code == 6 and str(tmp_path / "r.2.nc") in told.stderr
    assert path.read_bytes() == OLD
    with rm.open(tmp_path / "r.2.nc") as kept:
        assert kept.sizes["member"] == 1
    outputs.write_bytes(tmp_path / "new", b"1")
    folder = tmp_path / "folder"
    folder.mkdir()
    with pytest.raises(OutputExists, match=r"folder\.2"):
        outputs.write_bytes(folder, b"2", force=True)
    assert (tmp_path / "folder.2").read_bytes() == b"2" and not parts(tmp_path)


def test_an_animation_is_complete_or_absent(tmp_path):
    ds = rm.simulate(SCENE, members=1, every=0.05, save=("attitude", "momentum"))
    path = tmp_path / "a.gif"

    def half(writer):
        with open(writer.outfile, "wb") as file:
            file.write(b"half")
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with (
        patch.object(animation.animation.PillowWriter, "finish", half),
        pytest.raises(OSError, match=r"No space left .*a\.gif"),
    ):
        animation.animate(ds, path)
    assert os.listdir(tmp_path) == []
    path.write_bytes(OLD)
    with (
        patch.object(animation.animation.PillowWriter, "finish", half),
        pytest.raises(OSError, match="No space left"),
    ):
        animation.animate(ds, path, force=True)
    assert path.read_bytes() == OLD and os.listdir(tmp_path) == ["a.gif"]
    with pytest.raises(OutputExists):
        animation.animate(ds, path)
    with pytest.raises(KeyboardInterrupt):  # not the error of a writer without a frame
        stop = lambda *_: (_ for _ in ()).throw(KeyboardInterrupt)  # noqa: E731
        animation.animate(ds, path, force=True, progress=stop)
    animation.animate(ds, path, force=True)
    assert path.read_bytes().startswith(b"GIF8") and os.listdir(tmp_path) == ["a.gif"]


def test_a_failure_of_ffmpeg_is_reported(tmp_path, monkeypatch):
    """Before: exit 0 if it died before the last frame, a traceback if it returned an exit code."""
    (tmp_path / "bin").mkdir()
    monkeypatch.setenv("PATH", f"{tmp_path / 'bin'}:{os.environ['PATH']}")
    assert invoke("run nasa_brick --t-end 0.1 -o", tmp_path / "r.nc").exit_code == 0
    for script in ("cat > /dev/null; exit 1", "exit 0", "exit 1"):
        (tmp_path / "bin" / "ffmpeg").write_text(f"#!/bin/sh\n{script}\n")
        (tmp_path / "bin" / "ffmpeg").chmod(0o755)
        words = "--member", 0, "--seconds", 0.2, "-o", tmp_path / "a.mp4"
        told = invoke("animate", tmp_path / "r.nc", *words)
        assert told.exit_code == 74 and told.stderr.count("rigidmc:") == 1, (script, told.output)
        assert "a.mp4" in told.stderr
        assert isinstance(told.exception, SystemExit)
        assert sorted(os.listdir(tmp_path)) == ["bin", "r.nc"]


def test_names_of_all_lengths(tmp_path):
    """A name may have 255 bytes. Before, 250 were too many for the part beside it, and 256 were
    refused only after the work."""
    words = "run", "nasa_brick", "--t-end", 0.1
    assert invoke(*words, "-o", tmp_path / ("n" * 247 + ".nc")).exit_code == 0
    assert invoke(*words, "-o", f"{tmp_path / ('n' * 250)}/", "--shard-size", 1).exit_code == 0
    plot = "plot", tmp_path / ("n" * 247 + ".nc"), "--picture", "drift_histogram"
    assert invoke(*plot, "-o", tmp_path / ("n" * 251 + ".png")).exit_code == 0
    long = tmp_path / ("n" * 300 + ".nc")
    with patch.object(prepare, "compute") as compute:
        told = invoke(*words, "-o", long)
    assert told.exit_code == 74 and "File name too long" in told.stderr
    assert not compute.called and isinstance(told.exception, SystemExit)
    long = tmp_path / ("n" * 252 + ".nc")
    with pytest.raises(OutputExists, match="appeared"):
        long.write_bytes(OLD)
        outputs.write_bytes(long, b"1")
    assert sum(name.endswith(".2.nc") for name in os.listdir(tmp_path)) == 1


def test_a_bad_folder_gets_the_right_message(tmp_path):
    with (
        limited(1000),
        pytest.raises(
            OSError, match=r"not writable: File too large; nothing was written"
        ) as caught,
    ):
        outputs.refuse_existing(tmp_path / "x.nc", False)
    assert not isinstance(caught.value, PermissionError) and os.listdir(tmp_path) == []
    for number, kind in (
        (errno.ENOSPC, OSError),
        (errno.EROFS, OSError),
        (errno.EACCES, PermissionError),
    ):
        with (
            patch("builtins.open", side_effect=OSError(number, os.strerror(number))),
            patch("os.open", side_effect=OSError(number, os.strerror(number))),
            pytest.raises(OSError, match=os.strerror(number)) as caught,
        ):  # fmt: skip
            outputs.refuse_unwritable(str(tmp_path))
        assert type(caught.value) is kind
    with pytest.raises(NoRoom, match="MB are needed"):
        outputs.refuse_unwritable(str(tmp_path), 10**18)
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(OutputExists, match="not a file that can be replaced"):
        outputs.refuse_existing(tmp_path / "pipe", True)
    told = invoke("map intermediate_axis -o", tmp_path / "m.nc", "--resolution", 10**6)
    assert told.exit_code == 74 and "nothing was written" in told.stderr


def test_files_respect_the_umask_and_short_shards_are_deleted_durably(tmp_path):
    """Before: other threads' files were readable by all; after a power failure the new run.json
    could stand beside the short shard."""
    known = os.umask(0o027)
    try:
        with patch.object(os, "umask", side_effect=AssertionError):
            create(SCENE, tmp_path / "run", 100_000)
    finally:
        os.umask(known)
    assert stat.S_IMODE((tmp_path / "run").stat().st_mode) == 0o750
    resume.resume(tmp_path / "run")
    calls = list[str]()

    def noted(name):
        real = getattr(os, name)

        def called(*given, **named):
            where = os.readlink(f"/proc/self/fd/{given[0]}") if name == "fsync" else given[-1]
            calls.append(f"{name} {os.path.basename(where)}")
            return real(*given, **named)

        return patch.object(os, name, called)

    with noted("unlink"), noted("fsync"), noted("replace"):
        resume.extend(tmp_path / "run", 20_000)
    (shard,) = [call for call in calls if call.startswith("unlink 0000")]
    i = calls.index(shard)
    # the new run.json is durable before anything is deleted
    assert calls[i - 1].startswith("fsync .part-")
    assert calls[i + 1 : i + 3] == ["fsync shards", "replace run.json"]


def test_a_run_without_disk_space_does_not_begin(tmp_path):
    """Before: the folder was made for as many threads as cores, and refused for the number given.
    No worker starts here."""
    asked = list[int]()

    def hopeless(run, count, block, threads, *_):
        asked.append(threads)
        raise NoRoom("too little memory")

    words = "run", "nasa_brick", "-o", f"{tmp_path}/run/"
    with (
        patch("rigidmc.runs.directory.create.check_resources", hopeless),
        patch.object(resume, "resume", side_effect=AssertionError),
    ):
        for more in (["--threads", 7], ["--cluster", "local:9"]):
            told = invoke(*words, *more)
            assert told.exit_code == 74 and "nothing was written" in told.stderr, told.output
            assert os.listdir(tmp_path) == []
    assert asked == [7, 9]


def test_parts_of_killed_runs_are_cleaned_up(tmp_path):
    """Before: a run to a file and a consolidation left a part each time they were killed."""
    some = outputs.PartialFile(tmp_path / "x")
    here = os.path.basename(some.path).rsplit("-", 2)[0]
    some.discard()
    gone = subprocess.Popen([sys.executable, "-c", ""])
    gone.wait()
    (tmp_path / f"{here}-{gone.pid}-3").mkdir()
    (tmp_path / f"{here}-{gone.pid}-3" / "0.nc").touch()
    for name in (
        f"{here}-{gone.pid}-1.nc",
        f"{here}-{os.getpid()}-10000000",
        f"{here}-{os.getppid()}-1",
        ".part-elsewhere-7-1",
        ".part-notes",
    ):
        # of a process that ended, one that reused this number, one that writes, another computer,
        # no one
        (tmp_path / name).touch()
    with outputs.PartialFile(tmp_path / "mine") as mine:
        with open(mine, "w"):
            pass
        assert invoke("run nasa_brick --t-end 0.1 -o", tmp_path / "r.nc").exit_code == 0
        assert os.path.exists(mine)
    assert sorted(os.listdir(tmp_path)) == sorted(
        [f"{here}-{os.getppid()}-1", ".part-elsewhere-7-1", ".part-notes", "mine", "r.nc"]
    )


TWICE = """
import os, signal, sys, time
import rigidmc.files.outputs
from rigidmc.cli import main
real = rigidmc.files.outputs._free
def slow(*given):
    print("cleaning", flush=True)
    time.sleep(0.5)
    return real(*given)
rigidmc.files.outputs._free = slow
main()
"""


def test_a_signal_leaves_no_lock_behind():
    """An interrupted call of the C library goes on, and the next call waits for its end."""
    done = []
    # a shell starts background jobs with SIGINT ignored, and then there is no KeyboardInterrupt
    before = signal.signal(signal.SIGINT, signal.default_int_handler)

    def slowly():
        time.sleep(0.3)
        done.append("first")

    try:
        with pytest.raises(KeyboardInterrupt):
            threading.Timer(0.1, os.kill, (os.getpid(), signal.SIGINT)).start()
            in_netcdf_thread(slowly)
    finally:
        signal.signal(signal.SIGINT, before)
    assert done == []
    in_netcdf_thread(done.append, "second")
    assert done == ["first", "second"]


def has_grown(folder, size):
    for path in folder.iterdir():
        with contextlib.suppress(FileNotFoundError):
            if path.stat().st_size > size:
                return True
    return False


@pytest.mark.parametrize(
    ("number", "code"),
    [pytest.param(signal.SIGINT, 130, marks=pytest.mark.slow), (signal.SIGTERM, 143)],
)
def test_a_second_signal_leaves_no_more_files_than_the_first(tmp_path, number, code):
    words = ["run", "dzhanibekov", "--members", "2000000", "-o", str(tmp_path / "x.nc")]
    heard = {"preexec_fn": lambda: signal.signal(signal.SIGINT, signal.SIG_DFL)}
    heard |= {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    child = subprocess.Popen([sys.executable, "-c", TWICE, *words], **heard)
    end = time.monotonic() + 60
    while not has_grown(tmp_path, 10**5) and time.monotonic() < end:
        time.sleep(0.01)
    assert child.poll() is None, child.communicate()
    assert has_grown(tmp_path, 10**5), list(tmp_path.iterdir())
    child.send_signal(number)
    assert child.stdout.readline() == "cleaning\n"
    child.send_signal(number)
    child.send_signal(number)
    _, told = child.communicate(timeout=60)
    assert child.returncode == code and told.count("rigidmc:") == 1 and "Traceback" not in told
    assert os.listdir(tmp_path) == []


def test_a_broken_stream_changes_no_output(tmp_path):
    """As `python tests/tools/torture.py --outputs all`."""
    ends = "reader gone, unbuffered", "all closed", "full"
    told = torture_outputs.streams(str(tmp_path), ("verify bad",), ends)
    assert set(told.values()) == {3}, told


def test_an_output_that_fails(tmp_path):
    """As `python tests/tools/torture.py --outputs all`."""
    told = torture_outputs.faults(1, str(tmp_path), random.Random(6), ("consolidate",))
    assert told["faults"] >= 25 and told["wrong files"] == told["left behind"] == 0
    ends = "exit 74, one message", "exit 6, one message, NAME.2", "no harm done, exit 0"
    assert told["faults"] == told["whole in the end"] == sum(told[end] for end in ends)


@pytest.mark.slow
def test_every_output_survives(tmp_path):
    """As `python tests/tools/torture.py --outputs all`."""
    told = torture_outputs.outputs(3, str(tmp_path), random.Random(6))
    bad = "faults: wrong files", "kills: torn files", "kills: left behind in the end"
    assert [told[name] for name in bad] == [0, 0, 0]


def test_a_command_with_all_streams_closed(tmp_path):
    """Before: closed stderr ended every run with AttributeError, because the next file opened gets
    the number of a stream."""
    run = shlex.join([*COMMAND, "run", "nasa_brick", "--t-end", "0.1", "-o", f"{tmp_path}/r.nc"])
    assert subprocess.run(["sh", "-c", f"{run} <&- >&- 2>&-"]).returncode == 0
    with rm.open(tmp_path / "r.nc") as ds:
        assert ds.sizes["member"] == 1
    code = f"{shlex.join([*COMMAND, 'scenes'])} > /dev/full"
    done = subprocess.run(["sh", "-c", code], capture_output=True, text=True)
    assert done.returncode == 74
    assert done.stderr.count("rigidmc:") == 1
    assert "No space left" in done.stderr
