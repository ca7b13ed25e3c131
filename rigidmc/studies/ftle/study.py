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

{returns}

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
>>> study = rm.ftle(scene, 8, unit=1.0, integrator="exact", t_end=10.0)
>>> bool(abs(study.ftle - np.log(101.0) / 20.0).max() < 1e-12)
True
"""

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from rigidmc.errors import OptionError, SceneError
from rigidmc.inputs.arrays import Array
from rigidmc.mechanics.euler_angles import angle_names
from rigidmc.results.labels import count_text, value_text
from rigidmc.runs.resources import refuse_count
from rigidmc.scene.quantities import is_shared
from rigidmc.scene.sampling import is_drawn
from rigidmc.scene.scene import Scene
from rigidmc.scene.start import Start
from rigidmc.studies.framework.members import TUNING, Batches, Members, refuse_stops, start_numbers
from rigidmc.studies.framework.options import Options, option
from rigidmc.studies.framework.study import Example, Study
from rigidmc.studies.framework.variables import StudyVariable, make_dataset

# of products of unit vectors: two changes that are 1.4e-4 rad apart have this eigenvalue
ALIKE = 1e-8  # least eigenvalue of independent changes; below it they differ by rounding alone
STATE = "attitude", "omega"
VARIABLES = (
    StudyVariable(
        "ftle", "family", "s-1", "finite-time Lyapunov exponent",
        "nan where a member is flagged or a derivative is not finite", attrs={"method": "tangents"},
    ),
    StudyVariable("start", "family number", "", "parameter of the start"),
)  # fmt: skip
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
        value, name = getattr(start, key), f"start.{key}"
        if not isinstance(value, tuple) or len(value) != len(parts):
            names += [name] * (not isinstance(value, tuple) or not is_shared(*value))
        else:
            pairs = zip(parts, value, strict=True)
            names += [f"{name}.{part}" for part, x in pairs if not is_shared(x)]
    return tuple(names)


def check_result(scene: Scene, result: xr.Dataset, options: FtleOptions) -> None:
    """Raise OptionError for a result without the derivatives at start and end by its starts."""
    refuse_stops(scene.observables)
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
        field = (0.5 * np.log(square) + np.log(largest)) / time
    return np.where(good, field, np.nan)


def reduce(batches: Batches, options: FtleOptions) -> xr.Dataset:
    """Return the Dataset of the study of members."""
    time, parts, square, count = float(batches.scene.run.t_end), [], 0.0, 0
    for part in batches.results:
        names, ends, healthy = _parameters(part), part.isel(time=[0, -1]), part.status.values == 0
        # by each of d parameters, at start and end (n, 2, d, 6): angles, changes of omega
        both = [
            ends[f"d_{name}"].sel(parameter=names).transpose("member", "time", "parameter", "axis")
            for name in STATE
        ]
        changes = np.concatenate(both, axis=-1)
        changes[~healthy] = np.nan
        speeds = (ends.omega**2).sum("axis").transpose("member", "time").values[healthy]
        square, count = square + float(speeds.sum()), count + speeds.size
        starts, units = zip(*(start_numbers(part, name) for name in names), strict=True)
        parts.append((changes, np.stack(starts, -1), part.member.values))
    changes, start, member = (np.concatenate(x) for x in zip(*parts, strict=True))
    unit = options.unit
    if unit is None:
        # 1 s if nothing rotates: the unit then has no effect
        unit = 1.0 / math.sqrt(square / max(1, count)) if square > 0.0 else 1.0
    changes[..., 3:] *= unit
    field = exponents(changes[:, 0], changes[:, 1], time)
    coordinates = {"family": member, "number": names, "units": ("number", list(units))}
    attrs = {
        "t_end": time,
        "unit": unit,
        "numbers": len(names),
        "left_out": int(np.isnan(field).sum()),
    }
    return make_dataset(VARIABLES, {"ftle": field, "start": start}, coordinates, attrs)


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
    variables=VARIABLES,
    picture="ftle_field",
    picture_options=FtlePlaneOptions,
    settings=TUNING,
    scene_text="a scene, its file, or the name of a shipped scene; the parameters of its start that"
    " are distributions, tables or grids change",
    example=Example("dzhanibekov", {"families": 40}, {"t_end": 6.0}),
)
