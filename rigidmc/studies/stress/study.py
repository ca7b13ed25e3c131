"""Run hard cases on this machine, each against its bound; or assess how far a scene can be trusted.

With a scene, the study recomputes its members with half the step, with another integrator, in other
units and with permuted axes; the differences are the errors. `integrator` replaces that of the
scene.

{parameters}

Returns
-------
xarray.Dataset
    without a scene, over `case` and `integrator`: error, bound, measured (the error on the machine
    that measured the bounds), seconds, verdict (see `flag_meanings`; "not up to it" is an
    integrator that claims a case and is known to fail it, "not judged" a run without a bound),
    reason (the message of a crash); over `case`: group, why, truth. With a scene, over `check` and
    `time`: error (of the worst member) and error_median, the larger of the errors of momentum
    [relative] and attitude [rad]; over `check`: tells, "accuracy", or "rounding" if the same motion
    is computed with different numbers. Attributes: verdict, digits (correct for all members up to
    t_end), horizon [s] (after which fewer than two are correct), chaotic_share, flagged

Raises
------
OptionError
    for unknown names, and for bounds that are negative or not finite
FileError
    for a file of bounds with mistakes
SceneError
    for a scene that cannot run, or that is random

Examples
--------
>>> found = rm.stress("nasa_brick", quick=True)  # doctest: +SKIP
>>> found.attrs["verdict"]  # doctest: +SKIP
'trust 12 digits to t = 30 s'

>>> rm.stress(group="H77")  # doctest: +ELLIPSIS
Traceback (most recent call last):
rigidmc.errors.OptionError: group = 'H77': ...
"""

from collections.abc import Mapping
from typing import Any, cast

import xarray as xr

from rigidmc.engine.machine import threads_available
from rigidmc.errors import OptionError
from rigidmc.files.outputs import Path
from rigidmc.scene.scene import Scene
from rigidmc.studies.framework.options import Names, Options, option
from rigidmc.studies.framework.study import Example, OutputFile, Study
from rigidmc.studies.framework.work import Direct
from rigidmc.studies.stress import hard_cases, trust


class StressOptions(Options):
    """The options of `stress`."""

    group: Names | None = option(None, "groups of the catalogue, e.g. H2,H7; by default all")
    integrator: Names | None = option(
        None, "names, e.g. rk4,exact; by default all, or for a scene its own integrator"
    )
    quick: bool = option(False, "run few cases and integrators, and shorten long cases")
    bounds: str | None = option(
        None,
        "bounds that replace the shipped ones, as written by --write-bounds",
        more="a file, or numbers by (case, integrator)",
        metavar="FILE",
    )


def measure(
    scene: Scene | None, options: StressOptions, threads: int | None, progress: Any
) -> xr.Dataset:
    """Run the hard cases, or the checks of a scene, and return the Dataset."""
    names, bounds = options.integrator, cast(Any, options.bounds)
    if scene is not None:
        for name in ("group", "bounds"):
            if (value := getattr(options, name)) is not None:
                rule = "applies to the hard cases, not to a scene: omit one of the two"
                raise OptionError(
                    rule, at=name, value=",".join(value) if name == "group" else value
                )
        if names is not None:
            scene = scene.with_run(integrator=",".join(names))
        return trust.trust(scene, options.quick, progress)
    if bounds is not None and not isinstance(bounds, Mapping):
        bounds = hard_cases.load_bounds(bounds)
    many = threads or threads_available()
    return hard_cases.run_cases(options.group, names, options.quick, bounds, many, progress)


def is_of_cases(study: xr.Dataset) -> bool:
    """Return whether a study is of the hard cases, and not of a scene."""
    return "case" in study.dims


def table(study: xr.Dataset) -> list[Any]:
    """Return the study as lines of text, or as objects that rich prints."""
    if not is_of_cases(study):
        return trust.table(study)
    from rigidmc.studies.stress.table import case_table  # rich takes 0.1 s

    return case_table(study)


def outcome(study: xr.Dataset) -> str:
    """Return "flagged" if a case is above its bound or crashed, or the scene cannot be trusted;
    else "done"."""
    failed = hard_cases.any_failed if is_of_cases(study) else trust.has_failed
    return "flagged" if failed(study) else "done"


def save_bounds(study: xr.Dataset, path: Path, force: bool) -> bool:
    """Write bounds of the hard cases; return False for a scene, which has no bounds."""
    if is_of_cases(study):
        hard_cases.write_bounds(study, path, force)
    return is_of_cases(study)


stress = Study(
    name="stress",
    text=__doc__,
    options=StressOptions,
    work=Direct(measure, "True for a bar, or a function of (done, all)", needs_scene=False),
    table=table,
    picture="stress_picture",
    scene_text="a scene for the generic checks; without it the catalogue of hard cases runs",
    files={
        "write_bounds": OutputFile(
            "tables of bounds",
            "write four times the errors measured here as bounds (.csv)",
            save_bounds,
        )
    },
    outcome=outcome,
    example=Example("nasa_brick", {"quick": True}, {}),
)
