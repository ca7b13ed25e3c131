"""Classical Runge-Kutta."""

from typing import NamedTuple

from rigidmc.dynamics.euler import derivative
from rigidmc.dynamics.so3 import axpy, axpy4, renormalise
from rigidmc.effects.verbs import total_torque


class RK4(NamedTuple):
    """Classical Runge-Kutta of order 4 on quaternion and body angular momentum, the quaternion normalised after each step.

    For any torque; the cheapest step for moderate accuracy over short times. Energy and |L|^2 drift as h^4 t.
    Source: Kutta 1901; Hairer, Norsett & Wanner, Solving ODEs I, table II.1.2.
    """

    order = 4
    evaluations = 4
    reversible = False
    conserves = ()
    accepts = "any torque"

    def step(self, body, effects, t, h, q, l):
        dq1, dl1 = derivative(body, total_torque(effects, body, t, q, l), q, l)
        q2, l2 = axpy4(q, 0.5 * h, dq1), axpy(l, 0.5 * h, dl1)
        dq2, dl2 = derivative(body, total_torque(effects, body, t + 0.5 * h, q2, l2), q2, l2)
        q3, l3 = axpy4(q, 0.5 * h, dq2), axpy(l, 0.5 * h, dl2)
        dq3, dl3 = derivative(body, total_torque(effects, body, t + 0.5 * h, q3, l3), q3, l3)
        q4, l4 = axpy4(q, h, dq3), axpy(l, h, dl3)
        dq4, dl4 = derivative(body, total_torque(effects, body, t + h, q4, l4), q4, l4)
        q = axpy4(axpy4(q, h / 6.0, axpy4(dq1, 1.0, dq4)), h / 3.0, axpy4(dq2, 1.0, dq3))
        l = axpy(axpy(l, h / 6.0, axpy(dl1, 1.0, dl4)), h / 3.0, axpy(dl2, 1.0, dl3))
        return renormalise(q), l
