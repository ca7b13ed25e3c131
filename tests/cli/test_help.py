"""What `rigidmc --help` shows, the version, and what the shell completes."""

import subprocess
import sys

import pytest
import typer

import rigidmc as rm
from rigidmc.cli import app
from rigidmc.cli.commands import PANELS
from rigidmc.version import VERSION
from tests.tools.commands import invoke


def test_commands_are_in_panels_and_run_is_the_first():
    group = typer.main.get_command(app)
    names = group.list_commands(typer.Context(group))
    panels = [group.commands[name].rich_help_panel for name in names]
    assert names[0] == "run" and sorted(panels, key=PANELS.index) == panels
    assert set(panels) == set(PANELS)
    shown = invoke("--help").stdout
    places = [shown.index(f"─ {panel} ─") for panel in PANELS]
    assert places == sorted(places)


def test_help_has_no_broken_lines():
    """Lines of a docstring are joined: lines of --help once ended where those of the code do."""
    for command in typer.main.get_command(app).commands.values():
        for paragraph in command.help.split("\n\n"):
            assert "\n" not in paragraph or paragraph.startswith("\b"), command.name


def test_every_says_what_it_means_for_a_command():
    """Of a run the first and the last state are saved by default; not so of others."""
    commands = typer.main.get_command(app).commands.items()
    every = ((name, p.help) for name, one in commands for p in one.params if p.name == "every")
    texts = dict(every)
    assert "the first and the last state" in texts["run"] and "first" not in texts["rerun"]
    assert "as in the run" in texts["rerun"] and "one step" in texts["section"]
    ds = rm.simulate(rm.Scene.load("dzhanibekov"), members=2, t_end=1.0, threads=1)
    assert ds.rigid.rerun(1).sizes["time"] == ds.sizes["time"] == 6


HEAVY = {"numpy", "pandas", "xarray", "netCDF4", "scipy", "numba", "matplotlib"}
LISTS = """
import sys
from typer.testing import CliRunner
from rigidmc.cli import app

def printed(*words, **environment):
    done = CliRunner().invoke(app, words, env=environment, prog_name="rigidmc")
    assert done.exit_code == 0, done
    return done.output

assert "Simulate" in printed("--help") and "rigidmc" in printed("--version")
print(*sys.modules)
completed = {"_RIGIDMC_COMPLETE": "complete_bash", "COMP_WORDS": "rigidmc sce", "COMP_CWORD": "1"}
assert printed(**completed).strip() == "scenes"
assert "heavy_top  " in printed("scenes")
print(*sys.modules)
printed("show", "--help")
print(*sys.modules)
"""


def test_lists_of_commands_and_scenes_import_no_heavy_library():
    """What is imported, not how long it takes: `rigidmc --help` once took 0.35 s, 0.2 s of it for
    the options of commands that it lists."""
    done = subprocess.run([sys.executable, "-c", LISTS], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    helped, listed, shown = (set(line.split()) for line in done.stdout.splitlines())
    files = {name for name in helped if name.startswith("rigidmc.cli.")}
    assert files == {f"rigidmc.cli.{name}" for name in ("commands", "app", "reporting")}
    assert not (HEAVY | {"pydantic"}) & helped
    assert not HEAVY & listed  # typer itself imports pydantic for the values of a command that runs
    assert HEAVY & shown == {"numpy"}  # the options of `show`


def test_a_command_ends_without_a_search_for_cycles():
    code = (
        "import atexit, gc, sys; from rigidmc.cli import main; sys.argv[1:] = ['--version'];"
        " atexit.register(lambda: print(gc.get_freeze_count() > 10_000)); main()"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout == f"rigidmc {VERSION}\nTrue\n", done  # 17,343 objects, 0 without


def test_short_options():
    for words in (["-h"], ["run", "-h"], ["map", "-h"]):
        long = [word.replace("-h", "--help") for word in words]
        done = invoke(*words)
        assert done.exit_code == 0 and done.stdout == invoke(*long).stdout
    assert invoke("--version").stdout == f"rigidmc {VERSION}\n"


@pytest.mark.parametrize(("words", "completed"), [
    ("rigidmc run hea", "heavy_top"),
    ("rigidmc run heavy_top --integrator srkn", "srkn6\nsrkn11"),
    ("rigidmc show heavy_top --save omega,nut", "omega,nutation"),
])  # fmt: skip
def test_the_shell_completes_scenes_integrators_and_observables(words, completed):
    count = len(words.split()) - 1
    known = {"_RIGIDMC_COMPLETE": "complete_bash", "COMP_WORDS": words, "COMP_CWORD": str(count)}
    assert invoke("", env=known, prog_name="rigidmc").stdout.strip() == completed
