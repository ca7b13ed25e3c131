"""Arguments of the closed forms: leading shapes broadcast, components go first."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rigidmc.arrays import floats
from rigidmc.errors import SceneError

Shape = tuple[int, ...]


def aligned(*arguments: tuple[str, ArrayLike, int]) -> tuple[Shape, list[NDArray[np.float64]]]:
    """(leading shape, arrays (components, n)) of the values of some arguments.

    arguments : (name, value (..., components), number of components) each

    0 components: the value is a number (...), its array (1, n). SceneError for values that are no
    numbers, have another number of components, or do not broadcast.
    """
    arrays = []
    for name, value, size in arguments:
        array = floats(value, name, size)
        arrays.append(array if size else array[..., None])
    try:
        shape = np.broadcast_shapes(*(a.shape[:-1] for a in arrays))
    except ValueError:
        shapes = ", ".join(
            f"{name} {a.shape[:-1]}" for (name, _, _), a in zip(arguments, arrays, strict=True)
        )
        rule = (
            f"leading shapes do not broadcast: {shapes}; "
            "give an axis of length 1 where they differ, e.g. (bodies, 1) and (times,)"
        )
        raise SceneError("", arguments[0][0], None, rule) from None
    return shape, [_components_first(a, shape) for a in arrays]


def _components_first(array: NDArray[np.float64], shape: Shape) -> NDArray[np.float64]:
    """(components, n) of an array (..., components) broadcast to a leading shape."""
    whole = np.moveaxis(np.broadcast_to(array, shape + array.shape[-1:]), -1, 0)
    return whole.reshape(array.shape[-1], -1).copy()


def spread(
    shape: Shape, t: NDArray[np.float64]
) -> tuple[Shape, NDArray[np.int64], NDArray[np.float64]]:
    """(shape, row, time): each body of a table at each time.

    shape : leading shape of the bodies, in whose order the rows of the table are;  t : times (...)

    Returns the shape to which both broadcast, and the row of the table and the time of each
    element.
    """
    try:
        whole = np.broadcast_shapes(shape, t.shape)
    except ValueError:
        rule = (
            f"times {t.shape} do not broadcast against bodies {shape}; give an axis of length 1, "
            "e.g. bodies (n, 1) and times (m,)"
        )
        raise SceneError("", "t", None, rule) from None
    rows: NDArray[Any] = np.arange(int(np.prod(shape, dtype=int))).reshape(shape)
    return whole, np.broadcast_to(rows, whole).reshape(-1), np.broadcast_to(t, whole).reshape(-1)
