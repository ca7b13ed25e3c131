"""Bodies that cannot exist: the likely mistakes in their description, each with its cure.

A body with the tensor I about the fixed point, the mass m and the centre of mass c exists iff its
second moments of mass about the centre of mass,

    tr(I)/2 1 - I - m c c^T,

have no negative eigenvalue.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np

from rigidmc.inputs.arrays import Array
from rigidmc.mechanics import inertia

SLACK = 1e-9  # relative, as in `inertia.too_far`
# {unit: (factor of lengths, factor of masses, decades by which it is rarer than others)}
_UNITS = {
    "centimetres": (1e-2, 1.0, 0.5),
    "inches": (0.0254, 1.0, 0.5),
    "millimetres": (1e-3, 1.0, 0.0),
    "grams": (1.0, 1e-3, 0.0),
    "millimetres and the mass in grams": (1e-3, 1e-3, 0.5),
}
# log10 of m c^2 over the largest moment: of moments about the fixed point, from -3 to 0; of moments
# about the centre of mass, as of a bob on a rod, up to 3
_ABOUT_PIVOT, _ABOUT_CENTRE = -0.5, 1.0
_MOST, _WORSE = 3, 1.25  # causes shown, and decades by which they may fit worse than the best


def can_exist(tensor: Any, mass: float, centre: Any) -> bool:
    """Return whether a body can have a tensor (3, 3) about the fixed point, a mass and a centre of
    mass (3,) from the fixed point."""
    inertia_tensor, c = np.asarray(tensor, dtype=float), np.asarray(centre, dtype=float)
    second = 0.5 * np.trace(inertia_tensor) * np.eye(3) - inertia_tensor - mass * np.outer(c, c)
    if not np.isfinite(second).all():
        return False
    return bool(np.linalg.eigvalsh(second).min() >= -SLACK * np.trace(inertia_tensor))


def opposite_products(tensor: Any) -> Array:
    """Return a tensor (3, 3) with the opposite sign of its products of inertia."""
    inertia_tensor = np.asarray(tensor, dtype=float)
    turned: Array = 2.0 * np.diag(inertia_tensor.diagonal()) - inertia_tensor
    return turned


def likely_causes(tensor: Any, mass: float, centre: Any) -> tuple[str, ...]:
    """Return the likely causes that a body cannot exist, each with the numbers of the corrected
    body: first the cause with which m c^2 and the moments fit a real body best.

    tensor (3, 3) [kg m^2] about the fixed point;  mass [kg];  centre (3,) [m]
    """
    inertia_tensor, c = np.asarray(tensor, dtype=float), np.asarray(centre, dtype=float)
    finite = np.isfinite(inertia_tensor).all() and np.isfinite(c).all()
    if not (finite and mass > 0.0) or can_exist(inertia_tensor, mass, c):
        return ()
    causes = sorted(_causes(inertia_tensor, mass, c), key=lambda cause: cause[0])
    return tuple(text for misfit, text in causes[:_MOST] if misfit <= causes[0][0] + _WORSE)


def causes_text(tensor: Any, mass: float, centre: Any) -> str:
    """Return `likely_causes` as the end of a message; "" if there are none."""
    causes = likely_causes(tensor, mass, centre)
    if len(causes) < 2:
        return "".join(f"; likely cause: {cause}" for cause in causes)
    listed = ", or ".join(f"({k}) {cause}" for k, cause in enumerate(causes, 1))
    return f"; likely causes: {listed}"


def _causes(tensor: Array, mass: float, centre: Array) -> Iterator[tuple[float, str]]:
    """Yield (decades by which the numbers miss a real body, cause)."""
    size = mass * float(centre @ centre) / np.abs(np.linalg.eigvalsh(tensor)).max()
    decades = float(np.log10(size)) if size > 0.0 else _ABOUT_PIVOT
    far, near = abs(decades - _ABOUT_CENTRE), abs(decades - _ABOUT_PIVOT)
    moved = inertia.about_point(tensor, mass, centre)
    turned = opposite_products(tensor)
    away, products = bool(centre.any()), _has_products(tensor)
    about = away and can_exist(moved, mass, centre)
    if about:
        yield (
            far,
            'the inertia is about the centre of mass: about = "centre" gives the moments'
            f" {_moments(moved)} about the fixed point",
        )
    opposite = products and can_exist(turned, mass, centre)
    if opposite:
        yield (
            far if about else near,
            "the products of inertia have the opposite sign (I_xy = -int x y dm here): reversed,"
            f" the moments are {_moments(turned)}",
        )
    both = inertia.about_point(turned, mass, centre)
    if away and products and not (about or opposite) and can_exist(both, mass, centre):
        yield (
            far,
            "the products of inertia have the opposite sign (I_xy = -int x y dm here), and the"
            ' tensor is about the centre of mass: reversed, and with about = "centre", the moments'
            f" are {_moments(both)}",
        )
    yield from _units(tensor, mass, centre, decades)


def _units(
    tensor: Array, mass: float, centre: Array, decades: float
) -> Iterator[tuple[float, str]]:
    """Yield lengths and masses in other units, as `_causes` does.

    decades : log10 of m c^2 over the largest moment
    """
    for word, (length, weight, rare) in _UNITS.items():
        m, c = weight * mass, length * centre
        in_unit = decades + np.log10(weight * length**2)
        if not -4.0 < in_unit < 3.0:
            continue
        place = f"({', '.join(f'{x:g}' for x in c)})"
        si = f"in m, it is {place}" if weight == 1.0 else f"in kg, it is {m:g}"
        if length != 1.0 != weight:
            si = f"in m and kg, they are {place} and {m:g}"
        cause = f"the {'mass' if length == 1.0 else 'centre'} is in {word}: {si}"
        moved = inertia.about_point(tensor, m, c)
        if can_exist(tensor, m, c):
            yield rare + abs(in_unit - _ABOUT_PIVOT), cause
        elif word == "millimetres" and can_exist(moved, m, c):
            yield (
                1.0 + abs(in_unit - _ABOUT_CENTRE),  # a decade: two mistakes at once are rarer
                f'{cause}, and the inertia is about it: about = "centre" then gives the moments'
                f" {_moments(moved)}",
            )


def _moments(tensor: Array) -> str:
    """Write the moments of a tensor: along its axes, in their order, if these are principal, so
    that a user can copy them; else the principal moments, in ascending order."""
    moments = np.linalg.eigvalsh(tensor) if _has_products(tensor) else tensor.diagonal()
    return f"({', '.join(f'{x:.6g}' for x in moments)}) kg m2"


def _has_products(tensor: Array) -> bool:
    """Return whether a tensor has products of inertia beyond rounding."""
    return bool(np.abs(tensor - np.diag(tensor.diagonal())).max() > 1e-12 * np.abs(tensor).max())
