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

{returns}

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
>>> study = rm.gradient(scene, "mean(energy_last)", ["start.omega.3.mean"], **run)
>>> study.derivative.values.round(1).tolist()  # I m
[[2.0]]
"""

import math
import re
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from rigidmc.inputs.arrays import Array, Bools
from rigidmc.physics.observables import saved_observables
from rigidmc.results.labels import count_text
from rigidmc.results.variables import saved_variables, variables_of
from rigidmc.scene.derivatives import derivative_name, quotient
from rigidmc.scene.parameters import units_at
from rigidmc.scene.sampling import is_sample
from rigidmc.scene.scene import Scene
from rigidmc.statistics.intervals import Interval, resolution_of
from rigidmc.statistics.measures import save_for_measures
from rigidmc.studies.framework.members import TUNING, Batches, Members, start_numbers
from rigidmc.studies.framework.options import (
    REQUIRED,
    Names,
    Options,
    Words,
    confidence_option,
    option,
)
from rigidmc.studies.framework.study import Example, Study
from rigidmc.studies.framework.variables import StudyVariable, interval_of, make_dataset
from rigidmc.studies.gradient import estimators
from rigidmc.studies.gradient.question import ENDS, Asked, Question
from rigidmc.studies.gradient.scores import scores_of_model, scores_of_noise

METHODS = "auto", "path", "score"
FEW = 30.0  # effective members below which an interval of a mean is not reliable
VARIABLES = (
    StudyVariable(
        "derivative", "measure parameter", "", "derivative of the measure",
        "in `unit` per `parameter_unit`", has_interval=True,
    ),
    StudyVariable("value", "measure", "", "the measure", "in `unit`", has_interval=True),
    StudyVariable(
        "growth", "measure parameter", "1", "median log growth of the tangents, over the run"
    ),
    StudyVariable(
        "carriers", "measure parameter", "1",
        "effective number of members that carry the derivative",
    ),
    StudyVariable("method", "measure parameter", "", "estimator"),
)  # fmt: skip


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
        words=METHODS,
    )
    confidence: float = confidence_option("confidence level of the intervals")


def observables_of(observables: tuple[Any, ...], texts: Sequence[str]) -> tuple[str, ...]:
    """Return the observables whose values at the end measures name."""
    words = [word for text in texts for word in re.findall(r"[A-Za-z_]\w*", text)]
    ended = [word.rsplit("_", 1)[0] for word in words if word.endswith(ENDS)]
    return saved_observables(ended, observables)


def scene_with_derivatives(
    scene: Scene, options: GradientOptions, settings: Mapping[str, Any]
) -> Scene:
    """Return the scene with the members of the study; OptionError, SceneError."""
    save = observables_of(scene.observables, options.of)
    at_saves = saved_observables(scene.run.save, scene.observables)
    others = tuple(name for name in scene.run.save if name not in at_saves)
    scene = scene.with_run(save=(*save, *others), keep="full", every=0.5 * scene.run.t_end)
    # the saves have the values at the end: nothing needs to monitor NAME_last
    texts = [re.sub(rf"\b({'|'.join(save)})_last\b", "", text) for text in options.of]
    scene = save_for_measures(scene, texts if save else options.of)
    ending = saved_variables(scene.effects, scene.with_run(keep="final").recording)
    last = {name.replace(*ENDS): about for name, about in ending.items()}
    variables = {**variables_of(scene), **ending, **last}
    assert options.wrt is not None
    question = Question.of(scene, options.of, options.wrt, options.method, variables, True)
    needs_noise = question.by_noise() and "noise_score" not in scene.run.save
    save = (*scene.run.save, *(("noise_score",) if needs_noise else ()))
    derived: Scene = scene.with_run(wrt=question.by("path"), save=save)
    return derived


def with_ends(part: xr.Dataset) -> xr.Dataset:
    """Return a result with NAME_final and NAME_last of each observable that has all saves."""
    saved = [n for n, v in part.data_vars.items() if v.dims[:1] == ("time",) and "member" in v.dims]
    ends = {n: part[n].isel(time=-1, drop=True) for n in saved}
    return part.assign({f"{n}{end}": last for n, last in ends.items() for end in ENDS})


class MemberNumbers(NamedTuple):
    """The numbers of members from which a gradient is estimated.

    values : of each measure (measure, n)
    rates, half, end : derivatives by the path at the end, and their sizes over all components at
        half of the time (nan for results over all steps) and at the end (measure, parameter, n);
        nan for flagged members and where there is no derivative by the path
    scores : of each parameter (parameter, n)
    is_good : (1, n)
    """

    values: Array
    rates: Array
    half: Array
    end: Array
    scores: Array
    is_good: Bools


def _numbers(part: xr.Dataset, question: Question) -> MemberNumbers:
    """Return the MemberNumbers of the members of a result."""
    count, names = part.sizes["member"], question.names
    is_good = part.status.values == 0
    tangents = np.full((3, len(question.asked), len(names), count), np.nan)
    for i, (asked, row) in enumerate(zip(question.asked, question.ways, strict=True)):
        by_path = [j for j, way in enumerate(row) if way == "path"]
        if by_path:
            derivatives = part[derivative_name(asked.observable)]
            derivatives = derivatives.sel(parameter=[names[j] for j in by_path])
            tangents[:, i, by_path] = _tangents(asked, derivatives.where(is_good), part.time.values)
    by_noise, scores = scores_of_noise(question.model.effects), scores_of_model(question.model)
    of_members = np.zeros((len(names), count))
    for name in question.by("score"):
        j = names.index(name)
        if name in by_noise:
            of_members[j] = part[by_noise[name]].values
            continue
        drawn, score = scores[name]
        assert not isinstance(score, str)
        numbers = np.stack([start_numbers(part, word)[0] for word in drawn])
        of_members[j] = score(numbers if len(drawn) > 1 else numbers[0])
    values = np.stack([asked.measure.numbers(part) for asked in question.asked])
    rates, half, end = tangents
    return MemberNumbers(values, rates, half, end, of_members, is_good[None])


def _tangents(asked: Asked, derivatives: xr.DataArray, times: Array) -> tuple[Array, Array, Array]:
    """Return the `rates`, `half` and `end` of `MemberNumbers`, (parameter, n) each."""
    if "time" in derivatives.dims:
        middle = int(np.abs(times - 0.5 * times[-1]).argmin())
        derivatives = derivatives.isel(time=[middle, -1])
    else:
        derivatives = xr.concat([np.nan * derivatives, derivatives], "time")
    values = derivatives.transpose("parameter", "time", ..., "member").values
    axis = asked.measure.result.axis
    size = np.sqrt((values.reshape(*values.shape[:2], -1, values.shape[-1]) ** 2).sum(2))
    end = values[:, -1] if axis is None else values[:, -1, axis - 1]
    return end, size[:, 0], size[:, 1]


def reduce(batches: Batches, options: GradientOptions) -> xr.Dataset:
    """Return the Dataset of the study of members."""
    scene, parts, question = batches.scene, list[MemberNumbers](), None
    for part in map(with_ends, batches.results):
        if question is None:
            wrt = options.wrt or tuple(map(str, part.parameter.values))
            variables = part.data_vars
            question = Question.of(scene, options.of, wrt, options.method, variables, False)
            question.refuse_lacking(part)
            units = [asked.measure.units(variables) for asked in question.asked]
            by_noise = question.by_noise()
            steps = [_steps(part) if name in by_noise else 0 for name in question.names]
        parts.append(_numbers(part, question))
    assert question is not None
    numbers = MemberNumbers(*(np.concatenate(x, axis=-1) for x in zip(*parts, strict=True)))
    derivative, value, growth, carriers = _estimates(question, numbers, options.confidence)
    if not is_sample(scene.model) or scene.run.points != "independent":
        derivative[1:], value[1:] = np.nan, np.nan  # the members are not independent draws
    values = {
        "derivative": Interval(*derivative),
        "value": Interval(*value),
        "growth": growth,
        "carriers": carriers,
        "method": np.array(question.ways),
    }
    about = {"long_name": "steps whose noise adds to the score", "units": "1"}
    coordinates = {
        "measure": [asked.measure.text for asked in question.asked],
        "parameter": list(question.names),
        "parameter_unit": ("parameter", list(units_at(scene.model, question.names))),
        "unit": ("measure", units),
        "noise_steps": ("parameter", steps, about),
    }
    attrs = {
        "confidence": options.confidence,
        "t_end": float(scene.run.t_end),
        "growth_limit": -math.log(resolution_of(scene.run)),
        "members": numbers.is_good.size,
        "left_out": int((~numbers.is_good).sum()),
    }
    return make_dataset(VARIABLES, values, coordinates, attrs)


def _steps(part: xr.Dataset) -> int:
    """Return the number of steps of a result, of members with their own steps the mean."""
    return round(float(part["steps"].mean()) if "steps" in part else part.attrs["steps"])


def _estimates(
    question: Question, numbers: MemberNumbers, confidence: float
) -> tuple[Array, Array, Array, Array]:
    """Return (derivatives with their ends (3, measure, parameter), measures with theirs
    (3, measure), growth and carriers (measure, parameter))."""
    values, rates, half, end, scores, _ = (x[..., numbers.is_good[0]] for x in numbers)
    shape = len(question.asked), len(question.names)
    derivative, growth = np.full((3, *shape), np.nan), np.full((2, *shape), np.nan)
    value = np.full((3, len(question.asked)), np.nan)
    for i, (measure, _) in enumerate(question.asked):
        y, kind = values[i], measure._replace(given=None)
        value[:, i] = kind.interval(y.astype(kind.dtype), np.isfinite(y), confidence)
        for j, way in enumerate(question.ways[i]):
            if way == "score":
                derivative[:, i, j] = estimators.of_score(y, scores[j], confidence)
                growth[1, i, j] = estimators.carriers_of(estimators.terms_of(y, scores[j]))
                continue
            if measure.kind == "quantile":
                derivative[:, i, j] = estimators.of_quantile(
                    y, rates[i, j], measure.number, confidence
                )
            else:
                derivative[:, i, j] = estimators.of_mean(rates[i, j], confidence)
            growth[:, i, j] = estimators.growth_of(half[i, j], end[i, j], rates[i, j])
    return derivative, value, *growth


def table(study: xr.Dataset) -> list[str]:
    """Return the study as lines of text, with what chaos makes useless in words."""
    a = study.attrs
    lines = [f"{a['title']}: {count_text(a['members'], 'member')}, t = {a['t_end']:g} s"]
    for i, text in enumerate(study.measure.values):
        row = study.isel(measure=i)
        unit = str(row.unit.item())
        lines.append(f"  {text} = {_interval(row, 'value')} {unit if unit != '1' else ''}".rstrip())
        for j, name in enumerate(study.parameter.values):
            cell = row.isel(parameter=j)
            units = quotient(unit, str(cell.parameter_unit.item()))
            number = f"{_interval(cell, 'derivative')} {units}, {cell.method.item()}"
            lines.append(f"    by {name:32s} {number}".replace(" 1,", ","))
            lines += [f"      {words}" for words in warnings_of(cell)]
    if left := a["left_out"]:
        lines.append(f"  members left out because they are flagged: {left:,}")
    return lines


def warnings_of(cell: xr.Dataset) -> list[str]:
    """Return what makes one derivative useless or doubtful, as text."""
    a, growth, carriers = cell.attrs, float(cell.growth), float(cell.carriers)
    derivative = interval_of(cell, "derivative")
    if growth > a["growth_limit"]:
        rate = growth / a["t_end"]
        horizon = a["growth_limit"] / rate
        return [
            f"useless: the motion is chaotic, tangents grow as exp({rate:.3g} t), and after"
            f" {horizon:.3g} s rounding decides the motion: use a shorter time, or the likelihood"
            ' ratio (method = "score")'
        ]
    if not np.isfinite(derivative.value):
        return ["unknown: too few members have a value, or all have the same"]
    if int(cell.noise_steps) and derivative.low < 0.0 < derivative.high:
        return [
            f"uncertain in sign: the noise of {int(cell.noise_steps):,} steps adds to the score,"
            " and its variance grows with their number: use fewer, longer steps, or more members"
        ]
    if carriers < min(FEW, 0.5 * a["members"]):
        grown = f"; tangents grow by exp({growth:.3g}) in the run" if growth > 0.0 else ""
        few = f"few members carry it, as many as {carriers:.2g} equal ones would"
        return [f"doubtful: {few}{grown}"]
    return []


def _interval(study: xr.Dataset, name: str) -> str:
    value, low, high = interval_of(study, name)
    return f"{value:.6g}{f' ({low:.5g} to {high:.5g})' if low == low else ''}"


gradient = Study(
    name="gradient",
    text=__doc__,
    options=GradientOptions,
    work=Members(scene_with_derivatives, reduce, batch=2**16),
    table=table,
    variables=VARIABLES,
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
