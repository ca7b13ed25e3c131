"""What the model leaves out: torques that explain residuals which are not white.

Each candidate is fitted together with the parameters. One that gains much is proposed, and its fit
says how far its absence shifts the parameters: the covariance is the mean over the laws that the
data allow, and grows by the squares of their shifts.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from rigidmc.physics.effects import label_effects, name_of
from rigidmc.physics.effects.damping import AxialDamping, DryFriction, QuadraticDrag, ViscousDamping
from rigidmc.physics.effects.torques import BodyTorque
from rigidmc.scene.scene import Scene
from rigidmc.studies.fit.answers import best_of
from rigidmc.studies.fit.problem import FitProblem
from rigidmc.studies.fit.solve import minimise
from rigidmc.studies.fit.starts import make_starts
from rigidmc.studies.fit.streams import Array
from rigidmc.studies.fit.uncertainty import Assessment, assess

TRIALS = 16  # for each torque, among them those from the best answer without it
LEAST = 3.0  # laws exp(3) = 20 times less likely than the best are excluded
SIZES = (1e-3, 3e-2, 1.0)  # first guesses of a torque, times |L|/(length of the record)


class Candidate(NamedTuple):
    """A fit with another torque.

    text : the torque, in words;  effect : with its fitted parameters
    gain : of the logarithm of the likelihood, less 1/2 ln n for each further parameter
        (Schwarz, Ann. Stat. 6 (1978) 461), with the variance of the residuals of this fit
    problem, x : the fit and its coordinates
    """

    text: str
    effect: Any
    gain: float
    problem: FitProblem
    x: Array


class Law(NamedTuple):
    """A law of the motion that the data do not exclude: its probability, the coordinates of the
    parameters of the first fit, and their covariance."""

    weight: float
    x: Array
    covariance: Array


def laws(
    problem: FitProblem, x: Array, found: Assessment, torques: Sequence[Candidate]
) -> list[Law]:
    """Return the laws by their probabilities, that of the first fit first: the others are those
    that explain the data better, and none that is 20 times less likely than the best.

    Source: Madigan & Raftery, J. Am. Stat. Assoc. 89 (1994) 1535.
    """
    best = max([0.0, *(one.gain for one in torques)])
    each = [Law(np.exp(-best), x, found.covariance)]
    hidden = found.shown.unseen / found.shown.unit
    for one in torques:
        if one.gain > max(0.0, best - LEAST):
            place = {name: i for i, name in enumerate(one.problem.parameters.names)}
            some = [place[name] for name in problem.parameters.names]
            wider = assess(one.problem, one.x).covariance[np.ix_(some, some)]
            # what the data do not show is as in the first fit
            shift = (one.x[some] - x) / found.shown.unit
            shift -= np.linalg.pinv(hidden) @ (hidden @ shift)
            each.append(Law(np.exp(one.gain - best), x + shift * found.shown.unit, wider))
    total = sum(law.weight for law in each)
    return [law._replace(weight=law.weight / total) for law in each]


def covariance_of(laws: Sequence[Law], of: Callable[[Array], tuple[Array, Array]]) -> Array:
    """Return the covariance of quantities about their values in the first fit, over all laws.

    of : coordinates -> (quantities, their derivatives by the coordinates)
    """
    centre = of(laws[0].x)[0]
    total = np.zeros((centre.size, centre.size))
    for weight, x, covariance in laws:
        value, slope = of(x)
        shift = value - centre
        total += weight * (slope @ covariance @ slope.T + np.outer(shift, shift))
    return np.asarray(total)


def torques(moment: float, rate: float, time: float) -> list[tuple[str, str, Any]]:
    """Return (words, parameter, effect of unit size) of the candidates; unit size stops a body with
    this moment [kg m^2] and angular velocity [rad/s] in the time of a record [s]."""
    torque = moment * rate / time
    return [
        ("linear drag", "rate", ViscousDamping(1.0 / time)),
        ("quadratic drag", "drag", QuadraticDrag(torque / rate**2)),
        ("friction", "friction", DryFriction(torque, 1e-2 * rate)),
        ("drag that differs between the axes", "rates", AxialDamping((1.0 / time,) * 3)),
        ("a torque fixed in the body", "size", BodyTorque((torque,) * 3)),
    ]


def candidates(
    scene: Scene, problem: FitProblem, x: Array, cost: float,
    make: Callable[[Scene, Sequence[str]], FitProblem], all_of_them: bool,
) -> list[Candidate]:  # fmt: skip
    """Return the fits with one more torque each, the largest gain first.

    x, cost : the best answer of the fit without it
    make : (scene, names of further free parameters) -> its fit
    all_of_them : or drag alone, which every body in air has, and which nuisances may hide
    """
    found, taken = [], {name_of(effect) for _, effect in label_effects(scene.effects)}
    moment, rate, time = _scales(problem)
    tried = torques(moment, rate, time)
    for text, field, unit in tried if all_of_them else tried[:2]:
        if name_of(unit) in taken:
            continue
        wider = scene.with_model(scene.model._replace(effects=(*scene.effects, unit)))
        name = f"effects.{name_of(unit)}.{field}"
        larger = make(wider, (name,))
        # Also from new guesses: without its torque, the best answer may lie where no body can.
        trials = make_starts(larger, TRIALS, scene.run.seed)
        for i, size in enumerate(SIZES):
            first = np.array(getattr(unit, field)) * size
            trials[-1 - i] = _moved(problem, x, larger, {name: first})
        solution = minimise(larger, trials)
        best = best_of(larger, solution)
        n = problem.residuals
        fraction = solution.sums.cost[best] / cost
        more = larger.parameters.size - problem.parameters.size
        gain = -0.5 * n * float(np.log(fraction)) - 0.5 * more * float(np.log(n))
        whole = solution.x[best]
        effect = unit._replace(**{field: _fitted(larger, whole, name)})
        found.append(Candidate(text, effect, gain, larger, whole))
    return sorted(found, key=lambda one: -one.gain)


def _scales(problem: FitProblem) -> tuple[float, float, float]:
    """Return a moment [kg m^2], an angular velocity [rad/s] and a time [s] of the fit."""
    model, time = problem.run.scene.model, float(problem.run.layout.axes.times[-1])
    moments = [float(np.median(x)) for x in model.body.moments]
    rates = [s.values for s in problem.streams if s.observable == "omega"]
    rate = float(np.nanmax(np.abs(rates[0]))) if rates else 1.0 / time
    return max(moments), rate, time


def _moved(source: FitProblem, x: Array, target: FitProblem, more: dict[str, Array]) -> Array:
    """Return the coordinates of parameters in another fit. more : of parameters it has besides"""
    moved = target.parameters.coordinates(more)
    place = {name: i for i, name in enumerate(source.parameters.names)}
    for i, name in enumerate(target.parameters.names):
        if name in place:
            moved[i] = x[place[name]]
    return np.clip(moved, target.parameters.low, target.parameters.high)


def _fitted(problem: FitProblem, x: Array, name: str) -> Any:
    values = problem.parameters.values(x)[problem.parameters.places_of(name)[0]]
    return tuple(map(float, values)) if values.size > 1 else float(values[0])
