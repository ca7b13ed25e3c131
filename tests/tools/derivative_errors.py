"""Derivatives of runs by parameters against central differences of order 8 of the same runs.

The example of every effect with every integrator that takes it, and hard bodies and starts, where
formulas switch. Derivatives by components of the start, moments, every number of the effect, and
means and widths of distributions. The errors of each pair, and the largest (half an hour)::

    python -m tests.tools.derivative_errors [INTEGRATOR ...]

A difference of steps of 1 % of a parameter leaves 1e-13 of the values by rounding. Where a step has
a kink the differences are of one side: the derivative is that of the side on which the value is.
"""

import math
import sys
import warnings
from collections.abc import Iterable, Iterator
from itertools import product
from typing import Any, NamedTuple
from unittest import mock

import numpy as np

import rigidmc as rm
from rigidmc.engine.kernel.arguments import SaveTarget, StepRange
from rigidmc.physics.dynamics.so3 import conjugate, multiply
from rigidmc.physics.effects import EFFECTS
from rigidmc.physics.effects.protocol import from_numbers, numbers, user_parameters
from rigidmc.physics.integrators import INTEGRATORS, integrators_for
from rigidmc.planning import plan as plans
from rigidmc.planning.initial import initial_block, noise_keys

MEMBERS, STEPS = 4, (0.05, 0.01)
AHEAD = {1: 4 / 5, 2: -1 / 5, 3: 4 / 105, 4: -1 / 280}
# Differences of order 8, central and of one side
CENTRAL = {**AHEAD, **{-k: -weight for k, weight in AHEAD.items()}}
FORWARD = {
    0: -761 / 280, 1: 8.0, 2: -14.0, 3: 56 / 3, 4: -35 / 2, 5: 56 / 5, 6: -14 / 3, 7: 8 / 7,
    8: -1 / 8,
}  # fmt: skip
ONE_SIDED = FORWARD, {-k: -weight for k, weight in FORWARD.items()}
SAVED = ("omega", "attitude", "energy")
RUN = {"dt": 0.02, "t_end": 0.5, "every": 0.25, "members": MEMBERS, "save": SAVED, "checks": False}
NAMES = tuple(name for name in INTEGRATORS if name != "closed")


class Case(NamedTuple):
    """A scene as a function of its numbers {name of a parameter: number}, and these numbers.

    varied : of the run for differences, which must not rely on equal moments
    """

    make: Any
    given: dict[str, float]
    varied: tuple[str, ...] = ()

    def scene(self, **changed: float) -> rm.Scene:
        """The scene, with some numbers changed."""
        return self.make(self.given | changed)


def effect_case(name: str) -> Case:
    """The example of an effect on a body with random spin, attitude and moments.

    The first number of the effect has a distribution.
    """
    kind = EFFECTS[name]
    example = kind(*kind.example)
    own = {}
    for field, i, value in numbers(example):
        if field in user_parameters(kind):
            key = f"effects.{name}.{field}" + ("" if i is None else f".{i + 1}")
            if own:
                own[key] = value
            else:
                first, own = key, {f"{key}.mean": value, f"{key}.standard_deviation": 0.05 * value}
    given = {
        "start.omega.1.mean": 0.7, "start.omega.1.standard_deviation": 0.3, "start.omega.2": -1.1,
        "start.attitude.theta.low": 0.4, "start.attitude.theta.high": 1.2,
        "start.attitude.psi": -0.8, "body.moments.1": 1.0, "body.moments.2.mean": 1.4,
        "body.moments.2.standard_deviation": 0.05, "body.moments.3": 2.0, **own,
    }  # fmt: skip
    if name != "gravity_gradient":  # on an orbit a body turns about its centre of mass
        given |= {"body.mass": 1.3, "body.centre.3": 0.3}

    def make(v: dict[str, float]) -> rm.Scene:
        drawn = rm.normal(v[f"{first}.mean"], v[f"{first}.standard_deviation"])
        known = {first: drawn, **v}
        values = [
            known.get(f"effects.{name}.{field}" + ("" if i is None else f".{i + 1}"), value)
            for field, i, value in numbers(example)
        ]
        moments = (
            v["body.moments.1"],
            rm.normal(v["body.moments.2.mean"], v["body.moments.2.standard_deviation"]),
            v["body.moments.3"],
        )
        arm = v.get("body.centre.3")
        centre = (0.0, 0.0, 0.0) if arm is None else (0.1, -0.2, arm)
        body = rm.Body.from_moments(moments, v.get("body.mass", 1.0), centre)
        spin = rm.normal(v["start.omega.1.mean"], v["start.omega.1.standard_deviation"])
        theta = rm.uniform(v["start.attitude.theta.low"], v["start.attitude.theta.high"])
        start = rm.Start(
            omega=(spin, v["start.omega.2"], 0.9), attitude=(0.3, theta, v["start.attitude.psi"])
        )
        return rm.Scene(body, from_numbers(kind, values), start)

    return Case(make, given)


class Hard(NamedTuple):
    """A body and a start where formulas switch: moments, omega, (phi, theta, psi).

    A body with two moments is a plate of 12 kg with these sides: a change of one of the moments of
    a planar body may make a body that cannot exist.
    """

    moments: tuple[float, ...]
    omega: tuple[float, float, float] = (0.7, -1.1, 0.9)
    angles: tuple[float, float, float] = (0.3, 0.8, -0.8)


# 2 omega_1^2 = 4 omega_3^2: L^2 = 2 T I_2
_SEPARATRIX = (1.1 * math.sqrt(2.0), -0.7, 1.1)
HARD = {
    "sphere": Hard((1.5, 1.5, 1.5)),
    "symmetric about axis 1": Hard((1.0, 1.5, 1.5)),
    "symmetric about axis 2": Hard((1.5, 1.0, 1.5)),
    "symmetric about axis 3": Hard((1.5, 1.5, 1.0)),
    "planar body": Hard((1.0, 1.3)),
    "at rest": Hard((1.0, 1.4, 2.0), (0.0, 0.0, 0.0)),
    "spin about axis 1": Hard((1.0, 1.4, 2.0), (1.3, 0.0, 0.0)),
    "spin about axis 2": Hard((1.0, 1.4, 2.0), (0.0, -1.3, 0.0)),
    "spin about axis 3": Hard((1.0, 1.4, 2.0), (0.0, 0.0, 1.3)),
    "separatrix": Hard((2.0, 3.0, 4.0), _SEPARATRIX),
    "upright top": Hard((1.5, 1.5, 1.0), (0.0, 0.0, 3.0), (0.0, 0.0, 0.0)),
    "hanging top": Hard((1.5, 1.5, 1.0), (0.0, 0.0, 3.0), (0.0, math.pi, 0.0)),
    "gimbal angle 0": Hard((1.0, 1.4, 2.0), angles=(0.3, 0.0, -0.8)),
    "gimbal angle pi": Hard((1.0, 1.4, 2.0), angles=(0.3, math.pi, -0.8)),
}


def hard_case(name: str, is_heavy: bool) -> Case:
    """A body of HARD, with gravity or free, whose centre is on axis 3 if it stands or hangs."""
    one = HARD[name]
    given = {f"start.omega.{i + 1}": x for i, x in enumerate(one.omega)}
    angles = zip(("phi", "theta", "psi"), one.angles, strict=True)
    given |= {f"start.attitude.{word}": x for word, x in angles}
    is_plate = len(one.moments) == 2
    vector = "body.plate.size" if is_plate else "body.moments"
    given |= {f"{vector}.{i + 1}": x for i, x in enumerate(one.moments)}
    if is_heavy and not is_plate:
        given |= {"body.mass": 1.3, "body.centre.1": 0.0, "body.centre.3": 0.3}
    given |= {"body.plate.mass": 12.0} if is_plate else {}
    given |= {"effects.gravity.g": 9.8} if is_heavy else {}

    def make(v: dict[str, float]) -> rm.Scene:
        size, omega, angles = (
            tuple(x for key, x in v.items() if key.startswith(f"{word}."))
            for word in (vector, "start.omega", "start.attitude")
        )
        if is_plate:
            body = rm.Body.solid("plate", mass=v["body.plate.mass"], size=size)
            body = body.with_pivot((0.1, 0.0, 0.0)) if is_heavy else body
        else:
            centre = (v.get("body.centre.1", 0.0), 0.0, v.get("body.centre.3", 0.0))
            body = rm.Body.from_moments(size, v.get("body.mass", 1.0), centre)
        effects = (rm.Gravity(v["effects.gravity.g"]),) if is_heavy else ()
        return rm.Scene(body, effects, rm.Start(omega=omega, attitude=angles))

    return Case(make, given, () if is_plate else ("body.moments",))


def has_kink(integrator: str, name: str) -> bool:
    """Whether a pair has a step with a kink: `rotations` turn a body about the axes of its smallest
    and largest moment, which are others on either side of two equal moments."""
    return integrator == "rotations" and name.startswith("symmetric")


def errors(
    case: Case, integrator: str, is_one_sided: bool = False, **settings: Any
) -> dict[str, float]:
    """{parameter: largest error of the derivatives}; of the largest derivative of an observable, or
    of 1 % of the observable over the parameter, where rounding alone is left.

    Of differences with a long and with a short step, the nearer: the error of one is that of the
    series, of the other rounding. Of those of one side, the nearer side.
    """
    # one derivative in a pass: half as long to compile, with the same bits (test_derivatives.py)
    with warnings.catch_warnings(), mock.patch.object(plans, "AT_ONCE", 1):
        warnings.simplefilter("ignore", rm.SceneWarning)
        known = {"wrt": tuple(case.given), **RUN, **settings}
        run = rm.prepare(case.scene(), integrator, **known)
        found = run.run(threads=1)
        run = rm.prepare(case.scene(), integrator, varied=case.varied, **known)
    assert run.units is None and not found.status.values.any()
    ways = product(ONE_SIDED if is_one_sided else (CENTRAL,), STEPS)
    each = [of_differences(case, run, found, *way) for way in ways]
    return {name: min(one[name] for one in each) for name in case.given}


def of_differences(
    case: Case, run: rm.PreparedRun, found: Any, weights: dict[int, float], step: float
) -> dict[str, float]:
    """The `errors` of a result, by differences of steps of a fraction of each parameter."""
    worst = dict.fromkeys(case.given, 0.0)
    true = differences(case, run, weights, step)
    for j, (name, value) in enumerate(case.given.items()):
        true[name]["attitude"] = turn(found.attitude.values, true[name]["attitude"])
        for saved, rates in true[name].items():
            # all observables are about 1, except those at rest
            least = 0.01 * max(np.abs(found[saved].values).max(), 0.1) / (abs(value) or 1.0)
            given = found[f"d_{saved}"].values[j].reshape(rates.shape)
            error = float(np.abs(given - rates).max() / max(np.abs(rates).max(), least))
            worst[name] = max(worst[name], math.inf if math.isnan(error) else error)
    return worst


def turn(q: Any, change: Any) -> Any:
    """The rotation vector 2 vec(q* dq) of a change of attitudes (time, quat, member)."""
    turned = multiply(conjugate(np.moveaxis(q, 1, 0)), np.moveaxis(change, 1, 0))
    return 2.0 * np.stack(turned[1:], axis=1)


def differences(
    case: Case, run: rm.PreparedRun, weights: dict[int, float], step: float
) -> dict[str, dict[str, Any]]:
    """{parameter: {observable: its derivative}}, by the same program for all changed scenes."""
    steps = {name: step * (abs(value) or 1.0) for name, value in case.given.items()}
    scenes = [
        case.scene(**{name: case.given[name] + k * h}) for name, h in steps.items() for k in weights
    ]
    saves = values_at_saves(run, scenes)
    saves = saves.reshape(*saves.shape[:2], len(steps), len(weights), MEMBERS)
    rates = np.einsum("tvpkm,k->ptvm", saves, list(weights.values()))
    return {
        name: {saved: each[:, rows] / h for saved, rows in run.layout.saved.items()}
        for (name, h), each in zip(steps.items(), rates, strict=True)
    }


def values_at_saves(run: rm.PreparedRun, scenes: list[rm.Scene]) -> Any:
    """(saves, values, scenes * members) of members of other scenes, by the plan of a run.

    Each member has the same noise in all of them.
    """
    plan, program, grid = run.plan, run.program(), run.plan.grid
    known = run.sampler, 0, MEMBERS, True, plan.places.end
    block = np.concatenate([initial_block(s.model, *known)[0] for s in scenes], axis=1)
    rows, count = block.shape
    whole = np.zeros((rows * program.copies, count))
    whole[:rows] = block
    out = np.empty((plan.grid.saves, run.layout.values, program.copies, count))
    noise = noise_keys(plan.model.effects, plan.run.seed, np.tile(np.arange(MEMBERS), len(scenes)))
    steps = StepRange(
        grid.dt, 1, grid.stride, grid.steps, 0, 0, grid.steps, grid.head, grid.last_dt
    )
    program.advance(whole, steps, noise, SaveTarget(out, count, 0, np.arange(count)))
    return out[:, :, 0]


def pairs(integrator: str) -> Iterator[tuple[str, Case]]:
    """(name, Case) of the effects and of the hard bodies that an integrator takes."""
    for name, kind in EFFECTS.items():
        if integrator in integrators_for((kind(*kind.example),)):
            yield name, effect_case(name)
    for name in HARD:
        yield f"{name}, free", hard_case(name, False)
        if integrator in integrators_for((rm.Gravity(9.81),)):
            yield f"{name}, heavy", hard_case(name, True)


def main(integrators: Iterable[str]) -> None:
    """Print a row for each pair as it is found, then the largest errors of each integrator."""
    largest: dict[str, list[float]] = {}
    for integrator in integrators:
        of_effects, of_bodies = largest.setdefault(integrator, [0.0, 0.0])
        for name, case in pairs(integrator):
            found = errors(case, integrator, has_kink(integrator, name))
            worst = max(found, key=lambda key: found[key])
            print(f"| {integrator} | {name} | {found[worst]:.1e} | {worst} |", flush=True)
            if name in EFFECTS:
                of_effects = max(of_effects, found[worst])
            else:
                of_bodies = max(of_bodies, found[worst])
        largest[integrator] = [of_effects, of_bodies]
    print("| integrator | effects | bodies and starts |\n| --- | ---: | ---: |")
    for integrator, (of_effects, of_bodies) in largest.items():
        effects = f"{of_effects:.0e}" if of_effects else "none"  # `exact` takes no effect
        print(f"| {integrator} | {effects} | {of_bodies:.0e} |")


if __name__ == "__main__":
    main(sys.argv[1:] or NAMES)
