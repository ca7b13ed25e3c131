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
RESULTS = {**dict.fromkeys(("summary", "view", "run", "map"), ()), "plot": ("-o", "x.png")}
RESULTS |= {"export": ("-o", "x.csv"), "rerun": ("--member", "0"), "reweight": ("dzhanibekov",)}
RESULTS["animate"] = "--member", "0", "-o", "x.gif"
RUNS = {**dict.fromkeys(("status", "resume", "verify", "merge"), ()), "consolidate": ("-o", "y.nc")}
RUNS["extend"] = "--members", "10"
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


MAP = "map dzhanibekov --of flips"
MISTAKES = {  # {a command: words of its one message}; `...` stands for anything between words
    "run dzanibekov": "did you mean 'dzhanibekov'",
    "run heavy_top --integrator exact": "takes no torque",
    "run heavy_top --integrator rkm4": "did you mean 'rkmk4'",
    "run dzhanibekov --members 0": "at least 1",
    "run dzhanibekov --members ten": "integer",
    "run dzhanibekov --dt -1": "greater than 0",
    "run dzhanibekov --save omga": "did you mean 'omega'",
    "run dzhanibekov --set body.moments=[1,2,9]": "triangle inequality",
    "run dzhanibekov --set moments": "table.key=value",
    "run dzhanibekov --plot x.gif": ".png, .pdf, .svg",
    "show heavy_top --integrator exact": "takes no torque",
    "check dzhanibekov --set run.dtt=1": "did you mean 'dt'",
    "scenes heavytop": "did you mean 'heavy_top'",
    "stress --group H77": "did you mean 'H7'",
    "stress --integrator rk44": "did you mean 'rk4'",
    "stress dzhanibekof": "did you mean 'dzhanibekov'",
    f"plot {__file__} -o x.png --picture sumary": "did you mean 'summary'",
    "map nosuch": "no such map",
    "map tennis_racket": "--x, --y, --of: missing; the map of a scene needs",
    "map dzhanibekov --x body.moments.1=0:1": "--y",
    f"{MAP} --x body.moments.1=0 --y body.moments.3=1:2": "KEY=LOW:HIGH",
    f"{MAP} --x body.moments.1=1:0 --y body.moments.3=1:2": "low < high",
    f"{MAP} --x body.momnts.1=0:1 --y body.moments.3=1:2": "body.moments.1",
    f"{MAP} --x body.moments.3=0:1 --y body.moments.3=1:2": "already",
    "map growth --set body.mass=2": "a shipped map has its own",
    f"{MAP} --resolution 2 --x body.moments.3=1:2 --y body.moments.1=1e-3:1e-2": "impossible body",
    f"{MAP} --set run.points=sobol --x body.moments.1=1:2 --y body.moments.3=1:2": "independent",
    "map intermediate_axis --resolution 0": "at least 1",
    "map intermediate_axis --members 0": "at least 1",
    "map intermediate_axis --plot map.xyz": ".png",
    "map sleeping_top --zoom 0.4:0.9,0.8:1.2": "a part of an existing map",
    "map sleeping_top -o new/ --adaptive --shards 0:1": "each level needs all",
    "map sleeping_top -o new/ --adaptive --shard-size 1": "each level needs all",
    "map sleeping_top -o new/ --border 0.5": "requires --adaptive",
    "map sleeping_top --resolution 46 --members 2 --shards 0:1": "--shards",
    "map growth --z body.mass=1:2": "two axes",
    "view heavy_top --slider body.mass": "is for --live",
    "view heavy_top --with gyroscope": "is for --live",
    "view heavy_top --live --until 1s": "a live page has no end",
    "run dzhanibekov --members 1.5": "--members ... expected",
    "run dzhanibekov --t-end soon": "--t-end ... expected",
    "run dzhanibekov --seed -1": "--seed ... expected",
    "run dzhanibekov --every 0s": "--every ... greater",
    "run dzhanibekov --threads 0": "--threads ... expected",
    "run tennis_racket --turn 0.2 --dt 0.1": "give dt or turn, not both",
    "run heavy_top --integrator rk4 --tolerance 1e-6": "ignores a tolerance",
    "run tennis_racket --until mean(flips)+-1% --members 100": "--most",
    "stress nasa_brick --group H2": "--group = 'H2' ... a scene",
    "stress nasa_brick --bounds b.csv": "--bounds = 'b.csv' ... a scene",
    "run dzhanibekov -o x.txt": "ends in .",
    "run dzhanibekov -o x.h5": "ends in .",
    "run dzhanibekov -o x": "ends in .",
    "run dzhanibekov --plot x.jpg": "ends in .",
    "map kapitza -o x.h5": "ends in .",
    "accuracy dzhanibekov -o x.csv": "ends in .",
    "stress -o x.txt": "ends in .",
    "stress --write-bounds x.txt": "ends in .",
    "rerun no.nc --member 1 -o x.txt": "ends in .",
    "map kapitza -o x.zarr": "ends in .",
    "plot no.nc -o x.gif": "ends in .",
    "animate no.nc --member 1 -o x.avi": "ends in .",
    "exact dzhanibekov --plot x.txt": "ends in .",
    "new x.toml --solid cilinder": "--solid = 'cilinder' ... did you mean 'cylinder'",
    "new x.toml --size radius=0.03,heigth=1": "--size heigth ... no such key ... 'height'",
    "new x.toml --size radius=-1,height=1": "--size radius = -1.0 ... must be positive",
    "new x.toml --size radius=0.03": "--size height ... is missing",
    "new x.toml --size 0.03": "--size = '0.03' ... expected NAME=NUMBER",
    "new x.toml --solid box --size size=1,2": "--size size ... 3",
    "new x.toml --mass -1": "--mass = -1.0 ... must be positive",
    "new x.toml --solid t_handle --mass 1": "--mass ... no such key ... density",
    "new x.toml --moments 1,2": "--moments = '1,2' ... expected 3 numbers",
    "new x.toml --moments 1,2,9": "--moments = [1.0, 2.0, 9.0] ... triangle inequality",
    "new x.toml --moments 1,2,2 --solid ball": "--solid = 'ball' ... --moments",
    "new x.toml --centre 0,0,1": "--centre = '0,0,1' ... --pivot",
    "new x.toml --pivot 0,0,nan": "--pivot = '0,0,nan' ... finite",
    "new x.toml --spin fast": "--spin = 'fast' ... expected 3 numbers",
    "new x.toml --solid ball --spin 0,0,0": "--spin = '0,0,0' ... nothing moves",
    "new x.toml --spread 2": "--spread = 2.0 ... from 0 to below 1",
    "new x.toml --lean far": "--lean = 'far' ... expected a number",
    "new x.toml --lean 20": "--lean = '20' ... 20deg",
    "new x.toml --gravity moon": "--gravity = 'moon' ... expected a number",
    "new x.toml --solid ball --gravity 9.81": "--gravity = '9.81' ... --pivot",
    "new x.toml --members 0": "--members ... at least 1",
    "new x.toml --t-end soon": "--t-end ... expected a finite number of seconds",
}


@pytest.mark.parametrize("text", MISTAKES)
def test_a_mistake_takes_one_message_and_writes_nothing(tmp_path, monkeypatch, text):
    monkeypatch.chdir(tmp_path)
    done = invoke(text)
    assert done.exit_code == INVALID and "Traceback" not in done.output, done.output
    assert all(word in done.output for word in MISTAKES[text].split(" ... ")), done.output
    assert list(tmp_path.iterdir()) == []


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
    (("run", "dzhanibekov", "-o", "nowhere/x.nc", "--members", "2"), IO),
    (("map", "missing.nc"), IO),
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
