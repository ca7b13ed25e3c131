"""The balance of angular momentum of measured rates: bodies without a fit, and without a motion.

Rates of a body obey, over any interval,

    I [omega] + integral of omega x I omega dt + k I integral of omega dt = integral of the torque

with a rate k of linear damping. Without a torque this is linear and homogeneous in the six numbers
of the tensor I in the axes of the sensor: the vector that leaves least is the body, up to a factor.
It needs no start and no motion, and so has no wrong minimum.
Source: Manchester & Peck, AIAA GNC (2016) 1366; Ljung, System Identification (1999), 7.3.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from rigidmc.studies.fit.streams import Array

WINDOWS = 6  # of a record: each balance averages the noise of a sixth of its samples
DAMPING = (0.0, 0.03, 0.1, 0.2, 0.4)  # rates tried, in units of 1/(length of a record)
TENSORS = np.zeros((6, 3, 3))  # of I11, I22, I33, I12, I13, I23
for _k, (_i, _j) in enumerate(((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))):
    TENSORS[_k, _i, _j] = TENSORS[_k, _j, _i] = 1.0


class Windows(NamedTuple):
    """Rates over intervals of records.

    change : of the rates (n, 3);  turn : integrals of omega dt (n, 3)
    products : integrals of omega_j omega_k dt (n, 3, 3);  length : of a record [s]
    """

    change: Array
    turn: Array
    products: Array
    length: float

    def torque(self, tensor: Array) -> Array:
        """Return the integrals of omega x I omega dt (n, 3)."""
        l = self.products @ tensor
        return l[:, [1, 2, 0], [2, 0, 1]] - l[:, [2, 0, 1], [1, 2, 0]]

    def residuals(self, tensor: Array, factor: float) -> Array:
        """Return what a body leaves of the changes of the rates (n, 3), if these are multiplied by
        a factor, with the linear damping that fits best."""
        left = self.change + factor * self.torque(tensor) @ np.linalg.inv(tensor)
        size = float(np.vdot(self.turn, self.turn))
        damping = max(0.0, -float(np.vdot(left, self.turn))) / size if size else 0.0
        return np.asarray(left + damping * self.turn)


def windows_of(records: Sequence[tuple[Array, Array]]) -> Windows | None:
    """Return the windows of records of (times, rates); None for too few readings."""
    parts, lengths = [], []
    for t, w in records:
        sound = np.isfinite(t) & np.isfinite(w).all(1)
        t, w = t[sound], w[sound]
        if (width := (t.size - 1) // WINDOWS) > 0:
            x = np.concatenate([w, (w[:, :, None] * w[:, None, :]).reshape(-1, 9)], axis=1)
            step = 0.5 * (x[1:] + x[:-1]) * np.diff(t)[:, None]
            sums = np.concatenate([w, np.vstack([np.zeros(12), np.cumsum(step, axis=0)])], axis=1)
            parts.append(sums[width:] - sums[:-width])
            lengths.append(t[-1] - t[0])
    if not parts:
        return None
    change, turn, products = np.split(np.concatenate(parts), [3, 6], axis=1)
    return Windows(change, turn, products.reshape(-1, 3, 3), float(np.median(lengths)))


def balance(windows: Windows, whole: bool, factors: Sequence[float] = (1.0,)) -> list[Array | None]:
    """Return the tensor, up to a factor, that balances angular momentum best, for each factor of
    the rates; None if it is not a body.

    whole : all six numbers, or the three of principal axes
    """
    tensors = TENSORS[: 6 if whole else 3]
    rows = [
        np.stack([of(x).ravel() for x in tensors], axis=1)
        for of in (lambda x: windows.change @ x, windows.torque, lambda x: windows.turn @ x)
    ]
    grams = np.array([[a.T @ b for b in rows] for a in rows])
    found = []
    for factor in factors:
        each = []
        for damping in DAMPING:
            by = np.array([1.0, factor, damping / windows.length])
            sizes, vectors = np.linalg.eigh(np.einsum("i,j,ijab->ab", by, by, grams))
            each.append((sizes[0], vectors[:, 0]))
        tensor = np.tensordot(min(each, key=lambda one: one[0])[1], tensors, 1)
        found.append(_nearest_body(tensor * np.sign(np.trace(tensor))))
    return found


def _nearest_body(tensor: Array) -> Array | None:
    """Return the nearest tensor of a body: noise may ask for a second moment below 0."""
    values, axes = np.linalg.eigh(0.5 * np.trace(tensor) * np.eye(3) - tensor)
    if values[-1] <= 0.0:
        return None
    second = (axes * np.maximum(values, 1e-2 * values[-1])) @ axes.T
    return np.asarray(np.trace(second) * np.eye(3) - second)
