"""rigidmc basins."""

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

Measures = Annotated[
    list[str],
    typer.Option(
        "--of",
        metavar="MEASURE",
        help='What tells the basins apart: "p(omega_last\\[3] >= 0)"; may be repeated.',
    ),
]
Families = Annotated[
    int | None, count_option("--families", help="How many starts; each has 12 neighbours.")
]


@app.command(rich_help_panel=STUDY)
@takes_settings(*SETTINGS)
@takes_members
def basins(
    name: Name, run: dict[str, Any], where: Where, of: Measures, families: Families = None
) -> None:
    """How well a start has to be known to know where it ends: the share of starts that end
    otherwise if they change a little, by how little, and the dimension of the boundary between
    basins of attraction. With -o RUN/ the members are a run directory, which survives a kill."""
    with reported(name):
        from rigidmc.studies.basins import study

        threads, code = where.threads, where.allow_code
        count = study.FAMILIES if families is None else families
        does = of_members(
            where,
            designed=lambda scene: study.designed(scene, of, count, **run)[0],
            now=lambda scene: study.basins(scene, of, count, threads, progress=show_done, **run),
            of=lambda result: study.basins_of(result, of, allow_code=code),
        )
        dataset, file = studied(name, where, does, families=families, **run)
        shown(dataset, file, where, study.table(dataset), _draw)


def _draw(dataset: "xr.Dataset") -> "Figure":
    from rigidmc.studies.basins.picture import basins_and_shares

    return basins_and_shares(dataset)
