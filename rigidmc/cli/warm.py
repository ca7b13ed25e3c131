"""rigidmc warm."""

from typing import Annotated

import typer

from rigidmc.cli.common import AllowCode, Set, app, load_scene, reported


@app.command()
def warm(
    scenes: Annotated[list[str], typer.Argument(metavar="[SCENE]...", help="TOML files, names of shipped scenes or result files; default all shipped scenes.")] = [],  # noqa: B006
    all_integrators: Annotated[bool, typer.Option("--all-integrators", help="For every integrator that takes the scene, not its own alone.")] = False,
    settings: Set = [], allow_code: AllowCode = False,  # noqa: B006
):  # fmt: skip
    """Compile ahead what runs of scenes need, so that none of them waits: after an installation, or before jobs that share a cache.

    A line for each scene tells what it took; code that is there is not compiled again."""
    with reported():
        from rigidmc.errors import RigidmcError
        from rigidmc.runs import warm as precompile
        from rigidmc.scene.file import shipped

        loaded = [(name, load_scene(name, settings, allow_code)) for name in scenes or shipped()]
        for name, scene in loaded:
            try:
                found = precompile.warm(scene, all_integrators)
            except RigidmcError as error:
                error.file = error.file or name
                raise
            able = [one for one in found if not one.skipped]
            took, new = (
                sum(one.seconds for one in able),
                [one.integrator for one in able if one.compiled],
            )
            told = f"{took:6.1f} s for {', '.join(new)}" if new else "nothing to compile"
            print(f"{name:18s} {told}", flush=True)
            for one in found:
                if one.skipped:
                    print(f"{'':18s} skipped {one.integrator}: {one.skipped}")
