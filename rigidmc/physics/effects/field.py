"""Dipoles in uniform fields."""

import math
from typing import NamedTuple

from rigidmc.physics.dynamics.so3 import cross, dot, into_body, root, sincos
from rigidmc.physics.effects.protocol import Number, Vector, effect

_ANY = (-math.inf, math.inf)


@effect(
    units={"dipole": "A m2", "field": "T"},
    shapes={"dipole": 3, "field": 3},
    in_body=("dipole",),
    limits={"dipole": _ANY, "field": _ANY},
    example=((0.3, -0.1, 0.5), (1.0, 2.0, -0.5)),
)
class UniformField(NamedTuple):
    """A magnetic or electric dipole of the body in a uniform field.

    Torque and potential energy::

        tau = dipole x A^T field,   E = -dipole . A^T field

    A needle swings about the field with omega^2 = `|dipole| |field|/I`. For an electric dipole use
    C m and V/m.

    Parameters
    ----------
    dipole : quantities (3,) [A m^2]
        moment in body axes
    field : quantities (3,) [T]
        in space

    Examples
    --------
    >>> needle = rm.UniformField(dipole=(2.0, 0.0, 0.0), field=(0.0, 0.5, 0.0))
    >>> needle.torque((1.0, 0.0, 0.0, 0.0))
    (0.0, 0.0, 1.0)
    """

    dipole: Vector
    field: Vector

    def torque(self, q):
        return cross(self.dipole, into_body(q, self.field))

    def torque_rate(self, q, w):
        return cross(self.dipole, cross(into_body(q, self.field), w))

    def energy(self, q):
        return -dot(self.dipole, into_body(q, self.field))

    def energy_scale(self):
        return _sizes(self.dipole, self.field)


@effect(
    units={"dipole": "A m2", "field": "T", "rate": "rad s-1"},
    shapes={"dipole": 3, "field": 3},
    in_body=("dipole",),
    limits={"dipole": _ANY, "field": _ANY, "rate": _ANY},
    example=((0.3, -0.1, 0.5), (1.0, 2.0, -0.5), 1.7),
)
class RotatingField(NamedTuple):
    """A dipole of the body in a field that rotates about the vertical, as in a synchronous motor.

    Torque::

        tau = dipole x A^T R_z(rate t) field

    Parameters
    ----------
    dipole : quantities (3,) [A m^2]
        moment in body axes
    field : quantities (3,) [T]
        in space at t = 0
    rate : quantity [rad/s]
        angular velocity of the field about the vertical

    Examples
    --------
    >>> motor = rm.RotatingField(dipole=(2.0, 0.0, 0.0), field=(0.0, 0.5, 0.0), rate=3.0)
    >>> motor.torque(0.0, (1.0, 0.0, 0.0, 0.0))
    (0.0, 0.0, 1.0)
    """

    dipole: Vector
    field: Vector
    rate: Number

    def torque(self, t, q):
        return cross(self.dipole, into_body(q, field_at(self.field, self.rate, t)))

    def torque_rate(self, t, q, w):
        return cross(self.dipole, cross(into_body(q, field_at(self.field, self.rate, t)), w))

    def energy_scale(self):
        return _sizes(self.dipole, self.field)


def field_at(field, rate, t):
    """Compute R_z(rate t) field."""
    s, c = sincos(rate * t)
    x, y, z = field
    return c * x - s * y, s * x + c * y, z


def _sizes(a, b):
    """Return a bound on |a . A b|: (a.a b.b)^(1/2), for numbers and arrays."""
    # One square root for two lengths.
    return root(dot(a, a) * dot(b, b))
