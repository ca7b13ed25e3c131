"""The app: exit codes, and functions that open a scene or a result."""

import os
import re
import sys
import time
from collections.abc import Mapping, Sequence
from types import ModuleType
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

import typer
from typer.core import TyperGroup

from rigidmc.errors import FileError, OptionError, RigidmcError, in_file
from rigidmc.processes.helpers import PACKAGE, environment
from rigidmc.processes.import_hook import Load, on_import
from rigidmc.version import VERSION

if TYPE_CHECKING:
    import xarray as xr

    from rigidmc.scene.scene import Scene

# Exit codes. The help and docs/reference/commands.md show this table, and tests/cli/test_codes.py
# holds every command to it.
OK, USAGE, INVALID, FLAGGED, INCOMPLETE, REFUSED = 0, 2, 3, 4, 5, 6
IO, HUNG_UP, INTERRUPTED, TERMINATED = 74, 129, 130, 143

# {code: (short name, meaning)}
CODES = {
    OK: ("done", "the command succeeded, and no member is flagged"),
    USAGE: ("usage", "unknown command or option, or missing argument"),
    INVALID: (
        "invalid",
        "unusable input: an invalid scene or option value, a file whose format needs a package"
        " that is not installed, a member or measure that the result does not have, a file that"
        " is damaged or of another kind, a run in which `verify` finds faults",
    ),
    FLAGGED: (
        "flagged",
        "done, and some members are flagged; for `stress` and `doctor`: some checks fail",
    ),
    INCOMPLETE: (
        "incomplete",
        "some members or shards are still missing, or the accuracy is not yet reached",
    ),
    REFUSED: ("refused", "an output already exists; nothing was overwritten"),
    IO: (
        "input or output",
        "a scene, result or run directory does not exist, or cannot be read or written; not enough"
        " memory or disk space; no GPU, or no matplotlib for a picture",
    ),
    HUNG_UP: ("hung up", "by SIGHUP: the terminal or the ssh session ended"),
    INTERRUPTED: ("interrupted", "by Ctrl-C"),
    TERMINATED: ("terminated", "by SIGTERM"),
}


def code_table() -> str:
    """Return the codes as a Markdown table."""
    rows = [f"| {code} | {words}: {when} |" for code, (words, when) in CODES.items()]
    return "\n".join(["| code | meaning |", "| ---: | --- |", *rows])


def fail(message: object, code: int) -> NoReturn:
    """Print a message and end the command with an exit code."""
    print(f"rigidmc: {message}", file=sys.stderr)
    raise typer.Exit(code)


def in_options(error: RigidmcError, command: Any) -> str:
    """Return the text of an error, with each argument named by its option: max_wall becomes
    --max-wall."""
    if not isinstance(error, OptionError) or error.table:
        return str(error)
    options = {option for parameter in command.params for option in parameter.opts}

    def typed(word: re.Match[str]) -> str:
        option = f"--{word[0].replace('_', '-')}"
        return option if option in options else word[0]

    # a comma or "and" separates several keys; "size radius" is a word of --size
    return error.text(re.sub(r"(?:^|(?<=, )|(?<= and ))\w+", typed, error.key))


class Commands(TyperGroup):
    """The group of all commands, which turns their errors into messages."""

    def invoke(self, ctx: Any) -> Any:
        """Run a command. An invalid option value exits with INVALID, whether typer or the command
        finds it. A user's mistake becomes one message without a traceback."""
        try:
            return super().invoke(ctx)
        except typer.BadParameter as error:
            if type(error) is typer.BadParameter:  # missing parameters raise a subclass
                error.exit_code = INVALID
            raise
        except RigidmcError as error:
            fail(in_options(error, self.commands[ctx.invoked_subcommand]), INVALID)


app = typer.Typer(
    cls=Commands,
    context_settings={"help_option_names": ["-h", "--help"]},
    no_args_is_help=True,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    epilog=f"Exit codes: {', '.join(f'{code} {words}' for code, (words, _) in CODES.items())}.",
)


def _version(asked: bool) -> None:
    """Print the version and exit."""
    if asked:
        print(f"rigidmc {VERSION}")
        raise typer.Exit(OK)


@app.callback()
def common(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Simulate Monte Carlo ensembles of rigid bodies with a fixed point, millions in parallel."""


def load_scene(
    source: str,
    settings: Sequence[str] = (),
    allow_code: bool = False,
    run: Mapping[str, Any] | None = None,
) -> "Scene":
    """Load a scene and apply the --set options and run settings of the command line."""
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
            # this checks the whole result; Scene.load checks only its scene
            with load_result(source) as result:
                scene = scene_of(result, pairs, allow_code)
        else:
            scene = Scene.load(source, pairs, allow_code)
        return scene.with_run(**run or {})


def load_result(path: str, allow_code: bool = False) -> "xr.Dataset":
    """Open the Dataset of a result file or a run directory; FileError with advice for others."""
    from rigidmc.files.kinds import another_kind
    from rigidmc.files.opening import is_zarr
    from rigidmc.files.stores import is_folder
    from rigidmc.scene.library import shipped_names

    if not os.path.exists(path) and path in shipped_names():
        rule = (another_kind("SCENE.toml", "result") or "").replace("SCENE.toml", path)
        raise FileError(rule, at="result", value=path)
    if is_folder(path) and not is_zarr(path):
        from rigidmc.runs.directory.dataset import open_run

        return open_run(path, allow_code)
    from rigidmc.results.reader import open_result

    return open_result(path, allow_code)


_from_start = False


def limit_from_start() -> None:
    """Let time limits count from the start of the process, which runs one command."""
    global _from_start
    _from_start = True


def end_of_limit(max_wall: float | None) -> float | None:
    """Return when a time limit ends, on the clock of time.monotonic(); None without limit.

    It counts from the start of the process, as batch systems count: imports take some of it.
    """
    if max_wall is None:
        return None
    spent = 0.0
    if _from_start:
        import psutil

        spent = time.time() - psutil.Process().create_time()
    return time.monotonic() + max_wall - spent


def keep_apart() -> None:
    """Keep libraries that are not imported yet from reading settings in the working directory,
    which may hold a downloaded result.

    Three libraries read files from the working directory: matplotlib reads `matplotlibrc`, which
    may name a program to run as ffmpeg; Numba reads `.numba_config.yaml`, which may change the bits
    of results; netCDF reads `.ncrc`. A pipe with one of these names would block every command.
    Settings in the user's own folders still apply.
    """
    os.environ.update(environment())
    on_import(("matplotlib", "numba"), _load_in_package)


def _load_in_package(module: ModuleType, load: Load) -> None:
    """Load a library with the folder of this package as the working directory."""
    here = os.getcwd()
    os.chdir(PACKAGE)
    try:
        load()
    finally:
        os.chdir(here)
    if module.__name__ == "numba":
        # Numba searches for its file at every compilation
        module.core.config._config_fname = os.devnull
