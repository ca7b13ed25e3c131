"""Solids with closed forms: each gives (mass, centre of mass, inertia tensor about the origin named), moments in TdC (3.17)'s sense.

Every solid stands with its own axis along 3. `rigidmc.scene.body.Body` makes bodies of them, scene files name them by these words.
"""

import numpy as np

from rigidmc.errors import SceneError

_ZERO = (0.0, 0.0, 0.0)
COMPONENTS = {
    ("box", "size"): 3,
    ("plate", "size"): 2,
    ("ellipsoid", "semiaxes"): 3,
}  # of the arguments that are no numbers


def _diagonal(mass, *moments):
    return mass, _ZERO, np.diag([mass * m for m in moments])


def box(mass, size):
    """Box with edges (x, y, z) [m] about its centre: M/12 (y^2 + z^2) and cyclic."""
    x, y, z = size
    return _diagonal(mass, (y * y + z * z) / 12, (z * z + x * x) / 12, (x * x + y * y) / 12)


def ball(mass, radius):
    """Ball about its centre: 2/5 M r^2."""
    return _diagonal(mass, *[0.4 * radius**2] * 3)


def shell(mass, radius):
    """Thin spherical shell about its centre: 2/3 M r^2."""
    return _diagonal(mass, *[2 / 3 * radius**2] * 3)


def cylinder(mass, radius, height):
    """Cylinder about its centre: M/12 (3 a^2 + h^2), M a^2/2, TdC (3.18)."""
    side = (3 * radius**2 + height**2) / 12
    return _diagonal(mass, side, side, radius**2 / 2)


def hollow_cylinder(mass, inner, outer, height):
    """Tube about its centre: M/12 (3 (a^2 + b^2) + h^2), M (a^2 + b^2)/2."""
    if not inner < outer:
        raise SceneError(
            "body.hollow_cylinder", "inner", inner, f"must be less than outer = {outer:g}"
        )
    side = (3 * (inner**2 + outer**2) + height**2) / 12
    return _diagonal(mass, side, side, (inner**2 + outer**2) / 2)


def cone(mass, radius, height):
    """Cone about its APEX, base up along +3, so that it spins on its tip: 3/5 M (a^2/4 + h^2), 3/10 M a^2; centre at 3 h/4."""
    side = 0.6 * (radius**2 / 4 + height**2)
    return (
        mass,
        (0.0, 0.0, 0.75 * height),
        np.diag([mass * side, mass * side, 0.3 * mass * radius**2]),
    )


def ellipsoid(mass, semiaxes):
    """Ellipsoid about its centre: M/5 (b^2 + c^2) and cyclic."""
    a, b, c = semiaxes
    return _diagonal(mass, (b * b + c * c) / 5, (c * c + a * a) / 5, (a * a + b * b) / 5)


def rod(mass, length, radius):
    """Rod about its centre: a cylinder, named for what it is used for; a rod of no radius has no moment about its axis and is no body."""
    return cylinder(mass, radius, length)


def plate(mass, size):
    """Thin plate with edges (x, y) [m] about its centre: M y^2/12, M x^2/12 and their sum."""
    x, y = size
    return _diagonal(mass, y * y / 12, x * x / 12, (x * x + y * y) / 12)


def disc(mass, radius):
    """Thin disc about its centre: M r^2/4, M r^2/4, M r^2/2."""
    return _diagonal(mass, radius**2 / 4, radius**2 / 4, radius**2 / 2)


def ring(mass, radius):
    """Thin ring about its centre: M r^2/2, M r^2/2, M r^2."""
    return _diagonal(mass, radius**2 / 2, radius**2 / 2, radius**2)


def t_handle(density, radius, bar, stem):
    """T-handle about its centre of mass: a bar along 1 and a stem along 3 that starts at the bar's middle, both rods [kg/m^3, m]."""
    bar_mass, stem_mass = (density * np.pi * radius**2 * length for length in (bar, stem))
    mass = bar_mass + stem_mass
    _, _, across = cylinder(bar_mass, radius, bar)
    _, _, along = cylinder(stem_mass, radius, stem)
    centre = 0.5 * stem * stem_mass / mass
    level = np.diag([1.0, 1.0, 0.0])  # of a unit mass at a unit distance up axis 3
    tensor = (
        np.diag(np.diag(across)[[2, 1, 0]])
        + bar_mass * centre**2 * level
        + along
        + stem_mass * (0.5 * stem - centre) ** 2 * level
    )
    return mass, _ZERO, tensor


SOLIDS = {
    f.__name__: f
    for f in (
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
}
