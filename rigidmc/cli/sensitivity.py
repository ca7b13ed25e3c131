"""rigidmc sensitivity."""

from typing import TYPE_CHECKING, Annotated, Any

import typer

from rigidmc.cli.app import STUDY, app
from rigidmc.cli.members import Where, of_members, shown, studied, takes_members
from rigidmc.cli.options import count_option, takes_settings
from rigidmc.cli.reporting import reported, show_done

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

Name = Annotated[
    str,
    typer.Argument(
        metavar="SCENE|FILE|RUN/",
        help="A shipped scene or a TOML file; or the result of a study that exists.",
    ),
]
Measures = Annotated[
    list[str],
    typer.Option(
        "--of",
        metavar="MEASURE",
        help='What the members are asked: "mean(nutation_max)", "p(flips >= 1)"; may be repeated.',
    ),
]
Families = Annotated[
    int | None,
    count_option(
        "--families",
        help="How many; a family has two members more than the scene has uncertain numbers.",
    ),
]
SETTINGS = ("integrator", "dt", "turn", "t_end", "tolerance", "seed", "dtype", "compensated")


@app.command(rich_help_panel=STUDY)
@takes_settings(*SETTINGS)
@takes_members
def sensitivity(
    name: Name, run: dict[str, Any], where: Where, of: Measures, families: Families = None
) -> None:
    """Which uncertain number of a scene matters: the share of a measure's variance that each causes
    alone, and in which it takes part (Sobol indices), with intervals. With -o RUN/ the members are
    a run directory, which survives a kill: `rigidmc sensitivity RUN/ --of MEASURE` tells of it."""
    with reported(name):
        from rigidmc.studies.sensitivity import study

        threads, code = where.threads, where.allow_code
        count = study.FAMILIES if families is None else families
        does = of_members(
            where,
            designed=lambda scene: study.designed(scene, of, count, **run)[0],
            now=lambda scene: study.sensitivity(
                scene, of, count, threads, progress=show_done, **run
            ),
            of=lambda result: study.sensitivity_of(result, of, allow_code=code),
        )
        dataset, file = studied(name, where, does, families=families, **run)
        shown(dataset, file, where, study.table(dataset), _draw)


def _draw(dataset: "xr.Dataset") -> "Figure":
    from rigidmc.studies.sensitivity.picture import sensitivity_bars

    return sensitivity_bars(dataset)
