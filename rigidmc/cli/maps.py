"""rigidmc map: the command of the study stability_map, for scenes, shipped maps and parts of
existing maps; and `rigidmc map list`."""

import errno
import inspect
import os
from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rigidmc.cli.app import load_scene
from rigidmc.cli.options import Force, add_setting_options, gather_options
from rigidmc.cli.reporting import refuse_outputs, report_errors
from rigidmc.cli.studies import (
    OF_MEMBERS,
    RunOptions,
    command_parameters,
    compute_study,
    end,
    folder_of,
    show,
    where_of,
)
from rigidmc.errors import OptionError, unknown
from rigidmc.results.labels import count_text
from rigidmc.studies import load_study

if TYPE_CHECKING:
    import xarray as xr

    from rigidmc.studies.framework.study import Study
    from rigidmc.studies.stability_map.question import Borders

NAME = "stability_map"
Name = Annotated[
    str,
    typer.Argument(
        metavar="NAME|SCENE|FILE|MAP/",
        help="A shipped map (see `rigidmc map list`), a TOML file, a shipped scene; or an existing"
        " map: a file (.nc) or a run directory.",
    ),
]
Listed = Annotated[
    str | None,
    typer.Argument(metavar="[NAME]", help="With `rigidmc map list`: the map to describe."),
]


def command_of_map(study: "Study") -> Callable[..., None]:
    """Return the function of the command, with options as typer reads them."""

    def command(
        name: str, run: dict[str, Any], where: RunOptions, listed: str | None = None, **options: Any
    ) -> None:
        with report_errors(name):
            if name == "list":
                _list(listed)
                return
            if listed is not None:
                raise OptionError("is for `rigidmc map list NAME`", at="NAME", value=listed)
            asked = {key: value for key, value in options.items() if value not in (None, [], False)}
            dataset, file = _mapped(study, name, asked, where, run)
            show(study, dataset, where._replace(output=file), {}, {})
        end(study, dataset)

    kind = inspect.Parameter.KEYWORD_ONLY
    parameters = [
        inspect.Parameter("name", kind, annotation=Name),
        inspect.Parameter("listed", kind, annotation=Listed, default=None),
        *command_parameters(study),
        *(inspect.Parameter(name, kind) for name in ("run", "where")),
    ]
    command.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    options = {**OF_MEMBERS, "force": (Force, False)}  # the help page shows this default
    return add_setting_options(*(study.settings or ()))(
        gather_options("where", options, where_of)(command)
    )


def _mapped(
    study: "Study", name: str, asked: dict[str, Any], where: RunOptions, run: dict[str, Any]
) -> "tuple[xr.Dataset, str | None]":
    """Return (an existing or new map, the file to write it to)."""
    file = None if folder_of(where.output) else where.output

    def stored(path: str) -> "xr.Dataset":
        return study.of(path, allow_code=where.allow_code)

    if _is_drawn(name, asked, where, run):
        refuse_outputs(where.force, plot=where.plot, study=where.output)
        return stored(name), where.output
    refuse_outputs(where.force, plot=where.plot, study=file, size=_size(name, asked, where))
    return compute_study(study, where, lambda: _designed(study, name, asked, where, run), stored)


def _is_drawn(name: str, asked: dict[str, Any], where: RunOptions, run: dict[str, Any]) -> bool:
    """Whether the command draws an existing map without computing. OptionError for an option of a
    new map with an existing one, and for a part of a map that does not exist."""
    from rigidmc.studies.stability_map.stored import is_map

    exists, part, ways = is_map(name), asked.get("zoom"), where.ways._asdict()
    if part is not None and not exists:
        rule = f"is a part of an existing map, and {name} is not the file or directory of a map"
        raise OptionError(rule, at="zoom", value=part)
    # a part is a new map with the same axes and measures
    kept = ("zoom",) if part is None else ("zoom", "resolution")
    of_new = {key: value for key, value in asked.items() if key not in kept}
    options = {**of_new, "set": where.settings, **run, **({} if part else ways)}
    for key, value in options.items():
        if exists and value not in (None, []):
            rule = f"is for a new map, and {name} already exists"
            raise OptionError(rule, at=key, value=value)
    if "border" in asked and "adaptive" not in asked:
        raise OptionError("requires --adaptive", at="border", value=asked["border"])
    of_shards = {key: value for key, value in ways.items() if "shard" in key and value}
    if "adaptive" in asked and of_shards:
        key, value = next(iter(of_shards.items()))
        rule = "an adaptive map sets its shards by its pixels, and each level needs all of them"
        raise OptionError(rule, at=key, value=value)
    return exists and part is None


def _is_of_package(name: str, asked: dict[str, Any], where: RunOptions) -> bool:
    """Whether the command names a shipped map; OptionError if the description of a shipped map or
    of a map of a scene is incomplete."""
    from rigidmc.scene.library import shipped_names
    from rigidmc.studies.stability_map.cases import MAPS

    missing = [key for key in ("x", "y", "of") if key not in asked]
    plain = len(missing) == 3 and not where.settings
    if name in MAPS and plain:
        if "z" in asked:
            rule = "a shipped map has two axes; give a scene with --x, --y, --z and --of"
            raise OptionError(rule, at="z", value=asked["z"])
        return True
    if plain and name not in shipped_names():
        if name.lower().endswith((".nc", ".toml", "/")) and not os.path.exists(name):
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), name)
        raise unknown("map", MAPS, at="map", value=name, error=OptionError)
    if missing and name in MAPS:
        rule = (
            "a shipped map has its own x, y, measures and scene; give --resolution, --members,"
            " --dt and the like, or a scene with all of --x, --y and --of"
        )
        raise OptionError(rule, at="map", value=name)
    if missing:
        shipped = ", ".join(MAPS)
        rule = f"missing; the map of a scene needs --x, --y and --of; shipped maps: {shipped}"
        raise OptionError(rule, at=", ".join(missing))
    return False


def _size(name: str, asked: dict[str, Any], where: RunOptions) -> int:
    """Estimate the bytes of the file of a map; 0 for a part, which is as large as its map."""
    from rigidmc.studies.stability_map import compute
    from rigidmc.studies.stability_map.question import LAYERS
    from rigidmc.studies.stability_map.study import RESOLUTION

    if "zoom" in asked:
        return 0
    usual = compute.RESOLUTION if _is_of_package(name, asked, where) else RESOLUTION
    pixels = asked.get("resolution", usual) ** 2
    layers = asked.get("layers", LAYERS) if "z" in asked else 1
    return int(8 * pixels * layers * (4 + 3 * len(asked.get("of", ()))))


def _designed(
    study: "Study", name: str, asked: dict[str, Any], where: RunOptions, run: dict[str, Any]
) -> tuple[Any, Any]:
    """Return (the map before its first step, its options)."""
    from rigidmc.studies.stability_map.cases import MAPS
    from rigidmc.studies.stability_map.compute import RESOLUTION, prepared_case
    from rigidmc.studies.stability_map.stored import prepare_zoom
    from rigidmc.studies.stability_map.study import read_part

    if "zoom" in asked:
        part = read_part(asked["zoom"], "zoom")
        return prepare_zoom(name, *part, where.allow_code, asked.get("resolution")), None
    if _is_of_package(name, asked, where):
        adaptive = _adaptive(asked, MAPS[name]().of[0])
        sides = asked.get("resolution", RESOLUTION)
        return prepared_case(name, sides, asked.get("members"), adaptive, **run), None
    scene = load_scene(name, where.settings, where.allow_code)
    return study.designed(scene, {**asked, "adaptive": _adaptive(asked, asked["of"][0])}, run)


def _adaptive(asked: dict[str, Any], first: str) -> "bool | Borders":
    """Whether a map is adaptive, or the borders between the classes of its first measure."""
    return ((first, tuple(asked["border"])),) if "border" in asked else "adaptive" in asked


def _list(name: str | None) -> None:
    """List the shipped maps, or describe one of them."""
    from rigidmc.studies.stability_map.cases import MAPS

    if name is not None and name not in MAPS:
        raise unknown("map", MAPS, at="map", value=name, error=OptionError)
    for word in MAPS if name is None else (name,):
        case = MAPS[word]()
        print(f"{word:18s} {case.title}")
        print(f"{'':18s} {case.x[0]} and {case.y[0]}: {', '.join(case.of)}")
        if case.source:
            print(f"{'':18s} theory: {case.source}")
        if name is not None:
            across, upwards = (
                f"{key} from {low:g} to {high:g}{', log-spaced' * bool(log)}"
                for key, low, high, *log in (case.x, case.y)
            )
            settings = ", ".join(f"{key} = {value}" for key, value in case.settings.items())
            print(f"{'':18s} across {across}; upwards {upwards}")
            print(f"{'':18s} {count_text(case.members, 'member')} per pixel; {settings}")
            print(f"\n{case.scene.dumps()}", end="")


map_command = command_of_map(load_study(NAME))
