"""Uniform gravity on a body whose centre of mass is off the fixed point."""

import math
from typing import NamedTuple

from rigidmc.physics.dynamics.so3 import cross, dot, vertical
from rigidmc.physics.effects.protocol import Number, effect


@effect(
    units={"g": "m s-2"},
    limits={"g": (-math.inf, math.inf)},
    example=(9.81,),
    conserves_lz=True,
    isotropic=True,
)
class Gravity(NamedTuple):
    """Uniform gravity along -z.

    Torque and potential energy (TdC Example 3.7)::

        tau = -g m r x u(q),   E = g m r . u(q),   u = A^T e_z

    m r is the body's static moment; r may have any direction in the body.

    Parameters
    ----------
    g : quantity [m/s^2]
        acceleration of gravity

    Examples
    --------
    >>> pendulum = rm.Body.cylinder(1.0, 0.1, 0.4).with_pivot((0.0, 0.0, -0.2))
    >>> rm.Scene(pendulum, rm.Gravity(9.81)).effects
    (Gravity(g=9.81),)
    """

    g: Number

    def torque(self, body, q):
        return cross(vertical(q), (self.g * body.p1, self.g * body.p2, self.g * body.p3))

    def add_torque(self, body, q, by, onto):
        # u_x/2 and u_y/2, and products that leave the loop over steps: 14 operations, not 19
        x, y = q[1] * q[3] - q[0] * q[2], q[2] * q[3] + q[0] * q[1]
        z = q[0] * q[0] - q[1] * q[1] - q[2] * q[2] + q[3] * q[3]
        one, two, three = self.g * body.p1, self.g * body.p2, self.g * body.p3
        return (
            onto[0] + (2.0 * by[0] * three) * y - (by[0] * two) * z,
            onto[1] + (by[1] * one) * z - (2.0 * by[1] * three) * x,
            onto[2] + (2.0 * by[2] * two) * x - (2.0 * by[2] * one) * y,
        )

    def torque_rate(self, body, q, w):
        # du/dt = u x omega
        return cross(cross(vertical(q), w), (self.g * body.p1, self.g * body.p2, self.g * body.p3))

    def energy(self, body, q):
        return self.g * dot((body.p1, body.p2, body.p3), vertical(q))

    def energy_scale(self, body):
        # |r_1| + |r_2| + |r_3| bounds |r|, without a root.
        return abs(self.g) * (abs(body.p1) + abs(body.p2) + abs(body.p3))
