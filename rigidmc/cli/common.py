"""What all commands share: the app, exit codes, errors in words, and outputs."""

import os
import signal
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from types import FrameType, ModuleType
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

import typer

from rigidmc.cli.codes import FLAGGED as FLAGGED
from rigidmc.cli.codes import INCOMPLETE as INCOMPLETE
from rigidmc.cli.codes import INTERRUPTED as INTERRUPTED
from rigidmc.cli.codes import INVALID as INVALID
from rigidmc.cli.codes import IO as IO
from rigidmc.cli.codes import OK as OK
from rigidmc.cli.codes import REFUSED, TERMINATED, in_short
from rigidmc.cli.panels import Commands
from rigidmc.engine.cuda.devices import use
from rigidmc.errors import (
    FileError,
    NoRoom,
    NoSuchScene,
    OptionError,
    OutputExists,
    RigidmcError,
    SceneWarning,
    nearest,
)
from rigidmc.version import VERSION

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

    from rigidmc.scene.scene import Scene

LEFT = "no incomplete file bears a final name, and `rigidmc resume` goes on with a run directory"

app = typer.Typer(
    cls=Commands,
    context_settings={"help_option_names": ["-h", "--help"]},
    no_args_is_help=True,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    epilog=in_short(),
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


class Terminated(BaseException):
    """SIGTERM as an exception, so that a run ends the way it ends on Ctrl-C."""


class AskedToStop(BaseException):
    """SIGUSR1 as an exception; batch systems send it before they kill."""


@contextmanager
def reported() -> Iterator[None]:
    """Turn what can go wrong into one message and an exit code, never a traceback for a user's
    mistake. Announce compilation before it begins."""
    from rigidmc.progress import announcing

    with _signals() as numbers:
        try:
            with noted(), announcing(True), _no_parts_left(numbers):
                yield
        except RigidmcError as error:
            fail(error, INVALID)
        except OutputExists as error:
            fail(error, REFUSED)
        except NoRoom as error:
            fail(f"{error}; nothing was written", IO)
        except NoSuchScene as error:
            fail(error, INVALID)
        except FileNotFoundError as error:
            fail(_in_words(error), IO)
        except (OSError, RuntimeError) as error:
            if isinstance(error, RuntimeError) and not _of_files(error):
                raise
            unharmed = "nothing was" in str(error)
            fail(error if unharmed else f"{_in_words(error)}; nothing that existed was changed", IO)
        except MemoryError as error:
            ways = "write to a file with -o, save less, or run fewer members"
            fail(f"not enough memory: {error}; {ways}", IO)
        except KeyboardInterrupt:
            fail(f"interrupted; {LEFT}", INTERRUPTED)
        except Terminated:
            fail(f"terminated; {LEFT}", TERMINATED)
        except AskedToStop:
            fail(f"asked to stop; {LEFT}", INCOMPLETE)
        finally:
            use("cpu")  # what --device chose is for one command


def _of_files(error: RuntimeError) -> bool:
    """Whether the C library of netCDF, or a codec of zarr, raised an error."""
    return any(word in str(error) for word in ("HDF error", "NetCDF", "decompress"))


@contextmanager
def _signals() -> Iterator[list[int]]:
    """Raise Terminated and AskedToStop for their signals; yield the numbers of all that stop a
    command, SIGINT included."""

    def heard(number: int, _: FrameType | None) -> None:
        raise Terminated if number == signal.SIGTERM else AskedToStop

    numbers = [signal.SIGTERM]
    if hasattr(signal, "SIGUSR1"):  # Windows has none
        numbers.append(signal.SIGUSR1)
    previous = {signal.SIGINT: signal.getsignal(signal.SIGINT)}
    previous |= {number: signal.signal(number, heard) for number in numbers}
    try:
        yield list(previous)
    finally:
        for number, handler in previous.items():
            signal.signal(number, signal.SIG_DFL if handler is None else handler)


@contextmanager
def _no_parts_left(numbers: list[int]) -> Iterator[None]:
    """Delete incomplete files when a signal stops the command."""
    from rigidmc.files.outputs import drop_parts

    try:
        yield
    except (KeyboardInterrupt, Terminated, AskedToStop):
        for number in numbers:  # the clean-up is short: no second signal may interrupt it
            signal.signal(number, signal.SIG_IGN)
        drop_parts()
        raise


@contextmanager
def about(file: str) -> Iterator[None]:
    """Name the file in each error that names none."""
    try:
        yield
    except RigidmcError as error:
        error.file = error.file or file
        raise


def _in_words(error: Exception) -> str:
    """An error of the system without its number: the file, and what is wrong with it."""
    if not isinstance(error, OSError) or error.strerror is None or error.filename is None:
        return str(error)
    path = os.path.relpath(error.filename)
    path = os.fspath(error.filename) if path.startswith(os.pardir) else path
    folder, name = os.path.split(path)
    close = None
    if isinstance(error, FileNotFoundError) and os.path.isdir(folder or os.curdir):
        ending = os.path.splitext(name)[1]
        names = os.listdir(folder or os.curdir)
        close = nearest(name, [word for word in names if os.path.splitext(word)[1] == ending])
    hint = f" (did you mean '{os.path.join(folder, close)}'?)" if close else ""
    return f"{path}: {error.strerror[0].lower()}{error.strerror[1:]}{hint}"


@contextmanager
def noted() -> Iterator[None]:
    """Show each warning about a scene once, as a note. Warnings of libraries about overflow or
    strange files are hidden: rigidmc itself flags or refuses what follows from them."""
    seen = set[str]()

    def show(message: Warning | str, *_: Any, **__: Any) -> None:
        if str(message) not in seen:
            seen.add(str(message))
            print(f"rigidmc: note: {message}", file=sys.stderr)

    with warnings.catch_warnings():
        for kind in (RuntimeWarning, UserWarning):
            warnings.simplefilter("ignore", kind)
        warnings.simplefilter("always", SceneWarning)
        warnings.showwarning = show
        yield


def fail(message: object, code: int) -> NoReturn:
    """Print a message and end the command with an exit code."""
    print(f"rigidmc: {message}", file=sys.stderr)
    raise typer.Exit(code)


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
            raise OptionError("", "--set", setting, rule)
        pairs.append((key.strip(), value.strip()))
    with about(source):
        file = source.lower().endswith(".nc") and not os.path.isdir(source)
        if file or is_zarr(source):
            # this checks the whole result, Scene.load only its scene
            with opened(source) as result:
                scene = scene_of(result, pairs, allow_code)
        else:
            scene = Scene.load(source, pairs, allow_code)
        return scene.with_run(**run or {})


def opened(path: str, allow_code: bool = False) -> "xr.Dataset":
    """A result as a Dataset: a file or a run directory; FileError that helps for a scene."""
    import rigidmc
    from rigidmc.scene.library import shipped

    there = os.path.exists(path)
    if (there and path.lower().endswith(".toml")) or (not there and path in shipped()):
        rule = (
            f"is a scene, no result: run it first, `rigidmc run {path} -o RESULT.nc`, or see it"
            f" turn by `rigidmc view {path}`"
        )
        raise FileError("", "result", path, rule)
    return rigidmc.open(path, allow_code)


def plots_module() -> ModuleType:
    """The module that draws ensembles; exit code 74 without matplotlib."""
    try:
        from rigidmc.views import ensemble
    except ImportError as error:
        fail(f"pictures need matplotlib: pip install 'rigidmc[plot]' ({error})", IO)
    return ensemble


def refuse_outputs(
    force: bool,
    output: str | None = None,
    plot: str | None = None,
    bounds: str | None = None,
    animation: str | None = None,
    scene: str | None = None,
    study: str | None = None,
    size: int = 100_000,
) -> None:
    """Refuse, before any work, outputs that could not be written after it: files that exist, files
    that cannot be created, and names whose ending belongs to another kind of file. No two kinds of
    a command share an ending, so no two outputs share a name. Pictures and animations need
    matplotlib.

    study : output of a study, which is netCDF;  size : bytes of the largest output, if known
    """
    from rigidmc.files.outputs import refuse_existing

    kinds = {
        "results": output,
        "pictures": plot,
        "tables of bounds": bounds,
        "animations": animation,
        "scenes": scene,
        "netCDF files": study,
    }
    for kind, path in kinds.items():
        if path is not None:
            refuse_existing(path, force, kind, size)
    if plot is not None or animation is not None:
        plots_module()


def show_done(done: int, total: int) -> None:
    """Show how many members are done, on a terminal."""
    if sys.stderr.isatty():
        end = "" if done < total else "\n"
        line = f"\r{100 * done / total:3.0f} % of {total:,} members{end}"
        getattr(sys.stderr, "draw", sys.stderr.write)(line)
        sys.stderr.flush()


def keep(
    dataset: "xr.Dataset",
    output: str | None,
    plot: str | None,
    force: bool,
    draw: Callable[["xr.Dataset"], "Figure"],
) -> list[str]:
    """Write a study, and the picture draw(dataset); return a line for each file, see `written`."""
    from rigidmc.files.outputs import write_bytes
    from rigidmc.results.writer import encoded

    if output is not None:
        write_bytes(output, encoded(dataset), force)
    if plot is not None:
        save_picture(draw(dataset), plot, force)
    return written([output, plot])


def save_picture(figure: "Figure", path: str, force: bool) -> None:
    """Write a picture to a path that was checked before the work. If a file has appeared there
    since, the picture gets another name."""
    from rigidmc.figures import drawn
    from rigidmc.files.outputs import write_bytes

    write_bytes(path, drawn(figure, path), force)


def written(paths: Iterable[str | None]) -> list[str]:
    """A line for each file that was written."""
    from rigidmc.files.outputs import size_of

    return [f"  wrote {path} ({size_of(path) / 1e6:,.1f} MB)" for path in paths if path is not None]
