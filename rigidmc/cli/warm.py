"""rigidmc warm."""

from typing import Annotated

import typer

from rigidmc.cli.common import about, app, load_scene, reported
from rigidmc.cli.options import AllowCode, Set
from rigidmc.cli.panels import REFERENCE

Scenes = Annotated[
    list[str],
    typer.Argument(
        metavar="[SCENE]...",
        help="TOML files, names of shipped scenes or result files; by default all shipped scenes.",
    ),
]
AllIntegrators = Annotated[
    bool,
    typer.Option(
        "--all-integrators", help="For every integrator that takes the scene, not only its own."
    ),
]


@app.command(rich_help_panel=REFERENCE)
def warm(
    scenes: Scenes = [],  # noqa: B006
    all_integrators: AllIntegrators = False,
    settings: Set = [],  # noqa: B006
    allow_code: AllowCode = False,
) -> None:
    """Compile ahead what runs of scenes need, so that no run waits: after an installation, or
    before jobs that share a cache.

    Prints the compile time of each scene; compiled code is not compiled again."""
    with reported():
        from rigidmc.runs import warm as precompile
        from rigidmc.scene.shipped import shipped

        loaded = [(name, load_scene(name, settings, allow_code)) for name in scenes or shipped()]
        width = max(len(name) for name, _ in loaded)
        for name, scene in loaded:
            with about(name):
                programs = precompile.warm(scene, all_integrators)
            new = [one.integrator for one in programs if one.compiled and not one.skipped]
            seconds = sum(one.seconds for one in programs if not one.skipped)
            print(
                f"{name:{width}s} "
                + (f"{seconds:6.1f} s for {', '.join(new)}" if new else "nothing to compile"),
                flush=True,
            )
            for one in programs:
                if one.skipped:
                    print(f"{'':{width}s} skipped {one.integrator}: {one.skipped}")
