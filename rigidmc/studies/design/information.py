"""The information of a measurement yet to be made, J^T J of the fit to its record; and what it
leaves open of a probability or a mean.

The scene draws its uncertain parameters from normal distributions, theta = m + L z with z normal of
covariance 1. Let z have the covariance V diag(k) V^T after a measurement. Data simulated from a
member z allow, with their probability, the members::

    z' = V [a V^T z + sqrt(1 - a^2) e],   a = 1 - k

with e normal of covariance 1: z itself where the data show all, any member where they show nothing.
For any number y of a member, the variance that is left, on average over the data, is::

    E Var(y | data) = 1/2 E (y' - y)^2

so pairs, which are independent, take the place of weights or a regression. This is exact for
readings that are linear in theta; k follows from the derivatives at each member.
Source: Heath, Manolopoulou & Baio, Med. Decis. Making 37 (2017) 747, review the other ways.
"""

import math
import re
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from rigidmc.errors import OptionError, SceneError
from rigidmc.physics.observables import bare_observables
from rigidmc.physics.observables.protocol import size
from rigidmc.planning.initial import uncertain_numbers
from rigidmc.results.variables import variables_of
from rigidmc.runs.prepare import PreparedRun
from rigidmc.runs.simulate import prepare
from rigidmc.scene.parameters import value_at
from rigidmc.scene.scene import Scene
from rigidmc.statistics import intervals
from rigidmc.statistics.intervals import Interval
from rigidmc.statistics.measures import Measure, measure, save_for_measures
from rigidmc.studies.fit.parameters import MOMENTS, FitParameters, ratios
from rigidmc.studies.fit.problem import FitProblem
from rigidmc.studies.fit.records import Record
from rigidmc.studies.fit.setup import make_problem
from rigidmc.studies.fit.streams import Array
from rigidmc.studies.fit.visible import Seen, seen
from rigidmc.studies.propagate.covariance import factor_of, of_distributions

FINER = 1, 2, 4, 8, 16, 32, 64  # divisors of the step, as in a fit
NORMAL = {"normal", "common", "correlated"}  # distributions
RESOLVED = 0.01  # relative change of a deviation by half the step
_SENSOR = re.compile(r"\s*(\w+)\s*=([^@]+)@\s*((?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*")

Sensors = dict[str, tuple[str, float]]  # {observable: (noise of a reading, readings a second)}


def read_sensors(value: Any, at: str) -> dict[str, Sensors]:
    """Return {text: sensors that measure together} of OBSERVABLE=NOISE@RATE+...; OptionError."""
    made = dict[str, Sensors]()
    for text in (value,) if isinstance(value, str) else map(str, value):
        parts = [_SENSOR.fullmatch(part) for part in re.split(r"\+(?=\s*[A-Za-z_])", text)]
        made[text] = {part[1]: (part[2].strip(), float(part[3])) for part in parts if part}
        if len(made[text]) < len(parts):
            rule = (
                "expected OBSERVABLE=NOISE@RATE, e.g. omega=0.002@100; other observables that are"
                " read at the same time follow after +"
            )
            raise OptionError(rule, at=at, value=text)
    return made


def problem_of(
    scene: Scene, sensors: Sensors, time: float, free: Sequence[str], nuisances: Sequence[str],
    threads: int,
) -> FitProblem:  # fmt: skip
    """Return the fit to a record [s] of sensors with their nuisances; OptionError, SceneError.

    Its readings are 0: the information depends on where they are made alone. Steps are halved until
    no deviation changes; long ones may flag a motion that short ones follow.
    """
    recording = scene.with_run(save=tuple(sensors), members=1).recording
    times, values = dict[str, Array](), dict[str, Array]()
    for name, (_, rate) in sensors.items():
        count = 1 + math.floor(time * rate * (1.0 + 1e-9))  # rounding leaves the last reading
        if count < 2:
            rule = f"a sensor makes no second reading in {time:g} s: measure longer"
            raise OptionError(rule, at="sensor", value=f"{name} @{rate:g}")
        times[name] = np.arange(count) / rate
        values[name] = np.zeros((count, size(recording.observable(name).dims)))
    records, noise = [Record("data", times, values)], {k: x for k, (x, _) in sensors.items()}
    own = [name for name in nuisances if name.rpartition(".")[0] in ("", *sensors)]
    found = np.full(1, np.nan)
    for finer in FINER:
        problem = make_problem(scene, free, (), records, noise, own, threads, finer)
        parameters, x, last = problem.parameters, problem.parameters.coordinates({}), found
        sums = problem.sums(x[None])
        shown = seen(sums.matrix[0], parameters.slopes(x))
        found = deviations(parameters, x, shown, quantities(parameters))
        found = np.where(np.isfinite(sums.cost[0]), found, np.nan)
        if np.allclose(found, last, RESOLVED, 0.0):
            return problem
    if np.isnan(found).any():
        rule = "the motion of these numbers is flagged: it has no information"
        raise SceneError(rule, at="scene", table="")
    return problem


def quantities(parameters: FitParameters, asked: str = "") -> list[str]:
    """Return what a record may show: the parameters of the scene, and ratios of moments; and what
    is asked for, if it is another ratio of two, FIRST/SECOND."""
    names = [parameters.names[i] for i in parameters.index[0, : parameters.moving]]
    ratios = [f"{MOMENTS}.{i}/{MOMENTS}.3" for i in (1, 2)] if parameters.mixed else []
    ratios += [asked] * all(word in names for word in asked.split("/"))
    return list(dict.fromkeys(names + ratios))


def deviations(parameters: FitParameters, x: Array, shown: Seen, names: Sequence[str]) -> Array:
    """Return the standard deviations (n,) of quantities at the coordinates x, inf for those that no
    reading shows."""
    words = [*parameters.names, ""]  # a parameter alone is one over 1
    pairs = [[words.index(word) for word in name.partition("/")[::2]] for name in names]
    slopes = np.pad(parameters.slopes(x), ((0, 1), (0, 0)))
    slopes = ratios(np.append(parameters.values(x), 1.0), slopes, *np.transpose(pairs))[1]
    variance = np.einsum("qi,ij,qj->q", slopes, shown.inverse, slopes)
    return np.where(shown.hides(slopes), math.inf, np.sqrt(np.maximum(variance, 0.0)))


class Pairs(NamedTuple):
    """The first members of all pairs, and the draws of their partners.

    run : prepared with the uncertain parameters `names` as `varied`;  mean, factor : their m and L
    z, e : draws (pairs, parameters)
    """

    measure: Measure
    run: PreparedRun
    names: list[str]
    mean: Array
    factor: Array
    z: Array
    e: Array

    def numbers(self, z: Array, first: int, threads: int) -> Array:
        """Return the numbers (pairs,) of members from index `first` on, nan if flagged: what else
        the scene draws depends on the index."""
        count, theta = len(z), self.mean + z @ self.factor.T
        values = dict(zip(self.names, np.tile(theta, (2, 1)).T, strict=True))
        members = range(first, first + count)
        return self.measure.numbers(self.run.run(values=values, members=members, threads=threads))

    def partners(self, problem: FitProblem) -> Array:
        """Return the draws z' after a measurement; nan for members whose motion is flagged."""
        parameters, theta = problem.parameters, self.mean + self.z @ self.factor.T
        places = np.array([parameters.names.index(name) for name in self.names])
        values = np.tile(parameters.values(parameters.coordinates({})), (len(theta), 1))
        values[:, places] = theta
        x, by_z = parameters.coordinates_of(values), np.eye(parameters.size)
        by_z[places[:, None], places] = self.factor
        turn = np.tile(by_z, (len(x), 1, 1))  # of coordinates by z and all others
        chain = parameters.chain(x).transpose(2, 0, 1)
        turn[:, : parameters.mixed] = np.linalg.inv(chain) @ turn[:, : parameters.mixed]
        sums = problem.sums(x)
        matrix = turn.transpose(0, 2, 1) @ sums.matrix @ turn
        matrix[:, places, places] += 1.0  # known before
        inverse = np.stack([seen(one).inverse for one in matrix])
        k, v = np.linalg.eigh(inverse[:, places[:, None], places])
        a = 1.0 - np.where(np.isfinite(sums.cost)[:, None], np.clip(k, 0.0, 1.0), np.nan)
        z, e = (np.einsum("mji,mj->mi", v, draw) for draw in (self.z, self.e))
        return np.asarray(np.einsum("mij,mj->mi", v, a * z + np.sqrt(1.0 - a * a) * e))

    def mean_of(self, y: Array) -> Interval:
        """Return the mean of numbers, of which a probability has 0 and 1."""
        if self.measure.kind == "p":
            return intervals.probability(np.nansum(y), np.isfinite(y).sum())
        return intervals.mean(y)

    def left(self, y: Array, problem: FitProblem, threads: int) -> Interval:
        """Return the standard deviation that a measurement leaves. y : of the first members"""
        z = self.partners(problem)
        other = self.numbers(np.nan_to_num(z), len(z), threads)
        squares = self.mean_of(np.where(np.isnan(z).any(1), np.nan, (other - y) ** 2))
        return Interval(*(np.sqrt(np.maximum(0.5 * end, 0.0)) for end in squares))


def make_pairs(text: str, drawn: Scene, scene: Scene, count: int) -> Pairs:
    """Return pairs of members; OptionError for a text that is not a mean or probability, SceneError
    for a scene that draws nothing, or not from normal distributions.

    drawn : has the distributions of what a measurement is about;  scene : of the members, has their
        means
    """
    uncertain = uncertain_numbers(drawn.model)[0]
    if not uncertain:
        rule = "draws nothing that the measurement shows: fit it first, or draw a parameter"
        raise SceneError(rule, at="scene", table="")
    for name in uncertain:
        law = value_at(drawn.model, name)
        if not {x.name for x in (law if isinstance(law, tuple) else (law,))} <= NORMAL:
            rule = "a measure needs a normal distribution: give one as wide"
            raise SceneError(rule, at=name, value=law.words())
    names, covariance = of_distributions(drawn.model)
    scene = save_for_measures(scene.with_run(first=0, points="independent"), [text])
    save = tuple(name for name in scene.run.save if name not in bare_observables())
    scene = scene.with_run(save=save, members=2 * count)
    asked = measure(text, variables_of(scene))
    if asked.kind not in ("p", "mean"):
        rule = "is not a mean over members: use mean(NAME) or p(NAME >= NUMBER)"
        raise OptionError(rule, at="of", value=text)
    mean = np.array([float(value_at(scene.model, name)) for name in names])
    random = np.random.default_rng([scene.run.seed, 0x70616972])
    z, e = random.standard_normal((2, count, len(names)))
    return Pairs(asked, prepare(scene, varied=names), names, mean, factor_of(covariance), z, e)
