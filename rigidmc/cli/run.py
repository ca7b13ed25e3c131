"""rigidmc run, show, check, scenes, plot, doctor."""

import json
import sys
import time
from typing import Annotated

import typer

from rigidmc.cli.common import (
    FLAGGED,
    INCOMPLETE,
    INVALID,
    OK,
    AllowCode,
    Compensated,
    Dt,
    Dtype,
    Every,
    Force,
    Integrator,
    Keep,
    Members,
    Most,
    Plot,
    ResultArgument,
    Save,
    SceneArgument,
    Seed,
    Set,
    TEnd,
    Threads,
    Tolerance,
    Turn,
    Until,
    app,
    fail,
    load_scene,
    opened,
    plots_module,
    refuse_outputs,
    reported,
    save_picture,
    told,
)  # fmt: skip
from rigidmc.cli.directories import (
    Blocks,
    Cluster,
    MaxWall,
    OutputOrRun,
    ShardSize,
    go_on,
    is_run,
    shards_of,
)
from rigidmc.scene import library


@app.command("run")
def run_scene(
    scene: SceneArgument,
    members: Members = None, seed: Seed = None, integrator: Integrator = None, dt: Dt = None, turn: Turn = None,
    t_end: TEnd = None,
    every: Every = None, save: Save = None, keep: Keep = None, threads: Threads = None, tolerance: Tolerance = None,
    dtype: Dtype = None, compensated: Compensated = None, settings: Set = [], allow_code: AllowCode = False,  # noqa: B006
    until: Until = None, most: Most = 10_000_000, output: OutputOrRun = None, plot: Plot = None, force: Force = False,
    max_wall: MaxWall = None, shards: Blocks = None, shard_size: ShardSize = None, cluster: Cluster = None,
):  # fmt: skip
    """Run a scene: integrate its ensemble, write the result and a picture, and say what it cost."""
    began = time.perf_counter()
    with reported():
        from rigidmc.errors import OptionError, RigidmcError
        from rigidmc.runs.simulate import simulate

        loaded = load_scene(
            scene,
            settings,
            allow_code,
            members=members,
            seed=seed,
            integrator=integrator,
            dt=dt,
            turn=turn,
            t_end=t_end,
            every=every,
            save=save,
            keep=keep,
            tolerance=tolerance,
            dtype=dtype,
            compensated=compensated,
        )
        if is_run(output):
            if plot is not None or until is not None:
                raise OptionError(
                    "",
                    "--output",
                    output,
                    "a run directory goes without --plot and --until: consolidate it first",
                )
            if force:
                raise OptionError(
                    "", "--force", None, f"replaces files: take the folder {output} away yourself"
                )
            from rigidmc.runs.cluster import checked
            from rigidmc.runs.resume import SHARD, create

            kind, many = ("", "") if cluster is None else checked(cluster)
            if shard_size is not None and not shard_size < 1e6:
                raise OptionError("", "--shard-size", shard_size, "expected megabytes, up to 1e6")
            size = SHARD if shard_size is None else 1e6 * shard_size
            made = create(
                loaded, output, size, shards_of(shards), int(many) if kind == "local" else threads
            )
            raise typer.Exit(
                go_on(
                    made.path,
                    threads,
                    max_wall=max_wall,
                    shards=shards,
                    allow_code=allow_code,
                    cluster=cluster,
                )
            )
        for name, given in (
            ("--max-wall", max_wall),
            ("--shards", shards),
            ("--shard-size", shard_size),
            ("--cluster", cluster),
        ):
            if given is not None:
                raise OptionError("", name, given, "is of a run directory: -o RUN/")
        refuse_outputs(force, output, plot)
        try:
            if until is None:
                dataset, found = (
                    simulate(loaded, threads=threads, progress=True, output=output, force=force),
                    None,
                )
            else:
                from rigidmc.studies.until import goal_reached, simulate_until

                if members is not None:
                    raise OptionError(
                        "",
                        "--members",
                        members,
                        "with --until there are as many as it takes: give --most",
                    )
                dataset, found = simulate_until(
                    loaded,
                    until,
                    most,
                    threads=threads,
                    progress=_grown,
                    output=output,
                    force=force,
                )
        except RigidmcError as error:
            error.file = error.file or scene
            raise
        cost = dataset.encoding["rigidmc"]
        if plot is not None:
            save_picture(plots_module().summary(dataset), plot, force)
        _close(dataset, cost, time.perf_counter() - began, [p for p in (output, plot) if p])
        if found is not None:
            print(
                f"  {until}: {found.value:.6g}, 95 % between {found.low:.6g} and {found.high:.6g}"
            )
        flagged = dataset.sizes["member"] - cost["flagged"]["ok"]
        dataset.close()
    raise typer.Exit(
        INCOMPLETE
        if found is not None and not goal_reached(until, found)
        else FLAGGED
        if flagged
        else OK
    )


def _grown(members, found):
    """A line for each look."""
    print(
        f"  {members:,} members: {found.value:.6g} +- {found.half:.2g}", file=sys.stderr, flush=True
    )


def _close(dataset, cost, wall, files):
    """The closing summary."""
    import numpy as np

    count, steps, seconds = dataset.sizes["member"], cost["steps"], cost["run_seconds"]
    own = "turn" in dataset.attrs
    length = (
        f"{steps:,.1f} steps of their own on average"
        if own
        else f"{steps:,} steps of {dataset.attrs['dt']:.6g} s"
    )
    print(
        f"{dataset.attrs['title']}: {count:,} members x {length} with {dataset.attrs['integrator']}"
    )
    print(
        f"  {seconds:.2f} s, {count * steps / seconds / 1e6:.0f} M member-steps/s, {count / seconds:,.0f} members/s; "
        f"compiled in {cost['compile_seconds']:.2f} s; {wall:.2f} s in all"
    )
    for name, word in (
        ("energy", "energy less work" if "work" in dataset else "energy"),
        ("l2", "|L|^2"),
    ):
        drift = dataset[f"{name}_drift_max"]
        values = drift.values[np.isfinite(drift.values)]
        if values.size:
            kept = (
                ""
                if drift.attrs["conserved"] == "yes"
                else f"   (not conserved: {drift.attrs['conserved'][4:]})"
            )
            print(
                f"  drift of {word:6s}  median {np.median(values):.1e}   worst {values.max():.1e}{kept}"
            )
    flags = ", ".join(f"{v:,} {k}" for k, v in cost["flagged"].items() if v and k != "ok")
    where = "; their `status`, `status_step` and `status_time` tell which and when" if flags else ""
    print(f"  flagged members: {flags or 'none'}{where}")
    if not files:
        print("  nothing was written: -o FILE keeps the result, --plot FILE draws it")
    for line in told(files):
        print(line)


@app.command()
def show(
    scene: SceneArgument,
    members: Members = None, seed: Seed = None, integrator: Integrator = None, dt: Dt = None, turn: Turn = None,
    t_end: TEnd = None,
    every: Every = None, save: Save = None, keep: Keep = None, threads: Threads = None, tolerance: Tolerance = None,
    dtype: Dtype = None, compensated: Compensated = None, settings: Set = [], allow_code: AllowCode = False,  # noqa: B006
):  # fmt: skip
    """Say what a scene is, which effects are compiled, and what a run of it would take, without running it."""
    with reported():
        from rigidmc.engine.machine import threads_available
        from rigidmc.views.scene import describe

        loaded = load_scene(
            scene,
            settings,
            allow_code,
            members=members,
            seed=seed,
            integrator=integrator,
            dt=dt,
            turn=turn,
            t_end=t_end,
            every=every,
            save=save,
            keep=keep,
            tolerance=tolerance,
            dtype=dtype,
            compensated=compensated,
        )
        try:
            print(describe(loaded, threads or threads_available()))
        except ValueError as error:
            if hasattr(error, "file"):
                error.file = error.file or scene
            raise


@app.command()
def check(scene: SceneArgument, settings: Set = [], allow_code: AllowCode = False):  # noqa: B006
    """Check a scene file: exit code 0 where it can be run, 3 and one message where it cannot."""
    with reported():
        from rigidmc.errors import RigidmcError
        from rigidmc.planning.notes import notes
        from rigidmc.planning.plan import prepare

        loaded = load_scene(scene, settings, allow_code)
        try:
            loaded.check()
            plan = prepare(
                loaded.with_run(integrator="rk8")
                if (auto := loaded.run.integrator == "auto")
                else loaded
            )
            told = notes(loaded, plan)
        except RigidmcError as error:
            error.file = error.file or scene
            raise
        for note in told:
            print(f"note: {note}")
        how = (
            f"as many steps as keep {loaded.run.tolerance:g}"
            if auto
            else f"{plan.mean_steps:,.0f} steps with {loaded.run.integrator}"
        )
        print(f"{scene}: good, {loaded.run.members:,} members x {how}")


@app.command(help=library.__doc__.replace("[", r"\[").replace("\n\n", "\n\n\b\n"))
def scenes(name: Annotated[str | None, typer.Argument(help="A shipped scene to print.")] = None):
    with reported():
        from rigidmc.scene.file import load, read_source, shipped

        if name is not None:
            print(read_source(name), end="")
            return
        for word in shipped():
            print(f"{word:18s} {load(word).summary}")


@app.command()
def plot(
    file: ResultArgument,
    output: Annotated[
        str,
        typer.Option("-o", "--output", metavar="FILE", help="Picture to write (.png, .pdf, .svg)."),
    ],
    picture: Annotated[
        str,
        typer.Option(
            help="summary, momentum_sphere, middle_component, drift_histogram, axis_sphere; gibbs of a scene in a bath."
        ),
    ] = "summary",
    force: Force = False,
    allow_code: AllowCode = False,
):
    """Draw a picture of a result."""
    with reported():
        from rigidmc.errors import OptionError, nearest

        pictures = (
            "summary",
            "momentum_sphere",
            "middle_component",
            "drift_histogram",
            "axis_sphere",
            "gibbs",
        )
        if picture not in pictures:
            raise OptionError(
                "",
                "--picture",
                picture,
                f"no such picture; known: {', '.join(pictures)}",
                nearest(picture, pictures),
            )
        refuse_outputs(force, plot=output)
        plots = plots_module()
        try:
            with opened(file, allow_code) as dataset:
                if picture == "gibbs":
                    from rigidmc.views.gibbs import gibbs

                    save_picture(gibbs(dataset, allow_code), output, force)
                else:
                    save_picture(getattr(plots, picture)(dataset), output, force)
        except ValueError as error:
            fail(error, INVALID)
        print(*told([output]))


@app.command()
def doctor(machine: Annotated[bool, typer.Option("--json", help="As JSON.")] = False):
    """Say what this machine offers: cores, vector width, threads, kernel cache, versions."""
    from rigidmc.views.scene import machine_facts

    facts = machine_facts()
    if machine:
        print(json.dumps(facts, indent=1))
        return
    for key, value in facts.items():
        print(f"{key:16s} {value}")
