"""rigidmc frequencies."""

from functools import partial
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
        help="A shipped scene or a TOML file; or a result that has what is asked.",
    ),
]
Of = Annotated[
    str,
    typer.Option("--of", metavar="NAME", help='What oscillates, such as "omega\\[1]".'),
]
Terms = Annotated[int | None, count_option("--terms", help="How many oscillations; by default 3.")]
Across = Annotated[
    str | None,
    typer.Option("--x", metavar="NAME", help='Of the picture, such as "start_omega\\[3]".'),
]
Up = Annotated[
    str | None, typer.Option("--y", metavar="NAME", help="The same; by default the frequency.")
]


@app.command(rich_help_panel=STUDY)
@takes_settings()
@takes_members
def frequencies(
    name: Name,
    run: dict[str, Any],
    where: Where,
    of: Of,
    terms: Terms = None,
    x: Across = None,
    y: Up = None,
) -> None:
    """The frequencies of which the motion of each member is made, and how much the first of them
    changes from one half of the time to the other, which tells regular motion from chaos. With
    -o RUN/ the members are a run directory, which survives a kill."""
    with reported(name):
        from rigidmc.studies.frequencies import study

        count, code = study.TERMS if terms is None else terms, where.allow_code
        does = of_members(
            where,
            designed=lambda scene: study.designed(scene, of, count, **run),
            now=lambda scene: study.frequencies(scene, of, count, where.threads, show_done, **run),
            of=lambda result: study.frequencies_of(result, of, count, code),
        )
        dataset, file = studied(name, where, does, **run)
        shown(dataset, file, where, study.table(dataset), partial(_draw, x=x, y=y))


def _draw(dataset: "xr.Dataset", x: str | None, y: str | None) -> "Figure":
    from rigidmc.studies.frequencies.picture import frequency_map

    return frequency_map(dataset, x, y)
