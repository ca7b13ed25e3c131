"""Saved and monitored quantities. A new observable is one file here and one line below.

OBSERVABLES is the catalogue of the shipped classes, in the order of lists and results; the facts of
an observable stand on its class, see `rigidmc.physics.observables.protocol`. An observable is
recorded at save times (it has `value`), or monitored: over all steps, with one result per
member (events, running observables, `megno`, `noise_score`), or by counts over all members
(`histogram`). The fields of a class are its parameters, from a table [observables.NAME] of a scene.
`statistics` adds omega_min, omega_max, omega_mean, omega_variance, omega_last and so on: of each
observable at save times whose `value` uses neither start nor works.

A scene may add custom observables, called `given` below.
"""

# One line for each observable, in the order of lists and results. The word of an observable is the
# name of its class in snake_case.
# isort: off
from rigidmc.physics.observables.state import Omega as Omega
from rigidmc.physics.observables.state import Momentum as Momentum
from rigidmc.physics.observables.state import PrincipalOmega as PrincipalOmega
from rigidmc.physics.observables.state import PrincipalMomentum as PrincipalMomentum
from rigidmc.physics.observables.state import Attitude as Attitude
from rigidmc.physics.observables.state import Energy as Energy
from rigidmc.physics.observables.state import L2 as L2
from rigidmc.physics.observables.state import EnergyDrift as EnergyDrift
from rigidmc.physics.observables.state import L2Drift as L2Drift
from rigidmc.physics.observables.state import Work as Work
from rigidmc.physics.observables.angles import PointingAngle as PointingAngle
from rigidmc.physics.observables.angles import OrbitAngles as OrbitAngles
from rigidmc.physics.observables.flips import Flips as Flips
from rigidmc.physics.observables.passage import Passage as Passage
from rigidmc.physics.observables.nutation import Nutation as Nutation
from rigidmc.physics.observables.nutation import Precession as Precession
from rigidmc.physics.observables.chaos import Megno as Megno
from rigidmc.physics.observables.noise_score import NoiseScore as NoiseScore
from rigidmc.physics.observables.histogram import Histogram as Histogram
# isort: on

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from rigidmc.errors import SceneError
from rigidmc.physics.dynamics.methods import argument_names, implements, number_words, word_of
from rigidmc.physics.observables.protocol import (
    EnsembleObservable,
    Event,
    Growth,
    NoiseSum,
    Observable,
    Outputs,
    Running,
    size,
)
from rigidmc.physics.observables.statistics import STATISTICS

_KINDS = [kind for kind in globals().values() if hasattr(kind, "_fields")]  # the lines above
OBSERVABLES: dict[str, Any] = {word_of(kind): kind for kind in _KINDS}
# Variables that every run produces, whatever is saved. The last two are not in all results.
OUTCOMES = (
    "energy_drift_max", "l2_drift_max", "drift_law", "status", "status_step", "status_time",
    "steps", "followed_until",
)  # fmt: skip
Statistics = dict[str, tuple[str, Any]]  # {name: (name of the observable, statistic)}


def bare_observables() -> dict[str, Any]:
    """Return {name: class} of the shipped observables at save times without parameters."""
    at_saves = {word: kind for word, kind in OBSERVABLES.items() if implements(kind, "value")}
    return {word: kind for word, kind in at_saves.items() if not kind._fields}


def monitors() -> dict[str, Any]:
    """Return {name: class} of the shipped observables that are monitored."""
    return {word: kind for word, kind in OBSERVABLES.items() if not implements(kind, "value")}


def _statistics(kinds: Mapping[str, Any]) -> Statistics:
    """Return the running statistics of observables at save times, {name: class or instance}."""
    return {
        f"{name}_{word}": (name, statistic)
        for name, kind in kinds.items()
        for word, statistic in STATISTICS.items()
        if not argument_names(kind, "value") & {"start", "works"}
    }


_OF_BARE = _statistics(bare_observables())
# Classes already recognised as observables. On Python 3.11 one check against all kinds takes 10 to
# 80 us, and a scene checks each name that it saves.
_of_observables: set[type] = set()


def is_observable(value: Any) -> bool:
    """Return whether a value is an observable of any kind, such as Flips(), not its class."""
    if type(value) is tuple:  # a plain tuple of observables, not an observable
        return False
    if type(value) not in _of_observables:
        kinds = Observable, Event, Running, Growth, NoiseSum, EnsembleObservable
        if not isinstance(value, tuple) or not (isinstance(value, kinds) or is_opaque(value)):
            return False
        _of_observables.add(type(value))
    return True


def is_opaque(value: Any) -> bool:
    """Return whether a value stands in for a custom observable whose code is not run."""
    return implements(value, "stand_in")


def is_own(value: Any) -> bool:
    """Return whether an observable is custom: not of a shipped class."""
    return type(value) not in OBSERVABLES.values()


def word_of_observable(value: Any) -> str:
    """Return the name of an observable; raise SceneError for anything else."""
    if not is_observable(value):
        rule = "expected names of observables, or observables such as rigidmc.Flips()"
        raise SceneError(rule, at="run.save", value=value)
    return word_of(type(value))


def label_observables(given: Iterable[Any]) -> list[tuple[str, Any]]:
    """Return [(label, observable)]: names, numbered from the second use of a name on."""
    known = tuple(given)
    return list(zip(number_words(map(word_of_observable, known)), known, strict=True))


def own(given: Iterable[Any]) -> dict[str, Any]:
    """Return {label: observable} of the given observables that can be recorded at save times."""
    return {
        label: one
        for label, one in label_observables(given)
        if isinstance(one, Observable) and not is_opaque(one)
    }


def find_observable(given: Iterable[Any], name: str) -> Any:
    """Return the observable at save times with this name or label."""
    kind = OBSERVABLES.get(name)
    if kind is not None and not kind._fields:  # to look through `given` takes 0.05 ms, each block
        return kind()
    if name in default_names(given):
        return OBSERVABLES[name]()
    return dict(label_observables(given))[name]


def default_names(given: Iterable[Any]) -> tuple[str, ...]:
    """Return names of shipped observables at save times, less those given with parameters."""
    others = {*monitors(), *own(given)}
    return tuple(name for name in OBSERVABLES if name not in others)


def statistics(given: Iterable[Any] = ()) -> Statistics:
    """Return the statistics of shipped observables without parameters, and of the given ones."""
    return {**_OF_BARE, **_statistics(own(given))}


def saveable_names(given: Iterable[Any] = ()) -> tuple[str, ...]:
    """Return all names that a scene may save: shipped ones first."""
    opaque = [word_of_observable(one) for one in given if is_opaque(one)]
    perhaps = (f"{word}_{statistic}" for word in opaque for statistic in STATISTICS)
    words = (*map(word_of_observable, given), *dict(label_observables(given)))
    shipped = (*OBSERVABLES, *_OF_BARE)
    return tuple(dict.fromkeys((*shipped, *words, *statistics(given), *perhaps)))


def value_rows(observables: Mapping[str, Any], effects: int) -> dict[str, slice]:
    """Return {observable: rows of its values at one save}, one after the other.

    observables : {name: observable} recorded at save times
    effects : number of effects of the scene
    """
    rows, end = {}, 0
    for name, one in observables.items():
        rows[name] = slice(end, end := end + size(one.dims, effects))
    return rows


def saved_observables(save: Iterable[str], given: Sequence[Any] = ()) -> tuple[str, ...]:
    """Return the labels of the named observables that are recorded at save times."""
    labels = own(given)
    names: dict[str, None] = {}
    for name in save:
        if name in default_names(given):
            names[name] = None
        names |= {k: None for k, one in labels.items() if name in (k, word_of(type(one)))}
    return tuple(names)


def recorded_observables(save: Sequence[str], given: Sequence[Any]) -> dict[str, Any]:
    """Return {name: observable} of all that a kernel records at save times.

    Saved observables come first, then observables that only histograms use.
    """
    hidden = (
        one.name
        for _, one in monitored_observables(save, given)
        if isinstance(one, EnsembleObservable)
    )
    return {
        name: find_observable(given, name)
        for name in dict.fromkeys((*saved_observables(save, given), *hidden))
    }


def monitored_observables(save: Sequence[str], given: Sequence[Any]) -> list[tuple[str, Any]]:
    """Return [(label, observable)] of the observables over all steps.

    save : names; a name in `given` has the parameters given there, any other its defaults
    given : observables with their parameters; all are monitored except those at save times
    """
    found: list[tuple[str, Any]] = []
    at_times = own(given)
    over = [
        (s, one) for s, one in label_observables(given) if s not in at_times and not is_opaque(one)
    ]
    extra, shipped = statistics(given), monitors()
    for name in dict.fromkeys((*save, *(word_of_observable(one) for _, one in over))):
        if name in extra:
            observable, statistic = extra[name]
            found.append((name, statistic(find_observable(given, observable))))
            continue
        same = [(label, one) for label, one in over if word_of_observable(one) == name]
        found += same or ([(name, shipped[name]())] if name in shipped else [])
    return found


def outputs(label: str, one: Any) -> Outputs:
    """Return {variable: (units, long_name, dims)} of an observable over all steps.

    label : from `monitored_observables`; variables get the suffix of the label: passage_2,
        passages_2
    """
    if type(one) in STATISTICS.values():
        units = square_units(one.of.units) if one.squares else one.of.units
        return {label: (units, f"{one.word} {title(one.of)}, over the steps", one.of.dims)}
    end, words = label.removeprefix(word_of_observable(one)), one.label_fields()
    return {
        name + end: (units, text.format(**words), dims)
        for name, (units, text, dims) in one.outputs.items()
    }


def title(one: Any) -> str:
    """Return the long_name of an observable at save times, with its {field} values filled in."""
    text: str = one.long_name
    return text.format(**(one.label_fields() if implements(one, "label_fields") else one._asdict()))


def bind(one: Any, effects: Sequence[Any]) -> Any:
    """Return an observable, or its statistic, as compiled under the effects of a scene."""
    if type(one) in STATISTICS.values():
        return one._replace(of=bind(one.of, effects))
    return one.bind(effects) if implements(one, "bind") else one


def dimensions(
    recorded: Mapping[str, Any], monitored: Iterable[tuple[str, Any]]
) -> tuple[str, ...]:
    """Return the dimensions of the recorded and the monitored observables."""
    dims = [one.dims for one in recorded.values()]
    dims += [output[2] for pair in monitored for output in outputs(*pair).values()]
    return tuple(dict.fromkeys(name for each in dims for name in each))


def square_units(units: str) -> str:
    """Return units squared: "s-2" of "s-1", "kg2 m4 s-2" of "kg m2 s-1"."""
    return " ".join(map(_squared, units.split()))


def _squared(unit: str) -> str:
    """Return one unit squared: "s-2" of "s-1", "rad2" of "rad"."""
    base = unit.rstrip("-0123456789")
    return f"{base}{2 * int(unit[len(base) :] or 1)}" if base else unit
