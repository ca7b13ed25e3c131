"""The app: exit codes, panels, and how a command opens the scene or the result that it is given."""

import os
import re
import sys
from collections.abc import Mapping, Sequence
from inspect import cleandoc
from types import ModuleType
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

import typer
from typer.core import TyperGroup

from rigidmc.errors import FileError, OptionError, RigidmcError, in_file
from rigidmc.files.processes import PACKAGE, environment
from rigidmc.import_hook import Load, on_import
from rigidmc.version import VERSION

if TYPE_CHECKING:
    import xarray as xr

    from rigidmc.scene.scene import Scene

# How commands end. The help and docs/reference/commands.md show this table, and
# tests/cli/test_codes.py holds every command to it.
OK, USAGE, INVALID, FLAGGED, INCOMPLETE, REFUSED = 0, 2, 3, 4, 5, 6
IO, INTERRUPTED, TERMINATED = 74, 130, 143

# {code: (in a few words, when)}
CODES = {
    OK: ("done", "the command did its work, and no member is flagged"),
    USAGE: ("usage", "no such command or option, or an argument is missing"),
    INVALID: (
        "invalid",
        "what was given cannot be used: a scene, a value of an option, a member or a measure that"
        " a result does not have, a file that is damaged or of another kind, a run that `verify`"
        " finds wrong",
    ),
    FLAGGED: ("flagged", "done, and some members are flagged; of `stress`, `doctor`: some fail"),
    INCOMPLETE: ("incomplete", "members, shards or accuracy are still missing"),
    REFUSED: ("refused", "something exists in the place of an output; nothing was overwritten"),
    IO: (
        "input or output",
        "a scene, result or run directory is not there, or cannot be read or written; memory, disk,"
        " a graphics processor or an optional package is missing",
    ),
    INTERRUPTED: ("interrupted", "by Ctrl-C"),
    TERMINATED: ("terminated", "by SIGTERM"),
}

# the panels of `rigidmc --help`; a command names its own: `@app.command(rich_help_panel=LOOK)`
PANELS = ("Start", "Look", "Study", "Long runs", "Reference")
START, LOOK, STUDY, LONG_RUNS, REFERENCE = PANELS
# what users want first comes first; others follow as they are registered
FIRST = ("run", "show", "check", "scenes", "new", "body", "view", "plot", "animate", "summary")


def codes_in_short() -> str:
    """The codes on a line of help."""
    return f"Exit codes: {', '.join(f'{code} {words}' for code, (words, _) in CODES.items())}."


def code_table() -> str:
    """The codes as a Markdown table."""
    rows = [f"| {code} | {words}: {when} |" for code, (words, when) in CODES.items()]
    return "\n".join(["| code | meaning |", "| ---: | --- |", *rows])


def unwrap_text(text: str) -> str:
    """A help text with each paragraph on one line, except those marked with a backspace."""
    paragraphs = cleandoc(text).split("\n\n")
    return "\n\n".join(p if p.startswith("\b") else " ".join(p.split()) for p in paragraphs)


def fail(message: object, code: int) -> NoReturn:
    """Print a message and end the command with an exit code."""
    print(f"rigidmc: {message}", file=sys.stderr)
    raise typer.Exit(code)


def in_options(error: RigidmcError, command: Any) -> str:
    """The text of an error, in which an argument has the name of the option of the command that
    gives it: max_wall is --max-wall."""
    if not isinstance(error, OptionError) or error.table:
        return str(error)
    known = {option for one in command.params for option in one.opts}

    def typed(word: re.Match[str]) -> str:
        option = f"--{word[0].replace('_', '-')}"
        return option if option in known else word[0]

    # several have a comma or "and" between them; "size radius" is a word of --size
    return error.text(re.sub(r"(?:^|(?<=, )|(?<= and ))\w+", typed, error.key))


class Commands(TyperGroup):
    """The commands by panel, those of FIRST before others, studies by their names."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        for command in self.commands.values():
            command.help = unwrap_text(command.help or "")

    def invoke(self, ctx: Any) -> Any:
        """Run a command; a value that an option cannot take ends it as one does that the command
        itself finds wrong, and not as a wrong word. A mistake becomes one message, no traceback."""
        try:
            return super().invoke(ctx)
        except typer.BadParameter as error:
            if type(error) is typer.BadParameter:  # a missing one is of a class of its own
                error.exit_code = INVALID
            raise
        except RigidmcError as error:
            fail(in_options(error, self.commands[ctx.invoked_subcommand]), INVALID)

    def list_commands(self, ctx: Any) -> list[str]:
        def place(name: str) -> tuple[int, int, str]:
            panel: Any = getattr(self.commands[name], "rich_help_panel", None)
            # a command without a panel: at the end; studies by their names
            at = (*PANELS, panel).index(panel), (*FIRST, name).index(name)
            return *at, name if panel == STUDY else ""

        return sorted(self.commands, key=place)


app = typer.Typer(
    cls=Commands,
    context_settings={"help_option_names": ["-h", "--help"]},
    no_args_is_help=True,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    epilog=codes_in_short(),
)


def _version(asked: bool) -> None:
    """Print the version, and end."""
    if asked:
        print(f"rigidmc {VERSION}")
        raise typer.Exit(OK)


@app.callback()
def common(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Monte Carlo ensembles of rigid bodies with a fixed point: millions of tops in parallel."""


def load_scene(
    source: str,
    settings: Sequence[str] = (),
    allow_code: bool = False,
    run: Mapping[str, Any] | None = None,
) -> "Scene":
    """A scene with the --set options and the run settings of the command line."""
    from rigidmc.files.opening import is_zarr
    from rigidmc.scene.scene import Scene, scene_of

    pairs = []
    for setting in settings:
        key, equals, value = setting.partition("=")
        if not equals or "." not in key:
            rule = "expected table.key=value, e.g. body.moments=[1,2,3] or effects.gravity.g=1.62"
            raise OptionError(rule, at="set", value=setting)
        pairs.append((key.strip(), value.strip()))
    with in_file(source):
        file = source.lower().endswith(".nc") and not os.path.isdir(source)
        if file or is_zarr(source):
            # this checks the whole result, Scene.load only its scene
            with load_result(source) as result:
                scene = scene_of(result, pairs, allow_code)
        else:
            scene = Scene.load(source, pairs, allow_code)
        return scene.with_run(**run or {})


def load_result(path: str, allow_code: bool = False) -> "xr.Dataset":
    """The Dataset of a result, a file or a run directory; FileError that helps for other files."""
    from rigidmc.files.opening import is_zarr
    from rigidmc.scene.library import shipped_names

    there = os.path.exists(path)
    if (there and path.lower().endswith(".toml")) or (not there and path in shipped_names()):
        rule = (
            f"is a scene, no result: run it first, `rigidmc run {path} -o RESULT.nc`, or see it"
            f" turn by `rigidmc view {path}`"
        )
        raise FileError(rule, at="result", value=path)
    if os.path.isdir(path) and not is_zarr(path):
        from rigidmc.runs.directory.dataset import open_run

        return open_run(path, allow_code)
    from rigidmc.results.reader import open_result

    result = open_result(path)
    result.encoding["allow_code"] = allow_code
    return result


def keep_apart() -> None:
    """Let the libraries that this process has not imported yet read no settings from the working
    directory, which may hold a downloaded result.

    Three libraries read files where they are started: matplotlib `matplotlibrc`, which may name a
    program to run as ffmpeg; Numba `.numba_config.yaml`, which may change the bits of results;
    netCDF `.ncrc`. A pipe of such a name would block each command. The settings in the user's own
    folders hold as before.
    """
    os.environ.update(environment())
    on_import(("matplotlib", "numba"), _load_in_package)


def _load_in_package(module: ModuleType, load: Load) -> None:
    """Load a library in the folder of this package."""
    here = os.getcwd()
    os.chdir(PACKAGE)
    try:
        load()
    finally:
        os.chdir(here)
    if module.__name__ == "numba":
        # Numba looks for its file again whenever it compiles
        module.core.config._config_fname = os.devnull
