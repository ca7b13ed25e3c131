"""The rates of motion of one body, with exact derivatives, in units of its own size and speed.

A state is an attitude q and a momentum l in the principal axes. Its rates are the angular velocity
w, with all that effects add to I^-1 L, and f = dL/dt in the body::

    dq/dt = 1/2 q (0, w(q, l, t)),   dl/dt = f(q, l, t)

The engine compiles the same formulas; arrays with tangents
(`rigidmc.physics.dynamics.dual_arrays`) differentiate them. A change of attitude is a rotation
vector in body axes, q exp(x/2).
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigidmc.engine.formulas import torques
from rigidmc.errors import SceneError
from rigidmc.physics.dynamics.dual_arrays import DualArray
from rigidmc.physics.dynamics.euler import MassProperties, angular_velocity, free_rate
from rigidmc.physics.dynamics.so3 import add, spin
from rigidmc.physics.effects import label_effects
from rigidmc.physics.effects.rotor import Rotor
from rigidmc.physics.effects.sums import add_slip, total_energy, total_energy_scale, total_torque
from rigidmc.planning.initial import members_at_start
from rigidmc.planning.steps import physics
from rigidmc.scene.scene import Scene

Array = NDArray[np.float64]


class Mechanics(NamedTuple):
    """One body with its effects, and the units of its states: momenta are in moment * rate, times
    in 1/rate.

    body, effects : in the principal axes, with arrays (1,) as fields
    moment, rate : scale of the moments [kg m^2] and of the motion [rad/s]
    wheel : momentum of all rotors at t = 0 [moment * rate]
    axes : quaternion of the principal axes in the axes of the scene
    names : labels of the effects
    """

    body: MassProperties
    effects: tuple[Any, ...]
    moment: float
    rate: float
    wheel: Array
    axes: Array
    names: tuple[str, ...]

    @property
    def unit(self) -> float:
        """The unit of momenta [kg m^2/s]."""
        return self.moment * self.rate


class Rates(NamedTuple):
    """Rates of states, and their derivatives by seven numbers: x (3), l (3) and t.

    value : (n, 6), w and f;  slope : (n, 6, 7)
    """

    value: Array
    slope: Array


def mechanics_of(
    scene: Scene, member: int, turning: float | None = None
) -> tuple[Mechanics, Array, Array]:
    """Return (mechanics, q (4,), l (3,)) of a member of a scene at its start, l in scaled units.

    turning : rate of the steady motions [rad/s], if the start has another
    Raises SceneError for a body or start that is impossible.
    """
    block, start = members_at_start(scene.model, scene.run, member, 1)
    body, effects = physics(scene.effects, block)
    q, l = block[:4, 0], block[4:7, 0]
    inverse = np.array(body[:3])[:, 0]
    # of the middle axis: a thin axis turns fast, but carries no weight
    moment = 1.0 / float(np.median(inverse))
    swing = float(np.max(total_energy_scale(effects, body)))
    swing = max(swing, float(np.sqrt((torques(effects, body, tuple(q), tuple(l)) ** 2).sum())))
    speed = float(np.sqrt(((inverse * l) ** 2).sum())) if turning is None else turning
    rate = float(np.sqrt(speed**2 + swing / moment))
    if not np.isfinite([rate, *q, *l, *inverse]).all():
        rule = "has an impossible body or start, so it has no motion to linearise"
        raise SceneError(rule, at="member", table="", value=member)
    rate = rate if rate > 0.0 else 1.0  # a free body at rest has no unit of time
    rotors = [np.array(e.momentum)[:, 0] for e in effects if isinstance(e, Rotor)]
    wheel = sum(rotors, np.zeros(3)) / (moment * rate)
    axes = start["principal_axes"][:, 0] if "principal_axes" in start else np.eye(4)[0]
    names = tuple(label for label, _ in label_effects(scene.effects))
    mechanics = Mechanics(body, effects, moment, rate, wheel, axes, names)
    return mechanics, q, l / mechanics.unit


def rates_of(mechanics: Mechanics, q: Array, l: Array, t: Array | float = 0.0) -> Rates:
    """Return the Rates of states q (4, n), l (3, n) at times t.

    Raises SceneError for an effect whose code accepts no arrays or has no derivative.
    """
    count = q.shape[1]
    half = np.eye(3)[:, :, None] * np.full(count, 0.5)
    turned = np.stack([np.stack(spin(tuple(q), tuple(turn))) for turn in half])
    none = np.zeros((4, 3, count))
    attitude = DualArray(q, np.concatenate([turned, np.zeros((4, 4, count))]))
    slopes = np.concatenate([none[:3], np.eye(3)[:, :, None] + none[:3], none[:1]])
    scale, period = mechanics.unit, 1.0 / mechanics.rate
    momentum = DualArray(l, slopes) * scale
    time = DualArray(np.zeros(count) + t, np.eye(7)[6][:, None] + none[:1, 0]) * period
    try:
        parts = _rates(mechanics, time, tuple(attitude), tuple(momentum))
    except (TypeError, ValueError) as error:
        raise SceneError(_without_derivative(mechanics), at="effects", table="") from error
    value, slope = np.empty((count, 6)), np.zeros((count, 6, 7))
    for i, part in enumerate(parts):
        unit = mechanics.rate if i < 3 else scale * mechanics.rate
        value[:, i] = (part.value if isinstance(part, DualArray) else part) / unit
        if isinstance(part, DualArray):
            slope[:, i] = part.tangents.T / unit
    return Rates(value, slope)


def _rates(mechanics: Mechanics, t: Any, q: Any, l: Any) -> tuple[Any, ...]:
    """Return (w, f), six numbers or arrays."""
    body, effects = mechanics.body, mechanics.effects
    w = add_slip(effects, body, t, 2.0, q, l, angular_velocity(body, l))
    f: tuple[Any, ...] = add(free_rate(body, l), total_torque(effects, body, t, q, l))
    return (*w, *f)


def _without_derivative(mechanics: Mechanics) -> str:
    """Return the rule for effects whose code has no derivative."""
    return (
        f"the torque of {' or '.join(mechanics.names)} has no derivative in Python: write it with"
        " arithmetic and the functions of rigidmc.physics.dynamics.so3, such as root and select,"
        " in place of math and branches"
    )


def energy_of(mechanics: Mechanics, q: Array, l: Array) -> Array:
    """Return kinetic plus potential energy of states [J], (n,)."""
    spin_of, scale = np.array(mechanics.body[:3]), mechanics.unit
    kinetic = 0.5 * (spin_of * (scale * l) ** 2).sum(0)
    return np.asarray(kinetic + total_energy(mechanics.effects, mechanics.body, tuple(q)))
