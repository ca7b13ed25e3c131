"""Measure what accuracy costs: the errors and times of integrators, precisions and steps.

If the rates of the members differ much, each member has its own step: `turn` [rad] is common to
them, and dt and steps are means. An error is the largest over up to 8 of the times that the
scene saves.

{parameters}

Returns
-------
xarray.Dataset
    over `row`: integrator, dtype, dt [s], steps, turn, error_Q_S with Q of state, momentum,
    attitude, energy, l2, lz and S of median, p99, worst, upper (which 99 % of all members stay
    below with 95 % certainty), inf of steps so long that members fail;
    ns_per_member_step and ns_per_member on one thread, members_per_second; over `tolerance`:
    `cheapest`, the cheapest row that reaches it, -1 if none does. The attributes name the
    truth, its own error, and the horizon of rounding. With `long`, over `integrator` and `step`,
    powers of two up to `steps`: energy_drift, l2_drift, lz_drift, the largest so far of the worst
    member, relative to the sizes in play; energy_law, l2_law, lz_law, the law by which each grows
    with the steps ("bounded", "sqrt" or "linear"), and energy_power, ..., the fitted exponent

Raises
------
SceneError
    for a scene that cannot be run, that is random, or whose pilot fails
OptionError
    for an integrator that does not take the scene

Examples
--------
A study takes a minute, and its times are those of this machine:

>>> study = rm.accuracy(rm.Scene.load("heavy_top"), tolerances=[1e-6])  # doctest: +SKIP
>>> study.integrator[study.cheapest], study.dt[study.cheapest]  # doctest: +SKIP

An integrator of free bodies refuses a heavy top:

>>> rm.accuracy(rm.Scene.load("heavy_top"), ["exact"])  # doctest: +ELLIPSIS
Traceback (most recent call last):
rigidmc.errors.OptionError: integrators = 'exact': ...
"""

from typing import Any

import xarray as xr

from rigidmc.progress import say
from rigidmc.scene.scene import Scene
from rigidmc.studies.accuracy.drift import long_drift, long_table
from rigidmc.studies.accuracy.work_precision import ladder_table, work_precision
from rigidmc.studies.framework.direct import Direct
from rigidmc.studies.framework.options import Example, Names, Numbers, Options, Time, option
from rigidmc.studies.framework.study import Study

TOLERANCES = tuple(10.0**-k for k in range(3, 13))
FEW = 64  # members of a long drift


class AccuracyOptions(Options):
    """What `accuracy` may be asked."""

    integrators: Names | None = option(
        None,
        "e.g. rk4,rk8,srkn11; by default all that take the scene",
        more="names, and integrators of your own",
    )
    tolerances: Numbers = option(
        TOLERANCES, "of the table, e.g. 1e-4,1e-8; by default every decade from 1e-3 to 1e-12"
    )
    members: int = option(
        256, "number of members of the pilot", more=f"the first of the scene; at most {FEW} if long"
    )
    long: bool = option(False, "drift of energy, |L|^2 and L_z over very many steps instead")
    steps: int = option(1_000_000, "with --long: number of steps", least=1000)
    dt: Time | None = option(None, "with --long: time step; by default the scene's", unit="s")


def measure(
    scene: Scene, options: AccuracyOptions, threads: int | None, progress: Any
) -> xr.Dataset:
    """The Dataset of the study of a scene."""
    tell = progress if callable(progress) else lambda line: say(f"  {line}")
    names, members = options.integrators or None, options.members
    if options.long:
        return long_drift(scene, names, options.steps, options.dt, min(members, FEW), tell)
    return work_precision(scene, names, options.tolerances, members, threads, tell)


def table(study: xr.Dataset) -> list[str]:
    """The study in lines of text."""
    return (long_table if "step" in study.dims else ladder_table)(study)


accuracy = Study(
    name="accuracy",
    text=__doc__,
    options=AccuracyOptions,
    work=Direct(measure, "a function of a line on what is done; True prints it"),
    table=table,
    picture="accuracy_picture",
    example=Example(
        "dzhanibekov", {"integrators": "rk4", "members": 4, "long": True, "steps": 1000}, {}
    ),
)
