"""The command line: rigidmc run, show, check, scenes, body, exact, plot, integrators, doctor. Nothing heavy is imported before it is needed."""

import json
import os
import signal
import sys
import time
import warnings
from contextlib import contextmanager
from typing import Annotated

import typer

from rigidmc import scenes as scenes_package

OK, USAGE, INVALID, FLAGGED, INCOMPLETE, REFUSED, IO, INTERRUPTED, TERMINATED = 0, 2, 3, 4, 5, 6, 74, 130, 143

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    help="Monte Carlo ensembles of rigid bodies with a fixed point: millions of free or heavy tops in parallel.",
    epilog="Exit codes: 0 done, 2 usage, 3 invalid scene, 4 some members flagged, 5 incomplete, 6 refused to overwrite, "
    "74 input or output failed, 130 / 143 stopped by a signal.",
)

SceneArgument = Annotated[
    str, typer.Argument(metavar="SCENE", help="A TOML file, the name of a shipped scene, or a result file (.nc).")
]
Members = Annotated[int | None, typer.Option(help="Members of the ensemble.")]
Seed = Annotated[int | None, typer.Option(help="Seed of all random draws.")]
Integrator = Annotated[str | None, typer.Option(help="rk4, rkmk4, strang or exact.")]
Dt = Annotated[float | None, typer.Option(help="Step [s].")]
TEnd = Annotated[float | None, typer.Option(help="End time [s].")]
Every = Annotated[float | None, typer.Option(help="Time between saves [s]; without it first and last.")]
Save = Annotated[
    str | None,
    typer.Option(
        help="What to save, e.g. omega,attitude,energy; also momentum, l2, energy_drift, l2_drift; none for the summary only."
    ),
]
Threads = Annotated[int | None, typer.Option(min=1, help="Threads; default one per core.")]
Set = Annotated[
    list[str], typer.Option("--set", metavar="KEY=VALUE", help="Override a value of the scene, e.g. body.moments=[1,2,3].")
]
Output = Annotated[str | None, typer.Option("-o", "--output", metavar="FILE", help="netCDF file to write.")]
Plot = Annotated[str | None, typer.Option(metavar="FILE", help="Picture to write (.png, .pdf, .svg).")]
Force = Annotated[bool, typer.Option(help="Replace files that exist.")]


class Terminated(BaseException):
    """SIGTERM, as an exception, so that a run ends the way it does on Ctrl-C."""


@contextmanager
def reported():
    """Turn what can go wrong into one message and an exit code; never a traceback for a user's mistake."""
    from rigidmc.errors import OutputExists, SceneError

    def terminate(*_):
        raise Terminated

    previous = signal.signal(signal.SIGTERM, terminate)
    try:
        yield
    except SceneError as error:
        _fail(error, INVALID)
    except OutputExists as error:
        _fail(error, REFUSED)
    except FileNotFoundError as error:
        _fail(error, INVALID if "shipped scene" in str(error) else IO)
    except BrokenPipeError:  # whoever read our lines has gone
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise typer.Exit(OK) from None
    except (OSError, RuntimeError) as error:
        if isinstance(error, RuntimeError) and "HDF error" not in str(error) and "NetCDF" not in str(error):
            raise
        _fail(f"{error}; nothing that existed was changed", IO)
    except MemoryError as error:
        _fail(f"not enough memory: {error}; write to a file with -o, save less, or run fewer members", IO)
    except KeyboardInterrupt:
        _fail("interrupted; no file was left under the final name", INTERRUPTED)
    except Terminated:
        _fail("terminated; no file was left under the final name", TERMINATED)
    finally:
        signal.signal(signal.SIGTERM, previous)


def _fail(message, code):
    print(f"rigidmc: {message}", file=sys.stderr)
    raise typer.Exit(code)


def _load(source, settings, **run):
    """A scene with the options of the command line in it."""
    from rigidmc.errors import SceneError
    from rigidmc.scene import Scene

    pairs = []
    for setting in settings:
        key, equals, value = setting.partition("=")
        if not equals or "." not in key:
            raise SceneError("", "--set", setting, "expected table.key=value, e.g. body.moments=[1,2,3] or effects.gravity.g=1.62")
        pairs.append((key.strip(), value.strip()))
    if run.get("save") is not None:
        run["save"] = tuple(word.strip() for word in run["save"].split(",") if word.strip() not in ("", "none"))
    try:
        return Scene.load(source, pairs).with_run(**run)
    except SceneError as error:
        error.file = error.file or source
        raise


@app.command("run")
def run_scene(
    scene: SceneArgument,
    members: Members = None, seed: Seed = None, integrator: Integrator = None, dt: Dt = None, t_end: TEnd = None,
    every: Every = None, save: Save = None, threads: Threads = None, settings: Set = [],  # noqa: B006
    output: Output = None, plot: Plot = None, force: Force = False,
):  # fmt: skip
    """Run a scene: integrate its ensemble, write the result and a picture, and say what it cost."""
    began = time.perf_counter()
    with reported():
        from rigidmc.errors import OutputExists, SceneError, SceneWarning
        from rigidmc.simulation import simulate

        loaded = _load(
            scene, settings, members=members, seed=seed, integrator=integrator, dt=dt, t_end=t_end, every=every, save=save
        )
        for path in (output, plot):
            if path is not None and os.path.lexists(path) and not force:
                raise OutputExists(f"{path} exists; nothing was written (use --force to replace it)")
        if plot is not None:
            _check_suffix(plot)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("always", SceneWarning)
                warnings.showwarning = lambda message, *_, **__: print(f"rigidmc: note: {message}", file=sys.stderr)
                dataset = simulate(loaded, threads=threads, progress=True, output=output, force=force)
        except SceneError as error:
            error.file = error.file or scene
            raise
        cost = dataset.encoding["rigidmc"]
        if plot is not None:
            plots = _plots()
            plots.save(plots.summary(dataset), plot)
        _close(dataset, cost, time.perf_counter() - began, [p for p in (output, plot) if p])
        flagged = dataset.sizes["member"] - cost["flagged"]["ok"]
        dataset.close()
    raise typer.Exit(FLAGGED if flagged else OK)


def _plots():
    try:
        from rigidmc import plots
    except ImportError as error:
        _fail(f"pictures need matplotlib: pip install 'rigidmc[plot]' ({error})", IO)
    return plots


def _check_suffix(path):
    try:
        _plots().check_suffix(path)
    except ValueError as error:
        _fail(error, INVALID)


def _close(dataset, cost, wall, files):
    """The closing summary."""
    import numpy as np

    count, steps, seconds = dataset.sizes["member"], cost["steps"], cost["run_seconds"]
    print(
        f"{dataset.attrs['title']}: {count:,} members x {steps:,} steps of {dataset.attrs['dt']:.6g} s with {dataset.attrs['integrator']}"
    )
    print(
        f"  {seconds:.2f} s, {count * steps / seconds / 1e6:.0f} M member-steps/s, {count / seconds:,.0f} members/s; "
        f"compiled in {cost['compile_seconds']:.2f} s; {wall:.2f} s in all"
    )
    for name, word in (("energy", "energy"), ("l2", "|L|^2")):
        drift = dataset[f"{name}_drift_max"]
        values = drift.values[np.isfinite(drift.values)]
        if values.size:
            kept = "" if drift.attrs["conserved"] == "yes" else f"   (not conserved: {drift.attrs['conserved'][4:]})"
            print(f"  drift of {word:6s}  median {np.median(values):.1e}   worst {values.max():.1e}{kept}")
    flags = ", ".join(f"{v:,} {k}" for k, v in cost["flagged"].items() if v and k != "ok")
    print(f"  flagged members: {flags or 'none'}")
    if not files:
        print("  nothing was written: -o FILE keeps the result, --plot FILE draws it")
    for path in files:
        print(f"  wrote {path} ({os.path.getsize(path) / 1e6:,.1f} MB)")


@app.command()
def show(
    scene: SceneArgument,
    members: Members = None, seed: Seed = None, integrator: Integrator = None, dt: Dt = None, t_end: TEnd = None,
    every: Every = None, save: Save = None, threads: Threads = None, settings: Set = [],  # noqa: B006
):  # fmt: skip
    """Say what a scene is, which effects are compiled, and what a run of it would take, without running it."""
    with reported():
        from rigidmc.engine.machine import threads_available
        from rigidmc.estimate import describe

        loaded = _load(
            scene, settings, members=members, seed=seed, integrator=integrator, dt=dt, t_end=t_end, every=every, save=save
        )
        try:
            print(describe(loaded, threads or threads_available()))
        except ValueError as error:
            if hasattr(error, "file"):
                error.file = error.file or scene
            raise


@app.command()
def check(scene: SceneArgument, settings: Set = []):  # noqa: B006
    """Check a scene file: exit code 0 where it can be run, 3 and one message where it cannot."""
    with reported():
        from rigidmc.errors import SceneError
        from rigidmc.planning import prepare

        loaded = _load(scene, settings)
        try:
            plan = prepare(loaded)
        except SceneError as error:
            error.file = error.file or scene
            raise
        for note in plan.notes:
            print(f"note: {note}")
        print(f"{scene}: good, {loaded.run.members:,} members x {plan.steps:,} steps with {loaded.run.integrator}")


@app.command(help=scenes_package.__doc__.replace("[", r"\[").replace("\n\n", "\n\n\b\n"))
def scenes(name: Annotated[str | None, typer.Argument(help="A shipped scene to print.")] = None):
    with reported():
        from rigidmc.scene_file import load, read_source, shipped

        if name is not None:
            print(read_source(name), end="")
            return
        for word in shipped():
            print(f"{word:18s} {load(word).summary}")


@app.command()
def plot(
    file: Annotated[str, typer.Argument(metavar="FILE", help="A result (.nc).")],
    output: Annotated[str, typer.Option("-o", "--output", metavar="FILE", help="Picture to write (.png, .pdf, .svg).")],
    picture: Annotated[
        str, typer.Option(help="summary, momentum_sphere, middle_component, drift_histogram or axis_sphere.")
    ] = "summary",
    force: Force = False,
):
    """Draw a picture of a result."""
    with reported():
        from rigidmc.errors import SceneError, nearest
        from rigidmc.storage import open_result, refuse_existing

        pictures = ("summary", "momentum_sphere", "middle_component", "drift_histogram", "axis_sphere")
        if picture not in pictures:
            raise SceneError("", "--picture", picture, f"no such picture; known: {', '.join(pictures)}", nearest(picture, pictures))
        refuse_existing(output, force)
        plots = _plots()
        _check_suffix(output)
        try:
            with open_result(file) as dataset:
                plots.save(getattr(plots, picture)(dataset), output)
        except ValueError as error:
            _fail(error, INVALID)
        print(f"wrote {output}")


@app.command("body")
def body_command(
    source: Annotated[str, typer.Argument(metavar="FILE|NAME", help="A scene file, a shipped scene, or a mesh (.stl, .obj).")],
    density: Annotated[float | None, typer.Option(help="Of a mesh [kg/m3]; default 1.")] = None,
    mass: Annotated[float | None, typer.Option(help="Of a mesh [kg], instead of the density.")] = None,
    scale: Annotated[float, typer.Option(help="Metres per unit of a mesh file: 0.001 for millimetres.")] = 1.0,
    machine: Annotated[bool, typer.Option("--json", help="As JSON.")] = False,
):
    """Say what a body is: mass, centre, tensor, principal axes, which rotations are stable and how fast the unstable one grows."""
    with reported():
        from rigidmc.body_report import body_of, describe, facts
        from rigidmc.errors import SceneError

        try:
            body, title = body_of(source, density, mass, scale)
            print(json.dumps(facts(body), indent=1) if machine else "\n".join(describe(body, title)))
        except SceneError as error:
            error.file = error.file or source
            raise


@app.command("exact")
def exact_command(
    scene: SceneArgument,
    at: Annotated[float | None, typer.Option(help="Time [s]; default the scene's t_end. Negative: the closed form alone.")] = None,
    members: Annotated[int, typer.Option(min=1, help="How many members, the first ones.")] = 1000,
    integrator: Integrator = None, dt: Dt = None, settings: Set = [],  # noqa: B006
    plot: Annotated[str | None, typer.Option(metavar="FILE", help="Picture of the first member (.png, .pdf, .svg).")] = None,
    force: Force = False,
):  # fmt: skip
    """The closed form of a scene at a time, beside its integration, with the difference."""
    with reported():
        from rigidmc.closed_form import closed_form, compare
        from rigidmc.errors import SceneError, SceneWarning
        from rigidmc.storage import refuse_existing

        loaded = _load(scene, settings, integrator=integrator, dt=dt)
        at = loaded.run.t_end if at is None else at
        if plot is not None:
            refuse_existing(plot, force)
            _check_suffix(plot)
        with warnings.catch_warnings():
            warnings.simplefilter("always", SceneWarning)
            warnings.showwarning = lambda message, *_, **__: print(f"rigidmc: note: {message}", file=sys.stderr)
            try:
                print("\n".join(compare(loaded, at, members)))
                if plot is not None:
                    from rigidmc import exact_plots

                    case = closed_form(loaded, 1)
                    title = f"{loaded.title}: {case.name}, closed form of member {loaded.run.first}"
                    _plots().save(exact_plots.case_summary(case, title, abs(at) or loaded.run.t_end), plot)
                    print(f"wrote {plot}")
            except SceneError as error:
                error.file = error.file or scene
                raise


@app.command()
def integrators():
    """List the integrators: order, what they keep, which torques they take."""
    from rigidmc.integrators import INTEGRATORS

    for name, kind in INTEGRATORS.items():
        order = "exact" if kind.order == float("inf") else f"order {kind.order}"
        keeps = ", ".join(kind.conserves) or "nothing"
        print(f"{name:8s} {kind.__doc__.splitlines()[0]}")
        print(f"         {order}, {'reversible' if kind.reversible else 'not reversible'}; takes {kind.accepts}; keeps {keeps}")


@app.command()
def doctor(machine: Annotated[bool, typer.Option("--json", help="As JSON.")] = False):
    """Say what this machine offers: cores, vector width, threads, kernel cache, versions."""
    from rigidmc.estimate import machine_facts

    facts = machine_facts()
    if machine:
        print(json.dumps(facts, indent=1))
        return
    for key, value in facts.items():
        print(f"{key:16s} {value}")


def main():
    """Entry point of the `rigidmc` command."""
    try:
        app()
    except KeyboardInterrupt:  # before or after the work itself
        sys.exit(INTERRUPTED)


if __name__ == "__main__":
    main()
