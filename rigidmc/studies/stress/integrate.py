"""One integration of a hard case, and the distance between two states."""

import math
import warnings
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from rigidmc.errors import SceneWarning
from rigidmc.integrators import INTEGRATORS
from rigidmc.mechanics.rotation import attitude_error
from rigidmc.planning.rates import physics, rates
from rigidmc.planning.stage import stage
from rigidmc.planning.units import internal, scaled
from rigidmc.runs.simulate import simulate
from rigidmc.scene.quantities import is_shared, rows
from rigidmc.scene.scene import Scene

# rotation of the fastest member in a step [rad], by the order of the integrator
TURNS = {2: 0.01, 4: 0.05, 6: 0.12, 8: 0.25, math.inf: 0.12}


def turn_of(order: float) -> float:
    """Rotation of the fastest member in a step [rad], for an integrator of some order.

    An order that TURNS does not list takes the value of the next lower one.
    """
    return TURNS[max((known for known in TURNS if known <= order), default=min(TURNS))]


def run(
    scene: Scene,
    integrator: str,
    t_end: float,
    saves: int = 8,
    turn: float | None = None,
    steps: int | None = None,
    **settings: Any,
) -> xr.Dataset:
    """Integrate a scene to t_end [s] and save momentum and attitude at `saves` equal times.

    steps : how many; by default the step rotates the fastest member by `turn` [rad], or by TURNS
    """
    alike = is_shared(*scene.quantities())
    turn = turn_of(INTEGRATORS[integrator].order) if turn is None else turn
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
    """The rate of the fastest member at its start [rad/s], in units that do not overflow."""
    members = rows(*scene.quantities()) or 1
    units = internal(scene)
    inner = scene if units is None else scaled(scene, units.mass, 1.0, units.time)
    per_second = 1.0 if units is None else units.time
    return per_second * float(np.max(rates(inner.effects, stage(inner, 0, members, True)[0])))


def staged_physics(scene: Scene, members: int) -> tuple[Any, Any]:
    """(body, effects) of the first members, as the physics functions take them."""
    body, effects = physics(scene.effects, stage(scene, 0, members, True)[0])
    return body, effects


def worst(ds: xr.Dataset, values: ArrayLike) -> float:
    """The largest of one value per member; inf if a member is flagged or its value is nan."""
    finite = np.nan_to_num(values, nan=math.inf, posinf=math.inf)
    return float(np.max(np.where(ds.status.values == 0, finite, math.inf)))


def distance(
    q: NDArray[np.float64],
    l: NDArray[np.float64],
    true_q: NDArray[np.float64],
    true_l: NDArray[np.float64],
) -> NDArray[np.float64]:
    """The larger error of momentum [of its size] and attitude [rad], (times, members).

    q, true_q : (times, 4, members);  l, true_l : (times, 3, members)
    """
    unit = np.max(np.abs(true_l)) or 1.0  # so that squares neither overflow nor vanish
    size = np.linalg.norm(true_l / unit, axis=1)
    # where L is 0 the error is that in units of the largest |L|
    off = np.linalg.norm((l - true_l) / unit, axis=1) / np.where(size > 0.0, size, 1.0)
    angle = attitude_error(np.moveaxis(q, 1, -1), np.moveaxis(true_q, 1, -1))
    apart: NDArray[np.float64] = np.maximum(off, angle)
    return apart
