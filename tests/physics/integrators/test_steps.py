"""Steps in plain Python, nothing compiled: a broken step fails here within seconds."""

import math
import re
from functools import cache
from typing import NamedTuple

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from bench.problems.published import PROBLEMS
from rigidmc.physics.dynamics.euler import angular_velocity
from rigidmc.physics.dynamics.so3 import cross, scale, value_of, vertical
from rigidmc.physics.effects.sums import total_torque
from rigidmc.physics.integrators import INTEGRATORS, description, integrators_for, rk8
from rigidmc.physics.integrators.protocol import precompute, step, to_stepping
from tests.tools.kernels import one_step, prepare, turn
from tests.tools.reference import apart, attitude_error

FREE = PROBLEMS["hairer_heavy"]  # without weight, if no effect acts
GRAVITY = FREE.effects
SECONDS = 2.0


class Wind(NamedTuple):
    """A torque that depends on time."""

    size: float

    def torque(self, t):
        return self.size * math.cos(3.0 * t), 0.0, self.size * t

    def torque_rate(self, w):
        return 0.0, 0.0, 0.0


class Fading(NamedTuple):
    """Damping whose rate depends on time."""

    rate: float

    def torque(self, t, l):
        return scale(-self.rate * (1.0 + math.sin(3.0 * t)), l)

    def kick(self, t, h, l):
        return scale(math.exp(-h * self.rate * (1.0 + math.sin(3.0 * t))), l)


@cache
def true_end(effects):
    """(q, L) of the body of Hairer after SECONDS, by an adaptive Runge-Kutta method of order 8."""
    body = FREE.body

    def rates(t, y):
        q, l = y[:4], y[4:]
        x, y, z = w = angular_velocity(body, l)
        spin = np.array([[0, -x, -y, -z], [x, 0, z, -y], [y, -z, 0, x], [z, y, -x, 0]])
        return np.concatenate(
            [0.5 * spin @ q, np.cross(l, w) + total_torque(effects, body, t, q, l)]
        )

    start = np.array([1.0, 0.0, 0.0, 0.0, *FREE.momentum])
    solution = solve_ivp(rates, (0.0, SECONDS), start, method="DOP853", rtol=3e-14, atol=1e-15)
    return solution.y[:, -1]


def end(name, effects, steps, compensated=False):
    """(q, L) of the body of Hairer after SECONDS."""
    h = SECONDS / steps
    made = prepare(INTEGRATORS[name], 2.0 * turn(FREE, h), effects)
    q, l = (1.0, 0.0, 0.0, 0.0), FREE.momentum
    if compensated:
        q, l = (q, (0.0,) * 4), (l, (0.0,) * 3)
    for i in range(steps):
        q, l = one_step(made, FREE.body, effects, i * h, h, q, l)
    return value_of(q), value_of(l)


def error(name, effects, steps, compensated=False):
    """The largest error of attitude [rad] and momentum after SECONDS."""
    (q, l), true = end(name, effects, steps, compensated), true_end(effects)
    return max(attitude_error(q, true[:4]), apart(l, true[4:]))


def measured_order(name, effects, few, compensated=False):
    """log2 of the ratio of the errors of `few` and of twice as many steps."""
    coarse, fine = (error(name, effects, n, compensated) for n in (few, 2 * few))
    return math.log2(coarse / fine)


@pytest.mark.parametrize("name", [name for name in INTEGRATORS if name != "closed"])
def test_the_order_of_steps_of_a_free_body(name):
    kind = INTEGRATORS[name]
    if "T" in kind.conserves and name != "midpoint":  # exact for a free body at any step
        assert error(name, (), 5) < 3e-14  # measured 6e-15
    else:
        order = measured_order(name, (), {2: 40, 4: 40, 8: 10, 12: 3}.get(kind.order, 20))
        # measured 0.07 for rk8, 0.01 for the others
        assert abs(order - kind.order) < (0.6 if kind.order == 12 else 0.15)


@pytest.mark.parametrize("name", [name for name in integrators_for(GRAVITY) if name != "closed"])
def test_the_order_of_steps_with_gravity(name):
    order = INTEGRATORS[name].order
    few = {2: 100, 6: 14, 8: 10, 12: 3}.get(order, 80)
    assert abs(measured_order(name, GRAVITY, few) - order) < (0.3 if order == 12 else 0.15)


@pytest.mark.parametrize(("name", "compensated", "effect"), [
    (name, compensated, effect)
    for effect in (Wind(0.7), Fading(0.3))
    for compensated in (False, True)
    for name in integrators_for((effect,), compensated)
    if name != "closed"
])  # fmt: skip
def test_order_with_a_torque_that_depends_on_time(name, compensated, effect):
    """Each part of a step takes the torque at its own time."""
    kind = INTEGRATORS[name]
    few = {2: 40, 4: 40, 6: 8, 8: 6, 12: 3}.get(kind.order, 20)
    order = measured_order(name, (effect,), few, compensated)
    # aba864 and aba1064 reach orders 8 and 10 only if torques are small
    off = 1.2 if kind.order == 12 else 0.4  # errors of three long steps are far from their limit
    assert abs(order - kind.order) < off or (name.startswith("aba") and order > 4.0)


class Leaning(NamedTuple):
    """A torque of attitude that comes from no potential: the force gradient of chin4 is a
    commutator, not a gradient.
    """

    size: float

    def torque(self, q):
        u = vertical(q)
        return self.size * u[1], self.size * u[2], -self.size * u[0]

    def torque_rate(self, q, w):
        u = cross(vertical(q), w)
        return self.size * u[1], self.size * u[2], -self.size * u[0]


def test_chin4_is_of_order_4_where_there_is_no_potential():
    assert abs(measured_order("chin4", (Leaning(0.9),), 20) - 4.0) < 0.15


OF_TORQUES = "torques with an exact flow", "torques of attitude and time"
ACCEPTS = "any torque", *OF_TORQUES, "no torque", "free tops"


def test_every_integrator_has_its_facts():
    for name, kind in INTEGRATORS.items():
        assert kind.order > 0
        assert isinstance(kind.is_reversible, bool)
        assert isinstance(kind.compensated, bool)
        assert set(kind.conserves) <= {"|q|", "|L|^2", "T", "L in space"}
        assert kind.accepts.startswith(ACCEPTS)
        assert "Source:" in description(INTEGRATORS[name])


TIMES: list[float] = []


class Clock(NamedTuple):
    """A torque of zero that writes down the times at which a step asks for it."""

    def torque(self, t):
        TIMES.append(t)
        return 0.0, 0.0, 0.0

    def torque_rate(self):
        return 0.0, 0.0, 0.0


@pytest.mark.parametrize("name", [name for name in INTEGRATORS if name != "closed"])
def test_a_step_asks_for_the_torques_of_its_facts(name):
    """What opens a run and closes it is not part of a step. Docstrings say the same."""
    kind = INTEGRATORS[name]
    effects = () if kind.accepts == "no torque" else (Clock(),)
    counted = []
    for steps in (1, 3):
        TIMES.clear()
        made = prepare(kind, 0.1, effects)
        lead, rows = 0.1 * made.substeps[0], 0.1 * made.substeps[1:]
        q, l = (1.0, 0.0, 0.0, 0.0), FREE.momentum
        q, l = to_stepping(made.integrator, FREE.body, effects, lead[3], tuple(lead[:3]), q, l)
        once = precompute(made.integrator, FREE.body, tuple(rows[0][:3]), l)
        for i in range(steps):
            for row in rows:
                t, part = 0.1 * i + row[3], tuple(row[:3])
                q, l = step(made.integrator, FREE.body, effects, t, 0.1, part, q, l, once)
        counted.append(len(TIMES))
    if name == "midpoint":  # as many as its steps are long
        kind = made.integrator
    assert counted[1] - counted[0] == 2 * kind.evaluations
    said = re.search(r"(\d+) torques a step", description(kind))
    assert said is None or int(said[1]) == kind.evaluations


def test_rk8_asks_for_torques_at_the_times_of_its_stages():
    """c_i is the sum of a_ij."""
    TIMES.clear()
    effects = (Clock(),)
    made = prepare(INTEGRATORS["rk8"], 0.1, effects)
    one_step(made, FREE.body, effects, 0.0, 1.0, (1.0, 0.0, 0.0, 0.0), FREE.momentum)
    stages = [sum(getattr(rk8, f"_A{i}")) for i in range(2, 13)]
    error = np.abs(np.subtract(TIMES, [0.0, *stages])).max()
    assert error < 2e-14  # measured 6e-15, the rounding of the table
