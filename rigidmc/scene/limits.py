"""The limits of parameters, and of what a histogram may count."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from rigidmc.effects.protocol import Effect, facts
from rigidmc.errors import SceneError, unknown
from rigidmc.observables import OBSERVABLES, is_opaque, named, own, word_of_observable
from rigidmc.observables.histogram import Histogram
from rigidmc.observables.protocol import size

# members whose sampled values are checked before a run; always the first ones, so that no result
# depends on the number of members
PILOT = 4096
ALLOWED = "needs anti_damping = true under [run]"


def check_histogram(one: Histogram, given: Sequence[Any]) -> None:
    """Raise SceneError if a histogram names no observable, or a wrong component.

    given : the observables of the scene, with their numbers
    """
    table = "observables.histogram"
    if any(is_opaque(x) and word_of_observable(x) == one.name for x in given):
        return
    known = [name for name in (*OBSERVABLES, *own(given)) if name != "work"]
    if one.name not in known:
        raise unknown(table, "of", one.name, "observable", known)
    count = size(named(given, one.name).dims)
    if (count > 1) != one.of.endswith("]") or one.component >= count:
        rule = f"{one.name} has no components"
        if count > 1:
            rule = f"{one.name} has {count} components: give one, as in {one.name}[{count}]"
        raise SceneError(table, "of", one.of, rule)


def limits(effect: Effect | type[Effect], name: str, driven: bool) -> tuple[float, float]:
    """(least, largest) value of a parameter. driven : whether damping may be negative"""
    low, high = facts(effect).limits.get(name, (-np.inf, np.inf))
    return (0.0 if low == -np.inf and facts(effect).damps and not driven else low), high


def outside(effect: Effect, low: float, high: float) -> str:
    """The rule that a parameter outside its limits breaks."""
    if low == high:  # of a hidden parameter
        return "is filled in, not given"
    more = ""
    if low == 0.0 and facts(effect).damps:
        more = f"; below 0 it drives the body, which {ALLOWED}"
    return f"must lie between {low:g} and {high:g}{more}"
