"""Grow an ensemble until a measure has the requested accuracy."""

import math
import re
import warnings
from collections.abc import Callable
from os import PathLike
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from rigidmc.errors import OptionError, SceneError, SceneWarning
from rigidmc.files.outputs import refuse_existing
from rigidmc.inputs.amounts import read_count
from rigidmc.results.labels import count_text
from rigidmc.results.variables import variables_of
from rigidmc.runs.prepare import PreparedRun, prepare_scene
from rigidmc.runs.resources import refuse_count
from rigidmc.runs.simulate import simulate
from rigidmc.scene.model import Model
from rigidmc.scene.quantities import count_rows
from rigidmc.scene.sampling import is_sample, refuse_indexed
from rigidmc.scene.scene import Scene, takes_scene
from rigidmc.statistics.intervals import Estimate, Interval, mean, probability
from rigidmc.statistics.measures import Measure, Variables, measure, save_for_measures

FIRST = 8192  # members of the first round
MOST = 10_000_000
SURE = 1.05  # margin on the number of members: the spread is known to a few per cent only
_SIGN = re.compile(r"\s*(?:±|\+-|\+/-)\s*")
_WIDTH = re.compile(r"((?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(%?)")
RULE = (
    "expected a measure and half the width of its interval,"
    ' as in "p(flips >= 1) +- 0.001" or "mean(flip_wait) +- 1 %"'
)


class Goal(NamedTuple):
    """A measure with its target half-width `half`: absolute, or a fraction of the value if
    `relative`."""

    measure: Measure
    half: float
    relative: bool

    def half_at(self, value: float) -> float:
        """Return the target half-width for a value of the measure."""
        return self.half * abs(value) if self.relative else self.half


def goal(text: str, variables: Variables) -> Goal:
    """Parse the Goal of a text such as "p(flips >= 1) +- 0.001" or "mean(flip_wait) +- 1 %".

    variables : of a result;  raises OptionError if the text does not have this form
    """
    name, *ends = _SIGN.split(text.strip())
    width = _WIDTH.fullmatch(ends[0]) if len(ends) == 1 else None
    if width is None or not float(width[1]) > 0.0:
        raise OptionError(RULE, at="run.until", value=text)
    half = float(width[1]) / (100.0 if width[2] else 1.0)
    return Goal(measure(name, variables), half, bool(width[2]))


@takes_scene
def simulate_until(
    scene: Scene,
    until: str,
    most: int = MOST,
    confidence: float = 0.95,
    threads: int | None = None,
    progress: Callable[[int, Estimate], object] | None = None,
    output: str | PathLike[str] | None = None,
    force: bool = False,
    device: str | None = None,
    **options: Any,
) -> tuple[xr.Dataset, Estimate]:
    """Grow an ensemble until the interval of a measure is narrow enough.

    The ensemble grows without the saves of the scene and uses some 100 bytes of memory per member.
    The final ensemble then runs once with saves and output; it equals the first members of the
    scene, to the bit. The spread of the members so far predicts the number needed, to a few per
    cent, so few rounds suffice.

    Parameters
    ----------
    scene : Scene or path_like
        a scene, its file, or the name of a shipped scene
    until : str
        measure and half-width, such as "p(flips >= 1) +- 0.001"; see `rigidmc.statistics.measures`
    most : int, optional
        largest number of members
    confidence : float, optional
        confidence level of the interval
    threads : int, optional
        as in `simulate`
    progress : callable, optional
        a function of (members so far, the Estimate)
    output : path_like, optional
        as in `simulate`
    force : bool, optional
        as in `simulate`
    device : str, optional
        as in `simulate`
    **options : object
        as in `simulate`

    Returns
    -------
    result : xarray.Dataset
        the final ensemble, as from `simulate`
    interval : Estimate
        the measure: value, low, high; `without`, the fraction of members without a value

    Raises
    ------
    OptionError
        if the first round shows that the goal needs more than `most` members

    Warns
    -----
    SceneWarning
        if the goal is not reached

    Examples
    --------
    >>> scene = rm.Scene.load("dzhanibekov").with_run(dt=0.025, t_end=2.5)
    >>> ds, interval = rm.simulate_until(scene, "p(flips >= 1) +- 0.02")
    >>> interval.half <= 0.02
    True
    """
    if options.get("members") is not None:
        rule = "the goal decides the number of members; give their limit, `most`, instead"
        raise OptionError(rule, at="run.members", value=options["members"])
    most = read_count(most, "most")
    if output is not None:
        refuse_existing(output, force)
    scene = save_for_measures(scene.with_run(**options), [_SIGN.split(until)[0]])
    _refuse_no_sample(scene.model, scene.run.points, until)
    run = prepare_scene(without_saves(scene))  # for all rounds
    if (count := count_rows(*scene.model.quantities())) is not None:
        most = min(most, count - scene.run.first)
    sample = _Sample(run, goal(until, variables_of(run.scene)), confidence, threads, device)
    size, interval = sample.grow(until, most, progress)
    if not is_goal_reached(until, interval):
        reached = f"{interval.value:.6g} +- {interval.half:.2g} by {count_text(size, 'member')}"
        rule = f"{until} is not reached: {reached}, the most allowed"
        warnings.warn(rule, SceneWarning, stacklevel=2)
    ends = f"{interval.low:.10g} to {interval.high:.10g}{interval.lacking()}"
    result = simulate(  # the scene with its saves, which the rounds leave out
        scene,
        members=range(scene.run.first, scene.run.first + size),
        threads=threads,
        output=output,
        force=force,
        device=device,
        attrs={"until": until, "found": f"{interval.value:.10g} in {ends}"},
    )
    return result, interval


def _refuse_no_sample(model: Model, points: str, until: str) -> None:
    """Raise SceneError if the spread of members gives no interval, or the first members are not a
    sample."""
    if points != "independent":
        rule = f"the spread of {points} points gives no interval: see rigidmc.estimate_rqmc"
        raise SceneError(f"{rule}; use independent", at="run.points", value=points)
    if not is_sample(model):
        rule = "more members do not narrow the interval: nothing in the scene is drawn"
        raise OptionError(rule, at="run.until", value=until)
    refuse_indexed(model, "the first members have only its first values", tables=False)


def without_saves(scene: Scene) -> Scene:
    """Return the scene, saving only final values of its members, and no derivatives."""
    at_times = scene.recording.names
    save = tuple(name for name in scene.run.save if name not in at_times)
    lean: Scene = scene.with_run(save=save, wrt=())
    return lean


class _Sample(NamedTuple):
    """An ensemble that grows, and the goal of its measure."""

    run: PreparedRun
    goal: Goal
    confidence: float
    threads: int | None
    device: str | None

    def grow(
        self, until: str, most: int, progress: Callable[[int, Estimate], object] | None
    ) -> tuple[int, Estimate]:
        """Return (members, Estimate) when the goal is reached, or at `most` members."""
        values, who, asked = np.empty(0), np.empty(0, bool), self.goal.measure
        before, size, first = 0, min(FIRST, most), self.run.scene.run.first
        while True:
            with warnings.catch_warnings(action="ignore", category=SceneWarning):
                members = range(first + before, first + size)
                part = self.run.run(members=members, threads=self.threads, device=self.device)
            values = np.append(values, asked.values(part))
            who = np.append(who, asked.asks(part))
            interval = asked.interval(values, who, self.confidence).each(float)
            asked.refuse_unknown(interval)
            if progress is not None:
                progress(size, interval)
            if is_goal_reached(until, interval):
                return size, interval
            if asked.kind == "quantile" and interval.low == interval.until:
                rule = f"is later than {interval.until:g} s, the end of the run"
                raise OptionError(f"{rule}: give a longer t_end", at="run.until", value=until)
            if before == 0:
                _check_first(until, self.goal, interval, size)
            if size >= most:
                return size, interval
            half = self.goal.half_at(interval.value)
            needed = members_for(asked, interval, size, half, self.confidence)
            needed = FIRST * math.ceil(SURE * needed / FIRST)
            if before == 0 and needed > most:
                by = f"by the first {size:,} ({interval.value:.4g} +- {interval.half:.2g})"
                rule = f"needs about {needed:,} members {by}, more than the limit of {most:,}"
                raise OptionError(rule, at="run.until", value=until)
            before, size = size, min(most, max(needed, size + FIRST))


def _check_first(until: str, goal: Goal, interval: Estimate, size: int) -> None:
    """Raise OptionError if the first round shows that no number of members reaches the goal."""
    if np.isnan(interval.value):
        rule = f"none of the first {count_text(size, 'member')} has a {goal.measure.result.name}"
        raise OptionError(rule, at="run.until", value=until)
    if goal.half_at(interval.value) == 0.0:
        rule = f"is 0 for the first {size:,} members, so a relative width is 0"
        raise OptionError(f"{rule}; give an absolute width", at="run.until", value=until)


def is_goal_reached(until: str, interval: Interval) -> bool:
    """Return whether an Interval has the width of a text; False if an end is unknown."""
    if not math.isfinite(interval.half):
        return False
    width = _SIGN.split(until.strip())[1].strip()
    if width.endswith("%"):
        return bool(interval.half <= abs(interval.value) * float(width[:-1]) / 100.0)
    return bool(interval.half <= float(width))


def members_for(
    measure: Measure, interval: Interval, count: int, half: float, confidence: float
) -> float:
    """Return the number of members needed for +- `half`, from the interval of `count` members."""
    if not (half > 0.0 and math.isfinite(interval.half)):
        return 4 * count
    if measure.kind != "p":
        return count * float((interval.half / half) ** 2)
    # near 0 and 1 the width falls as 1/n, not as its root
    low, high = float(count), count * max(1.0, interval.half / half) ** 2 + 1.0
    while high - low > 0.01 * low:
        middle = 0.5 * (low + high)
        narrow = probability(interval.value * middle, middle, confidence).half <= half
        low, high = (low, middle) if narrow else (middle, high)
    return float(high)


@takes_scene
def estimate_rqmc(
    scene: Scene,
    text: str,
    members: int,
    randomisations: int = 16,
    confidence: float = 0.95,
    threads: int | None = None,
    device: str | None = None,
    **options: Any,
) -> Interval:
    """Estimate the mean of a measure from independent randomisations of its points.

    Use it for Sobol points and Latin hypercubes, whose members are not independent. Each
    randomisation has `members` members and the next seed, starting with that of the scene. The
    interval is Student's t over the values of the randomisations.

    Parameters
    ----------
    scene : Scene or path_like
        a scene, its file, or the name of a shipped scene
    text : str
        a measure, such as "p(flips >= 1)"; see `rigidmc.statistics.measures`
    members : int
        members of each randomisation
    randomisations : int, optional
        their number
    confidence : float, optional
        confidence level of the interval
    threads : int, optional
        as in `simulate`
    device : str, optional
        as in `simulate`
    **options : object
        as in `simulate`

    Returns
    -------
    Interval
        the mean: value, low, high

    Examples
    --------
    >>> scene = rm.Scene.load("dzhanibekov").with_run(dt=0.025, t_end=2.5, points="sobol")
    >>> interval = rm.estimate_rqmc(scene, "p(flips >= 1)", members=64, randomisations=4)
    >>> bool(interval.low <= interval.value <= interval.high)
    True
    """
    refuse_count(read_count(randomisations, "randomisations"), "randomisations", 64)
    scene = without_saves(save_for_measures(scene.with_run(members=members, **options), [text]))
    asked = measure(text, variables_of(scene))
    values: list[float] = []
    for i in range(randomisations):
        # another seed makes other points: each is a scene of its own
        part = simulate(scene, seed=scene.run.seed + i, threads=threads, device=device)
        interval = asked.interval(asked.values(part), asked.asks(part), confidence).each(float)
        asked.refuse_unknown(interval)
        values.append(interval.value)
    return mean(np.array(values), confidence=confidence)
