"""Compute how much a small change of each start has grown at the end: the field of finite-time
Lyapunov exponents, whose ridges are the stable manifolds of unstable motions.

With the flow Phi over the time T and all changes x of the start by its uncertain parameters::

    ftle = 1/T ln max |D Phi x|/|x|,   |x|^2 = angle^2 + unit^2 |change of omega|^2

The maximum is the root of the largest eigenvalue of the Cauchy-Green tensor of the changes at
the end, relative to that of the changes at the start. The changes are exact derivatives of the
steps (`[run] wrt`), so no distance has to be small, and neither the precision nor the width of a
distribution matters. With six parameters they span all changes of attitude and angular velocity,
with fewer a subspace; a vector or an attitude that is drawn as a whole changes in all directions.
Bodies, effects and noise of a member do not change. A different unit changes ftle by a term of size
1/T.
Source: Haller, Physica D 149 (2001) 248; Shadden, Lekien & Marsden, Physica D 212 (2005) 271.

{parameters}

Returns
-------
xarray.Dataset
    over family: `ftle` [1/s], nan where a member is flagged or a derivative is not finite; and
    `start`, over number (a parameter)

Raises
------
SceneError
    if the start has no uncertain parameter, or one without derivatives, and for closed forms, which
    have no steps

Examples
--------
The angular velocity about the axis of a disc is constant, and its change times t adds to the angle:

>>> start = rm.Start(omega=(0.0, 0.0, rm.uniform(1.0, 2.0)))
>>> scene = rm.Scene(rm.Body((1.0, 1.0, 2.0)), start=start)
>>> found = rm.ftle(scene, 8, unit=1.0, integrator="exact", t_end=10.0)
>>> bool(abs(found.ftle - np.log(101.0) / 20.0).max() < 1e-12)
True
"""

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from rigidmc.errors import OptionError, SceneError
from rigidmc.mechanics.euler_angles import angle_names
from rigidmc.results.labels import count_text, value_text
from rigidmc.runs.resources import refuse_count
from rigidmc.scene.quantities import is_shared
from rigidmc.scene.sampling import is_drawn
from rigidmc.scene.scene import Scene
from rigidmc.scene.start import Start
from rigidmc.studies.framework.members import (
    TUNING,
    Batches,
    Members,
    refuse_stops,
    start_numbers,
)
from rigidmc.studies.framework.options import Example, Options, option
from rigidmc.studies.framework.study import Study

Array = NDArray[np.float64]
ALIKE = 1e-8  # least eigenvalue of independent changes; below it they differ by rounding alone
STATE = "attitude", "omega"
KEPT_CHANGES = 1600.0  # bytes: twice six numbers for each of six parameters, and two copies


class FtleOptions(Options):
    """The options of `ftle`."""

    families: int = option(16384, "number of starts", is_new=True)
    unit: float | None = option(
        None,
        "time that turns changes of angular velocity into angles, by multiplication",
        more="by default 1 / (root mean square of the angular velocities at start and end)",
        unit="s",
        above=0.0,
        rule="expected a time above 0 s",
        metavar="SECONDS",
    )


class FtlePlaneOptions(Options):
    """The parameters of a start on the axes of the field."""

    x: str | None = option(None, 'horizontal axis, such as "start.omega.1"', metavar="KEY")
    y: str | None = option(None, 'vertical axis, such as "start.omega.2"', metavar="KEY")


def scene_of_tangents(scene: Scene, options: FtleOptions, settings: Mapping[str, Any]) -> Scene:
    """Return the scene with the members of the study, saved at start and end with the derivatives
    by their starts."""
    names = uncertain_parameters(scene.start)
    if not names:
        rule = "has no distribution, table or grid, so no parameter changes"
        raise SceneError(rule, at="start", table="")
    refuse_count(options.families, "families", KEPT_CHANGES, "use fewer families")
    return dataclasses.replace(scene, observables=()).with_run(
        points="sobol" if is_drawn(scene.model) else "independent",
        wrt=names,
        save=STATE,
        keep="full",
        every=scene.run.t_end,
        members=options.families,
        first=0,
    )


def uncertain_parameters(start: Start) -> tuple[str, ...]:
    """Return the names of the parameters of a start by which members differ; one name for a vector
    or an attitude that is drawn as a whole."""
    names: list[str] = []
    for key, parts in (("attitude", angle_names(start.sequence)), (start.spin_name, "123")):
        value, whole = getattr(start, key), f"start.{key}"
        if not isinstance(value, tuple) or len(value) != len(parts):
            names += [whole] * (not isinstance(value, tuple) or not is_shared(*value))
        else:
            pairs = zip(parts, value, strict=True)
            names += [f"{whole}.{part}" for part, one in pairs if not is_shared(one)]
    return tuple(names)


def check_result(scene: Scene, result: xr.Dataset, options: FtleOptions) -> None:
    """Raise OptionError for a result without the derivatives at start and end by its starts."""
    refuse_stops(scene)
    lacking = [f"d_{name}" for name in STATE if "time" not in result.get(f"d_{name}", result).dims]
    if lacking or result.sizes["time"] < 2 or not _parameters(result):
        rule = (
            "expected the derivatives of attitude and omega by parameters of the start, saved at"
            f" start and end; `rigidmc run SCENE --save {','.join(STATE)} --wrt start.omega.1`"
        )
        raise OptionError(rule, at="run.wrt", value=list(scene.run.wrt or ()))


def _parameters(result: xr.Dataset) -> list[str]:
    """Return the parameters of the start by which a result has derivatives."""
    names = map(str, result.parameter.values if "parameter" in result else ())
    return [name for name in names if name.startswith("start.")]


def exponents(start: Array, end: Array, time: float) -> Array:
    """Return ftle [1/s] of members, nan where a change is not finite.

    start, end : (members, d, 6) changes: angles, and changes of angular velocity times the unit
    """
    with np.errstate(all="ignore"):
        # a change of any length has the same growth, and no square is out of range
        size = np.abs(start).max(axis=-1, keepdims=True)
        start, end = start / size, end / size
        long = np.sqrt((start * start).sum(axis=-1, keepdims=True))
        first, last = start / long, end / long
        largest = np.abs(last).max(axis=(1, 2))
        last = last / largest[:, None, None]
        first, last = (x @ np.swapaxes(x, -1, -2) for x in (first, last))
    good = np.isfinite(first).all(axis=(1, 2)) & np.isfinite(last).all(axis=(1, 2))
    values, vectors = np.linalg.eigh(np.where(good[:, None, None], first, 0.0))
    # of changes that depend on each other, only the independent ones count
    counts = values > ALIKE
    # 1 avoids 0/0 for the dependent ones
    roots = vectors * (counts / np.sqrt(np.where(counts, values, 1.0)))[:, None, :]
    grown = np.swapaxes(roots, -1, -2) @ np.where(good[:, None, None], last, 0.0) @ roots
    with np.errstate(all="ignore"):
        square = np.linalg.eigvalsh(grown)[:, -1]
        found: Array = (0.5 * np.log(square) + np.log(largest)) / time
    return np.where(good, found, np.nan)


def reduce(batches: Batches, options: FtleOptions) -> xr.Dataset:
    """Return the Dataset of the study of members."""
    scene, parts = batches.scene, list(map(_changes, batches.results))
    names, time = parts[0][0], float(scene.run.t_end)
    changes, numbers = (np.concatenate([part[i] for part in parts]) for i in (1, 2))
    unit = options.unit
    if unit is None:
        square = sum(part[3] for part in parts) / max(1, sum(part[4] for part in parts))
        # 1 s if nothing rotates: the unit then has no effect
        unit = 1.0 / math.sqrt(square) if square > 0.0 else 1.0
    changes[..., 3:] *= unit
    found = exponents(changes[:, 0], changes[:, 1], time)
    about = {
        "long_name": "finite-time Lyapunov exponent",
        "units": "s-1",
        "method": "tangents",
    }
    variables: dict[str, Any] = {
        "ftle": ("family", found, about),
        "start": (("family", "number"), numbers, {"long_name": "parameter of the start"}),
    }
    attrs = {
        "title": scene.title,
        "t_end": time,
        "unit": unit,
        "numbers": len(names),
        "left_out": int(np.isnan(found).sum()),
        "scene": scene.dumps(),
    }
    units = ("number", parts[0][5])
    member = np.concatenate([part[6] for part in parts])
    return xr.Dataset(variables, {"family": member, "number": names, "units": units}, attrs)


def _changes(part: xr.Dataset) -> tuple[Any, ...]:
    """Return of members: the names of their d parameters; their changes (n, 2, d, 6) at start and
    end, angles and changes of angular velocity, nan if flagged; the parameters (n, d); the sum of
    the squares of the angular velocities and their number; the units of the parameters; and the
    indices of the members."""
    names, ends = _parameters(part), part.isel(time=[0, -1])
    both = [
        ends[f"d_{name}"].sel(parameter=names).transpose("member", "time", "parameter", "axis")
        for name in STATE
    ]
    healthy = part.status.values == 0
    changes = np.concatenate(both, axis=-1)
    changes[~healthy] = np.nan
    square = (ends.omega**2).sum("axis").transpose("member", "time").values[healthy]
    starts = [start_numbers(part, name) for name in names]
    numbers, units = zip(*starts, strict=True)
    known = names, changes, np.stack(numbers, -1), float(square.sum()), square.size
    return *known, list(units), part.member.values


def table(study: xr.Dataset) -> list[str]:
    """Return the study as lines of text."""
    a, good = study.attrs, study.ftle.values[np.isfinite(study.ftle.values)]
    lines = [
        f"{a['title']}: {count_text(good.size, 'start')}, each changed by"
        f" {count_text(a['numbers'], 'parameter')}, to t = {a['t_end']:g} s; unit ="
        f" {a['unit']:.4g} s"
    ]
    if good.size:
        ends = np.quantile(good, [0.0, 0.05, 0.5, 0.95, 1.0])
        lines += [
            f"  {word:28s} {value_text(value, study.ftle, 4):>14s},"
            f" growth by {math.exp(value * a['t_end']):.3g}"
            for word, value in zip(
                ("smallest", "5 % are below", "half are below", "95 % are below", "largest"),
                ends,
                strict=True,
            )
        ]
    if left := a["left_out"]:
        lines.append(f"  starts left out, flagged or with an infinite derivative: {left:,}")
    return lines


ftle = Study(
    name="ftle",
    text=__doc__,
    options=FtleOptions,
    work=Members(scene_of_tangents, reduce, batch=2**15, check=check_result),
    table=table,
    picture="ftle_field",
    picture_options=FtlePlaneOptions,
    settings=TUNING,
    scene_text="a scene, its file, or the name of a shipped scene; the parameters of its start that"
    " are distributions, tables or grids change",
    example=Example("dzhanibekov", {"families": 40}, {"t_end": 6.0}),
)
