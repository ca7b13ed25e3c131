"""What is recorded or watched. A new observable is one file here and one line below.

Four kinds, see `rigidmc.observables.protocol`:

OBSERVABLES          recorded at save times; a class with `value`
WATCHED              over all steps, one result per member: events (`level`), running observables
                     (`begin` and `update`), `megno`; over all members at save times: `histogram`
WATCHED_STATISTICS   omega_min, omega_max, omega_mean, omega_variance and so on: of each of
                     OBSERVABLES that asks for neither start nor works
"""

# One line for each observable, in the order in which lists and results have them. The word of an
# observable is the name of its class in snake_case.
# isort: off
from rigidmc.observables.state import Omega as Omega
from rigidmc.observables.state import Momentum as Momentum
from rigidmc.observables.state import Attitude as Attitude
from rigidmc.observables.invariants import Energy as Energy
from rigidmc.observables.invariants import L2 as L2
from rigidmc.observables.invariants import EnergyDrift as EnergyDrift
from rigidmc.observables.invariants import L2Drift as L2Drift
from rigidmc.observables.work import Work as Work
from rigidmc.observables.flips import Flips as Flips
from rigidmc.observables.passage import Passage as Passage
from rigidmc.observables.nutation import Nutation as Nutation
from rigidmc.observables.nutation import Precession as Precession
from rigidmc.observables.chaos import Megno as Megno
from rigidmc.observables.histogram import Histogram as Histogram
# isort: on

from collections.abc import Iterable, Sequence
from typing import Any

from rigidmc.dynamics.methods import argument_names, implements, word_of
from rigidmc.errors import SceneError
from rigidmc.observables.protocol import Ensemble, Outputs, size
from rigidmc.observables.running import STATISTICS

_KINDS = {word_of(kind): kind for kind in globals().values() if hasattr(kind, "_fields")}
OBSERVABLES: dict[str, Any] = {
    word: kind for word, kind in _KINDS.items() if implements(kind, "value")
}
WATCHED: dict[str, Any] = {word: kind for word, kind in _KINDS.items() if word not in OBSERVABLES}
WATCHED_STATISTICS: dict[str, tuple[str, Any]] = {  # {name: (name of the observable, statistic)}
    f"{name}_{word}": (name, statistic)
    for name, kind in OBSERVABLES.items()
    for word, statistic in STATISTICS.items()
    if not argument_names(kind, "value") & {"start", "works"}
}
KNOWN = (*OBSERVABLES, *WATCHED, *WATCHED_STATISTICS)


def value_rows(names: Iterable[str], effects: int) -> dict[str, slice]:
    """{observable: rows of its values} at one save, one after the other; names of what is recorded
    at save times, and the number of effects of the scene."""
    rows, end = {}, 0
    for name in names:
        rows[name] = slice(end, end := end + size(OBSERVABLES[name].dims, effects))
    return rows


def saved(save: Iterable[str]) -> tuple[str, ...]:
    """The named observables that are recorded at save times."""
    return tuple(name for name in save if name in OBSERVABLES)


def recorded(save: Sequence[str], given: Sequence[Any]) -> tuple[str, ...]:
    """The observables that a kernel records at save times: the saved ones, then those that only
    histograms need."""
    hidden = (one.name for _, one in watched(save, given) if isinstance(one, Ensemble))
    return tuple(dict.fromkeys((*saved(save), *hidden)))


def is_summary(value: Any) -> bool:
    """Whether a value is an observable over all steps, such as Flips()."""
    return any(known is type(value) for known in WATCHED.values())


def word_of_watched(summary: Any) -> str:
    """The name in WATCHED of a class or of an instance; SceneError for anything else."""
    kind = summary if isinstance(summary, type) else type(summary)
    for name, known in WATCHED.items():
        if known is kind:
            return name
    rule = "expected names of observables, or observables over all steps such as rigidmc.Flips()"
    raise SceneError("run", "save", summary, rule)


def watched(save: Sequence[str], given: Sequence[Any]) -> list[tuple[str, Any]]:
    """[(label, observable)] of the observables over all steps.

    save : names; a name with numbers in `given` has those, a name without has its defaults
    given : observables with their numbers; all of them are watched
    """
    labelled: list[tuple[str, Any]] = []
    for name in dict.fromkeys((*save, *(word_of_watched(one) for one in given))):
        if name in WATCHED_STATISTICS:
            observable, statistic = WATCHED_STATISTICS[name]
            labelled.append((name, statistic(OBSERVABLES[observable]())))
        elif name in WATCHED:
            same = [one for one in given if word_of_watched(one) == name] or [WATCHED[name]()]
            labelled += [(f"{name}_{i}" if i > 1 else name, one) for i, one in enumerate(same, 1)]
    return labelled


def outputs(label: str, one: Any) -> Outputs:
    """{variable: (units, long_name, dims)} of an observable over all steps.

    label : as `watched` has it; the ends of variables are those of labels: passage_2, passages_2
    """
    if label in WATCHED_STATISTICS:
        units = " ".join(map(_squared, one.of.units.split())) if one.squares else one.of.units
        return {label: (units, f"{one.word} {one.of.long_name}, over the steps", one.of.dims)}
    end, words = label.removeprefix(word_of_watched(one)), one.words()
    return {
        name + end: (units, text.format(**words), dims)
        for name, (units, text, dims) in one.outputs.items()
    }


def _squared(unit: str) -> str:
    """A unit squared: "s-2" of "s-1", "rad2" of "rad"."""
    base = unit.rstrip("-0123456789")
    return f"{base}{2 * int(unit[len(base) :] or 1)}" if base else unit
