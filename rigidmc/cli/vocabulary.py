"""rigidmc effects, observables, integrators: list all of a kind, or describe one.

A description is the docstring of the class, with one line per parameter and without examples.
"""

import re
import textwrap
from collections.abc import Callable, Iterable, Iterator, Mapping
from inspect import cleandoc
from math import inf
from typing import Annotated, Any

import typer

from rigidmc.cli.app import load_scene
from rigidmc.cli.options import AllowCode
from rigidmc.cli.reporting import report_errors
from rigidmc.errors import OptionError, unknown
from rigidmc.results.labels import units_text, with_units

Name = Annotated[
    str | None, typer.Argument(metavar="[NAME]", help="Describe this one; without NAME, list all.")
]
OfScene = Annotated[
    str | None,
    typer.Option("--scene", metavar="SCENE", help="Include the custom integrators of this scene."),
]
Facts = Iterator[tuple[str, str]]
MeasureEffects = Annotated[
    bool,
    typer.Option(
        "--measure",
        help="Time each effect on this machine (the first time compiles for 3 minutes).",
    ),
]
MeasureObservables = Annotated[
    bool,
    typer.Option(
        "--measure",
        help="Time each observable on this machine (the first time compiles for 4 minutes).",
    ),
]
MeasureIntegrators = Annotated[
    bool,
    typer.Option(
        "--measure",
        help="Time a step of each integrator on this machine, for a free and a heavy body.",
    ),
]


def _explain(
    name: str, kinds: Iterable[str], kind: str, text: str | None, facts: Callable[[str], Facts]
) -> None:
    """Print the docstring of a kind, with its equation and source, then its facts."""
    if name not in kinds:
        raise unknown(kind, kinds, at=kind, value=name, error=OptionError)
    print(f"{name}: {explain_docstring(text or '')}\n")
    for label, fact in facts(name):
        if fact:
            print(f"{label:12s} {fact}")


def _summary(kind: Any) -> str:
    """Return the first sentence of a docstring, without the test that it names."""
    words = " ".join(str(kind.__doc__).split("\n\n")[0].split())
    return re.sub(r" \(tests/[^)]*\)", "", re.split(r"(?<=\S\.) (?=[A-Z])", words)[0])


def _by(dims: Iterable[str]) -> str:
    """Name the dimensions of a result."""
    return f", by {', '.join(dims)}" if dims else ""


def effects_command(name: Name = None, measure: MeasureEffects = False) -> None:
    with report_errors():
        from rigidmc.physics.effects import EFFECTS, description

        if name is not None:
            _explain(name, EFFECTS, "effect", getattr(EFFECTS.get(name), "__doc__", ""), _of_effect)
            return
        costs = _effect_costs() if measure else {}
        for word, kind in EFFECTS.items():
            law, parameters, facts = description(kind)
            print(f"{word:18s} {law}")
            print(f"{'':18s} {parameters}; {facts}")
            if word in costs:
                operations, alone, added = costs[word]
                print(
                    f"{'':18s} {operations} per torque; {alone:.2f} ns per step alone; adds"
                    f" {added:.2f} ns to a step with gravity"
                )


def _effect_costs() -> dict[str, Any]:
    """Return {effect: its measured cost}; print the cost of steps without effects."""
    from rigidmc.runs.price import effect_prices

    costs = effect_prices()
    words = ("free", "with attitude", "with gravity", "strang", "rk8")
    free, turning, heavy, split, eighth = (costs.pop(word) for word in words)
    print(
        f"a step of rk4 on one thread: {free:.2f} ns for the momentum alone, {turning:.2f} ns with"
        f" attitude, {heavy:.2f} ns with gravity; a step of strang: {split:.2f} ns with gravity,"
        f" the base for random effects, and of rk8: {eighth:.2f} ns, for effects with moving parts"
    )
    return costs


def _in_toml(value: Any) -> str:
    """Write a number or a vector as in a scene file."""
    return f"[{', '.join(map(_in_toml, value))}]" if isinstance(value, tuple) else f"{value:g}"


def _of_effect(name: str) -> Facts:
    """Yield (label, fact) of an effect."""
    from rigidmc.physics.effects import EFFECTS, description
    from rigidmc.physics.effects.protocol import user_parameters
    from rigidmc.scene.validation import parameter_limits

    kind = EFFECTS[name]
    defaults = kind._field_defaults
    fields = {
        field: f" = {_in_toml(defaults[field])}" if field in defaults else ""
        for field in user_parameters(kind)
    }
    table = ", ".join(f"{field}{default}" for field, default in fields.items())
    in_python = f"rigidmc.{kind.__name__}({', '.join(fields)})"
    yield "in a scene", f"[effects.{name}] with {table}; in Python {in_python}"
    units = {field: units_text(kind.units[field]) or "1" for field in fields}
    yield "units", ", ".join(f"{field} [{text}]" for field, text in units.items())
    ranges = ((field, *parameter_limits(kind, field, False)) for field in fields)
    yield (
        "ranges",
        ", ".join(
            f"{field} {low:g} to {high:g}"
            for field, low, high in ranges
            if (low, high) != (-inf, inf)
        ),
    )
    yield "facts", description(kind)[2]


def observables_command(name: Name = None, measure: MeasureObservables = False) -> None:
    with report_errors():
        from rigidmc.physics.observables import OBSERVABLES, monitors, statistics
        from rigidmc.physics.observables.statistics import STATISTICS

        if name is not None:
            kinds = {**OBSERVABLES, **{word: kind for word, (_, kind) in statistics().items()}}
            text = getattr(kinds.get(name), "__doc__", "")
            _explain(name, tuple(kinds), "observable", text, _of_observable)
            return
        costs = _monitoring_costs() if measure else {}

        def print_added(word: str) -> None:
            if word in next(iter(costs.values()), {}):
                added = ", ".join(f"{each[word]:.2f} ns {where}" for where, each in costs.items())
                print(f"{'':12s} adds {added}")

        print("saved at the save times (save = [...]):")
        for word, kind in OBSERVABLES.items():
            if word not in monitors():
                print(f"{word:12s} {with_units(_summary(kind), kind.units)}")
                if parameters := _fields(kind):
                    print(f"{'':12s} parameters, in a table [observables.{word}]: {parameters}")
        print("\nmonitored over all steps, one result per member (save = [...]; parameters in")
        print("a table [observables.NAME]):")
        for word, kind in monitors().items():
            parameters = _fields(kind) or "none"
            results = ", ".join(kind.outputs) or "counts"
            print(f"{word:12s} {_summary(kind)}")
            print(f"{'':12s} parameters: {parameters}; results: {results}")
            print_added(word)
        able = list(dict.fromkeys(of for of, _ in statistics().values()))
        print(f"\nstatistics over all steps, for {', '.join(able)},")
        print("and for observables with parameters, such as pointing_angle_max:")
        for word, kind in STATISTICS.items():
            print(f"NAME_{word:7s} {_summary(kind)}")
            for observable in able:
                print_added(f"{observable}_{word}")


def _monitoring_costs() -> dict[str, dict[str, float]]:
    """Return {scene: {observable: added time per step [ns]}}; print the cost of bare steps."""
    from rigidmc.runs.price import monitored_prices

    costs = monitored_prices()
    bare = ", ".join(f"{where} {each['']:.2f} ns" for where, each in costs.items())
    print(f"a step of rk4 with attitude on one thread: {bare}")
    return costs


def _of_observable(name: str) -> Facts:
    """Yield (label, fact) of an observable."""
    from rigidmc.physics.observables import OBSERVABLES, monitors, outputs, statistics
    from rigidmc.physics.observables.statistics import STATISTICS

    if (kind := OBSERVABLES.get(name)) is not None:
        fields = _fields(kind)
        table = f" with [observables.{name}] {fields}" if fields else ""
        if name in monitors():
            yield "in a scene", f'save = ["{name}"]{table}'
            for variable, (units, _, dims) in kind.outputs.items():
                yield "result", f"{with_units(variable, units)}{_by(dims)}"
        elif fields:
            yield "in a scene", f'save = ["{name}"]{table}'
            yield "over all steps", ", ".join(f"{name}_{word}" for word in STATISTICS)
            yield "result", f"{with_units(name, kind.units)}{_by(kind.dims)}"
        else:
            words = [word for word, (of, _) in statistics().items() if of == name]
            over = ", ".join(words) or "no statistics"
            yield "in a scene", f'save = ["{name}"], at save times; over all steps: {over}'
            yield "result", f"{with_units(kind.long_name, kind.units)}{_by(kind.dims)}"
    else:
        of, kind = statistics()[name]
        yield "in a scene", f'save = ["{name}"], over all steps of {of}'
        for variable, (units, text, dims) in outputs(name, kind(OBSERVABLES[of]())).items():
            yield "result", f"{variable}: {with_units(text, units)}{_by(dims)}"


def _fields(kind: Any) -> str:
    """Return the parameters of an observable, with their defaults."""
    return ", ".join(_default(kind, field) for field in kind._fields)


def _default(kind: Any, field: str) -> str:
    """Return a parameter of an observable, with its default if it has one."""
    if field not in kind._field_defaults:
        return field
    default = kind._field_defaults[field]
    return f"{field} = {default:.4g}" if isinstance(default, float) else f"{field} = {default}"


def integrators_command(
    name: Name = None,
    measure: MeasureIntegrators = False,
    scene: OfScene = None,
    allow_code: AllowCode = False,
) -> None:
    with report_errors():
        from rigidmc.physics.integrators import INTEGRATORS, description

        kinds = dict(INTEGRATORS)
        if scene is not None:
            kinds = load_scene(scene, allow_code=allow_code).known_integrators()
        if name is not None:
            text = description(kinds[name]) if name in kinds else ""
            _explain(name, kinds, "integrator", text, lambda word: _of_integrator(word, kinds))
            return
        costs: dict[str, dict[str, float]] = {}
        if measure:
            from rigidmc.runs.price import step_costs

            costs = step_costs()
        for word, kind in kinds.items():
            keeps = ", ".join(kind.conserves) or "nothing"
            print(f"{word:10s} {description(kind).splitlines()[0]}")
            print(
                f"{'':10s} {_order(kind)}; accepts {kind.accepts}; conserves {keeps} of a free body"
            )
            if word in costs:
                times = ", ".join(f"{where} {ns:.1f} ns" for where, ns in costs[word].items())
                print(f"{'':10s} one step on one thread: {times}")


def _order(kind: Any) -> str:
    """Describe order, torques per step and reversibility of an integrator."""
    order = "exact" if kind.order == inf else f"order {kind.order}"
    torques = f"{kind.evaluations} torque{'s' * (kind.evaluations != 1)} per step"
    return f"{order}, {torques}, {'' if kind.is_reversible else 'not '}reversible"


def _of_integrator(name: str, kinds: Mapping[str, Any]) -> Facts:
    """Yield (label, fact) of an integrator."""
    kind = kinds[name]
    yield "in a scene", f'[run] integrator = "{name}"'
    yield "facts", _order(kind)
    yield "accepts", kind.accepts
    yield "conserves", f"{', '.join(kind.conserves) or 'nothing'} of a free body"


_TITLE = re.compile(r"^(\w[\w ]*)\n-+\n", re.MULTILINE)
_PARAMETER = re.compile(r"^(?P<names>\w[\w, ]*) : (?P<kind>.*)\n(?P<meaning>(?:[ ]+.*\n?)+)", re.M)
_UNIT = re.compile(r"\[[^\]]+\]$")


def explain_docstring(docstring: str) -> str:
    """Return summary, equation, text and source of a docstring, and lines `name : meaning [unit]`.

    Other sections concern Python only: examples, errors and return values.
    """
    text, *sections = _TITLE.split(cleandoc(docstring))
    parts = [re.sub("::$", ":", text.strip(), flags=re.MULTILINE)]
    for title, section in zip(sections[::2], sections[1::2], strict=True):
        if title == "Parameters":
            parts.append("\n".join(_parameters(section)))
        elif title == "Notes":
            parts.append(section.strip())
    return "\n\n".join(parts)


def _parameters(section: str) -> Iterator[str]:
    for match in _PARAMETER.finditer(section):
        unit = _UNIT.search(match["kind"])
        words = [match["meaning"], *([unit[0]] if unit else [])]
        line = f"{match['names']} : {' '.join(' '.join(words).split())}"
        yield textwrap.fill(line, width=100, subsequent_indent="    ", break_on_hyphens=False)
