"""Fit parameters of a scene to measured motion.

Each residual is r = (data - model)/sigma, with the noise sigma of its channel. Trials minimise the
sum of r^2 by Levenberg-Marquardt, all in lockstep: bodies from the balance of angular momentum, and
random ones. Every minimum that differs is an answer.

Intervals come from the derivatives J of the residuals at the best answer, and from the covariance R
of the residuals: white noise, and a model error that lasts from sample to sample, as large as the
residuals show it to be (`rigidmc.studies.fit.uncertainty`)::

    C = (J^T J)^-1 J^T R J (J^T J)^-1

Drag is always tried, and other stock torques where residuals are correlated. C is the mean over the
laws that the data do not exclude, with the squares of their shifts.

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
A racket tossed with a phone. Rates show ratios of moments, as long as no torque is known:

>>> racket = rm.Scene.load("tennis_racket", {"effects.quadratic_drag.drag": 1e-5})
>>> free = "body.moments,start.omega,effects.quadratic_drag.drag"
>>> study = rm.fit(racket, "toss", free, nuisances="bias,alignment", trials=20)
>>> study.ratio.sel(over="body.moments.3").values.round(2).tolist()
[0.07, 0.94, 1.0]
"""

import math
import re
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from rigidmc.engine.machine import threads_available
from rigidmc.errors import OptionError, unknown
from rigidmc.files.outputs import Path, write_bytes
from rigidmc.processes.progress import say
from rigidmc.results.labels import count_text, units_text
from rigidmc.scene.scene import Scene
from rigidmc.studies.fit.answers import best_of, contenders, upright
from rigidmc.studies.fit.dataset import AXES, VARIABLES, dataset_of
from rigidmc.studies.fit.missing import candidates
from rigidmc.studies.fit.problem import LOSSES, FitProblem
from rigidmc.studies.fit.records import read_columns_option
from rigidmc.studies.fit.setup import make_problem, records_of
from rigidmc.studies.fit.solve import Solution, minimise, polish
from rigidmc.studies.fit.starts import make_starts
from rigidmc.studies.fit.streams import NUISANCES, Array, Stream
from rigidmc.studies.fit.suspicions import examine
from rigidmc.studies.fit.uncertainty import SEEN, assess
from rigidmc.studies.fit.visible import in_words, seen
from rigidmc.studies.framework.members import refuse_noise
from rigidmc.studies.framework.options import Names, Options, Words, confidence_option, option
from rigidmc.studies.framework.study import Example, OutputFile, Study
from rigidmc.studies.framework.work import Direct

MOST_FINER = 64  # steps, times that of the rates: a nutation is 64 times as fast as they
MOST_REFINED = 6  # fits, each with the noise and jitter that the one before shows
RESOLVED = 0.1  # of the noise: it changes no parameter by more than a tenth of its deviation
MOST_ANSWERS = 4  # printed besides the best: a screen has 24 lines


class DataOptions(Options):
    """The options of the picture of `fit`."""

    picture: str = option(
        "data",
        "kind of picture: data, with the fitted motion and residuals, or corner",
        metavar="KIND",
    )
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


def read_loss(value: Any, at: str) -> str:
    """Return the name of a loss; OptionError."""
    if value not in LOSSES:
        raise unknown("loss", LOSSES, at=at, value=value, error=OptionError)
    return str(value)


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
    free: Names | None = option(
        None,
        "parameters to fit, e.g. body.moments,start.omega,effects.gravity.g",
        missing="is missing: the parameters to fit, e.g. body.moments,start.omega",
    )
    columns: Any = option(
        None,
        "columns of an observable and their unit, e.g. omega=gx,gy,-gz:deg/s",
        metavar="NAME=A,B,C[:UNIT]",
        type=Words,
        reader=read_columns_option,
        kind="mapping or str",
    )
    time: str | None = option(None, "column of the times, NAME or NAME:UNIT")
    rate: float | None = option(
        None, "samples a second, of a table without times", above=0.0, unit="1/s"
    )
    split: str | None = option(None, "column whose values are separate records of the body")
    between: Words | None = option(
        None,
        "interval of times that is a record, e.g. 0.9:1.4",
        metavar="FROM:TO",
        reader=read_intervals,
    )
    noise: Any = option(
        None,
        "standard deviation of the readings, e.g. omega=0.002; by default from third differences",
        metavar="NAME=NUMBER",
        type=Words,
        reader=lambda value, name: value,
        kind="mapping or str",
    )
    nuisances: Names | None = option(
        None, f"unknown properties of the sensors, of {', '.join(NUISANCES)}", metavar="NAME,..."
    )
    loss: str = option(
        "linear", "cost of outliers: squares (linear), or less (huber, cauchy)", reader=read_loss
    )
    each: Names | None = option(None, "free parameters that differ between records, beside [start]")
    trials: int = option(100, "first guesses from which the fit begins")
    confidence: float = confidence_option("confidence of the intervals")


def is_resolved(problem: FitProblem, finer: FitProblem, x: Array) -> bool:
    """Return whether half the step changes the residuals at x by less than their noise."""
    residuals = problem.jacobian(x)[0]
    change = residuals - finer.jacobian(x)[0]
    # of exact data, whose noise is rounding, by less than a tenth of the residuals
    allowed = RESOLVED * max(1.0, float(np.std(residuals)))
    return not np.std(change) > allowed  # nan if the motion is flagged: no step helps


def solve_finely(
    problem: FitProblem, make: Callable[[int], FitProblem], x: Array
) -> tuple[FitProblem, Solution, int, int]:
    """Return (problem, where the trials x end, the best of them, divisor of the step) with steps of
    which the halves give the same residuals: a rotor or a spring moves a body faster than its rates
    show.

    make : divisor -> the problem with steps divided by it
    """
    finer, at = 1, x[0]
    while True:
        half = make(2 * finer)
        if 2 * finer <= MOST_FINER and not is_resolved(problem, half, at):
            problem, finer = half, 2 * finer
            continue
        solution = upright(problem, minimise(problem, x))
        solution = polish(problem, solution, contenders(problem, solution))
        best = best_of(problem, solution)
        at = solution.x[best]
        if finer >= MOST_FINER or is_resolved(problem, half, at):
            return problem, solution, best, finer


def compute(scene: Scene, options: FitOptions, threads: int | None, progress: Any) -> xr.Dataset:
    """Return the Dataset of the study."""
    refuse_noise(scene.effects)
    columns, threads = options.columns or {}, threads or threads_available()
    intervals: Any = options.between or ()
    source = options.data, columns, options.time, options.split, intervals, options.rate
    records, notes = examine(scene, records_of(scene, *source), options.nuisances or ())
    for line in notes if progress else ():
        say(line)

    def make(moved: Scene, more: Sequence[str] = (), finer: int = 1) -> FitProblem:
        free, own = (*(options.free or ()), *more), options.each or ()
        nuisances = options.nuisances or ()
        return make_problem(
            moved, free, own, records, options.noise, nuisances, threads, finer, options.loss,
            streams,
        )  # fmt: skip

    streams: tuple[Stream, ...] = ()
    problem = make(scene)
    x = make_starts(problem.parameters, problem.streams, options.trials, scene.run.seed)
    if progress:
        first = seen(problem.sums(x[:1]).matrix[0])
        for line in in_words(problem.parameters, x[0], first):
            say(line)
    for more in reversed(range(MOST_REFINED)):
        problem, solution, best, finer = solve_finely(problem, lambda n: make(scene, finer=n), x)
        at, x = solution.x[best], solution.x
        newer = problem.refined(at) if more else ()
        if not newer:
            break
        streams = newer
        problem = make(scene)
    found, cost = assess(problem, at), float(solution.sums.cost[best])
    torques = candidates(scene, problem, at, cost, partial(make, finer=finer), found.error.is_seen)
    made = dataset_of(scene, problem, solution, best, found, torques, options.confidence)
    return made.assign_attrs(notes="\n".join(notes))


def table(study: xr.Dataset) -> list[str]:
    """Return the study as lines of text."""
    a, records = study.attrs, int(study.record.max())
    lines = [
        f"{a['title']}: {a['residuals']:,} readings"
        + f" of {records} records" * (records > 1)
        + f", {count_text(study.sizes['parameter'], 'parameter')},"
        f" residuals {a['reduced_chi_square'] ** 0.5:.3g} times their noise"
    ]
    lines += [f"  {text}" for key in ("notes", "unseen") for text in a[key].splitlines()]
    rows = [("parameter", "value", "std. dev.", "unit"), *_rows(study)]
    if np.isinf(study.deviation.values[_is_moment(study)]).any():
        for i in range(2):
            value, deviation = study.ratio.values[i, 2], study.ratio_deviation.values[i, 2]
            rows.append((f"{AXES[i]}/{AXES[2]}", *in_digits(value, deviation), ""))
    for name, size, width in zip(
        study.sensor.values, study.jitter.values, study.jitter_deviation.values, strict=True
    ):
        if width > 0.0:
            rows.append((f"{name}.jitter", *in_digits(size, width), "s"))
    widths = [max(map(len, column)) for column in list(zip(*rows, strict=True))[:3]]
    for name, value, deviation, unit in rows:
        line = f"  {name:{widths[0]}}  {value:>{widths[1]}}  {deviation:>{widths[2]}}  {unit}"
        lines.append(line.rstrip())
    return lines + _other_answers(study) + _missing(study)


def _is_moment(study: xr.Dataset) -> NDArray[np.bool_]:
    return np.array([name in AXES for name in study.parameter.values])


def in_digits(value: float, deviation: float) -> tuple[str, str]:
    """Write a value with the digits that its standard deviation leaves, and the deviation."""
    if not 0.0 < deviation < math.inf:
        return f"{value:.4g}", "not shown" if deviation > 0.0 else "0"
    leading = math.floor(math.log10(abs(value) or deviation)) - math.floor(math.log10(deviation))
    digits = min(15, max(0, leading) + 2)
    return f"{value:#.{digits}g}".rstrip("."), f"{deviation:.2g}"


def _rows(study: xr.Dataset) -> Iterator[tuple[str, str, str, str]]:
    """Yield the rows of the table of parameters; a number of each record is one row for all."""
    families: dict[str, list[int]] = {}
    for i, name in enumerate(study.parameter.values):
        families.setdefault(re.sub(r"\[\d+\]", "", str(name)), []).append(i)
    values, deviations = study.value.values[0], study.deviation.values
    for name, some in families.items():
        unit = units_text(str(study.unit.values[some[0]]))
        if len(some) == 1:
            yield (name, *in_digits(values[some[0]], deviations[some[0]]), unit)
        else:
            least, largest = values[some].min(), values[some].max()
            width = in_digits(largest, deviations[some].max())[1]
            yield f"{name} ({len(some)} records)", f"{least:.3g} to {largest:.3g}", width, unit


def _other_answers(study: xr.Dataset) -> list[str]:
    """Return lines about further answers, with the parameters of all records."""
    lines, names = list[str](), [str(name) for name in study.parameter.values]
    for i in range(1, study.sizes["answer"])[:MOST_ANSWERS]:
        cost, least = study.cost.values[[i, 0]]
        texts = [
            f"{name} {value:.4g}"
            for name, value in zip(names, study.value.values[i], strict=True)
            if not name.startswith("start.") and "[" not in name
        ]
        lines.append(f"  another answer, cost {cost:.4g} beside {least:.4g}: {', '.join(texts)}")
    if study.sizes["answer"] - 1 > MOST_ANSWERS:
        lines.append(f"  {study.sizes['answer'] - 1 - MOST_ANSWERS} more answers in the Dataset")
    return lines


def _missing(study: xr.Dataset) -> list[str]:
    """Return lines about what the model leaves out."""
    a = study.attrs
    if not a["lasting_gain"] > SEEN:
        return []
    lines = [
        f"  residuals are correlated over {a['lasting_time']:.2g} s: the model leaves something"
        " out; the standard deviations allow for it"
    ]
    for i, gain in enumerate(study.gain.values[:2]):
        if gain > 0.0:
            name, setting, free = (
                str(study[key].values[i]) for key in ("torque", "setting", "torque_parameter")
            )
            lines.append(f"  {name} gains {gain:.4g} in ln likelihood; to fit it, too, add")
            lines.append(f'    --set "{setting}" --free ...,{free}')
    return lines


def save_scene(study: xr.Dataset, path: Path, force: bool) -> bool:
    """Write the fitted scene."""
    write_bytes(path, str(study.attrs["fitted"]).encode(), force)
    return True


fit = Study(
    name="fit",
    text=__doc__,
    options=FitOptions,
    work=Direct(compute, "True prints what the data show; a function has no effect"),
    table=table,
    variables=VARIABLES,
    picture="pictures",
    picture_options=DataOptions,
    files={"scene": OutputFile("scenes", "write the fitted scene (.toml)", save_scene)},
    scene_text="a scene, its file, or the name of a shipped scene: the body and its torques, with"
    " first guesses of the free parameters",
    example=Example(
        "tennis_racket",
        {"data": "toss", "free": "body.moments,start.omega", "trials": 40, "nuisances": "bias"},
        {},
    ),
)
