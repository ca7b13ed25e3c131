"""What differs by rounding alone: one rule for all studies, which compare members with each other.

Numbers of a precision have the resolution eps, the distance from 1 to the next of them, times their
size; a sum over many steps loses some eps times the root of their number.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from rigidmc.scene.scene import Scene

ULPS = 32.0  # resolutions by which numbers that should be the same may differ


def resolution(dtype: DTypeLike, steps: float = 1.0) -> float:
    """The relative resolution of numbers of a precision after `steps` steps."""
    return float(np.finfo(dtype).eps) * math.sqrt(max(1.0, steps))


def resolution_of(scene: Scene) -> float:
    """The relative resolution of what members of a scene show at the end."""
    run = scene.run
    return resolution(run.dtype, 1.0 if run.turn else run.t_end / run.dt)


def is_constant(
    values: ArrayLike, axis: int | None = -1, resolved: float | None = None
) -> NDArray[np.bool_]:
    """Whether numbers along an axis are all the same to rounding; those that are not finite are
    left out, and fewer than two are the same.

    A mean of a constant is not the constant to the bit, so that rounding decides a variance, a
    correlation and an index of differences from it.

    resolved : the relative resolution of the numbers; by default that of their precision
    """
    x: NDArray[Any] = np.asarray(values)
    if not np.issubdtype(x.dtype, np.floating):
        x = x.astype(float)
    there, eps = np.isfinite(x), resolution(x.dtype) if resolved is None else resolved
    high = np.max(x, axis=axis, where=there, initial=-np.inf)
    low = np.min(x, axis=axis, where=there, initial=np.inf)
    with np.errstate(invalid="ignore"):
        # by halves: the range of the largest numbers is none
        apart, size = 0.5 * high - 0.5 * low, np.maximum(np.abs(high), np.abs(low))
        return np.asarray(~(apart > 0.5 * ULPS * eps * size))
