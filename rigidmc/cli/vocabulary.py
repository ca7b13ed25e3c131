"""rigidmc effects, observables, integrators: all of a kind in a list, or one of them explained."""

from math import inf
from typing import Annotated

import typer

from rigidmc.cli.common import app, reported

Name = Annotated[
    str | None,
    typer.Argument(metavar="[NAME]", help="The one to explain; without it all are listed."),
]


def _explained(name, kinds, word, text, lines):
    """Explain the kind of this name: print its docstring, which has its equation and source, then lines of facts."""
    from inspect import cleandoc

    from rigidmc.errors import OptionError, unknown

    if name not in kinds:
        raise unknown("", word, name, word, kinds, OptionError)
    print(f"{name}: {cleandoc(text(name))}\n")
    for label, fact in lines(name):
        if fact:
            print(f"{label:12s} {fact}")


@app.command()
def effects(
    name: Name = None,
    measure: Annotated[
        bool,
        typer.Option(
            "--measure", help="Time each on this machine; compiling them takes 3 minutes at first."
        ),
    ] = False,
):
    """List the effects: law, parameters, what they ask for and keep; with --measure what each costs here. NAME: its equation, parameters and source."""
    with reported():
        from rigidmc.effects import EFFECTS, description

        if name is not None:
            _explained(name, EFFECTS, "effect", lambda one: EFFECTS[one].__doc__, _of_effect)
            return

        costs = {}
        if measure:
            from rigidmc.planning.tolerance.effect_costs import effect_prices

            costs = effect_prices()
            free, turning, heavy, split = (
                costs.pop(word) for word in ("free", "with attitude", "with gravity", "strang")
            )
            print(
                f"a step of rk4 on one thread: {free:.2f} ns of the momentum alone, {turning:.2f} ns with attitude, "
                f"{heavy:.2f} ns with gravity; of strang {split:.2f} ns with gravity, which is what random effects are added to"
            )
        for word, kind in EFFECTS.items():
            law, parameters, facts = description(kind)
            print(f"{word:18s} {law}")
            print(f"{'':18s} {parameters}; {facts}")
            if word in costs:
                operations, alone, added = costs[word]
                print(
                    f"{'':18s} {operations} a torque; a step with it alone {alone:.2f} ns; it adds {added:.2f} ns to one with gravity"
                )


def _of_effect(name):
    """(label, fact) of an effect."""
    from rigidmc.effects import EFFECTS, description
    from rigidmc.effects.parameters import given
    from rigidmc.scene.checks import limits

    kind = EFFECTS[name]
    numbers = {
        field: f" = {kind._field_defaults[field]:g}" if field in kind._field_defaults else ""
        for field in given(kind)
    }
    ranges = {field: limits(kind, field, False) for field in numbers}
    yield (
        "in a scene",
        f"[effects.{name}] with {', '.join(f'{k}{v}' for k, v in numbers.items())}; in Python rigidmc.{kind.__name__}({', '.join(numbers)})",
    )
    yield "units", ", ".join(f"{k} [{kind.units[k]}]" for k in numbers)
    yield (
        "ranges",
        ", ".join(
            f"{k} {low:g} to {high:g}"
            for k, (low, high) in ranges.items()
            if (low, high) != (-inf, inf)
        ),
    )
    yield "facts", description(kind)[2]


def _of_observable(name):
    """(label, fact) of an observable."""
    from rigidmc.observables import OBSERVABLES, RUNNING, SUMMARIES, outputs

    if name in OBSERVABLES:
        kind = OBSERVABLES[name]
        yield (
            "in a scene",
            f'save = ["{name}"], at save times; over all steps '
            + (
                ", ".join(word for word, (of, _) in RUNNING.items() if of == name)
                or "nothing of it"
            ),
        )
        yield (
            "result",
            f"{kind.long_name} [{kind.units}]"
            + (f", by {', '.join(kind.dims)}" if kind.dims else ""),
        )
    elif name in SUMMARIES:
        kind = SUMMARIES[name]
        table = (
            f" with [observables.{name}] {', '.join(_default(kind, field) for field in kind._fields)}"
            if kind._fields
            else ""
        )
        yield "in a scene", f'save = ["{name}"]{table}'
        for variable, (units, _, dims) in kind.outputs.items():
            yield "result", f"{variable} [{units}]" + (f", by {', '.join(dims)}" if dims else "")
    else:
        of, kind = RUNNING[name]
        yield "in a scene", f'save = ["{name}"], over all steps of {of}'
        for variable, (units, text, dims) in outputs(name, kind(OBSERVABLES[of]())).items():
            yield (
                "result",
                f"{variable}: {text} [{units}]" + (f", by {', '.join(dims)}" if dims else ""),
            )


def _of_integrator(name):
    """(label, fact) of an integrator."""
    from rigidmc.integrators import INTEGRATORS

    kind = INTEGRATORS[name]
    order = "exact" if kind.order == float("inf") else f"order {kind.order}"
    yield "in a scene", f'[run] integrator = "{name}"'
    yield (
        "facts",
        f"{order}, {kind.evaluations} torque{'s' * (kind.evaluations != 1)} a step, {'' if kind.reversible else 'not '}reversible",
    )
    yield "takes", kind.accepts
    yield "keeps", f"{', '.join(kind.conserves) or 'nothing'} of a free body"


@app.command()
def observables(
    name: Name = None,
    measure: Annotated[bool, typer.Option("--measure", help="Time each on this machine; compiling them takes 4 minutes at first.")] = False,
):  # fmt: skip
    """List what can be saved and watched: what it is, its numbers, its results; with --measure what each watched one adds to a step here.
    NAME: all of it."""
    with reported():
        from rigidmc.observables import KNOWN, OBSERVABLES, RUNNING, SUMMARIES
        from rigidmc.observables.running import STATISTICS

        if name is not None:
            kinds = {
                **OBSERVABLES,
                **SUMMARIES,
                **{word: kind for word, (_, kind) in RUNNING.items()},
            }
            _explained(
                name,
                {word: kinds[word] for word in KNOWN},
                "observable",
                lambda one: kinds[one].__doc__,
                _of_observable,
            )
            return
        costs = {}
        if measure:
            from rigidmc.planning.tolerance.effect_costs import watched_prices

            costs = watched_prices()
            bare = ", ".join(f"{word} {each['']:.2f} ns" for word, each in costs.items())
            print(f"a step of rk4 with attitude on one thread: {bare}")

        def added(one):
            if one in next(iter(costs.values()), {}):
                print(
                    f"{'':12s} adds "
                    + ", ".join(f"{each[one]:.2f} ns {word}" for word, each in costs.items())
                )

        print("at save times (save = [...]):")
        for word, kind in OBSERVABLES.items():
            print(f"{word:12s} {kind.__doc__.splitlines()[0]} [{kind.units}]")
        print(
            "\nover all steps, one result per member (save = [...]; numbers in a table [observables.NAME]):"
        )
        for word, kind in SUMMARIES.items():
            print(f"{word:12s} {kind.__doc__.splitlines()[0]}")
            print(
                f"{'':12s} numbers: {', '.join(_default(kind, f) for f in kind._fields) or 'none'}; results: {', '.join(kind.outputs) or 'counts'}"
            )
            added(word)
        able = [word for word in OBSERVABLES if f"{word}_mean" in RUNNING]
        print(f"\nand of {', '.join(able)}, over all steps:")
        for word, kind in STATISTICS.items():
            print(f"NAME_{word:7s} {kind.__doc__.splitlines()[0]}")
            for one in able:
                added(f"{one}_{word}")


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
    name: Name = None,
    measure: Annotated[
        bool, typer.Option("--measure", help="Time a step of each on this machine, free and heavy.")
    ] = False,
):
    """List the integrators: order, torques a step, what they keep, which torques they take; with --measure what a step costs here. NAME: its source."""
    with reported():
        from rigidmc.integrators import INTEGRATORS, description

        if name is not None:
            _explained(name, INTEGRATORS, "integrator", description, _of_integrator)
            return
        costs = {}
        if measure:
            from rigidmc.planning.tolerance.costs import step_costs

            costs = step_costs()
        for word, kind in INTEGRATORS.items():
            order = "exact" if kind.order == float("inf") else f"order {kind.order}"
            keeps = ", ".join(kind.conserves) or "nothing"
            print(f"{word:10s} {description(word).splitlines()[0]}")
            facts = [
                f"{kind.evaluations} torque{'s' * (kind.evaluations != 1)} a step",
                "reversible" if kind.reversible else "not reversible",
            ]
            print(
                f"{'':10s} {order}, {', '.join(facts)}; takes {kind.accepts}; keeps {keeps} of a free body"
            )
            if word in costs:
                made = [f"{where} {ns:.1f} ns" for where, ns in costs[word].items()]
                print(f"{'':10s} a step on one thread: {', '.join(made)}")
