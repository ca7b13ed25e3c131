"""Solids with closed forms: each returns (mass, centre of mass, inertia tensor about its origin).

The moments follow TdC (3.17). The symmetry axis of every solid is axis 3. Lengths are in m, masses
in kg. `rigidmc.scene.body.Body` makes bodies from the solids; scene files use the function names.
"""

from collections.abc import Callable

import numpy as np

from rigidmc.errors import SceneError
from rigidmc.inputs.arrays import Array
from rigidmc.physics.dynamics.dual_arrays import as_array

Solid = tuple[float, tuple[float, float, float], Array]
_ZERO = (0.0, 0.0, 0.0)
# number of components of vector arguments
COMPONENTS = {("box", "size"): 3, ("plate", "size"): 2, ("ellipsoid", "semiaxes"): 3}


def _diagonal(mass: float, *moments: float) -> Solid:
    """Return a solid about its centre of mass, from its moments per mass."""
    return mass, _ZERO, np.diag(as_array([mass * m for m in moments]))


def box(mass: float, size: tuple[float, float, float]) -> Solid:
    """Box with edges (x, y, z) [m] about its centre: M/12 (y^2 + z^2) and cyclic."""
    x, y, z = size
    return _diagonal(mass, (y * y + z * z) / 12, (z * z + x * x) / 12, (x * x + y * y) / 12)


def ball(mass: float, radius: float) -> Solid:
    """Ball about its centre: 2/5 M r^2."""
    return _diagonal(mass, *[0.4 * radius**2] * 3)


def shell(mass: float, radius: float) -> Solid:
    """Thin spherical shell about its centre: 2/3 M r^2."""
    return _diagonal(mass, *[2 / 3 * radius**2] * 3)


def cylinder(mass: float, radius: float, height: float) -> Solid:
    """Cylinder about its centre: M/12 (3 a^2 + h^2), M a^2/2, TdC (3.18)."""
    side = (3 * radius**2 + height**2) / 12
    return _diagonal(mass, side, side, radius**2 / 2)


def hollow_cylinder(mass: float, inner: float, outer: float, height: float) -> Solid:
    """Tube about its centre: M/12 (3 (a^2 + b^2) + h^2), M (a^2 + b^2)/2."""
    if not inner < outer:
        rule = f"must be less than outer = {outer:g}"
        raise SceneError(rule, at="body.hollow_cylinder.inner", value=inner)
    side = (3 * (inner**2 + outer**2) + height**2) / 12
    return _diagonal(mass, side, side, (inner**2 + outer**2) / 2)


def cone(mass: float, radius: float, height: float) -> Solid:
    """Cone about its APEX, the base towards +3: it spins on its tip.

    3/5 M (a^2/4 + h^2), 3/10 M a^2; centre of mass at 3 h/4.
    """
    side = 0.6 * (radius**2 / 4 + height**2)
    tensor = np.diag(as_array([mass * side, mass * side, 0.3 * mass * radius**2]))
    return mass, (0.0, 0.0, 0.75 * height), tensor


def ellipsoid(mass: float, semiaxes: tuple[float, float, float]) -> Solid:
    """Ellipsoid about its centre: M/5 (b^2 + c^2) and cyclic."""
    a, b, c = semiaxes
    return _diagonal(mass, (b * b + c * c) / 5, (c * c + a * a) / 5, (a * a + b * b) / 5)


def rod(mass: float, length: float, radius: float) -> Solid:
    """Rod about its centre: another name for a cylinder.

    The radius must not be 0: a body cannot have the moment 0 about its axis.
    """
    return cylinder(mass, radius, length)


def plate(mass: float, size: tuple[float, float]) -> Solid:
    """Thin plate with edges (x, y) [m] about its centre: M y^2/12, M x^2/12 and their sum."""
    x, y = size
    return _diagonal(mass, y * y / 12, x * x / 12, (x * x + y * y) / 12)


def disc(mass: float, radius: float) -> Solid:
    """Thin disc about its centre: M r^2/4, M r^2/4, M r^2/2."""
    return _diagonal(mass, radius**2 / 4, radius**2 / 4, radius**2 / 2)


def ring(mass: float, radius: float) -> Solid:
    """Thin ring about its centre: M r^2/2, M r^2/2, M r^2."""
    return _diagonal(mass, radius**2 / 2, radius**2 / 2, radius**2)


def t_handle(density: float, radius: float, bar: float, stem: float) -> Solid:
    """T-handle about its centre of mass: a bar along 1, and a stem along 3 from its middle.

    density [kg/m^3];  radius of both rods, length of bar and stem [m]
    """
    bar_mass, stem_mass = (density * np.pi * radius**2 * length for length in (bar, stem))
    mass = bar_mass + stem_mass
    _, _, across = cylinder(bar_mass, radius, bar)
    _, _, along = cylinder(stem_mass, radius, stem)
    centre = 0.5 * stem * stem_mass / mass
    level = np.diag([1.0, 1.0, 0.0])  # tensor of a unit mass at a unit distance along axis 3
    tensor = (
        np.diag(np.diag(across)[[2, 1, 0]])
        + bar_mass * centre**2 * level
        + along
        + stem_mass * (0.5 * stem - centre) ** 2 * level
    )
    return mass, _ZERO, tensor


_ALL = (
    box,
    ball,
    shell,
    cylinder,
    hollow_cylinder,
    cone,
    ellipsoid,
    rod,
    plate,
    disc,
    ring,
    t_handle,
)
SOLIDS: dict[str, Callable[..., Solid]] = {solid.__name__: solid for solid in _ALL}
