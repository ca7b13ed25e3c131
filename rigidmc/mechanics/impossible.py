"""Bodies that cannot exist: the likely mistakes in their description, each with its cure.

A body with the tensor I about the fixed point, the mass m and the centre of mass c exists iff its
second moments of mass about the centre of mass,

    tr(I)/2 1 - I - m c c^T,

have no negative eigenvalue.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigidmc.mechanics import inertia

Array = NDArray[np.float64]

SLACK = 1e-9  # relative, as in `inertia.too_far`
# m c^2 over the largest moment, of bodies whose lengths or masses have another unit. In SI, real
# bodies have 1e-3 to 1; millimetres multiply this by 1e6, grams by 1e3
_MILLIMETRES, _GRAMS, _BOTH = (900.0, 9e8), (5.0, 5e3), (5e6, 5e9)


def can_exist(tensor: Any, mass: float, centre: Any) -> bool:
    """Return whether a body can have a tensor (3, 3) about the fixed point, a mass and a centre of
    mass (3,) from the fixed point."""
    own, c = np.asarray(tensor, dtype=float), np.asarray(centre, dtype=float)
    second = 0.5 * np.trace(own) * np.eye(3) - own - mass * np.outer(c, c)
    if not np.isfinite(second).all():
        return False
    return bool(np.linalg.eigvalsh(second).min() >= -SLACK * np.trace(own))


def opposite_products(tensor: Any) -> Array:
    """Return a tensor (3, 3) with the opposite sign of its products of inertia."""
    own = np.asarray(tensor, dtype=float)
    turned: Array = 2.0 * np.diag(own.diagonal()) - own
    return turned


def likely_causes(tensor: Any, mass: float, centre: Any) -> tuple[str, ...]:
    """Return the likely causes that a body cannot exist, the likeliest first, each with the numbers
    of the corrected body.

    tensor (3, 3) [kg m^2] about the fixed point;  mass [kg];  centre (3,) [m]
    """
    own, c = np.asarray(tensor, dtype=float), np.asarray(centre, dtype=float)
    finite = np.isfinite(own).all() and np.isfinite(c).all()
    if not (finite and mass > 0.0) or can_exist(own, mass, c):
        return ()
    return tuple(_causes(own, mass, c))


def causes_text(tensor: Any, mass: float, centre: Any) -> str:
    """Return `likely_causes` as the end of a message; "" if there are none."""
    causes = likely_causes(tensor, mass, centre)
    if len(causes) < 2:
        return "".join(f"; likely cause: {cause}" for cause in causes)
    listed = ", or ".join(f"({k}) {cause}" for k, cause in enumerate(causes, 1))
    return f"; likely causes: {listed}"


def _causes(tensor: Array, mass: float, centre: Array) -> Iterator[str]:
    moved = inertia.about_point(tensor, mass, centre)
    turned = opposite_products(tensor)
    products = _has_products(tensor)
    away = bool(centre.any())
    about = away and can_exist(moved, mass, centre)
    if about:
        yield (
            'the inertia is about the centre of mass: about = "centre" gives the moments'
            f" {_moments(moved)} about the fixed point"
        )
    opposite = products and can_exist(turned, mass, centre)
    if opposite:
        yield (
            "the products of inertia have the opposite sign (I_xy = -int x y dm here): reversed,"
            f" the moments are {_moments(turned)}"
        )
    both = inertia.about_point(turned, mass, centre)
    if away and products and not (about or opposite) and can_exist(both, mass, centre):
        yield (
            "the products of inertia have the opposite sign (I_xy = -int x y dm here), and the"
            ' tensor is about the centre of mass: reversed, and with about = "centre", the moments'
            f" are {_moments(both)}"
        )
    yield from _units(tensor, mass, centre)


def _units(tensor: Array, mass: float, centre: Array) -> Iterator[str]:
    """Find lengths in millimetres and masses in grams."""
    ratio = mass * float(centre @ centre) / np.abs(np.linalg.eigvalsh(tensor)).max()

    def fits(band: tuple[float, float], mass: float, centre: Array) -> bool:
        return band[0] < ratio < band[1] and can_exist(tensor, mass, centre)

    small, light = 1e-3 * centre, 1e-3 * mass
    place = ", ".join(f"{x:g}" for x in small)
    if fits(_MILLIMETRES, mass, small):
        yield f"the centre is in millimetres: in m, it is ({place})"
    elif _MILLIMETRES[0] < ratio < _MILLIMETRES[1]:
        moved = inertia.about_point(tensor, mass, small)
        if can_exist(moved, mass, small):
            yield (
                f"the centre is in millimetres: in m, it is ({place}), and the inertia is about it:"
                f' about = "centre" then gives the moments {_moments(moved)}'
            )
    if fits(_GRAMS, light, centre):
        yield f"the mass is in grams: in kg, it is {light:g}"
    if fits(_BOTH, light, small):
        yield (
            "the centre is in millimetres and the mass in grams: in m and kg, they are"
            f" ({place}) and {light:g}"
        )


def _moments(tensor: Array) -> str:
    """Write the moments of a tensor: along its axes, in their order, if these are principal, so
    that a user can copy them; else the principal moments, in ascending order."""
    moments = np.linalg.eigvalsh(tensor) if _has_products(tensor) else tensor.diagonal()
    return f"({', '.join(f'{x:.6g}' for x in moments)}) kg m2"


def _has_products(tensor: Array) -> bool:
    """Return whether a tensor has products of inertia beyond rounding."""
    return bool(np.abs(tensor - np.diag(tensor.diagonal())).max() > 1e-12 * np.abs(tensor).max())
