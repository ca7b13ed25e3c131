"""Bounds that flag a member: on its drifts and on its turn per step. The defaults follow from the
integrator, the step and the number of steps."""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from rigidmc.physics.integrators import StepScheme
from rigidmc.physics.integrators.protocol import Integrator
from rigidmc.physics.integrators.splitting import PANEL_TURN, Exact, Split
from rigidmc.scene.settings import Run

COARSE = 0.05  # never trust a result with a larger drift of energy or momentum, whatever the step
# [rad] per step of free motion that is split into turns: ten such steps are off by 0.011 rad
# (median of 60 bodies; 0.8 at worst)
SPLIT = 2.0
# A member may spin faster by this factor than the drift or the iteration was prepared for. A drift
# is then off by 5e-12 (60 bodies each for five turns; at a factor of 3: 5e-10), and the stage of
# midpoint by 3e-15 (at a factor of 3: 7e-8).
PLANNED = 2.0
SPUN_UP = 2.0  # a member with its own steps may turn by this many times `turn` per step


class Limits(NamedTuple):
    """Bounds of a run, as `rigidmc.engine.program.Program` uses them; inf where there is no bound.

    energy : |E - E(0)|, relative to the energies in play
    l2 : change of |L|^2, relative to its size
    lz : change of L_z, relative to the largest |L| that the energies allow
    turn : |omega| h [rad];  norm : ||q|^2 - 1|
    """

    energy: float
    l2: float
    lz: float
    turn: float
    norm: float


def make_limits(
    run: Run,
    kind: Integrator,
    conserved: Mapping[str, str],
    has_attitude: bool,
    theta: float,
    steps: float,
    form: StepScheme | None = None,
    spin: float = 0.0,
) -> Limits | tuple[()]:
    """Compute the Limits of a run, or () if only non-finite members are flagged (checks = false).

    kind : the integrator;  conserved : see `rigidmc.scene.recording.conservation`
    has_attitude : whether the attitude is followed; without it L_z is not monitored
    theta : largest motion of the pilot's members in a step [rad];  steps : number to the end
    form, spin : the StepScheme of the integrator, and the turn per step [rad] it was prepared for

    A drift that the scene does not bound (energy_limit, momentum_limit) may reach

        steps theta^(order + 1),  at least (5e6 + 50 steps) roundings,  at most 0.05

    Where the first term is below 0.05, it is at least 12 times the drift of the shipped
    integrators, free and heavy; strang comes nearest (tests/planning/test_limits.py).

    A step may turn a member by the integrator's `max_turn` (turn_limit), or by pi if it has none.
    A member that turns by more is aliased or divergent. A member with its own steps may turn by
    twice `turn`. A potential never brings it there, because the rate that sets its steps bounds
    |omega|; a torque that spins it up may. The exact free motion and midpoint are prepared for
    the spins of the pilot, and allow twice those spins.
    """
    if not run.checks:
        return ()
    drift = _largest_drift(run.dtype, kind.order, theta, steps)
    # driving effects may make a body much faster than the pilot is at the start
    energy = COARSE if "work" in run.save else drift
    bounds = {
        "energy": energy if run.energy_limit is None else run.energy_limit,
        "l2": drift if run.momentum_limit is None else run.momentum_limit,
    }
    bounds["lz"] = bounds["l2"]
    for name in bounds:
        unseen = name == "lz" and not has_attitude
        if unseen or conserved[{"energy": "energy_drift"}.get(name, name)] != "yes":
            bounds[name] = math.inf
    turn = _largest_turn(kind, run.turn, form, spin) if run.turn_limit is None else run.turn_limit
    norm = 1e-9 if run.dtype == "float64" else 1e-3
    return Limits(**bounds, turn=turn, norm=norm)


def _largest_drift(dtype: str, order: float, theta: float, steps: float) -> float:
    """Return the largest drift that integration itself may cause."""
    if theta >= 1.0 and order < math.inf:
        return COARSE
    rounding = float(np.finfo(dtype).eps) * (5e6 + 50.0 * steps)
    with np.errstate(over="ignore"):
        error = 0.0 if order == math.inf or not theta < 1.0 else steps * theta ** (order + 1)
    return min(COARSE, max(error, rounding))


def _largest_turn(
    kind: Integrator, turn: float | None, form: StepScheme | None, spin: float
) -> float:
    """Return the largest turn of a step [rad] that an integrator tolerates."""
    drift = getattr(form.integrator, "drift", None) if form else None
    largest = math.pi if drift is None else SPLIT if isinstance(drift, Split) else math.inf
    largest = kind.max_turn or largest
    if isinstance(drift, Exact):
        largest = PLANNED * max(spin, PANEL_TURN)
    if kind.min_spin:
        largest = PLANNED * max(spin, kind.min_spin)
    return largest if turn is None else min(largest, SPUN_UP * turn)
