"""Options and arguments that commands share; the options of run settings follow from `Run`."""

import functools
import inspect
from collections.abc import Callable, Collection, Iterable, Mapping
from typing import Annotated, Any

import typer

from rigidmc.cli.app import INVALID, IO, fail
from rigidmc.engine.cuda.devices import resolve_device
from rigidmc.errors import NoDevice, OptionError, RigidmcError
from rigidmc.inputs.amounts import read_count_text, read_seconds, words_of
from rigidmc.inputs.measured import in_units
from rigidmc.inputs.units import units_text
from rigidmc.scene.library import shipped_names
from rigidmc.scene.save_times import read_every
from rigidmc.scene.settings import Angle, Count, Digits, Every, Index, Rate, Run, Time, types


def _option(key: str, metavar: str, read: Callable[[str], Any], **option: Any) -> Any:
    """Return an option whose text `read` parses; a RigidmcError ends the command with its
    message."""

    def parser(text: str) -> Any:
        try:
            return read(text)
        except RigidmcError as error:
            return fail(error.text(key), INVALID)

    return typer.Option(key, parser=parser, metavar=metavar, **option)


def count_option(key: str, least: int = 1, most: int | None = None, **option: Any) -> Any:
    """Return an option for a whole number, also written 1e6."""
    return _option(key, "N", lambda text: read_count_text(text, key[2:], least, most), **option)


def time_option(key: str, positive: bool = True, **option: Any) -> Any:
    """Return an option for a time: seconds, or 90s, 1h30m, 250ms."""
    return _option(key, "TIME", lambda text: read_seconds(text, key[2:], positive), **option)


def _number_option(key: str, units: str, **option: Any) -> Any:
    """Return an option for a number in SI units, or with a unit, such as "5 deg"."""

    def read(text: str) -> float:
        try:
            number: Any = float(text)
        except ValueError:
            number = in_units(text, units, key[2:])
        if isinstance(number, str):
            example = "5 deg" if units == "rad" else "5 deg/s"
            rule = f'expected a number in {units_text(units)}, or with its unit, "{example}"'
            raise OptionError(rule, at=key[2:], value=text)
        return float(number)

    return _option(key, "FLOAT", read, **option)


def _device(word: str) -> str:
    """Parse --device; the device must exist."""
    try:
        return resolve_device(word)
    except RigidmcError as error:
        fail(error.text("--device"), INVALID)
    except NoDevice as error:
        fail(f"{error}; nothing was written", IO)


def _keep_of(text: str) -> str | dict[str, str]:
    """Parse the setting `keep`: "final", or "omega=final,energy=summary"."""
    if "=" not in text:
        return text
    pairs = (part.partition("=") for part in text.split(","))
    return {name.strip(): word.strip() for name, _, word in pairs}


def make_completion(words: Callable[[], Iterable[str]]) -> Callable[[str], list[str]]:
    """Return a shell completion: the words that begin with the text after the last comma.

    Without a match, the shell completes file names.
    """

    def complete(incomplete: str) -> list[str]:
        before, comma, begun = incomplete.rpartition(",")
        return [f"{before}{comma}{word}" for word in words() if word.startswith(begun)]

    return complete


def _integrators() -> Iterable[str]:
    from rigidmc.physics.integrators import INTEGRATORS

    return INTEGRATORS


def _observables() -> Iterable[str]:
    from rigidmc.physics.observables import saveable_names

    return saveable_names()


_COMPLETED = {"integrator": make_completion(_integrators), "save": make_completion(_observables)}
_TEXTS: dict[str, Callable[[str], Any]] = {"save": words_of, "wrt": words_of, "keep": _keep_of}


def setting(name: str, words: str | None = None) -> Any:
    """Return the annotated type of the option for a run setting. Key, parser and help text follow
    from the field of `Run`.

    words : help text for a command that uses the setting differently
    """
    kind, key = types()[name], f"--{name.replace('_', '-')}"
    description = words or Run.model_fields[name].description or ""
    text: dict[str, Any] = {
        "help": f"{description[0].upper()}{description[1:]}.".replace("[", "\\["),
        "rich_help_panel": "Run settings, which override the scene",
        "autocompletion": _COMPLETED.get(name),
    }
    if name in _TEXTS:
        return Annotated[Any, typer.Option(key, parser=_TEXTS[name], metavar="WORDS", **text)]
    if kind is bool:
        return Annotated[bool | None, typer.Option(f"{key}/--no-{key[2:]}", **text)]
    if kind == Time:
        return Annotated[Any, time_option(key, **text)]
    if kind == Every:
        read = functools.partial(read_every, at=name, error=OptionError)
        return Annotated[Any, _option(key, "TIME", read, **text)]
    if kind in (Count, Index, Digits):
        return Annotated[Any, count_option(key, 0 if kind == Index else 1, **text)]
    if kind in (Angle, Rate):
        units = "rad" if kind == Angle else "rad s-1"
        return Annotated[Any, _number_option(key, units, **text)]
    number = getattr(kind, "__origin__", kind) is float
    return Annotated[(float if number else str) | None, typer.Option(key, **text)]


Command = Callable[..., None]


def add_setting_options(
    *names: str, but: Collection[str] = (), words: Mapping[str, str] = {}
) -> Callable[[Command], Command]:
    """Decorate a command that has a parameter `run`: add an option for each run setting in `names`
    (all by default) except those in `but`. `run` becomes the dict of the given settings.

    words : {setting: help text} for settings that this command uses differently
    """
    chosen = [name for name in names or Run.model_fields if name not in (*but, "varied")]
    return gather_options(
        "run",
        {name: setting(name, words.get(name)) for name in chosen},
        lambda given: {k: v for k, v in given.items() if v is not None},
    )


def gather_options(
    into: str, options: Mapping[str, Any], made: Callable[[dict[str, Any]], Any]
) -> Callable[[Command], Command]:
    """Decorate a command that has a parameter `into`: replace it by options, from whose values
    `made` makes the argument.

    options : {name: annotation, or (annotation, default)}; the default is None if omitted
    """

    def decorate(command: Command) -> Command:
        signature = inspect.signature(command)
        kind = inspect.Parameter.KEYWORD_ONLY
        others = [p.replace(kind=kind) for p in signature.parameters.values() if p.name != into]
        pairs = {k: how if isinstance(how, tuple) else (how, None) for k, how in options.items()}
        more = [
            inspect.Parameter(name, kind, default=default, annotation=annotation)
            for name, (annotation, default) in pairs.items()
        ]

        @functools.wraps(command)
        def gathered(**given: Any) -> None:
            value = made({name: given.pop(name) for name in options})
            command(**{into: value}, **given)

        # `inspect` documents this attribute; mypy lacks it
        shown = signature.replace(parameters=[*others, *more])
        gathered.__signature__ = shown  # type: ignore[attr-defined]
        gathered.__annotations__ = {p.name: p.annotation for p in (*others, *more)}
        return gathered

    return decorate


SceneArgument = Annotated[
    str,
    typer.Argument(
        metavar="SCENE",
        help="A TOML file, a shipped scene (see `rigidmc scenes`), or a result (.nc, .zarr).",
        autocompletion=make_completion(shipped_names),
    ),
]
ResultArgument = Annotated[
    str, typer.Argument(metavar="FILE", help="A result (.nc, .zarr) or a run directory.")
]
RunArgument = Annotated[
    str, typer.Argument(metavar="RUN", help="A run directory, from `rigidmc run SCENE -o RUN/`.")
]
Threads = Annotated[
    int | None, count_option("--threads", help="Number of threads; by default one per core.")
]
Device = Annotated[
    str | None,
    typer.Option(
        "--device",
        metavar="DEVICE",
        parser=_device,
        help="Where to integrate members: cpu, cuda for all GPUs, cuda:1 for one, or auto.",
    ),
]
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
    typer.Option("--allow-code", help="Run the scene's Python files, e.g. with custom effects."),
]
Output = Annotated[
    str | None, typer.Option("-o", "--output", metavar="FILE", help="netCDF file to write.")
]
FORMATS = (
    "File to write: netCDF (.nc), zarr (.zarr), or a table with one row per member (.csv, .parquet)"
)
ResultOutput = Annotated[
    str | None, typer.Option("-o", "--output", metavar="FILE", help=f"{FORMATS}.")
]
OutputOrRun = Annotated[
    str | None,
    typer.Option(
        "-o",
        "--output",
        metavar="FILE",
        help=f"{FORMATS}; RUN/ writes a run directory, which survives a kill.",
    ),
]
Plot = Annotated[
    str | None, typer.Option(metavar="FILE", help="Picture to write (.png, .pdf, .svg).")
]
Force = Annotated[bool, typer.Option(help="Replace existing files, but never folders.")]
Accept = Annotated[
    bool,
    typer.Option(
        "--accept", help="Continue even if library versions differ, which may change last bits."
    ),
]
MaxWall = Annotated[
    float | None,
    time_option(
        "--max-wall",
        help="Stop after this time and save unfinished work; `rigidmc resume` continues there."
        " Write 3h, 1h30m, 3600s or seconds.",
    ),
]
ShardSize = Annotated[
    float | None,
    typer.Option(
        min=0.001,
        help="Size of a shard of a run directory \\[MB]; by default 67. A shard has at least one"
        " block of members.",
    ),
]
ShardTime = Annotated[
    float | None,
    time_option(
        "--shard-time",
        help="Longest time for one thread to compute a shard of a run directory, from a measured"
        " rate; by default 120 s. With --shard-size alone there is no time limit, and the shards"
        " are the same on every machine.",
    ),
]
Cluster = Annotated[
    str | None,
    typer.Option(
        metavar="WHERE",
        help="Compute on dask workers: tcp://host:8786 is a scheduler, local:N starts N processes"
        " here.",
    ),
]
Shards = Annotated[
    str | None,
    typer.Option(
        "--shards",
        metavar="FROM:TO",
        help="Compute only these shards, as in a job array: 0:100 is the first hundred. `rigidmc"
        " show` prints the number of shards.",
    ),
]
