"""Estimate the probability of a rare event.

The method leads members towards the event level by level. A probability p then needs some
ln(1/p) times the members of a common event, instead of 1/p times.

Noisy scenes: adaptive multilevel splitting. It drops the members farthest from the event and
branches others; the estimate is unbiased. Source: Cerou & Guyader, Stoch. Anal. Appl. 25
(2007) 417; Brehier et al., Ann. Appl. Probab. 26 (2016) 3559.

Scenes whose members differ only in their starts, bodies and effects: subset simulation. The
random numbers of the members walk towards the event; the estimate has a bias of the order
1/members, a few per cent of its interval. Source: Au & Beck, Probab. Eng. Mech. 16 (2001) 263.

In a scene with grids or tables, each member takes the row of a random member of the scene, and
walks or branches with it; p is the mean over all rows.

Both methods are repeated with successive seeds, starting with that of the scene. The interval is
that of the mean of a skewed distribution over the repetitions, see
`rigidmc.statistics.intervals.mean_of_skew`. If no member reaches the event, p is 0, and the upper
end is that of the same number of plain members without the event.

{parameters}

{returns}

Raises
------
OptionError
    if `of` is not an event or has no score, or for an impossible count

Warns
-----
SceneWarning
    as in `simulate`, and if the study finds no path to the event

Examples
--------
A disc thrown with a normal spin is 5 standard deviations fast with p = 2.9e-7:

>>> start = rm.Start(omega=(0.0, 0.0, rm.normal(0.0, 1.0)))
>>> scene = rm.Scene(rm.Body((1.0, 1.0, 2.0)), start=start)
>>> run = {"dt": 0.1, "t_end": 0.1, "members": 200, "repetitions": 8}
>>> study = rm.rare(scene, "p(omega_max[3] >= 5)", **run)
>>> bool(study.p_low < 2.87e-7 < study.p_high), bool(study.gain > 300)
(True, True)
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from scipy import stats

from rigidmc.engine.kernel import layout
from rigidmc.errors import OptionError
from rigidmc.inputs.amounts import read_count
from rigidmc.inputs.arrays import Array, Bools
from rigidmc.planning.initial import random_dimensions
from rigidmc.results.labels import count_text
from rigidmc.results.variables import variables_of
from rigidmc.runs.directory.tasks import Request, TaskArrays
from rigidmc.runs.prepare import PreparedRun
from rigidmc.runs.resources import refuse_count
from rigidmc.runs.segments import SegmentedRun
from rigidmc.scene.sampling import is_indexed, rows_to_run
from rigidmc.scene.scene import Scene
from rigidmc.statistics.intervals import mean_of_skew, probability
from rigidmc.studies.framework.options import Options, confidence_option, option
from rigidmc.studies.framework.study import Example, Study
from rigidmc.studies.framework.tasks import Tasks
from rigidmc.studies.framework.variables import StudyVariable, interval_of, make_dataset
from rigidmc.studies.rare.methods import FEWER, KEPT, KILLED, PARTS, descend, split
from rigidmc.studies.rare.score import is_noisy, make_score

WIDE = 1.0  # spread of the repetitions / their mean, above which the interval covers less
LEAST = 20  # members of a repetition: two of them pass a level
REPETITION = 4096  # bytes of the result of one, with its levels
METHODS = {True: "adaptive multilevel splitting", False: "subset simulation"}  # by is_noisy
VARIABLES = (
    StudyVariable("p", "", "1", "probability of {of}", has_interval=True),
    StudyVariable(
        "gain", "", "1", "member-steps of plain sampling for the same interval / of this study"
    ),
    StudyVariable("probability", "repetition", "1", "estimate of the repetition"),
    StudyVariable("member_steps", "repetition", "1", "steps of all members of the repetition"),
    StudyVariable("flagged", "repetition", "1", "flagged members"),
    StudyVariable(
        "below_target", "repetition", "1", "whether it stopped at the target, before the event"
    ),
    StudyVariable(
        "stuck", "repetition", "1",
        "whether it stopped before the event and the target: no member came nearer",
    ),
    StudyVariable("score", "repetition level", str, "level that members must pass"),
    StudyVariable("share", "repetition level", "1", "probability of passing the level"),
)  # fmt: skip


class RareOptions(Options):
    """The options of `rare`."""

    of: str | None = option(
        None,
        'event, such as "p(nutation_max >= 2)" or "p(passage_first < 60)"',
        more="p(NAME >= NUMBER) or p(NAME <= NUMBER), with a quantity that is monitored at every"
        " step; in a noisy scene, one that only grows",
        metavar="EVENT",
        is_new=True,
        missing='a new study needs an event, as in "p(flips >= 3)"',
    )
    target: float = option(
        1e-9,
        "the smallest probability that matters; by default 1e-9",
        more="a repetition stops below it",
        above=0.0,
        below=1.0,
        rule="expected a probability between 0 and 1",
        metavar="P",
        is_new=True,
    )
    members: int = option(1000, "members of each repetition; by default 1000", is_new=True)
    repetitions: int = option(16, "number of repetitions; by default 16", least=2, is_new=True)
    confidence: float = confidence_option("confidence level of the interval")


def start(
    scene: Scene, options: RareOptions, settings: Mapping[str, Any]
) -> tuple[Scene, dict[str, Any]]:
    """Return (the scene of a study, its request); OptionError if `of` is not an event or has no
    score."""
    of, target, repetitions = str(options.of), options.target, options.repetitions
    members = read_count(options.members, "members", LEAST)
    refuse_count(repetitions, "repetitions", REPETITION)
    refuse_count(members, "members", 4 * 8 * layout.EFFECTS, FEWER)
    moved, _ = make_score(scene, of)
    if not is_noisy(moved.effects) and not random_dimensions(moved.model):
        rule = "nothing is random: no effect has noise, and all parameters of the scene are fixed"
        raise OptionError(rule, at="scene")
    request: dict[str, Any] = {
        "of": of,
        "target": target,
        "members": members,
        "repetitions": repetitions,
    }
    if is_indexed(moved.model):  # members walk and branch with a row; there may be fewer rows
        rows: int = rows_to_run(moved.model, moved.run) or moved.run.members
        request["rows"], members = rows, min(members, rows)
    return moved.with_run(members=members), request


def doubts(study: xr.Dataset) -> list[str]:
    """Return the warnings if no repetition found a path to the event."""
    if float(study.p) > 0.0:
        return []
    return [f"{study.attrs['of']}: {why}" for why in _stuck(study)]


def cost_of(run: PreparedRun, request: Request, numbers: Sequence[int]) -> float:
    """Return the member-steps of repetitions for an event of probability `target`, to a factor of
    2: a level of splitting takes half a run, a level of subset simulation a whole one."""
    members, depth = request["members"], -math.log(request["target"])
    killed, part = (
        (KILLED, 0.5 * KILLED) if is_noisy(run.scene.effects) else (1.0 - KEPT, 1.0 - KEPT)
    )
    levels = depth / -math.log(1.0 - killed)
    return float(len(numbers) * members * (1.0 + part * levels) * run.plan.grid.steps)


def compute_repetitions(
    run: PreparedRun, request: Request, numbers: Sequence[int], threads: int, device: str | None
) -> list[TaskArrays]:
    """Compute repetitions and return their results."""
    moved, score = make_score(run.scene, request["of"])
    is_split, seed = is_noisy(moved.effects), run.scene.run.seed
    # without noise, a member has several score evaluations only for an event
    parts = PARTS if is_split or score.event is not None else 1
    results = []
    for number in numbers:
        # another scene: that of the event, with a seed for each repetition
        moving = SegmentedRun(moved.with_run(seed=seed + number), parts, threads, device)
        asked = score, request["members"], request["target"], request.get("rows")
        results.append((split if is_split else descend)(moving, *asked).numbers())
    return results


def reduce(
    run: PreparedRun, request: Request, found: dict[int, TaskArrays], options: RareOptions,
    threads: int,
) -> xr.Dataset:  # fmt: skip
    """Return the Dataset of the finished repetitions."""
    scene, confidence, numbers = run.scene, options.confidence, sorted(found)
    rows = [found[i] for i in numbers]
    p, steps = (np.array([float(row[name]) for row in rows]) for name in ("p", "steps"))
    deep = np.array([bool(row["deep"]) for row in rows])
    value, low, high = _interval(p, deep, request, confidence)
    depth = max(row["levels"].size for row in rows)
    levels, shares = np.full((2, len(rows), depth), np.nan)
    for row, level, share in zip(rows, levels, shares, strict=True):
        level[: row["levels"].size], share[: row["shares"].size] = row["levels"], row["shares"]
    moved, score = make_score(scene, request["of"])
    values = {
        "p": (value, low, high),
        "gain": _gain(run.plan.grid.steps, value, 0.5 * (high - low), steps.sum(), confidence),
        "probability": p,
        "member_steps": steps,
        "flagged": [int(row["flagged"]) for row in rows],
        "below_target": deep,
        "stuck": (p == 0.0) & ~deep,
        "score": score.sign * levels,
        "share": shares,
    }
    attrs = {
        "of": request["of"],
        "method": METHODS[is_noisy(scene.effects)],
        "target": request["target"],
        "members": request["members"],
        "wanted": request["repetitions"],
        "goal": score.sign * score.goal,
        "graded": "score" if score.event is not None else score.result.name,
        "confidence": confidence,
    }
    units = "1"
    if score.event is None:  # the score is a quantity of the motion, with its units
        units = variables_of(moved)[score.result.name].attrs.get("units", "1")
    return make_dataset(VARIABLES, values, {"repetition": numbers}, attrs, units)


def _interval(
    p: Array, deep: Bools, request: Request, confidence: float
) -> tuple[float, float, float]:
    """Return (mean over the repetitions, ends of its interval).

    Repetitions that stopped at the target count as 0 in the mean, and as the target in the upper
    end. If no member reached the event and not all repetitions stopped at the target, the upper
    end is at least that of the same number of plain members without the event.
    """
    value, low, high = mean_of_skew(p, confidence)
    high += float(deep.mean()) * request["target"]
    if value == 0.0 and not deep.all():
        members = request["members"] * p.size
        high = max(high, float(probability(0, members, confidence, "clopper-pearson").high))
    return value, max(low, 0.0), min(high, 1.0)


def _gain(each: int, p: float, half: float, steps: float, confidence: float) -> float:
    """Return the member-steps of plain sampling for the same interval, divided by `steps`: with n
    members its half-width is z (p (1 - p)/n)^(1/2).

    each : steps of a member
    """
    if not (p > 0.0 and half > 0.0 and math.isfinite(half)):
        return math.nan
    z = float(stats.norm.ppf(0.5 + 0.5 * confidence))
    plain = p * (1.0 - p) * (z / half) ** 2
    return plain * each / float(steps)


def _stuck(study: xr.Dataset) -> list[str]:
    """Explain repetitions that found no path to the event; [] if all found one or stopped at the
    target."""
    stuck, done = int(study.stuck.sum()), study.sizes["repetition"]
    if not stuck:
        return []
    if float(study.p) > 0.0:
        repetitions = count_text(done, "repetition")
        return [f"{stuck:,} of {repetitions} found no path to the event and count as 0"]
    levels = int(np.isfinite(study.score.values).any(axis=0).sum())
    why = "their members came no nearer" if levels else "all members score the same"
    return [
        f"found no path to the event: {why}, and the interval is that of plain members; use more"
        " members, or a quantity that measures the distance to the event better"
    ]


def table(study: xr.Dataset) -> list[str]:
    """Return the study as lines of text."""
    p, low, high = interval_of(study, "p")
    done, wanted = study.sizes["repetition"], int(study.attrs["wanted"])
    lines = [study.attrs["title"]]
    if study.below_target.values.all():
        lines.append(f"  {study.attrs['of']} is less than {study.attrs['target']:.3g}, the target")
    else:
        lines.append(f"  {study.attrs['of']} = {p:.4g} ({low:.3g} to {high:.3g})")
        lines += [f"  {why}" for why in _stuck(study)]
    steps = float(study.member_steps.sum())
    lines.append(
        f"  {study.attrs['method']}: {count_text(done, 'repetition')} of"
        f" {count_text(study.attrs['members'], 'member')},"
        f" at most {study.sizes['level']:,} levels, {steps:.3g} member-steps"
    )
    if math.isfinite(gain := float(study.gain)):
        lines.append(f"  plain sampling needs {gain:,.3g} times the member-steps for this interval")
    if p > 0.0 and done > 1 and float(study.probability.std(ddof=1)) > WIDE * p:
        lines.append(
            "  the repetitions spread by more than their mean, and few dominate it: use more"
            " members, or a quantity that measures the distance to the event better"
        )
    if done < wanted:
        missing = count_text(wanted - done, "repetition is", "repetitions are")
        lines.append(f"  {missing} missing: continue with `rigidmc resume`")
    if not study.below_target.values.all() and (deep := int(study.below_target.sum())):
        ended = count_text(deep, "repetition")
        lines.append(f"  {ended} stopped at the target: counted as 0")
    if flagged := int(study.flagged.sum()):
        lines.append(f"  flagged members, counted as far from the event: {flagged:,}")
    return lines


rare = Study(
    name="rare",
    text=__doc__,
    options=RareOptions,
    work=Tasks(
        start,
        lambda run, request, done: [i for i in range(request["repetitions"]) if i not in done],
        compute_repetitions,
        cost_of,
        reduce,
        notes=lambda run: run.notes,
        doubts=doubts,
    ),
    table=table,
    variables=VARIABLES,
    picture="rare_curve",
    settings=("integrator", "dt", "t_end", "tolerance", "seed", "dtype", "compensated"),
    source="the run directory of an existing study",
    example=Example(
        "dzhanibekov",
        {"of": "p(omega_max[1] >= 0.05)", "members": 64, "repetitions": 3, "target": 1e-6},
        {"t_end": 0.2},
    ),
)
