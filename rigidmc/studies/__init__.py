"""Studies: each turns a scene into a Dataset that answers one question about it.

A study is a folder with one record: a `Study` of `rigidmc.studies.framework.study`, at the end of
`study.py`. The record defines the function that users call, its command, run directory, resume,
cost estimate and generic tests; its entry below makes it known to the rest of the package.
docs/contributing.md has the recipe. `picture.py` draws the study; only it imports matplotlib.

Reading order: `framework` (the record is in `framework/study`); `ftle`, the shortest study; then
`basins`, `sensitivity`, `frequencies`, `section` (members of a design, by `framework/members`),
`gradient` (members with derivatives), `stability_map` (parameters against measures), `rare`,
`multilevel` and `lyapunov` (tasks, by `framework/tasks`), `propagate` (derivatives of one member
beside an ensemble), `accuracy`, `stress` (integrators against truths), `linearise` (steady
motions), `fit` (parameters from measured motion) and `design` (what a fit to a measurement yet to
be made would show), which `framework/work` computes in one call.
Five files are verbs, not studies: `until` (grow an ensemble until a measure is known), `totals`
(keep only sums over the members), `reweight` (a finished ensemble with other distributions),
`exact` (compare one top with its formula), `bits` (compare CPUs and GPUs).

Two promises never change: an answer carries its interval, or says why it has none; and it is the
same for any number of threads, batches and restarts.
"""

from importlib import import_module
from typing import Any

# {name: help text of its command}; help pages and indexes use it without importing a study
STUDIES = {
    "accuracy": "Measure the time that accuracy costs for a scene: run every integrator with a"
    " range of steps, compare with the truth, and list the cheapest integrator and step for each"
    " accuracy.",
    "basins": "Measure how accurately a start must be known to predict where it ends: the fraction"
    " of starts whose end changes under small perturbations, for each size of the perturbation,"
    " and the dimension of the boundary between basins of attraction. With -o RUN/ the members go"
    " to a run directory, which survives a kill.",
    "design": "Compare measurements before you make them: how precisely each start, duration and"
    " sensor shows a parameter, and how far it decides whether an event occurs.",
    "fit": "Fit parameters of a scene to measured motion: every body and start that the data allow,"
    " with intervals that residuals widen where the model leaves something out.",
    "frequencies": "Compute the frequencies in the motion of each member, and the change of the"
    " first one between the two halves of the time, which distinguishes regular motion from chaos."
    " With -o RUN/ the members go to a run directory, which survives a kill.",
    "ftle": "Compute how much a small change of each start has grown at the end (finite-time"
    " Lyapunov exponents): a field whose ridges are stable manifolds, the boundaries between kinds"
    " of motion. With -o RUN/ the members go to a run directory, which survives a kill.",
    "gradient": "Differentiate means and quantiles over an ensemble by parameters of the scene,"
    " with intervals; probabilities, counts and events by the likelihood ratio, if the parameter is"
    " one of a distribution. It reports what chaos makes useless. With -o RUN/ the members go to a"
    " run directory, which survives a kill.",
    "linearise": "Find the steady motions of a scene (rotations about principal axes, an upright or"
    " hanging top, regular precession, a satellite at rest in its orbit) and their stability:"
    " eigenvalues of the linearised motion, growth rates and periods. With --along it follows them"
    " along a parameter and lists the bifurcations.",
    "lyapunov": "Compute the whole spectrum of Lyapunov exponents of each member, and the chaos"
    " indices SALI and GALI_k, by derivatives of the motion. With -o RUN/ the members go to a run"
    " directory, which survives a kill.",
    "multilevel": "Estimate a mean of a noisy scene to a given width, the error of the step"
    " included: nearly all members use the steps of the scene, which may be long, and few use"
    " shorter steps with the same noise (multilevel Monte Carlo). The narrower the interval, the"
    " more it saves: for a top, plain members take 2 times as long at +- 0.001 rad/s, and 10 times"
    " at +- 0.0001 (python -m bench rare). With -o RUN/ batches of members go to a run directory,"
    " which survives a kill.\n\nExit code 5 if the width is not reached: because of --most, or in"
    " an unfinished run.",
    "propagate": "Propagate a covariance to every save, linearly, by derivatives of the motion; and"
    " compare it with the covariance of an ensemble: the fraction that linearity misses. Uncertain"
    " are the distributions of the scene, or --wrt with --deviations.",
    "rare": "Estimate the probability of a rare event, with an interval: by adaptive multilevel"
    " splitting if effects are random, by subset simulation if starts, bodies or effects are drawn."
    " With -o RUN/ the repetitions go to a run directory, which survives a kill.",
    "section": "Show the structure of phase space in a Poincare section: the states of the members"
    " wherever a quantity crosses a value, or once per period. With -o RUN/ the members go to a run"
    " directory, which survives a kill: `rigidmc section RUN/ --at WHERE` evaluates it.",
    "sensitivity": "Find the uncertain parameters of a scene that matter: the fraction of a"
    " measure's variance that each causes alone, and together with the others (Sobol indices), with"
    " intervals. With -o RUN/ the members go to a run directory, which survives a kill:"
    " `rigidmc sensitivity RUN/ --of MEASURE` evaluates it.",
    "stability_map": "Map a measure of the motion over two parameters of a scene, with replicas and"
    " a confidence interval for every pixel. With -o MAP/ the map is a run directory, which"
    " survives a kill: `rigidmc map MAP/` draws its finished part.",
    "stress": "Run hard cases on this machine, each against its bound; or assess how far your own"
    " scene can be trusted. Exit code 4 if something fails.",
}


def load_study(name: str) -> Any:
    """Return the `Study` with a name of STUDIES: the variable of that name in its `study.py`.

    The return type is Any: `framework` reads STUDIES, and imports must not be circular.
    """
    return getattr(import_module(f"rigidmc.studies.{name}.study"), name)
