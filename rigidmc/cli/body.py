"""rigidmc body, exact."""

import json
from typing import Annotated

import typer

from rigidmc.cli.common import (
    AllowCode,
    Dt,
    Force,
    Integrator,
    SceneArgument,
    Set,
    app,
    count_option,
    load_scene,
    refuse_outputs,
    reported,
    save_picture,
    time_option,
    told,
)


@app.command("body")
def body_command(
    source: Annotated[
        str,
        typer.Argument(
            metavar="FILE|NAME", help="A scene file, a shipped scene, or a mesh (.stl, .obj)."
        ),
    ],
    density: Annotated[float | None, typer.Option(help="Of a mesh \\[kg/m3]; default 1.")] = None,
    mass: Annotated[
        float | None, typer.Option(help="Of a mesh \\[kg], instead of the density.")
    ] = None,
    scale: Annotated[
        float, typer.Option(help="Metres per unit of a mesh file: 0.001 for millimetres.")
    ] = 1.0,
    machine: Annotated[bool, typer.Option("--json", help="As JSON.")] = False,
):
    """Say what a body is: mass, centre, tensor, principal axes, which rotations are stable and how fast the unstable one grows."""
    with reported():
        from rigidmc.errors import RigidmcError
        from rigidmc.views.body import body_of, describe, facts

        try:
            body, title = body_of(source, density, mass, scale)
            print(
                json.dumps(facts(body), indent=1) if machine else "\n".join(describe(body, title))
            )
        except RigidmcError as error:
            error.file = error.file or source
            raise


@app.command("exact")
def exact_command(
    scene: SceneArgument,
    at: Annotated[float | None, time_option("--at", positive=False, help="Time; default the scene's t_end. Negative: the closed form alone.")] = None,
    members: Annotated[int, count_option("--members", help="How many members, the first ones.")] = 1000,
    integrator: Integrator = None, dt: Dt = None, settings: Set = [], allow_code: AllowCode = False,  # noqa: B006
    plot: Annotated[str | None, typer.Option(metavar="FILE", help="Picture of the first member (.png, .pdf, .svg).")] = None,
    force: Force = False,
):  # fmt: skip
    """The closed form of a scene at a time, beside its integration, with the difference."""
    with reported():
        from rigidmc.errors import RigidmcError
        from rigidmc.planning.closed_form import closed_form
        from rigidmc.studies.closed_form import compare

        loaded = load_scene(scene, settings, allow_code, integrator=integrator, dt=dt)
        at = loaded.run.t_end if at is None else at
        refuse_outputs(force, plot=plot)
        try:
            lines = compare(loaded, at, members)
            if plot is not None:
                from rigidmc.views import closed_forms

                case = closed_form(loaded, 1)
                title = f"{loaded.title}: {case.name}, closed form of member {loaded.run.first}"
                save_picture(
                    closed_forms.case_summary(case, title, abs(at) or loaded.run.t_end), plot, force
                )
            print("\n".join([*lines, *told([plot])]))
        except RigidmcError as error:
            error.file = error.file or scene
            raise
