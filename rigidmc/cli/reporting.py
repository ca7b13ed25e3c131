"""Messages and output of commands: errors and signals with their exit codes, notes, lines on
written files, and standard streams that never fail."""

import contextlib
import os
import signal
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from types import FrameType, ModuleType
from typing import TYPE_CHECKING, Any, TextIO, cast

from rigidmc.cli.app import HUNG_UP, INCOMPLETE, INTERRUPTED, INVALID, IO, REFUSED, TERMINATED, fail
from rigidmc.errors import (
    NoRoom,
    NoSuchScene,
    OptionError,
    OutputExists,
    SceneWarning,
    in_file,
    nearest,
    terminal_text,
)

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

LEFT = "no partial file is under its final name; `rigidmc resume` continues a run directory"


class Terminated(BaseException):
    """SIGTERM as an exception, so that a run ends as it does on Ctrl-C."""


class HungUp(Terminated):
    """SIGHUP as an exception: a lost ssh session ends a run as SIGTERM does."""


class AskedToStop(BaseException):
    """SIGUSR1 as an exception; batch systems send it before they kill."""


@contextmanager
def report_errors(file: str | None = None) -> Iterator[None]:
    """Turn errors of files and memory into one message and an exit code, never a traceback;
    `rigidmc.cli.app.Commands` handles a user's mistakes likewise. Announce compilation before it
    begins.

    file : the scene or result of the command, for messages that name no file
    """
    from rigidmc.processes.progress import announce

    named = contextlib.nullcontext() if file is None else in_file(file)
    with _signals() as numbers:
        try:
            with show_notes(), announce(True), _no_parts_left(numbers), named:
                yield
        except OutputExists as error:
            fail(error, REFUSED)
        except NoRoom as error:
            fail(f"{error}; nothing was written", IO)
        except NoSuchScene as error:
            fail(error, INVALID)
        except FileNotFoundError as error:
            fail(_in_words(error), IO)
        except (OSError, RuntimeError) as error:
            # the C library of netCDF and codecs of zarr raise RuntimeErrors
            of_files = any(word in str(error) for word in ("HDF error", "NetCDF", "decompress"))
            if isinstance(error, RuntimeError) and not of_files:
                raise
            unharmed = "nothing was" in str(error)
            fail(error if unharmed else f"{_in_words(error)}; nothing that existed was changed", IO)
        except MemoryError as error:
            ways = "write to a file with -o, save fewer variables, or run fewer members"
            fail(f"not enough memory: {error}; {ways}", IO)
        except KeyboardInterrupt:
            fail(f"interrupted; {LEFT}", INTERRUPTED)
        except HungUp:
            fail(f"hung up; {LEFT}", HUNG_UP)
        except Terminated:
            fail(f"terminated; {LEFT}", TERMINATED)
        except AskedToStop:
            fail(f"stopped by SIGUSR1; {LEFT}", INCOMPLETE)


@contextmanager
def _signals() -> Iterator[list[int]]:
    """Raise an exception for each signal that stops a command; yield the numbers of these signals,
    SIGINT included."""
    kinds: dict[int, type[BaseException]] = {signal.SIGTERM: Terminated}
    if hasattr(signal, "SIGUSR1"):  # not on Windows
        kinds[signal.SIGUSR1] = AskedToStop
        if signal.getsignal(signal.SIGHUP) != signal.SIG_IGN:  # as nohup sets it
            kinds[signal.SIGHUP] = HungUp

    def heard(number: int, _: FrameType | None) -> None:
        raise kinds[number]

    previous: dict[int, Any] = {signal.SIGINT: signal.getsignal(signal.SIGINT)}
    previous |= {number: signal.signal(number, heard) for number in kinds}
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
        for number in numbers:  # the clean-up is short; a second signal must not interrupt it
            signal.signal(number, signal.SIG_IGN)
        drop_parts()
        raise


def _in_words(error: Exception) -> str:
    """Return an operating-system error without its number: the file and the fault."""
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
def show_notes() -> Iterator[None]:
    """Show each warning about a scene once, as a note. Hide the warnings of libraries about
    overflow or strange files: rigidmc itself flags or refuses the consequences."""
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


def plots_module() -> ModuleType:
    """Return the module that draws ensembles; exit code 74 without matplotlib."""
    try:
        from rigidmc.views import ensemble
    except ImportError as error:
        fail(f"pictures need matplotlib: pip install 'rigidmc[plot]' ({error})", IO)
    return ensemble


def refuse_outputs(
    force: bool,
    output: str | None = None,
    plot: str | None = None,
    animation: str | None = None,
    picture: str | None = None,
    scene: str | None = None,
    study: str | None = None,
    size: int = 100_000,
    more: Sequence[tuple[str, str, str | None]] = (),
) -> None:
    """Refuse, before any work, outputs that could not be written after it: files that exist, files
    that cannot be created, and names whose extension belongs to another kind of file. No two kinds
    of output of a command share an extension, so no two outputs share a name. Pictures and
    animations require matplotlib.

    plot : picture of the option --plot, in addition to another output
    study : output of a study, a netCDF file;  size : bytes of the largest output, if known
    more : (kind of file, option, path) of other outputs
    """
    from rigidmc.files.outputs import refuse_existing

    outputs = [
        ("results", "output", output),
        ("pictures", "plot", plot),
        ("pictures", "output", picture),
        ("animations", "output", animation),
        ("scenes", "output", scene),
        ("netCDF files", "output", study),
        *more,
    ]
    for kind, option, path in outputs:
        if path is not None:
            try:
                refuse_existing(path, force, kind, size)
            except OptionError as error:
                error.at = option
                raise
    if any(path is not None for path in (plot, picture, animation)):
        plots_module()


def show_done(done: int, total: int) -> None:
    """Show the number of finished members, on a terminal."""
    from rigidmc.results.labels import count_text  # brings NumPy, which `scenes` does without

    if sys.stderr.isatty():
        end = "" if done < total else "\n"
        line = f"\r{100 * done / total:3.0f} % of {count_text(total, 'member')}{end}"
        getattr(sys.stderr, "draw", sys.stderr.write)(line)
        sys.stderr.flush()


def write_study(
    dataset: "xr.Dataset",
    output: str | None,
    plot: str | None,
    force: bool,
    draw: Callable[["xr.Dataset"], "Figure"],
) -> list[str]:
    """Write a study and the picture draw(dataset); return one line per file, see
    `report_files`."""
    from rigidmc.files.outputs import write_bytes
    from rigidmc.results.writer import netcdf_bytes

    if output is not None:
        write_bytes(output, netcdf_bytes(dataset), force)
    if plot is not None:
        save_picture(draw(dataset), plot, force)
    return report_files([output, plot])


def save_picture(figure: "Figure", path: str, force: bool) -> None:
    """Write a picture to a path that was checked before the work. If a file has appeared there
    since, write the picture under another name."""
    from rigidmc.files.outputs import write_bytes
    from rigidmc.views.figures import picture_bytes

    write_bytes(path, picture_bytes(figure, path), force)


def report_files(paths: Iterable[str | None]) -> list[str]:
    """Return one line for each written file."""
    from rigidmc.files.outputs import disk_bytes

    return [
        f"  wrote {path} ({disk_bytes(path) / 1e6:,.1f} MB)" for path in paths if path is not None
    ]


class Stream:
    """A standard stream that never fails, even if it is closed, lacks a reader, or fills the disk.

    Files and exit codes do not depend on it, except the exit code that reports a failed write.

    fault : the OSError that ended the output; None if the reader has gone
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream, self._gone = stream, False
        self.fault: OSError | None = None
        with contextlib.suppress(AttributeError):
            # an encoding without a character such as ² must not make the command fail
            # (a stream without `reconfigure` stays as it is)
            stream.reconfigure(errors="backslashreplace")  # type: ignore[attr-defined]

    def write(self, text: str) -> int:
        """Write a text without terminal control characters, unless rich writes it: rich draws help
        and progress, and only from our own words."""
        rich = sys._getframe(1).f_globals.get("__name__", "").startswith("rich.")
        return self.draw(text if rich else terminal_text(text))

    def draw(self, text: str) -> int:
        """Write a text unchanged."""
        self._tried(self._stream.write, text)
        return len(text)

    def flush(self) -> None:
        self._tried(self._stream.flush)

    def _tried(self, work: Callable[..., object], *texts: str) -> None:
        if not self._gone:
            try:
                work(*texts)
            except OSError as error:
                self._gone, self.fault = True, None if isinstance(error, BrokenPipeError) else error
                with contextlib.suppress(OSError):  # drops its buffer and the output of libraries
                    os.dup2(os.open(os.devnull, os.O_WRONLY), self._stream.fileno())

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


def guard() -> Stream:
    """Give this process standard streams that never fail; return the standard output."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:  # closed: printed text would go into the next file that is opened
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)
    sys.stdin = sys.stdin or os.fdopen(0, closefd=False)
    out = Stream(sys.stdout or os.fdopen(1, "w", closefd=False))
    error = Stream(sys.stderr or os.fdopen(2, "w", closefd=False))
    sys.stdout, sys.stderr = cast(TextIO, out), cast(TextIO, error)
    return out
