"""Studies: each takes a scene to a Dataset that answers one question about it.

A study is a folder, and one record: a `Study` of `rigidmc.studies.framework.study`, at the end of
`study.py`. The function that users call, its command, run directory, resume, price and generic
tests are made of it, and the rest of the package knows of it by its entry below:
docs/contributing.md has the recipe. `picture.py` draws it, and alone imports matplotlib.

Reading order: `framework` (the record is in `framework/study`); `ftle` as the shortest one, then
`basins`, `sensitivity`, `frequencies`, `section` (members of a design, by `framework/members`),
`stability_map` (parameters against measures), `rare` and `multilevel` (tasks, by
`framework/tasks`), `accuracy` and `stress` (integrators against truths, by `framework/direct`).
Three files are verbs, not studies: `until` (an ensemble grows until a measure is known),
`closed_form` (one top beside its formula), `bits` (processors compared).

What must never change: an answer carries its interval, or says why it has none; and it is the same
for any number of threads, batches and restarts.
"""

from importlib import import_module
from typing import Any

# {name: what its command says}; help pages and indexes are made of it, and import no study
STUDIES = {
    "accuracy": "What accuracy costs in time, for a scene: every integrator over a ladder of steps"
    " against the truth, and the cheapest integrator and step for each accuracy.",
    "basins": "How well a start has to be known to know where it ends: the share of starts that"
    " end otherwise if they change a little, by how little, and the dimension of the boundary"
    " between basins of attraction. With -o RUN/ the members are a run directory, which survives a"
    " kill.",
    "frequencies": "The frequencies of which the motion of each member is made, and how much the"
    " first of them changes from one half of the time to the other, which tells regular motion"
    " from chaos. With -o RUN/ the members are a run directory, which survives a kill.",
    "ftle": "How much a small change of each start has grown at the end (finite-time Lyapunov"
    " exponents): a field whose ridges are stable manifolds, which part one kind of motion from"
    " another. With -o RUN/ the members are a run directory, which survives a kill.",
    "multilevel": "A mean of a noisy scene to a width, the error of the step included: nearly all"
    " members make the steps of the scene, which may be long, and few make shorter ones with the"
    " same noise (multilevel Monte Carlo). It saves the more, the narrower the interval: of a top,"
    " plain members take 2 times as long at +- 0.001 rad/s, and 10 times at +- 0.0001 (python -m"
    " bench rare). With -o RUN/ batches of members are a run directory, which survives a"
    " kill.\n\nExit code 5 if the width is not reached: because of --most, or in a run that has not"
    " ended.",
    "rare": "How likely something is that almost never happens, with an interval: by adaptive"
    " multilevel splitting if effects are random, by subset simulation if starts, bodies or"
    " effects are drawn. With -o RUN/ the repetitions are a run directory, which survives a kill.",
    "section": "The structure of phase space: a Poincare section, the states of the members"
    " wherever a quantity passes a value, or once in a period. With -o RUN/ the members are a run"
    " directory, which survives a kill: `rigidmc section RUN/ --at WHERE` tells of it.",
    "sensitivity": "Which uncertain number of a scene matters: the share of a measure's variance"
    " that each causes alone, and in which it takes part (Sobol indices), with intervals. With -o"
    " RUN/ the members are a run directory, which survives a kill: `rigidmc sensitivity RUN/ --of"
    " MEASURE` tells of it.",
    "stability_map": "Map two parameters of a scene against what its members do, with replicas and"
    " a confidence interval for every pixel. With -o MAP/ the map is a run directory, which"
    " survives a kill: `rigidmc map MAP/` draws what is there.",
    "stress": "Hard cases on this machine, each against its bound; or how far your own scene can be"
    " trusted. Exit code 4 if something fails.",
}


def load_study(name: str) -> Any:
    """The `Study` of a name of STUDIES: the value of that name in its file.

    Its type is not told here: `framework` reads STUDIES, and no file imports one that imports it.
    """
    return getattr(import_module(f"rigidmc.studies.{name}.study"), name)
