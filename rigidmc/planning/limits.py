"""What flags a member: bounds on its drifts and on how far a step may turn it, by default from integrator, step and number of steps."""

import math
from typing import NamedTuple

import numpy as np

from rigidmc.integrators import INTEGRATORS
from rigidmc.integrators.drifts import PANEL_TURN, Exact, Split
from rigidmc.scene.conservation import conservation

COARSE = 0.05  # drift of energy or momentum that is never taken for a result, whatever the step
SPLIT = 2.0  # [rad] in a step of free motion that is split into turns: ten of them are off by 0.011 rad (median of 60 bodies; 0.8 at worst)
# A member may spin so many times faster than what drift or iteration were prepared for: a drift of it is off by 5e-12 (60 bodies each for five
# turns; 3 times: 5e-10), the stage of midpoint by 3e-15 (3 times: 7e-8).
PLANNED = 2.0
SPUN_UP = 2.0  # a member with steps of its own may turn by this many times `turn` in a step


class Limits(NamedTuple):
    """Bounds of a run, as `rigidmc.engine.program.Program` takes them; inf where there is none.

    energy : |E - E(0)| of the energies in play;  l2 : of |L|^2, of its size;  lz : of L_z, of the largest |L| that the energies allow
    turn : |omega| h [rad];  norm : ||q|^2 - 1|
    """

    energy: float
    l2: float
    lz: float
    turn: float
    norm: float


def limits(scene, carried, theta, steps, made=None, spin=0.0):
    """The Limits of a scene, or () where nothing but non-finite members is to be flagged (checks = false).

    carried : whether the attitude is: without it nobody sees L_z
    theta : how far the fastest member of the pilot moves in a step [rad];  steps : to the end;  made, spin : the Form of the integrator, and the
        turn [rad] of a step that it was prepared for

    A drift that is not bounded by the scene (energy_limit, momentum_limit) may reach steps * theta^(order + 1), at least 380 times what the
    shipped integrators make of it (1 to 3,000 steps of 0.05 to 0.6 rad, free and heavy; strang comes nearest), at least 5e6 + 50 steps
    roundings, at most 0.05. A step may turn a member by the integrator's `largest_turn` (turn_limit), pi where it has none; by more it is
    aliased or divergent. A member with steps of its own may turn by twice `turn`. A potential never brings it there, because the
    rate of its steps bounds |omega|; a torque that spins it up may. The exact free motion and midpoint are prepared for the spins
    of the pilot, and take twice that.
    """
    run = scene.run
    if not run.checks:
        return ()
    kind, kept = INTEGRATORS[run.integrator], conservation(scene)
    rounding = float(np.finfo(run.dtype).eps) * (5e6 + 50.0 * steps)
    with np.errstate(over="ignore"):
        error = (
            0.0 if kind.order == math.inf or not theta < 1.0 else steps * theta ** (kind.order + 1)
        )
    allowed = (
        COARSE if theta >= 1.0 and kind.order < math.inf else min(COARSE, max(error, rounding))
    )
    energy = (
        COARSE if "work" in run.save else allowed
    )  # what drives a body may make it much faster than the pilot is at the start
    drift = getattr(getattr(made, "integrator", None), "drift", None)
    turns = math.pi if drift is None else SPLIT if isinstance(drift, Split) else math.inf
    largest = kind.largest_turn or turns
    if isinstance(drift, Exact):
        largest = PLANNED * max(spin, PANEL_TURN)
    if kind.least_spin:
        largest = PLANNED * max(spin, kind.least_spin)
    bounds = {
        "energy": energy if run.energy_limit is None else run.energy_limit,
        "l2": allowed if run.momentum_limit is None else run.momentum_limit,
    }
    bounds["lz"] = bounds["l2"]
    for name in bounds:
        if kept[{"energy": "energy_drift"}.get(name, name)] != "yes" or (
            name == "lz" and not carried
        ):
            bounds[name] = math.inf
    largest = largest if run.turn is None else min(largest, SPUN_UP * run.turn)
    norm = 1e-9 if run.dtype == "float64" else 1e-3
    return Limits(**bounds, turn=largest if run.turn_limit is None else run.turn_limit, norm=norm)
