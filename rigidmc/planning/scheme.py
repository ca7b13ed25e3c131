"""Choose the form in which an integrator is compiled, which may depend on the turn per step; and
the bounds that flag a member, on its drifts and on its turn per step. Their defaults follow from
the integrator, the step and the number of steps."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from rigidmc.engine.kernel import layout
from rigidmc.errors import SceneError
from rigidmc.inputs.arrays import Array
from rigidmc.physics.effects.sums import total_energy_scale
from rigidmc.physics.integrators import StepScheme, TurnBounds, scheme_of
from rigidmc.physics.integrators.protocol import Integrator, follows_turns
from rigidmc.physics.integrators.splitting import PANEL_TURN, Exact, Split
from rigidmc.planning.steps import physics, rate_bounds
from rigidmc.scene.model import Model
from rigidmc.scene.quantities import is_variable
from rigidmc.scene.settings import Run

# a member beyond the pilot may spin faster than all of the pilot: 7 sigma if the pilot reaches 3.5
MARGIN = 2.0
# with per-member steps, only body shapes beyond the pilot matter: lambda relative to the rate
OWN_MARGIN = 1.25


def make_scheme(
    kind: Integrator, model: Model, run: Run, pilot: Array, dt: float
) -> tuple[StepScheme, float | None, float]:
    """Return (StepScheme of an integrator, bound on the rate of free motion, turn |omega| dt of a
    step), for steps of dt [s] or for per-member steps of at most dt.

    pilot : the block of the first members, of a coarse model;  run : settings with the name of the
        integrator

    The bound is None, and the turn 0, if the integrator does not use them. With `turn` the bound is
    in units of the members' rates. Raises SceneError if a step turns a body too far for the
    integrator.
    """
    rate, turns = None, TurnBounds()
    if follows_turns(kind):
        bound = _turn_rates(model, pilot, run.turn is not None)
        rate = bound.free if run.turn_rate is None else run.turn_rate
        unit, key = (dt, "dt") if run.turn is None else (run.turn, "turn")
        turns = TurnBounds(rate * unit, bound.spin * unit, bound.symmetric)
        largest = kind.max_spin
        if turns.spin > largest:
            rule = (
                f"a step may turn by {turns.spin:.3g} rad, more than the {largest:g} rad that "
                f"{run.integrator} can solve; use {key} <= {unit * largest / turns.spin:.2g}"
            )
            raise SceneError(rule, at=f"run.{key}", value=getattr(run, key))
    return scheme_of(kind, turns, model.effects)._replace(name=run.integrator), rate, turns.spin


def largest_rates(effects: Sequence[Any], pilot: Array) -> tuple[float, float]:
    """Return (largest |omega| at the start, largest of `rate_bounds`) over the pilot [rad/s]."""
    with np.errstate(all="ignore"):
        omega = pilot[layout.BODY : layout.BODY + 3] * pilot[layout.MOMENTUM : layout.EXTRA]
        spins = np.sqrt((omega**2).sum(0))
        return _largest(spins), _largest(rate_bounds(effects, pilot))


def _largest(values: Array) -> float:
    return float(np.max(values, where=np.isfinite(values), initial=0.0))


class _TurnRates(NamedTuple):
    """Bounds on rates over the pilot.

    free : on lambda, the rate at which free motion turns L in the body [rad/s]
    spin : on |omega| [rad/s]; with per-member steps both are in units of the members' rates
    symmetric : whether all bodies have two equal moments
    """

    free: float
    spin: float
    symmetric: bool


def _turn_rates(model: Model, block: Array, own_steps: bool) -> _TurnRates:
    body, effects = physics(model.effects, block)
    l = block[layout.MOMENTUM : layout.EXTRA]
    a, i = np.array([body.a1, body.a2, body.a3]), np.array([body.i1, body.i2, body.i3])
    with np.errstate(all="ignore"):
        products = np.stack(
            [a[1] * a[2] * l[0] * l[0], a[2] * a[0] * l[1] * l[1], a[0] * a[1] * l[2] * l[2]]
        )
        free = np.sqrt(products.max(0) - products.min(0))
        spin = np.sqrt(((i * l) ** 2).sum(0))
        scale = total_energy_scale(effects, body) + np.zeros(l.shape[1])
        # torques can raise the kinetic energy from T to T + 2 V, and |L| and omega with it
        kinetic = 0.5 * (i * l * l).sum(0) + 2.0 * scale
        sizes = np.abs(a)
        bound = np.sqrt(2.0 * kinetic / i.min(0)) * np.sqrt(
            sizes.max(0) * np.sort(sizes, axis=0)[1]
        )
        free = np.where(scale > 0.0, bound, free)
        spin = np.where(scale > 0.0, spin + np.sqrt(2.0 * scale * i.max(0)), spin)
        if own_steps:
            rate = rate_bounds(model.effects, block)
            free, spin = free / rate, np.ones_like(rate)  # no member is faster than its rate
        equal = bool(np.all(sizes.min(0) <= 4e-15 * i.max(0)))
    # the pilot shows the symmetry of all members only if no moment is drawn
    symmetric = equal and not is_variable(model.body.moments)
    margin = OWN_MARGIN if own_steps else MARGIN
    margin = margin if is_variable(*model.quantities()) else 1.0
    # a member that exceeds the bounds is flagged; the scheme does not allow for it
    return _TurnRates(
        margin * _largest(free), (1.0 if own_steps else margin) * _largest(spin), symmetric
    )


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
    theta: float,
    steps: float,
    form: StepScheme | None = None,
    spin: float = 0.0,
) -> Limits | tuple[()]:
    """Compute the Limits of a run, or () if only non-finite members are flagged (checks = false).

    kind : the integrator;  conserved : see `rigidmc.scene.recording.conservation`
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
        if conserved[{"energy": "energy_drift"}.get(name, name)] != "yes":
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
