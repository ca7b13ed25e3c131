"""rigidmc show, check, scenes: look at a scene without running it."""

from typing import Annotated, Any

import typer

from rigidmc.cli.common import about, app, load_scene, reported
from rigidmc.cli.options import AllowCode, Device, SceneArgument, Set, Threads, takes_settings
from rigidmc.cli.panels import START
from rigidmc.scene import library


@app.command(rich_help_panel=START)
@takes_settings()
def show(
    scene: SceneArgument,
    run: dict[str, Any],
    settings: Set = [],  # noqa: B006
    allow_code: AllowCode = False,
    threads: Threads = None,
    device: Device = None,
) -> None:
    """Say what a scene is, which effects are compiled, and what a run would take; run nothing."""
    with reported(), about(scene):
        from rigidmc.engine.machine import threads_available
        from rigidmc.views.scene import describe

        loaded = load_scene(scene, settings, allow_code, run)
        print(describe(loaded, threads or threads_available()))


@app.command(rich_help_panel=START)
def check(
    scene: SceneArgument,
    settings: Set = [],  # noqa: B006
    allow_code: AllowCode = False,
) -> None:
    """Check a scene file: exit code 0 if it can be run, else 3 and a message."""
    with reported(), about(scene):
        from rigidmc.planning.notes import notes
        from rigidmc.planning.plan import prepare

        loaded = load_scene(scene, settings, allow_code)
        loaded.check()
        auto = loaded.run.integrator == "auto"
        plan = prepare(loaded.with_run(integrator="rk8") if auto else loaded)
        for note in notes(loaded, plan):
            print(f"note: {note}")
        steps = f"{plan.mean_steps:,.0f} steps with {loaded.run.integrator}"
        if auto:
            steps = f"as many steps as the tolerance {loaded.run.tolerance:g} needs"
        print(f"{scene}: valid, {loaded.run.members:,} members x {steps}")


@app.command(
    rich_help_panel=START,
    help=(library.__doc__ or "").replace("[", r"\[").replace("\n\n", "\n\n\b\n"),
)
def scenes(
    name: Annotated[str | None, typer.Argument(help="A shipped scene to print.")] = None,
) -> None:
    with reported():
        from rigidmc.scene.scene import Scene
        from rigidmc.scene.shipped import read_source, shipped

        if name is not None:
            print(read_source(name), end="")
            return
        names = shipped()
        width = max(map(len, names))
        for word in names:
            print(f"{word:{width}s} {Scene.load(word).summary}")
