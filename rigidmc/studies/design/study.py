"""Compare measurements before one makes them: which start, how long, and which sensor.

A fit to readings with the derivatives J over their noise has at best the standard deviation of
Cramer and Rao, with the derivatives g of the quantity by all parameters and nuisances::

    sqrt(g^T F^-1 g),   F = J^T J

F follows from the motion of the scene, without readings. What it does not show is named in words.

The standard deviation of a measure, such as the probability of a flip, is that of the event, 1 or
0, after the measurement, on average over its data: see `rigidmc.studies.design.information`.
One measures the motion itself, or with `start` another one, which teaches about body and torques.

{parameters}

{returns}

Raises
------
OptionError, SceneError
    for what cannot be read or measured, and for parameters that are uncertain and not free

Examples
--------
How long a racket must be tossed until a phone shows a ratio of its moments to 0.001:

>>> ratio, free = "body.moments.1/body.moments.3", "body.moments,start.omega"
>>> start = "start.omega=[0.3, 9, 0.3]"
>>> study = rm.design("tennis_racket", free, "omega=0.002@100", [0.5, 1, 2], ratio, start)
>>> found = study.deviation.sel(quantity=ratio).squeeze()
>>> study.duration[found.values < 1e-3].values.tolist()
[1.0, 2.0]
"""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr

from rigidmc.engine.machine import threads_available
from rigidmc.errors import OptionError, SceneError, unknown
from rigidmc.planning.initial import uncertain_numbers
from rigidmc.results.labels import with_units
from rigidmc.results.variables import variables_of
from rigidmc.scene.derivatives import quotient
from rigidmc.scene.parameters import units_at
from rigidmc.scene.scene import Scene, loads
from rigidmc.statistics.intervals import Interval
from rigidmc.studies.design.information import (
    deviations,
    make_pairs,
    problem_of,
    quantities,
    read_sensors,
)
from rigidmc.studies.fit.streams import NUISANCES
from rigidmc.studies.fit.visible import in_words, seen
from rigidmc.studies.framework.members import refuse_noise
from rigidmc.studies.framework.options import REQUIRED, Names, Numbers, Options, Words, option
from rigidmc.studies.framework.study import Example, Study
from rigidmc.studies.framework.variables import StudyVariable, make_dataset
from rigidmc.studies.framework.work import Direct
from rigidmc.studies.propagate.covariance import at_means, of_distributions

ERRORS = tuple(word for word, each in NUISANCES.items() if each.row >= 0)  # with derivatives
VARIABLES = (
    StudyVariable(
        "deviation", "quantity start sensor duration", "", "standard deviation",
        "inf where nothing shows it; of a measure, an estimate", has_interval=True,
    ),
)  # fmt: skip
EXAMPLE = {
    "free": "body.moments,start.omega", "sensor": "omega=0.002@100", "duration": "0.5,1,2",
    "of": "body.moments.1/body.moments.3", "start": "start.omega=[0.3, 9, 0.3]",
}  # fmt: skip


class DesignOptions(Options):
    """The options of `design`."""

    free: Names = option(
        REQUIRED,
        "unknown parameters, which a fit to the readings finds, e.g. body.moments,start.omega",
    )
    sensor: Any = option(
        REQUIRED,
        "a sensor: observable, noise of a reading and readings a second, e.g. omega=0.002@100;"
        " omega=0.002@100+attitude=0.01@10 for two that measure together; give several to compare",
        metavar="NAME=NOISE@RATE",
        type=Words,
        reader=read_sensors,
        kind="str or sequence of str",
    )
    duration: Numbers = option(REQUIRED, "how long it measures, in s, e.g. 1,2,5")
    of: str = option(
        REQUIRED,
        'what you want to know: a parameter, a ratio such as "body.moments.1/body.moments.3", or a'
        ' measure such as "p(flips >= 1)" or "mean(nutation_max)"',
    )
    start: Words = option(
        (),
        'start of the motion to measure, e.g. "start.omega=[0.1, 9, 0.1]"; give several to compare;'
        " by default that of the scene",
        metavar="KEY=VALUE",
    )
    nuisances: Names = option(
        (),
        f"unknown properties of the sensors, of {', '.join(ERRORS)}; by default none",
        metavar="NAME,...",
    )
    reach: float | None = option(
        None, "standard deviation that suffices: names the shortest duration with it", above=0.0
    )
    pairs: int = option(1000, "pairs of members that estimate a measure", least=2)


def started(scene: Scene, text: str) -> Scene:
    """Return the scene with another setting of its start, KEY=VALUE; OptionError, SceneError."""
    key, _, value = text.partition("=")
    if not key.startswith("start.") or not value:
        rule = 'expected a setting of the start, e.g. "start.omega=[0.1, 9, 0.1]"'
        raise OptionError(rule, at="start", value=text)
    text = scene.dumps()
    return replace(scene, start=loads(text, "start", [(key, value)], allow_code=None).start)


def compute(scene: Scene, options: DesignOptions, threads: int | None, progress: Any) -> xr.Dataset:
    """Return the Dataset of the study."""
    refuse_noise(scene.effects)
    threads, asked, times = threads or threads_available(), options.of, sorted({*options.duration})
    if not times or not 0.0 < times[0] <= times[-1] < math.inf:
        raise OptionError("expected times above 0, e.g. 1,2,5", at="duration", value=times)
    known = ["", *{name: 0 for sensors in options.sensor.values() for name in sensors}]
    for name in options.nuisances:
        owner, _, word = name.rpartition(".")
        if owner not in known:
            raise unknown("observable", known[1:], at="nuisances", value=name, error=OptionError)
        if word in NUISANCES and word not in ERRORS:
            raise OptionError("only readings show its size", at="nuisances", value=name)
    drawn = [started(scene, start) for start in options.start] or [scene]
    plain, sensors = [at_means(one) for one in drawn], list(options.sensor.values())
    fixed = options.free, options.nuisances, threads
    parameters = problem_of(plain[0], sensors[0], times[-1], *fixed).parameters
    uncertain = uncertain_numbers(drawn[0].model)[0] and of_distributions(drawn[0].model)[0]
    for name in uncertain:
        if name not in parameters.names:
            rule = "is random, but a record is one motion: name it in `free`, or give a number"
            raise SceneError(rule, at=name)
    names = quantities(parameters, asked)
    units = [units_at(plain[0].model, name.split("/")) for name in names]
    pairs, attrs = None, {"of": asked, **({"reach": options.reach} if options.reach else {})}
    if asked not in names:
        if "(" not in asked:
            raise unknown("parameter", names, at="of", value=asked, error=OptionError)
        members = replace(plain[0], start=scene.start) if options.start else plain[0]
        pairs = make_pairs(asked, drawn[0], members, options.pairs)
        y = pairs.numbers(pairs.z, 0, threads)
        units.append((pairs.measure.units(variables_of(pairs.run.scene)),))
        attrs |= {"now": [*map(float, pairs.mean_of(y))], "before": float(np.nanstd(y))}
    shape = len(units), len(plain), len(sensors), len(times)
    deviation, unseen = np.empty((3, *shape)), np.full(shape[1:], "", object)
    for i, j, k in np.ndindex(*shape[1:]):
        problem = problem_of(plain[i], sensors[j], times[k], *fixed)
        x = problem.parameters.coordinates({})
        shown = seen(problem.sums(x[None]).matrix[0], problem.parameters.slopes(x))
        deviation[:, : len(names), i, j, k] = deviations(problem.parameters, x, shown, names)
        unseen[i, j, k] = "\n".join(in_words(problem.parameters, x, shown))
        if pairs:
            deviation[:, -1, i, j, k] = pairs.left(y, problem, threads)
    coordinates = {
        "quantity": [*names, asked][: len(units)],
        "unit": ("quantity", [quotient(*x) if len(x) > 1 else x[0] for x in units]),
        "start": list(options.start) or ["of the scene"],
        "sensor": list(options.sensor),
        "duration": ("duration", times, {"units": "s", "long_name": "duration"}),
        "unseen": (("start", "sensor", "duration"), unseen.astype(str)),
    }
    return make_dataset(VARIABLES, {"deviation": Interval(*deviation)}, coordinates, attrs)


def table(study: xr.Dataset) -> list[str]:
    """Return the study as lines of text."""
    a, of = study.attrs, study.sel(quantity=study.attrs["of"])
    unit, times = str(of.unit.item()), of.duration.values
    found, low, high, unseen = (
        x.values.reshape(-1, times.size)
        for x in (of.deviation.fillna(math.inf), of.deviation_low, of.deviation_high, of.unseen)
    )
    several = 1 + (of.sizes["start"] > 1)
    ways = [", ".join((x, y)[:several]) for y in of.start.values for x in of.sensor.values]
    width = max(map(len, ways))
    lines = [f"{a['title']}: standard deviation of {with_units(a['of'], unit)}"]
    if "now" in a:
        value, *ends = a["now"]
        text = f"now {value:.3g} ({ends[0]:.3g} to {ends[1]:.3g})"
        lines.append(f"  {text}, standard deviation {a['before']:.2g}")
    lines.append(f"  {'':{width}}" + "".join(f"{t:>9g} s" for t in times))
    for way, row in zip(ways, found, strict=True):
        each = (f"{x:.2g}" if x < math.inf else "not shown" for x in row)
        lines.append(f"  {way:{width}}" + "".join(f"{text:>11}" for text in each))
    best = np.unravel_index(np.nanargmin(found), found.shape)
    text = f" ({low[best]:.2g} to {high[best]:.2g})" if low[best] < high[best] else ""
    text = f"best: {found[best]:.2g}{text} by {ways[best[0]]}, in {times[best[1]]:g} s"
    hint = ": compare starts by --start" if "of the scene" in of.start.values else ""
    lines.append(f"  {text}" if np.isfinite(found[best]) else f"  no measurement shows it{hint}")
    if "reach" in a:
        text = f"  none reaches {a['reach']:g}: measure longer, or with less noise"
        for k in np.flatnonzero((found <= a["reach"]).any(0))[:1]:
            way = ways[np.nanargmin(found[:, k])]
            text = f"  {a['reach']:g} is reached first by {way}, in {times[k]:g} s"
        lines.append(text)
    return lines + [f"  {text}" for text in str(unseen[best]).splitlines()]


design = Study(
    name="design",
    text=__doc__,
    options=DesignOptions,
    work=Direct(compute, "has no effect"),
    table=table,
    variables=VARIABLES,
    picture="deviation_over_duration",
    scene_text="a scene, its file, or the name of a shipped scene: the body and its torques, with"
    " the numbers that one expects",
    example=Example("tennis_racket", EXAMPLE, {}),
)
