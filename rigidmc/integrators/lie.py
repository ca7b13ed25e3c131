"""Lie-group Runge-Kutta methods: the attitude moves by exponentials and stays on SO(3) by construction."""

from typing import NamedTuple

from rigidmc.dynamics.euler import angular_velocity, free_rate
from rigidmc.dynamics.so3 import add, axpy, cross, exponential, multiply, touch_up
from rigidmc.effects.verbs import total_torque


def _rotation_rate(u, w):
    """du/dt of the rotation vector u in q = q0 exp(u): w + u x w/2 + u x (u x w)/12, enough for order 4."""
    uw = cross(u, w)
    return axpy(axpy(w, 0.5, uw), 1.0 / 12.0, cross(u, uw))


class RKMK4(NamedTuple):
    """Runge-Kutta-Munthe-Kaas of order 4: classical Runge-Kutta on the rotation vector of the step and on L.

    For any torque. About half the error of rk4 at the same step, at about twice its price; energy and |L|^2 drift as h^4 t.
    Source: Munthe-Kaas, Appl. Numer. Math. 29 (1999) 115; truncated dexp^-1 as in Hairer, Lubich & Wanner 2006, IV.8.
    """

    order = 4
    evaluations = 4
    reversible = False
    conserves = ("|q|",)
    accepts = "any torque"

    def step(self, body, effects, t, h, q, l):
        w1 = angular_velocity(body, l)
        dl1 = add(free_rate(body, l), total_torque(effects, body, t, q, l))
        u2, l2 = (0.5 * h * w1[0], 0.5 * h * w1[1], 0.5 * h * w1[2]), axpy(l, 0.5 * h, dl1)
        w2 = _rotation_rate(u2, angular_velocity(body, l2))
        dl2 = add(free_rate(body, l2), total_torque(effects, body, t + 0.5 * h, multiply(q, exponential(u2)), l2))
        u3, l3 = (0.5 * h * w2[0], 0.5 * h * w2[1], 0.5 * h * w2[2]), axpy(l, 0.5 * h, dl2)
        w3 = _rotation_rate(u3, angular_velocity(body, l3))
        dl3 = add(free_rate(body, l3), total_torque(effects, body, t + 0.5 * h, multiply(q, exponential(u3)), l3))
        u4, l4 = (h * w3[0], h * w3[1], h * w3[2]), axpy(l, h, dl3)
        w4 = _rotation_rate(u4, angular_velocity(body, l4))
        dl4 = add(free_rate(body, l4), total_torque(effects, body, t + h, multiply(q, exponential(u4)), l4))
        u = axpy(axpy((0.0, 0.0, 0.0), h / 6.0, add(w1, w4)), h / 3.0, add(w2, w3))
        l = axpy(axpy(l, h / 6.0, add(dl1, dl4)), h / 3.0, add(dl2, dl3))
        return touch_up(multiply(q, exponential(u))), l
