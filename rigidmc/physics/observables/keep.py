"""How much of what is saved is kept: the larger the ensemble, the less one wants of each member.

full       omega(time, axis, member), every save
thinned    omega_thinned(thinned_time, ...), every `thin`-th save, and the last
summary    omega_min, omega_max, omega_mean and so on, see `rigidmc.physics.observables.statistics`
final      omega_final(axis, member), the last save
none       nothing

Of flagged members every save is kept, whatever is kept of the others: omega_flagged(time, axis,
flagged), and flagged_member has their indices.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigidmc.errors import SceneError, unknown
from rigidmc.physics.observables import OBSERVABLES, is_opaque, labelled, own, statistics
from rigidmc.physics.observables.statistics import STATISTICS

WORDS = ("none", "final", "summary", "thinned", "full")
Keep = str | Mapping[str, str]  # one word for all observables, or {name: word}
Values = dict[str, NDArray[Any]]


def check_keep(keep: Keep, given: Sequence[Any] = ()) -> None:
    """Raise SceneError if the setting `keep` names an unknown observable or an unknown word.

    given : the observables of the scene, with their numbers
    """
    opaque = [label for label, one in labelled(given) if is_opaque(one)]
    names, summed = (*OBSERVABLES, *own(given), *opaque), statistics(given)
    named = {None: keep} if isinstance(keep, str) else keep
    for name, word in named.items():
        key = "keep" if name is None else f"keep.{name}"
        if name is not None and name not in names:
            raise unknown("run", key, name, "observable at save times", names)
        if word not in WORDS:
            raise unknown("run", key, word, "way to keep it", WORDS)
        if word == "summary" and name is not None and f"{name}_mean" not in summed:
            rule = "it has no summary over the steps: keep it final, thinned or full"
            raise SceneError("run", key, word, rule)


def kept(keep: Keep, saved: Iterable[str], given: Sequence[Any] = ()) -> dict[str, str]:
    """{name: word} of the saved observables.

    If all are summarised, an observable that has no summary keeps its last save.
    """
    summed = statistics(given)
    words = {name: keep if isinstance(keep, str) else keep.get(name, "full") for name in saved}
    return {
        name: "final" if word == "summary" and f"{name}_mean" not in summed else word
        for name, word in words.items()
    }


def summaries(kept: Mapping[str, str]) -> tuple[str, ...]:
    """Names of the running statistics of the observables that are summarised."""
    return tuple(
        f"{name}_{statistic}"
        for name, word in kept.items()
        if word == "summary"
        for statistic in STATISTICS
    )


def thinned(count: int, thin: int) -> NDArray[np.intp]:
    """Indices of the saves that a thinned observable keeps, of `count` saves."""
    return np.unique(np.append(np.arange(0, count, thin), count - 1))
