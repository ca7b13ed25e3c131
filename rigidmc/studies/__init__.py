"""The studies: questions about a scene, a folder each, and what each of them answers.

A study is one record, a `Study` of `rigidmc.studies.framework.study`, at the end of `study.py` in
its folder. Its function, its command, its run directory and its tests are made of it, and the rest
of the package knows of it by its entry below: docs/contributing.md has the recipe. Reading order:
`framework/study` (the record), `ftle/study` (the shortest one), `framework/members` and
`framework/tasks` (what computes).
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rigidmc.studies.framework.study import Study

# {name: what its command says}; help pages and indexes are made of it, and import no study
STUDIES = {
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
}


def load_study(name: str) -> "Study":
    """The record of a study of STUDIES: the value of its name in its file."""
    study: Study = getattr(import_module(f"rigidmc.studies.{name}.study"), name)
    return study
