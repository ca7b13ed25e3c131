"""What is recorded. An observable is a NamedTuple with its facts; a new one is one class and one line below.

At save times:
    value(self, [body, effects, t, q, l, start, works]) -> tuple of floats      start = (E, 1/scale of E, |L|^2, 1/|L|^2) at t = 0
    facts: units, long_name, dims (() for a number, ("axis",) for 3, ("quat",) for 4, ("effect",) for one of each effect)

Over all members, at save times and with nothing stored of each: `histogram`.

Over all steps, with one result per member and no trajectory kept:
    begin(self, [body, effects, t, q, l]) and update(self, kept, [...]) -> what it keeps, `marks` floats; results(kept)
    or, of an event, level(self, [body, effects, t, q, l]), which rises through 0 when it happens; results(record)
    facts: outputs {variable: (units, long_name, dims)}
and, of each observable of the first kind that asks for neither start nor works, `omega_min`, `omega_max`, `omega_mean`, `omega_variance`.
"""

from typing import Any

from rigidmc.dynamics.methods import names
from rigidmc.observables.chaos import Megno
from rigidmc.observables.flips import Flips
from rigidmc.observables.histogram import Histogram
from rigidmc.observables.invariants import L2, Energy, EnergyDrift, L2Drift
from rigidmc.observables.nutation import Nutation, Precession
from rigidmc.observables.passage import Passage
from rigidmc.observables.running import STATISTICS
from rigidmc.observables.state import Attitude, Momentum, Omega
from rigidmc.observables.work import Work

OBSERVABLES: dict[str, Any] = {
    "omega": Omega,
    "momentum": Momentum,
    "attitude": Attitude,
    "energy": Energy,
    "l2": L2,
    "energy_drift": EnergyDrift,
    "l2_drift": L2Drift,
    "work": Work,
}
SUMMARIES: dict[str, Any] = {
    "flips": Flips,
    "passage": Passage,
    "nutation": Nutation,
    "precession": Precession,
    "megno": Megno,
    "histogram": Histogram,
}
SIZES = {(): 1, ("axis",): 3, ("quat",): 4}
RUNNING = {
    f"{name}_{word}": (name, kind)
    for name, of in OBSERVABLES.items()
    for word, kind in STATISTICS.items()
    if not names(of, "value") & {"start", "works"}
}
KNOWN = (*OBSERVABLES, *SUMMARIES, *RUNNING)


def rows_of(effects, *names):
    """How many numbers the named observables are for one member at one time; those over all steps have none."""
    return sum(
        {**SIZES, ("effect",): len(effects)}[OBSERVABLES[name].dims]
        for name in names
        if name in OBSERVABLES
    )


def saved(save):
    """Those of the named observables that are recorded at save times."""
    return tuple(name for name in save if name in OBSERVABLES)


def recorded(save, given):
    """The observables that a kernel records at save times: those that are saved, and those that only histograms need."""
    hidden = (one.name for _, one in watched(save, given) if hasattr(one, "ensemble"))
    return tuple(dict.fromkeys((*saved(save), *hidden)))


def summary_of(kind):
    """The word for a kind of summary in a scene file."""
    return next(
        name
        for name, known in SUMMARIES.items()
        if known is (kind if isinstance(kind, type) else type(kind))
    )


def watched(save, given):
    """[(label, observable)] over all steps: those named in `save`, with their numbers from `given` where that has some; all of `given` is watched."""
    found: list[tuple[str, Any]] = []
    for name in dict.fromkeys((*save, *(summary_of(one) for one in given))):
        if name in RUNNING:
            of, kind = RUNNING[name]
            found.append((name, kind(OBSERVABLES[of]())))
        elif name in SUMMARIES:
            some = [one for one in given if summary_of(one) == name] or [SUMMARIES[name]()]
            found += [(name if i == 0 else f"{name}_{i + 1}", one) for i, one in enumerate(some)]
    return found


def outputs(label, one):
    """{variable: (units, long_name, dims)} of an observable over all steps."""
    if label in RUNNING:
        units = one.of.units if not label.endswith("variance") else _squared(one.of.units)
        return {label: (units, f"{one.word} {one.of.long_name}, over the steps", one.of.dims)}
    end = label.removeprefix(summary_of(one))
    words = one.words() if hasattr(one, "words") else {}
    return {
        name + end: (units, text.format(**words), dims)
        for name, (units, text, dims) in one.outputs.items()
    }


def _squared(units):
    """The units of a square: "rad2 s-2" of "rad s-1"."""
    made = []
    for word in units.split():
        base = word.rstrip("-0123456789")
        made.append(f"{base}{2 * int(word[len(base) :] or 1)}" if base else word)
    return " ".join(made)
