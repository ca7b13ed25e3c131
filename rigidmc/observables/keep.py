"""How much is kept of what is saved: the larger the ensemble, the less one wants of each member.

full       omega(time, axis, member), every save
thinned    omega_thinned(thinned_time, ...), one save of `thin`, and the last
summary    omega_min, omega_max, omega_mean, omega_variance over all steps, see `rigidmc.observables.running`
final      omega_final(axis, member), the last save
none       nothing

Whatever is kept of the others, of members that are flagged every save is: omega_flagged(time, axis, flagged), and flagged_member tells whose.
"""

import numpy as np

from rigidmc.errors import SceneError, unknown
from rigidmc.observables import OBSERVABLES, RUNNING
from rigidmc.observables.running import STATISTICS

WORDS = ("none", "final", "summary", "thinned", "full")


def check_keep(keep):
    """SceneError for a setting `keep` that cannot be."""
    named = keep if isinstance(keep, dict) else {None: keep}
    for name, word in named.items():
        key = "keep" if name is None else f"keep.{name}"
        if name is not None and name not in OBSERVABLES:
            raise unknown("run", key, name, "observable at save times", OBSERVABLES)
        if word not in WORDS:
            raise unknown("run", key, word, "way to keep it", WORDS)
        if word == "summary" and name is not None and f"{name}_mean" not in RUNNING:
            raise SceneError(
                "run", key, word, "it has no summary over the steps: keep it final, thinned or full"
            )


def kept(keep, saved):
    """{name: word} of the saved observables; one that has no summary is kept to the end where all are summarised."""
    found = {name: keep if isinstance(keep, str) else keep.get(name, "full") for name in saved}
    return {
        name: "final" if word == "summary" and f"{name}_mean" not in RUNNING else word
        for name, word in found.items()
    }


def summaries(kept):
    """Names of the running statistics that stand for what is summarised."""
    return tuple(
        f"{name}_{word}" for name, how in kept.items() if how == "summary" for word in STATISTICS
    )


def thinned(count, thin):
    """Indices of the saves that are kept of what is thinned."""
    return np.unique(np.append(np.arange(0, count, thin), count - 1))
