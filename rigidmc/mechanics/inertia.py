"""Inertia tensors of arrays of bodies: particles, parallel axes, principal axes, L = I omega. Components last, any leading shape."""

import numpy as np

from rigidmc.dynamics.principal import Principal
from rigidmc.errors import SceneError, flag

SLACK = 1e-12  # a flat plate obeys I3 = I1 + I2 only to rounding
_SIX = ([0, 1, 2, 1, 2, 0], [0, 1, 2, 2, 0, 1])  # xx, yy, zz, yz, zx, xy


def broken(moments):
    """Which bodies cannot be: a moment is not positive, or exceeds the sum of the other two. moments (3, ...) -> bool (...)."""
    one, two, three = moments
    total = (one + two + three) * (1 + SLACK)
    return ~(
        (np.minimum(np.minimum(one, two), three) > 0)
        & (2 * np.maximum(np.maximum(one, two), three) <= total)
    )


def shift(r):
    """r^2 1 - r r^T (..., 3, 3) of vectors (..., 3): the tensor of a unit mass at r."""
    return (
        np.einsum("...i,...i", r, r)[..., None, None] * np.eye(3)
        - r[..., :, None] * r[..., None, :]
    )


def of_particles(masses, positions):
    """I_ij = sum m (r^2 delta_ij - x_i x_j) (..., 3, 3) of masses (..., N) at positions (..., N, 3), TdC (3.15)."""
    masses, positions = np.asarray(masses, dtype=float), np.asarray(positions, dtype=float)
    if (
        positions.ndim < 2
        or positions.shape[-1] != 3
        or masses.shape[-1:] != positions.shape[-2:-1]
    ):
        rule = f"masses {masses.shape} need positions of shape (..., {masses.shape[-1] if masses.ndim else 1}, 3), not {positions.shape}"
        raise SceneError("", "positions", None, rule)
    return np.einsum("...n,...nij->...ij", masses, shift(positions))


def moments_of_density(density, region, points):
    """(mass, three first and nine second moments), TdC (3.17), by a product Gauss-Legendre rule; see `rigidmc.scene.body.Body.from_density`."""
    word = region[0] if isinstance(region[0], str) else None
    if len(region) != {"box": 4, "cylinder": 3, None: 3}.get(word):
        rule = 'expected ("box", (x0, x1), (y0, y1), (z0, z1)), ("cylinder", radius, (z0, z1)), or three pairs of limits'
        raise SceneError("body", "region", word, rule)
    node, weight = np.polynomial.legendre.leggauss(points)
    # sin(pi t/2) makes limits that meet like roots smooth: a ball to 1e-14 in place of 3e-5
    node, weight = np.sin(0.5 * np.pi * node), 0.5 * np.pi * np.cos(0.5 * np.pi * node) * weight

    def stretched(low, high):
        low, high = np.broadcast_arrays(
            np.asarray(low, dtype=float)[..., None], np.asarray(high, dtype=float)[..., None]
        )
        if not (low <= high).all():
            raise SceneError(
                "body", "region", None, "a lower limit lies above its upper one, or is not finite"
            )
        return 0.5 * (high + low) + 0.5 * (high - low) * node, 0.5 * (high - low) * weight

    if word == "cylinder":
        r, wr = stretched(0.0, region[1])
        angle = (
            2.0 * np.pi * np.arange(2 * points) / (2 * points)
        )  # the trapezoidal rule is Gauss's of a circle
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
    x, y, z, volume = np.broadcast_arrays(x, y, z, volume)
    try:
        values = np.broadcast_to(
            np.asarray(density(x, y, z) if callable(density) else density, dtype=float), x.shape
        )
    except (TypeError, ValueError) as error:
        raise SceneError(
            "body",
            "density",
            None,
            f"must be a number or take and give arrays of one shape: {error}",
        ) from None
    good = np.isfinite(values) & (values >= 0.0)
    if not good.all():
        raise SceneError(
            "body", "density", float(values[~good][0]), "must be finite and not negative"
        )
    mass = (volume * values).ravel()
    place = np.stack([x, y, z]).reshape(3, -1)
    return np.concatenate([[mass.sum()], place @ mass, ((place * mass) @ place.T).ravel()])


def about_point(tensor, mass, offset):
    """Tensor about a point from that about the centre of mass: I + m (d^2 1 - d d^T), TdC (3.26), (3.27).

    tensor (..., 3, 3) about the centre of mass;  mass (...);  offset d (..., 3) between the two points, either sign
    """
    return np.asarray(tensor, dtype=float) + np.asarray(mass, dtype=float)[..., None, None] * shift(
        np.asarray(offset, dtype=float)
    )


def about_centre(tensor, mass, offset):
    """Tensor about the centre of mass from that about a point at `offset` from it, TdC (3.28): about_point backwards."""
    return np.asarray(tensor, dtype=float) - np.asarray(mass, dtype=float)[..., None, None] * shift(
        np.asarray(offset, dtype=float)
    )


def angular_momentum(tensor, omega):
    """L = I omega (..., 3), TdC (3.25): along omega only on a principal axis."""
    return np.einsum(
        "...ij,...j->...i", np.asarray(tensor, dtype=float), np.asarray(omega, dtype=float)
    )


def kinetic_energy(tensor, omega):
    """T = 1/2 omega I omega (...), TdC (3.16)."""
    return 0.5 * (np.asarray(omega, dtype=float) * angular_momentum(tensor, omega)).sum(-1)


def survives(axis, offset, relative=1e-12):
    """Whether principal axes (..., 3) about the centre of mass are principal too about a point at `offset` (..., 3), TdC Example 3.4.

    The shift adds m (d^2 1 - d d^T), of which an axis e is an eigenvector iff it is parallel or perpendicular to d.
    """
    axis, offset = np.asarray(axis, dtype=float), np.asarray(offset, dtype=float)
    size = np.linalg.norm(axis, axis=-1) * np.linalg.norm(offset, axis=-1)
    along, across = np.abs((axis * offset).sum(-1)), np.linalg.norm(np.cross(axis, offset), axis=-1)
    return (along <= relative * size) | (across <= relative * size)


def principal_axes(tensor):
    """(moments (..., 3), axes (..., 3, 3)) of inertia tensors (..., 3, 3), I = B diag(moments) B^T, det B = +1, TdC (3.19)-(3.23).

    The columns of B are the axes; moments ascend, the largest components of the first two axes are positive, the third completes a
    right-handed set. A tensor that is diagonal to 4e-15 keeps its axes and their order; where two or three moments are equal the axes
    in their plane are those that Jacobi's rotations reach from the tensor as given: the same bits for the same tensor.

    What is not symmetric, not positive or against the triangle inequality is nan, with a SceneWarning that counts; SceneError where
    all are, with what is wrong.
    """
    tensor = np.asarray(tensor, dtype=float)
    if tensor.shape[-2:] != (3, 3):
        raise SceneError(
            "", "tensor", None, f"has shape {tensor.shape}; its last two axes must be 3 and 3"
        )
    if not tensor.size:
        return np.empty(tensor.shape[:-1]), np.empty(tensor.shape)
    flat = tensor.reshape(-1, 3, 3)
    size = np.abs(flat).max((1, 2))
    endless = ~np.isfinite(size)
    flag(endless, "an inertia tensor has finite components")
    with np.errstate(invalid="ignore"):
        skew = np.abs(flat - np.swapaxes(flat, 1, 2)).max((1, 2)) / np.where(size > 0.0, size, 1.0)
    bad = endless | ~(skew <= 1e-9)
    worst = np.max(skew, where=~endless, initial=0.0)
    flag(
        bad & ~endless,
        f"an inertia tensor is symmetric; I_ij and I_ji differ by {worst:.2g} of its size",
    )
    symmetric = 0.5 * (flat + np.swapaxes(flat, 1, 2))
    six = symmetric[:, _SIX[0], _SIX[1]]
    if len(six) > 1:
        from rigidmc.engine.formulas import (
            evaluate,
        )  # imports the compiler, which one tensor does not need

        values = evaluate(Principal, 12, six.T)
    else:
        values = np.array([Principal(*t).values() for t in six.tolist()]).T
    values[:, bad] = np.nan
    moments = values[:3]
    # particles on a line that is no axis leave a moment of 6e-17 of the others, of either sign
    impossible = (broken(moments) | (moments.min(0) <= 1e-14 * moments.max(0))) & ~bad
    example = ", ".join(f"{m:.4g}" for m in moments[:, np.argmax(impossible)])
    flag(
        impossible,
        f"principal moments must be positive and obey I_i <= I_j + I_k, and ({example}) are not: no mass is spread like that",
    )
    values[:, impossible] = np.nan
    shape = tensor.shape[:-2]
    return values[:3].T.reshape(*shape, 3), np.moveaxis(
        values[3:].reshape(3, 3, -1), -1, 0
    ).swapaxes(1, 2).reshape(*shape, 3, 3)


def growth_rate(moments):
    """lambda/omega (...) with which a small disturbance of a spin about the axis of the middle moment grows; 0 where two are equal.

    lambda = omega sqrt((I2 - I1)(I3 - I2)/(I1 I3)),   I1 <= I2 <= I3;   moments (..., 3)
    """
    one, two, three = np.moveaxis(np.sort(np.asarray(moments, dtype=float), axis=-1), -1, 0)
    return np.sqrt((two - one) / one * ((three - two) / three))
