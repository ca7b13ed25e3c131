"""Differentiate the mean or a quantile over an ensemble by parameters of a scene, with intervals.

Two estimators serve two kinds of measure. For an observable X at the end, or a mean or an extremum
over the steps, members have derivatives of their own ("path")::

    d<X>/dp = <dX/dp>,   dq/dp = <dX/dp | X = q> for the quantile q

Counts, events and the truth of a comparison jump: the derivative of a member is 0 almost
everywhere and says nothing about the mean. If p is a parameter of a distribution with density f,
the likelihood ratio ("score") has the derivative of any mean::

    d<Y>/dp = <Y s>,   s = d ln f/dp

The noise of a bath has a density, too: for its gamma and kT, s is a sum over all steps. Its
variance grows with their number.

Tangents of chaotic motion grow as exp(lambda t). The study measures this growth from the tangents
themselves, as twice the median of ``ln |dX/dp|`` at the end less that at half of the time. A
derivative by the path is useless if growth exceeds ln(1/eps), with the resolution eps of the
states; long before, few members carry the mean, and their effective number warns of it.
Source: Glynn, Commun. ACM 33 (1990) 75; Hong, Oper. Res. 57 (2009) 118; Lea, Allen & Haine, Tellus
52A (2000) 523.

{parameters}

Returns
-------
xarray.Dataset
    over measure and parameter: `derivative` [unit of the measure per unit of the parameter] with
    the ends `_low` and `_high` of its interval, `method`, `growth` and `carriers`; over measure:
    `value` with its ends, and its `unit`

Raises
------
OptionError
    for a measure without a derivative by a parameter, with the reason and the way out
SceneError
    for a parameter that the scene lacks

Examples
--------
The mean energy of a disc that spins with omega drawn from N(m, s^2) is I (m^2 + s^2)/2:

>>> start = rm.Start(omega=(0.0, 0.0, rm.normal(1.0, 0.1)))
>>> scene = rm.Scene(rm.Body((1.0, 1.0, 2.0)), start=start)
>>> run = {"integrator": "exact", "t_end": 1.0, "members": 1000}
>>> found = rm.gradient(scene, "mean(energy_last)", ["start.omega.3.mean"], **run)
>>> found.derivative.values.round(1).tolist()  # I m
[[2.0]]
"""

import math
import re
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from rigidmc.errors import OptionError, unknown
from rigidmc.physics.observables import saved_observables
from rigidmc.results.labels import count_text
from rigidmc.results.variables import saved_variables, variables_of
from rigidmc.scene.derivatives import derivative_name, parameters_of_run, quotient
from rigidmc.scene.parameters import units_at
from rigidmc.scene.recording import make_recording
from rigidmc.scene.sampling import is_sample
from rigidmc.scene.scene import Scene
from rigidmc.statistics.intervals import resolution_of
from rigidmc.statistics.measures import save_for_measures
from rigidmc.studies.framework.members import TUNING, Batches, Members, start_numbers
from rigidmc.studies.framework.options import (
    REQUIRED,
    Example,
    Names,
    Options,
    Words,
    confidence_option,
    option,
)
from rigidmc.studies.framework.study import Study
from rigidmc.studies.gradient.estimators import (
    carriers_of,
    growth_of,
    of_mean,
    of_quantile,
    of_score,
    terms_of,
)
from rigidmc.studies.gradient.scores import scores_of_noise, scores_of_scene
from rigidmc.studies.gradient.ways import ENDS, Asked, asked_of, ways

Array = NDArray[np.float64]
METHODS = "auto", "path", "score"
FEW = 30.0  # effective members below which an interval of a mean is not reliable


class GradientOptions(Options):
    """The options of `gradient`."""

    of: Words = option(
        REQUIRED,
        'measure, such as "mean(energy_last)", "median(omega_last[1])" or "p(flips >= 1)"; may be'
        " repeated",
        more="NAME_last is an observable at the end",
        metavar="MEASURE",
    )
    wrt: Names | None = option(
        None,
        "parameters, e.g. effects.gravity.g,start.omega.1.mean",
        missing="a new study needs parameters, as in start.omega.1,effects.gravity.g",
        metavar="NAMES",
    )
    method: str = option(
        "auto",
        'estimator: "path", by derivatives of members, "score", by the likelihood ratio, or'
        ' "auto"; by default "auto", which is "path" where possible',
    )
    confidence: float = confidence_option("confidence level of the intervals")


def observables_of(scene: Scene, texts: Sequence[str]) -> tuple[str, ...]:
    """Return the observables whose values at the end measures name."""
    words = [word for text in texts for word in re.findall(r"[A-Za-z_]\w*", text)]
    ended = [word.rsplit("_", 1)[0] for word in words if word.endswith(ENDS)]
    return saved_observables(ended, scene.observables)


def scene_with_derivatives(
    scene: Scene, options: GradientOptions, settings: Mapping[str, Any]
) -> Scene:
    """Return the scene with the members of the study; OptionError, SceneError."""
    if options.method not in METHODS:
        raise unknown("method", METHODS, at="method", value=options.method, error=OptionError)
    save = observables_of(scene, options.of)
    at_saves = saved_observables(scene.run.save, scene.observables)
    own = tuple(name for name in scene.run.save if name not in at_saves)
    scene = scene.with_run(save=(*save, *own), keep="full", every=0.5 * scene.run.t_end)
    # the saves have the values at the end: nothing needs to monitor NAME_last
    others = [re.sub(rf"\b({'|'.join(save)})_last\b", "", text) for text in options.of]
    scene = save_for_measures(scene, others if save else options.of)
    ending = saved_variables(scene.effects, make_recording(scene.with_run(keep="final")))
    last = {name.replace(*ENDS): about for name, about in ending.items()}
    known = {**variables_of(scene), **ending, **last}
    asked = [asked_of(text, known, scene, True) for text in options.of]
    assert options.wrt is not None
    names = expanded(scene, options.wrt)
    found = ways(scene, asked, names, options.method)
    by_path = [name for j, name in enumerate(names) if "path" in [row[j] for row in found]]
    by_noise = _by_noise(scene, names, found) and "noise_score" not in scene.run.save
    more = ("noise_score",) if by_noise else ()
    derived: Scene = scene.with_run(wrt=tuple(by_path), save=(*scene.run.save, *more))
    return derived


def _by_noise(scene: Scene, names: Sequence[str], plan: list[list[str]]) -> list[str]:
    """Return the parameters of noise by which a likelihood ratio differentiates."""
    of_noise = scores_of_noise(scene)
    scored = (name for j, name in enumerate(names) if "score" in [row[j] for row in plan])
    return [name for name in scored if name in of_noise]


def expanded(scene: Scene, names: Sequence[str]) -> tuple[str, ...]:
    """Return the parameters, vectors by component; SceneError for an unknown one."""
    scores, found = scores_of_scene(scene), dict[str, None]()
    for name in names:
        single: tuple[str, ...] = (name,)
        if name not in scores:
            single = parameters_of_run(scene.model, (name,))
        found |= dict.fromkeys(single)
    return tuple(found)


def with_ends(part: xr.Dataset) -> xr.Dataset:
    """Return a result with NAME_final and NAME_last of each observable that has all saves."""
    saved = [n for n, v in part.data_vars.items() if v.dims[:1] == ("time",) and "member" in v.dims]
    ends = {n: part[n].isel(time=-1, drop=True) for n in saved}
    return part.assign({f"{n}{end}": one for n, one in ends.items() for end in ENDS})


class Rates(NamedTuple):
    """Derivatives of one observable of members, over (parameter, n).

    rates : at the end;  half, end : sizes over all components, at half of the time (nan for results
        over all steps) and at the end
    """

    rates: Array
    half: Array
    end: Array


def rates_of(part: xr.Dataset, one: Asked, names: Sequence[str]) -> Rates:
    """Return the derivatives of the observable of a measure by parameters of the result; nan for
    flagged members."""
    found = part[derivative_name(one.observable)].sel(parameter=list(names))
    if "time" in found.dims:
        middle = int(np.abs(part.time.values - 0.5 * part.time.values[-1]).argmin())
        found = found.isel(time=[middle, -1])
    else:
        found = xr.concat([np.nan * found, found], "time")
    found = found.transpose("parameter", "time", ..., "member")
    values = np.where(part.status.values == 0, found.values, np.nan)
    axis = one.measure.result.axis
    size = np.sqrt((values.reshape(*values.shape[:2], -1, values.shape[-1]) ** 2).sum(2))
    end = values[:, -1] if axis is None else values[:, -1, axis - 1]
    return Rates(end, size[:, 0], size[:, 1])


def reduce(batches: Batches, options: GradientOptions) -> xr.Dataset:
    """Return the Dataset of the study of members."""
    scene, parts = batches.scene, []
    asked: list[Asked] = []
    names: tuple[str, ...] = ()
    plan: list[list[str]] = []
    units: list[str] = []
    steps: dict[str, int] = {}
    for part in map(with_ends, batches.results):
        if not asked:
            asked = [asked_of(text, part.data_vars, scene, False) for text in options.of]
            wrt = options.wrt or tuple(map(str, part.parameter.values))
            names = expanded(scene, wrt)
            plan = ways(scene, asked, names, options.method)
            units = [one.measure.units(part.data_vars) for one in asked]
            _refuse_missing(part, asked, names, plan)
            by_noise = _by_noise(scene, names, plan)
            _refuse_unscored(part, scene, by_noise)
            steps = {name: _steps(part) for name in by_noise}
        parts.append(_numbers(part, scene, asked, names, plan))
    numbers = [np.concatenate(one, axis=-1) for one in zip(*parts, strict=True)]
    found = _dataset(scene, asked, names, plan, numbers, options.confidence)
    about = {"long_name": "steps whose noise adds to the score", "units": "1"}
    scored = "parameter", [steps.get(name, 0) for name in names], about
    return found.assign_coords(unit=("measure", units), noise_steps=scored)


def _steps(part: xr.Dataset) -> int:
    """Return the number of steps of a result, of members with their own steps the mean."""
    own = float(part["steps"].mean()) if "steps" in part else part.attrs["steps"]
    return round(own)


def _refuse_missing(
    part: xr.Dataset, asked: list[Asked], names: tuple[str, ...], plan: list[list[str]]
) -> None:
    """Raise OptionError for derivatives that a stored result lacks."""
    has = set(map(str, part.parameter.values)) if "parameter" in part.coords else set()
    for one, row in zip(asked, plan, strict=True):
        for name, way in zip(names, row, strict=True):
            lacks = name not in has or derivative_name(one.observable) not in part
            if way == "path" and lacks:
                rule = f"the result has no derivatives of {one.observable} by {name}"
                raise OptionError(f"{rule}: run it with --wrt {name}", at="wrt", value=name)


def _refuse_unscored(part: xr.Dataset, scene: Scene, by_noise: Sequence[str]) -> None:
    """Raise OptionError if a stored result lacks the scores of its noise."""
    for name in by_noise:
        if scores_of_noise(scene)[name] not in part:
            rule = "the result has no score of its noise: run it with --save noise_score"
            raise OptionError(rule, at="wrt", value=name)


def _numbers(
    part: xr.Dataset, scene: Scene, asked: list[Asked], names: tuple[str, ...],
    plan: list[list[str]],
) -> tuple[Array, ...]:  # fmt: skip
    """Return (values (measure, n), rates, half, end (measure, parameter, n) for derivatives by the
    path and nan elsewhere, scores (parameter, n), good (1, n))."""
    count = part.sizes["member"]
    values = np.stack([one.measure.numbers(part) for one in asked])
    tangents = np.full((3, len(asked), len(names), count), np.nan)
    for i, (one, row) in enumerate(zip(asked, plan, strict=True)):
        some = [j for j, way in enumerate(row) if way == "path"]
        if some:
            tangents[:, i, some] = rates_of(part, one, [names[j] for j in some])
    scores, of_noise = scores_of_scene(scene), scores_of_noise(scene)
    found = np.zeros((len(names), count))
    for j, name in enumerate(names):
        if not any(row[j] == "score" for row in plan):
            continue
        if name in of_noise:
            found[j] = part[of_noise[name]].values
            continue
        drawn, score = scores[name]
        assert not isinstance(score, str)
        numbers = np.stack([start_numbers(part, word)[0] for word in drawn])
        found[j] = score(numbers if len(drawn) > 1 else numbers[0])
    good = (part.status.values == 0)[None].astype(float)
    return values, *tangents, found, good


def _dataset(
    scene: Scene, asked: list[Asked], names: tuple[str, ...], plan: list[list[str]],
    numbers: list[Array], confidence: float,
) -> xr.Dataset:  # fmt: skip
    """Return the Dataset from the numbers of `_numbers` of all members."""
    values, rates, half, end, scores, good = numbers
    is_good = good[0] == 1.0
    shape = len(asked), len(names)
    found, growth = np.full((3, *shape), np.nan), np.full((2, *shape), np.nan)
    value = np.full((3, len(asked)), np.nan)
    for i, one in enumerate(asked):
        y = values[i][is_good]
        kind = one.measure._replace(given=None)
        value[:, i] = kind.interval(y.astype(kind.dtype), np.isfinite(y), confidence)
        for j, way in enumerate(plan[i]):
            own = rates[i, j][is_good]
            if way == "score":
                found[:, i, j] = of_score(y, scores[j][is_good], confidence)
                growth[1, i, j] = carriers_of(terms_of(y, scores[j][is_good]))
                continue
            quantile = one.measure.kind == "quantile"
            level = one.measure.number
            found[:, i, j] = (
                of_quantile(y, own, level, confidence) if quantile else of_mean(own, confidence)
            )
            growth[:, i, j] = growth_of(half[i, j][is_good], end[i, j][is_good], own)
    if not is_sample(scene.model) or scene.run.points != "independent":
        found[1:], value[1:] = np.nan, np.nan  # the members are not independent draws
    return _labelled(scene, asked, names, plan, (found, growth, value), confidence).assign_attrs(
        members=int(is_good.size), left_out=int((~is_good).sum())
    )


def _labelled(
    scene: Scene, asked: list[Asked], names: tuple[str, ...], plan: list[list[str]],
    numbers: tuple[Array, Array, Array], confidence: float,
) -> xr.Dataset:  # fmt: skip
    found, growth, value = numbers
    over, variables = ("measure", "parameter"), dict[str, Any]()
    ends = {"": "", "_low": ": lower end", "_high": ": upper end"}
    for k, (key, more) in enumerate(ends.items()):
        text = f"derivative of the measure{more}"
        variables[f"derivative{key}"] = over, found[k], {"long_name": text}
        variables[f"value{key}"] = "measure", value[k], {"long_name": f"the measure{more}"}
    about = {"long_name": "median log growth of the tangents, over the run", "units": "1"}
    variables["growth"] = over, growth[0], about
    about = {"long_name": "effective number of members that carry the derivative", "units": "1"}
    variables["carriers"] = over, growth[1], about
    variables["method"] = over, np.array(plan), {"long_name": "estimator"}
    coordinates = {
        "measure": [one.measure.text for one in asked],
        "parameter": list(names),
        "parameter_unit": ("parameter", list(units_at(scene.model, names))),
    }
    attrs = {
        "title": scene.title,
        "confidence": confidence,
        "t_end": float(scene.run.t_end),
        "growth_limit": -math.log(resolution_of(scene)),
        "scene": scene.dumps(),
    }
    return xr.Dataset(variables, coordinates, attrs)


def table(study: xr.Dataset) -> list[str]:
    """Return the study as lines of text, with what chaos makes useless in words."""
    a = study.attrs
    lines = [f"{a['title']}: {count_text(a['members'], 'member')}, t = {a['t_end']:g} s"]
    for i, text in enumerate(study.measure.values):
        one = study.isel(measure=i)
        unit = str(one.unit.item())
        lines.append(f"  {text} = {_interval(one, 'value')} {unit if unit != '1' else ''}".rstrip())
        for j, name in enumerate(study.parameter.values):
            this = one.isel(parameter=j)
            units = quotient(unit, str(this.parameter_unit.item()))
            line = (
                f"    by {name:32s} {_interval(this, 'derivative')} {units}, {this.method.item()}"
            )
            lines += [line.replace(" 1,", ","), *(f"      {w}" for w in warnings_of(this))]
    if left := a["left_out"]:
        lines.append(f"  members left out because they are flagged: {left:,}")
    return lines


def warnings_of(one: xr.Dataset) -> list[str]:
    """Return what makes one derivative useless or doubtful, as text."""
    a, growth = one.attrs, float(one.growth)
    if growth > a["growth_limit"]:
        rate = growth / a["t_end"]
        horizon = a["growth_limit"] / rate
        return [
            f"useless: the motion is chaotic, tangents grow as exp({rate:.3g} t), and after"
            f" {horizon:.3g} s rounding decides the motion: use a shorter time, or the likelihood"
            ' ratio (method = "score")'
        ]
    if not np.isfinite(float(one.derivative)):
        return ["unknown: too few members have a value, or all have the same"]
    if int(one.noise_steps) and float(one.derivative_low) < 0.0 < float(one.derivative_high):
        return [
            f"uncertain in sign: the noise of {int(one.noise_steps):,} steps adds to the score, and"
            " its variance grows with their number: use fewer, longer steps, or more members"
        ]
    if float(one.carriers) < min(FEW, 0.5 * a["members"]):
        grown = f"; tangents grow by exp({growth:.3g}) in the run" if growth > 0.0 else ""
        few = f"few members carry it, as many as {float(one.carriers):.2g} equal ones would"
        return [f"doubtful: {few}{grown}"]
    return []


def _interval(one: xr.Dataset, key: str) -> str:
    value, low, high = (float(one[f"{key}{end}"]) for end in ("", "_low", "_high"))
    ends = f" ({low:.5g} to {high:.5g})" if low == low else ""
    return f"{value:.6g}{ends}"


gradient = Study(
    name="gradient",
    text=__doc__,
    options=GradientOptions,
    work=Members(scene_with_derivatives, reduce, batch=2**16),
    table=table,
    picture="gradient_bars",
    settings=(*TUNING, "members"),
    scene_text="a scene, its file, or the name of a shipped scene",
    source="a result with derivatives",
    example=Example(
        "dzhanibekov",
        {"of": "mean(omega_last[1])", "wrt": "start.omega.1,start.omega.2"},
        {"integrator": "rk4", "t_end": 2.0, "members": 40},
    ),
)
