"""rigidmc stress."""

from typing import Annotated

import typer

from rigidmc.cli.common import (
    FLAGGED,
    OK,
    AllowCode,
    Force,
    Output,
    Plot,
    Set,
    Threads,
    app,
    keep,
    load_scene,
    refuse_outputs,
    reported,
    told,
)


@app.command()
def stress(
    scene: Annotated[str | None, typer.Argument(metavar="[SCENE]", help="A scene to put through the generic checks; without it the catalogue of hard cases.")] = None,
    group: Annotated[str | None, typer.Option(help="Groups of the catalogue, e.g. H2,H7; default all.")] = None,
    integrator: Annotated[str | None, typer.Option(help="Which, e.g. rk4,exact; default all, of a scene its own.")] = None,
    quick: Annotated[bool, typer.Option("--quick", help="A few cases and integrators, long ones shortened.")] = False,
    bounds: Annotated[str | None, typer.Option(metavar="FILE", help="Bounds in place of those that ship, as --write-bounds writes them.")] = None,
    write_bounds: Annotated[str | None, typer.Option("--write-bounds", metavar="FILE", help="Write four times what was measured here as bounds (.csv).")] = None,
    threads: Threads = None, settings: Set = [], allow_code: AllowCode = False,  # noqa: B006
    output: Output = None, plot: Plot = None, force: Force = False,
):  # fmt: skip
    """Hard cases, each against its bound, on this machine; or how far your own scene can be trusted. Exit code 4 where something fails."""
    with reported():
        from rigidmc.errors import RigidmcError

        refuse_outputs(force, output, plot, write_bounds)
        if scene is not None:
            from rigidmc.studies import trust

            loaded = load_scene(scene, settings, allow_code, integrator=integrator)
            try:
                found = trust.trust(loaded, quick=quick, progress=True)
            except RigidmcError as error:
                error.file = error.file or scene
                raise
            bad = trust.failed(found)
        else:
            from rigidmc.cli.stress_table import show
            from rigidmc.studies.stress import run

            given = run.load_bounds(bounds) if bounds else None
            found = run.stress(
                _words(group), _words(integrator), quick, given, threads, progress=True
            )
            bad = run.failed(found)

        def draw(found):
            from rigidmc.views import studies

            return (studies.trust if scene is not None else studies.hard_cases)(found)

        lines = list[str]()
        try:
            lines += keep(found, output, plot, force, draw)
            if scene is None and write_bounds is not None:
                run.save_bounds(found, write_bounds, force)
                lines += told([write_bounds])
        finally:  # what was found is told also where it could not be written
            if scene is not None:
                print("\n".join(trust.table(found)))
            else:
                show(found)
            print("\n".join(lines), end="\n" * bool(lines))
    raise typer.Exit(FLAGGED if bad else OK)


def _words(text):
    return [word.strip() for word in text.split(",")] if text else None
