"""The rates of motion of one body, with exact derivatives, in units of its own size and speed; and
the continuous symmetries of its scene, with the momenta that they conserve.

A state is an attitude q and a momentum l in the principal axes. Its rates are the angular velocity
w, with all that effects add to I^-1 L, and f = dL/dt in the body::

    dq/dt = 1/2 q (0, w(q, l, t)),   dl/dt = f(q, l, t)

The engine compiles the same formulas; arrays with tangents
(`rigidmc.physics.dynamics.dual_arrays`) differentiate them. A change of attitude is a rotation
vector in body axes, q exp(x/2).

A generator (n, s, m) turns the body about the space vector n, shifts time by s, and turns the state
about the body vector m::

    dq = (0, n) q/2 + q (0, m)/2,   dl = -m x l,   dt = s

It is a symmetry if the rates only turn with it, dw = -m x w and df = -m x f in all states. This is
linear in (n, s, m): the symmetries are the null space of a matrix with rows at several states.
Source: Marsden & Ratiu, Introduction to Mechanics and Symmetry (1999), 9 and 11.
"""

from typing import Any, NamedTuple

import numpy as np

from rigidmc.engine.formulas import torques
from rigidmc.engine.streams import uniforms
from rigidmc.errors import SceneError
from rigidmc.inputs.arrays import Array
from rigidmc.physics.dynamics.dual_arrays import DualArray
from rigidmc.physics.dynamics.euler import MassProperties, angular_velocity, free_rate
from rigidmc.physics.dynamics.methods import argument_names
from rigidmc.physics.dynamics.so3 import add, into_body, spin
from rigidmc.physics.effects import label_effects
from rigidmc.physics.effects.rotor import Rotor
from rigidmc.physics.effects.sums import add_slip, total_energy, total_energy_scale, total_torque
from rigidmc.planning.initial import members_at_start
from rigidmc.planning.steps import physics
from rigidmc.scene.model import Model
from rigidmc.scene.settings import Run
from rigidmc.scene.vector_distributions.vectors import uniform_attitudes

STATES = 12  # random states; 3 would determine the 7 numbers of a generator
# of a singular value, in scaled units: rounding is below 1e-14, and gravity gradient on a body that
# turns 1000 times an orbit is 1e-6
ZERO = 1e-12
PARTS = slice(0, 3), slice(3, 6)  # n and m of a generator


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
    model: Model, run: Run, member: int, turning: float | None = None
) -> tuple[Mechanics, Array, Array]:
    """Return (mechanics, q (4,), l (3,)) of a member of a model at its start, l in scaled units.

    turning : rate of the steady motions [rad/s], if the start has another
    Raises SceneError for a body or start that is impossible.
    """
    block, start = members_at_start(model, run, member, 1)
    body, effects = physics(model.effects, block)
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
    names = tuple(label for label, _ in label_effects(model.effects))
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


class System(NamedTuple):
    """The mechanics of a scene and its symmetries.

    frame : (6,) n and m of a generator with s = 1: its flow shifts time by as much as passes
    generators : (k, 6) n and m of the generators with s = 0
    conserved : (c, 6) a basis of the generators whose momentum is constant
    central : (d, 6) a basis of the conserved ones that commute with all generators: symmetries
        leave their momentum as it is
    conserves_size : whether |l + wheel| is constant
    is_hamiltonian : whether the torques follow from a potential, so that nothing is damped
    """

    mechanics: Mechanics
    frame: Array
    generators: Array
    conserved: Array
    central: Array
    conserves_size: bool
    is_hamiltonian: bool


def cross_matrix(a: Array) -> Array:
    """Return the matrices (..., 3, 3) of b -> a x b."""
    matrix = np.zeros((*a.shape[:-1], 3, 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        matrix[..., k, j], matrix[..., j, k] = a[..., i], -a[..., i]
    return matrix


def space_to_body(q: Array) -> Array:
    """Return the matrices A^T (n, 3, 3) of attitudes (4, n)."""
    zero = np.zeros(q.shape[1])
    columns = [into_body(tuple(q), tuple(axis[:, None] + zero)) for axis in np.eye(3)]
    return np.moveaxis(np.array(columns), -1, 0).swapaxes(1, 2)


def null_space(matrix: Array, zero: float) -> Array:
    """Return orthonormal rows that span the null space of a matrix, 0 up to `zero`."""
    _, values, rows = np.linalg.svd(matrix)
    rank = int((values > zero).sum())
    return np.asarray(rows[rank:])


def tidied(rows: Array) -> Array:
    """Return a basis of the span of some rows, in echelon form, each of length 1.

    A generator about one axis then is that axis alone, to the last bit.
    """
    rows, at = rows.copy(), 0
    for column in range(rows.shape[1]):
        if at == len(rows):
            break
        best = at + int(np.abs(rows[at:, column]).argmax())
        # in 19 shipped scenes pivots are above 0.3, and rounding leaves at most 1e-13 in their
        # place
        if abs(rows[best, column]) < 1e-8:
            continue
        rows[[at, best]] = rows[[best, at]]
        rows[at] /= rows[at, column]
        others = np.arange(len(rows)) != at
        rows[others] -= rows[others, column, None] * rows[at]
        at += 1
    rows[np.abs(rows) < 1e-10] = 0.0  # without the sign of -0.0
    return np.asarray(rows / np.sqrt((rows * rows).sum(1, keepdims=True)))


def momentum_rows(mechanics: Mechanics, q: Array, l: Array, generators: Array) -> Array:
    """Return the derivatives (k, 6) of the momenta by x and l in one state.

    The momentum of a generator is (A^T n + m) . (l + wheel).
    """
    total, up = l + mechanics.wheel, generators[:, :3] @ space_to_body(q[:, None])[0].T
    return np.concatenate([np.cross(total, up), up + generators[:, 3:]], axis=1)


def orbit_rows(q: Array, l: Array, generators: Array) -> Array:
    """Return the changes (k, 6) of x and l along the generators in one state."""
    up, m = generators[:, :3] @ space_to_body(q[:, None])[0].T, generators[:, 3:]
    return np.concatenate([up + m, np.cross(l, m)], axis=1)


def sample_states(count: int) -> tuple[Array, Array, Array]:
    """Return random (q (4, n), w (3, n), t (n,)) in scaled units, the same in every call."""
    u, v, w, t = uniforms(0, "linearise", 0, count, 0)
    x, y, z, _ = uniforms(0, "linearise", 0, count, 1)
    return uniform_attitudes(u, v, w), 2.0 * np.array([x, y, z]) - 1.0, 10.0 * t


def find_symmetries(mechanics: Mechanics) -> System:
    """Return the System of a scene; SceneError if none of them passes with time, as for a
    periodic torque: the scene then has no steady motion."""
    q, w, t = sample_states(STATES)
    # an axis with a small moment turns no faster
    l = w / (mechanics.moment * np.array(mechanics.body[:3]))
    rates, into = rates_of(mechanics, q, l, t), space_to_body(q)
    w, f = rates.value[:, :3], rates.value[:, 3:]
    by_x, by_l, by_t = rates.slope[..., :3], rates.slope[..., 3:6], rates.slope[..., 6:]
    turned = np.concatenate([-cross_matrix(w), -cross_matrix(f)], axis=1)
    by_m = by_x + by_l @ cross_matrix(l.T) + turned
    changes = np.concatenate([by_x @ into, by_t, by_m], axis=2).reshape(-1, 7)
    # a turn of a thin body changes its rates much, which must not hide weak effects
    size = np.maximum(1.0, np.abs(changes).max(axis=0))
    free = np.linalg.qr((null_space(changes / size, ZERO) / size).T)[0].T
    passing = free.T @ free[:, 3]
    if not passing[3] > 1e-12:
        raise SceneError(_never_steady(mechanics), at="effects", table="")
    frame = np.delete(passing / passing[3], 3)
    frame[np.abs(frame) < 1e-12] = 0.0
    still = null_space(free[:, 3:4].T, 1e-9) @ free if len(free) > 1 else np.empty((0, 7))
    generators = tidied(np.delete(still, 3, axis=1))
    up, m = generators[:, :3] @ into.swapaxes(1, 2), generators[:, 3:]
    total = l.T + mechanics.wheel
    # rates (n, k) of the momenta
    moved = ((np.cross(w, total) + f)[:, None] * up).sum(2) + f @ m.T
    conserved = _null_part(moved, generators)
    brackets = [np.cross(conserved[:, None, part], generators[:, part]) for part in PARTS]
    flat = np.concatenate(brackets, axis=2).reshape(len(conserved), 6 * len(generators))
    central = _null_part(flat.T, conserved)
    growth = (total * f).sum(1)
    has_size = bool(np.abs(growth).max() < ZERO * max(1.0, (np.abs(total) * np.abs(f)).max()))
    is_hamiltonian = _is_hamiltonian(rates, total)
    return System(mechanics, frame, generators, conserved, central, has_size, is_hamiltonian)


def _is_hamiltonian(rates: Rates, total: Array) -> bool:
    """Return whether w = dH/dl and f = total x w - dV/dx, from rates at random states.

    The torque tau = f - total x w then does not depend on l, and turns about the body axes, which
    do not commute, give dtau/dx - (dtau/dx)^T = tau x.
    """
    w, f = rates.value[:, :3], rates.value[:, 3:]
    inverse, by_x = rates.slope[:, :3, 3:6], rates.slope[:, 3:, :3]
    tau = f - np.cross(total, w)
    by_l = rates.slope[:, 3:, 3:6] + cross_matrix(w) - cross_matrix(total) @ inverse
    curl = by_x - by_x.swapaxes(1, 2) - cross_matrix(tau)
    slip = rates.slope[:, :3, :3], inverse - inverse.swapaxes(1, 2)
    # the rates are in the scene's own units
    size = max(1.0, float(np.abs(rates.slope).max()))
    return all(float(np.abs(part).max()) < ZERO * size for part in (by_l, curl, *slip))


def subalgebra(generators: Array, zero: slice) -> Array:
    """Return a basis (a, 6) of the combinations of generators whose part `zero` is 0."""
    return _null_part(generators[:, zero].T, generators)


def _null_part(matrix: Array, rows: Array) -> Array:
    """Return a basis of those combinations of rows (k, 6) whose coefficients a matrix (..., k)
    takes to 0."""
    if not len(rows):
        return rows
    # the matrix is in units of the scene's own scales
    return tidied(null_space(matrix, ZERO * max(1.0, np.abs(matrix).max())) @ rows)


def _never_steady(mechanics: Mechanics) -> str:
    """Return the rule for a scene without a symmetry that passes with time."""
    timed = [
        name
        for name, effect in zip(mechanics.names, mechanics.effects, strict=True)
        if "t" in argument_names(effect, "torque")
    ]
    return (
        f"{' and '.join(timed)} changes with time, and no rotating frame makes it constant, so"
        " there is no steady motion; use constant effects, a circular orbit (eccentricity = 0) or"
        " a field that rotates"
    )
