"""Choose the form in which an integrator is compiled; it may depend on the turn per step."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from rigidmc.engine.kernel import layout
from rigidmc.errors import SceneError
from rigidmc.physics.effects.sums import total_energy_scale
from rigidmc.physics.integrators import StepScheme, TurnBounds, scheme_of
from rigidmc.physics.integrators.protocol import Integrator, follows_turns
from rigidmc.planning.steps import Array, physics, rate_bounds
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
        margin * _largest(free),
        (1.0 if own_steps else margin) * _largest(spin),
        symmetric,
    )
