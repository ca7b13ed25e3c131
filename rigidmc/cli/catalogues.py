"""rigidmc accuracy."""

import sys
from typing import Annotated

import typer

from rigidmc.cli.common import (
    AllowCode,
    Force,
    Output,
    Plot,
    SceneArgument,
    Set,
    Threads,
    app,
    count_option,
    keep,
    load_scene,
    refuse_outputs,
    reported,
    time_option,
)


@app.command()
def accuracy(
    scene: SceneArgument,
    integrators: Annotated[str | None, typer.Option(help="Which, e.g. rk4,rk8,srkn11; default all that take the scene.")] = None,
    tolerances: Annotated[str | None, typer.Option(help="For the table, e.g. 1e-4,1e-8; default every decade from 1e-3 to 1e-12.")] = None,
    members: Annotated[int, count_option("--members", help="Members of the pilot.")] = 256,
    long: Annotated[bool, typer.Option("--long", help="Drift of energy, |L|^2 and L_z over very many steps instead.")] = False,
    steps: Annotated[int, count_option("--steps", 1000, help="How many, with --long.")] = 1_000_000,
    dt: Annotated[float | None, time_option("--dt", help="Step with --long; default the scene's.")] = None,
    threads: Threads = None, settings: Set = [], allow_code: AllowCode = False,  # noqa: B006
    output: Output = None, plot: Plot = None, force: Force = False,
):  # fmt: skip
    """What accuracy costs in time, for a scene: every integrator over a ladder of steps against the truth, and the cheapest for each accuracy."""
    with reported():
        from rigidmc.errors import RigidmcError
        from rigidmc.studies import accuracy as study

        loaded = load_scene(scene, settings, allow_code)
        refuse_outputs(force, output, plot)
        names = [word.strip() for word in integrators.split(",")] if integrators else None

        def say(line):
            print(f"  {line}", file=sys.stderr, flush=True)

        try:
            if long:
                found = study.long_drift(loaded, names, steps, dt, min(members, 64), progress=say)
                lines = study.long_table(found)
            else:
                wanted = _numbers(tolerances) if tolerances else study.TOLERANCES
                found = study.accuracy(loaded, names, wanted, members, threads, progress=say)
                lines = study.table(found)
        except RigidmcError as error:
            error.file = error.file or scene
            raise

        def draw(found):
            from rigidmc.views import studies

            return (studies.long_drift if long else studies.work_precision)(found)

        try:
            lines += keep(found, output, plot, force, draw)
        finally:  # what was found is told also where it could not be written
            print("\n".join(lines))


def _numbers(text):
    from rigidmc.errors import OptionError

    try:
        return tuple(float(word) for word in text.split(","))
    except ValueError:
        raise OptionError(
            "", "--tolerances", text, "expected numbers between commas, e.g. 1e-4,1e-8"
        ) from None
