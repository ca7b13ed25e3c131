"""Mass and moments of a density over a region, by product Gauss-Legendre rules."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rigidmc.errors import SceneError
from rigidmc.inputs.arrays import Array, floats


def moments_of_density(
    density: float | Callable[..., ArrayLike], region: tuple[Any, ...], points: int
) -> Array:
    """Return mass, three first and nine second moments (13,), TdC (3.17).

    A product Gauss-Legendre rule integrates them. density, region : see
    `rigidmc.scene.body.Body.from_density`;  points : of the rule in each direction

    SceneError for an invalid region, and for a density that is negative or not finite.
    """
    x, y, z, volume = _nodes(region, points)
    try:
        densities = floats(density(x, y, z) if callable(density) else density, "body.density")
        values = np.broadcast_to(densities, x.shape)
    except SceneError:
        raise
    except (TypeError, ValueError) as error:
        rule = f"must be a number, or a function whose arrays have the shape of x: {error}"
        raise SceneError(rule, at="body.density") from None
    good = np.isfinite(values) & (values >= 0.0)
    if not good.all():
        rule = "must be finite and not negative"
        raise SceneError(rule, at="body.density", value=float(values[~good][0]))
    mass = (volume * values).ravel()
    place = np.stack([x, y, z]).reshape(3, -1)
    return np.concatenate([[mass.sum()], place @ mass, ((place * mass) @ place.T).ravel()])


def _nodes(region: tuple[Any, ...], points: int) -> tuple[Array, ...]:
    """Return (x, y, z, volume) of a product rule over a region, arrays of one shape."""
    word = region[0] if isinstance(region[0], str) else None
    if len(region) != {"box": 4, "cylinder": 3, None: 3}.get(word):
        rule = (
            'expected ("box", (x0, x1), (y0, y1), (z0, z1)), ("cylinder", radius, (z0, z1)), '
            "or three pairs of limits"
        )
        raise SceneError(rule, at="body.region", value=word)
    node, weight = np.polynomial.legendre.leggauss(points)
    # sin(pi t/2) smooths limits that meet like square roots: error for a ball 1e-14, not 3e-5
    node, weight = np.sin(0.5 * np.pi * node), 0.5 * np.pi * np.cos(0.5 * np.pi * node) * weight

    def stretched(low: Any, high: Any) -> tuple[Array, Array]:
        """Return (nodes, weights) from limits (...) to limits (...), along a new last axis."""
        low, high = floats(low, "body.region"), floats(high, "body.region")
        low, high = np.broadcast_arrays(low[..., None], high[..., None])
        if not (low <= high).all():
            rule = "a lower limit exceeds its upper limit, or is not finite"
            raise SceneError(rule, at="body.region")
        return 0.5 * (high + low) + 0.5 * (high - low) * node, 0.5 * (high - low) * weight

    if word == "cylinder":
        r, wr = stretched(0.0, region[1])
        # on a circle the Gauss rule is the trapezoidal rule
        angle = 2.0 * np.pi * np.arange(2 * points) / (2 * points)
        z, wz = stretched(*region[2])
        x, y = r[:, None, None] * np.cos(angle)[:, None], r[:, None, None] * np.sin(angle)[:, None]
        volume = (wr * r)[:, None, None] * np.full((angle.size, 1), np.pi / points) * wz
    else:
        along, in_y, in_z = region[1:] if word == "box" else region
        x, wx = stretched(*along)
        y, wy = stretched(*(in_y(x) if callable(in_y) else in_y))
        y, wy = np.broadcast_to(y, (points, points)), np.broadcast_to(wy, (points, points))
        z, wz = stretched(*(in_z(x[:, None], y) if callable(in_z) else in_z))
        x, y, volume = x[:, None, None], y[..., None], wx[:, None, None] * wy[..., None] * wz
    return tuple(np.broadcast_arrays(x, y, z, volume))
