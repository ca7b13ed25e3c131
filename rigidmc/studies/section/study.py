"""Tell the states of the members wherever a quantity passes a value: a Poincare section.

A member is integrated as always. Between two saves at which the quantity lies on both sides of
the value, the crossing is sought by Chandrupatla's method, with steps of rk8 from the earlier
save. These are no longer than those of the run, turn no member by more than 0.2 rad
(tests/whole/test_claims.py), and are halved until halving changes nothing. Two crossings
between two saves are not seen.
Source: Henon, Physica D 5 (1982) 412; Chandrupatla, Adv. Eng. Softw. 28 (1997) 145.

{parameters}

Returns
-------
xarray.Dataset
    over point, in the order of members and times: `member`, `time`, attitude, momentum, and
    whatever the scene saves; the attribute `lost` is the number of crossings that were not
    found, because steps between saves did not converge

Raises
------
OptionError
    for a quantity that is not known at save times
SceneError
    for random effects: between saves a path with noise is not known

Examples
--------
A body that turns about its long axis, whenever axis 1 comes past the same side:

>>> scene = rm.Scene(rm.Body((1.0, 2.0, 3.0)), start=rm.Start(omega=(1.0, 0.2, 0.1)))
>>> found = rm.section(scene, "omega[2] = 0", members=1, dt=0.01, t_end=50.0)
>>> found.time.diff("point").values.round(9).tolist()  # its period
[10.858161105, 10.858161105, 10.858161105]
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from rigidmc.errors import OptionError, nearest
from rigidmc.physics.observables.protocol import DIMENSIONS
from rigidmc.planning.steps import MOST_STEPS
from rigidmc.results.estimates import of_the_state
from rigidmc.results.labels import count_text
from rigidmc.runs.resources import refuse_count
from rigidmc.scene.recording import make_recording
from rigidmc.scene.scene import Scene
from rigidmc.studies.framework.members import Batches, Members
from rigidmc.studies.framework.options import REQUIRED, Example, Options, option
from rigidmc.studies.framework.study import Study
from rigidmc.studies.section.points import (
    STATE,
    WAYS,
    crossing_of,
    find_crossings,
    period_of,
    periodic,
)

Array = NDArray[np.float64]
BYTES = 2**27  # of saved states at once
POINT = 2 * 8 * 14  # bytes of a point, and a copy of it: member, time, state and a quantity


class SectionOptions(Options):
    """What `section` may be asked."""

    at: str = option(
        REQUIRED,
        'where the points are: "omega[1] = 0", "every orbit", "every 12.5" (seconds)',
        more="a value of any observable that the scene can save, or of a component of it; once in"
        " each orbit of a `GravityGradient`; or once in a time, from the start on",
        metavar="WHERE",
    )
    way: str = option("rises", "whether the quantity rises there, falls, or both", metavar="WAY")


class SectionPlaneOptions(Options):
    """The numbers of a point over which the section is drawn."""

    x: str | None = option(None, 'of the picture, such as "momentum[2]"', metavar="NAME")
    y: str | None = option(None, "the same, for the other axis", metavar="NAME")


def scene_of_points(scene: Scene, options: SectionOptions, settings: Mapping[str, Any]) -> Scene:
    """The scene with the members of a section, with the saves that it needs."""
    at = options.at
    refuse_count(scene.run.members, "members of a section", POINT, "take fewer members")
    if period := period_of(scene, at):
        if not period / scene.run.dt < MOST_STEPS:
            rule = f"more than {MOST_STEPS:.3g} steps to the first point"
            raise OptionError(rule, at="at", value=at)
        count = max(1, math.floor(scene.run.t_end / period * (1.0 + 1e-9)))
        dt = period / math.ceil(period / scene.run.dt * (1.0 - 1e-9))  # whole steps in a period
        return _saving(scene, every=period, t_end=count * period, dt=dt)
    name = crossing_of(scene, at, WAYS[0]).of.name
    every = settings.get("every") or (scene.run.every if scene.run.turn else scene.run.dt)
    return _saving(scene, name, every=every)


def check_source(scene: Scene, result: xr.Dataset, options: SectionOptions) -> None:
    """OptionError for a result without attitude, momentum and the quantity."""
    at = options.at
    of = () if period_of(scene, at) else (crossing_of(scene, at, options.way).of.name,)
    names = (*STATE, *of)
    for name in names:
        if name not in result or "time" not in result[name].dims:
            rule = f"needs {name} at save times; `rigidmc run SCENE --save {','.join(names)}`"
            raise OptionError(
                f"a section {rule}", at="at", value=at, nearest=nearest(name, list(result))
            )


def batch_of(saves: int) -> int:
    """How many members are looked at at once."""
    return max(1, BYTES // (8 * 12 * max(1, saves)))


def _saving(scene: Scene, *more: str, **settings: Any) -> Scene:
    """A scene that saves the state, what it saves at times now, and more."""
    names = (name for name in scene.run.save if name in make_recording(scene).recorded)
    save = tuple(dict.fromkeys((*STATE, *more, *names)))
    wider: Scene = scene.with_run(save=save, keep="full", **settings)
    return wider


def reduce(batches: Batches, options: SectionOptions) -> xr.Dataset:
    """The Dataset of the study of members: their points, one after the other."""
    scene, at, way = batches.scene, options.at, options.way
    found, flagged, lost, attrs = [], 0, 0, dict[str, Any]()
    crossing = None if period_of(scene, at) else crossing_of(scene, at, way)
    wider = _saving(scene, *((crossing.of.name,) if crossing else ()))
    observed = {
        name: one
        for name, one in make_recording(wider).recorded.items()
        if of_the_state(scene, name)
    }
    for part in batches.results:
        flagged += int((part.status != 0).sum())
        attrs |= {name: part[name].attrs for name in observed if name in part}
        if crossing is None:
            found.append(periodic(part, observed))
        else:
            points, missing = find_crossings(scene, part, crossing, observed, batches.threads)
            found.append(points)
            lost += missing
    observed = {name: one for name, one in observed.items() if name in attrs}
    return _dataset(scene, at, way if crossing else "", observed, attrs, found, flagged, lost)


def _dataset(
    scene: Scene,
    at: str,
    way: str,
    observed: Mapping[str, Any],
    about: Mapping[str, Any],
    found: Sequence[Mapping[str, Array]],
    flagged: int,
    lost: int,
) -> xr.Dataset:
    """The Dataset of points.

    about : attributes of what is observed, those of the result;  lost : crossings not found
    """

    def joined(name: str) -> Array:
        return np.concatenate([one[name] for one in found], axis=-1)

    variables: dict[str, Any] = {
        "member": ("point", joined("member"), {"long_name": "index of the member"}),
        "time": ("point", joined("time"), {"long_name": "time of the point", "units": "s"}),
    }
    coords: dict[str, Any] = {}
    for name, one in observed.items():
        values = joined(name)
        variables[name] = (*one.dims, "point"), values if one.dims else values[0], about[name]
        coords |= {dim: list(DIMENSIONS[dim].labels) for dim in one.dims}
    attrs = {
        "title": scene.title,
        "at": at.strip(),
        "way": way,
        "members": int(scene.run.members),
        "flagged": flagged,
        "lost": lost,
        "scene": scene.dumps(),
    }
    return xr.Dataset(variables, coords, attrs)


def table(study: xr.Dataset) -> list[str]:
    """The study in lines of text."""
    each = np.bincount(np.unique(study.member.values, return_inverse=True)[1])
    lines = [
        study.attrs["title"],
        f"  {count_text(study.sizes['point'], 'point')}, {study.attrs['at']}"
        + f" as it {study.attrs['way']}" * (study.attrs["way"] in WAYS[:2])
        + f", of {each.size:,} of {count_text(study.attrs['members'], 'member')}",
    ]
    if each.size:
        lines.append(f"  points of a member: {each.min():,} to {each.max():,}")
    if study.attrs["flagged"]:
        lines.append(
            f"  flagged members, whose later points are missing: {study.attrs['flagged']:,}"
        )
    if study.attrs["lost"]:
        lines.append(
            f"  crossings that were not found, since steps between the saves do not converge:"
            f" {study.attrs['lost']:,}; save more often"
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
        "every": "time between two looks for a crossing [s]; by default one step of the run"
    },
    scene_text="what is run; without noise",
    settings_text="of `simulate`; `every` is the time between two looks for a crossing, by default"
    " one step",
    source="a result that has attitude and momentum",
    example=Example("kovalevskaya", {"at": "omega[1] = 0"}, {"members": 40, "t_end": 2.0}),
)
