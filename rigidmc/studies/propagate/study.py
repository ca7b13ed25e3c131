"""Propagate the covariance of uncertain numbers to every save, linearly, and compare it with the
covariance of an ensemble.

With the covariance C_0 of the parameters p and the derivatives J(t) = dx(t)/dp of the member whose
numbers are the means::

    C(t) = J(t) C_0 J(t)^T

The rows of x are components of saved observables; an attitude has three, the rotation vector of the
change in body axes. The ensemble draws p from its distribution. With the deviation dx of a member
from the member of the means, and dp that of its parameters, the fraction that linearity misses is::

    missed = <|dx - J dp|^2> / <|dx|^2>

for each row: 0 if the motion is linear in p, 1 if the linear prediction is worth nothing, and nan
where members differ by rounding alone. It compares member by member, so the size of the sample
hardly changes it.
Source: Battin, An Introduction to the Mathematics and Methods of Astrodynamics (1999), chap. 14.

{parameters}

{returns}

Raises
------
SceneError
    if nothing is drawn and no covariance is given, for a random effect, for a parameter without a
    derivative, and for a distribution without mean or variance
OptionError
    for a covariance that is none, and for an observable without derivatives at the saves

Examples
--------
The angle of a disc about its axis has the variance of the angular velocity times t^2:

>>> start = rm.Start(omega=(rm.normal(0.0, 0.01), 0.0, rm.normal(1.0, 0.01)))
>>> scene = rm.Scene(rm.Body((1.0, 1.0, 2.0)), start=start)
>>> study = rm.propagate(scene, integrator="exact", t_end=10.0, every=5.0, members=64)
>>> last = study.covariance.isel(time=-1).sel(row="attitude[3]", column="attitude[3]")
>>> round(float(last), 9)
0.01
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from rigidmc.errors import OptionError, SceneError
from rigidmc.inputs.arrays import Array, Ints
from rigidmc.mechanics.rotation import product, rotation_vector
from rigidmc.planning.saves import first_and_last
from rigidmc.processes.progress import reporter
from rigidmc.results.labels import count_text, with_units
from rigidmc.runs.prepare import prepare_scene
from rigidmc.runs.simulate import prepare
from rigidmc.scene.derivatives import derivative_name, parameters_of_run
from rigidmc.scene.parameters import END, units_at, value_at
from rigidmc.scene.scene import Scene
from rigidmc.statistics.estimates import rows_in_time
from rigidmc.statistics.intervals import ULPS, resolution_of
from rigidmc.studies.framework.members import TUNING, refuse_noise, start_numbers
from rigidmc.studies.framework.options import Names, Numbers, Options, option
from rigidmc.studies.framework.study import Example, Study
from rigidmc.studies.framework.variables import StudyVariable, make_dataset
from rigidmc.studies.framework.work import Direct
from rigidmc.studies.propagate.covariance import (
    at_means,
    checked_covariance,
    draw_normal,
    of_distributions,
)

BATCH = 1024  # members computed at once; sums over them do not depend on threads
KEPT = 1000  # most members of which deviations are kept, for the picture
PANELS = 4  # saves at which they are kept
LINEAR = 0.05  # fraction missed up to which the motion counts as linear
VARIABLES = (
    StudyVariable("covariance", "time row column", "", "linear covariance, units of both rows"),
    StudyVariable("sample_covariance", "time row column", "", "covariance of the ensemble"),
    StudyVariable(
        "bias", "time row", "", "mean deviation of the ensemble from the nominal member"
    ),
    StudyVariable("missed", "time row", "1", "fraction of the mean square that linearity misses"),
    StudyVariable("jacobian", "time row parameter", "", "derivative of the row"),
    StudyVariable("parameter_covariance", "parameter other", "", "covariance of the parameters"),
    StudyVariable(
        "sample", "sample_time row sample_member", "", "deviations of members",
        "of the first ones, at some saves",
    ),
)  # fmt: skip


class PropagateOptions(Options):
    """The options of `propagate`."""

    covariance: Any = option(
        None,
        "covariance of the parameters `wrt`, in SI units; by default that of the distributions of"
        " the scene",
        in_command=False,
        reader=lambda value, name: value,
        kind="array_like",
    )
    wrt: Names | None = option(
        None,
        "parameters that vary, with --deviations, e.g. start.omega.1,effects.gravity.g; all others"
        " keep their means",
        more="or with `covariance`",
        metavar="NAMES",
    )
    deviations: Numbers | None = option(
        None,
        "standard deviations of the parameters --wrt, in SI units, e.g. 1e-3,0.01; by default the"
        " distributions of the scene",
        metavar="NUMBERS",
    )
    of: Names = option(
        ("attitude", "omega"),
        "observables, e.g. omega,energy; by default attitude and omega",
        metavar="NAMES",
    )
    members: int = option(2000, "members of the ensemble", least=2)


class EllipseOptions(Options):
    """The axes of the picture."""

    x: str | None = option(None, 'horizontal axis, such as "omega[1]"', metavar="ROW")
    y: str | None = option(None, 'vertical axis, such as "omega[2]"', metavar="ROW")


class Input(NamedTuple):
    """What is propagated.

    nominal : scene of the member whose numbers are the means
    names : of the parameters;  covariance : of the parameters (P, P)
    scene : of the ensemble, if it draws from its own distributions; None to draw normally
    """

    nominal: Scene
    names: tuple[str, ...]
    covariance: Array
    scene: Scene | None = None


def input_of(scene: Scene, options: PropagateOptions) -> Input:
    """Return what is propagated; SceneError, OptionError."""
    refuse_noise(scene.effects)
    scene = scene.with_run(save=options.of, keep="full", members=options.members, first=0)
    covariance, deviations, nominal = options.covariance, options.deviations, at_means(scene)
    if covariance is None and deviations is None:
        if options.wrt is not None:
            rule = "names the parameters of a covariance: give `covariance` or `deviations`, too"
            raise OptionError(rule, at="wrt", value=",".join(options.wrt))
        names, covariance = of_distributions(scene.model)
        return Input(nominal, parameters_of_run(nominal.model, names), covariance, scene)
    if not options.wrt:
        raise OptionError("is missing: it names the parameters of the covariance", at="wrt")
    if covariance is not None and deviations is not None:
        rule = "is given beside `covariance`: give one of them"
        raise OptionError(rule, at="deviations", value=list(deviations))
    chosen = parameters_of_run(nominal.model, list(options.wrt))
    if END in chosen:
        rule = "has one value for all members: no ensemble has it as a random number"
        raise OptionError(rule, at="wrt", value=END)
    if deviations is None:
        return Input(nominal, chosen, checked_covariance(covariance, len(chosen)))
    if len(deviations) != len(chosen) or not min(deviations) >= 0.0:
        many = count_text(len(chosen), "number")
        rule = f"expected {many} of at least 0, one for each of {', '.join(chosen)}"
        raise OptionError(rule, at="deviations", value=list(deviations))
    return Input(nominal, chosen, np.diag(np.square(deviations)))


def ensemble_of(inputs: Input, threads: int | None) -> "Iterator[tuple[Array, Any]]":
    """Yield (deviations of the parameters (P, n), result) of the members, BATCH at a time."""
    members, seed = inputs.nominal.run.members, inputs.nominal.run.seed
    if inputs.scene is None:
        run = prepare(inputs.nominal, varied=inputs.names)
        drawn = draw_normal(inputs.covariance, members, seed)
    else:
        run = prepare_scene(inputs.scene)  # another scene: it draws from its own distributions
    means = {name: float(value_at(inputs.nominal.model, name)) for name in inputs.names}
    for low in range(0, members, BATCH):
        some = range(low, min(low + BATCH, members))
        if inputs.scene is None:
            away = drawn[:, some.start : some.stop]
            pairs = zip(means.items(), away, strict=True)
            part = run.run(values={name: mean + x for (name, mean), x in pairs}, threads=threads)
        else:
            part = run.run(members=some, threads=threads)
            away = np.stack([start_numbers(part, name)[0] - means[name] for name in means])
        yield away, part


def rows_of(result: xr.Dataset, names: tuple[str, ...]) -> tuple[list[str], list[str]]:
    """Return (names, units) of the components of observables, with three for an attitude.

    Raises OptionError for an observable without derivatives at the saves.
    """
    rows, units = [], []
    for name in names:
        rates = result.get(derivative_name(name))
        if rates is None or "time" not in rates.dims:  # a result of the whole run has one value
            rule = "has no derivative at each save: use one that has, such as omega or energy"
            raise OptionError(rule, at="of", value=name)
        attitude = "quat" in result[name].dims
        size = 3 if attitude else rows_in_time(result, name).shape[1]
        rows += [f"{name}[{i + 1}]" for i in range(size)] if size > 1 else [name]
        units += ["rad" if attitude else result[name].attrs["units"]] * size
    return rows, units


def jacobian_of(result: xr.Dataset, names: tuple[str, ...]) -> Array:
    """Return the derivatives (time, row, parameter) of a result with one member."""
    parts = []
    for name in names:
        rates = result[derivative_name(name)].transpose("time", ..., "parameter", "member").values
        parts.append(rates.reshape(rates.shape[0], -1, rates.shape[-2]))
    return np.concatenate(parts, axis=1)


def deviations_of(result: xr.Dataset, nominal: xr.Dataset, names: tuple[str, ...]) -> Array:
    """Return the deviations (time, row, member) of good members from the nominal one."""
    good, parts = result.status.values == 0, []
    for name in names:
        values, origin = rows_in_time(result, name)[..., good], rows_in_time(nominal, name)
        if "quat" in result[name].dims:
            back = np.moveaxis(origin, 1, -1) * (1.0, -1.0, -1.0, -1.0)
            turned = product(
                np.broadcast_to(back, (*values.shape[::2], 4)), np.moveaxis(values, 1, -1)
            )
            parts.append(np.moveaxis(rotation_vector(turned), -1, 1))
        else:
            parts.append(values - origin)
    return np.concatenate(parts, axis=1)


def compute(
    scene: Scene, options: PropagateOptions, threads: int | None, progress: Any
) -> xr.Dataset:
    """Compute the study of a scene and return its Dataset."""
    inputs = input_of(scene, options)
    # one choice of integrator and step for all
    run = prepare_scene(first_and_last(inputs.nominal))
    if run.choice is not None:
        keys = "integrator", "dt", "turn", "dtype"
        chosen = {key: getattr(run.scene.run, key) for key in keys}
        ensemble = inputs.scene and inputs.scene.with_run(**chosen)
        inputs = inputs._replace(nominal=inputs.nominal.with_run(**chosen), scene=ensemble)
    nominal = run.run(members=1, wrt=inputs.names, threads=threads)
    if nominal.status.item() != 0:
        rule = "the member whose numbers are the means is flagged: it has no linear covariance"
        raise SceneError(rule, at="scene")
    rows, units = rows_of(nominal, options.of)
    jacobian = jacobian_of(nominal, options.of)
    last = nominal.sizes["time"] - 1
    at = np.unique(np.linspace(0, last, PANELS + 1).round().astype(int)[1:])
    good, arrays = compare(inputs, options.of, nominal, jacobian, at, threads)
    arrays["covariance"] = jacobian @ inputs.covariance @ np.swapaxes(jacobian, -1, -2)
    arrays |= {"jacobian": jacobian, "parameter_covariance": inputs.covariance}
    values = {variable.name: arrays[variable.name] for variable in VARIABLES}
    names, model = list(inputs.names), inputs.nominal.model
    coordinates = {
        "time": nominal.time,
        "row": rows,
        "column": rows,
        "unit": ("row", units),
        "parameter": names,
        "other": names,
        "parameter_unit": ("parameter", list(units_at(model, names))),
        "sample_time": ("sample_time", nominal.time.values[at], nominal.time.attrs),
    }
    attrs = {
        "title": inputs.nominal.title,
        "members": options.members,
        "left_out": options.members - good,
        "scene": (inputs.scene or inputs.nominal).dumps(),
    }
    return make_dataset(VARIABLES, values, coordinates, attrs)


def compare(
    inputs: Input, of: tuple[str, ...], nominal: xr.Dataset, jacobian: Array,
    at: Ints, threads: int | None,
) -> tuple[int, dict[str, Array]]:  # fmt: skip
    """Return (number of good members, variables of the ensemble).

    at : saves at which deviations of members are kept
    """
    shape, kept = jacobian.shape[:2], []
    good, first, missed, second = 0, np.zeros(shape), np.zeros(shape), np.zeros((*shape, shape[1]))
    with reporter(True, inputs.nominal.run.members, 1) as report:
        for away, part in ensemble_of(inputs, threads):
            is_good = part.status.values == 0
            moved = deviations_of(part, nominal, of)
            rest = moved - jacobian @ away[:, is_good]
            good += int(is_good.sum())
            first += moved.sum(-1)
            second += moved @ np.swapaxes(moved, -1, -2)
            missed += (rest * rest).sum(-1)
            kept.append(moved[at])
            report.step(part.sizes["member"])
            report.poll()
    with np.errstate(all="ignore"):
        bias = np.divide(first, good)
        sample = second - good * bias[..., None] * bias[:, None, :]
        sample = np.divide(sample, good - 1) if good > 1 else np.full_like(sample, np.nan)
        squares = np.diagonal(second, axis1=-2, axis2=-1)
        is_known = squares > good * rounding_of(inputs, nominal) ** 2
        share = np.where(is_known, missed / squares, np.nan)
    shown = np.concatenate(kept, axis=-1)[..., :KEPT]
    return good, {"sample_covariance": sample, "bias": bias, "missed": share, "sample": shown}


def rounding_of(inputs: Input, nominal: xr.Dataset) -> Array:
    """Return the deviation of each row (row,) below which members differ by rounding alone."""
    sizes = []
    for name in inputs.nominal.run.save:
        values = np.abs(rows_in_time(nominal, name)).max(axis=(0, 2))
        sizes.append(np.full(3, np.pi) if "quat" in nominal[name].dims else values)
    return ULPS * resolution_of(inputs.nominal.run) * np.concatenate(sizes)


def linear_until(study: xr.Dataset) -> float:
    """Return the last save up to which linearity misses at most LINEAR in every row; nan if it
    misses more at once."""
    over = np.asarray((study.missed > LINEAR).any("row").values)
    good = int(over.argmax()) if over.any() else over.size
    return float(study.time.values[good - 1]) if good else float("nan")


def table(study: xr.Dataset) -> list[str]:
    """Return the study as lines of text: the end, and the time until which linearity holds."""
    a, last = study.attrs, study.isel(time=-1)
    parameters = ", ".join(map(str, study.parameter.values))
    members = count_text(a["members"] - a["left_out"], "member")
    lines = [
        f"{a['title']}: covariance of {parameters}, at t = {float(last.time):g} s",
        f"  {'standard deviation of':24s} {'linear':>12s} {'ensemble':>12s} {'mean shift':>12s}"
        f" {'missed':>8s}",
    ]
    keys = "covariance", "sample_covariance"
    linear, sample = (np.sqrt(np.diagonal(last[key].values)) for key in keys)
    for i, row in enumerate(study.row.values):
        name = with_units(str(row), str(study.unit.values[i]))
        share = _percent(float(last.missed[i]))
        lines.append(
            f"  {name:24s} {linear[i]:12.5g} {sample[i]:12.5g} {float(last.bias[i]):12.4g}"
            f" {share:>8s}"
        )
    error = 100.0 / np.sqrt(2.0 * max(1, a["members"] - a["left_out"]))
    until = linear_until(study)
    words = f"up to t = {until:g} s" if until == until else "at no save"
    lines += [
        f"  missed: of the mean square deviation of {members}, by which a standard deviation is"
        f" known to {error:.2g} %",
        f"  linearity misses at most {100 * LINEAR:g} % of every row {words}",
    ]
    if left := a["left_out"]:
        lines.append(f"  members left out because they are flagged: {left:,}")
    return lines


def _percent(share: float) -> str:
    if share != share:
        return "-"
    return "> 100 %" if share > 1.0 else f"{100.0 * share:.3g} %"


propagate = Study(
    name="propagate",
    text=__doc__,
    options=PropagateOptions,
    work=Direct(compute, "True shows a bar; a function has no effect"),
    table=table,
    variables=VARIABLES,
    picture="covariance_ellipses",
    picture_options=EllipseOptions,
    command="covariance",
    settings=(*TUNING, "every"),
    scene_text="a scene, its file, or the name of a shipped scene; its distributions are the"
    " uncertain numbers, unless a covariance is given",
    example=Example(
        "dzhanibekov",
        {"members": 40, "of": "omega"},
        {"integrator": "rk4", "t_end": 2.0, "every": 1.0},
    ),
)
