"""Steady motions of a scene: Newton's method for relative equilibria, from many starts at once.

A steady motion follows the symmetries of the scene, see `rigidmc.studies.linearise.symmetries`.
With c_i along the generators (n_i, m_i) and (n, m) = frame + sum c_i (n_i, m_i)::

    w(q, l) = A^T n + m,   f(q, l) = l x m,   momenta = momenta of the start

It is an equilibrium in the frame that turns with n in space, seen from axes that turn with m in the
body: m is 0 except for bodies that are symmetric about an axis. The unknowns are q, l and c. They
may be more than the equations determine, as the direction of a tilt is; steps are the shortest that
solve the linear equations (Levenberg-Marquardt with a damping that vanishes as the square of the
residual, so the convergence is quadratic). Source: Yamashita & Fukushima, Computing Suppl. 15
(2001) 239.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigidmc.engine.streams import uniforms
from rigidmc.mechanics.rotation import from_rotation_vector
from rigidmc.physics.dynamics.so3 import multiply
from rigidmc.scene.vector_distributions.vectors import uniform_attitudes
from rigidmc.studies.linearise.rates import Mechanics, rates_of
from rigidmc.studies.linearise.symmetries import (
    Symmetries,
    cross_matrix,
    null_space,
    orbit_rows,
    space_to_body,
    subalgebra,
)

Array = NDArray[np.float64]
MOST = 60  # steps; 99 of 100 starts need at most 25
SOLVED = 1e-12  # largest residual of a solution, in scaled units; rounding leaves 1e-14
FLAT = 1e-12  # singular values below this fraction of the largest are rounding
ALIKE = 1e-6  # of directions that are one up to the error of a double root
LONGEST = 0.7  # rad of a step: longer ones jump between solutions


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


def frames(found: Symmetries, states: States) -> tuple[Array, Array]:
    """Return (A^T n, m), (n, 3) each: the turning in space and in the body, in body axes."""
    moving = found.frame + states.c.T @ found.generators
    return np.einsum("nij,nj->ni", space_to_body(states.q), moving[:, :3]), moving[:, 3:]


def held_momenta(known: Mechanics, found: Symmetries, q: Array, l: Array) -> Array:
    """Return the momenta (h, n) of states that a search holds: of each central generator, and half
    the square of the whole, if this is constant."""
    whole = l.T + known.wheel
    up = found.central[:, :3] @ space_to_body(q).swapaxes(1, 2)
    momenta = ((up + found.central[:, 3:]) * whole[:, None]).sum(2)
    if found.conserves_size:
        momenta = np.concatenate([momenta, 0.5 * (whole**2).sum(1, keepdims=True)], axis=1)
    return np.asarray(momenta.T)


def residual(
    known: Mechanics, found: Symmetries, states: States, held: Array
) -> tuple[Array, Array]:
    """Return (residuals (n, r), their derivatives (n, r, 6 + k) by x, l and c)."""
    q, l, _ = states
    rates, (turn, m) = rates_of(known, q, l), frames(found, states)
    into, k = space_to_body(q), len(found.generators)
    up = found.generators[:, :3] @ into.swapaxes(1, 2)
    value = rates.value.copy()
    value[:, :3] -= turn + m
    value[:, 3:] -= np.cross(l.T, m)
    slope = np.zeros((q.shape[1], 6, 6 + k))
    slope[:, :, :6] = rates.slope[:, :, :6]
    slope[:, :3, :3] -= cross_matrix(turn)  # a vector fixed in space changes by u x x in the body
    slope[:, 3:, 3:6] += cross_matrix(m)
    slope[:, :3, 6:] = -(up + found.generators[:, 3:]).swapaxes(1, 2)
    slope[:, 3:, 6:] = -np.cross(l.T[:, None], found.generators[:, 3:]).swapaxes(1, 2)
    whole, central = l.T + known.wheel, found.central
    up = central[:, :3] @ into.swapaxes(1, 2)
    rows = np.zeros((q.shape[1], len(held), 6 + k))
    rows[:, : len(central), :3] = np.cross(whole[:, None], up)
    rows[:, : len(central), 3:6] = up + central[:, 3:]
    if found.conserves_size:
        rows[:, -1, 3:6] = whole
    off = (held_momenta(known, found, q, l) - held).T
    return np.concatenate([value, off], axis=1), np.concatenate([slope, rows], axis=1)


def moved(states: States, step: Array) -> States:
    """Return states after steps (n, 6 + k)."""
    q = np.stack(multiply(tuple(states.q), tuple(from_rotation_vector(step[:, :3]).T)))
    q /= np.sqrt((q * q).sum(0))
    return States(q, states.l + step[:, 3:6].T, states.c + step[:, 6:].T)


def solve(known: Mechanics, found: Symmetries, states: States, held: Array) -> tuple[States, Array]:
    """Return (states after Newton's method, their largest residuals (n,) in scaled units).

    held : (h, 1) the momenta, see `held_momenta`
    """
    value, slope = residual(known, found, states, held)
    size, damping = (value**2).sum(1), np.ones(len(value))
    for _ in range(MOST):
        if (size < 1e-30).all():  # residuals are in units of the scene's own rates
            break
        left, scales, right = np.linalg.svd(slope, full_matrices=False)
        scales = np.where(scales > FLAT * scales[:, :1], scales, 0.0)
        # below 1e-24 the square of a singular value that counts vanishes beside it
        over = scales**2 + (np.maximum(damping * size, 1e-24))[:, None]
        along = (scales / over) * np.einsum("nri,nr->ni", left, value)
        step = -np.einsum("nij,ni->nj", right, along)
        angle = np.sqrt((step[:, :3] ** 2).sum(1))
        # angles are pure numbers
        step *= np.minimum(1.0, LONGEST / np.maximum(angle, 1e-300))[:, None]
        tried = moved(states, step)
        next_value, next_slope = residual(known, found, tried, held)
        next_size = (next_value**2).sum(1)
        better = next_size < size
        damping = np.clip(np.where(better, 0.2 * damping, 8.0 * damping), 1e-12, 1e12)
        states = States(*(np.where(better, a, b) for a, b in zip(tried, states, strict=True)))
        value = np.where(better[:, None], next_value, value)
        slope = np.where(better[:, None, None], next_slope, slope)
        size = np.where(better, next_size, size)
    return states, np.abs(value).max(axis=1)


def with_frames(known: Mechanics, found: Symmetries, q: Array, l: Array) -> States:
    """Return states with the c whose turning is nearest to their angular velocity."""
    w = rates_of(known, q, l).value[:, :3]
    states = States(q, l, np.zeros((len(found.generators), q.shape[1])))
    turn, m = frames(found, states)
    up = found.generators[:, :3] @ space_to_body(q).swapaxes(1, 2) + found.generators[:, 3:]
    c = np.einsum("nki,ni->nk", np.linalg.pinv(up.swapaxes(1, 2)), w - turn - m)
    return states._replace(c=c.T)


def standing(found: Symmetries, state: States) -> Array:
    """Return the combinations (s, k) of generators that leave a single state as it is."""
    rows = orbit_rows(state.q, state.l, found.generators)
    return null_space(rows.T, ALIKE)


def seen_from_body(found: Symmetries, states: States) -> States:
    """Return states with the c whose turning in the body is least.

    They have a choice where a turn in space and one in the body do the same, as for an upright top.
    """
    turned, bodily = states.c.copy(), found.generators[:, 3:]
    for i in range(states.q.shape[1]):
        same = standing(found, states.at(i))
        m = found.frame[3:] + bodily.T @ turned[:, i]
        turned[:, i] -= np.linalg.pinv(same @ bodily, rcond=ALIKE).T @ m @ same
    return states._replace(c=turned)


def signatures(known: Mechanics, found: Symmetries, states: States) -> Array:
    """Return numbers (n, s) that are equal for states that symmetries carry into each other, and
    differ for others: components in the body of l and of the directions that are fixed in space."""
    spatial, bodily = (subalgebra(found.generators, part) for part in (slice(3, 6), slice(0, 3)))
    into = space_to_body(states.q)
    vectors = [states.l.T + known.wheel]
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


def search_starts(known: Mechanics, found: Symmetries, q: Array, l: Array, count: int) -> States:
    """Return `count` states to search from: the start (q, l) first, then random attitudes with
    the turning of the start, and its |l| if this is constant."""
    own = with_frames(known, found, q[:, None], l[:, None])
    if count == 1:
        return own
    u, v, w, _ = uniforms(0, "linearise.starts", 0, count - 1, 0)
    others = uniform_attitudes(u, v, w)
    turning = States(others, np.zeros((3, count - 1)), np.repeat(own.c, count - 1, axis=1))
    turn, m = frames(found, turning)
    momenta = ((turn + m) / (known.moment * np.array(known.body[:3])[:, 0])).T
    if found.conserves_size:
        momenta = momenta + known.wheel[:, None]
        size = np.sqrt(((l + known.wheel) ** 2).sum()), np.sqrt((momenta**2).sum(0))
        # momenta are in units of the scene's own scale
        momenta = momenta * (size[0] / np.maximum(size[1], 1e-300)) - known.wheel[:, None]
    both = np.concatenate([q[:, None], others], 1), np.concatenate([l[:, None], momenta], 1)
    return with_frames(known, found, *both)
