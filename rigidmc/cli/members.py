"""A study of what exists already, of what a run directory computes, or of what it computes now."""

import os
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import typer

from rigidmc.cli.app import load_scene, open_result
from rigidmc.cli.directories import Make, Ways, begun, names_a_run, refuse_force, refuse_ways
from rigidmc.cli.options import (
    AllowCode,
    Cluster,
    Device,
    Force,
    MaxWall,
    OutputOrRun,
    Plot,
    Set,
    Shards,
    ShardSize,
    ShardTime,
    Threads,
    gathering,
)
from rigidmc.cli.reporting import keep, refuse_outputs
from rigidmc.errors import OptionError

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

    from rigidmc.results.run_directory import RunDirectory
    from rigidmc.scene.scene import Scene
    from rigidmc.studies.framework.tasks import Kind


class Study(NamedTuple):
    """What a study can do.

    now : the study of a scene, whose members it computes
    make : what makes its run directory of a scene, see `begun`, from the scene and the path
    of : the study of a result or a run directory, by its path
    """

    now: "Callable[[Scene], xr.Dataset]"
    make: "Callable[[Scene, str], Make]"
    of: "Callable[[str], xr.Dataset]"


class Where(NamedTuple):
    """How members are computed and where they go, as options.

    settings : of --set;  output : a file, or a run directory;  ways : that only these have
    """

    settings: list[str]
    allow_code: bool
    threads: int | None
    output: str | None
    plot: str | None
    force: bool
    ways: Ways


def _where(given: dict[str, Any]) -> Where:
    """The Where of the options."""
    ways = Ways(*(given.pop(name) for name in Ways._fields))
    settings, output = list(given["settings"] or ()), given["output"]
    flags = bool(given["allow_code"]), bool(given["force"])
    return Where(settings, flags[0], given["threads"], output, given["plot"], flags[1], ways)


takes_members = gathering(  # decorates a command that has a parameter `where`
    "where",
    {
        "settings": Set, "allow_code": AllowCode, "threads": Threads, "device": Device,
        "output": OutputOrRun,
        "plot": Plot, "force": Force, "max_wall": MaxWall, "shards": Shards,
        "shard_size": ShardSize, "shard_time": ShardTime, "cluster": Cluster,
    },
    _where,
)  # fmt: skip


def of_members(
    where: Where,
    designed: "Callable[[Scene], Scene]",
    now: "Callable[[Scene], xr.Dataset]",
    of: "Callable[[xr.Dataset], xr.Dataset]",
) -> Study:
    """A study of members, which tells beforehand what they will cost.

    designed : the scene of these, from a scene;  now : the study of a scene;  of : that of a
    result, also of one with few of the members
    """

    def priced(scene: "Scene", folder: str | None = None) -> None:
        from rigidmc.progress import say
        from rigidmc.runs.price import price

        say(str(price(scene, of, where.threads, folder)))

    def computed(scene: "Scene") -> "xr.Dataset":
        priced(designed(scene))
        return now(scene)

    def maker(scene: "Scene", path: str) -> Any:
        from rigidmc.runs.directory.create import create

        members = designed(scene)

        def make(
            size: float | None, only: range | None, threads: int | None, limit: float | None
        ) -> "RunDirectory":
            directory = create(members, path, size, only, threads, limit=limit)
            priced(members, path)
            return directory

        return make

    return Study(computed, maker, lambda path: of(open_result(path, where.allow_code)))


def of_tasks(
    kind: "Kind",
    asked: "Callable[[Scene], tuple[Scene, dict[str, Any]]]",
    now: "Callable[[Scene], xr.Dataset]",
    of: "Callable[[str], xr.Dataset]",
) -> Study:
    """A study whose run directory has tasks.

    asked : the scene of these and what is asked, from a scene;  now : the study of a scene
    of : that of a run directory
    """

    def maker(scene: "Scene", path: str) -> Any:
        from rigidmc.studies.framework import tasks

        def make(
            size: float | None, only: range | None, threads: int | None, limit: float | None
        ) -> "RunDirectory":
            for key, value in (("shard_size", size and size / 1e6), ("shard_time", limit)):
                if value is not None:
                    rule = "is for members; here a shard is a task of the study"
                    raise OptionError(rule, at=key, value=value)
            return tasks.create(kind, *asked(scene), path)

        return make

    return Study(now, maker, of)


def studied(name: str, where: Where, study: Study, **new: Any) -> "tuple[xr.Dataset, str | None]":
    """(a study, the file to write it to).

    name : of a scene, a result or a run directory;  new : options of members to be computed
    """
    output, ways, allow_code = where.output, where.ways, where.allow_code
    folder = output if output is not None and names_a_run(output) else None
    refuse_outputs(where.force, plot=where.plot, study=None if folder else output)
    if os.path.isdir(name) or name.lower().endswith(".nc"):
        _refuse({"set": where.settings or None, **new, **ways._asdict()})
        return study.of(name), output
    if folder is None:
        refuse_ways(ways)
        return study.now(load_scene(name, where.settings, allow_code)), output
    refuse_force(folder, where.force)
    make = study.make(load_scene(name, where.settings, allow_code), folder)
    code, whole = begun(make, ways, where.threads, allow_code)
    if not whole:
        raise typer.Exit(code)
    return study.of(folder), None


def shown(
    dataset: "xr.Dataset", file: str | None, where: Where, lines: list[str],
    draw: "Callable[[xr.Dataset], Figure]",
) -> None:  # fmt: skip
    """Write a study and its picture, and print its lines, also if a file cannot be written."""
    try:
        lines += keep(dataset, file, where.plot, where.force, draw)
    finally:
        print("\n".join(lines))


def _refuse(given: dict[str, Any]) -> None:
    """OptionError for an option of new members beside those that exist."""
    for key, value in given.items():
        if value is not None:
            rule = "is for a new study, and the members of this one exist"
            raise OptionError(rule, at=key, value=value)
