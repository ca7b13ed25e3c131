"""Poincare sections: the states of members where a quantity passes a value, or once in a period."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from rigidmc.errors import OptionError, nearest
from rigidmc.physics.observables.protocol import DIMENSIONS
from rigidmc.planning.steps import MOST_STEPS
from rigidmc.progress import Progress
from rigidmc.results.estimates import of_the_state
from rigidmc.runs.resources import refuse_count
from rigidmc.scene.recording import recording
from rigidmc.scene.scene import Scene, scene_of, takes_scene
from rigidmc.studies.framework.members import chunks, pieces, saves_of
from rigidmc.studies.section.points import STATE, WAYS, crossed, crossing_of, period_of, periodic

Array = NDArray[np.float64]
BYTES = 2**27  # of saved states at once
POINT = 2 * 8 * 14  # bytes of a point, and a copy of it: member, time, state and a quantity


@takes_scene
def section(
    scene: Scene,
    at: str,
    way: str = "rises",
    threads: int | None = None,
    progress: Progress = None,
    **settings: Any,
) -> xr.Dataset:
    """Tell the states of the members wherever a quantity passes a value: a Poincare section.

    A member is integrated as always. Between two saves at which the quantity lies on both sides of
    the value, the crossing is sought by Chandrupatla's method, with steps of rk8 from the earlier
    save. These are no longer than those of the run, turn no member by more than 0.2 rad
    (tests/whole/test_claims.py), and are halved until halving changes nothing. Two crossings
    between two saves are not seen.
    Source: Henon, Physica D 5 (1982) 412; Chandrupatla, Adv. Eng. Softw. 28 (1997) 145.

    Parameters
    ----------
    scene : Scene or path_like
        what is run; without noise
    at : str
        "omega[1] = 0": any observable that the scene can save, or a component of it; "every 12.5":
        a time [s], from the start on; "every orbit": once in each orbit of a `GravityGradient`
    way : str, optional
        whether the quantity "rises" there, "falls", or "both"
    threads : int, optional
        as of `simulate`
    progress : bool or callable, optional
        True for what the study will cost, told before the first member, and a bar; or a function
        of (members done, all)
    **settings : object
        of `simulate`; `every` is the time between two looks for a crossing, by default one step

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
    scene = designed(scene, at, **settings)

    def joined(parts: Iterable[xr.Dataset]) -> xr.Dataset:
        return _joined(scene, at, way, parts, threads)

    size = _size(saves_of(scene))
    return joined(chunks(scene, size, threads, progress, lambda part: joined([part])))


def designed(scene: Scene, at: str, **settings: Any) -> Scene:
    """The scene whose members are those of a section, with the saves that it needs.

    Arguments as of `section`.
    """
    scene = scene.with_run(**settings)
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


def section_of(
    result: xr.Dataset,
    at: str,
    way: str = "rises",
    threads: int | None = None,
    allow_code: bool = False,
) -> xr.Dataset:
    """Tell what `section` tells, of a result that has attitude, momentum and the quantity.

    allow_code : whether to run the Python files of a user's own parts

    Raises OptionError if the result lacks one of them, and as `section`.
    """
    scene = scene_of(result, allow_code=allow_code)
    names = STATE if period_of(scene, at) else (*STATE, crossing_of(scene, at, way).of.name)
    for name in names:
        if name not in result or "time" not in result[name].dims:
            rule = f"needs {name} at save times; `rigidmc run SCENE --save {','.join(names)}`"
            raise OptionError(
                f"a section {rule}", at="at", value=at, nearest=nearest(name, list(result))
            )
    parts = pieces(result, _size(result.sizes["time"]))
    return _joined(scene, at, way, parts, threads)


def _size(saves: int) -> int:
    """How many members are looked at at once."""
    return max(1, BYTES // (8 * 12 * max(1, saves)))


def _saving(scene: Scene, *more: str, **settings: Any) -> Scene:
    """A scene that saves the state, what it saves at times now, and more."""
    names = (name for name in scene.run.save if name in recording(scene).recorded)
    save = tuple(dict.fromkeys((*STATE, *more, *names)))
    wider: Scene = scene.with_run(save=save, keep="full", **settings)
    return wider


def _joined(
    scene: Scene, at: str, way: str, parts: Iterable[xr.Dataset], threads: int | None
) -> xr.Dataset:
    """The points of some results, one after the other."""
    found, flagged, lost, attrs = [], 0, 0, dict[str, Any]()
    crossing = None if period_of(scene, at) else crossing_of(scene, at, way)
    wider = _saving(scene, *((crossing.of.name,) if crossing else ()))
    observed = {
        name: one for name, one in recording(wider).recorded.items() if of_the_state(scene, name)
    }
    for part in parts:
        flagged += int((part.status != 0).sum())
        attrs |= {name: part[name].attrs for name in observed if name in part}
        if crossing is None:
            found.append(periodic(part, observed))
        else:
            points, missing = crossed(scene, part, crossing, observed, threads)
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
        f"  {study.sizes['point']:,} points, {study.attrs['at']}"
        + f" as it {study.attrs['way']}" * (study.attrs["way"] in WAYS[:2])
        + f", of {each.size:,} of {study.attrs['members']:,} members",
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
