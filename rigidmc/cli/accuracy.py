"""rigidmc accuracy."""

import sys
from typing import TYPE_CHECKING, Annotated

import typer

from rigidmc.cli.app import STUDY, app, load_scene
from rigidmc.cli.options import (
    AllowCode,
    Force,
    Output,
    Plot,
    SceneArgument,
    Set,
    Threads,
    count_option,
    time_option,
    words_of,
)
from rigidmc.cli.reporting import keep, refuse_outputs, reported
from rigidmc.errors import OptionError, in_file

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

Integrators = Annotated[
    str | None, typer.Option(help="E.g. rk4,rk8,srkn11; by default all that take the scene.")
]
Tolerances = Annotated[
    str | None,
    typer.Option(help="Of the table, e.g. 1e-4,1e-8; by default every decade from 1e-3 to 1e-12."),
]
Members = Annotated[int, count_option("--members", help="Number of members of the pilot.")]
Long = Annotated[
    bool,
    typer.Option("--long", help="Drift of energy, |L|^2 and L_z over very many steps instead."),
]
Steps = Annotated[int, count_option("--steps", 1000, help="With --long: number of steps.")]
Dt = Annotated[
    float | None, time_option("--dt", help="With --long: time step; by default the scene's.")
]


@app.command(rich_help_panel=STUDY)
def accuracy(
    scene: SceneArgument,
    integrators: Integrators = None,
    tolerances: Tolerances = None,
    members: Members = 256,
    long: Long = False,
    steps: Steps = 1_000_000,
    dt: Dt = None,
    threads: Threads = None,
    settings: Set = [],  # noqa: B006
    allow_code: AllowCode = False,
    output: Output = None,
    plot: Plot = None,
    force: Force = False,
) -> None:
    """What accuracy costs in time, for a scene: every integrator over a ladder of steps against the
    truth, and the cheapest integrator and step for each accuracy."""
    with reported():
        from rigidmc.studies.accuracy import drift, study

        loaded = load_scene(scene, settings, allow_code)
        refuse_outputs(force, plot=plot, study=output)
        names = list(words_of(integrators)) if integrators else None

        def say(line: str) -> None:
            print(f"  {line}", file=sys.stderr, flush=True)

        def draw(dataset: "xr.Dataset") -> "Figure":
            from rigidmc.studies.accuracy import picture

            return (picture.long_drift if long else picture.work_precision)(dataset)

        with in_file(scene):
            if long:
                dataset = drift.long_drift(loaded, names, steps, dt, min(members, 64), progress=say)
                lines = drift.long_table(dataset)
            else:
                wanted = _numbers(tolerances) if tolerances else study.TOLERANCES
                dataset = study.accuracy(loaded, names, wanted, members, threads, progress=say)
                lines = study.table(dataset)
        try:
            lines += keep(dataset, output, plot, force, draw)
        finally:  # the table is printed also if a file cannot be written
            print("\n".join(lines))


def _numbers(text: str) -> tuple[float, ...]:
    """The numbers of a list such as 1e-4,1e-8."""
    try:
        return tuple(float(word) for word in text.split(","))
    except ValueError:
        rule = "expected numbers separated by commas, e.g. 1e-4,1e-8"
        raise OptionError(rule, at="tolerances", value=text) from None
