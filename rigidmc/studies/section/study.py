"""Compute a Poincare section: the states of the members wherever a quantity crosses a value.

Members are integrated as in any run. If the quantity lies on different sides of the value at two
successive saves, Chandrupatla's method finds the crossing, with steps of rk8 from the earlier
save. No step is longer than a step of the run; steps turn no member by more than 0.2 rad
(tests/whole/test_claims.py), and are halved until halving changes nothing. Two crossings
between two saves are missed.
Source: Henon, Physica D 5 (1982) 412; Chandrupatla, Adv. Eng. Softw. 28 (1997) 145.

{parameters}

Returns
-------
xarray.Dataset
    over point, in the order of members and times: `member`, `time`, attitude, momentum, energy,
    and the variables that the scene saves; the attribute `lost` is the number of crossings not
    found because steps between saves did not converge

Raises
------
OptionError
    for a quantity that cannot be saved at times
SceneError
    for random effects: paths with noise are unknown between saves

Examples
--------
A body that rotates about its long axis, at each upward crossing of omega_2 = 0:

>>> scene = rm.Scene(rm.Body((1.0, 2.0, 3.0)), start=rm.Start(omega=(1.0, 0.2, 0.1)))
>>> study = rm.section(scene, "omega[2] = 0", members=1, dt=0.01, t_end=50.0)
>>> study.time.diff("point").values.round(9).tolist()  # its period
[10.858161105, 10.858161105, 10.858161105]
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from rigidmc.errors import OptionError, nearest
from rigidmc.inputs.arrays import Array
from rigidmc.physics.observables.protocol import DIMENSIONS
from rigidmc.planning.steps import MOST_STEPS
from rigidmc.results.labels import count_text
from rigidmc.runs.resources import refuse_count
from rigidmc.scene.scene import Scene
from rigidmc.statistics.estimates import of_the_state
from rigidmc.studies.framework.members import Batches, Members
from rigidmc.studies.framework.options import REQUIRED, Options, option
from rigidmc.studies.framework.study import Example, Study
from rigidmc.studies.section.points import (
    STATE,
    WAYS,
    crossing_of,
    find_crossings,
    period_of,
    periodic,
)

BYTES = 2**27  # saved states held at once
POINT = 2 * 8 * 14  # bytes of a point, and a copy of it: member, time, state and a quantity


class SectionOptions(Options):
    """The options of `section`."""

    at: str = option(
        REQUIRED,
        'definition of the points: "omega[1] = 0", "every orbit", "every 12.5" (seconds)',
        more="a value of any observable that the scene can save, or of a component of one; once per"
        " orbit of a `GravityGradient`; or once per given time, from the start on",
        metavar="WHERE",
    )
    way: str = option("rises", "direction of the crossing: rises, falls or both", metavar="WAY")


class SectionPlaneOptions(Options):
    """The quantities on the axes of the section."""

    x: str | None = option(None, 'horizontal axis, such as "momentum[2]"', metavar="NAME")
    y: str | None = option(None, 'vertical axis, such as "momentum[3]"', metavar="NAME")


def scene_of_points(scene: Scene, options: SectionOptions, settings: Mapping[str, Any]) -> Scene:
    """Return the scene with the members of a section and the saves that it needs."""
    at = options.at
    refuse_count(scene.run.members, "members of a section", POINT, "use fewer members")
    if period := period_of(scene.effects, at):
        if not period / scene.run.dt < MOST_STEPS:
            rule = f"more than {MOST_STEPS:.3g} steps to the first point"
            raise OptionError(rule, at="at", value=at)
        count = max(1, math.floor(scene.run.t_end / period * (1.0 + 1e-9)))
        dt = period / math.ceil(period / scene.run.dt * (1.0 - 1e-9))  # whole steps per period
        return _saving(scene, every=period, t_end=count * period, dt=dt)
    name = crossing_of(scene, at, WAYS[0]).of.name
    every = settings.get("every") or (scene.run.every if scene.run.turn else scene.run.dt)
    return _saving(scene, name, every=every)


def check_source(scene: Scene, result: xr.Dataset, options: SectionOptions) -> None:
    """Raise OptionError for a result without attitude, momentum and the quantity."""
    at = options.at
    of = () if period_of(scene.effects, at) else (crossing_of(scene, at, options.way).of.name,)
    names = (*STATE, *of)
    for name in names:
        if name not in result or "time" not in result[name].dims:
            save = f"`rigidmc run SCENE --save {','.join(names)}`"
            rule = f"a section requires {name} at save times; {save}"
            raise OptionError(rule, at="at", value=at, nearest=nearest(name, list(result)))


def batch_of(saves: int) -> int:
    """Return the number of members evaluated at once."""
    return max(1, BYTES // (8 * 12 * max(1, saves)))


def _saving(scene: Scene, *more: str, **settings: Any) -> Scene:
    """Return the scene that saves the state, `more`, and its own variables at save times."""
    names = (name for name in scene.run.save if name in scene.recording.recorded)
    save = tuple(dict.fromkeys((*STATE, "energy", *more, *names)))  # curves of one energy
    return scene.with_run(save=save, keep="full", **settings)


def reduce(batches: Batches, options: SectionOptions) -> xr.Dataset:
    """Return the Dataset of the study of members: their points, in order."""
    scene, at = batches.scene, options.at
    crossing = None if period_of(scene.effects, at) else crossing_of(scene, at, options.way)
    wider = _saving(scene, *((crossing.of.name,) if crossing else ()))
    recorded = wider.recording.recorded.items()
    observed = {
        name: observable for name, observable in recorded if of_the_state(scene.recording, name)
    }
    parts, flagged, lost = list[dict[str, Array]](), 0, 0
    about: dict[str, Any] = {
        "member": {"long_name": "index of the member"},
        "time": {"long_name": "time of the point", "units": "s"},
    }
    for part in batches.results:
        flagged += int((part.status != 0).sum())
        about |= {name: part[name].attrs for name in observed if name in part}
        if crossing is None:
            points, missing = periodic(part, observed), 0
        else:
            points, missing = find_crossings(scene, part, crossing, observed, batches.threads)
        parts.append(points)
        lost += missing
    variables, coordinates = dict[str, Any](), dict[str, Any]()
    for name, attrs in about.items():
        values = np.concatenate([points[name] for points in parts], axis=-1)
        dims = observed[name].dims if name in observed else ()
        values = values[0] if values.ndim > 1 and not dims else values
        variables[name] = (*dims, "point"), values, attrs
        coordinates |= {dim: list(DIMENSIONS[dim].labels) for dim in dims}
    facts = {
        "at": at.strip(),
        "way": options.way if crossing else "",
        "members": int(scene.run.members),
        "flagged": flagged,
        "lost": lost,
    }
    return xr.Dataset(variables, coordinates, facts)


def table(study: xr.Dataset) -> list[str]:
    """Return the study as lines of text."""
    counts, attrs = np.bincount(np.unique(study.member.values, return_inverse=True)[1]), study.attrs
    way = f" as it {attrs['way']}" * (attrs["way"] in WAYS[:2])
    lines = [
        attrs["title"],
        f"  {count_text(study.sizes['point'], 'point')}, {attrs['at']}{way}"
        f", of {counts.size:,} of {count_text(attrs['members'], 'member')}",
    ]
    if counts.size:
        lines.append(f"  points per member: {counts.min():,} to {counts.max():,}")
    if attrs["flagged"]:
        lines.append(f"  flagged members, without later points: {attrs['flagged']:,}")
    if attrs["lost"]:
        lines.append(
            "  crossings not found, because steps between the saves do not converge:"
            f" {attrs['lost']:,}; save more often"
        )
    return lines


section = Study(
    name="section",
    text=__doc__,
    options=SectionOptions,
    work=Members(scene_of_points, reduce, batch_of, check=check_source),
    table=table,
    picture="section_points",
    picture_options=SectionPlaneOptions,
    settings_help={
        "every": "time between two checks for a crossing [s], or checks per turn such as 50/turn;"
        " by default one step of the run"
    },
    scene_text="a scene without noise, its file, or the name of a shipped scene",
    settings_text="run settings, as in `simulate`; `every` is the time between two checks for a"
    " crossing, by default one step",
    source="a result with attitude and momentum",
    example=Example("kovalevskaya", {"at": "omega[1] = 0"}, {"members": 40, "t_end": 2.0}),
)
