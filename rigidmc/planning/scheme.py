"""The form in which an integrator is compiled: it may depend on how far a step turns a body."""

from typing import NamedTuple

import numpy as np

from rigidmc.engine.kernel import layout
from rigidmc.engine.kernel.layout import whole_lanes
from rigidmc.errors import SceneError
from rigidmc.physics.dynamics.methods import argument_names, implements
from rigidmc.physics.effects.sums import total_energy_scale
from rigidmc.physics.integrators import Form, Turns, form
from rigidmc.planning.initial import first_members
from rigidmc.planning.monitors import Watch, needs_attitude, watch
from rigidmc.planning.steps import Array, own_steps, physics, rates
from rigidmc.scene.quantities import is_open, is_shared, rows
from rigidmc.scene.scene import Scene
from rigidmc.scene.validation import PILOT

# a member beyond the pilot may spin faster than all of the pilot: 7 sigma if the pilot reaches 3.5
MARGIN = 2.0
# with member steps only the shapes of bodies beyond the pilot count: lambda relative to the rate
OWN_MARGIN = 1.25


def carries_attitude(scene: Scene, watched: Watch | None = None) -> bool:
    """Whether anything needs the attitude: an effect that names q, or what is saved or watched.

    watched : the Watch of the scene, if it is known
    """
    by_effects = any("q" in argument_names(e, "torque", "kick", "energy") for e in scene.effects)
    return by_effects or needs_attitude(scene, watch(scene) if watched is None else watched)


def form_of(scene: Scene, dt: float) -> tuple[Form, float | None, float]:
    """(Form of a scene's integrator, bound on the rate of free motion, turn |omega| dt of a step)
    for steps of dt [s], or for member steps of at most dt.

    The bound is None, and the turn 0, if the integrator does not ask for them. With `turn` the
    bound is in units of the members' rates. Raises SceneError if a step turns a body too far for
    the integrator.
    """
    run = scene.run
    kind, rate, turns = scene.integrator, None, Turns()
    if implements(kind, "prepared"):
        bound = _turn_rates(scene)
        rate = bound.free if run.turn_rate is None else run.turn_rate
        unit, key = (dt, "dt") if run.turn is None else (run.turn, "turn")
        turns = Turns(rate * unit, bound.spin * unit, bound.symmetric)
        largest = kind.largest_spin
        if turns.spin > largest:
            rule = (
                f"a step may turn by {turns.spin:.3g} rad, more than the {largest:g} for which "
                f"{run.integrator} can be solved; use {key} <= {unit * largest / turns.spin:.2g}"
            )
            raise SceneError("run", key, getattr(run, key), rule)
    return form(kind, turns, scene.effects)._replace(name=run.integrator), rate, turns.spin


def largest_rates(scene: Scene, carried: bool) -> tuple[float, float]:
    """(largest |omega| at the start, largest of the `rates`) of the pilot [rad/s]."""
    scene = scene.coarse()
    block = first_members(scene, _pilot_size(scene), carried).block
    with np.errstate(all="ignore"):
        omega = block[layout.BODY : layout.BODY + 3] * block[layout.MOMENTUM : layout.REST]
        spins = np.sqrt((omega**2).sum(0))
        return _largest(spins), _largest(rates(scene.effects, block))


def mean_own_steps(scene: Scene, carried: bool, span: float) -> float:
    """How many steps the members of the pilot make in a time [s], on average."""
    block = first_members(scene.coarse(), _pilot_size(scene), carried).block
    return float(np.mean(own_steps(rates(scene.effects, block), span, scene.run.turn)))


def _pilot_size(scene: Scene) -> int:
    """How many first members stand for the ensemble: all rows if a scene has arrays."""
    alike = is_shared(*scene.quantities()) and not isinstance(scene.start.attitude, str)
    return layout.LANES if alike else whole_lanes(max(PILOT, rows(*scene.quantities()) or 0))


def _largest(values: Array) -> float:
    return float(np.max(values, where=np.isfinite(values), initial=0.0))


class _TurnRates(NamedTuple):
    """Bounds over the pilot.

    free : on lambda, the rate at which free motion turns L in the body [rad/s];  spin : on |omega|
        [rad/s]. With member steps both are in units of the members' rates
    symmetric : whether all bodies have two equal moments
    """

    free: float
    spin: float
    symmetric: bool


def _turn_rates(scene: Scene) -> _TurnRates:
    scene = scene.coarse()
    block = first_members(scene, _pilot_size(scene), carries_attitude(scene)).block
    body, effects = physics(scene.effects, block)
    l = block[layout.MOMENTUM : layout.REST]
    a, i = np.array([body.a1, body.a2, body.a3]), np.array([body.i1, body.i2, body.i3])
    with np.errstate(all="ignore"):
        products = np.stack(
            [a[1] * a[2] * l[0] * l[0], a[2] * a[0] * l[1] * l[1], a[0] * a[1] * l[2] * l[2]]
        )
        free = np.sqrt(products.max(0) - products.min(0))
        spin = np.sqrt(((i * l) ** 2).sum(0))
        scale = total_energy_scale(effects, body) + np.zeros(l.shape[1])
        # torques can bring the kinetic energy from T to T + 2 V, and |L| and omega with it
        kinetic = 0.5 * (i * l * l).sum(0) + 2.0 * scale
        sizes = np.abs(a)
        bound = np.sqrt(2.0 * kinetic / i.min(0)) * np.sqrt(
            sizes.max(0) * np.sort(sizes, axis=0)[1]
        )
        free = np.where(scale > 0.0, bound, free)
        spin = np.where(scale > 0.0, spin + np.sqrt(2.0 * scale * i.max(0)), spin)
        if scene.run.turn is not None:
            rate = rates(scene.effects, block)
            free, spin = free / rate, np.ones_like(rate)  # no member is faster than its rate
        equal = bool(np.all(sizes.min(0) <= 4e-15 * i.max(0)))
    # the pilot tells the symmetry of all members only if no moment is drawn
    symmetric = equal and not is_open(scene.body.moments)
    margin = MARGIN if scene.run.turn is None else OWN_MARGIN
    margin = margin if is_open(*scene.quantities()) else 1.0
    # a member that exceeds the bounds is flagged, not planned for
    return _TurnRates(
        margin * _largest(free),
        (margin if scene.run.turn is None else 1.0) * _largest(spin),
        symmetric,
    )
