"""The motions of hard cases: tops from plain numbers, their integration, and errors without a
truth.

The error of a case without a truth is the drift of its constants of motion. For cases with a truth,
`distance` is the error between two states.
"""

import math
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from rigidmc.engine.formulas import energies
from rigidmc.errors import SceneWarning
from rigidmc.inputs.arrays import Array
from rigidmc.mechanics.rotation import attitude_error
from rigidmc.physics.dynamics.euler import kinetic_energy
from rigidmc.physics.dynamics.so3 import dot, vertical
from rigidmc.physics.effects.damping import ViscousDamping
from rigidmc.physics.effects.gravity import Gravity
from rigidmc.physics.effects.sums import total_energy_scale
from rigidmc.physics.integrators import INTEGRATORS
from rigidmc.planning.initial import members_at_start
from rigidmc.planning.steps import physics, rate_bounds
from rigidmc.planning.tolerance.deviation import relative
from rigidmc.planning.unit_scale import choose_units, scale_scene
from rigidmc.runs.simulate import simulate
from rigidmc.scene.body import Body
from rigidmc.scene.quantities import count_rows, is_shared
from rigidmc.scene.scene import Scene
from rigidmc.scene.start import Start
from rigidmc.studies.stress.case import Comparison, makes_steps

# rotation of the fastest member per step [rad], by the order of the integrator; an order that is
# not here has the value of the next lower one
TURNS = {2: 0.01, 4: 0.05, 6: 0.12, 8: 0.25, math.inf: 0.12}


def run(
    scene: Scene,
    integrator: str,
    t_end: float,
    saves: int = 8,
    turn: float | None = None,
    steps: int | None = None,
    **settings: Any,
) -> xr.Dataset:
    """Integrate a scene to t_end [s] and save momentum and attitude at `saves` evenly spaced times.

    steps : their number; by default a step rotates the fastest member by `turn` [rad], or by TURNS
    """
    alike = is_shared(*scene.model.quantities())
    if turn is None:
        lower = (order for order in TURNS if order <= INTEGRATORS[integrator].order)
        turn = TURNS[max(lower, default=min(TURNS))]
    rate = fastest_rate(scene)
    dt = t_end / steps if steps else turn / rate if rate > 0.0 else t_end / 100.0
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SceneWarning)
        result: xr.Dataset = simulate(
            scene,
            integrator=integrator,
            dt=min(dt, t_end / saves),
            t_end=t_end,
            every=t_end / saves,
            members=1 if alike else None,
            save=("momentum", "attitude"),
            threads=1,
            **settings,
        )
    return result


def fastest_rate(scene: Scene) -> float:
    """Return the rate of the fastest member at its start [rad/s], from units that do not
    overflow."""
    members = count_rows(*scene.model.quantities()) or 1
    units = choose_units(scene)
    inner = scene if units is None else scale_scene(scene, units.mass, 1.0, units.time)
    per_second = 1.0 if units is None else units.time
    return per_second * float(
        np.max(rate_bounds(inner.effects, members_at_start(inner.model, inner.run, 0, members)[0]))
    )


def staged_physics(scene: Scene, members: int) -> tuple[Any, Any]:
    """Return (body, effects) of the first members, in the form the physics functions use."""
    body, effects = physics(scene.effects, members_at_start(scene.model, scene.run, 0, members)[0])
    return body, effects


def states(ds: xr.Dataset) -> tuple[Array, Array]:
    """Return (attitude (times, 4, members), momentum (times, 3, members)) of a result."""
    return ds.attitude.values, ds.momentum.values


def worst(ds: xr.Dataset, values: ArrayLike) -> float:
    """Return the largest of one value per member; inf if a member is flagged or a value is nan."""
    finite = np.nan_to_num(values, nan=math.inf, posinf=math.inf)
    return float(np.max(np.where(ds.status.values == 0, finite, math.inf)))


def distance(q: Array, l: Array, true_q: Array, true_l: Array) -> Array:
    """Return the larger error of momentum [relative] and attitude [rad], (times, members), of
    `states`."""
    unit = np.max(np.abs(true_l)) or 1.0  # keeps squares from overflow and underflow
    size = np.linalg.norm(true_l / unit, axis=1)
    # where L is 0, the error is relative to the largest |L|
    off = np.linalg.norm((l - true_l) / unit, axis=1) / np.where(size > 0.0, size, 1.0)
    angle = attitude_error(np.moveaxis(q, 1, -1), np.moveaxis(true_q, 1, -1))
    apart: Array = np.maximum(off, angle)
    return apart


# quantities(body, effects, q, l) -> [(values (..., times, members), scale (members))]
Quantities = Callable[[Any, Any, Array, Array], list[tuple[Array, Array]]]


def largest_change(
    scene: Scene,
    t_end: float,
    quantities: Quantities,
    saves: int = 8,
    steps: int | None = None,
    **options: Any,
) -> Comparison:
    """Return the largest change of some quantities, each relative to its scale; inf if only the
    scale is 0."""

    def error(integrator: str, share: float) -> float:
        n = max(saves, round(steps * share / saves) * saves) if steps else None
        end = t_end * (n / steps if n and steps else 1.0)
        ds = run(scene, integrator, end, saves, steps=n, **options)
        body, effects = staged_physics(scene, ds.sizes["member"])
        q, l = np.moveaxis(ds.attitude.values, 1, 0), np.moveaxis(ds.momentum.values, 1, 0)
        largest = np.zeros(ds.sizes["member"])
        for values, scale in quantities(body, effects, q, l):
            values = np.reshape(values, (-1, *np.shape(values)[-2:]))
            change = np.abs(values - values[:, :1]).max((0, 1))
            off = np.nan_to_num(relative(change, scale), nan=math.inf, posinf=math.inf)
            largest = np.maximum(largest, off)
        return worst(ds, largest)

    return Comparison(error, "invariants", scene.effects, makes_steps)


def invariants(body: Any, effects: Any, q: Array, l: Array) -> list[tuple[Array, Array]]:
    """Return energy and |L|^2 of a free body; energy and L_z under gravity."""
    play = kinetic_energy(body, l[:, 0]) + total_energy_scale(effects, body)
    energy = kinetic_energy(body, l) + energies(effects, body, q)
    if not effects:
        return [(energy, play), (dot(l, l), dot(l[:, 0], l[:, 0]))]
    largest = np.sqrt(2.0 * play / np.min([body.i1, body.i2, body.i3], axis=0))
    return [(energy, play), (dot(l, vertical(q)), largest)]


def direction(body: Any, effects: Any, q: Array, l: Array) -> list[tuple[Array, Array]]:
    """Return L in body axes, and under gravity the vertical: constant in a permanent rotation."""
    momentum = np.array(l), np.sqrt(dot(l[:, 0], l[:, 0]))
    return [momentum, (np.array(vertical(q)), np.ones(l.shape[-1]))] if effects else [momentum]


def walk(scene: Scene, turn: float, steps: int) -> Comparison:
    """Return how much faster than sqrt(n) the drift of energy and |L|^2 grows with the steps n.

    This is the largest of rms(n)/rms(n0) / sqrt(n/n0) over n = 2^k n0.

    turn : rotation per step [rad]
    """

    def error(integrator: str, share: float) -> float:
        saves = 64
        n = saves * round(steps * share / saves)
        ds = run(scene, integrator, n * turn / fastest_rate(scene), saves, steps=n)
        body, effects = staged_physics(scene, ds.sizes["member"])
        q, l = np.moveaxis(ds.attitude.values, 1, 0), np.moveaxis(ds.momentum.values, 1, 0)
        ratios = []
        for values, scale in invariants(body, effects, q, l):
            rms = np.sqrt((((values - values[:1]) / scale) ** 2).mean(1))[[1, 4, 16, 64]]
            rms = np.maximum(rms, 1.1e-16)
            ratios.append(np.max(rms[1:] / rms[0] / np.sqrt([4, 16, 64])))
        return max(worst(ds, 0.0), float(np.max(ratios)))

    return Comparison(error, "random walk", scene.effects)


UPRIGHT, HANGING = (1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0)


def tops(
    moments: ArrayLike,
    momentum: ArrayLike,
    attitude: ArrayLike = (1.0, 0.0, 0.0, 0.0),
    weight: ArrayLike = (0.0, 0.0, 0.0),
    damping: float = 0.0,
    g: float = 1.0,
) -> Scene:
    """Return a Scene of tops: each argument is a tuple of numbers, or an array with one row per
    member.

    weight : m g r [N m];  damping : rate of viscous damping [1/s]
    """
    columns = [np.asarray(x, dtype=float) for x in (moments, momentum, attitude, weight)]
    members = max(len(c) if c.ndim == 2 else 0 for c in columns)
    if members:
        columns = [np.array(np.broadcast_to(c, (members, c.shape[-1]))) for c in columns]
    # components: three or four rows would read two ways
    vectors: list[Any] = [tuple(c.T) if members else tuple(c.tolist()) for c in columns]
    effects: tuple[Any, ...] = (Gravity(g),) if np.any(columns[3]) else ()
    effects += (ViscousDamping(damping),) if damping else ()
    body = Body.from_moments(vectors[0], mass=1.0, centre=vectors[3])
    return Scene(body, effects, Start(momentum=vectors[1], attitude=vectors[2]))


def lean_by(theta: float) -> tuple[float, float, float, float]:
    """Return the attitude whose third axis leans by theta [rad] from the vertical."""
    return math.cos(0.5 * theta), math.sin(0.5 * theta), 0.0, 0.0


def rotation_about(axis: Array, angle: float) -> Array:
    """Return the quaternion of a rotation by an angle [rad] about an axis of any length."""
    vector = math.sin(0.5 * angle) * axis / np.linalg.norm(axis)
    return np.array([math.cos(0.5 * angle), *vector])


def random_tops(count: int = 32, seed: int = 1) -> tuple[Array, Array]:
    """Return (moments, momenta) of random bodies of unit size and spin, one row each."""
    random = np.random.default_rng(seed)
    second = random.uniform(0.1, 1.0, (count, 3))
    moments = (second.sum(1, keepdims=True) - second) / second.sum(1, keepdims=True)
    momentum = random.normal(size=(count, 3))
    return moments, momentum / np.linalg.norm(momentum, axis=1, keepdims=True) * 0.5
