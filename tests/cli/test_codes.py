"""Exit codes: one table, and every command held to it."""

from pathlib import Path

import pytest
from typer.main import get_command

import rigidmc as rm
from rigidmc.cli import app
from rigidmc.cli.app import CODES, INVALID, IO, OK, REFUSED, USAGE, code_table
from rigidmc.studies import STUDIES, load_study
from tests.studies.examples import words_of
from tests.tools.commands import invoke

# what each command needs beside its first argument
SCENES = {
    **dict.fromkeys(("run", "check", "show", "view", "body", "exact", "warm", "scenes"), ()),
    **{load_study(name).command: words_of(name) for name in STUDIES},
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
WORDS = {"new", "integrators", "effects", "observables", "doctor"}


def code(*words):
    done = invoke(*words)
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
    assert code(command, "missing.toml", *more) == IO
    assert code(command, "bad.toml", *more) == (OK if command == "scenes" else INVALID)
    assert code(command, "dzhanibekov", *more, "--no-such-option") == USAGE


@pytest.mark.parametrize("command", RESULTS)
def test_commands_on_results(here, command):
    assert code(command, "missing.nc", *RESULTS[command]) == IO
    assert code(command, "bad.nc", *RESULTS[command]) == INVALID


@pytest.mark.parametrize("command", RUNS)
def test_commands_on_runs(here, command):
    new = ["new"] if command == "merge" else []  # its inputs are merged into a new run
    assert code(command, *new, "missing", *RUNS[command]) == IO
    assert code(command, *new, "empty", *RUNS[command]) == INVALID


# more values that are invalid, with what is said of them: test_commands.py
@pytest.mark.parametrize(("words", "expected"), [
    (("run",), USAGE),
    (("runn",), USAGE),
    (("rerun", "r.nc"), USAGE),
    (("new", "a.toml", "--mass"), USAGE),
    # a wrong value is invalid, whoever reads it
    (("new", "a.toml", "--mass", "abc"), INVALID),
    (("run", "dzhanibekov", "--threads", "x"), INVALID),
    (("run", "dzhanibekov", "--energy-limit", "x"), INVALID),
    (("run", "dzhanibekov", "--dtype", "float16"), INVALID),
    (("map", "nosuch"), INVALID),
    (("run", "dzhanibekov", "-o", "nowhere/x.nc", "--members", "2"), IO),
    (("map", "missing.nc"), IO),
    (("scenes", "nosuch"), INVALID),  # a wrong name
    (("scenes", "nosuch.toml"), IO),  # a file that is not there
    (("run", "room/dzhanibekov"), IO),
    (("scenes",), OK),
    (("--version",), OK),
])  # fmt: skip
def test_words_values_and_files(here, words, expected):
    assert code(*words) == expected


def test_a_result_that_exists_and_members_that_it_lacks(here):
    scene = rm.Scene.load("dzhanibekov").with_run(members=4, t_end=1.0)
    rm.simulate(scene, output="r.nc", threads=1).close()
    assert code("run", "dzhanibekov", "--members", 2, "-o", "r.nc") == REFUSED
    assert code("rerun", "r.nc", "--member", 9) == INVALID
    assert code("summary", "r.nc", "--of", "p(foo >= 1)") == INVALID
    assert code("summary", "r.nc") == OK


def test_the_table_is_the_one_of_the_page_and_of_the_help():
    page = Path(__file__).parents[2].joinpath("docs/reference/commands.md").read_text("utf-8")
    assert code_table() in page
    shown = " ".join(invoke("--help").output.split())
    assert all(f"{number} {short}" in shown for number, (short, _) in CODES.items())
