"""rigidmc scenes: list the shipped scenes, or print one."""

import tomllib
from typing import Annotated

import typer

from rigidmc.cli.reporting import report_errors
from rigidmc.scene.library import read_source, shipped_names


def scenes_command(
    name: Annotated[str | None, typer.Argument(help="A shipped scene to print.")] = None,
) -> None:
    with report_errors():
        if name is not None:
            print(read_source(name), end="")
            return
        names = shipped_names()
        width = max(map(len, names))
        for word in names:
            # not `Scene.load`, which imports NumPy and pydantic and makes every body: 0.2 s
            print(f"{word:{width}s} {tomllib.loads(read_source(word))['summary']}")
