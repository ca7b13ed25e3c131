"""rigidmc section."""

from functools import partial
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rigidmc.cli.app import STUDY, app
from rigidmc.cli.members import Where, of_members, shown, studied, takes_members
from rigidmc.cli.options import takes_settings
from rigidmc.cli.reporting import reported, show_done

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

Name = Annotated[
    str,
    typer.Argument(
        metavar="SCENE|FILE|RUN/",
        help="A shipped scene or a TOML file; or a result that has attitude and momentum.",
    ),
]
At = Annotated[
    str,
    typer.Option(
        "--at",
        metavar="WHERE",
        help='Where the points are: "omega\\[1] = 0", "every orbit", "every 12.5" (seconds).',
    ),
]
Way = Annotated[
    str,
    typer.Option("--way", metavar="WAY", help="Whether the quantity rises there, falls, or both."),
]
Across = Annotated[
    str | None,
    typer.Option("--x", metavar="NAME", help='Of the picture, such as "momentum\\[2]".'),
]
Up = Annotated[
    str | None, typer.Option("--y", metavar="NAME", help="The same, for the other axis.")
]


@app.command(rich_help_panel=STUDY)
@takes_settings(
    words={"every": "time between two looks for a crossing [s]; by default one step of the run"}
)
@takes_members
def section(
    name: Name,
    run: dict[str, Any],
    where: Where,
    at: At,
    way: Way = "rises",
    x: Across = None,
    y: Up = None,
) -> None:
    """The structure of phase space: a Poincare section, the states of the members wherever a
    quantity passes a value, or once in a period. With -o RUN/ the members are a run directory,
    which survives a kill: `rigidmc section RUN/ --at WHERE` tells of it."""
    with reported(name):
        from rigidmc.studies.section import study

        threads, code = where.threads, where.allow_code
        does = of_members(
            where,
            designed=lambda scene: study.designed(scene, at, **run),
            now=lambda scene: study.section(scene, at, way, threads, show_done, **run),
            of=lambda result: study.section_of(result, at, way, threads, code),
        )
        dataset, file = studied(name, where, does, **run)
        shown(dataset, file, where, study.table(dataset), partial(_draw, x=x, y=y))


def _draw(dataset: "xr.Dataset", x: str | None, y: str | None) -> "Figure":
    from rigidmc.studies.section.picture import section_points

    return section_points(dataset, x, y)
