"""Compute how much a small change of each start has grown at the end: the field of finite-time
Lyapunov exponents, whose ridges are the stable manifolds of unstable motions.

With the flow Phi over the time T and all changes x of the d parameters that a start draws::

    ftle = 1/T ln max |D Phi x|/|x|,   |x|^2 = angle^2 + unit^2 |change of omega|^2

The maximum is the root of the largest eigenvalue of the Cauchy-Green tensor of the changes at
the end, relative to that of the changes at the start. The changes are the differences from d shadow
trajectories, see `rigidmc.scene.sampling.TangentFamilies`: with six parameters they span all
changes of attitude and angular velocity, with fewer a subspace. A different unit changes ftle by a
term of size 1/T.
Source: Haller, Physica D 149 (2001) 248; Shadden, Lekien & Marsden, Physica D 212 (2005) 271.

{parameters}

Returns
-------
xarray.Dataset
    over family: `ftle` [1/s], nan where a member is flagged, the changes are not independent,
    or a shadow trajectory is nearer than rounding; and `start`, over number (a parameter)

Raises
------
SceneError
    if nothing or more than six parameters are drawn, if parameters outside the start are drawn,
    or if an effect is random

Examples
--------
The angular velocity about the axis of a disc is constant, and its change times t adds to the angle:

>>> start = rm.Start(omega=(0.0, 0.0, rm.uniform(1.0, 2.0)))
>>> scene = rm.Scene(rm.Body((1.0, 1.0, 2.0)), start=start)
>>> found = rm.ftle(scene, 8, unit=1.0, integrator="exact", t_end=10.0)
>>> bool(abs(found.ftle - np.log(101.0) / 20.0).max() < 1e-6)
True
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from rigidmc.errors import SceneError
from rigidmc.planning.initial import uncertain_numbers
from rigidmc.results.frames import described, principal
from rigidmc.results.intervals import resolution_of
from rigidmc.results.labels import count_text, value_text
from rigidmc.scene.scene import Scene
from rigidmc.studies.framework.members import (
    TUNING,
    Batches,
    Members,
    drawn_families,
    family_size,
    refuse_noise,
    start_numbers,
)
from rigidmc.studies.framework.options import Example, Options, option
from rigidmc.studies.framework.study import Study

Array = NDArray[np.float64]
FAR = 0.1  # rad: shadow trajectories that end farther apart are no longer tangent
RESOLVED = 30.0  # least difference, in units of the resolution: growth is then known to 3 %
CURE = (
    "use wider distributions (the exponents do not depend on the width), float64 or a shorter time"
)
ALIKE = 1e-8  # least eigenvalue of the start directions; below it they differ by rounding alone
STATE = "attitude_last", "omega_last"


class FtleOptions(Options):
    """The options of `ftle`."""

    families: int = option(
        16384,
        "number of starts; each has one shadow trajectory per uncertain parameter",
        is_new=True,
    )
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
    """Return the scene with the members of the study; SceneError if it has no tangents."""
    refuse_noise(scene)
    scene = drawn_families(scene, STATE, "tangents", options.families)
    names, dimensions = uncertain_numbers(scene.model)
    for name in names:
        if not name.startswith("start."):
            rule = "is uncertain but not a parameter of the start: give it one value"
            raise SceneError(rule, at=name, table="")
    if len(dimensions) > 6:
        rule = f"{len(dimensions)} parameters are drawn, and a state has six: give some one value"
        raise SceneError(rule, at=f"start.{scene.start.spin_name}")
    return scene


def exponents(start: Array, end: Array, unit: float, time: float) -> tuple[Array, Array]:
    """Return (ftle [1/s], largest distance of a shadow trajectory at the end) of families.

    start, end : (families, 1 + d, 7) attitudes and angular velocities of the members
    """
    before, after = _changes(start, unit), _changes(end, unit)
    with np.errstate(all="ignore"):
        long = np.sqrt((before * before).sum(axis=-1, keepdims=True))
        before, apart = before / long, np.sqrt((after * after).sum(axis=-1)).max(axis=-1)
        after = after / long
    first, last = (x @ np.swapaxes(x, -1, -2) for x in (before, after))
    first = np.where(np.isfinite(first), first, 0.0)
    values, vectors = np.linalg.eigh(first)
    with np.errstate(all="ignore"):
        roots = vectors / np.sqrt(values)[:, None, :]
        grown = np.swapaxes(roots, -1, -2) @ last @ roots
        good = np.isfinite(grown).all(axis=(1, 2)) & (values[:, 0] > ALIKE)
        largest = np.linalg.eigvalsh(np.where(good[:, None, None], grown, 0.0))[:, -1]
        found = np.where(good, 0.5 * np.log(largest) / time, np.nan)
    return found, apart


def is_resolved(start: Array, end: Array, unit: float, eps: float) -> NDArray[np.bool_]:
    """Return whether the differences in families exceed rounding: all differences at the start, and
    the largest at the end, must be RESOLVED times the resolution of the states.

    eps : the relative resolution of the states;  others as in `exponents`
    """
    sure = np.ones(start.shape[0], bool)
    for states, least in ((start, np.min), (end, np.max)):
        spin = unit * np.sqrt((states[:, 0, 4:] ** 2).sum(axis=-1))
        long = np.sqrt((_changes(states, unit) ** 2).sum(axis=-1))
        with np.errstate(invalid="ignore"):
            sure &= ~(least(long, axis=-1) < RESOLVED * eps * np.hypot(1.0, spin))
    return sure


def _changes(states: Array, unit: float) -> Array:
    """Return differences (families, d, 7) between shadow trajectories and their member: angles, and
    changes of angular velocity times `unit`. The states are (families, 1 + d, 7)."""
    own, others = states[:, :1], states[:, 1:]
    same = np.where((own[..., :4] * others[..., :4]).sum(-1, keepdims=True) < 0.0, -1.0, 1.0)
    turned = 2.0 * (same * others[..., :4] - own[..., :4])
    return np.concatenate([turned, unit * (others[..., 4:] - own[..., 4:])], axis=-1)


def _states(part: xr.Dataset) -> tuple[Array, Array]:
    """Return (start, end) of members, (n, 7) each; the end is nan for flagged members."""
    if "start_omega" in part:
        spin = part["start_omega"]
    else:
        spin = described(part, principal(part, "start_momentum") / part.moments)
    end = np.concatenate([part[name].transpose(..., "member").values for name in STATE])
    start = [x.transpose(..., "member").values for x in (part["start_attitude"], spin)]
    return np.concatenate(start).T, np.where(part.status.values == 0, end, np.nan).T


def reduce(batches: Batches, options: FtleOptions) -> xr.Dataset:
    """Return the Dataset of the study of members."""
    scene, unit = batches.scene, options.unit
    names, many = uncertain_numbers(scene.model)[0], family_size(scene)
    count = -(-(scene.run.first + scene.run.members) // many)
    states = np.full((2, count * many, 7), np.nan)
    numbers, units = np.full((count, len(names)), np.nan), ["1"] * len(names)
    for part in batches.results:
        member = part.member.values
        states[:, member] = _states(part)
        own = member % many == 0
        for i, name in enumerate(names):
            values, units[i] = start_numbers(part, name)
            numbers[member[own] // many, i] = values[own]
    if unit is None:
        with np.errstate(all="ignore"):
            square = float(np.nanmean((states[..., 4:] ** 2).sum(axis=-1)))
        # 1 s if nothing rotates: the unit then has no effect
        unit = 1.0 / math.sqrt(square) if square > 0.0 else 1.0
    start, end = states.reshape(2, count, many, 7)
    found, apart = exponents(start, end, unit, scene.run.t_end)
    sure = is_resolved(start, end, unit, resolution_of(scene))
    flat, found = np.isnan(found), np.where(sure, found, np.nan)
    about = {"long_name": "finite-time Lyapunov exponent", "units": "s-1"}
    variables: dict[str, Any] = {
        "ftle": ("family", found, about),
        "start": (("family", "number"), numbers, {"long_name": "parameter of the first member"}),
    }
    attrs = {
        "title": scene.title,
        "t_end": float(scene.run.t_end),
        "unit": unit,
        "numbers": many - 1,
        "far": int((apart > FAR).sum()),
        "left_out": int((flat & sure).sum()),
        "unresolved": int((~sure).sum()),
        "scene": scene.dumps(),
    }
    return xr.Dataset(variables, {"number": names, "units": ("number", units)}, attrs)


def table(study: xr.Dataset) -> list[str]:
    """Return the study as lines of text."""
    a, good = study.attrs, study.ftle.values[np.isfinite(study.ftle.values)]
    lines = [
        f"{a['title']}: {count_text(good.size, 'start')}, each with one shadow trajectory per"
        f" uncertain parameter ({a['numbers']}), to t = {a['t_end']:g} s; unit = {a['unit']:.4g} s"
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
    if far := a["far"]:
        lines.append(
            f"  starts whose shadow trajectories end more than {FAR} rad apart; their growth may be"
            f" larger: {far:,}"
        )
    if rounded := a["unresolved"]:
        lines.append(
            "  starts left out because their shadow trajectories differ by little more than"
            f" rounding: {rounded:,}; {CURE}"
        )
    if left := a["left_out"]:
        lines.append(f"  starts left out with a flagged member or dependent changes: {left:,}")
    return lines


ftle = Study(
    name="ftle",
    text=__doc__,
    options=FtleOptions,
    work=Members(scene_of_tangents, reduce, batch=2**17, points="tangents", needs=STATE),
    table=table,
    picture="ftle_field",
    picture_options=FtlePlaneOptions,
    settings=TUNING,
    scene_text="a scene, its file, or the name of a shipped scene; the parameters of its start that"
    " are distributions change",
    example=Example("dzhanibekov", {"families": 12}, {"t_end": 6.0}),
)
