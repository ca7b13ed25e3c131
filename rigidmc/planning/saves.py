"""How dense saves must be, by the rates at which saved and plotted quantities turn; and the times
of saves that a scene leaves open: saves per turn, and enough saves to plot few members.

Only this module decides it: between two values that a line joins, no quantity may turn by more than
MOST. A quantity that turns by pi between saves seems to turn backwards; one that turns by 2 pi
seems to stand still. At 2 rad lines are coarse, but `numpy.unwrap` still finds every turn.

The saves chosen here end steps that the run makes anyway: they change no step, and so no motion.
"""

import math
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np

from rigidmc.engine.formulas import torques
from rigidmc.engine.kernel import layout
from rigidmc.errors import SceneError
from rigidmc.inputs.arrays import Array
from rigidmc.physics.dynamics.methods import argument_names
from rigidmc.physics.effects.protocol import DECIDING, facts
from rigidmc.physics.effects.rotor import Rotor
from rigidmc.physics.observables import value_rows
from rigidmc.planning.initial import make_pilot, make_sampler
from rigidmc.planning.plan import MOST_SAVES
from rigidmc.planning.steps import make_time_grid, physics
from rigidmc.scene.model import Model
from rigidmc.scene.recording import Recording
from rigidmc.scene.save_times import settled
from rigidmc.scene.scene import Scene
from rigidmc.scene.settings import Run

MOST = 2.0  # rad
LOOKED_AT = 64  # members used to find how fast effects swing a body
ATTITUDES = 32  # attitudes at which their torque is evaluated
BODY, AXIS, ATTITUDE = "body", "axis", "attitude"  # the fields of `Turning`


class Drive(NamedTuple):
    """The contribution of a scene's effects to the rates of its motion.

    attitude : whether a torque depends on the attitude, so that directions fixed in space show in
        omega
    swing : rate of swings that the effects cause, the largest sqrt |I^-1 torque| [rad/s]
    frequency : largest driving frequency of a torque [rad/s]
    rotor : momentum of rotors in the body, (3, 1) or (3, n) [kg m2/s]
    """

    attitude: bool = False
    swing: float = 0.0
    frequency: float = 0.0
    rotor: Array = np.zeros((3, 1))


class Turning(NamedTuple):
    """Rates of states [rad/s], as arrays of one shape.

    body : of vectors in the body, such as omega and the momentum
    axis : of the directions of axis 3 in space, and of the Euler angles
    attitude : of the body, |omega|
    """

    body: Array
    axis: Array
    attitude: Array


def drive(model: Model, run: Run, rotor: Array | None = None) -> Drive:
    """Return the Drive of the first members.

    rotor : momentum of rotors (3, n), if other members are meant
    """
    effects = model.effects
    if not effects:
        return Drive()
    block = _first_block(model, run)
    body, filled = physics(effects, block)
    inverse = block[layout.BODY : layout.BODY + 3]
    frequency, held = 0.0, np.zeros((3, 1))
    for effect in filled:
        units = facts(effect).units
        if "t" in argument_names(effect, "torque", "kick"):
            driven = [getattr(effect, name) for name, unit in units.items() if unit == "rad s-1"]
            frequency = max([frequency, *map(_largest, driven)])
        if isinstance(effect, Rotor):
            held = held + np.stack(np.broadcast_arrays(*effect.momentum))
    turned = any("q" in argument_names(e, *DECIDING) for e in effects)
    swing = _swing(body, filled, inverse) if turned else 0.0
    return Drive(turned, swing, frequency, held if rotor is None else rotor)


def _first_block(model: Model, run: Run) -> Array:
    """Return the rows of the first members at their start, with attitudes."""
    coarse = model.coarse()
    return make_pilot(coarse, make_sampler(coarse, run), True, LOOKED_AT).block


def _swing(body: Any, effects: Any, inverse: Array) -> float:
    """Return the largest sqrt |I^-1 torque| of a body at rest, excluding the part that is the same
    at all attitudes [rad/s]."""
    rest = (np.zeros(inverse.shape[1]),) * 3
    with np.errstate(all="ignore"):
        felt = [
            inverse * torques(effects, body, tuple(q / np.linalg.norm(q)), rest)
            for q in np.random.default_rng(1).normal(size=(ATTITUDES, 4))
        ]
        return math.sqrt(_largest(np.linalg.norm(felt - np.mean(felt, axis=0), axis=1)))


def turning_rates(moments: Array, l: Array, by: Drive) -> Turning:
    """Compute the turning rates of states with momenta l (..., 3, n) and moments (3, n).

    A free momentum runs around its polhode at the rate lambda, at most |omega|:

        lambda^2 = max - min of  L_i^2 (1/I_i - 1/I_j) (1/I_k - 1/I_i)

    With a rotor of momentum h, the rate is that of small motions about the present state. It
    follows from the second coefficient c of the characteristic polynomial of dL/dt = M x omega,
    M = L + h:

        c = |omega|^2 + sum M_i omega_i/I_i - M . omega sum 1/I_i + sum M_i^2/(I_j I_k)

    Torques that depend on the attitude turn in the body with omega, and so do their effects on it.
    Axis 3 of a free body circles L at |L| (L_1^2/I_1 + L_2^2/I_2)/(L_1^2 + L_2^2). This is at most
    2 |omega| for a symmetric body; other bodies exceed it only where axis 3 comes close to L.
    """
    rotor = by.rotor if by.rotor.shape[1] in (1, l.shape[-1]) else by.rotor.max(1, keepdims=True)
    with np.errstate(all="ignore"):
        inverse = 1.0 / moments
        omega, total = inverse * l, l + rotor
        square, spin = l * l, np.sqrt((omega * omega).sum(-2))
        if rotor.any():
            c = omega * omega + total * omega * inverse + total**2 * inverse.prod(0) * moments
            free = np.sqrt(np.abs(c.sum(-2) - (total * omega).sum(-2) * inverse.sum(0)))
        else:
            gaps = inverse - np.roll(inverse, -1, 0)
            products = square * (-gaps * np.roll(gaps, 1, 0))
            free = np.sqrt(products.max(-2) - products.min(-2))
        across = square[..., :2, :]
        around = (across * inverse[:2]).sum(-2) / across.sum(-2)
        around = np.where(across.sum(-2) > 0.0, around, inverse[:2].max(0))
        around = np.minimum(np.sqrt(square.sum(-2)) * around, 2.0 * spin)
    body = np.maximum(free, spin) if by.attitude else free
    return Turning(
        np.maximum(body, max(by.swing, by.frequency)),
        np.maximum(around, by.swing),
        np.maximum(spin, by.swing),
    )


def _largest(values: Array) -> float:
    values = np.asarray(values, dtype=float)
    return float(np.max(np.abs(values), where=np.isfinite(values), initial=0.0))


KINDS = {
    "omega": BODY,
    "momentum": BODY,
    "principal_omega": BODY,
    "principal_momentum": BODY,
    "attitude": ATTITUDE,
    "orbit_angles": ATTITUDE,
}
FEW = 1e-3  # fraction of members that may turn further: no line and no quantile shows them


class Sparse(NamedTuple):
    """Members that turn by more than MOST between two shown values.

    fast : number of these members;  members : number of all;  angle : turn of the fastest [rad]
    every : largest time between values that resolves the motion [s], rounded down to 2 digits
    """

    fast: int
    members: int
    angle: float
    every: float

    def who(self) -> str:
        """Describe the members and their turn in words."""
        if self.members == 1:
            return f"turns by up to {self.angle:.3g} rad"
        some = "all" if self.fast == self.members else f"{self.fast:,}"
        return f"{some} of {self.members:,} members turn by up to {self.angle:.3g} rad"


def sparse(rates: Array, between: float, drawn: Iterable[int] = ()) -> Sparse | None:
    """Find members whose values are too far apart for lines to join them; None if there are none.

    rates : largest of each member (n,) [rad/s];  between : time between two values [s]
    drawn : members that a picture shows one by one; of the others, one in a thousand may turn
        further
    """
    with np.errstate(invalid="ignore"):
        fast = rates * between > MOST * (1.0 + 1e-9)
    count = int(np.count_nonzero(fast))
    if count <= FEW * rates.size and not fast[list(drawn)].any():
        return None
    fastest = _largest(rates)
    return Sparse(count, rates.size, fastest * between, rounded_down(MOST / fastest))


def rounded_down(value: float) -> float:
    """Round a number down to two digits."""
    unit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return float(f"{math.floor(value / unit * (1.0 + 1e-12)) * unit:.2g}")


def longest_interval(run: Run) -> float:
    """Return the longest time between two saves [s]."""
    every = settled(run.every)
    if isinstance(every, tuple):
        inner = [t for t in every if t < run.t_end]
        return float(np.diff([0.0, *inner, run.t_end]).max())
    return run.t_end if every is None else min(every, run.t_end)


def turning_at_start(model: Model, run: Run) -> Turning:
    """Return the Turning of the first members at their start."""
    block = _first_block(model, run)
    with np.errstate(all="ignore"):
        moments = 1.0 / block[layout.BODY : layout.BODY + 3]
    return turning_rates(moments, block[layout.MOMENTUM : layout.EXTRA], drive(model, run))


def shown_rate(model: Model, run: Run) -> float:
    """Return the rate of the saved quantity that turns fastest, among the first members at their
    start [rad/s]; if no saved quantity turns, of vectors in the body, of axis 3 or of the body."""
    turns = turning_at_start(model, run)
    fields = {KINDS[name] for name in run.save if name in KINDS} or set(Turning._fields)
    return max(_largest(getattr(turns, field)) for field in fields)


def sparse_saves(model: Model, run: Run) -> tuple[str, Sparse] | None:
    """Find the saved quantity that turns fastest, judged at the start.

    Returns (quantity, Sparse), or None if lines through the saves show the motion, or if there are
    only two saves.
    """
    turned = []
    between = longest_interval(run)
    if 2.0 * between > run.t_end:
        return None
    turns = turning_at_start(model, run)
    for name in run.save:
        if name in KINDS and (gap := sparse(getattr(turns, KINDS[name]), between)):
            turned.append((name, gap))
    return max(turned, key=lambda pair: pair[1].angle, default=None)


FEW_MEMBERS = 20  # of a run that is plotted member by member
POINTS = 400  # saves to plot, if the motion does not require more
PER_TURN = 20  # saves to plot per turn of the fastest saved quantity: lines bend by 18 degrees
MOST_POINTS = 20_000
MOST_BYTES = 64e6  # of the saves to plot of all members
LONGEST_STRIDE = 1000  # steps: `make_time_grid` finds back t_end/every = steps/stride up to here


def settle_saves(scene: Scene) -> Scene:
    """Return the scene with a time between saves in place of saves per turn.

    A turn is one of the saved quantity that turns fastest at the start, see
    `rigidmc.planning.saves.shown_rate`. Raises SceneError if nothing turns.
    """
    run = scene.run
    if not isinstance(run.every, str):
        return scene
    number = float(run.every.partition("/")[0])  # of a checked N/turn
    count = number * run.t_end * shown_rate(scene.model, run) / (2.0 * math.pi)
    if not count > 0.0:
        rule = "nothing turns at the start: give a time between saves"
        raise SceneError(rule, at="run.every", value=run.every)
    if count > MOST_SAVES:
        rule = f"{count:.3g} saves exceed the limit of {MOST_SAVES:,}"
        raise SceneError(rule, at="run.every", value=run.every)
    return scene.with_run(every=_even(run, math.ceil(count)))


def save_to_plot(scene: Scene, recording: Recording, members: int, parameters: int) -> Scene:
    """Return the scene with a time between saves at which lines through the saves of `members`
    members show the motion; the scene itself if that is not possible or not asked for.

    It is asked for if few members save their values in full, and the scene leaves `every` open. It
    is not possible if members have their own steps, which begin again at each save, or if the steps
    or the limits are too coarse for the motion.

    parameters : number of parameters of derivatives
    """
    run, words = scene.run, set(recording.retained.values())
    if run.every is not None or run.turn is not None or run.varied:
        return scene
    if not 0 < members <= FEW_MEMBERS or words != {"full"}:
        return scene
    rows = max(place.stop for place in value_rows(recording.recorded, len(scene.effects)).values())
    numbers = rows * (1 + parameters)
    angle = run.t_end * shown_rate(scene.model, run)
    count = max(POINTS, math.ceil(PER_TURN * angle / (2.0 * math.pi)))
    count = min(count, MOST_POINTS, int(MOST_BYTES / (8 * members * numbers)))
    grid = None if run.integrator == "closed" else make_time_grid(run.t_end, run.dt, None)
    if grid is not None:
        count = min(count, grid.steps)
    if count < 2 or angle > MOST * count:
        return scene
    every = _even(run, count)
    if grid is not None:
        made = make_time_grid(run.t_end, run.dt, every)
        if (made.steps, made.dt, made.is_shortened) != (grid.steps, grid.dt, False):
            return scene
    return scene.with_run(every=every)


def first_and_last(scene: Scene) -> Scene:
    """Return the scene whose saves, if it leaves them open, are the first and the last state,
    however few its members are."""
    return scene if scene.run.every is not None else scene.with_run(every=scene.run.t_end)


def _even(run: Run, count: int) -> float:
    """Return the time between at least `count` even saves [s]; with steps of one length, a whole
    number of these if they are at least as many."""
    if run.integrator in ("auto", "closed") or run.turn is not None:
        return run.t_end / count
    grid = make_time_grid(run.t_end, run.dt, None)
    if count >= grid.steps:
        return run.t_end / count
    most = min(2 * count, grid.steps)
    dividing = next((n for n in range(count, most + 1) if grid.steps % n == 0), None)
    if dividing is not None:
        return run.t_end / dividing
    return grid.dt * min(grid.steps // count, LONGEST_STRIDE)
