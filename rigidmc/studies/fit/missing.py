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
from rigidmc.studies.fit.answers import best_of, upright
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

    text : the torque, in words;  effect : with its fitted parameters;  parameter : its name
    gain : of the evidence, see `rigidmc.studies.fit.uncertainty.Assessment`
    x, found : the coordinates of the fit, and what its residuals say
    places : of the coordinates of the first fit among its own
    """

    text: str
    effect: Any
    parameter: str
    gain: float
    x: Array
    found: Assessment
    places: list[int]


class Law(NamedTuple):
    """A law of the motion that the data do not exclude: its probability, the coordinates of the
    parameters of the first fit, and their covariance."""

    weight: float
    x: Array
    covariance: Array


def laws(x: Array, found: Assessment, torques: Sequence[Candidate]) -> list[Law]:
    """Return the laws by their probabilities, that of the first fit first: the others are those
    that explain the data better, and none that is 20 times less likely than the best.

    Source: Madigan & Raftery, J. Am. Stat. Assoc. 89 (1994) 1535.
    """
    best = max([0.0, *(one.gain for one in torques)])
    each = [Law(np.exp(-best), x, found.covariance)]
    hidden = found.shown.unseen / found.shown.unit
    for one in torques:
        if one.gain > max(0.0, best - LEAST):
            wider = one.found.covariance[np.ix_(one.places, one.places)]
            # what the data do not show is as in the first fit
            shift = (one.x[one.places] - x) / found.shown.unit
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


def torques(problem: FitProblem) -> list[tuple[str, str, Any]]:
    """Return (words, parameter, effect of unit size) of the candidates; unit size stops the body in
    the time of a record."""
    time = float(problem.run.layout.axes.times[-1])
    rates = [s.values for s in problem.streams if s.observable == "omega"]
    rate = float(np.nanmax(np.abs(rates[0]))) if rates else 1.0 / time
    torque = max(float(np.median(x)) for x in problem.run.scene.model.body.moments) * rate / time
    return [
        ("linear drag", "rate", ViscousDamping(1.0 / time)),
        ("quadratic drag", "drag", QuadraticDrag(torque / rate**2)),
        ("friction", "friction", DryFriction(torque, 1e-2 * rate)),
        ("drag that differs between the axes", "rates", AxialDamping((1.0 / time,) * 3)),
        ("a torque fixed in the body", "size", BodyTorque((torque,) * 3)),
    ]


def candidates(
    scene: Scene, problem: FitProblem, x: Array, found: Assessment,
    make: Callable[[Scene, Sequence[str]], FitProblem],
) -> list[Candidate]:  # fmt: skip
    """Return the fits with one more torque each, the largest gain first: drag, which every body in
    air has, and which nuisances may hide; the others where residuals are correlated.

    x, found : the best answer of the fit without it, and what its residuals say
    make : (scene, names of further free parameters) -> its fit
    """
    each, taken = [], {name_of(effect) for _, effect in label_effects(scene.effects)}
    for text, field, unit in torques(problem)[: None if found.error.is_seen else 2]:
        if name_of(unit) in taken:
            continue
        wider = scene.with_model(scene.model._replace(effects=(*scene.effects, unit)))
        name = f"effects.{name_of(unit)}.{field}"
        larger = make(wider, (name,))
        parameters = larger.parameters
        places = [parameters.names.index(one) for one in problem.parameters.names]
        # Also from new guesses: without its torque, the best answer may lie where no body can.
        trials = make_starts(larger, TRIALS, scene.run.seed)
        for trial, size in zip(trials[::-1], SIZES, strict=False):
            trial[:] = parameters.coordinates({name: np.array(getattr(unit, field)) * size})
            trial[places] = x
        solution = minimise(larger, np.clip(trials, parameters.low, parameters.high))
        solution = upright(larger, solution)
        end = solution.x[best_of(larger, solution)]
        more = assess(larger, end)
        fitted = parameters.values(end)[parameters.places_of(name)[0]].tolist()
        effect = unit._replace(**{field: tuple(fitted) if len(fitted) > 1 else fitted[0]})
        gain = more.evidence - found.evidence
        each.append(Candidate(text, effect, name, gain, end, more, places))
    return sorted(each, key=lambda one: -one.gain)
