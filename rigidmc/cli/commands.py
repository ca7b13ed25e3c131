"""The commands: module, panel and help text of each, in the order of `rigidmc --help`.

`rigidmc --help` and the completion of a command's name read this table and import no other file of
commands: the options of `run` alone need NumPy and pydantic, which take 0.2 s. The module of a
command is imported when the command runs, shows its help page or completes its options.
"""

from collections.abc import Callable
from importlib import import_module
from typing import Any, NamedTuple, cast

from typer.core import TyperCommand
from typer.main import get_command_from_info
from typer.models import CommandInfo

from rigidmc.cli.app import app
from rigidmc.scene import library
from rigidmc.studies import STUDIES, load_study

PANELS = ("Start", "Look", "Study", "Long runs", "Reference")
START, LOOK, STUDY, LONG_RUNS, REFERENCE = PANELS


class Entry(NamedTuple):
    """A command in the table.

    module : file in `rigidmc.cli` with its function NAME_command, or that makes it from a study
    panel : of `rigidmc --help`;  text : its help text
    """

    module: str
    panel: str
    text: str


_STUDIES = {
    **{name: Entry("studies", STUDY, text) for name, text in STUDIES.items()},
    "exact": Entry(
        "body",
        STUDY,
        "Compare the closed form of a scene at one time with its integration, and show the"
        " difference.",
    ),
}
# {command: study of another name}
_NAMES = {"covariance": "propagate"}
_STUDIES |= {name: _STUDIES.pop(study) for name, study in _NAMES.items()}
# this command has its own file
_STUDIES["map"] = _STUDIES.pop("stability_map")._replace(module="maps")
COMMANDS = {
    "run": Entry(
        "run",
        START,
        "Run a scene: integrate its ensemble, write the result and a picture, and report the cost.",
    ),
    "show": Entry(
        "show",
        START,
        "Describe a scene, the effects to compile, and the time, memory and disk of a run,"
        " without running it.",
    ),
    "check": Entry(
        "show", START, "Check a scene file. Exit code 0 if it can be run, else 3 and a message."
    ),
    "scenes": Entry(
        "scenes", START, (library.__doc__ or "").replace("[", r"\[").replace("\n\n", "\n\n\b\n")
    ),
    "new": Entry(
        "new",
        START,
        "Write a first scene file to edit, with a comment on each line. At a terminal and"
        " without options, the command prompts for the values; otherwise every option has a"
        " default, and the default body is a heavy top.",
    ),
    "body": Entry(
        "body",
        START,
        "Describe a body: mass, centre of mass, inertia tensor, principal axes, stable and"
        " unstable rotations, the growth rate of the unstable one, and the notes of `rigidmc"
        " check` on it.",
    ),
    "view": Entry(
        "results",
        LOOK,
        "Write one HTML page in which members turn in space next to their momentum spheres,"
        " with a time slider, omega, Euler angles and drifts. The page works offline.",
    ),
    "plot": Entry("results", LOOK, "Draw a picture of a result."),
    "animate": Entry(
        "results",
        LOOK,
        "Animate one member of a result: rerun it, and draw the turning body next to its"
        " momentum sphere.",
    ),
    "summary": Entry(
        "results",
        LOOK,
        "Summarise a result: the flagged members; for each quantity with one value per"
        " member, the mean with its confidence interval, the median and the middle 90 %. With"
        " --of, estimate measures instead.",
    ),
    "rerun": Entry(
        "results",
        LOOK,
        "Rerun one member of a result, to the same bits, and save more: all observables"
        " unless --save names some.",
    ),
    "reweight": Entry(
        "results",
        LOOK,
        "Estimate measures of a result for a scene with other distributions, by weights of the"
        " members, without a new run.",
    ),
    "export": Entry(
        "results",
        LOOK,
        "Write a result in another format. A table has the columns with one value per"
        " member: start, last state, drifts, status, statistics.",
    ),
    **dict(sorted(_STUDIES.items())),
    "resume": Entry(
        "directories",
        LONG_RUNS,
        "Continue a run: compute the missing shards. The result has the same bits as an"
        " uninterrupted run. Existing shards are trusted by name; `verify` and --repair read"
        " them.\n\nExit code 0 if the run, or the range of --shards, is done, 4 if some of"
        " its members are flagged, 5 if some of its shards are missing (--max-wall).",
    ),
    "status": Entry(
        "directories",
        LONG_RUNS,
        "Show the progress of a run, even while it is running. Reads only the names of"
        " shards.\n\nExit code 0 if the run is done, 4 if it is done and some members are"
        " flagged, 5 if shards are missing.",
    ),
    "verify": Entry(
        "directories",
        LONG_RUNS,
        "Verify a run: compare the checksum of every shard with its name, check run.json and"
        " the scene, and recompute some members, which must match to the bit.\n\nExit code 0"
        " if all shards exist and are sound, 5 if some are missing and the others are sound,"
        " 3 if there are faults.",
    ),
    "consolidate": Entry(
        "directories",
        LONG_RUNS,
        "Write a complete run as one netCDF file. Exit code 4 if some of its members are flagged.",
    ),
    "extend": Entry(
        "directories", LONG_RUNS, "Add members to a run. Existing members keep all their bits."
    ),
    "merge": Entry(
        "directories",
        LONG_RUNS,
        "Gather the shards of a job array in one run directory, which may be new. All parts"
        " must have the same scene, seed, members and shard size.",
    ),
    "doctor": Entry(
        "doctor",
        REFERENCE,
        "Describe this machine: cores, vector width, threads, kernel cache, GPUs and versions.",
    ),
    "warm": Entry(
        "show",
        REFERENCE,
        "Compile the kernels of scenes ahead of their runs: after an installation, or before"
        " jobs that share a cache.\n\nPrints the compile time of each scene. Kernels in the"
        " cache are not recompiled.",
    ),
    "effects": Entry(
        "vocabulary",
        REFERENCE,
        "List the effects: law, parameters, requirements, conserved quantities; with"
        " --measure, the cost on this machine. With NAME, show equation, parameters and"
        " source.",
    ),
    "observables": Entry(
        "vocabulary",
        REFERENCE,
        "List the observables, saved or monitored, with parameters and results; with"
        " --measure, the time that each monitored one adds to a step on this machine. With"
        " NAME, describe one.",
    ),
    "integrators": Entry(
        "vocabulary",
        REFERENCE,
        "List the integrators: order, torques per step, conserved quantities, accepted"
        " torques; with --measure, the cost of a step on this machine. With NAME, describe"
        " one and cite its source.",
    ),
}


def load_function(name: str) -> Callable[..., None]:
    """Import the function of a command, with options as typer reads them."""
    module = import_module(f"rigidmc.cli.{COMMANDS[name].module}")
    study = _NAMES.get(name, name)
    made = (
        module.command_of(load_study(study))
        if study in STUDIES
        else getattr(module, f"{name}_command")
    )
    return cast(Callable[..., None], made)


class LazyCommand(TyperCommand):
    """A command that imports its function, and makes its parameters, at first use."""

    _made: TyperCommand | None = None

    @property
    def made(self) -> Any:
        """The actual command."""
        if self._made is None:
            info = CommandInfo(name=self.name, callback=load_function(str(self.name)))
            self._made = get_command_from_info(  # type: ignore[assignment]
                info, pretty_exceptions_short=True, rich_markup_mode="rich"
            )
        return self._made

    @property
    def params(self) -> Any:
        """Its argument and options."""
        return self.made.params

    @params.setter
    def params(self, value: Any) -> None:
        """Ignore the parameters that typer made from `unmade`."""

    @property
    def callback(self) -> Any:
        """Its function."""
        return self.made.callback

    @callback.setter
    def callback(self, value: Any) -> None:
        """Ignore `unmade`."""


def unmade() -> None:
    """Stand in for the function of a command until it is made."""


for _name, _command in COMMANDS.items():
    app.command(_name, cls=LazyCommand, help=_command.text, rich_help_panel=_command.panel)(unmade)
