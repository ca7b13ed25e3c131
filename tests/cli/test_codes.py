"""Exit codes: one table, and every command held to it."""

from pathlib import Path

import pytest
from typer.main import get_command
from typer.testing import CliRunner

import rigidmc as rm
from rigidmc.cli import app, codes

EVENT, MEAN = ("--of", "p(flips >= 1)"), ("--of", "mean(omega_mean[1])")
# what each command needs beside its first argument
SCENES = {
    "run": (),
    "check": (),
    "show": (),
    "view": (),
    "body": (),
    "exact": (),
    "warm": (),
    "scenes": (),
    "accuracy": (),
    "ftle": (),
    "section": ("--at", "omega[1] = 0"),
    "basins": EVENT,
    "rare": EVENT,
    "frequencies": ("--of", "omega[1]"),
    "sensitivity": MEAN,
    "multilevel": ("--until", "mean(omega_final[1]) +- 1"),
    "map": ("--x", "run.t_end=1:2", "--y", "run.dt=0.1:0.2", *EVENT),
}
RESULTS = {
    "summary": (),
    "plot": ("-o", "x.png"),
    "export": ("-o", "x.csv"),
    "rerun": ("--member", "0"),
    "animate": ("--member", "0", "-o", "x.gif"),
    "view": (),
    "run": (),
    "map": (),
}
RUNS = {
    "status": (),
    "resume": (),
    "verify": (),
    "consolidate": ("-o", "y.nc"),
    "extend": ("--members", "10"),
    "merge": (),
}
# commands whose words are no files
WORDS = {"new", "integrators", "effects", "observables", "doctor", "stress"}


def code(*words):
    done = CliRunner().invoke(app, [str(word) for word in words])
    assert done.exception is None or isinstance(done.exception, SystemExit), done.exception
    return done.exit_code


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bad.nc").write_bytes(b"junk" * 100)
    (tmp_path / "empty").mkdir()
    (tmp_path / "bad.toml").write_text("[body]\nmoments = [1, 2, 9]\n[start]\nomega = [1, 1, 1]\n")
    return tmp_path


def test_every_command_is_in_a_table_here():
    commands = set(get_command(app).commands)
    assert commands - WORDS <= {*SCENES, *RESULTS, *RUNS}


@pytest.mark.parametrize("command", SCENES)
def test_commands_on_scenes(here, command):
    more = SCENES[command]
    assert code(command, "missing.toml", *more) == codes.IO
    assert code(command, "bad.toml", *more) == (codes.OK if command == "scenes" else codes.INVALID)
    assert code(command, "dzhanibekov", *more, "--no-such-option") == codes.USAGE


@pytest.mark.parametrize("command", RESULTS)
def test_commands_on_results(here, command):
    assert code(command, "missing.nc", *RESULTS[command]) == codes.IO
    assert code(command, "bad.nc", *RESULTS[command]) == codes.INVALID


@pytest.mark.parametrize("command", RUNS)
def test_commands_on_runs(here, command):
    new = ["new"] if command == "merge" else []  # its inputs are merged into a new run
    assert code(command, *new, "missing", *RUNS[command]) == codes.IO
    assert code(command, *new, "empty", *RUNS[command]) == codes.INVALID


@pytest.mark.parametrize(("words", "expected"), [
    (("run",), codes.USAGE),
    (("runn",), codes.USAGE),
    (("rerun", "r.nc"), codes.USAGE),
    (("new", "a.toml", "--mass"), codes.USAGE),
    # a wrong value is invalid, whoever reads it
    (("new", "a.toml", "--mass", "abc"), codes.INVALID),
    (("run", "dzhanibekov", "--members", "abc"), codes.INVALID),
    (("run", "dzhanibekov", "--threads", "x"), codes.INVALID),
    (("run", "dzhanibekov", "--energy-limit", "x"), codes.INVALID),
    (("run", "dzhanibekov", "--integrator", "rk9"), codes.INVALID),
    (("run", "dzhanibekov", "--dtype", "float16"), codes.INVALID),
    (("run", "dzhanibekov", "--plot", "x.foo"), codes.INVALID),
    (("show", "dzhanibekov", "--set", "x"), codes.INVALID),
    (("stress", "--integrator", "foo"), codes.INVALID),
    (("map", "nosuch"), codes.INVALID),
    (("run", "dzhanibekov", "-o", "nowhere/x.nc", "--members", "2"), codes.IO),
    (("map", "missing.nc"), codes.IO),
    (("scenes", "nosuch"), codes.INVALID),  # a wrong name
    (("run", "dzhanibekow"), codes.INVALID),
    (("scenes", "nosuch.toml"), codes.IO),  # a file that is not there
    (("run", "room/dzhanibekov"), codes.IO),
    (("scenes",), codes.OK),
    (("--version",), codes.OK),
])  # fmt: skip
def test_words_values_and_files(here, words, expected):
    assert code(*words) == expected


def test_a_result_that_exists_and_members_that_it_lacks(here):
    scene = rm.Scene.load("dzhanibekov").with_run(members=4, t_end=1.0)
    rm.simulate(scene, output="r.nc", threads=1).close()
    assert code("run", "dzhanibekov", "--members", 2, "-o", "r.nc") == codes.REFUSED
    assert code("rerun", "r.nc", "--member", 9) == codes.INVALID
    assert code("summary", "r.nc", "--of", "p(foo >= 1)") == codes.INVALID
    assert code("summary", "r.nc") == codes.OK


def test_the_table_is_the_one_of_the_page_and_of_the_help():
    page = Path(__file__).parents[2].joinpath("docs/reference/commands.md").read_text("utf-8")
    assert codes.table() in page
    shown = " ".join(CliRunner().invoke(app, ["--help"]).output.split())
    assert all(f"{number} {short}" in shown for number, (short, _) in codes.CODES.items())
