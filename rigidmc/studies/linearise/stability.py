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
from scipy.optimize import minimize_scalar

from rigidmc.inputs.arrays import Array
from rigidmc.studies.linearise.steady import ALIKE, States, frames, moved, newton_steps, standing
from rigidmc.studies.linearise.system import (
    System,
    cross_matrix,
    momentum_rows,
    null_space,
    orbit_rows,
    rates_of,
    space_to_body,
)

Complex = NDArray[np.complex128]
MOTION, MOMENTUM, SYMMETRY = ("motion", "momentum", "symmetry")
# what an eigenvalue off the imaginary axis says of the full motion
FULL_MOTION = {
    "saddle": "unstable", "unstable spiral": "unstable",
    "stable spiral": "stable", "stable node": "stable",
}  # fmt: skip
DOUBLE = 1e-7  # error of a double eigenvalue: the root of rounding, relative to J


class Linearised(NamedTuple):
    """The linearised motion about one steady motion, in scaled units.

    values : (6,) eigenvalues, of the motion first, fastest growth first
    vectors : (6, 6) their eigenvectors as columns, of length 1
    origins : (6,) "motion", "momentum" or "symmetry"
    errors : (6,) of the eigenvalues, by rounding and by the error of the state
    stability : see `stability_of`
    full_motion : "stable", "unstable" or "unknown", not only of the linear motion
    """

    values: Complex
    vectors: Complex
    origins: tuple[str, ...]
    errors: Array
    stability: str
    full_motion: str


def jacobians(system: System, states: States) -> Array:
    """Return J (n, 6, 6) of steady motions."""
    rates, (turn, m) = rates_of(system.mechanics, states.q, states.l), frames(system, states)
    matrices = rates.slope[:, :, :6].copy()
    matrices[:, :3, :3] -= cross_matrix(turn)
    matrices[:, 3:, 3:] += cross_matrix(m)
    return matrices


def linearise_motions(system: System, states: States) -> list[Linearised]:
    """Return the Linearised motion about each steady motion.

    J is also taken four Newton steps before and behind each state, since Newton's method halves the
    distance to a double root, such as rest under quadratic drag: the root is one more step away.
    """
    count = states.q.shape[1]
    if not count:
        return []
    step = 4.0 * newton_steps(system, states)
    near = [moved(states, step), states, moved(states, -step)]
    rows = States(*(np.concatenate(parts, axis=1) for parts in zip(*near, strict=True)))
    below, j, above = jacobians(system, rows).reshape(3, count, 6, 6)
    blur = np.maximum(np.abs(below - j), np.abs(above - j)).max(axis=(1, 2))
    return [_linearise(system, states.at(i), j[i], float(blur[i])) for i in range(count)]


def _linearise(system: System, state: States, j: Array, blur: float) -> Linearised:
    """Return the Linearised motion with the matrix J, which has an error."""
    q, l = state.q, state.l
    turned = orbit_rows(q, l, system.generators)
    rows = momentum_rows(system.mechanics, q, l, system.conserved)
    if system.conserves_size:
        rows = np.concatenate([rows, [np.r_[np.zeros(3), l + system.mechanics.wheel]]])
    along = _span(turned)
    held = _span(null_space((rows @ along.T).T, ALIKE) @ rows if len(along) else rows)
    rest = null_space(np.concatenate([along, held, np.zeros((1, 6))]), 0.5)
    parts = [along, rest, held]
    blocks = [[a @ j @ b.T for b in parts] for a in parts]
    size = max(1.0, float(np.abs(j).max()))
    values, vectors, errors = list[complex](), list[Complex](), list[float]()
    for k in (1, 2, 0):
        block_values, left, right = eig(blocks[k][k], left=True) if len(parts[k]) else _NOTHING
        order = np.lexsort((-block_values.imag, -np.round(block_values.real, 9)))
        for i in order:
            cosine = abs(np.vdot(left[:, i], right[:, i]))
            # 1e-300 stands for a cosine of 0, of a double eigenvalue, whose error is DOUBLE
            rounding = min(DOUBLE, 1e3 * np.finfo(float).eps / max(cosine, 1e-300))
            errors.append(size * rounding + blur)
            values.append(complex(block_values[i]))
            vectors.append(_eigenvector(block_values[i], right[:, i], k, parts, blocks))
    origins = (MOTION,) * len(rest) + (MOMENTUM,) * len(held) + (SYMMETRY,) * len(along)
    all_errors, count = np.array(errors), len(rest)
    word = stability_of(np.array(values[:count]), all_errors[:count], system.is_hamiltonian)
    verdict = FULL_MOTION.get(word, "unknown")
    if word in ("elliptic", "undecided") and system.is_hamiltonian:
        verdict = "stable" if has_energy_extreme(system, state, j) else verdict
    return Linearised(np.array(values), np.array(vectors).T, origins, all_errors, word, verdict)


def has_energy_extreme(system: System, state: States, j: Array) -> bool:
    """Return whether the energy in the turning frame has a strict extreme at a steady motion, among
    the states with its momenta: then small changes stay small for ever, not only linearly.

    J = P S with the second derivatives S of this energy and the brackets P of x and l. Where a turn
    in space and one in the body do the same, as for a sleeping top, one choice of the frame is
    enough. Source: Marsden, Lectures on Mechanics (1992), 5 (the energy-momentum method).
    """
    q, l = state.q, state.l
    rows = momentum_rows(system.mechanics, q, l, system.conserved)
    level = null_space(np.concatenate([rows, np.zeros((1, 6))]), ALIKE)
    turned = orbit_rows(q, l, system.generators)
    inside = null_space((turned @ rows.T).T, ALIKE) @ turned if len(turned) else turned
    across = null_space(
        _span(inside) @ level.T if len(inside) else np.zeros((1, len(level))), ALIKE
    )
    basis, of_momentum = across @ level, cross_matrix(l + system.mechanics.wheel)

    def form(matrix: Array) -> Array:
        second = np.concatenate([of_momentum @ matrix[:3] - matrix[3:], matrix[:3]])
        return np.asarray(basis @ second @ basis.T)

    still = standing(system, state)
    first, tilt = form(j), np.zeros((len(basis), len(basis)))
    if len(still) == 1:
        n, m = (still @ system.generators)[0, :3], (still @ system.generators)[0, 3:]
        other = np.zeros((6, 6))
        other[:3, :3] = -cross_matrix(space_to_body(q[:, None])[0] @ n)
        other[3:, 3:] = cross_matrix(m)
        tilt = form(other)
    return any(_largest_least(sign * first, sign * tilt) > DOUBLE for sign in (1.0, -1.0))


def _largest_least(first: Array, tilt: Array) -> float:
    """Return the largest, over s, of the least eigenvalue of first + s tilt, which is concave."""

    def least(s: float) -> float:
        return float(np.linalg.eigvalsh(first + s * tilt)[0])

    size = float(np.abs(tilt).max(initial=0.0))
    if size < ALIKE:  # the frame has no choice
        return least(0.0)
    reach = 10.0 * float(np.abs(first).max()) / size
    best = minimize_scalar(lambda s: -least(s), bounds=(-reach, reach), method="bounded")
    return -float(best.fun)


_NOTHING = np.zeros(0, complex), np.zeros((0, 0)), np.zeros((0, 0))


def _span(rows: Array) -> Array:
    """Return orthonormal rows that span some rows."""
    if not len(rows):
        return np.zeros((0, 6))
    size = np.sqrt((rows * rows).sum(1, keepdims=True))
    _, values, span = np.linalg.svd(rows / np.maximum(size, ALIKE))
    return np.asarray(span[: int((values > ALIKE).sum())])


def _eigenvector(
    value: complex, part: Any, k: int, parts: list[Array], blocks: list[list[Array]]
) -> Complex:
    """Return the eigenvector (6,) of J for one of a diagonal block; J is triangular by blocks.

    For a momentum that comes with a drift along a symmetry it is the change that drifts.
    """
    pieces = {k: part.astype(complex)}
    for above in range(k - 1, -1, -1):
        pushed = sum(blocks[above][j] @ piece for j, piece in pieces.items())
        shifted = value * np.eye(len(parts[above])) - blocks[above][above]
        pieces[above] = np.linalg.lstsq(shifted, pushed, rcond=1e-9)[0]
    vector = sum(parts[j].T @ piece for j, piece in pieces.items())
    return np.asarray(vector / np.linalg.norm(vector))


def stability_of(values: Complex, errors: Array, is_hamiltonian: bool) -> str:
    """Return what the eigenvalues of a motion mean.

    saddle, unstable spiral : a change grows, without or with oscillation
    stable node, stable spiral : all changes decay, none or some with oscillation
    elliptic : changes of an undamped motion oscillate; the linear motion is stable
    undecided : none grows, but not all decay: one is 0 or double, or a damped scene has one that
        neither grows nor decays, so the linear motion does not decide
    neutral : there is nothing but symmetries and momenta, as for a sphere
    """
    if not len(values):
        return "neutral"
    grows, decays = values.real > errors, values.real < -errors
    turns, zero = np.abs(values.imag) > errors, np.abs(values) <= errors
    if grows.any():
        return "saddle" if (grows & ~turns).any() else "unstable spiral"
    if decays.all():
        return "stable spiral" if turns.any() else "stable node"
    apart = np.abs(values[:, None] - values) + np.diag(np.full(len(values), np.inf))
    double = (apart.min(axis=1, initial=np.inf) < 2.0 * DOUBLE) & (errors > 0.9 * DOUBLE)
    if zero.any() or double.any() or not is_hamiltonian:
        return "undecided"
    return "elliptic"
