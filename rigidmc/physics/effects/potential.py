"""A potential that depends on the vertical in the body."""

import math
from typing import NamedTuple

from rigidmc.physics.dynamics.so3 import add, cross, dot, root, symmetric_times, vertical
from rigidmc.physics.effects.protocol import Vector, effect

_ANY = (-math.inf, math.inf)


@effect(
    units={"linear": "J", "quadratic": "J", "quartic": "J"},
    shapes={"linear": 3, "quadratic": 6, "quartic": 3},
    limits={"linear": _ANY, "quadratic": _ANY, "quartic": _ANY},
    in_body=("linear", "quadratic"),
    along_axes=("quartic",),
    example=((0.3, -0.1, 0.5), (0.2, 0.5, -0.3, 0.1, 0.25, -0.15), (0.1, 0.3, -0.2)),
    conserves_lz=True,
)
class Potential(NamedTuple):
    """A polynomial in the vertical u = A^T e_z, in body components.

    Potential energy and torque::

        E = linear . u + 1/2 u . Q u + quartic . (u_1^4, u_2^4, u_3^4)
        tau = u x dE/du

    The linear part is gravity (linear = g m r). 1/2 u . Q u is the potential of Clebsch and Brun: a
    quadratic field, or an induced dipole.

    Parameters
    ----------
    linear : quantities (3,) [J]
        coefficients of u, body axes
    quadratic : quantities (6,), optional [J]
        xx, yy, zz, yz, zx, xy of the symmetric Q, body axes
    quartic : quantities (3,), optional [J]
        coefficients of u_1^4, u_2^4, u_3^4 along the principal axes; refused for a body described
        in other axes

    Examples
    --------
    >>> clebsch = rm.Potential((0.0, 0.0, 0.0), quadratic=(1.0, 2.0, 3.0, 0.0, 0.0, 0.0))
    >>> clebsch.energy((1.0, 0.0, 0.0, 0.0))
    1.5
    """

    linear: Vector
    quadratic: Vector = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    quartic: Vector = (0.0, 0.0, 0.0)

    def torque(self, q):
        u = vertical(q)
        return cross(u, _slope(self, u))

    def torque_rate(self, q, w):
        u, k = vertical(q), self.quartic
        du = cross(u, w)
        # The rate of change of dE/du when u changes at the rate du.
        x, y, z = 12.0 * k[0] * u[0] * u[0], 12.0 * k[1] * u[1] * u[1], 12.0 * k[2] * u[2] * u[2]
        bend = add(symmetric_times(self.quadratic, du), (x * du[0], y * du[1], z * du[2]))
        return add(cross(du, _slope(self, u)), cross(u, bend))

    def energy(self, q):
        u, k = vertical(q), self.quartic
        x, y, z = u[0] * u[0], u[1] * u[1], u[2] * u[2]
        quadratic = 0.5 * dot(u, symmetric_times(self.quadratic, u))
        return dot(self.linear, u) + quadratic + (k[0] * x * x + k[1] * y * y + k[2] * z * z)

    def energy_scale(self):
        m, k = self.quadratic, self.quartic
        # The Frobenius norm of Q bounds its eigenvalues.
        off = m[3] * m[3] + m[4] * m[4] + m[5] * m[5]
        return (
            root(dot(self.linear, self.linear))
            + 0.5 * root(m[0] * m[0] + m[1] * m[1] + m[2] * m[2] + 2.0 * off)
            + (abs(k[0]) + abs(k[1]) + abs(k[2]))
        )


def _slope(potential, u):
    """Return dE/du."""
    k = potential.quartic
    x, y, z = 4.0 * k[0] * u[0] * u[0], 4.0 * k[1] * u[1] * u[1], 4.0 * k[2] * u[2] * u[2]
    slope = add(potential.linear, symmetric_times(potential.quadratic, u))
    return add(slope, (x * u[0], y * u[1], z * u[2]))
