"""Estimate a mean without the error of the step, by multilevel Monte Carlo.

The mean over paths of many steps is the mean over paths of few steps plus the means of
corrections::

    E[X_L] = E[X_0] + sum over l of E[X_l - X_(l-1)]

X_l is the measured quantity of a member after n 2^l steps; n is the number of steps of the scene.
The two paths of a correction have the same start and the same noise, so that its variance falls as
the square of the step, and few members suffice. For an error eps the cost is of order eps^-2,
instead of eps^-2.5 with a single step of an integrator of order 2. The study adds levels until the
error of the step, estimated from the last corrections, contributes little to the interval, which
includes it. Formulas are in `rigidmc.studies.multilevel.corrections`.
Source: Giles, Oper. Res. 56 (2008) 607.

{parameters}

{returns}

Raises
------
OptionError
    for a measure that is not a mean, a width that costs more than `most`, and a measure whose
    error falls too slowly with the step
SceneError
    for a scene without a fixed step, and for a step so long that members are flagged

Warns
-----
SceneWarning
    if the study stops at `most` before it reaches the width

Examples
--------
The squared momentum of a free body in a bath that starts without spin:

>>> bath = rm.Bath(gamma=0.5, kT=1.0)
>>> scene = rm.Scene(rm.Body((1.0, 1.0, 1.0)), bath, rm.Start(omega=(0.0, 0.0, 0.0)))
>>> study = rm.multilevel(scene, "mean(l2_final) +- 0.1", integrator="strang", t_end=2, dt=0.5)
>>> bool(study.low < 3.0 * (1.0 - np.exp(-2.0)) < study.high)
True
"""

import math
import warnings
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from rigidmc.errors import FileError, OptionError, SceneError, SceneWarning
from rigidmc.physics.effects.protocol import is_random
from rigidmc.physics.observables import default_names, own, square_units
from rigidmc.processes.progress import say
from rigidmc.results.labels import count_text, with_units
from rigidmc.results.variables import saved_variables, variables_of
from rigidmc.runs.directory import tasks as runs
from rigidmc.runs.prepare import PreparedRun, prepare_scene
from rigidmc.runs.resources import refuse_count
from rigidmc.scene.sampling import refuse_indexed
from rigidmc.scene.scene import Scene
from rigidmc.scene.settings import Run
from rigidmc.statistics.measures import save_for_measures
from rigidmc.studies.framework.options import Options, confidence_option, option
from rigidmc.studies.framework.study import Example, Study
from rigidmc.studies.framework.tasks import Tasks
from rigidmc.studies.framework.variables import StudyVariable, make_dataset
from rigidmc.studies.multilevel.corrections import Level, MultilevelEstimate, Plain, cheapest_plain
from rigidmc.studies.multilevel.levels import (
    CHUNK,
    TASKS,
    MultilevelSetup,
    MultilevelState,
    state_after,
    sums,
)
from rigidmc.studies.until import goal

BATCH = 8192  # members of a task, and of a level at first
MEMBER = 8 * 32  # bytes: values of the fine and of the coarse path
VARIABLES = (
    StudyVariable("steps", "level", "1", "steps of the fine paths"),
    StudyVariable("dt", "level", "s", "step of the fine paths"),
    StudyVariable("members", "level", "1", "members counted"),
    StudyVariable("flagged", "level", "1", "flagged members, left out"),
    StudyVariable("mean", "level", str, "mean of the corrections"),
    StudyVariable("error", "level", str, "its standard error"),
    StudyVariable("variance", "level", square_units, "variance of the corrections"),
    StudyVariable("price", "level", "1", "cost of a member, in steps"),
    StudyVariable("value", "", str, "the mean"),
    StudyVariable("low", "", str, "lower end of its interval"),
    StudyVariable("high", "", str, "upper end of its interval"),
    StudyVariable("sampling", "", str, "half-width from sampling alone"),
    StudyVariable("bias", "", str, "half-width from the error of the step alone"),
    StudyVariable("half", "round", str, "half-width so far"),
    StudyVariable("cost", "round", "", "cost so far, in steps"),
)


class MultilevelOptions(Options):
    """The options of `multilevel`."""

    until: str | None = option(
        None,
        'a mean and its width: "mean(energy_final) +- 0.001", "mean(omega_mean[1]) +- 1 %"',
        more="the width is the half-width of the interval; NAME_final is an observable at the end,"
        " NAME_mean its average over time",
        metavar="MEASURE",
        is_new=True,
        missing='a new study needs a mean and its width, as in "mean(energy_final) +- 1 %"',
    )
    most: int = option(
        10**12,
        "largest cost, in member-steps; by default 1e12",
        more="the start and end of a member count as 24 steps",
        is_new=True,
    )
    batch: int = option(
        BATCH,
        "members that a level starts with, and that are added at once",
        least=2,
        is_new=True,
        in_command=False,
    )
    confidence: float = confidence_option("confidence level of the interval", is_new=True)


def start(
    scene: Scene, options: MultilevelOptions, settings: Mapping[str, Any]
) -> tuple[Scene, dict[str, Any]]:
    """Return (the scene of a study, its request); give the notes on the scene as warnings."""
    request = {**vars(options), "until": str(options.until)}
    _check_run(scene.run)
    refuse_indexed(scene.model, "every level draws its own members")
    # the scene saves only the variables of the measure
    names = (*default_names(scene.observables), *own(scene.observables))
    finals = tuple(name for name in names if f"{name}_final" in request["until"])
    saves = {"save": finals, "keep": "final", "first": 0, "every": scene.run.t_end}
    scene = save_for_measures(scene.with_run(**saves), [request["until"]])
    refuse_count(options.batch, "members of a batch", MEMBER, "use a smaller batch")
    run = prepare_scene(scene)
    make_setup(run, **request)
    # no notes on long steps: the study corrects for these
    for note in run.scene_notes:
        warnings.warn(note, SceneWarning, stacklevel=3)
    return scene, request


def make_setup(
    run: PreparedRun, until: str, most: int, batch: int, confidence: float
) -> MultilevelSetup:
    """Return the common setup of the tasks; OptionError."""
    scene, wanted = run.scene, goal(until, _variables(run.scene))
    if wanted.measure.kind != "mean" or wanted.measure.given is not None:
        rule = "has corrections that do not become small: use mean(NAME) over all members"
        raise OptionError(rule, at="run.until", value=until)
    # `exact` has the order inf, for which the weight f/(f - 1) of the last level would be nan
    order = min(scene.integrator.order, 2 if any(map(is_random, scene.effects)) else 8)
    steps = run.plan.grid.steps
    return MultilevelSetup(scene, until, wanted, order, confidence, steps, batch, float(most))


def _variables(scene: Scene) -> dict[str, Any]:
    """Return the variables that the measure may name."""
    return {**variables_of(scene), **saved_variables(scene.effects, scene.recording)}


def next_batches(
    run: PreparedRun, request: runs.Request, found: dict[int, runs.TaskArrays]
) -> list[int]:
    """Return the next batches."""
    now = state_after(make_setup(run, **request), found)
    if now.line:
        say(now.line)
    return now.next


def cost_of(run: PreparedRun, request: runs.Request, numbers: Sequence[int]) -> float:
    """Return the member-steps of batches."""
    setup = make_setup(run, **request)
    return sum(setup.batch * setup.empty_level(number // TASKS).price for number in numbers)


def reduce(
    run: PreparedRun,
    request: runs.Request,
    found: dict[int, runs.TaskArrays],
    options: MultilevelOptions,
    threads: int,
) -> xr.Dataset:
    """Return the Dataset of the finished rounds; FileError if the first is not finished."""
    setup = make_setup(run, **request)
    now = state_after(setup, found)
    if now.estimate is None:
        tasks = "task of the first round is", "tasks of the first round are"
        rule = f"{count_text(len(now.next), *tasks)} missing: resume it first"
        raise FileError(rule, at="run")
    if now.short:
        text = f"{setup.text} is not reached: {now.short}"
        warnings.warn(text, SceneWarning, stacklevel=3)
    return dataset(setup, now, now.estimate)


def _check_run(run: Run) -> None:
    """Raise SceneError unless the members are independent and their step is fixed."""
    if run.points != "independent":
        rule = "the levels of a study require independent members"
        raise SceneError(rule, at="run.points", value=run.points)
    if run.turn is not None:
        raise SceneError("a level has a fixed step: give dt", at="run.turn", value=run.turn)
    if run.integrator in ("auto", "closed"):
        rule = "levels require the steps of one integrator: name it"
        raise SceneError(rule, at="run.integrator", value=run.integrator)


def dataset(
    setup: MultilevelSetup, now: MultilevelState, estimate: MultilevelEstimate
) -> xr.Dataset:
    """Return the Dataset of a study with progress `now`, whose first round has ended."""
    levels, half = now.levels, estimate.half
    names = "steps", "members", "flagged", "mean", "error", "variance", "price"
    values: dict[str, Any] = {name: [getattr(level, name) for level in levels] for name in names}
    values["dt"] = [setup.scene.run.t_end / level.steps for level in levels]
    values |= {name: getattr(estimate, name) for name in ("value", "sampling", "bias")}
    values |= {"low": estimate.value - half, "high": estimate.value + half}
    values |= zip(("cost", "half"), np.transpose(now.rounds), strict=True)
    attrs = {
        "measure": setup.goal.measure.text,
        "until": setup.text,
        "reached": int(half <= setup.goal.half_at(estimate.value)),
        "missing": len(now.next),
        "confidence": setup.confidence,
        "order": setup.order,
        "order_seen": estimate.order,
        "variance_order_seen": estimate.variance_order,
    }
    units = _variables(setup.scene)[setup.goal.measure.result.name].attrs["units"]
    ordered = {variable.name: values[variable.name] for variable in VARIABLES}
    numbers = {"level": [level.number for level in levels]}
    return make_dataset(VARIABLES, ordered, numbers, attrs, units)


def read_levels(study: xr.Dataset) -> list[Level]:
    """Return the levels of a study."""
    names = "level", "steps", "members", "flagged", "mean", "variance"
    rows = zip(*(study[name].values.tolist() for name in names), strict=True)
    return [Level(i, steps, n, f, m, v * (n - 1.0)) for i, steps, n, f, m, v in rows]


def plain_members(study: xr.Dataset, half: float) -> Plain:
    """Return the cheapest plain members for an interval of this half-width."""
    return cheapest_plain(read_levels(study), study.attrs["order"], half, study.attrs["confidence"])


def table(study: xr.Dataset) -> list[str]:
    """Return the study as lines of text."""
    attrs, cost = study.attrs, float(study.cost[-1])
    v = {name: float(study[name]) for name in ("value", "low", "high", "sampling", "bias")}
    step = with_units("step", study["dt"].attrs["units"])
    lines = [
        attrs["title"],
        f"  {attrs['measure']} = {v['value']:.8g}, {100 * attrs['confidence']:g} % between"
        f" {v['low']:.8g} and {v['high']:.8g}:",
        f"  +- {v['sampling']:.2g} by sampling, {v['bias']:.2g} by the step",
        f"  {'level':>5s} {'steps':>9s} {step:>10s} {'members':>14s}"
        f" {'correction':>24s} {'variance':>10s} {'of the cost':>12s}",
    ]
    levels = read_levels(study)
    costs = [level.cost for level in levels]
    for level, dt, error, spent in zip(
        levels, study["dt"].values, study.error.values, costs, strict=True
    ):
        lines.append(
            f"  {level.number:5d} {level.steps:9,d} {dt:10.4g} {int(level.members):14,d}"
            f" {level.mean:+12.5g} +- {error:8.2g} {level.variance:10.3g}"
            f" {100 * spent / sum(costs):10.1f} %"
        )
    if not math.isnan(attrs["order_seen"]):
        lines.append(
            f"  the last corrections fall with order {attrs['order_seen']:.2f} in the step"
            f" (expected: {attrs['order']:g}), their variance with order"
            f" {attrs['variance_order_seen']:.2f}"
        )
    single = plain_members(study, float(study.half[-1]))
    lines.append(
        f"  cost: {cost:.3g} steps; {single.members:.2g} plain members of {single.steps:,} steps"
        f" cost {single.cost:.2g}, {single.cost / cost:.2g} times as much"
    )
    if single.cost < cost:
        lines.append("  for this width, plain members cost less: use `rigidmc run --until`")
    if not attrs["reached"]:
        lines.append(f"  {attrs['until']} is not reached")
    if attrs["missing"]:
        tasks = count_text(attrs["missing"], "task is", "tasks are")
        lines.append(f"  {tasks} missing: continue with `rigidmc resume`")
    if left := int(study.flagged.sum()):
        lines.append(f"  flagged members, left out: {left:,}")
    return lines


def outcome(study: xr.Dataset) -> str:
    """Return "done" if the interval has the requested width, else "incomplete"."""
    return "done" if study.attrs["reached"] else "incomplete"


multilevel = Study(
    name="multilevel",
    text=__doc__,
    options=MultilevelOptions,
    work=Tasks(
        start, next_batches,
        lambda run, request, *how: sums(make_setup(run, **request), *how), cost_of, reduce,
        is_growing=True, together=CHUNK // BATCH,
    ),
    table=table,
    variables=VARIABLES,
    picture="multilevel_levels",
    settings=("integrator", "dt", "t_end", "seed", "dtype"),
    scene_text="a scene, its file, or the name of a shipped scene, usually with a random effect;"
    " its step is that of the first level",
    source="the run directory of an existing study",
    outcome=outcome,
    example=Example("brownian_rotor", {"until": "mean(energy_final) +- 10 %"}, {"t_end": 1e-4}),
)  # fmt: skip
