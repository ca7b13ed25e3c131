"""rigidmc show, check, warm: what a run will do, whether it can, and its kernels ahead of it."""

from typing import Annotated, Any

import typer

from rigidmc.cli.app import load_scene
from rigidmc.cli.options import AllowCode, Device, SceneArgument, Set, Threads, add_setting_options
from rigidmc.cli.reporting import report_errors
from rigidmc.errors import in_file
from rigidmc.results.labels import count_text


@add_setting_options()
def show_command(
    scene: SceneArgument,
    run: dict[str, Any],
    settings: Set = [],  # noqa: B006
    allow_code: AllowCode = False,
    threads: Threads = None,
    device: Device = None,
) -> None:
    with report_errors(scene):
        from rigidmc.engine.cuda.devices import resolve_device
        from rigidmc.engine.machine import threads_available
        from rigidmc.views.descriptions import describe_scene

        loaded = load_scene(scene, settings, allow_code, run)
        many, where = threads or threads_available(), resolve_device(device)
        print(describe_scene(loaded, many, where))


def check_command(
    scene: SceneArgument,
    settings: Set = [],  # noqa: B006
    allow_code: AllowCode = False,
) -> None:
    with report_errors(scene):
        from rigidmc.planning.check import check_scene as check_scene
        from rigidmc.runs.prepare import prepare_scene

        loaded = load_scene(scene, settings, allow_code)
        auto = loaded.run.integrator == "auto"
        if auto:
            check_scene(loaded, loaded.recording)
        ready = prepare_scene(loaded.with_run(integrator="rk8") if auto else loaded)
        for note in ready.scene_notes if auto else ready.notes:
            print(f"note: {note}")
        steps = f"{ready.plan.mean_steps:,.0f} steps with {loaded.run.integrator}"
        if auto:
            steps = f"the steps that tolerance {loaded.run.tolerance:g} requires"
        print(f"{scene}: valid, {count_text(loaded.run.members, 'member')} x {steps}")


Scenes = Annotated[
    list[str],
    typer.Argument(
        metavar="[SCENE]...",
        help="TOML files, shipped scenes or result files; by default all shipped scenes.",
    ),
]
AllIntegrators = Annotated[
    bool,
    typer.Option(
        "--all-integrators",
        help="Compile for every integrator that accepts the scene, not only for its own.",
    ),
]


def warm_command(
    scenes: Scenes = [],  # noqa: B006
    all_integrators: AllIntegrators = False,
    settings: Set = [],  # noqa: B006
    allow_code: AllowCode = False,
) -> None:
    with report_errors():
        from rigidmc.runs.simulate import precompile
        from rigidmc.scene.library import shipped_names

        loaded = [
            (name, load_scene(name, settings, allow_code)) for name in scenes or shipped_names()
        ]
        width = max(len(name) for name, _ in loaded)
        for name, scene in loaded:
            with in_file(name):
                programs = precompile(scene, all_integrators)
            made = [program for program in programs if not program.skipped]
            new = [program.integrator for program in made if program.compiled]
            seconds = sum(program.seconds for program in made)
            print(
                f"{name:{width}s} "
                + (f"{seconds:6.1f} s for {', '.join(new)}" if new else "nothing to compile"),
                flush=True,
            )
            for program in programs:
                if program.skipped:
                    print(f"{'':{width}s} skipped {program.integrator}: {program.skipped}")
