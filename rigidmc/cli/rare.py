"""rigidmc rare."""

from typing import TYPE_CHECKING, Annotated, Any

import typer

from rigidmc.cli.app import STUDY, app
from rigidmc.cli.members import Where, of_tasks, shown, studied, takes_members
from rigidmc.cli.options import count_option, takes_settings
from rigidmc.cli.reporting import reported
from rigidmc.errors import OptionError

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

Name = Annotated[
    str,
    typer.Argument(
        metavar="SCENE|RUN/",
        help="A shipped scene or a TOML file; or the run directory of a study that exists.",
    ),
]
Of = Annotated[
    str | None,
    typer.Option(
        "--of", metavar="EVENT", help='Such as "p(nutation_max >= 2)" or "p(passage_first < 60)".'
    ),
]
Target = Annotated[
    float | None,
    typer.Option(
        "--target", metavar="P", help="The smallest probability that matters; by default 1e-9."
    ),
]
Members = Annotated[
    int | None, count_option("--members", help="Of each repetition; by default 1000.")
]
Repetitions = Annotated[
    int | None, count_option("--repetitions", 2, help="How many; by default 16.")
]
SETTINGS = ("integrator", "dt", "t_end", "tolerance", "seed", "dtype", "compensated")


@app.command(rich_help_panel=STUDY)
@takes_settings(*SETTINGS)
@takes_members
def rare(
    name: Name,
    run: dict[str, Any],
    where: Where,
    of: Of = None,
    target: Target = None,
    members: Members = None,
    repetitions: Repetitions = None,
) -> None:
    """How likely something is that almost never happens, with an interval: by adaptive multilevel
    splitting if effects are random, by subset simulation if starts, bodies or effects are drawn.
    With -o RUN/ the repetitions are a run directory, which survives a kill."""
    with reported(name):
        from rigidmc.studies.rare import study

        sizes: dict[str, Any] = {
            "target": study.TARGET if target is None else target,
            "members": study.MEMBERS if members is None else members,
            "repetitions": study.REPETITIONS if repetitions is None else repetitions,
        }
        does = of_tasks(
            study.KIND,
            asked=lambda scene: study.asked(scene.with_run(**run), _asked(of), **sizes),
            now=lambda scene: study.rare(
                scene, _asked(of), threads=where.threads, progress=True, **sizes, **run
            ),
            of=lambda path: study.rare_of(path, allow_code=where.allow_code),
        )
        new = {"of": of, "target": target, "members": members, "repetitions": repetitions}
        dataset, file = studied(name, where, does, **new, **run)
        shown(dataset, file, where, study.table(dataset), _draw)


def _asked(of: str | None) -> str:
    """The event; OptionError if none is given."""
    if of is None:
        raise OptionError('a new study needs an event, as in "p(flips >= 3)"', at="of")
    return of


def _draw(dataset: "xr.Dataset") -> "Figure":
    from rigidmc.studies.rare.picture import rare_curve

    return rare_curve(dataset)
