"""The command of every study, made from its record when it runs or shows its help page."""

import inspect
from collections.abc import Callable
from contextlib import nullcontext
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from rigidmc.cli.app import FLAGGED, INCOMPLETE, OK, load_result, load_scene
from rigidmc.cli.directories import (
    DirectoryOptions,
    names_a_run,
    refuse_directory_options,
    refuse_force,
    start_directory,
)
from rigidmc.cli.options import (
    AllowCode,
    Cluster,
    Device,
    Force,
    MaxWall,
    Output,
    OutputOrRun,
    Plot,
    SceneArgument,
    Set,
    Shards,
    ShardSize,
    ShardTime,
    Threads,
    add_setting_options,
    count_option,
    gather_options,
    time_option,
)
from rigidmc.cli.reporting import (
    refuse_outputs,
    report_errors,
    report_files,
    show_done,
    write_study,
)
from rigidmc.errors import OptionError, in_file
from rigidmc.files.stores import is_folder

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

    from rigidmc.runs.directory.folder import RunDirectory
    from rigidmc.studies.framework.options import Option
    from rigidmc.studies.framework.study import Study


OUTCOMES = {"done": OK, "flagged": FLAGGED, "incomplete": INCOMPLETE}  # {outcome: exit code}


class RunOptions(NamedTuple):
    """Options for computing members and writing them.

    settings : values of --set;  output : a file or a run directory
    ways : options for run directories only
    """

    settings: list[str]
    allow_code: bool
    threads: int | None
    device: str | None
    output: str | None
    plot: str | None
    force: bool
    ways: DirectoryOptions


def where_of(values: dict[str, Any]) -> RunOptions:
    """Gather options in a RunOptions."""
    ways = DirectoryOptions(*(values.pop(name, None) for name in DirectoryOptions._fields))
    settings, output = list(values["settings"] or ()), values["output"]
    flags = bool(values["allow_code"]), bool(values["force"])
    threads, device = values["threads"], values.get("device")
    return RunOptions(settings, flags[0], threads, device, output, values["plot"], flags[1], ways)


# options from which `where_of` makes a RunOptions: for studies whose members or tasks may be in a
# run directory, and for others
OF_MEMBERS: dict[str, Any] = {
    "settings": Set, "allow_code": AllowCode, "threads": Threads, "device": Device,
    "output": OutputOrRun, "plot": Plot, "force": Force, "max_wall": MaxWall, "shards": Shards,
    "shard_size": ShardSize, "shard_time": ShardTime, "cluster": Cluster,
}  # fmt: skip
OF_FILES: dict[str, Any] = {
    "threads": Threads, "settings": Set, "allow_code": AllowCode, "output": Output, "plot": Plot,
    "force": (Force, False),  # the help page shows this default
}  # fmt: skip


def command_of(study: "Study") -> Callable[..., None]:
    """Return the function of the command of a study, with options as typer reads them."""
    from rigidmc.studies.framework.options import options_of
    from rigidmc.studies.framework.work import Direct

    pictured, is_direct = options_of(study.picture_options), isinstance(study.work, Direct)

    def command(name: str, where: RunOptions, run: Any = None, **options: Any) -> None:
        picture = {option.name: options.pop(option.name) for option in pictured}
        files = {key: options.pop(key) for key in study.files}
        with report_errors(None if is_direct else name):  # `_measured` names the scene itself
            if is_direct:
                dataset = _measured(study, name, where, options, files, run or {})
                file = where.output
            else:
                dataset, file = _run_study(study, name, where, options, run)
            show(study, dataset, where._replace(output=file), picture, files)
        end(study, dataset)

    kind = inspect.Parameter.KEYWORD_ONLY
    has_settings = not is_direct or study.settings is not None
    parameters = [
        _source(study),
        *command_parameters(study),
        *(_path(name, file.text) for name, file in study.files.items()),
        *(inspect.Parameter(name, kind) for name in ("run",) * has_settings + ("where",)),
    ]
    command.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    gathered = gather_options("where", OF_FILES if is_direct else OF_MEMBERS, where_of)(command)
    if not has_settings:
        return gathered
    settings = add_setting_options(*(study.settings or ()), but=("wrt",), words=study.settings_help)
    return settings(gathered)


def command_parameters(study: "Study") -> list[inspect.Parameter]:
    """Return the options of a study and of its picture as parameters of a command."""
    from rigidmc.studies.framework.options import options_of

    options = (*options_of(study.options), *options_of(study.picture_options))
    return [_parameter(option) for option in options if option.in_command]


def _source(study: "Study") -> inspect.Parameter:
    """Return the scene or other source of a study as a parameter of its command."""
    kind, metavar = inspect.Parameter.KEYWORD_ONLY, study.work.sources
    if metavar == "SCENE":
        return inspect.Parameter("name", kind, annotation=SceneArgument)
    if study.work.needs_scene:
        text = f"A shipped scene or a TOML file; or {study.source}."
        source = Annotated[str, typer.Argument(metavar=metavar, help=text)]
        return inspect.Parameter("name", kind, annotation=source)
    text = f"{study.scene_text[0].upper()}{study.scene_text[1:]}."
    optional = Annotated[str | None, typer.Argument(metavar=metavar, help=text)]
    return inspect.Parameter("name", kind, annotation=optional, default=None)


def _path(name: str, text: str) -> inspect.Parameter:
    """Return the path of a file that a study writes as a parameter of its command."""
    key, text = f"--{name.replace('_', '-')}", f"{text[0].upper()}{text[1:]}."
    annotation = Annotated[str | None, typer.Option(key, metavar="FILE", help=text)]
    return inspect.Parameter(
        name, inspect.Parameter.KEYWORD_ONLY, annotation=annotation, default=None
    )


def _parameter(option: "Option") -> inspect.Parameter:
    """Return an option of a study as a parameter of its command."""
    from rigidmc.studies.framework.options import REQUIRED, Names, Numbers, Time, Words

    key, text = f"--{option.name.replace('_', '-')}", f"{option.text[0].upper()}{option.text[1:]}."
    more: dict[str, Any] = {"help": text.replace("[", "\\[")}
    kind: Any = {Words: list[str], Names: str, Numbers: str}.get(option.type, option.type)
    kind = kind if option.default is REQUIRED or kind is bool else kind | None
    made = typer.Option(key, metavar=option.metavar or None, **more)
    if option.type is int:
        made = count_option(key, option.least, **more)
    elif option.type is Time:
        made = time_option(key, **more)
    elif option.is_argument:
        made = typer.Argument(metavar=option.metavar, **more)
    # the help page shows the default unless the text does; None marks an omitted option
    is_shown = option.default is REQUIRED or not (option.is_new or "by default" in option.text)
    return inspect.Parameter(
        option.name,
        inspect.Parameter.KEYWORD_ONLY,
        default=option.default if is_shown else None,
        annotation=Annotated[kind, made],
    )


def _measured(
    study: "Study",
    name: str | None,
    where: RunOptions,
    options: dict[str, Any],
    files: dict[str, str | None],
    run: dict[str, Any],
) -> "xr.Dataset":
    """Compute a study at once, with or without a scene."""
    more = [(study.files[key].kind, key, path) for key, path in files.items()]
    refuse_outputs(where.force, plot=where.plot, study=where.output, more=more)
    asked = {key: value for key, value in options.items() if value is not None}
    with nullcontext() if name is None else in_file(name):
        scene = None if name is None else load_scene(name, where.settings, where.allow_code)
        scene, read = study.designed(scene, asked, run)
        return study.work.compute(scene, read, where.threads, None, True)


def _run_study(
    study: "Study", name: str, where: RunOptions, options: dict[str, Any], run: dict[str, Any]
) -> "tuple[xr.Dataset, str | None]":
    """Return (a study, the file to write it to), from a result, a run directory or a scene."""
    from rigidmc.studies.framework.members import Members
    from rigidmc.studies.framework.options import options_of

    news = {option.name for option in options_of(study.options) if option.is_new}
    new = {key: value for key, value in options.items() if key in news}
    asked = {key: value for key, value in options.items() if value is not None}
    again = {key: value for key, value in asked.items() if key not in news}

    def stored(path: str) -> "xr.Dataset":
        code = where.allow_code
        result = load_result(path, code) if isinstance(study.work, Members) else path
        return study.of(result, allow_code=code, threads=where.threads, **again)

    file = None if folder_of(where.output) else where.output
    refuse_outputs(where.force, plot=where.plot, study=file)
    if is_folder(name) or name.lower().endswith(".nc"):
        _refuse_new({"set": where.settings or None, **new, **run, **where.ways._asdict()})
        return stored(name), where.output

    def designed() -> tuple[Any, Any]:
        return study.designed(load_scene(name, where.settings, where.allow_code), asked, run)

    return compute_study(study, where, designed, stored)


def folder_of(output: str | None) -> str | None:
    """Return the run directory that an output names; None if it names a file."""
    return output if output is not None and names_a_run(output) else None


def compute_study(
    study: "Study",
    where: RunOptions,
    designed: Callable[[], tuple[Any, Any]],
    stored: "Callable[[str], xr.Dataset]",
) -> "tuple[xr.Dataset, str | None]":
    """Compute the members or tasks of a study, in memory or in a run directory; return (the study,
    the file to write it to).

    designed : () -> (input of the work, options of the study)
    stored : path of a run directory -> study
    """
    from rigidmc.processes.progress import say
    from rigidmc.studies.framework.members import Members
    from rigidmc.studies.framework.tasks import Tasks

    work: Any = study.work
    folder, threads, device = folder_of(where.output), where.threads, where.device
    if folder is None:
        refuse_directory_options(where.ways)
        design, read = designed()
        if isinstance(work, Members):
            say(work.price(design, read, threads, device=device))
        progress: Any = True if isinstance(work, Tasks) else show_done
        return work.compute(design, read, threads, device, progress), where.output
    refuse_force(folder, where.force)
    design, read = designed()

    def make(
        size: float | None, only: range | None, threads: int | None, limit: float | None
    ) -> "RunDirectory":
        sizes = {"size": size, "only": only, "threads": threads, "limit": limit, "device": device}
        directory: RunDirectory = work.create(study.name, design, read, folder, **sizes)
        return directory

    code_of_run, is_complete = start_directory(make, where.ways, threads, where.allow_code, device)
    if not is_complete:
        raise typer.Exit(code_of_run)
    return stored(folder), None


def show(
    study: "Study",
    dataset: "xr.Dataset",
    where: RunOptions,
    picture: dict[str, Any],
    files: dict[str, str | None],
) -> None:
    """Write a study, its picture and its other files, and print its lines, even if a file cannot be
    written."""
    table, lines = study.table(dataset), list[str]()

    def draw(drawn: "xr.Dataset") -> "Figure":
        return study.draw(drawn, **picture)

    try:
        lines += write_study(dataset, where.output, where.plot, where.force, draw)
        for key, path in files.items():
            if path is not None:
                kind = study.files[key]
                has_one = kind.write(dataset, path, where.force)
                nothing = f"  {path} was not written: this study has no {kind.kind}"
                lines += report_files([path]) if has_one else [nothing]
    finally:
        if all(isinstance(line, str) for line in table):
            print("\n".join(table))
        else:
            from rich.console import Console

            console = Console(width=max(150, Console().width), highlight=False)
            for line in table:
                console.print(line)
        print("\n".join(lines), end="\n" * bool(lines))


def end(study: "Study", dataset: "xr.Dataset") -> None:
    """Exit with the code of the outcome of a study."""
    if code := OUTCOMES[study.outcome(dataset)]:
        raise typer.Exit(code)


def _refuse_new(options: dict[str, Any]) -> None:
    """Raise OptionError for an option of new members if the members exist."""
    for key, value in options.items():
        if value is not None:
            rule = "is for a new study; this study already has its members"
            raise OptionError(rule, at=key, value=value)
