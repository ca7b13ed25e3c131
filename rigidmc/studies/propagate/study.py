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

Returns
-------
xarray.Dataset
    over time, row and column: `covariance` and `sample_covariance`; over time and row: `bias`, the
    mean deviation of the ensemble, and `missed`; `jacobian` over time, row and parameter,
    `parameter_covariance`, and `sample`, deviations of the first members at some saves

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
>>> found = rm.propagate(scene, integrator="exact", t_end=10.0, every=5.0, members=64)
>>> last = found.covariance.isel(time=-1).sel(row="attitude[3]", column="attitude[3]")
>>> round(float(last), 9)
0.01
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from rigidmc.errors import OptionError, SceneError
from rigidmc.mechanics.rotation import product, rotation_vector
from rigidmc.planning.saves import first_and_last
from rigidmc.processes.progress import reporter
from rigidmc.results.labels import count_text, with_units
from rigidmc.runs.prepare import prepare_scene
from rigidmc.runs.simulate import prepare, simulate
from rigidmc.scene.derivatives import derivative_name, parameters_of_run
from rigidmc.scene.parameters import END, units_at, value_at
from rigidmc.scene.scene import Scene
from rigidmc.statistics.estimates import rows_in_time
from rigidmc.statistics.intervals import ULPS, resolution_of
from rigidmc.studies.framework.members import TUNING, refuse_noise, start_numbers
from rigidmc.studies.framework.options import Example, Names, Numbers, Options, option
from rigidmc.studies.framework.study import Study
from rigidmc.studies.framework.work import Direct
from rigidmc.studies.propagate.covariance import (
    at_means,
    checked_covariance,
    draw_normal,
    of_distributions,
)

Array = NDArray[np.float64]
BATCH = 1024  # members computed at once; sums over them do not depend on threads
KEPT = 1000  # most members of which deviations are kept, for the picture
PANELS = 4  # saves at which they are kept
LINEAR = 0.05  # fraction missed up to which the motion counts as linear


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
    scene: Scene | None


def input_of(scene: Scene, options: PropagateOptions) -> Input:
    """Return what is propagated; SceneError, OptionError."""
    refuse_noise(scene)
    scene = scene.with_run(save=options.of, keep="full", members=options.members, first=0)
    given = options.covariance is not None or options.deviations is not None
    nominal = at_means(scene)
    if not given:
        if options.wrt is not None:
            rule = "names the parameters of a covariance: give `covariance` or `deviations`, too"
            raise OptionError(rule, at="wrt", value=",".join(options.wrt))
        names, covariance = of_distributions(scene)
        return Input(nominal, _known(nominal, names), covariance, scene)
    if not options.wrt:
        raise OptionError("is missing: it names the parameters of the covariance", at="wrt")
    if options.covariance is not None and options.deviations is not None:
        rule = "is given beside `covariance`: give one of them"
        raise OptionError(rule, at="deviations", value=list(options.deviations))
    chosen = _known(nominal, list(options.wrt))
    if END in chosen:
        rule = "has one value for all members: no ensemble has it as a random number"
        raise OptionError(rule, at="wrt", value=END)
    if options.deviations is None:
        return Input(nominal, chosen, checked_covariance(options.covariance, len(chosen)), None)
    if len(options.deviations) != len(chosen) or not min(options.deviations) >= 0.0:
        many = count_text(len(chosen), "number")
        rule = f"expected {many} of at least 0, one for each of {', '.join(chosen)}"
        raise OptionError(rule, at="deviations", value=list(options.deviations))
    return Input(nominal, chosen, np.diag(np.square(options.deviations)), None)


def _known(nominal: Scene, names: list[str]) -> tuple[str, ...]:
    """Return the parameters, vectors by component; SceneError for one without a derivative."""
    return parameters_of_run(nominal.model, names)


def ensemble_of(given: Input, members: int, threads: int | None) -> "Iterator[tuple[Array, Any]]":
    """Yield (deviations of the parameters (P, n), result) of the members, BATCH at a time."""
    if given.scene is not None:
        run = prepare_scene(given.scene)
        means = np.array([_number(given.nominal, name) for name in given.names])
        for low in range(0, members, BATCH):
            part = run.run(members=range(low, min(low + BATCH, members)), threads=threads)
            drawn = np.stack([start_numbers(part, name)[0] for name in given.names])
            yield drawn - means[:, None], part
        return
    run = prepare(given.nominal, varied=given.names)
    away = draw_normal(given.covariance, members, given.nominal.run.seed)
    for low in range(0, members, BATCH):
        some = away[:, low : low + BATCH]
        values = {
            name: _number(given.nominal, name) + x
            for name, x in zip(given.names, some, strict=True)
        }
        yield some, run.run(values=values, threads=threads)


def _number(scene: Scene, name: str) -> float:
    return float(value_at(scene.model, name))


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
        values, own = rows_in_time(result, name)[..., good], rows_in_time(nominal, name)
        if "quat" in result[name].dims:
            back = np.moveaxis(own, 1, -1) * (1.0, -1.0, -1.0, -1.0)
            turned = product(
                np.broadcast_to(back, (*values.shape[::2], 4)), np.moveaxis(values, 1, -1)
            )
            parts.append(np.moveaxis(rotation_vector(turned), -1, 1))
        else:
            parts.append(values - own)
    return np.concatenate(parts, axis=1)


class Sums(NamedTuple):
    """Sums over the members of the ensemble.

    good : number of good members;  first, second : of deviations (time, row), (time, row, row)
    missed : of squares that linearity misses (time, row);  sample : deviations of the first members
    """

    good: int
    first: Array
    second: Array
    missed: Array
    sample: Array


def sums_of(
    given: Input, options: PropagateOptions, nominal: xr.Dataset, jacobian: Array,
    threads: int | None, at: NDArray[np.int64],
) -> Sums:  # fmt: skip
    """Sum over the ensemble; `at` : saves at which deviations are kept."""
    shape, kept = jacobian.shape[:2], []
    count, first, missed = 0, np.zeros(shape), np.zeros(shape)
    second = np.zeros((*shape, shape[1]))
    with reporter(True, options.members, 1) as report:
        for away, part in ensemble_of(given, options.members, threads):
            good = part.status.values == 0
            moved = deviations_of(part, nominal, options.of)
            rest = moved - jacobian @ away[:, good]
            count += int(good.sum())
            first += moved.sum(-1)
            second += moved @ np.swapaxes(moved, -1, -2)
            missed += (rest * rest).sum(-1)
            kept.append(moved[at])
            report.step(part.sizes["member"])
            report.poll()
    return Sums(count, first, second, missed, np.concatenate(kept, axis=-1)[..., :KEPT])


def compute(
    scene: Scene, options: PropagateOptions, threads: int | None, progress: Any
) -> xr.Dataset:
    """Compute the study of a scene and return its Dataset."""
    given = input_of(scene, options)
    # one choice of integrator and step for all
    run = prepare_scene(given.nominal).scene.run
    chosen = {key: getattr(run, key) for key in ("integrator", "dt", "turn", "dtype")}
    if run.integrator != scene.run.integrator:
        nominal = given.nominal.with_run(**chosen)
        own = given.scene and given.scene.with_run(**chosen)
        given = given._replace(nominal=nominal, scene=own)
    one = simulate(first_and_last(given.nominal), members=1, wrt=given.names, threads=threads)
    if one.status.item() != 0:
        rule = "the member whose numbers are the means is flagged: it has no linear covariance"
        raise SceneError(rule, at="scene")
    rows, units = rows_of(one, options.of)
    jacobian = jacobian_of(one, options.of)
    at = np.unique(np.linspace(0, one.sizes["time"] - 1, PANELS + 1).round().astype(int)[1:])
    sums = sums_of(given, options, one, jacobian, threads, at)
    return _dataset(given, options, one, jacobian, sums, rows, units, at)


def rounding_of(given: Input, nominal: xr.Dataset) -> Array:
    """Return the deviation of each row (row,) below which members differ by rounding alone."""
    sizes = []
    for name in given.nominal.run.save:
        values = np.abs(rows_in_time(nominal, name)).max(axis=(0, 2))
        sizes.append(np.full(3, np.pi) if "quat" in nominal[name].dims else values)
    return ULPS * resolution_of(given.nominal) * np.concatenate(sizes)


def _dataset(
    given: Input, options: PropagateOptions, one: xr.Dataset, jacobian: Array, sums: Sums,
    rows: list[str], units: list[str], at: NDArray[np.int64],
) -> xr.Dataset:  # fmt: skip
    linear = jacobian @ given.covariance @ np.swapaxes(jacobian, -1, -2)
    with np.errstate(all="ignore"):
        bias = np.divide(sums.first, sums.good)
        own = sums.second - sums.good * bias[..., None] * bias[:, None, :]
        own = np.divide(own, sums.good - 1) if sums.good > 1 else np.full_like(own, np.nan)
        moved = np.diagonal(sums.second, axis1=-2, axis2=-1)
        missed = np.where(
            moved > sums.good * rounding_of(given, one) ** 2, sums.missed / moved, np.nan
        )
    texts = {
        "covariance": (("time", "row", "column"), linear, "linear covariance, units of both rows"),
        "sample_covariance": (("time", "row", "column"), own, "covariance of the ensemble"),
        "bias": (("time", "row"), bias, "mean deviation of the ensemble from the nominal member"),
        "missed": (("time", "row"), missed, "fraction of the mean square that linearity misses"),
        "jacobian": (("time", "row", "parameter"), jacobian, "derivative of the row"),
        "parameter_covariance": (
            ("parameter", "other"), given.covariance, "covariance of the parameters"
        ),
        "sample": (("sample_time", "row", "sample_member"), sums.sample, "deviations of members"),
    }  # fmt: skip
    coordinates = {
        "time": one.time,
        "row": rows,
        "column": rows,
        "unit": ("row", units),
        "parameter": list(given.names),
        "other": list(given.names),
        "parameter_unit": ("parameter", list(units_at(given.nominal.model, given.names))),
        "sample_time": ("sample_time", one.time.values[at], one.time.attrs),
    }
    variables = {key: (dims, x, {"long_name": text}) for key, (dims, x, text) in texts.items()}
    variables["missed"][2]["units"] = "1"
    attrs = {
        "title": given.nominal.title,
        "members": options.members,
        "left_out": options.members - sums.good,
        "scene": (given.scene or given.nominal).dumps(),
    }
    return xr.Dataset(variables, coordinates, attrs)


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
    own, linear = (
        np.sqrt(np.diagonal(last[key].values)) for key in ("sample_covariance", "covariance")
    )
    for i, row in enumerate(study.row.values):
        name = with_units(str(row), str(study.unit.values[i]))
        share = _percent(float(last.missed[i]))
        lines.append(
            f"  {name:24s} {linear[i]:12.5g} {own[i]:12.5g} {float(last.bias[i]):12.4g} {share:>8s}"
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
