"""Steady motions of a scene: Newton's method for relative equilibria, from many starts at once.

A steady motion follows the symmetries of the scene, see `rigidmc.studies.linearise.system`.
With c_i along the generators (n_i, m_i) and (n, m) = frame + sum c_i (n_i, m_i)::

    w(q, l) = A^T n + m,   f(q, l) = l x m,   momenta = momenta of the start

It is an equilibrium in the frame that turns with n in space, seen from axes that turn with m in the
body: m is 0 except for bodies that are symmetric about an axis. The unknowns are q, l and c. They
may be more than the equations determine, as the direction of a tilt is; steps are the shortest that
solve the linear equations (Levenberg-Marquardt with a damping that vanishes as the square of the
residual, so the convergence is quadratic). Source: Yamashita & Fukushima, Computing Suppl. 15
(2001) 239.
"""

from itertools import permutations, product
from typing import Any, NamedTuple

import numpy as np

from rigidmc.inputs.arrays import Array
from rigidmc.mechanics.rotation import from_rotation_vector, quaternion_from_matrix
from rigidmc.physics.dynamics.so3 import multiply
from rigidmc.scene.sampling import points
from rigidmc.scene.vector_distributions.vectors import uniform_attitudes
from rigidmc.studies.linearise.system import (
    System,
    cross_matrix,
    null_space,
    orbit_rows,
    rates_of,
    space_to_body,
    subalgebra,
)

MOST = 60  # steps; 99 of 100 starts need at most 25
SOLVED = 1e-12  # largest residual of a solution, in scaled units; rounding leaves 1e-14
FLAT = 1e-12  # singular values below this fraction of the largest are rounding
ALIKE = 1e-6  # of directions that are one up to the error of a double root
LONGEST = 0.7  # rad of a step: longer ones jump between solutions
SMALLEST = 1e-30  # square of a residual that is rounding; residuals are in the scene's own rates
STREAM = "linearise.starts"  # of the quasi-random attitudes


class States(NamedTuple):
    """States, and the motions that they may have.

    q : (4, n);  l : (3, n) [moment * rate];  c : (k, n) along the generators [rate]
    """

    q: Array
    l: Array
    c: Array

    def at(self, index: Any) -> "States":
        """Return some of the states."""
        return States(self.q[:, index], self.l[:, index], self.c[:, index])

    def with_at(self, index: Any, states: "States") -> "States":
        """Return the states with those at some places replaced."""
        q, l, c = self.q.copy(), self.l.copy(), self.c.copy()
        q[:, index], l[:, index], c[:, index] = states
        return States(q, l, c)


def frames(system: System, states: States) -> tuple[Array, Array]:
    """Return (A^T n, m), (n, 3) each: the turning in space and in the body, in body axes."""
    moving = system.frame + states.c.T @ system.generators
    return np.einsum("nij,nj->ni", space_to_body(states.q), moving[:, :3]), moving[:, 3:]


def held_momenta(system: System, q: Array, l: Array) -> Array:
    """Return the momenta (h, n) of states that a search holds: of each central generator, and half
    the square of the whole, if this is constant."""
    total = l.T + system.mechanics.wheel
    up = system.central[:, :3] @ space_to_body(q).swapaxes(1, 2)
    momenta = ((up + system.central[:, 3:]) * total[:, None]).sum(2)
    if system.conserves_size:
        momenta = np.concatenate([momenta, 0.5 * (total**2).sum(1, keepdims=True)], axis=1)
    return np.asarray(momenta.T)


def residual(system: System, states: States, held: Array) -> tuple[Array, Array]:
    """Return (residuals (n, r), their derivatives (n, r, 6 + k) by x, l and c)."""
    q, l, _ = states
    rates, (turn, m) = rates_of(system.mechanics, q, l), frames(system, states)
    into, k = space_to_body(q), len(system.generators)
    up = system.generators[:, :3] @ into.swapaxes(1, 2)
    value = rates.value.copy()
    value[:, :3] -= turn + m
    value[:, 3:] -= np.cross(l.T, m)
    slope = np.zeros((q.shape[1], 6, 6 + k))
    slope[:, :, :6] = rates.slope[:, :, :6]
    slope[:, :3, :3] -= cross_matrix(turn)  # a vector fixed in space changes by u x x in the body
    slope[:, 3:, 3:6] += cross_matrix(m)
    slope[:, :3, 6:] = -(up + system.generators[:, 3:]).swapaxes(1, 2)
    slope[:, 3:, 6:] = -np.cross(l.T[:, None], system.generators[:, 3:]).swapaxes(1, 2)
    total, central = l.T + system.mechanics.wheel, system.central
    up = central[:, :3] @ into.swapaxes(1, 2)
    rows = np.zeros((q.shape[1], len(held), 6 + k))
    rows[:, : len(central), :3] = np.cross(total[:, None], up)
    rows[:, : len(central), 3:6] = up + central[:, 3:]
    if system.conserves_size:
        rows[:, -1, 3:6] = total
    off = (held_momenta(system, q, l) - held).T
    return np.concatenate([value, off], axis=1), np.concatenate([slope, rows], axis=1)


def moved(states: States, step: Array) -> States:
    """Return states after steps (n, 6 + k)."""
    q = np.stack(multiply(tuple(states.q), tuple(from_rotation_vector(step[:, :3]).T)))
    q /= np.sqrt((q * q).sum(0))
    return States(q, states.l + step[:, 3:6].T, states.c + step[:, 6:].T)


def solve(system: System, states: States, held: Array) -> tuple[States, Array]:
    """Return (states after Newton's method, their largest residuals (n,) in scaled units).

    held : (h, 1) the momenta, see `held_momenta`
    """
    value, slope = residual(system, states, held)
    size, damping = (value**2).sum(1), np.ones(len(value))
    for _ in range(MOST):
        open_ = np.flatnonzero(size > SMALLEST)
        if not len(open_):
            break
        tried = moved(states.at(open_), _step(value[open_], slope[open_], damping[open_]))
        next_value, next_slope = residual(system, tried, held)
        next_size = (next_value**2).sum(1)
        better = next_size < size[open_]
        # The factors hardly matter: 256 starts of heavy_top take 12 to 13 steps each with 0.1 to
        # 0.5 and 2 to 10.
        damping[open_] = np.clip(damping[open_] * np.where(better, 0.2, 8.0), 1e-12, 1e12)
        ahead = open_[better]
        states = states.with_at(ahead, tried.at(better))
        value[ahead], slope[ahead] = next_value[better], next_slope[better]
        size[ahead] = next_size[better]
    return states, np.abs(value).max(axis=1)


def newton_steps(system: System, states: States) -> Array:
    """Return the next steps (n, 6 + k) from steady motions, at their own momenta: their errors."""
    held = held_momenta(system, states.q, states.l)
    value, slope = residual(system, states, held)
    return _step(value, slope, np.zeros(len(value)))


def _step(value: Array, slope: Array, damping: Array) -> Array:
    """Return the steps (n, 6 + k) that reduce residuals (n, r) with slopes (n, r, 6 + k)."""
    left, scales, right = np.linalg.svd(slope, full_matrices=False)
    scales = np.where(scales > FLAT * scales[:, :1], scales, 0.0)
    # below 1e-24 the square of a singular value that counts vanishes beside it
    over = scales**2 + (np.maximum(damping * (value**2).sum(1), 1e-24))[:, None]
    along = (scales / over) * np.einsum("nri,nr->ni", left, value)
    step = -np.einsum("nij,ni->nj", right, along)
    angle = np.sqrt((step[:, :3] ** 2).sum(1))
    # 1e-300 rad only avoids 0/0 for a step that does not turn
    return np.asarray(step * np.minimum(1.0, LONGEST / np.maximum(angle, 1e-300))[:, None])


def with_frames(system: System, q: Array, l: Array) -> States:
    """Return states with the c whose turning is nearest to their angular velocity."""
    w = rates_of(system.mechanics, q, l).value[:, :3]
    states = States(q, l, np.zeros((len(system.generators), q.shape[1])))
    turn, m = frames(system, states)
    up = system.generators[:, :3] @ space_to_body(q).swapaxes(1, 2) + system.generators[:, 3:]
    c = np.einsum("nki,ni->nk", np.linalg.pinv(up.swapaxes(1, 2)), w - turn - m)
    return states._replace(c=c.T)


def standing(system: System, state: States) -> Array:
    """Return the combinations (s, k) of generators that leave a single state as it is."""
    rows = orbit_rows(state.q, state.l, system.generators)
    return null_space(rows.T, ALIKE)


def seen_from_body(system: System, states: States) -> States:
    """Return states with the c whose turning in the body is least.

    They have a choice where a turn in space and one in the body do the same, as for an upright top.
    """
    turned, bodily = states.c.copy(), system.generators[:, 3:]
    for i in range(states.q.shape[1]):
        same = standing(system, states.at(i))
        m = system.frame[3:] + bodily.T @ turned[:, i]
        turned[:, i] -= np.linalg.pinv(same @ bodily, rcond=ALIKE).T @ m @ same
    return states._replace(c=turned)


def signatures(system: System, states: States) -> Array:
    """Return numbers (n, s) that are equal for states that symmetries carry into each other, and
    differ for others: components in the body of l and of the directions that are fixed in space."""
    spatial, bodily = (subalgebra(system.generators, part) for part in (slice(3, 6), slice(0, 3)))
    into = space_to_body(states.q)
    vectors = [states.l.T + system.mechanics.wheel]
    if len(spatial) == 1:
        vectors.append(into @ spatial[0, :3])
    elif not len(spatial):
        vectors += list(np.moveaxis(into, 2, 0))
    seen = np.stack(vectors, axis=1)
    if not len(bodily):
        return seen.reshape(len(seen), -1)
    products = (seen @ seen.swapaxes(1, 2)).reshape(len(seen), -1)
    if len(bodily) > 1:
        return products
    return np.concatenate([seen @ bodily[0, 3:], products], axis=1)


def search_starts(system: System, q: Array, l: Array, count: int) -> States:
    """Return `count` states to search from, or as many as the first two kinds are.

    The start (q, l) is first. Then come 24 attitudes, with the principal axes both ways along the
    axis of the start's motion and along the axes of space, and then Sobol points on all attitudes.
    These have the momentum of the start in space, if its size is constant, and else turn as the
    start does, at the rates that give them its momenta. Of one state asked for, only the start is
    returned.
    """
    first = with_frames(system, q[:, None], l[:, None])
    if count == 1:
        return first
    axis = (system.frame + first.c[:, 0] @ system.generators)[:3]
    total = space_to_body(first.q)[0].T @ (l + system.mechanics.wheel)
    others = aligned_attitudes(total if system.conserves_size else axis)
    numbers = points(0, "sobol", tuple((STREAM, 0, i) for i in range(3)))
    u, v, w, _ = numbers.words(STREAM, 0, max(0, count - 1 - others.shape[1]), 0, range(3))
    others = np.concatenate([others, uniform_attitudes(u, v, w)], axis=1)
    if system.conserves_size:
        momenta = (space_to_body(others) @ total).T - system.mechanics.wheel[:, None]
    else:
        momenta = _turning_momenta(system, first, others)
    both = np.concatenate([q[:, None], others], 1), np.concatenate([l[:, None], momenta], 1)
    return with_frames(system, *both)


def aligned_attitudes(axis: Array) -> Array:
    """Return the 24 attitudes (4, 24) whose principal axes are along three axes of space: a given
    one, or z if it is 0, and the one nearest to x."""
    size = float(np.sqrt(axis @ axis))
    up = axis / size if size > 0.0 else np.array([0.0, 0.0, 1.0])
    east = np.eye(3)[0] - up[0] * up
    if abs(up[0]) > 0.9:  # x is nearly along the axis
        east = np.eye(3)[1] - up[1] * up
    east /= np.sqrt(east @ east)
    base = quaternion_from_matrix(np.stack([east, np.cross(up, east), up], axis=1))
    cube = [
        np.eye(3)[list(order)] * np.array(signs)
        for order in permutations(range(3))
        for signs in product((1.0, -1.0), repeat=3)
    ]
    turns = quaternion_from_matrix(np.array([a for a in cube if np.linalg.det(a) > 0.0]))
    return np.array(multiply(tuple(np.asarray(base)[:, None]), tuple(np.asarray(turns).T)))


def _turning_momenta(system: System, state: States, q: Array) -> Array:
    """Return the momenta (3, n) of bodies at attitudes q that turn as one state does, with the
    central momenta of that state."""
    turning = States(q, np.zeros((3, q.shape[1])), np.repeat(state.c, q.shape[1], axis=1))
    turn, m = frames(system, turning)
    moments = 1.0 / (system.mechanics.moment * np.array(system.mechanics.body[:3])[:, 0])
    w, central = turn + m, system.central
    ways = central[:, :3] @ space_to_body(q).swapaxes(1, 2) + central[:, 3:]
    off = held_momenta(system, state.q, state.l).T
    off = off - ((moments * w + system.mechanics.wheel)[:, None] * ways).sum(2)
    inertia = (moments * ways) @ ways.swapaxes(1, 2)
    w = w + np.einsum("nd,ndi->ni", np.einsum("nij,nj->ni", np.linalg.pinv(inertia), off), ways)
    return np.asarray((moments * w).T)
