"""rigidmc sensitivity."""

import os
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rigidmc.cli.common import (
    INCOMPLETE,
    about,
    app,
    keep,
    load_scene,
    opened,
    refuse_outputs,
    reported,
    show_done,
)
from rigidmc.cli.directories import (
    Ways,
    begun,
    names_a_run,
    refuse_force,
    refuse_ways,
    takes_ways,
)
from rigidmc.cli.options import (
    AllowCode,
    Force,
    OutputOrRun,
    Plot,
    Set,
    Threads,
    count_option,
    takes_settings,
)
from rigidmc.cli.panels import STUDY
from rigidmc.errors import OptionError

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
@takes_ways
def sensitivity(
    name: Name,
    run: dict[str, Any],
    ways: Ways,
    of: Measures,
    families: Families = None,
    settings: Set = [],  # noqa: B006
    allow_code: AllowCode = False,
    threads: Threads = None,
    output: OutputOrRun = None,
    plot: Plot = None,
    force: Force = False,
) -> None:
    """Which uncertain number of a scene matters: the share of a measure's variance that each causes
    alone, and in which it takes part (Sobol indices), with intervals. With -o RUN/ the members are
    a run directory, which survives a kill: `rigidmc sensitivity RUN/ --of MEASURE` tells of it."""
    with reported(), about(name):
        from rigidmc.studies import sensitivity as study

        folder = output is not None and names_a_run(output)
        refuse_outputs(force, plot=plot, study=None if folder else output)
        count = study.FAMILIES if families is None else families
        if os.path.isdir(name) or name.lower().endswith(".nc"):
            given = {"families": families, "set": settings or None, **run, **ways._asdict()}
            _refuse_all(given)
            dataset = study.sensitivity_of(opened(name, allow_code), of, allow_code=allow_code)
        elif output is not None and folder:
            refuse_force(output, force)
            scene, _ = study.designed(load_scene(name, settings, allow_code), of, count, **run)
            if begun(_maker(scene, output), ways, threads, allow_code) == INCOMPLETE:
                raise typer.Exit(INCOMPLETE)
            dataset = study.sensitivity_of(opened(output, allow_code), of, allow_code=allow_code)
            output = None
        else:
            refuse_ways(ways)
            scene = load_scene(name, settings, allow_code)
            dataset = study.sensitivity(scene, of, count, threads, progress=show_done, **run)
        lines = study.table(dataset)
        try:
            lines += keep(dataset, output, plot, force, _draw)
        finally:  # the table is printed also if a file cannot be written
            print("\n".join(lines))


def _refuse_all(given: dict[str, Any]) -> None:
    """OptionError for an option of a new study beside the result of one."""
    for key, value in given.items():
        if value is not None:
            rule = "is for a new study, and the members of this one exist"
            raise OptionError("", f"--{key.replace('_', '-')}", value, rule)


def _maker(scene: Any, path: str) -> Any:
    """The function that makes the run directory of a study."""
    from rigidmc.runs.create import create

    return partial(create, scene, path)


def _draw(dataset: "xr.Dataset") -> "Figure":
    from rigidmc.views.sensitivity import sensitivity_bars

    return sensitivity_bars(dataset)
