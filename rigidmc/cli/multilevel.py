"""rigidmc multilevel."""

import sys
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rigidmc.cli.common import (
    INCOMPLETE,
    OK,
    about,
    app,
    keep,
    load_scene,
    refuse_outputs,
    reported,
)
from rigidmc.cli.options import (
    AllowCode,
    Force,
    Output,
    Plot,
    SceneArgument,
    Set,
    Threads,
    count_option,
    takes_settings,
)
from rigidmc.cli.panels import STUDY

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

Until = Annotated[
    str,
    typer.Option(
        "--until",
        metavar="MEASURE",
        help='A mean and its width: "mean(energy_final) +- 0.001", "mean(omega_mean\\[1]) +- 1 %".',
    ),
]
Most = Annotated[int, count_option("--most", help="Cost at most, in steps of members.")]
SETTINGS = ("integrator", "dt", "t_end", "seed", "dtype")


@app.command(rich_help_panel=STUDY)
@takes_settings(*SETTINGS)
def multilevel(
    scene: SceneArgument,
    run: dict[str, Any],
    until: Until,
    most: Most = 10**12,
    threads: Threads = None,
    settings: Set = [],  # noqa: B006
    allow_code: AllowCode = False,
    output: Output = None,
    plot: Plot = None,
    force: Force = False,
) -> None:
    """A mean of a noisy scene to a width, the error of the step included: nearly all members make
    the steps of the scene, which may be long, and few make shorter ones with the same noise
    (multilevel Monte Carlo). For narrow intervals it costs a tenth of `run --until` and less."""
    with reported(), about(scene):
        from rigidmc.studies.multilevel.dataset import table
        from rigidmc.studies.multilevel.study import multilevel as study

        loaded = load_scene(scene, settings, allow_code)
        refuse_outputs(force, plot=plot, study=output)

        def say(line: str) -> None:
            print(f"  {line}", file=sys.stderr, flush=True)

        dataset = study(loaded, until, most, threads=threads, progress=say, **run)
        lines = table(dataset)
        try:
            lines += keep(dataset, output, plot, force, _draw)
        finally:  # the table is printed also if a file cannot be written
            print("\n".join(lines))
    raise typer.Exit(OK if dataset.attrs["reached"] else INCOMPLETE)


def _draw(dataset: "xr.Dataset") -> "Figure":
    from rigidmc.views.multilevel import multilevel_levels

    return multilevel_levels(dataset)
