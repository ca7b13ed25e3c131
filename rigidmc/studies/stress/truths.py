"""Errors of hard cases against a closed form, a published end, an invariant, or another run.

Each function returns a `Comparison`, whose `error` integrates, compares, and returns the error.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import xarray as xr

from rigidmc.errors import RigidmcError
from rigidmc.inputs.arrays import Array
from rigidmc.mechanics.free_top import analyse_free_top
from rigidmc.mechanics.rotation import attitude_error
from rigidmc.physics.integrators import integrators_for
from rigidmc.planning.closed_form import closed_form
from rigidmc.planning.initial import make_sampler
from rigidmc.planning.unit_scale import UnitScale, choose_units, scale_scene
from rigidmc.scene.scene import Scene
from rigidmc.scene.start import Start
from rigidmc.studies.stress.case import Claim, Comparison, makes_steps, reversible
from rigidmc.studies.stress.motions import distance, run, states, tops, worst
from rigidmc.studies.stress.problems import Problem


def closed_states(scene: Scene, ds: xr.Dataset) -> tuple[Array, Array]:
    """Return (attitude, momentum) from the closed form at the times of a Dataset."""
    units = choose_units(scene) or UnitScale(1.0, 1.0)
    inner = scale_scene(scene, units.mass, 1.0, units.time)
    case = closed_form(inner.model, make_sampler(inner.model, inner.run), 0, ds.sizes["member"])
    motion = case.motion(ds.time.values * units.time)
    momentum = np.moveaxis(motion.momentum, -1, 1) * units.factor("kg m2 s-1")
    return np.moveaxis(motion.attitude, -1, 1), momentum


def distance_to_closed_form(
    scene: Scene, t_end: float, saves: int = 8, **options: Any
) -> Comparison:
    """Compare the state with the closed form; compare the closed form with an integrator."""

    def error(integrator: str, share: float) -> float:
        ds, able = run(scene, integrator, t_end, saves, **options), integrators_for(scene.effects)
        if integrator == "closed":
            best = next(name for name in ("exact", "srkn11", "rk8") if name in able)
            true = states(run(scene, best, t_end, saves))
        else:
            true = closed_states(scene, ds)
        return worst(ds, distance(*states(ds), *true)[1:].max(0))

    return Comparison(error, "closed form", scene.effects)


def against_turn(scene: Scene, t_end: float, omega: float) -> Comparison:
    """Compare the state with a rotation at omega [rad/s] about axis 2, from the attitude 1."""

    def error(integrator: str, share: float) -> float:
        ds = run(scene, integrator, t_end)
        half = 0.5 * omega * ds.time.values[:, None] * np.ones(ds.sizes["member"])
        rotation = np.stack([np.cos(half), 0.0 * half, np.sin(half), 0.0 * half], axis=1)
        q, l = states(ds)
        return worst(ds, distance(q, l, rotation, l[:1] + 0.0 * l).max(0))

    return Comparison(error, "a rotation at constant rate", scene.effects)


def flagged_or_close(scene: Scene, t_end: float, **options: Any) -> Comparison:
    """Compare the state with the closed form; the error of a flagged member is 0.

    A flag is a right answer here: nonsense must not look like a result.
    """

    def error(integrator: str, share: float) -> float:
        try:
            ds = run(scene, integrator, t_end, 8, **options)
        except RigidmcError as refusal:  # the equation of midpoint has no solution at this step
            return 0.0 if "can be solved" in str(refusal) else math.inf
        off = distance(*states(ds), *closed_states(scene, ds)).max(0)
        off[ds.status.values != 0] = 0.0
        return float(np.max(np.nan_to_num(off, nan=math.inf, posinf=math.inf)))

    return Comparison(error, "closed form, or a flag", scene.effects)


def against_end(problem: Problem, turn: float | None = None) -> Comparison:
    """Compare with the published end of a problem."""
    weight = tuple(problem.gravity * p for p in problem.static_moment)
    scene = tops(problem.moments, problem.momentum, problem.attitude, weight)

    def error(integrator: str, share: float) -> float:
        ds = run(scene, integrator, problem.time, 1, turn)
        (q, l), end = (x[-1, :, 0] for x in states(ds)), problem.end_momentum
        off = 0.0 if end is None else np.linalg.norm(l - end) / np.linalg.norm(end)
        angle = 0.0 if problem.end_attitude is None else attitude_error(q, problem.end_attitude)
        return worst(ds, np.array([max(float(off), float(angle))]))

    return Comparison(error, problem.source.split(";")[0], scene.effects)


def over_members(scene: Scene, t_end: float) -> Comparison:
    """Find the largest distance of a member from the first."""

    def error(integrator: str, share: float) -> float:
        ds = run(scene, integrator, t_end, 4)
        q, l = states(ds)
        first = (np.repeat(x[..., :1], x.shape[-1], -1) for x in (q, l))
        return worst(ds, distance(q, l, *first).max(0))

    return Comparison(error, "the symmetric body", scene.effects, makes_steps)


def flips(
    moments: tuple[float, float, float], momentum: tuple[float, float, float], count: int
) -> Comparison:
    """Find the largest relative error of the first `count` zeros of L2, at (2 k + 1) K/lambda.

    The motion must start at L3 = 0. Between saves L2 is the cubic through its values and slopes.
    """
    kind = analyse_free_top(moments, momentum)
    interval, rate = float(kind.flip_interval), float(kind.rate)
    assert rate > 0.0
    scene, saves = tops(moments, momentum), math.ceil(count * interval * rate / 0.01)

    def error(integrator: str, share: float) -> float:
        ds = run(scene, integrator, count * interval, saves)
        t, (l1, l2, l3) = ds.time.values, ds.momentum.values[:, :, 0].T
        slope = (1.0 / moments[0] - 1.0 / moments[2]) * l1 * l3  # L2' = L3 omega1 - L1 omega3
        before = np.flatnonzero((l2[:-1] > 0.0) != (l2[1:] > 0.0))
        if len(before) < count or ds.status.values[0]:
            return math.inf
        zeros = [
            _root(t[i], t[i + 1], l2[i], l2[i + 1], slope[i], slope[i + 1]) for i in before[:count]
        ]
        true = interval * (np.arange(count) + 0.5)
        return float(np.max(np.abs(np.array(zeros) - true) / true))

    return Comparison(error, f"{'(2 k + 1) ' * (count > 1)}K(m)/lambda, Jacobi")


def _root(a: float, b: float, f: float, g: float, df: float, dg: float) -> float:
    """Return the zero between a and b of the cubic with values f, g and slopes df, dg there."""
    h = b - a
    cubic = np.polynomial.Polynomial(
        [f, h * df, 3 * (g - f) - h * (2 * df + dg), 2 * (f - g) + h * (df + dg)]
    )
    x = f / (f - g)
    for _ in range(6):
        x -= cubic(x) / cubic.deriv()(x)
    return a + h * x


def there_and_back(scene: Scene, t_end: float, **options: Any) -> Comparison:
    """Run to t_end, reverse the momentum, and run back; the error is the distance from the
    start."""

    def error(integrator: str, share: float) -> float:
        ds = run(scene, integrator, t_end, 1, **options)
        q, l = states(ds)
        start = Start(momentum=tuple(-l[-1]), attitude=tuple(q[-1]))
        back = run(Scene(scene.body, scene.effects, start), integrator, t_end, 1, **options)
        end_q, end_l = states(back)
        off = distance(end_q[-1:], -end_l[-1:], q[:1], l[:1])[0]
        return max(worst(ds, 0.0), worst(back, off))

    return Comparison(error, "its own start", scene.effects, reversible)


def same_bits(scene: Scene, t_end: float, **options: Any) -> Comparison:
    """Count the numbers that differ between runs with blocks of different sizes."""
    names = ("momentum", "attitude", "energy_drift_max", "status")

    def error(integrator: str, share: float) -> float:
        ds = run(scene, integrator, t_end, 4, **options)
        others = [run(scene, integrator, t_end, 4, block=block, **options) for block in (32, 96)]
        count = sum(
            int(np.count_nonzero(ds[name].values != other[name].values))
            for other in others
            for name in names
        )
        return float(count) if not ds.status.values.any() else math.inf

    return Comparison(error, "the same run in other blocks", scene.effects, makes_steps)


def distance_in_units(
    scene: Scene,
    other: Scene,
    t_end: float,
    time: float,
    mass_length: float,
    power_of_two: bool,
    **options: Any,
) -> Comparison:
    """Find the distance of two scenes that differ only in units.

    time, mass_length : factors of times and of momenta;  power_of_two : then bits must be equal
    """

    def error(integrator: str, share: float) -> float:
        ds = run(scene, integrator, t_end, 4, **options)
        scaled = run(other, integrator, t_end * time, 4, **options)
        (true_q, true_l), (q, l) = states(ds), states(scaled)
        l = l / mass_length
        if power_of_two:
            same = np.array_equal(q, true_q) and np.array_equal(l, true_l)
            return 0.0 if same and worst(scaled, 0.0) == 0.0 else 1.0
        return max(worst(ds, 0.0), worst(scaled, distance(q, l, true_q, true_l).max(0)))

    return Comparison(error, "the same scene in the original units", scene.effects, makes_steps)


def is_refused(call: Callable[[str], object], rule: str, claims: Claim) -> Comparison:
    """Return the error 0 if a call raises a RigidmcError whose text contains `rule`, else 1."""

    def error(integrator: str, share: float) -> float:
        try:
            call(integrator)
        except RigidmcError as refusal:
            return 0.0 if rule in str(refusal) else 1.0
        return 1.0

    return Comparison(error, "an error with the reason", claims=claims)
