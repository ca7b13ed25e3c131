"""What all commands share: options, exit codes, and errors in words."""

import os
import signal
import sys
import warnings
from contextlib import contextmanager
from typing import Annotated

import typer

OK, USAGE, INVALID, FLAGGED, INCOMPLETE, REFUSED, IO, INTERRUPTED, TERMINATED = (
    0,
    2,
    3,
    4,
    5,
    6,
    74,
    130,
    143,
)

LEFT = "what is not whole was left under no final name, and `rigidmc resume` goes on with a run directory"

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    help="Monte Carlo ensembles of rigid bodies with a fixed point: millions of free or heavy tops in parallel.",
    epilog="Exit codes: 0 done, 2 usage, 3 invalid scene, 4 some members flagged, 5 incomplete, 6 refused to overwrite, "
    "74 input or output failed, 130 / 143 stopped by a signal.",
)


def count_option(key, least=1, most=None, **option):
    """An option that takes a whole number, also as 1e6."""

    def read(text):
        from rigidmc.scene.amounts import counted_text

        return counted_text(text, key, least, most)

    return typer.Option(key, parser=_told(read), metavar="N", **option)


def time_option(key, positive=True, **option):
    """An option that takes a time: seconds, or 90s, 1h30m, 250ms."""

    def read(text):
        from rigidmc.scene.amounts import seconds

        return seconds(text, key, positive=positive)

    return typer.Option(key, parser=_told(read), metavar="TIME", **option)


def _told(read):
    """A parser of an option: it calls `read`, and an error ends the command with its message and exit code."""

    def parser(text):
        from rigidmc.errors import RigidmcError

        try:
            return read(text)
        except RigidmcError as error:
            return fail(error, INVALID)

    return parser


SceneArgument = Annotated[
    str,
    typer.Argument(
        metavar="SCENE", help="A TOML file, the name of a shipped scene, or a result file (.nc)."
    ),
]
ResultArgument = Annotated[
    str, typer.Argument(metavar="FILE", help="A result (.nc), or a run directory.")
]
Members = Annotated[int | None, count_option("--members", help="Members of the ensemble.")]
Seed = Annotated[int | None, count_option("--seed", 0, help="Seed of all random draws.")]
Integrator = Annotated[
    str | None, typer.Option(help="A name of `rigidmc integrators`, or auto with --tolerance.")
]
Tolerance = Annotated[
    float | None,
    typer.Option(
        help="Error to keep in 99 % of the members, of momentum \\[of its size] and attitude \\[rad]: chooses integrator and step."
    ),
]
Dtype = Annotated[
    str | None, typer.Option(help="float64 or float32: the numbers in which steps are made.")
]
Compensated = Annotated[
    bool | None,
    typer.Option("--compensated", help="Keep the remainders of all sums, for very many steps."),
]
Dt = Annotated[float | None, time_option("--dt", help="Step.")]
Turn = Annotated[
    float | None,
    typer.Option(help="In place of --dt: each member steps by so much of its own motion \\[rad]."),
]
TEnd = Annotated[
    float | None,
    time_option("--t-end", help="End time. Every TIME is in seconds, or like 90s, 1h30m, 250ms."),
]
Every = Annotated[
    float | None, time_option("--every", help="Time between saves; without it first and last.")
]
Save = Annotated[
    str | None,
    typer.Option(
        help="What to save and to watch, of `rigidmc observables`, e.g. omega,attitude,energy or flips,omega_max; none for the summary only."
    ),
]
Keep = Annotated[
    str | None,
    typer.Option(
        help="How much of what is saved: full, thinned, summary, final or none, or of each: omega=final,energy=summary. Of flagged members, all."
    ),
]
Threads = Annotated[int | None, count_option("--threads", help="Threads; default one per core.")]
Set = Annotated[
    list[str],
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="Override a value of the scene, e.g. body.moments=[1,2,3].",
    ),
]
AllowCode = Annotated[
    bool,
    typer.Option(
        "--allow-code", help="Run the Python files that the scene takes effects of your own from."
    ),
]
Until = Annotated[
    str | None,
    typer.Option(
        metavar="MEASURE",
        help='Add members until it is known so well, e.g. "p(flips >= 1) +- 0.001", "mean(flip_wait) +- 1 %".',
    ),
]
Most = Annotated[int, count_option("--most", 32, help="Members at most, with --until.")]
Output = Annotated[
    str | None, typer.Option("-o", "--output", metavar="FILE", help="netCDF file to write.")
]
Plot = Annotated[
    str | None, typer.Option(metavar="FILE", help="Picture to write (.png, .pdf, .svg).")
]
Force = Annotated[bool, typer.Option(help="Replace files that exist; folders never.")]


class Terminated(BaseException):
    """SIGTERM, as an exception, so that a run ends the way it does on Ctrl-C."""


class AskedToStop(BaseException):
    """SIGUSR1, which batch systems send before they kill."""


@contextmanager
def reported():
    """Turn what can go wrong into one message and an exit code; never a traceback for a user's mistake. What is compiled is said before it begins."""
    from rigidmc.errors import NoRoom, OutputExists, RigidmcError
    from rigidmc.files.outputs import drop_parts
    from rigidmc.progress import announcing

    def heard(number, _):
        raise Terminated if number == signal.SIGTERM else AskedToStop

    numbers = [signal.SIGTERM, *([signal.SIGUSR1] if hasattr(signal, "SIGUSR1") else [])]
    previous = {
        signal.SIGINT: signal.getsignal(signal.SIGINT),
        **{number: signal.signal(number, heard) for number in numbers},
    }
    try:
        try:
            with noted(), announcing(True):
                yield
        except (KeyboardInterrupt, Terminated, AskedToStop):
            for number in previous:  # the clean-up is short: no second signal may interrupt it
                signal.signal(number, signal.SIG_IGN)
            drop_parts()
            raise
    except RigidmcError as error:
        fail(error, INVALID)
    except OutputExists as error:
        fail(error, REFUSED)
    except NoRoom as error:
        fail(f"{error}; nothing was written", IO)
    except FileNotFoundError as error:
        fail(_in_words(error), INVALID if "shipped scene" in str(error) else IO)
    except (OSError, RuntimeError) as error:
        if (
            isinstance(error, RuntimeError)
            and "HDF error" not in str(error)
            and "NetCDF" not in str(error)
        ):
            raise
        fail(
            error
            if "nothing was" in str(error)
            else f"{_in_words(error)}; nothing that existed was changed",
            IO,
        )
    except MemoryError as error:
        fail(
            f"not enough memory: {error}; write to a file with -o, save less, or run fewer members",
            IO,
        )
    except KeyboardInterrupt:
        fail(f"interrupted; {LEFT}", INTERRUPTED)
    except Terminated:
        fail(f"terminated; {LEFT}", TERMINATED)
    except AskedToStop:
        fail(f"asked to stop; {LEFT}", INCOMPLETE)
    finally:
        for number, handler in previous.items():
            signal.signal(number, signal.SIG_DFL if handler is None else handler)


def _in_words(error):
    """An error of the system without its number: the file, and what is wrong with it."""
    if getattr(error, "strerror", None) is None or error.filename is None:
        return str(error)
    from rigidmc.errors import nearest

    path = os.path.relpath(error.filename)
    path = os.fspath(error.filename) if path.startswith(os.pardir) else path
    folder, name = os.path.split(path)
    here = (
        os.listdir(folder or os.curdir)
        if isinstance(error, FileNotFoundError) and os.path.isdir(folder or os.curdir)
        else []
    )
    close = nearest(name, [word for word in here if _ending(word) == _ending(name)])
    hint = f" (did you mean '{os.path.join(folder, close)}'?)" if close else ""
    return f"{path}: {error.strerror[0].lower()}{error.strerror[1:]}{hint}"


def _ending(name):
    return os.path.splitext(name)[1]


@contextmanager
def noted():
    """Show warnings about scenes as notes, each once. Warnings of libraries, about overflow or strange files, are hidden: rigidmc
    itself flags or refuses what follows from them."""
    from rigidmc.errors import SceneWarning

    seen = set()

    def show(message, *_, **__):
        if str(message) not in seen:
            seen.add(str(message))
            print(f"rigidmc: note: {message}", file=sys.stderr)

    with warnings.catch_warnings():
        for kind in (RuntimeWarning, UserWarning):
            warnings.simplefilter("ignore", kind)
        warnings.simplefilter("always", SceneWarning)
        warnings.showwarning = show
        yield


def fail(message, code):
    print(f"rigidmc: {message}", file=sys.stderr)
    raise typer.Exit(code)


def load_scene(source, settings, allow_code=False, **run):
    """A scene with the options of the command line in it."""
    from rigidmc.errors import OptionError, RigidmcError
    from rigidmc.scene.file import scene_of
    from rigidmc.scene.scene import Scene

    pairs = []
    for setting in settings:
        key, equals, value = setting.partition("=")
        if not equals or "." not in key:
            raise OptionError(
                "",
                "--set",
                setting,
                "expected table.key=value, e.g. body.moments=[1,2,3] or effects.gravity.g=1.62",
            )
        pairs.append((key.strip(), value.strip()))
    if run.get("save") is not None:
        run["save"] = tuple(
            word.strip() for word in run["save"].split(",") if word.strip() not in ("", "none")
        )
    if run.get("keep") is not None and "=" in run["keep"]:
        run["keep"] = {
            name.strip(): word.strip()
            for name, _, word in (part.partition("=") for part in run["keep"].split(","))
        }
    try:
        if source.lower().endswith(".nc") and not os.path.isdir(source):
            with opened(source) as result:  # checks the whole result, Scene.load its scene alone
                return scene_of(result, pairs, allow_code).with_run(**run)
        return Scene.load(source, pairs, allow_code).with_run(**run)
    except RigidmcError as error:
        error.file = error.file or source
        raise


def opened(path, allow_code=False):
    """A result as a Dataset: a file or a run directory."""
    import rigidmc

    return rigidmc.open(path, allow_code)


def plots_module():
    try:
        from rigidmc.views import ensemble
    except ImportError as error:
        fail(f"pictures need matplotlib: pip install 'rigidmc[plot]' ({error})", IO)
    return ensemble


def refuse_outputs(force, output=None, plot=None, bounds=None, animation=None, size=100_000):
    """Refuse, before any work, outputs that could not be written after it: files that exist, that cannot be made, or whose ending
    is not one of their kind. No two kinds share an ending, so no two outputs share a name. Pictures and animations need matplotlib.

    size : bytes of the largest output, if known
    """
    from rigidmc.files.outputs import refuse_existing

    for kind, path in {
        "results": output,
        "pictures": plot,
        "tables of bounds": bounds,
        "animations": animation,
    }.items():
        if path is not None:
            refuse_existing(path, force, kind, size)
    if plot is not None or animation is not None:
        plots_module()


def keep(dataset, output, plot, force, draw):
    """Write a study, and the picture that draw(dataset) makes of it. Returns a line for each file, see `told`."""
    from rigidmc.files.outputs import write_bytes
    from rigidmc.storage.writer import encoded

    if output is not None:
        write_bytes(output, encoded(dataset), force)
    if plot is not None:
        save_picture(draw(dataset), plot, force)
    return told([output, plot])


def save_picture(figure, path, force):
    """Write a picture to a path that was checked before the work. If a file is there now, the picture gets another name."""
    from rigidmc.files.outputs import write_bytes

    write_bytes(path, plots_module().drawn(figure, path), force)


def told(paths):
    """A line for each file that was written."""
    return [
        f"  wrote {path} ({os.path.getsize(path) / 1e6:,.1f} MB)"
        for path in paths
        if path is not None
    ]
