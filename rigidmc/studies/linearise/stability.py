"""Stability of a steady motion: eigenvalues of the linearised motion, told apart by their origin.

The change of a state is y = (x, dl), six numbers: a rotation vector in body axes and a change of
momentum. In the axes of `rigidmc.studies.linearise.steady`, with u = A^T n::

    dx/dt = x x u + dw,   d(dl)/dt = df + m x dl,   dy/dt = J y

Symmetries span a space S of changes that J takes into itself. Conserved momenta that no symmetry
changes are rows D with D J = 0. Both add eigenvalues that say nothing of stability; the others are
eigenvalues of J on the changes that D takes to 0, modulo S. Source: Marsden, Lectures on Mechanics
(1992), 5; Meyer, Hall & Offin, Introduction to Hamiltonian Dynamical Systems (2009).
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eig

from rigidmc.studies.linearise.rates import Mechanics, rates_of
from rigidmc.studies.linearise.steady import ALIKE, States, frames
from rigidmc.studies.linearise.symmetries import (
    Symmetries,
    cross_matrix,
    momentum_rows,
    null_space,
    orbit_rows,
)

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
MOTION, MOMENTUM, SYMMETRY = ORIGINS = ("motion", "momentum", "symmetry")
DOUBLE = 1e-7  # error of a double eigenvalue: the root of rounding, relative to J


class Linearised(NamedTuple):
    """The linearised motion about one steady motion, in scaled units.

    values : (6,) eigenvalues, of the motion first, fastest growth first
    vectors : (6, 6) their eigenvectors as columns, of length 1
    origins : (6,) "motion", "momentum" or "symmetry"
    errors : (6,) of the eigenvalues, by rounding
    stability : see `stability_of`
    """

    values: Complex
    vectors: Complex
    origins: tuple[str, ...]
    errors: Array
    stability: str


def jacobian(known: Mechanics, found: Symmetries, state: States) -> Array:
    """Return J (6, 6) of one steady motion."""
    rates, (turn, m) = rates_of(known, state.q, state.l), frames(found, state)
    matrix = rates.slope[0, :, :6].copy()
    matrix[:3, :3] -= cross_matrix(turn[0])
    matrix[3:, 3:] += cross_matrix(m[0])
    return matrix


def linearise_motion(known: Mechanics, found: Symmetries, state: States) -> Linearised:
    """Return the Linearised motion about one steady motion."""
    j, q, l = jacobian(known, found, state), state.q[:, 0], state.l[:, 0]
    moved = orbit_rows(q, l, found.generators)
    rows = momentum_rows(known, q, l, found.conserved)
    if found.conserves_size:
        rows = np.concatenate([rows, [np.r_[np.zeros(3), l + known.wheel]]])
    along = _span(moved)
    held = _span(null_space((rows @ along.T).T, ALIKE) @ rows if len(along) else rows)
    rest = null_space(np.concatenate([along, held, np.zeros((1, 6))]), 0.5)
    parts = [along, rest, held]
    blocks = [[a @ j @ b.T for b in parts] for a in parts]
    size = max(1.0, float(np.abs(j).max()))
    values, vectors, errors = list[complex](), list[Complex](), list[float]()
    for k in (1, 2, 0):
        found_values, left, right = eig(blocks[k][k], left=True) if len(parts[k]) else _NOTHING
        order = np.lexsort((-found_values.imag, -np.round(found_values.real, 9)))
        for i in order:
            cosine = abs(np.vdot(left[:, i], right[:, i]))
            # a cosine is a pure number
            errors.append(size * min(DOUBLE, 1e3 * np.finfo(float).eps / max(cosine, 1e-300)))
            values.append(complex(found_values[i]))
            vectors.append(_whole(found_values[i], right[:, i], k, parts, blocks))
    origins = (MOTION,) * len(rest) + (MOMENTUM,) * len(held) + (SYMMETRY,) * len(along)
    known_errors, count = np.array(errors), len(rest)
    word = stability_of(np.array(values[:count]), known_errors[:count])
    return Linearised(np.array(values), np.array(vectors).T, origins, known_errors, word)


_NOTHING = np.zeros(0, complex), np.zeros((0, 0)), np.zeros((0, 0))


def _span(rows: Array) -> Array:
    """Return orthonormal rows that span some rows."""
    if not len(rows):
        return np.zeros((0, 6))
    size = np.sqrt((rows * rows).sum(1, keepdims=True))
    _, values, span = np.linalg.svd(rows / np.maximum(size, ALIKE))
    return np.asarray(span[: int((values > ALIKE).sum())])


def _whole(
    value: complex, part: Any, k: int, parts: list[Array], blocks: list[list[Array]]
) -> Complex:
    """Return the eigenvector (6,) of J for one of a diagonal block; J is triangular by blocks.

    For a momentum that comes with a drift along a symmetry it is the change that drifts.
    """
    pieces = {k: part.astype(complex)}
    for above in range(k - 1, -1, -1):
        pushed = sum(blocks[above][j] @ piece for j, piece in pieces.items())
        own = value * np.eye(len(parts[above])) - blocks[above][above]
        pieces[above] = np.linalg.lstsq(own, pushed, rcond=1e-9)[0]
    vector = sum(parts[j].T @ piece for j, piece in pieces.items())
    return np.asarray(vector / np.linalg.norm(vector))


def stability_of(values: Complex, errors: Array) -> str:
    """Return what the eigenvalues of a motion mean.

    saddle, unstable spiral : a change grows, without or with oscillation
    stable node, stable spiral : all changes decay, none or some with oscillation
    centre : changes oscillate, and none grows
    degenerate : none grows, but one is 0 or double: the linear motion does not decide
    neutral : there is nothing but symmetries and momenta, as for a sphere
    """
    if not len(values):
        return "neutral"
    grows, decays = values.real > errors, values.real < -errors
    turns, zero = np.abs(values.imag) > errors, np.abs(values) <= errors
    if grows.any():
        return "saddle" if (grows & ~turns).any() else "unstable spiral"
    apart = np.abs(values[:, None] - values) + np.diag(np.full(len(values), np.inf))
    double = (apart.min(axis=1, initial=np.inf) < 2.0 * DOUBLE) & (errors > 0.9 * DOUBLE)
    if zero.any() or double.any():
        return "degenerate"
    if decays.all():
        return "stable spiral" if turns.any() else "stable node"
    return "centre"
