"""The command line: exit codes, one-line messages, and existing files that stay intact."""

import os
import resource
import signal
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import rigidmc as rm
from rigidmc.cli.directories import refuse_force
from rigidmc.studies.stress import hard_cases
from tests.tools.commands import COMMAND, invoke, words_of
from tests.tools.faulty import LINUX


def failed(result, code, *words):
    assert result.exit_code == code, result.output
    assert "Traceback" not in result.output
    for word in words:
        assert word in result.output, result.output


def test_run_writes_a_result_and_a_picture(tmp_path):
    out, picture = tmp_path / "d.nc", tmp_path / "d.png"
    result = invoke("run dzhanibekov --members 500 --t-end 2 -o", out, "--plot", picture)
    assert result.exit_code == 0, result.output
    words = "500 members", "member-steps/s", "drift of energy", "flagged members: none"
    assert all(word in result.output for word in (*words, "d.nc", "d.png")), result.output
    assert picture.stat().st_size > 20_000
    with rm.open(out) as ds:
        assert ds.sizes["member"] == 500
        assert float(ds.energy_drift_max.max()) < 5e-8  # measured 1.7e-8
    assert sorted(os.listdir(tmp_path)) == ["d.nc", "d.png"]


def test_options_override_the_scene(tmp_path):
    out = tmp_path / "h.nc"
    words = "--members 3 --dt 0.001 --t-end 0.5 --every 0.1 --seed 4 --integrator rkmk4"
    more = "--save momentum,l2 --set effects.gravity.g=1.62 -o"
    result = invoke(f"run heavy_top {words} {more}", out)
    assert result.exit_code == 0, result.output
    with rm.open(out) as ds:
        assert set(ds.data_vars) >= {"momentum", "l2"}
        assert "omega" not in ds
        assert ds.attrs["integrator"] == "rkmk4"
        assert ds.attrs["seed"] == 4
        assert "g = 1.62" in ds.attrs["scene"]
        assert ds.sizes["time"] == 6


def test_a_result_file_is_a_scene(tmp_path):
    one, two = tmp_path / "1.nc", tmp_path / "2.nc"
    assert invoke("run tennis_racket --members 40 --t-end 0.5 -o", one).exit_code == 0
    assert invoke("run", one, "-o", two).exit_code == 0
    with rm.open(one) as a, rm.open(two) as b:
        assert a.identical(b)


def test_existing_files_are_refused_and_intact(tmp_path):
    out = tmp_path / "there.nc"
    out.write_bytes(b"precious")
    failed(invoke("run nasa_brick -o", out), 6, "there.nc exists", "nothing was written")
    failed(invoke("run nasa_brick --plot", out), 6, "exists")
    assert out.read_bytes() == b"precious"
    assert os.listdir(tmp_path) == ["there.nc"]
    assert invoke("run nasa_brick --t-end 0.1 -o", out, "--force").exit_code == 0
    with rm.open(out) as ds:
        assert ds.attrs["title"] == "nasa_brick"


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_read_only_folders(tmp_path):
    tmp_path.chmod(0o500)
    failed(invoke("run nasa_brick -o", tmp_path / "x.nc"), 74, "not writable")


def test_plot_of_a_file_that_is_no_result(tmp_path):
    failed(invoke("plot", tmp_path / "none.nc", "-o", tmp_path / "x.png"), 74, "none.nc")
    (tmp_path / "text.nc").write_text("not netCDF")
    failed(invoke("plot", tmp_path / "text.nc", "-o", tmp_path / "x.png"), 3, "text.nc")
    assert not (tmp_path / "x.png").exists()


def test_flagged_members_exit_4(tmp_path):
    scene = tmp_path / "wild.toml"
    scene.write_text(
        "[body]\nmoments=[1.0, 2.0, 2.5]\n[start]\nomega=[1e160, 1.0, 0.0]\n[run]\nmembers=3\n"
        "dt=0.1\nt_end=1.0"
    )
    failed(invoke("run", scene), 4, "flagged members: 3 step_too_large", "`status_step`")
    failed(invoke("run", scene, "--set", "run.checks=false"), 4, "flagged members: 3 non_finite")
    failed(invoke("run", scene, "--dt", "1e-159"), 3, "dt", "1e+159 steps")
    text = scene.read_text().replace("1e160", "1.0")
    scene.write_text(text.replace("dt=0.1", "dt=0.1\nenergy_limit=1e-12"))
    failed(invoke("run", scene), 4, "flagged members: 3 energy_drift")
    negative = invoke("run", scene, "--set", "run.energy_limit=-1.0")
    failed(negative, 3, "energy_limit", "greater than 0")


def test_a_full_disk(tmp_path):
    """A limit on file size simulates a full disk: exit 74, one message, old files intact."""
    (tmp_path / "there.nc").write_bytes(b"precious")

    def limit():
        resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, 200_000))

    words = words_of("run tennis_racket --members 2000 --force -o", tmp_path / "there.nc")
    # the kernel cache must be warm, or its files would hit the limit first
    assert invoke("run tennis_racket --members 1 -o", tmp_path / "warm.nc").exit_code == 0
    made = subprocess.run([*COMMAND, *words], capture_output=True, text=True, preexec_fn=limit)
    assert made.returncode == 74, made.stderr
    assert "Traceback" not in made.stderr
    assert "nothing that existed was changed" in made.stderr
    assert (tmp_path / "there.nc").read_bytes() == b"precious"
    assert sorted(os.listdir(tmp_path)) == ["there.nc", "warm.nc"]


def cpu_of(pid):
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return sum(map(int, fields[11:13])) / os.sysconf("SC_CLK_TCK")


def cpu_of_children():
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


@LINUX
@pytest.mark.parametrize(
    ("number", "code"),
    [
        (signal.SIGINT, 130),
        pytest.param(signal.SIGTERM, 143, marks=pytest.mark.slow),  # 3 s, as SIGHUP
        (getattr(signal, "SIGHUP", 1), 129),
    ],
)
def test_signals(tmp_path, number, code):
    """A stopped run exits with the code of the signal, does little more, and leaves no file."""
    # with a warm cache no process beside it compiles, whose CPU time would be counted, too
    assert invoke("run dzhanibekov --members 1 -o", tmp_path.with_suffix(".nc")).exit_code == 0
    spent = cpu_of_children()
    words = words_of("run dzhanibekov --members 2000000 -o", tmp_path / "x.nc")
    process = subprocess.Popen(
        [*COMMAND, *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        # tests that run in the background ignore it
        preexec_fn=lambda: signal.signal(number, signal.SIG_DFL),
    )  # fmt: skip
    deadline = time.monotonic() + 60
    while (
        not any(name.startswith(".part-") for name in os.listdir(tmp_path))
        and time.monotonic() < deadline
    ):
        time.sleep(0.05)
    time.sleep(0.5)
    before = cpu_of(process.pid)
    process.send_signal(number)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == code, errors
    # measured 0.56 to 0.73 s, where the rest of the run takes 8 s
    assert cpu_of_children() - spent - before < 2.0
    assert "Traceback" not in errors
    assert os.listdir(tmp_path) == []


def test_show_says_what_is_compiled():
    free, heavy = invoke("show dzhanibekov").output, invoke("show heavy_top").output
    assert "effects: none (free body); without attitude" in free
    assert "effects: gravity(g = 9.81); with attitude" in heavy
    for text in (free, heavy):
        for word in ("members", "memory", "file", "ns per member-step", "steps", "conserved"):
            assert word in text
    assert "price" not in free
    assert "ns without effects (188 operations), gravity 120 operations:" in heavy


def test_effects_are_listed():
    from rigidmc.physics.effects import EFFECTS
    from rigidmc.physics.effects.protocol import user_parameters

    listing = invoke("effects").output
    for name, kind in EFFECTS.items():
        assert f"\n{name} " in f"\n{listing}"
        assert all(field in listing for field in user_parameters(kind))
    assert "at [m, 3 numbers]" in listing


def test_effects_are_priced(monkeypatch):
    from rigidmc.physics.effects import EFFECTS
    from rigidmc.runs import price

    # what it measures is compiled for minutes
    monkeypatch.setattr(price, "cost_per_step", lambda *arguments: 2.5)
    listing = invoke("effects --measure").output
    assert "a step of rk4 on one thread: 2.50 ns for the momentum alone" in listing
    # gravity
    assert listing.count("27 operations per torque; 2.50 ns per step alone; adds 0.00 ns") == 1
    assert "(1 division, 1 root) per torque" in listing  # spring
    assert listing.count(" ns per step alone; adds ") == len(EFFECTS)


def test_check_scenes_integrators_doctor():
    assert invoke("check heavy_top").exit_code == 0
    listing = invoke("scenes").output
    assert all(name in listing for name in ("dzhanibekov", "toutatis", "cylinder_on_edge"))
    assert invoke("scenes toutatis").output.startswith("title")
    assert all(name in invoke("integrators").output for name in ("rk4", "rkmk4", "strang", "exact"))
    facts = invoke("doctor").output
    assert all(word in facts for word in ("vectors", "threads", "kernel cache", "numba"))


def test_nasa_brick_from_the_command_line(tmp_path):
    """NASA/TM-2015-218675 check-case 2: rates at 30 s to 1e-9 deg/s, with rk4 at 1 ms and with one
    exact step."""
    expected = (12.61839077591422, -17.39747476161139, 31.11958888694434)
    for words in ([], ["--integrator", "exact", "--dt", "30", "--every", "30"]):
        out = tmp_path / f"n{len(words)}.nc"
        assert invoke("run nasa_brick", *words, "-o", out).exit_code == 0
        with rm.open(out) as ds:
            error = np.abs(np.degrees(ds.omega.values[-1, :, 0]) - expected).max()
        assert error < 5e-12  # measured 5.3e-13 and 1.2e-14; target 1e-9
    rough = tmp_path / "rough.nc"
    invoke("run nasa_brick --dt 0.1 -o", rough)
    with rm.open(rough) as ds:
        assert np.abs(np.degrees(ds.omega.values[-1, :, 0]) - expected).max() > 1e-6


@pytest.mark.slow
def test_accuracy(tmp_path):
    words = "accuracy nasa_brick --integrators exact,rk8 --members 16 --tolerances 1e-4,1e-8"
    result = invoke(words, "-o", tmp_path / "a.nc", "--plot", tmp_path / "a.png")
    assert result.exit_code == 0
    assert "truth: closed form of the free top" in result.output
    assert "for 1e-08: exact " in result.output
    with xr.open_dataset(tmp_path / "a.nc") as study:
        assert set(study.integrator.values) == {"exact", "rk8"}
    with pytest.raises(rm.FileError, match="a map or a study, not a result with members"):
        rm.open(tmp_path / "a.nc")
    assert (tmp_path / "a.png").stat().st_size > 20_000
    failed(invoke(words, "-o", tmp_path / "a.nc"), 6, "a.nc")
    wrong = invoke("accuracy nasa_brick --tolerances 1e-4;1e-8")
    failed(wrong, 3, "expected numbers separated by commas")
    wrong = invoke("accuracy nasa_brick --integrators chin4,exakt")
    failed(wrong, 3, "exakt", "did you mean 'exact'")
    drift = invoke("accuracy nasa_brick --long --steps 5000 --integrators rk8,exact")
    assert drift.exit_code == 0
    assert "rk8        energy " in drift.output


@pytest.mark.slow
def test_run_with_a_tolerance(tmp_path):
    result = invoke("run nasa_brick --tolerance 1e-9 -o", tmp_path / "a.nc")
    assert result.exit_code == 0
    assert "for a tolerance of 1e-09: " in result.output
    assert "keep the tolerance" in result.output
    assert "about " in result.output
    far = "out of reach of double precision here", "the best is"
    failed(invoke("run nasa_brick --tolerance 1e-16"), 3, *far)
    failed(invoke("run nasa_brick --integrator auto"), 3, "tolerance", "is missing")


def test_steps_of_their_own(tmp_path):
    result = invoke("run tennis_racket --turn 0.2 --members 40 -o", tmp_path / "a.nc")
    assert result.exit_code == 0
    assert "different for each member" in result.output
    assert "different for each member, " in invoke("show tennis_racket --turn 0.2").output


@pytest.mark.slow  # 8 s, in a process; tests/studies/test_stress.py has the same study in Python
def test_stress_of_a_group(tmp_path, monkeypatch):
    """Exit 0 and three files; exit 4 and the right row if a bound is a tenth of the error.

    The cases run once: each run starts a process, which compiles for 3 s."""
    outcomes, carry_out = [], hard_cases.carry_out

    def once(*given):
        if not outcomes:
            outcomes.append(carry_out(*given))
        return outcomes[0]

    monkeypatch.setattr(hard_cases, "carry_out", once)
    files = [tmp_path / name for name in ("s.nc", "s.png", "b.csv")]
    words = ("stress", "--group", "H5", "--integrator", "exact")
    made = invoke(*words, "-o", files[0], "--plot", files[1], "--write-bounds", files[2])
    assert made.exit_code == 0, made.output
    assert "5 cases, 5 runs: " in made.output and " above," not in made.output
    assert all(file.stat().st_size > 100 for file in files)
    failed(invoke(*words, "-o", files[0]), 6, "exists")
    with xr.open_dataset(files[0]) as found:
        error = float(found.error.sel(case="needle", integrator="exact"))
    files[2].write_text(f"group,case,integrator,bound,measured\nH5,needle,exact,{0.1 * error},\n")
    failed(invoke(*words, "--bounds", files[2]), 4, "10.00  H5 needle, exact", "1 above")
    files[2].write_text("group,case,integrator,bound,measured\nH5,needle,exact,-1.0,\n")
    failed(invoke(*words, "--bounds", files[2]), 3, "not negative")


def test_stress_of_a_scene(tmp_path):
    words = "-o", tmp_path / "t.nc", "--plot", tmp_path / "t.png"
    made = invoke("stress nasa_brick --quick", *words, "--write-bounds", tmp_path / "b.csv")
    assert made.exit_code == 0, made.output
    assert "b.csv was not written: this study has no tables of bounds" in made.output
    assert "verdict: trust 12 digits to t = 30 s" in made.output
    assert (tmp_path / "t.png").exists()
    long = "--set run.dt=20.0 --set run.every=3000.0 --set run.t_end=3000.0"
    failed(invoke(f"stress nasa_brick --quick {long}"), 4, "the step is too long")


def test_force_is_refused_for_run_directories_that_exist(tmp_path):
    refuse_force(str(tmp_path / "new"), True)
    refuse_force(str(tmp_path), False)
    with pytest.raises(rm.OptionError, match="replaces files, never folders"):
        refuse_force(str(tmp_path), True)
