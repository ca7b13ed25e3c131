"""Rates of the principal moments and axes of a tensor that changes."""

import numpy as np

from rigidmc.inputs.arrays import Array


def axes_rates(moments: Array, axes: Array, change: Array) -> tuple[Array, Array]:
    """Return the rates of the moments (..., 3) and axes (..., 3, 3) of a tensor that changes at the
    symmetric rate `change` (..., 3, 3).

    With C = B^T (dI) B in the principal axes:

        dI_i = C_ii,   dB = B W,   W_ij = C_ij/(I_j - I_i) for i != j

    Axes with equal moments (to 1e-12 of the largest) have no rate, nan, unless C does not couple
    them: then W_ij = 0. Rounding grows by the factor I_k/(I_j - I_i), I_k the largest moment
    (tests/planning/test_dual_arrays.py).
    """
    inside = _product(np.swapaxes(axes, -1, -2), _product(change, axes))
    gap = moments[..., None, :] - moments[..., :, None]
    size, coupling = np.abs(moments).max(-1)[..., None, None], np.abs(inside)
    equal = np.abs(gap) <= 1e-12 * size
    # 4e-15: as `principal_axes` takes off-diagonal elements for rounding
    free = coupling <= 4e-15 * np.abs(change).max((-1, -2))[..., None, None]
    turn = np.where(equal, np.where(free, 0.0, np.nan), inside / np.where(equal, 1.0, gap))
    turn = np.where(np.eye(3) == 1.0, 0.0, turn)
    return np.diagonal(inside, axis1=-2, axis2=-1), _product(axes, turn)


def _product(a: Array, b: Array) -> Array:
    """Return matrix products (..., 3, 3), element by element."""
    product: Array = sum(a[..., :, k, None] * b[..., None, k, :] for k in range(3))  # type: ignore[assignment]
    return product
