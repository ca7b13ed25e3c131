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

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import xarray as xr

from rigidmc.errors import OptionError, warn
from rigidmc.files.outputs import Path, write_bytes
from rigidmc.results.labels import count_text
from rigidmc.runs.directory.tasks import Request, TaskArrays
from rigidmc.runs.prepare import PreparedRun
from rigidmc.scene.parameters import solid_by_mass
from rigidmc.scene.scene import Scene
from rigidmc.studies.fit.answers import best_of, doubts, grown, merged, upright
from rigidmc.studies.fit.dataset import VARIABLES, dataset_of
from rigidmc.studies.fit.draws import DRAWS, draw, save_groups
from rigidmc.studies.fit.missing import candidates
from rigidmc.studies.fit.options import FitOptions, PictureOptions
from rigidmc.studies.fit.posterior import SAMPLERS, package
from rigidmc.studies.fit.prior import Prior
from rigidmc.studies.fit.problem import FitProblem
from rigidmc.studies.fit.records import Record
from rigidmc.studies.fit.setup import make_problem, read_noise, records_of
from rigidmc.studies.fit.solve import Solution, minimise, polish
from rigidmc.studies.fit.starts import DRAWN, make_starts
from rigidmc.studies.fit.streams import Array
from rigidmc.studies.fit.suspicions import examine
from rigidmc.studies.fit.table import table
from rigidmc.studies.fit.uncertainty import assess
from rigidmc.studies.fit.visible import in_words, seen
from rigidmc.studies.framework.members import refuse_noise
from rigidmc.studies.framework.study import Example, OutputFile, Study
from rigidmc.studies.framework.tasks import Tasks

MOST_FINER = 64  # steps, times that of the rates: a nutation is 64 times as fast as they
MOST_REFINED = 6  # fits, each with the noise of the one before: measured 1, 2, with jitter 4, 5
RESOLVED = 0.1  # of a deviation; measured at rates' steps 2e-6 to 5e-3
SLOW = 4  # times finer steps, from which on a warning says so
UNRESOLVED = "steps of half the length change the motion of this answer: all its numbers are wrong"
MOST_DRAWN = 16  # times DRAWN, most trials of a task: a trial of a larger task costs as much


def divisor(make: Callable[[int], FitProblem], x: Array, finer: int) -> int:
    """Return by what to divide the step, `finer` or more, so that its half shifts no parameter at x
    by more than RESOLVED of its deviation: by no more than the norm of the change of residuals over
    their noise; 0 if MOST_FINER is too little.

    make : divisor -> the problem with steps divided by it
    """
    left = make(finer).residuals_of(x[None])
    while finer <= MOST_FINER:
        half = make(2 * finer).residuals_of(x[None])
        # Residuals of exact data, whose noise is rounding, set the deviations. nan: no step helps.
        if not np.linalg.norm(half - left) > RESOLVED * max(1.0, float(np.std(left))):
            return finer
        left, finer = half, 2 * finer
    return 0


def solve_finely(make: Callable[[int], FitProblem], x: Array, at: Array) -> tuple[Solution, int]:
    """Return (where trials x end, divisor of the step) with steps that resolve the motion of a
    trial and of the best end: a rotor or a spring moves a body faster than its rates show.

    make : as in `divisor`
    """
    finer, more = 1, divisor(make, at, 1)
    while True:
        # An end that no step resolves is a false minimum: finer steps would only take longer.
        finer = more or finer
        if finer >= SLOW:
            warn(f"steps {finer} times finer than the readings show: it takes {finer} times longer")
        problem = make(finer)
        solution = upright(problem, minimise(problem, *grown(problem, x)))
        more = divisor(make, solution.x[best_of(problem, solution)], finer)
        if more in (0, finer):
            return solution, finer


def refuse_draws(options: FitOptions, loss: str) -> None:
    """Raise OptionError for options of a posterior that is not asked for, or has no likelihood."""
    if options.pool and not options.posterior:
        raise OptionError("needs a posterior: --posterior nuts", at="pool", value=options.pool)
    if options.posterior and loss != "linear":
        raise OptionError("needs the loss linear: others have no likelihood", at="posterior")
    if options.posterior:
        package(SAMPLERS[options.posterior][0])


def start(
    scene: Scene, options: FitOptions, settings: Mapping[str, Any]
) -> tuple[Scene, dict[str, Any]]:
    """Return (the scene, the request: the readings, and what is fitted to them)."""
    refuse_noise(scene.effects)
    refuse_draws(options, options.loss)
    plain = scene
    if solid_by_mass(scene.body):
        plain = replace(scene, body=replace(scene.body, shape=()))
        if any("moments" in name for name in options.free or ()):
            scene = plain  # fitted moments leave the solid, which is the first guess
    where: Any = options.between or ()
    source = options.data, options.columns or {}, options.time, options.split, where, options.rate
    records, notes = examine(plain, records_of(scene, *source), options.nuisances or ())
    named = {"free": options.free, "own": options.each, "nuisances": options.nuisances}
    asked: dict[str, Any] = {"loss": options.loss, **{k: list(x or ()) for k, x in named.items()}}
    problem = make_problem(scene, records=records, noise=options.noise, threads=1, **asked)
    if problem.residuals < 2:
        raise OptionError("holds one reading, which leaves nothing to judge a fit by", at="data")
    run = problem.run
    batch = DRAWN * min(max(options.trials // (4 * DRAWN), 1), MOST_DRAWN)
    return scene, {
        "records": [
            [one.name, *({n: x.tolist() for n, x in part.items()} for part in one[1:4])]
            for one in records
        ],
        "asked": {**asked, "noise": read_noise(run, options.noise)},
        "notes": notes, "trials": options.trials, "batch": batch,
    }  # fmt: skip


def maker(request: Request, threads: int) -> Callable[..., FitProblem]:
    """Return the function that makes the problem of a request, for a scene and other keywords of
    `make_problem`."""

    def arrays(part: Mapping[str, Any]) -> dict[str, Array]:
        return {name: np.array(x) for name, x in part.items()}

    records = [
        Record(name, arrays(t), arrays(values), arrays(wheel))
        for name, t, values, wheel in request["records"]
    ]
    return partial(make_problem, records=records, threads=threads, **request["asked"])


def solve_batches(
    run: PreparedRun, request: Request, numbers: Sequence[int], threads: int, device: str | None
) -> list[TaskArrays]:
    """Return where the trials of some batches end."""
    if device not in (None, "cpu"):
        raise OptionError("fits are computed on the CPU", at="device", value=device)
    make, seed, found = maker(request, threads), run.scene.run.seed, list[TaskArrays]()
    problem = make(run.scene)
    at = make_starts(problem, 1, seed)[0]
    for first in (number * request["batch"] for number in numbers):
        count = min(request["batch"], request["trials"] - first)
        x = make_starts(problem, count, seed, first)
        solution, finer = solve_finely(lambda n: make(run.scene, finer=n), x, at)
        ends = {"ends": solution.ends, "settled": solution.is_settled * solution.ends}
        found.append({"x": solution.x, **ends, "finer": np.array([finer])})
    return found


def reduce(
    run: PreparedRun, request: Request, done: dict[int, TaskArrays], options: FitOptions,
    threads: int,
) -> xr.Dataset:  # fmt: skip
    """Return the Dataset of the ends of the trials."""
    refuse_draws(options, request["asked"]["loss"])
    x, ends, settled, finer = (
        np.concatenate([done[i][name] for i in sorted(done)])
        for name in ("x", "ends", "settled", "finer")
    )
    steps = int(finer.max())
    make = partial(maker(request, threads), finer=steps)
    problem = make(run.scene)
    solution = merged(problem, Solution(x, problem.sums(x), settled > 0, ends))
    if not np.isfinite(solution.sums.cost[0]):
        rule = "the motion of every trial is flagged: begin nearer to the body, or with a spin"
        raise OptionError(rule, at="free", value=",".join(request["asked"]["free"]))
    for more in reversed(range(MOST_REFINED)):
        solution = merged(problem, polish(problem, solution))
        streams = problem.refined(solution.x[0]) if more else ()
        if not streams:
            break
        make = partial(make, streams=streams)
        problem = make(run.scene)
        solution = minimise(problem, solution.x, solution.ends)
    at, free = solution.x[0], request["asked"]["free"]
    found = assess(problem, at)
    torques = candidates(
        run.scene, problem, at, found, lambda scene, more: make(scene, free=[*free, *more])
    )
    made = dataset_of(run.scene, problem, solution, found, torques, options.confidence)
    if options.posterior:
        prior = Prior(problem.parameters, at, found.shown, options.pool or ())
        seed, units = run.scene.run.seed, made.unit.values
        how = options.posterior, options.chains, options.draws, seed, units
        drawn = draw(problem, found.error, [*solution.x], prior, *how)
        made = made.merge(drawn, combine_attrs="no_conflicts")
    is_sound = divisor(lambda n: make(run.scene, finer=n), at, steps) == steps
    doubt = doubts(problem, solution, found)
    notes = "\n".join([*request["notes"], *doubt, *[UNRESOLVED][is_sound:]])
    return made.assign_attrs(notes=notes, trials=request["trials"], settled=int(settled.sum()))


class Fits(Tasks):
    """The work of a fit: tasks that are batches of trials."""

    def price(self, run: PreparedRun, request: Request, *more: Any) -> str:
        """Return what the readings show before any fit, as text."""
        problem = maker(request, 1)(run.scene)
        x = make_starts(problem, 1, run.scene.run.seed)
        shown = seen(problem.sums(x).matrix[0], problem.parameters.slopes(x[0]))
        first = f"{count_text(request['trials'], 'trial')}, {problem.residuals:,} readings"
        return "\n".join([first, *request["notes"], *in_words(problem.parameters, x[0], shown)])


def save_scene(study: xr.Dataset, path: Path, force: bool) -> bool:
    """Write the fitted scene."""
    write_bytes(path, str(study.attrs["fitted"]).encode(), force)
    return True


def save_page(study: xr.Dataset, path: Path, force: bool) -> bool:
    """Write the page with the body beside its readings."""
    from rigidmc.studies.fit.page import save_page as save  # views take .3 s

    return save(study, path, force)


fit = Study(
    name="fit",
    text=__doc__,
    options=FitOptions,
    work=Fits(
        start,
        lambda run, request, done: [
            i for i in range(-(-request["trials"] // request["batch"])) if i not in done
        ],
        solve_batches,
        lambda run, request, numbers: 0.0,
        reduce,
    ),
    settings=("seed",),
    source="the run directory of an existing study",
    table=table,
    variables=(*VARIABLES, *DRAWS),
    picture="pictures",
    picture_options=PictureOptions,
    files={
        "scene": OutputFile("scenes", "write the fitted scene (.toml)", save_scene),
        "page": OutputFile("pages", "write the body beside its readings (.html)", save_page),
        "arviz": OutputFile("netCDF files", "write draws as groups of ArviZ (.nc)", save_groups),
    },
    scene_text="a scene, its file, or the name of a shipped scene: the body and its torques, with"
    " first guesses of the free parameters",
    example=Example(
        "tennis_racket",
        {"data": "toss", "free": "body.moments,start.omega", "trials": 70, "nuisances": "bias"},
        {},
    ),
)
