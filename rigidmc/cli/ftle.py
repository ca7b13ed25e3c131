"""rigidmc ftle."""

from functools import partial
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rigidmc.cli.app import STUDY, app
from rigidmc.cli.members import Where, of_members, shown, studied, takes_members
from rigidmc.cli.options import count_option, takes_settings
from rigidmc.cli.reporting import reported, show_done
from rigidmc.cli.sensitivity import SETTINGS, Name

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

Families = Annotated[
    int | None,
    count_option("--families", help="How many starts; each has a neighbour for every number."),
]
Across = Annotated[
    str | None, typer.Option("--x", metavar="KEY", help='Of the picture, such as "start.omega.1".')
]
Up = Annotated[str | None, typer.Option("--y", metavar="KEY", help="The same, for the other axis.")]
Unit = Annotated[
    float | None,
    typer.Option(
        "--unit",
        metavar="SECONDS",
        help="Time by which changes of angular velocity are multiplied to be angles.",
    ),
]


@app.command(rich_help_panel=STUDY)
@takes_settings(*SETTINGS)
@takes_members
def ftle(
    name: Name,
    run: dict[str, Any],
    where: Where,
    families: Families = None,
    unit: Unit = None,
    x: Across = None,
    y: Up = None,
) -> None:
    """How much a small change of each start has grown at the end (finite-time Lyapunov exponents):
    a field whose ridges are stable manifolds, which part one kind of motion from another. With
    -o RUN/ the members are a run directory, which survives a kill."""
    with reported(name):
        from rigidmc.studies.ftle import study

        threads, code = where.threads, where.allow_code
        count = study.FAMILIES if families is None else families
        does = of_members(
            where,
            designed=lambda scene: study.designed(scene, count, **run),
            now=lambda scene: study.ftle(scene, count, unit, threads, show_done, **run),
            of=lambda result: study.ftle_of(result, unit, code),
        )
        dataset, file = studied(name, where, does, families=families, **run)
        shown(dataset, file, where, study.table(dataset), partial(_draw, x=x, y=y))


def _draw(dataset: "xr.Dataset", x: str | None, y: str | None) -> "Figure":
    from rigidmc.studies.ftle.picture import ftle_field

    return ftle_field(dataset, x, y)
