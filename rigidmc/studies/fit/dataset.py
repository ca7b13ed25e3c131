"""The Dataset of a fit: its answers, their intervals, the residuals, and the fitted scene."""

import math
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

import numpy as np
import xarray as xr
from scipy.special import ndtri  # `scipy.stats` takes 32 MB

from rigidmc.engine.kernel.normal_equations import ATTITUDE
from rigidmc.errors import RigidmcError
from rigidmc.mechanics.log_cholesky import cholesky_factor
from rigidmc.physics.effects import name_of
from rigidmc.scene.distributions import common
from rigidmc.scene.parameters import units_at, with_parameters
from rigidmc.scene.scene import Scene
from rigidmc.scene.varied import variables
from rigidmc.studies.fit.missing import Candidate, covariance_of, laws
from rigidmc.studies.fit.parameters import ratios
from rigidmc.studies.fit.problem import FitProblem
from rigidmc.studies.fit.solve import Solution
from rigidmc.studies.fit.streams import NUISANCES, Array
from rigidmc.studies.fit.uncertainty import Assessment
from rigidmc.studies.fit.visible import in_words
from rigidmc.studies.framework.variables import StudyVariable, make_dataset

AWAY = 5.0  # standard deviations: a drag that may be 0 is not drawn, since some would be below
ROUNDING = 1e-12  # of a variance: what is left of it follows from the numbers before
AXES = "body.moments.1", "body.moments.2", "body.moments.3"
VARIABLES = (
    StudyVariable("value", "answer parameter", "", "parameter at each answer", "in `unit`"),
    StudyVariable("deviation", "parameter", "", "standard deviation", "inf where nothing shows it"),
    StudyVariable("low", "parameter", "", "lower end of the interval"),
    StudyVariable("high", "parameter", "", "upper end of the interval"),
    StudyVariable(
        "covariance", "parameter other", "", "covariance of the parameters",
        "of what the data show",
    ),
    StudyVariable("ratio", "moment over", "1", "ratio of two principal moments"),
    StudyVariable("ratio_deviation", "moment over", "1", "standard deviation of the ratio"),
    StudyVariable("jitter", "sensor", "s", "standard deviation of the times of its samples"),
    StudyVariable("jitter_deviation", "sensor", "s", "standard deviation of the jitter"),
    StudyVariable("cost", "answer", "1", "sum of the squares of the residuals over their noise"),
    StudyVariable("ends", "answer", "1", "number of trials that end there"),
    StudyVariable("gain", "torque", "1", "gain of the logarithm of the likelihood by a torque"),
    StudyVariable("data", "sample", "", "measured value"),
    StudyVariable("model", "sample", "", "value at the best answer"),
    StudyVariable("model_deviation", "sample", "", "standard deviation of the model"),
    StudyVariable("noise", "sample", "", "standard deviation of the value"),
)  # fmt: skip


def dataset_of(
    scene: Scene,
    problem: FitProblem,
    solution: Solution,
    found: Assessment,
    torques: Sequence[Candidate],
    confidence: float,
) -> xr.Dataset:
    """Return the Dataset of a fit.

    scene : as the user gives it;  solution : the answers, the best first
    found : what its residuals say;  torques : missing ones
    """
    parameters, x = problem.parameters, solution.x[0]
    t, data, noise, names, which, _ = problem.samples_in_order()
    allowed = laws(x, found, torques)
    slopes, value = parameters.slopes(x), parameters.values(x)
    covariance = covariance_of(allowed, lambda y: (parameters.values(y), parameters.slopes(y)))
    deviation = np.sqrt(np.diag(covariance))
    jacobian = problem.jacobian(x, is_white=False)[1]
    spread = np.sqrt(np.maximum(0.0, ((jacobian @ found.covariance) * jacobian).sum(1)))
    shown_deviation = np.where(found.shown.hides(slopes), math.inf, deviation)
    width = ndtri(0.5 + 0.5 * confidence)
    ratio, ratio_deviation = np.full((2, 3, 3), np.nan)
    if parameters.mixed:  # the moments come first
        pairs = np.indices((3, 3)).reshape(2, -1)

        def of_moments(y: Array) -> tuple[Array, Array]:
            return ratios(parameters.values(y), parameters.slopes(y), *pairs)

        each, change = of_moments(x)
        variance = np.maximum(np.diag(covariance_of(allowed, of_moments)), 0.0)
        ratio = each.reshape(3, 3)
        is_hidden = found.shown.hides(change)
        ratio_deviation = np.where(is_hidden, math.inf, np.sqrt(variance)).reshape(3, 3)
    made = {
        "value": np.stack([parameters.values(y) for y in solution.x]),
        "deviation": shown_deviation,
        "low": value - width * shown_deviation,
        "high": value + width * shown_deviation,
        "covariance": covariance,
        "ratio": ratio,
        "ratio_deviation": ratio_deviation,
        "jitter": np.array([stream.jitter.size for stream in problem.streams]),
        "jitter_deviation": np.array([stream.jitter.deviation for stream in problem.streams]),
        "cost": solution.sums.cost,
        "ends": solution.ends,
        "gain": np.array([torque.gain for torque in torques]),
        "data": data,
        "model": data - found.residuals * noise,
        "model_deviation": noise * spread,
        "noise": noise,
    }
    units, of_parameters = _units(problem)
    coordinates = {
        "parameter": parameters.names,
        "other": parameters.names,
        "unit": ("parameter", of_parameters),
        "sample_time": ("sample", t),
        "channel": ("sample", names),
        "channel_unit": ("sample", [units[name.partition("[")[0]] for name in names]),
        "record": ("sample", which + 1),
        "moment": list(AXES),
        "over": list(AXES),
        "sensor": [stream.observable for stream in problem.streams],
        "torque": [torque.text for torque in torques],
        "torque_parameter": ("torque", [torque.parameter for torque in torques]),
        "setting": ("torque", [_setting(torque.effect) for torque in torques]),
    }
    attrs = {
        "reduced_chi_square": found.variance,
        "white": found.error.white,
        "lasting": found.error.lasting,
        "lasting_time": found.error.time,
        "lasting_gain": found.error.gain,
        "unseen": "\n".join(in_words(parameters, x, found.shown)),
        "residuals": found.residuals.size,
        "confidence": confidence,
        "fitted": fitted_scene(scene, problem, value, covariance).dumps(),
    }
    return make_dataset(VARIABLES, made, coordinates, attrs)


def _units(problem: FitProblem) -> tuple[dict[str, str], list[str]]:
    """Return ({observable: SI units of its readings, a rotation vector for an attitude}, SI units
    of all parameters)."""
    parameters, recording = problem.parameters, problem.run.layout.recording
    names = [s.observable for s in problem.streams]
    units = {name: recording.observable(name).units for name in names}
    units |= {s.observable: "rad" for s in problem.streams if s.kind == ATTITUDE}
    each = np.empty(parameters.size, object)
    for column in parameters.columns:
        if column.word:
            unit = NUISANCES[column.word].unit or units[names[column.stream]]
        else:
            (unit,) = units_at(problem.run.scene.model, [column.name])
        each[parameters.index[:, column.columns]] = unit
    return units, each.tolist()


def _setting(effect: Any) -> str:
    """Return an effect as a setting of a scene, KEY=VALUE."""
    numbers = ((key, np.asarray(x).tolist()) for key, x in effect._asdict().items())
    texts = (
        f"{key}=[{', '.join(f'{y:.3g}' for y in x)}]" if isinstance(x, list) else f"{key}={x:.3g}"
        for key, x in numbers
    )
    return f"effects.{name_of(effect)}={{{', '.join(texts)}}}"


def fitted_scene(scene: Scene, problem: FitProblem, value: Array, covariance: Array) -> Scene:
    """Return the scene with the fitted numbers of its first record, drawn with their covariance."""
    parameters, model = problem.parameters, scene.model
    known = variables(problem.run.scene.model)
    columns = [c for c in parameters.columns if c.stream < 0 and c.name not in parameters.tied]
    # in the order of the scene, by which studies name what numbers have in common
    columns.sort(key=lambda column: list(known).index(column.name))
    places = np.concatenate([parameters.index[0, column.columns] for column in columns])
    mean, own = value[places], covariance[np.ix_(places, places)]
    rows = np.array(cholesky_factor(own.tolist()))
    rows[rows**2 < ROUNDING * np.diag(own)[:, None]] = 0.0
    spread, low, high = AWAY * np.linalg.norm(rows, axis=1), parameters.low, parameters.high
    near = (mean - spread < low[places]) | (mean + spread > high[places])
    near &= places >= parameters.mixed  # moments are not their coordinates
    drawn, some = value.astype(object), rows.any(1) & ~near
    for place, row in zip(places[some], rows[some], strict=True):
        drawn[place] = common(value[place], *np.trim_zeros(row, "b"))
    for column in columns:
        for numbers in (value, drawn):
            each = tuple(numbers[parameters.index[0, column.columns]].tolist())
            put = each if parameters.is_vector[column.name] else each[0]
            with suppress(RigidmcError):  # what no distribution may draw stays certain
                model = with_parameters(model, {column.name: put}, "free", known)
    # the data allow members that a matrix drives
    drives = any(column.name.endswith(".matrix") for column in columns)
    return scene.with_model(model).with_run(anti_damping=drives or scene.run.anti_damping)
