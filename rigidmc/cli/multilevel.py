"""rigidmc multilevel."""

from typing import TYPE_CHECKING, Annotated, Any

import typer

from rigidmc.cli.app import INCOMPLETE, STUDY, app
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
Until = Annotated[
    str | None,
    typer.Option(
        "--until",
        metavar="MEASURE",
        help='A mean and its width: "mean(energy_final) +- 0.001", "mean(omega_mean\\[1]) +- 1 %".',
    ),
]
Most = Annotated[
    int | None, count_option("--most", help="Cost at most, in steps of members; by default 1e12.")
]
SETTINGS = ("integrator", "dt", "t_end", "seed", "dtype")


@app.command(rich_help_panel=STUDY)
@takes_settings(*SETTINGS)
@takes_members
def multilevel(
    name: Name, run: dict[str, Any], where: Where, until: Until = None, most: Most = None
) -> None:
    """A mean of a noisy scene to a width, the error of the step included: nearly all members make
    the steps of the scene, which may be long, and few make shorter ones with the same noise
    (multilevel Monte Carlo). It saves the more, the narrower the interval: of a top, plain members
    take 2 times as long at +- 0.001 rad/s, and 10 times at +- 0.0001 (python -m bench rare). With
    -o RUN/ batches of members are a run directory, which survives a kill.

    Exit code 5 if the width is not reached: because of --most, or in a run that has not ended."""
    with reported(name):
        from rigidmc.studies.multilevel import study
        from rigidmc.studies.multilevel.study import table

        limit = study.MOST if most is None else most
        does = of_tasks(
            study.KIND,
            asked=lambda scene: study.asked(scene.with_run(**run), _asked(until), limit),
            now=lambda scene: study.multilevel(
                scene, _asked(until), limit, threads=where.threads, progress=True, **run
            ),
            of=lambda path: study.multilevel_of(path, where.allow_code),
        )
        dataset, file = studied(name, where, does, until=until, most=most, **run)
        shown(dataset, file, where, table(dataset), _draw)
    if not dataset.attrs["reached"]:
        raise typer.Exit(INCOMPLETE)


def _asked(until: str | None) -> str:
    """The mean and its width; OptionError if none is given."""
    if until is None:
        rule = 'a new study needs a mean and its width, as in "mean(energy_final) +- 1 %"'
        raise OptionError(rule, at="until")
    return until


def _draw(dataset: "xr.Dataset") -> "Figure":
    from rigidmc.studies.multilevel.picture import multilevel_levels

    return multilevel_levels(dataset)
