"""Fit parameters of a scene to measured motion.

Each residual is r = (data - model)/sigma, with the noise sigma of its channel. Trials minimise the
sum of r^2 by Levenberg-Marquardt, all in lockstep: bodies from the balance of angular momentum, and
random ones. Every minimum that differs is an answer.

Intervals come from the derivatives J of the residuals at the best answer, with the variance s^2 of
a residual and the autocorrelation time tau of the residuals::

    C = tau s^2 (J^T J)^-1

tau is 1 for white noise. Real records show what the model leaves out (drag, time stamps): their
residuals are correlated, and the intervals are wider by sqrt(tau).

{parameters}

{returns}

Raises
------
OptionError
    for data that cannot be read, and for parameters that cannot be fitted
SceneError
    for a scene that cannot run

Examples
--------
A racket tossed with a phone; rates of a free body show ratios of its moments alone:

>>> free, nuisances = "body.moments,start.omega", "bias,alignment"
>>> study = rm.fit("tennis_racket", "toss", free, nuisances=nuisances, trials=40)
>>> study.ratio.sel(over="body.moments.3").values.round(2).tolist()
[0.07, 0.94, 1.0]
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr

from rigidmc.engine.machine import threads_available
from rigidmc.errors import OptionError
from rigidmc.processes.progress import say
from rigidmc.scene.scene import Scene
from rigidmc.studies.fit.answers import best_of, contenders
from rigidmc.studies.fit.dataset import VARIABLES, dataset_of
from rigidmc.studies.fit.missing import Candidate, candidates
from rigidmc.studies.fit.problem import FitProblem
from rigidmc.studies.fit.records import read_columns_option
from rigidmc.studies.fit.setup import make_problem, records_of
from rigidmc.studies.fit.solve import minimise, polish
from rigidmc.studies.fit.starts import make_starts
from rigidmc.studies.fit.streams import NUISANCES
from rigidmc.studies.fit.uncertainty import assess
from rigidmc.studies.fit.visible import in_words, seen
from rigidmc.studies.framework.members import refuse_noise
from rigidmc.studies.framework.options import Names, Options, Words, confidence_option, option
from rigidmc.studies.framework.study import Example, Study
from rigidmc.studies.framework.work import Direct


class DataOptions(Options):
    """The options of the picture of `fit`."""

    record: int | None = option(None, "the only record to draw, from 1; by default the first four")


def read_interval(text: str, at: str) -> tuple[float, float]:
    """Return an interval of time [s] of a text FROM:TO; OptionError."""
    try:
        low, high = map(float, text.split(":"))
    except ValueError:
        low = high = np.nan
    if not low < high:
        raise OptionError("expected FROM:TO in seconds, e.g. 0.9:1.4", at=at, value=text)
    return low, high


def read_intervals(value: Any, at: str) -> tuple[tuple[float, float], ...]:
    """Return intervals of time of texts, or of pairs of numbers; OptionError."""
    pairs = (value,) if isinstance(value, str) else value
    texts = (x if isinstance(x, str) else ":".join(map(repr, x)) for x in pairs)
    return tuple(read_interval(text, at) for text in texts)


class FitOptions(Options):
    """The options of `fit`."""

    data: Any = option(
        None,
        "the measurements: a CSV file, a mapping of columns, a DataFrame, or a Dataset",
        missing="is missing: the table of the measurements",
        reader=lambda value, name: value,
        metavar="DATA",
        type=Words,
        is_argument=True,
        kind="path_like or table",
    )
    free: Names = option(
        (),
        "parameters to fit, e.g. body.moments,start.omega,effects.gravity.g",
        missing="is missing: the parameters to fit, e.g. body.moments,start.omega",
    )
    columns: Any = option(
        None,
        "columns of an observable and their unit, e.g. omega=gx,gy,gz:deg/s",
        metavar="NAME=A,B,C[:UNIT]",
        type=Words,
        reader=read_columns_option,
        kind="mapping or str",
    )
    time: str | None = option(None, "column of the times")
    split: str | None = option(None, "column whose values are separate records of the body")
    between: Words | None = option(
        None,
        "interval of times that is a record, e.g. 0.9:1.4",
        metavar="FROM:TO",
        reader=read_intervals,
    )
    noise: Any = option(
        None,
        "standard deviation of the readings, e.g. omega=0.002; by default that of the residuals",
        metavar="NAME=NUMBER",
        type=Words,
        reader=lambda value, name: value,
        kind="mapping or str",
    )
    nuisances: Names | None = option(
        None, f"unknown properties of the sensors, of {', '.join(NUISANCES)}", metavar="NAME,..."
    )
    each: Names | None = option(
        None, "free parameters that differ between records, beside those of [start]"
    )
    trials: int = option(100, "first guesses from which the fit begins")
    confidence: float = confidence_option("confidence of the intervals")


def compute(scene: Scene, options: FitOptions, threads: int | None, progress: Any) -> xr.Dataset:
    """Return the Dataset of the study."""
    refuse_noise(scene.effects)
    columns, threads = options.columns or {}, threads or threads_available()
    intervals: Any = options.between or ()
    records = records_of(scene, options.data, columns, options.time, options.split, intervals)

    def make(moved: Scene, more: Sequence[str] = ()) -> FitProblem:
        free, own, nuisances = (*options.free, *more), options.each or (), options.nuisances or ()
        return make_problem(moved, free, own, records, options.noise, nuisances, threads)

    problem = make(scene)
    x = make_starts(problem.parameters, problem.streams, options.trials, scene.run.seed)
    if progress:
        first = seen(problem.sums(x[:1]).matrix[0])
        for line in in_words(problem.parameters, x[0], first):
            say(line)
    solution = minimise(problem, x)
    solution = polish(problem, solution, contenders(problem, solution))
    best = best_of(problem, solution)
    found, torques = assess(problem, solution.x[best]), list[Candidate]()
    if found.error.is_seen:
        cost = float(solution.sums.cost[best])
        torques = candidates(scene, problem, solution.x[best], cost, make)
    return dataset_of(problem, solution, best, found, torques, options.confidence)


def table(study: xr.Dataset) -> list[str]:
    """Return the study as lines of text."""
    a = study.attrs
    count, answers = study.sizes["parameter"], study.sizes["answer"]
    lines = [
        f"{a['title']}: {a['residuals']:,} readings, {count} parameters,"
        f" residuals {a['reduced_chi_square'] ** 0.5:.3g} times their noise"
    ]
    lines += [f"  {text}" for text in np.atleast_1d(a["unseen"])]
    for name, unit, value, deviation in zip(
        study.parameter.values, study.unit.values, study.value.values[0], study.deviation.values,
        strict=True,
    ):  # fmt: skip
        width = "not shown" if np.isinf(deviation) else f"+- {deviation:.2g}"
        lines.append(f"  {name:32s} {value:14.7g} {width:>12s} {unit}")
    if np.isfinite(study.ratio.values).all():
        pairs = ((0, 2), (1, 2))
        for i, j in pairs:
            value, deviation = study.ratio.values[i, j], study.ratio_deviation.values[i, j]
            lines.append(f"  I{i + 1}/I{j + 1} {value:.6g} +- {deviation:.2g}")
    if answers > 1:
        costs = ", ".join(f"{x:.4g}" for x in study.cost.values)
        lines.append(f"  {answers} answers, with the costs {costs}")
    for name, gain in zip(study.torque.values[:2], study.gain.values, strict=False):
        if gain > 0.0:
            lines.append(f"  the residuals suggest {name}: a gain of {gain:.4g} in ln likelihood")
    return lines


fit = Study(
    name="fit",
    text=__doc__,
    options=FitOptions,
    work=Direct(compute, "True shows a bar; a function has no effect"),
    table=table,
    variables=VARIABLES,
    picture="data_and_model",
    picture_options=DataOptions,
    scene_text="a scene, its file, or the name of a shipped scene: the body and its torques, with"
    " first guesses of the free parameters",
    example=Example(
        "tennis_racket",
        {"data": "toss", "free": "body.moments,start.omega", "trials": 40, "nuisances": "bias"},
        {},
    ),
)
