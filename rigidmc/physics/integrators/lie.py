"""Lie-group Runge-Kutta methods: the attitude moves by exponentials, so it stays on SO(3)."""

from typing import NamedTuple

from rigidmc.physics.dynamics.euler import angular_velocity, free_rate
from rigidmc.physics.dynamics.so3 import (
    add,
    add_compensated,
    apply_rotation,
    axpy,
    cross,
    exponential,
    multiply,
    scale,
    value_of,
)
from rigidmc.physics.effects.present import in_state
from rigidmc.physics.effects.sums import add_slip, push


def _rotation_rate(u, w):
    """Return du/dt of the rotation vector u in q = q0 exp(u), truncated for order 4.

    w + u x w/2 + u x (u x w)/12
    """
    # The next term of dexp^-1 is of order h^4 in a rate, h^5 in a step.
    uw = cross(u, w)
    return axpy(axpy(w, 0.5, uw), 1.0 / 12.0, cross(u, uw))


class RKMK4(NamedTuple):
    """Runge-Kutta-Munthe-Kaas of order 4: classical Runge-Kutta on rotation vector and L.

    For any torque. At equal steps the error is 0.45 to 0.50 times that of rk4 for heavy tops and
    0.04 to 0.05 for free ones, at 3.6 and 2.6 times the cost (`python -m bench accuracy`). Energy
    and |L|^2 drift as h^5 t.
    Source: Munthe-Kaas, Appl. Numer. Math. 29 (1999) 115; truncated dexp^-1 as in Hairer, Lubich &
    Wanner 2006, IV.8.
    """

    order = 4
    evaluations = 4
    is_reversible = False
    conserves = ("|q|",)
    accepts = "any torque"
    compensated = True
    max_turn = 2.0
    is_contender = False
    drifts_like = "rk4"

    def step(self, body, effects, t, h, q, l):
        state, momentum = q, l
        q, l = value_of(q), value_of(l)
        w1 = angular_velocity(body, l)
        dl1 = _force(body, effects, t, q, l)
        u2, l2 = (0.5 * h * w1[0], 0.5 * h * w1[1], 0.5 * h * w1[2]), axpy(l, 0.5 * h, dl1)
        w2 = _rotation_rate(u2, angular_velocity(body, l2))
        dl2 = _force(body, effects, t + 0.5 * h, multiply(q, exponential(u2)), l2)
        u3, l3 = (0.5 * h * w2[0], 0.5 * h * w2[1], 0.5 * h * w2[2]), axpy(l, 0.5 * h, dl2)
        w3 = _rotation_rate(u3, angular_velocity(body, l3))
        dl3 = _force(body, effects, t + 0.5 * h, multiply(q, exponential(u3)), l3)
        u4, l4 = (h * w3[0], h * w3[1], h * w3[2]), axpy(l, h, dl3)
        w4 = _rotation_rate(u4, angular_velocity(body, l4))
        dl4 = _force(body, effects, t + h, multiply(q, exponential(u4)), l4)
        u = axpy(axpy((0.0, 0.0, 0.0), h / 6.0, add(w1, w4)), h / 3.0, add(w2, w3))
        dl = axpy(scale(h / 6.0, add(dl1, dl4)), h / 3.0, add(dl2, dl3))
        return apply_rotation(state, exponential(u)), add_compensated(momentum, dl)


def _force(body, effects, t, q, l):
    """Return dL/dt."""
    return push(effects, body, t, 1.0, q, l, free_rate(body, l))


def _turning(body, effects, t, q, l):
    """Return the angular velocity of the body, including the `slip` of effects."""
    present = in_state(effects, l[3:])
    return add_slip(present, body, t, 2.0, q, l, angular_velocity(body, l))


class CF4(NamedTuple):
    """Commutator-free Lie-group method of order 4: five exponentials; L by classical Runge-Kutta.

    For any torque. At equal steps the error is 0.84 to 0.90 times that of rkmk4 for heavy tops and
    0.33 for free ones, at 1.1 times the cost (`python -m bench accuracy`). Energy and |L|^2 drift
    as h^5 t.
    Source: Celledoni, Marthinsen & Owren, Future Gener. Comput. Syst. 19 (2003) 341, the method
    with stage 4 from stage 2.
    """

    order = 4
    evaluations = 4
    is_reversible = False
    conserves = ("|q|",)
    accepts = "any torque"
    compensated = True
    slips = True
    max_turn = 2.0
    is_contender = False
    drifts_like = "rk4"

    def step(self, body, effects, t, h, q, l):
        state, momentum = q, l
        q, l = value_of(q), value_of(l)
        w1 = _turning(body, effects, t, q, l)
        dl1 = _force(body, effects, t, q, l)
        # Stage 4 starts from stage 2: this exponential serves both, so the step needs five.
        half = exponential(scale(0.5 * h, w1))
        q2, l2 = multiply(q, half), axpy(l, 0.5 * h, dl1)
        w2 = _turning(body, effects, t + 0.5 * h, q2, l2)
        dl2 = _force(body, effects, t + 0.5 * h, q2, l2)
        q3, l3 = multiply(q, exponential(scale(0.5 * h, w2))), axpy(l, 0.5 * h, dl2)
        w3 = _turning(body, effects, t + 0.5 * h, q3, l3)
        dl3 = _force(body, effects, t + 0.5 * h, q3, l3)
        q4, l4 = multiply(q2, exponential(scale(h, axpy(w3, -0.5, w1)))), axpy(l, h, dl3)
        w4 = _turning(body, effects, t + h, q4, l4)
        dl4 = _force(body, effects, t + h, q4, l4)
        middle = add(w2, w3)
        first = scale(h / 12.0, axpy(axpy(scale(2.0, middle), 3.0, w1), -1.0, w4))
        last = scale(h / 12.0, axpy(axpy(scale(2.0, middle), 3.0, w4), -1.0, w1))
        dl = axpy(scale(h / 6.0, add(dl1, dl4)), h / 3.0, add(dl2, dl3))
        return apply_rotation(
            state, multiply(exponential(first), exponential(last))
        ), add_compensated(momentum, dl)


def _low_storage(body, effects, t, h, a, b, u, v, r, q, l, dl):
    """Make one stage: u <- a u + h omega, r <- r exp(b u); v <- a v + h dL/dt, dl <- dl + b v."""
    now = add(l, dl)
    u = axpy(scale(a, u), h, angular_velocity(body, now))
    v = axpy(scale(a, v), h, _force(body, effects, t, multiply(q, r), now))
    return u, v, multiply(r, exponential(scale(b, u))), axpy(dl, b, v)


class CK45(NamedTuple):
    """Commutator-free Lie-group method of order 4 in low storage: one exponential a stage.

    For any torque. At equal steps the error is 0.39 to 0.46 times that of rkmk4 for heavy tops and
    0.21 to 0.22 for free ones, at 1.4 and 2.7 times the cost (`python -m bench accuracy`). Energy
    and |L|^2 drift as h^5 t.
    Source: Carpenter & Kennedy, NASA TM-109112 (1994), RK4(3)5[2N]; on groups Bazavov, arXiv
    2007.04225.
    """

    order = 4
    evaluations = 5
    is_reversible = False
    conserves = ("|q|",)
    accepts = "any torque"
    compensated = True
    max_turn = 2.0
    is_contender = False
    drifts_like = "rk4"

    def step(self, body, effects, t, h, q, l):
        at, now = value_of(q), value_of(l)
        # Rational coefficients of a two-register method: a, b of each stage, and c, its time in
        # units of the step.
        b = 1432997174477.0 / 9575080441755.0
        u, v = scale(h, angular_velocity(body, now)), scale(h, _force(body, effects, t, at, now))
        r, dl = exponential(scale(b, u)), scale(b, v)
        c, a, b = b, -567301805773.0 / 1357537059087.0, 5161836677717.0 / 13612068292357.0
        u, v, r, dl = _low_storage(body, effects, t + c * h, h, a, b, u, v, r, at, now, dl)
        c = 2526269341429.0 / 6820363962896.0
        a, b = -2404267990393.0 / 2016746695238.0, 1720146321549.0 / 2090206949498.0
        u, v, r, dl = _low_storage(body, effects, t + c * h, h, a, b, u, v, r, at, now, dl)
        c = 2006345519317.0 / 3224310063776.0
        a, b = -3550918686646.0 / 2091501179385.0, 3134564353537.0 / 4481467310338.0
        u, v, r, dl = _low_storage(body, effects, t + c * h, h, a, b, u, v, r, at, now, dl)
        c = 2802321613138.0 / 2924317926251.0
        a, b = -1275806237668.0 / 842570457699.0, 2277821191437.0 / 14882151754819.0
        u, v, r, dl = _low_storage(body, effects, t + c * h, h, a, b, u, v, r, at, now, dl)
        return apply_rotation(q, r), add_compensated(l, dl)


INTEGRATORS = {"rkmk4": RKMK4(), "cf4": CF4(), "ck45": CK45()}
