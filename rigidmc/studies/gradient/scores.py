"""Scores of distributions: derivatives of log densities by their parameters.

With the density f(x; p) of a number x that members draw, and Y of a member any function of it::

    d<Y>/dp = <Y s>,   s = d ln f(x; p)/dp,   <s> = 0

This holds even if Y jumps, as an indicator or a count does; but not if p moves an end of the
support of f.
The noise of a bath has a density, too: its score is a sum over the steps, see
`rigidmc.physics.observables.noise_score`.
Source: Glynn, Commun. ACM 33 (1990) 75; Rubinstein, Oper. Res. 37 (1989) 72.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, cast

import numpy as np
from scipy import special

from rigidmc.inputs.arrays import Array
from rigidmc.physics.dynamics.methods import implements
from rigidmc.physics.effects import label_effects
from rigidmc.physics.effects.bath import Bath
from rigidmc.physics.effects.protocol import depends_on_momentum, is_random
from rigidmc.physics.observables import NoiseScore
from rigidmc.planning.initial import uncertain_numbers
from rigidmc.scene.distributions import Common, Distribution, Truncated
from rigidmc.scene.mixtures import Mixture
from rigidmc.scene.model import Model
from rigidmc.scene.parameter import get
from rigidmc.scene.parameters import parameters_of, value_at
from rigidmc.scene.vector_distributions.ensembles import GibbsMomentum
from rigidmc.scene.vector_distributions.vectors import Correlated

Score = Callable[[Array], Array]  # of the drawn numbers (n,)
Refusal = str
MOVES = "moves an end of the support, where the density jumps"


def scores_of_model(model: Model) -> dict[str, tuple[tuple[str, ...], Score | Refusal]]:
    """Return {parameter: (names of the drawn numbers, its score or the reason why there is none)}.

    Derivatives have the same names, such as start.omega.1.mean. The score is a function of the
    drawn numbers: (n,), or (3, n) of the three components of a `Correlated` vector, or (6, n) of
    a momentum in equilibrium and the moments.
    """
    scores: dict[str, tuple[tuple[str, ...], Score | Refusal]] = {}
    probed = model
    if model.start.attitude == "ensemble":  # its rejection cannot be probed, and has no score
        probed = model._replace(start=replace(model.start, attitude="uniform"))
    for name in uncertain_numbers(probed)[0]:
        if name.startswith("body.tensor"):
            continue  # drawn as a matrix
        value = value_at(model, name)
        if isinstance(value, Correlated):
            parts = tuple(f"{name}.{i}" for i in (1, 2, 3))
            for i in range(3):
                scores[f"{name}.mean.{i + 1}"] = parts, partial(_of_mean, value, i)
        elif isinstance(value, Distribution) and not isinstance(value, Common):
            scores |= {f"{name}.{key}": ((name,), score) for key, score in scores_of(value).items()}
    return {**scores, **_of_equilibrium(model)}


def _of_equilibrium(model: Model) -> dict[str, tuple[tuple[str, ...], Score | Refusal]]:
    """Return the score of the temperature of a momentum in equilibrium, which is normal with
    variances I_i kT."""
    start, name = model.start, "start.momentum.kT"
    if not isinstance(start.momentum, GibbsMomentum) or not isinstance(start.momentum.kT, float):
        return {}
    kT = start.momentum.kT
    parts = tuple(f"{word}.{i}" for word in ("start.momentum", "body.moments") for i in (1, 2, 3))
    score: Score | Refusal = partial(_of_gibbs, kT)
    if kT == 0.0:
        score = "is 0: nothing is drawn"
    if model.body.is_turned:
        score = "has a score only for a body with moments in place of a tensor"
    if start.attitude == "ensemble" and any(implements(e, "energy") for e in model.effects):
        score = "also changes the attitudes of the ensemble, which are drawn by rejection"
    return {name: (parts, score)}


def _of_gibbs(kT: float, x: Array) -> Array:
    return np.asarray(((x[:3] ** 2 / (x[3:] * kT)).sum(0) - 3.0) / (2.0 * kT))


def scores_of_noise(effects: Sequence[Any]) -> dict[str, str]:
    """Return {parameter of a bath: variable of a result with its score}."""
    return {
        f"effects.{label}.{name.removesuffix('_score')}": name
        for label, effect in label_effects(effects)
        if isinstance(effect, Bath)
        for name in cast(Any, NoiseScore).outputs
    }


def why_no_noise_score(model: Model, name: str) -> str:
    """Return the reason why the noise of a model has no score by a parameter; "" if it has, or if
    there is no noise.

    The noise of a step is a change of L at a fixed attitude. A torque, a moment or a start also
    changes the attitude before the next noise: motions with two of its values never meet, and have
    no ratio of densities.
    """
    effects = model.effects
    if not any(map(is_random, effects)):
        return ""
    baths = [pair for pair in label_effects(effects) if isinstance(pair[1], Bath)]
    if not baths:
        return "only the noise of a bath has a score"
    label, bath = baths[0]
    if name in scores_of_noise(effects):
        zero = [word for word in ("gamma", "kT") if np.any(getattr(bath, word) == 0.0)]
        return f"there is no noise at {zero[0]} = 0" if zero else ""
    of_noise = f"the noise has a score by effects.{label}.gamma and effects.{label}.kT alone"
    path = parameters_of(model)[name].path
    if path[0] == "effects" and depends_on_momentum(get(model, path[:2])):
        return of_noise
    return f"{of_noise}: it acts on L, and {name} also moves the attitude in a step"


def _of_mean(law: Correlated, i: int, x: Array) -> Array:
    away = x - np.asarray(law.mean, float)[:, None]
    return np.asarray(np.linalg.solve(np.asarray(law.covariance, float), away)[i])


def scores_of(law: Distribution) -> dict[str, Score | Refusal]:
    """Return {parameter: its score, or the reason why there is none} of a distribution, with the
    names of `rigidmc.scene.reparametrise.rates_of`."""
    if isinstance(law, Mixture):
        return _of_mixture(law)
    if isinstance(law, Truncated):
        return _of_truncated(law)
    if law.name == "normal":
        return {"mean": _standard(law, _slope), "standard_deviation": _standard(law, _of_width)}
    if law.name == "uniform":
        return {"low": MOVES, "high": MOVES}
    shapes = {"loc": 0.0, "scale": 1.0} | dict(law.parameters)
    if law.name not in _FAMILIES:
        why = f"has no score here: {law.name} is not among {', '.join(sorted(_FAMILIES))}"
        return dict.fromkeys(shapes, why)
    scores: dict[str, Score | Refusal] = {"loc": MOVES}
    loc, scale = shapes.pop("loc"), shapes.pop("scale")
    for key, (score, is_scaled) in _FAMILIES[law.name](**shapes).items():
        scores[key] = partial(_at, score, loc, scale, scale if is_scaled else 1.0)
    return scores


def _at(score: Score, loc: float, scale: float, by: float, x: Array) -> Array:
    with np.errstate(all="ignore"):
        return score((x - loc) / scale) / by


def _standard(law: Distribution, score: Score) -> Score:
    mean, sd = map(float, law.parameters)
    return partial(_at, score, mean, sd, sd)


def _slope(z: Array) -> Array:
    return z


def _of_width(z: Array) -> Array:
    return z * z - 1.0


# {distribution: its parameters -> {parameter: (score of z = (x - loc)/scale, whether it is divided
# by the scale)}}
_FAMILIES: dict[str, Callable[..., dict[str, tuple[Score, bool]]]] = {
    "expon": lambda: {"scale": (lambda z: z - 1.0, True)},
    "gamma": lambda a: {
        "scale": (lambda z: z - a, True),
        "a": (lambda z: np.log(z) - special.digamma(a), False),
    },
    "laplace": lambda: {"loc": (np.sign, True), "scale": (lambda z: np.abs(z) - 1.0, True)},
    "logistic": lambda: {
        "loc": (lambda z: np.tanh(0.5 * z), True),
        "scale": (lambda z: z * np.tanh(0.5 * z) - 1.0, True),
    },
    "lognorm": lambda s: {
        "s": (lambda z: ((np.log(z) / s) ** 2 - 1.0) / s, False),
        "scale": (lambda z: np.log(z) / s**2, True),
    },
    "norm": lambda: {"loc": (_slope, True), "scale": (_of_width, True)},
    "rayleigh": lambda: {"scale": (lambda z: z * z - 2.0, True)},
}


def _of_truncated(law: Truncated) -> dict[str, Score | Refusal]:
    """The density f/(F(b) - F(a)) has the score of f less its mean between the bounds."""
    inner, low, high = law.parameters

    def centred(score: Score, x: Array) -> Array:
        expect = inner.frozen().expect
        middle = expect(lambda at: float(score(np.array(at))), lb=low, ub=high, conditional=True)
        return score(x) - float(middle)

    of_inner = scores_of(inner).items()
    scores = {k: x if isinstance(x, str) else partial(centred, x) for k, x in of_inner}
    return {"between.1": MOVES, "between.2": MOVES, **scores}


def _of_mixture(law: Mixture) -> dict[str, Score | Refusal]:
    """Of the density sum_k w_k f_k/sum_k w_k, by weights and by parameters of the components."""
    total = float(sum(weight for weight, _ in law.parameters))

    def densities(x: Array) -> Array:
        return np.exp([part.log_density(x) for _, part in law.parameters])

    def of_weight(i: int, x: Array) -> Array:
        f = densities(x)
        return np.asarray((f[i] / (law.shares() @ f) - 1.0) / total)

    def of_component(i: int, score: Score, x: Array) -> Array:
        f = densities(x)
        share = law.shares()[i] * f[i] / (law.shares() @ f)
        return np.where(share > 0.0, share * score(x), 0.0)

    scores: dict[str, Score | Refusal] = {}
    for i, (_, part) in enumerate(law.parameters):
        scores[f"{i + 1}.weight"] = partial(of_weight, i)
        for key, x in scores_of(part).items():
            scores[f"{i + 1}.{key}"] = x if isinstance(x, str) else partial(of_component, i, x)
    return scores
