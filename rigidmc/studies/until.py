"""An ensemble that grows until a number is known as well as asked."""

import math
import re
import warnings
from typing import NamedTuple

import numpy as np

from rigidmc.errors import OptionError, SceneError, SceneWarning
from rigidmc.files.outputs import refuse_existing
from rigidmc.observables import OBSERVABLES
from rigidmc.runs.simulate import simulate
from rigidmc.scene.amounts import counted
from rigidmc.scene.quantities import rows
from rigidmc.storage.schema import member_variables
from rigidmc.studies.intervals import Interval, mean, probability
from rigidmc.studies.measures import Measure, measure, observing

FIRST = 8192  # members of the first look
MOST = 10_000_000
SURE = (
    1.05  # members above what the spread so far asks for: it is itself known to a few per cent only
)
_SIGN = re.compile(r"\s*(?:±|\+-|\+/-)\s*")
RULE = 'expected a measure and half the width of its interval, as in "p(flips >= 1) +- 0.001" or "mean(flip_wait) +- 0.1"'


class Goal(NamedTuple):
    """A measure that is to be known to +- `half` (of itself where `relative`)."""

    measure: Measure
    half: float
    relative: bool


def goal(text, variables):
    """The Goal of a text such as "p(flips >= 1) +- 0.001" or "mean(flip_wait) +- 1 %"; OptionError for what is none."""
    parts = _SIGN.split(text.strip())
    number = (
        re.fullmatch(r"((?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(%?)", parts[1])
        if len(parts) == 2
        else None
    )
    if number is None or not float(number[1]) > 0.0:
        raise OptionError("run", "until", text, RULE)
    return Goal(
        measure(parts[0], variables),
        float(number[1]) / (100.0 if number[2] else 1.0),
        bool(number[2]),
    )


def simulate_until(
    scene,
    until,
    most=MOST,
    confidence=0.95,
    threads=None,
    progress=None,
    output=None,
    force=False,
    **options,
):
    """(Dataset, Interval): an ensemble that grows until the interval of a measure is as narrow as asked, or has `most` members.

    until : "p(flips >= 1) +- 0.001", see `rigidmc.studies.measures`;  progress : a function of (members so far, the Interval)
    output, force, options : as of `rigidmc.simulate`

    It grows without the saves of a scene, in memory of some 100 bytes a member; where there are saves, or an output, the members are then run once
    more with them. They are those of a run of that size, to the bit: the first so many of the scene. How many is known to a few per cent from the
    spread of those before, so that few looks are taken.
    A SceneWarning says where it is not reached. Raises OptionError where what is asked needs more than `most` members by the first.
    """
    if options.get("members") is not None:
        rule = "there are as many members as it takes, `most` at most: give that"
        raise OptionError("run", "members", options["members"], rule)
    most = counted(most, "most")
    if output is not None:
        refuse_existing(output, force)
    scene = observing(scene.with_run(**options), [_SIGN.split(until)[0]])
    if scene.run.points != "independent":
        rule = f"an interval of {scene.run.points} points is not told by their spread: see rigidmc.randomised; use independent ones"
        raise SceneError("run", "points", scene.run.points, rule)
    lean = scene.with_run(save=tuple(name for name in scene.run.save if name not in OBSERVABLES))
    if (count := rows(*scene.quantities())) is not None:
        most = min(most, count - scene.run.first)
    wanted = goal(until, {name: v.dims for name, v in member_variables(lean, False).items()})
    values, good = np.empty(0), np.empty(0, bool)
    known, size, first = 0, min(FIRST, most), scene.run.first
    while True:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SceneWarning)
            piece = simulate(lean, members=range(first + known, first + size), threads=threads)
        values, good = (
            np.append(values, wanted.measure.values(piece)),
            np.append(good, piece.status.values == 0),
        )
        found = Interval(*map(float, wanted.measure.interval(values, good, confidence)))
        if progress is not None:
            progress(size, found)
        half = wanted.half * abs(found.value) if wanted.relative else wanted.half
        if goal_reached(until, found):
            break
        if known == 0 and not np.isfinite(found.value):
            raise OptionError(
                "run",
                "until",
                until,
                f"none of the first {size:,} members has a {wanted.measure.name}",
            )
        if known == 0 and half == 0.0:
            rule = f"is 0 of the first {size:,} members: no number of them brings it to a share of 0; give the width itself"
            raise OptionError("run", "until", until, rule)
        if size >= most:
            rule = f"{until} is not reached: {found.value:.6g} +- {found.half:.2g} by {size:,} members, which are all that may be"
            warnings.warn(rule, SceneWarning, stacklevel=2)
            break
        needed = FIRST * math.ceil(
            SURE * members_for(wanted.measure, found, size, half, confidence) / FIRST
        )
        if known == 0 and needed > most:
            rule = f"needs about {needed:,} members by the first {size:,} ({found.value:.4g} +- {found.half:.2g}), more than the limit of {most:,}"
            raise OptionError("run", "until", until, rule)
        known, size = size, min(most, max(needed, size + FIRST))
    told = {"until": until, "found": f"{found.value:.10g} in {found.low:.10g} to {found.high:.10g}"}
    return simulate(
        scene,
        members=range(first, first + size),
        threads=threads,
        output=output,
        force=force,
        attrs=told,
    ), found


def goal_reached(until, found):
    """Whether an Interval is as narrow as a text asks."""
    number = _SIGN.split(until.strip())[1].strip()
    half = abs(found.value) * float(number[:-1]) / 100.0 if number.endswith("%") else float(number)
    return bool(found.half <= half)


def members_for(measure, found, count, half, confidence):
    """How many members bring an interval to +- half, by what `count` of them gave."""
    if not (half > 0.0 and math.isfinite(found.half)):
        return 4 * count
    if measure.kind != "p":
        return count * (found.half / half) ** 2
    low, high = (
        count,
        count * max(1.0, found.half / half) ** 2 + 1.0,
    )  # near 0 and 1 the width falls as 1/n, not as its root
    while high - low > 0.01 * low:
        middle = 0.5 * (low + high)
        narrow = probability(found.value * middle, middle, confidence).half <= half
        low, high = (low, middle) if narrow else (middle, high)
    return high


def randomised(scene, text, members, randomisations=16, confidence=0.95, threads=None, **options):
    """The Interval of the mean of a measure over independent randomisations of its points: what Sobol points and Latin hypercubes need, whose members are
    not independent. Each has `members` members, and a seed of its own from that of the scene on; Student's t over their values."""
    scene = observing(scene.with_run(members=members, **options), [text])
    scene = scene.with_run(save=tuple(name for name in scene.run.save if name not in OBSERVABLES))
    asked = measure(text, {name: v.dims for name, v in member_variables(scene, False).items()})
    values = []
    for i in range(randomisations):
        piece = simulate(scene, seed=scene.run.seed + i, threads=threads)
        values.append(
            float(asked.interval(asked.values(piece), piece.status.values == 0, confidence).value)
        )
    return mean(np.array(values), confidence=confidence)
