"""rigidmc body, exact: describe a body, and compare its motion with the closed form."""

import json
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rigidmc.cli.app import load_scene
from rigidmc.cli.options import (
    AllowCode,
    Force,
    SceneArgument,
    Set,
    add_setting_options,
    count_option,
    time_option,
)
from rigidmc.cli.reporting import refuse_outputs, report_errors, report_files, save_picture
from rigidmc.errors import OptionError, SceneError

if TYPE_CHECKING:
    from rigidmc.scene.body import Body

Source = Annotated[
    str,
    typer.Argument(
        metavar="FILE|NAME",
        help="A scene file, a shipped scene, a robot description (.urdf, .xml), mass properties as"
        " text (.txt), or a mesh (.stl, .obj).",
    ),
]
Link = Annotated[
    str | None, typer.Option(metavar="NAME", help="Link of a URDF file, or body of an MJCF file.")
]
Products = Annotated[
    str | None,
    typer.Option(
        metavar="SIGN",
        help="Products of inertia of a text: positive, +int x y dm, or negative; by default, the"
        " text decides.",
    ),
]
About = Annotated[
    str | None,
    typer.Option(
        metavar="POINT", help="Point of a text's tensor that does not say it: centre or pivot."
    ),
]
Pivot = Annotated[
    str | None, typer.Option(metavar="POINT", help=r'Another fixed point: centre, or "X,Y,Z" \[m].')
]
Solid = Annotated[
    str,
    typer.Option(
        metavar="KIND",
        help="Mesh as a solid, its convex hull, or a thin shell: solid, hull or shell.",
    ),
]
Density = Annotated[float | None, typer.Option(help="Density of a mesh \\[kg/m3]; by default 1.")]
Mass = Annotated[float | None, typer.Option(help="Mass of a mesh \\[kg], instead of --density.")]
Scale = Annotated[
    float | None,
    typer.Option(
        help="Metres per unit of a mesh file, e.g. 0.001 for millimetres; by default, guessed from"
        " its size."
    ),
]


def body_command(
    source: Source,
    link: Link = None,
    pivot: Pivot = None,
    products: Products = None,
    about: About = None,
    density: Density = None,
    mass: Mass = None,
    scale: Scale = None,
    solid: Solid = "solid",
    machine: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    with report_errors(source):
        from rigidmc.views.descriptions import body_facts, describe_body

        options = {
            "link": link,
            "pivot": _point(pivot),
            "products": products,
            "about": about,
            "density": density,
            "mass": mass,
            "scale": scale,
            "solid": None if solid == "solid" else solid,
        }
        chosen = {key: value for key, value in options.items() if value is not None}
        body, title = load_body(source, chosen)
        print(
            json.dumps(body_facts(body), indent=1)
            if machine
            else "\n".join(describe_body(body, title))
        )


def _point(text: str | None) -> Any:
    """Return the point of --pivot: "centre", three numbers, or None; OptionError."""
    if text is None or text == "centre":
        return text
    try:
        numbers = tuple(float(word) for word in text.split(","))
    except ValueError:
        numbers = ()
    if len(numbers) != 3:
        rule = "expected centre, or three numbers, such as 0,0,0.1"
        raise OptionError(rule, at="pivot", value=text, nearest="centre")
    return numbers


def load_body(source: str, options: dict[str, Any] | None = None) -> "tuple[Body, str]":
    """Return (Body, title) of a file with a body, a scene file or a shipped scene.

    options : of `Body.read`. Without density and mass, a mesh has density 1, and a shell mass 1.
    """
    from rigidmc.scene.body import Body
    from rigidmc.scene.body_files import SUFFIXES, is_mesh
    from rigidmc.scene.quantities import is_shared
    from rigidmc.scene.scene import Scene

    options = dict(options or {})
    if source.lower().endswith(SUFFIXES):
        if is_mesh(source) and not {"density", "mass"} & options.keys():
            options["mass" if options.get("solid") == "shell" else "density"] = 1.0
        return Body.read(source, **options), source
    if options:
        rule = "apply to files with a body only; a scene sets its mass and pivot in [body]"
        raise OptionError(rule, at=", ".join(options))
    scene = Scene.load(source)
    if not is_shared(*scene.body.quantities()):
        rule = "the body differs from member to member; to describe one, replace the distributions"
        raise SceneError(
            f"{rule} by plain numbers, e.g. in a copy of the scene",
            at=f"body.{scene.body.inertia_key}",
        )
    return scene.body, scene.title


At = Annotated[
    float | None,
    time_option(
        "--at",
        positive=False,
        help="Time to compare; by default the scene's t_end. At a negative time, show the closed"
        " form only.",
    ),
]
Members = Annotated[int, count_option("--members", help="Compare the first N members.")]
Picture = Annotated[
    str | None, typer.Option(metavar="FILE", help="Picture of the first member (.png, .pdf, .svg).")
]


@add_setting_options("integrator", "dt")
def exact_command(
    scene: SceneArgument,
    run: dict[str, Any],
    at: At = None,
    members: Members = 1000,
    settings: Set = [],  # noqa: B006
    allow_code: AllowCode = False,
    plot: Picture = None,
    force: Force = False,
) -> None:
    with report_errors(scene):
        from rigidmc.planning.closed_form import closed_form
        from rigidmc.studies.exact import compare

        loaded = load_scene(scene, settings, allow_code, run)
        at = loaded.run.t_end if at is None else at
        refuse_outputs(force, plot=plot)
        lines = compare(loaded, at, members)
        if plot is not None:
            from rigidmc.planning.initial import make_sampler
            from rigidmc.views import closed_forms

            case = closed_form(
                loaded.model, make_sampler(loaded.model, loaded.run), loaded.run.first, 1
            )
            title = f"{loaded.title}: {case.name}, closed form of member {loaded.run.first}"
            picture = closed_forms.case_summary(case, title, abs(at) or loaded.run.t_end)
            save_picture(picture, plot, force)
        print("\n".join([*lines, *report_files([plot])]))
