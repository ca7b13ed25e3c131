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

Returns
-------
xarray.Dataset
    `value` with `low` and `high`; `sampling` and `bias`, the half-width from each alone, whose
    squares add up; over level steps, members, mean and variance of the corrections; over round
    the width so far and its cost

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
>>> found = rm.multilevel(scene, "mean(l2_final) +- 0.1", integrator="strang", t_end=2, dt=0.5)
>>> bool(found.low < 3.0 * (1.0 - np.exp(-2.0)) < found.high)
True
"""

import math
import warnings
from collections.abc import Mapping, Sequence
from typing import Any

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
from rigidmc.scene.recording import make_recording
from rigidmc.scene.sampling import refuse_indexed
from rigidmc.scene.scene import Scene
from rigidmc.statistics.measures import save_for_measures
from rigidmc.studies.framework.options import Example, Options, confidence_option, option
from rigidmc.studies.framework.study import Study
from rigidmc.studies.framework.tasks import Tasks
from rigidmc.studies.multilevel.corrections import Level, Plain, cheapest_plain
from rigidmc.studies.multilevel.levels import (
    CHUNK,
    TASKS,
    LevelSetup,
    MultilevelGoal,
    MultilevelState,
    state_after,
    sums,
)
from rigidmc.studies.until import goal

BATCH = 8192  # members of a task, and of a level at first
MEMBER = 8 * 32  # bytes: values of the fine and of the coarse path


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
    until = str(options.until)
    scene = _showing(_with_steps(scene), until).with_run(first=0)
    scene = scene.with_run(every=scene.run.t_end)
    request: dict[str, Any] = {
        "until": until,
        "most": options.most,
        "batch": options.batch,
        "confidence": options.confidence,
    }
    refuse_count(request["batch"], "members of a batch", MEMBER, "use a smaller batch")
    run = prepare_scene(scene)
    make_setup(run, **request)
    # no notes on long steps: the study corrects for these
    for note in run.scene_notes:
        warnings.warn(note, SceneWarning, stacklevel=3)
    return scene, request


def make_setup(
    run: PreparedRun, until: str, most: int, batch: int, confidence: float
) -> tuple[LevelSetup, MultilevelGoal]:
    """Return (common setup of the tasks, goal of the study); OptionError."""
    scene = run.scene
    known = {**variables_of(scene), **saved_variables(scene.effects, make_recording(scene))}
    wanted = goal(until, known)
    if wanted.measure.kind != "mean" or wanted.measure.given is not None:
        rule = "has corrections that do not become small: use mean(NAME) over all members"
        raise OptionError(rule, at="run.until", value=until)
    order = min(scene.integrator.order, 2 if any(map(is_random, scene.effects)) else 8)
    request = LevelSetup(scene, wanted.measure, run.plan.grid.steps, batch)
    return request, MultilevelGoal(until, wanted, order, confidence, float(most))


def compute_levels(
    run: PreparedRun,
    request: runs.Request,
    numbers: Sequence[int],
    threads: int,
    device: str | None,
) -> list[runs.TaskArrays]:
    """Compute batches of levels and return their sums."""
    return sums(make_setup(run, **request)[0], numbers, threads, device)


def next_batches(
    run: PreparedRun, request: runs.Request, found: dict[int, runs.TaskArrays]
) -> list[int]:
    """Return the next batches."""
    now = state_after(*make_setup(run, **request), found)
    if now.line:
        say(now.line)
    return now.next


def cost_of(run: PreparedRun, request: runs.Request, numbers: Sequence[int]) -> float:
    """Return the member-steps of batches."""
    levels, known = (number // TASKS for number in numbers), make_setup(run, **request)[0]
    return sum(known.batch * Level(i, known.steps << i).price for i in levels)


def reduce(
    run: PreparedRun,
    request: runs.Request,
    found: dict[int, runs.TaskArrays],
    options: MultilevelOptions,
) -> xr.Dataset:
    """Return the Dataset of the finished rounds; FileError if the first is not finished."""
    known = make_setup(run, **request)
    now = state_after(*known, found)
    if now.found is None:
        missing = count_text(
            len(now.next), "task of the first round is", "tasks of the first round are"
        )
        rule = f"{missing} missing: resume it first"
        raise FileError(rule, at="run")
    if now.short:
        text = f"{request['until']} is not reached: {now.short}"
        warnings.warn(text, SceneWarning, stacklevel=3)
    return dataset(*known, now)


def _with_steps(scene: Scene) -> Scene:
    """Return the scene; SceneError unless its members are independent and its step is fixed."""
    run = scene.run
    if run.points != "independent":
        rule = "the levels of a study require independent members"
        raise SceneError(rule, at="run.points", value=run.points)
    if run.turn is not None:
        raise SceneError("a level has a fixed step: give dt", at="run.turn", value=run.turn)
    if run.integrator in ("auto", "closed"):
        rule = "levels require the steps of one integrator: name it"
        raise SceneError(rule, at="run.integrator", value=run.integrator)
    refuse_indexed(scene.model, "every level draws its own members")
    return scene


def _showing(scene: Scene, until: str) -> Scene:
    """Return the scene that saves only the variables of a measure."""
    names = (*default_names(scene.observables), *own(scene.observables))
    finals = tuple(name for name in names if f"{name}_final" in until)
    shown: Scene = save_for_measures(scene.with_run(save=finals, keep="final"), [until])
    return shown


def dataset(request: LevelSetup, target: MultilevelGoal, now: MultilevelState) -> xr.Dataset:
    """Return the Dataset of a study with progress `now`, whose first round has ended."""
    levels, rounds, found = now.levels, now.rounds, now.found
    assert found is not None
    name, order, scene = request.measure.result.name, target.order, request.scene
    known = {**variables_of(scene), **saved_variables(scene.effects, make_recording(scene))}
    units = known[name].attrs["units"]
    of_levels = {
        "steps": ([one.steps for one in levels], "steps of the fine paths", "1"),
        "dt": ([scene.run.t_end / one.steps for one in levels], "step of the fine paths", "s"),
        "members": ([one.members for one in levels], "members counted", "1"),
        "flagged": ([one.flagged for one in levels], "flagged members, left out", "1"),
        "mean": ([one.mean for one in levels], "mean of the corrections", units),
        "error": ([one.error for one in levels], "its standard error", units),
        "variance": (
            [one.variance for one in levels],
            "variance of the corrections",
            square_units(units),
        ),
        "price": ([one.price for one in levels], "cost of a member, in steps", "1"),
    }
    variables: dict[str, Any] = {
        key: ("level", values, {"long_name": text, "units": of})
        for key, (values, text, of) in of_levels.items()
    }
    half = found.half
    numbers = {
        "value": (found.value, "the mean"),
        "low": (found.value - half, "lower end of its interval"),
        "high": (found.value + half, "upper end of its interval"),
        "sampling": (found.sampling, "half-width from sampling alone"),
        "bias": (found.bias, "half-width from the error of the step alone"),
    }
    for key, (value, text) in numbers.items():
        variables[key] = ((), value, {"long_name": text, "units": units})
    about = {"long_name": "half-width so far", "units": units}
    variables["half"] = ("round", [h for _, h in rounds], about)
    variables["cost"] = ("round", [c for c, _ in rounds], {"long_name": "cost so far, in steps"})
    attrs = {
        "title": scene.title,
        "measure": request.measure.text,
        "until": target.text,
        "reached": int(half <= target.goal.half_at(found.value)),
        "missing": len(now.next),
        "confidence": target.confidence,
        "order": order,
        "order_seen": found.order,
        "variance_order_seen": found.variance_order,
        "scene": scene.dumps(),
    }
    return xr.Dataset(variables, {"level": [one.number for one in levels]}, attrs)


def read_levels(study: xr.Dataset) -> list[Level]:
    """Return the levels of a study."""
    names = "level", "steps", "members", "flagged", "mean", "variance"
    each = zip(*(study[name].values.tolist() for name in names), strict=True)
    return [Level(i, steps, n, f, m, v * (n - 1.0)) for i, steps, n, f, m, v in each]


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
    spent = (study.members + study.flagged) * study.price
    for i in range(study.sizes["level"]):
        one = study.isel(level=i)
        lines.append(
            f"  {int(one.level):5d} {int(one.steps):9,d} {float(one['dt']):10.4g}"
            f" {int(one.members):14,d} {float(one['mean']):+12.5g} +- {float(one.error):8.2g}"
            f" {float(one.variance):10.3g} {100 * float(spent[i] / spent.sum()):10.1f} %"
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
        start, next_batches, compute_levels, cost_of, reduce,
        is_growing=True, together=CHUNK // BATCH,
    ),
    table=table,
    picture="multilevel_levels",
    settings=("integrator", "dt", "t_end", "seed", "dtype"),
    scene_text="a scene, its file, or the name of a shipped scene, usually with a random effect;"
    " its step is that of the first level",
    source="the run directory of an existing study",
    outcome=outcome,
    example=Example("brownian_rotor", {"until": "mean(energy_final) +- 10 %"}, {"t_end": 1e-4}),
)  # fmt: skip
