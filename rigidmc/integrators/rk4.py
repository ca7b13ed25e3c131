"""Classical Runge-Kutta."""

from typing import NamedTuple

from rigidmc.dynamics.euler import increments, scaled
from rigidmc.dynamics.so3 import add, add4, axpy, axpy4, renormalise
from rigidmc.effects.verbs import push


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
        # Increments over h/2 throughout, so that each rate is scaled once and the sums are additions, which cost no multiplier.
        half = scaled(body, 0.5 * h)
        dq1, dl1 = increments(half, q, l)
        dl1 = push(effects, body, t, 0.5 * h, q, l, dl1)
        q2, l2 = add4(q, dq1), add(l, dl1)
        dq2, dl2 = increments(half, q2, l2)
        dl2 = push(effects, body, t + 0.5 * h, 0.5 * h, q2, l2, dl2)
        q3, l3 = add4(q, dq2), add(l, dl2)
        dq3, dl3 = increments(half, q3, l3)
        dl3 = push(effects, body, t + 0.5 * h, 0.5 * h, q3, l3, dl3)
        q4, l4 = add4(q, add4(dq3, dq3)), add(l, add(dl3, dl3))
        dq4, dl4 = increments(half, q4, l4)
        dl4 = push(effects, body, t + h, 0.5 * h, q4, l4, dl4)
        q = axpy4(q, 1.0 / 3.0, axpy4(add4(dq1, dq4), 2.0, add4(dq2, dq3)))
        l = axpy(l, 1.0 / 3.0, axpy(add(dl1, dl4), 2.0, add(dl2, dl3)))
        return renormalise(q), l
