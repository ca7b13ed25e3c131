"""Measure the cost of accuracy: errors and times of integrators, precisions and steps.

If the rates of the members differ much, each member has its own step: all have the same `turn`
[rad], and dt and steps are means. An error is the largest over up to 8 save times of the scene.

The errors are inf for steps so long that members fail; `upper` is a bound for 99 % of all members,
with 95 % confidence. The attributes name the truth, its own error, and the horizon set by rounding.
With `long`, drifts are relative to the scale of each quantity, at powers of two up to `steps`.

{parameters}

{returns}

Raises
------
SceneError
    for a scene that cannot run, that is random, or whose pilot run fails
OptionError
    for an integrator that does not support the scene

Examples
--------
A study takes a minute; times depend on the machine:

>>> study = rm.accuracy(rm.Scene.load("heavy_top"), tolerances=[1e-6])  # doctest: +SKIP
>>> study.integrator[study.cheapest], study.dt[study.cheapest]  # doctest: +SKIP

An integrator for free bodies refuses a heavy top:

>>> rm.accuracy(rm.Scene.load("heavy_top"), ["exact"])  # doctest: +ELLIPSIS
Traceback (most recent call last):
rigidmc.errors.OptionError: integrators = 'exact': ...
"""

from typing import Any

import xarray as xr

from rigidmc.processes.progress import say
from rigidmc.scene.scene import Scene
from rigidmc.studies.accuracy.drift import DRIFTS, long_drift, long_table
from rigidmc.studies.accuracy.work_precision import ROWS, ladder_table, work_precision
from rigidmc.studies.framework.options import Names, Numbers, Options, Time, option
from rigidmc.studies.framework.study import Example, Study
from rigidmc.studies.framework.work import Direct

TOLERANCES = tuple(10.0**-k for k in range(3, 13))
FEW = 64  # members of a long drift


class AccuracyOptions(Options):
    """The options of `accuracy`."""

    integrators: Names | None = option(
        None,
        "names, e.g. rk4,rk8,srkn11; by default all that support the scene",
        more="or custom integrators",
    )
    tolerances: Numbers = option(
        TOLERANCES,
        "tolerances of the table, e.g. 1e-4,1e-8; by default every decade from 1e-3 to 1e-12",
    )
    members: int = option(
        256,
        "members of the pilot run",
        more=f"the first members of the scene; at most {FEW} if long",
    )
    long: bool = option(False, "drift of energy, |L|^2 and L_z over very many steps instead")
    steps: int = option(1_000_000, "with --long: number of steps", least=1000)
    dt: Time | None = option(None, "with --long: time step; by default the scene's", unit="s")


def measure(
    scene: Scene, options: AccuracyOptions, threads: int | None, progress: Any
) -> xr.Dataset:
    """Compute the study of a scene and return its Dataset."""
    tell = progress if callable(progress) else lambda line: say(f"  {line}")
    names, members = options.integrators or None, options.members
    if options.long:
        return long_drift(scene, names, options.steps, options.dt, min(members, FEW), tell)
    return work_precision(scene, names, options.tolerances, members, threads, tell)


def table(study: xr.Dataset) -> list[str]:
    """Return the study as lines of text."""
    return (long_table if "step" in study.dims else ladder_table)(study)


accuracy = Study(
    name="accuracy",
    text=__doc__,
    options=AccuracyOptions,
    work=Direct(measure, "a function called with a line of text per stage; True prints the lines"),
    table=table,
    variables=(*ROWS, *DRIFTS),
    picture="accuracy_picture",
    example=Example(
        "dzhanibekov", {"integrators": "rk4", "members": 4, "long": True, "steps": 1000}, {}
    ),
)
