"""rigidmc accuracy, integrators."""

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
    check_outputs,
    keep,
    load_scene,
    reported,
)


@app.command()
def accuracy(
    scene: SceneArgument,
    integrators: Annotated[str | None, typer.Option(help="Which, e.g. rk4,rk8,srkn11; default all that take the scene.")] = None,
    tolerances: Annotated[str | None, typer.Option(help="For the table, e.g. 1e-4,1e-8; default every decade from 1e-3 to 1e-12.")] = None,
    members: Annotated[int, typer.Option(min=1, help="Members of the pilot.")] = 256,
    long: Annotated[bool, typer.Option("--long", help="Drift of energy, |L|^2 and L_z over very many steps instead.")] = False,
    steps: Annotated[int, typer.Option(min=1000, help="How many, with --long.")] = 1_000_000,
    dt: Annotated[float | None, typer.Option(help="Step \\[s] with --long; default the scene's.")] = None,
    threads: Threads = None, settings: Set = [], allow_code: AllowCode = False,  # noqa: B006
    output: Output = None, plot: Plot = None, force: Force = False,
):  # fmt: skip
    """What accuracy costs in time, for a scene: every integrator over a ladder of steps against the truth, and the cheapest for each accuracy."""
    with reported():
        from rigidmc.errors import SceneError
        from rigidmc.studies import accuracy as study

        loaded = load_scene(scene, settings, allow_code)
        check_outputs(force, output, plot=plot)
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
        except SceneError as error:
            error.file = error.file or scene
            raise

        def draw(found):
            from rigidmc import study_plots

            return (study_plots.long_drift if long else study_plots.work_precision)(found)

        try:
            lines += keep(found, output, plot, force, draw)
        finally:  # what was found is told also where it could not be written
            print("\n".join(lines))


def _numbers(text):
    from rigidmc.errors import SceneError

    try:
        return tuple(float(word) for word in text.split(","))
    except ValueError:
        raise SceneError("", "--tolerances", text, "expected numbers between commas, e.g. 1e-4,1e-8") from None


@app.command()
def effects(
    measure: Annotated[
        bool, typer.Option("--measure", help="Time each on this machine; compiling them takes 3 minutes at first.")
    ] = False,
):
    """List the effects: law, parameters, what they ask for and keep; with --measure what each costs here."""
    with reported():
        from rigidmc.effects import EFFECTS, description

        costs = {}
        if measure:
            from rigidmc.prices import effect_prices

            costs = effect_prices()
            free, turning, heavy, split = (costs.pop(word) for word in ("free", "with attitude", "with gravity", "strang"))
            print(
                f"a step of rk4 on one thread: {free:.2f} ns of the momentum alone, {turning:.2f} ns with attitude, "
                f"{heavy:.2f} ns with gravity; of strang {split:.2f} ns with gravity, which is what random effects are added to"
            )
        for name, kind in EFFECTS.items():
            law, parameters, facts = description(kind)
            print(f"{name:18s} {law}")
            print(f"{'':18s} {parameters}; {facts}")
            if name in costs:
                operations, alone, added = costs[name]
                print(
                    f"{'':18s} {operations} a torque; a step with it alone {alone:.2f} ns; it adds {added:.2f} ns to one with gravity"
                )


@app.command()
def observables(
    measure: Annotated[bool, typer.Option("--measure", help="Time each on this machine; compiling them takes 4 minutes at first.")] = False,
):  # fmt: skip
    """List what can be saved and watched: what it is, its numbers, its results; with --measure what each watched one adds to a step here."""
    with reported():
        from rigidmc.observables import OBSERVABLES, RUNNING, SUMMARIES
        from rigidmc.observables.statistics import STATISTICS

        costs = {}
        if measure:
            from rigidmc.prices import watched_prices

            costs = watched_prices()
            bare = ", ".join(f"{word} {each['']:.2f} ns" for word, each in costs.items())
            print(f"a step of rk4 with attitude on one thread: {bare}")

        def added(name):
            if name in next(iter(costs.values()), {}):
                print(f"{'':12s} adds " + ", ".join(f"{each[name]:.2f} ns {word}" for word, each in costs.items()))

        print("at save times (save = [...]):")
        for name, kind in OBSERVABLES.items():
            print(f"{name:12s} {kind.__doc__.splitlines()[0]} [{kind.units}]")
        print("\nover all steps, one result per member (save = [...]; numbers in a table [observables.NAME]):")
        for name, kind in SUMMARIES.items():
            print(f"{name:12s} {kind.__doc__.splitlines()[0]}")
            print(
                f"{'':12s} numbers: {', '.join(_default(kind, f) for f in kind._fields) or 'none'}; results: {', '.join(kind.outputs) or 'counts'}"
            )
            added(name)
        able = [name for name in OBSERVABLES if f"{name}_mean" in RUNNING]
        print(f"\nand of {', '.join(able)}, over all steps:")
        for word, kind in STATISTICS.items():
            print(f"NAME_{word:7s} {kind.__doc__.splitlines()[0]}")
            for name in able:
                added(f"{name}_{word}")


def _default(kind, field):
    """A number of an observable, with its default."""
    defaults = kind._field_defaults
    return (
        f"{field} = {defaults[field]:.4g}"
        if isinstance(defaults.get(field), float)
        else f"{field} = {defaults[field]}"
        if field in defaults
        else field
    )


@app.command()
def integrators(
    measure: Annotated[bool, typer.Option("--measure", help="Time a step of each on this machine, free and heavy.")] = False,
):
    """List the integrators: order, torques a step, what they keep, which torques they take; with --measure what a step costs here."""
    with reported():
        from rigidmc.integrators import INTEGRATORS, description

        costs = {}
        if measure:
            from rigidmc.ways import step_costs

            costs = step_costs()
        for name, kind in INTEGRATORS.items():
            order = "exact" if kind.order == float("inf") else f"order {kind.order}"
            keeps = ", ".join(kind.conserves) or "nothing"
            print(f"{name:10s} {description(name).splitlines()[0]}")
            facts = [
                f"{kind.evaluations} torque{'s' * (kind.evaluations != 1)} a step",
                "reversible" if kind.reversible else "not reversible",
            ]
            print(f"{'':10s} {order}, {', '.join(facts)}; takes {kind.accepts}; keeps {keeps} of a free body")
            if name in costs:
                made = [f"{where} {ns:.1f} ns" for where, ns in costs[name].items()]
                print(f"{'':10s} a step on one thread: {', '.join(made)}")
