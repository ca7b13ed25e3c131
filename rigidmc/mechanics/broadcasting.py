"""Arguments of the closed forms: leading shapes broadcast, components go first."""

import numpy as np

from rigidmc.errors import SceneError


def aligned(*arguments):
    """(leading shape, arrays (components, n)) of arguments (name, value (..., components), components); 0 components: a number."""
    arrays = []
    for name, value, size in arguments:
        try:
            array = np.asarray(value, dtype=float)
        except (TypeError, ValueError):
            raise SceneError("", name, value, "expected numbers") from None
        if size and (array.ndim == 0 or array.shape[-1] != size):
            raise SceneError(
                "",
                name,
                None,
                f"has shape {array.shape}; its last axis must have {size} components",
            )
        arrays.append(array if size else array[..., None])
    try:
        shape = np.broadcast_shapes(*(a.shape[:-1] for a in arrays))
    except ValueError:
        given = ", ".join(
            f"{name} {a.shape[:-1]}" for (name, _, _), a in zip(arguments, arrays, strict=True)
        )
        rule = f"leading shapes do not broadcast: {given}; give an axis of length 1 where they differ, e.g. (bodies, 1) and (times,)"
        raise SceneError("", arguments[0][0], None, rule) from None
    return shape, [
        np.moveaxis(np.broadcast_to(a, shape + a.shape[-1:]), -1, 0).reshape(a.shape[-1], -1).copy()
        for a in arrays
    ]


def spread(shape, t):
    """(whole shape, row of the table for each element, times) of a table with leading shape `shape` and times t (...)."""
    try:
        whole = np.broadcast_shapes(shape, t.shape)
    except ValueError:
        rule = f"times {t.shape} do not broadcast against bodies {shape}; give an axis of length 1, e.g. bodies (n, 1) and times (m,)"
        raise SceneError("", "t", None, rule) from None
    rows = np.arange(int(np.prod(shape, dtype=int))).reshape(shape)
    return whole, np.broadcast_to(rows, whole).reshape(-1), np.broadcast_to(t, whole).reshape(-1)
