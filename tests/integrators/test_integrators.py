"""One loop over INTEGRATORS: order, there and back, conservation, agreement with naive NumPy. A new one is tested by its facts."""

import math
from dataclasses import replace
from functools import cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from rigidmc.dynamics.euler import angular_velocity, kinetic_energy
from rigidmc.effects import Gravity, ViscousDamping
from rigidmc.engine import kernel as K
from rigidmc.integrators import INTEGRATORS
from rigidmc.integrators.verbs import step
from rigidmc.observables import Attitude, Energy, Momentum
from tests.kernels import block_of, march, prepare, run, turn
from tests.problems import PROBLEMS
from tests.reference import NAIVE, attitude_error, naive_rk4, rotation, true_end

FREE, HEAVY = PROBLEMS["hairer_free"], PROBLEMS["hairer_heavy"]
DAMPING = 0.1
EVERY = pytest.mark.parametrize("name", INTEGRATORS)
ANY_TORQUE = pytest.mark.parametrize("name", [n for n, i in INTEGRATORS.items() if i.accepts != "no torque"])


def end_error(name, problem, steps, effects=None, end=None):
    """Largest error of the final momentum [of its size] and attitude [rad]; one kernel for all step sizes."""
    q, l = end or (problem.end_attitude, problem.end_momentum)
    kind = INTEGRATORS[name]
    coarse, pieces = prepare(kind, turn(problem, problem.time / 50))
    integrator = coarse if pieces == 1 else None
    at, momentum = march(kind, [problem], problem.time / steps, steps, effects, integrator)
    return max(np.abs(momentum[:, 0] - l).max() / np.linalg.norm(l), attitude_error(at[:, 0], q))


def orders(errors):
    return [math.log2(a / b) for a, b in pairwise(errors)]


@EVERY
def test_order_for_a_free_body(name):
    errors = [end_error(name, FREE, n) for n in (50, 200, 400, 800)]
    if "T" in INTEGRATORS[name].conserves:  # the free motion itself, at any step
        assert max(errors) < 1e-13  # measured 1.4e-14
    else:
        assert errors[-1] > 1e-10  # measured 2e-8 and 2e-9: above rounding, so that the order means something
        assert abs(orders(errors)[-1] - INTEGRATORS[name].order) < 0.15  # measured 4.001 and 4.008


@ANY_TORQUE
def test_order_for_a_heavy_body(name):
    errors = [end_error(name, HEAVY, n) for n in (400, 800, 1600)]
    assert errors[-1] > 1e-10
    assert abs(orders(errors)[-1] - INTEGRATORS[name].order) < 0.15  # measured 4.02, 4.12, 2.000


@cache
def damped_end():
    return true_end(HEAVY, HEAVY.time, DAMPING)


@ANY_TORQUE
def test_order_with_damping(name):
    errors = [end_error(name, HEAVY, n, (Gravity(HEAVY.gravity), ViscousDamping(DAMPING)), damped_end()) for n in (200, 400, 800)]
    assert abs(orders(errors)[-1] - INTEGRATORS[name].order) < 0.15  # measured 4.007, 3.909, 2.000


class Wind(NamedTuple):
    """A torque that depends on time."""

    size: float

    def torque(self, t):
        return self.size * math.cos(3.0 * t), 0.0, self.size * t


@ANY_TORQUE
def test_order_with_a_torque_that_depends_on_time(name):
    """In plain Python: what runs compiled runs uncompiled too."""
    body, start = FREE.body, np.array([1.0, 0.0, 0.0, 0.0, *FREE.momentum])

    def rates(t, y):
        w = angular_velocity(body, y[4:])
        spin = np.array([[0, -w[0], -w[1], -w[2]], [w[0], 0, w[2], -w[1]], [w[1], -w[2], 0, w[0]], [w[2], w[1], -w[0], 0]])
        return np.concatenate([0.5 * spin @ y[:4], np.cross(y[4:], w) + Wind(0.7).torque(t)])

    true = solve_ivp(rates, (0.0, 2.0), start, method="DOP853", rtol=3e-14, atol=1e-15).y[:, -1]
    errors = []
    for steps in (40, 80):
        h = 2.0 / steps
        integrator, _ = prepare(INTEGRATORS[name], 2.0 * turn(FREE, 2.0 / 40))
        q, l = tuple(start[:4]), tuple(start[4:])
        for i in range(steps):
            q, l = step(integrator, body, (Wind(0.7),), i * h, h, q, l)
        errors.append(max(attitude_error(q, true[:4]), np.abs(l - true[4:]).max()))
    assert abs(orders(errors)[0] - INTEGRATORS[name].order) < 0.15  # measured 3.996, 4.008, 2.000


@EVERY
def test_there_and_back(name):
    kind = INTEGRATORS[name]
    problem = FREE if kind.accepts == "no torque" else HEAVY
    h, steps = 0.2, 50
    integrator, pieces = prepare(kind, turn(problem, h))
    block = block_of([problem])
    start = block[: K.START].copy()
    for way in (h, -h):
        run(block, integrator, problem.effects, way / pieces, steps * pieces)
    error = np.abs(block[: K.START] - start).max()
    if kind.reversible:
        assert error < 8e-14  # measured 8e-15
    else:
        assert error > 1e-4  # measured 2e-3


def drifts(name, problem, h, steps):
    """Relative drift of what a free body keeps, and of |q|."""
    block = block_of([problem])
    integrator, pieces = prepare(INTEGRATORS[name], turn(problem, h))
    q0, l0 = block[:4, 0].copy(), block[4:7, 0].copy()
    run(block, integrator, (), h / pieces, steps * pieces)
    q, l = block[:4, 0], block[4:7, 0]
    return {
        "|q|": abs(q @ q - 1.0),
        "|L|^2": abs(l @ l / (l0 @ l0) - 1.0),
        "T": abs(kinetic_energy(problem.body, l) / kinetic_energy(problem.body, l0) - 1.0),
        "L in space": np.linalg.norm(rotation(q) @ l - rotation(q0) @ l0) / np.linalg.norm(l0),
    }


@EVERY
def test_conserves_what_it_says_and_nothing_else(name):
    for keep, drift in drifts(name, FREE, 0.15, 2000).items():
        if keep in INTEGRATORS[name].conserves:
            assert drift < 8e-14  # measured 8e-15
        elif keep != "|q|":  # rk4 does not keep it but puts it right
            assert drift > 1e-6  # measured 3e-5 to 6e-5
    assert set(INTEGRATORS[name].conserves) <= set(drifts(name, FREE, 0.15, 1))


@EVERY
def test_the_attitude_stays_on_the_sphere(name):
    assert drifts(name, FREE, 0.15, 2000)["|q|"] < 2e-15  # measured 2e-16


def test_rk4_without_its_normalisation_leaves_the_sphere():
    a, _ = naive_rk4(FREE, 0.15, 2000, normalised=False)
    assert abs(np.linalg.det(a) - 1.0) > 1e-3  # measured 0.015


def heavy_errors(name, h, seconds, saves):
    """Largest |E - E0| in each of `saves` equal spans, and of L_z over all, of the heavy body."""
    kind = INTEGRATORS[name]
    integrator, pieces = prepare(kind, turn(HEAVY, h))
    assert pieces == 1
    block = block_of([HEAVY])
    rows = run(block, integrator, HEAVY.effects, h, round(seconds / h), (Energy(), Attitude(), Momentum()), 4)[:, :, 0]
    energy = np.abs(rows[:, 0] - HEAVY.more["energy"])
    up = np.array([rotation(q)[2] for q in rows[:, 1:5]])
    lz = np.sum(up * rows[:, 5:], axis=1)
    return [max(part) for part in np.array_split(energy, saves)], np.abs(lz - lz[0]).max()


def test_a_splitting_keeps_lz_and_its_energy_error_does_not_grow():
    energy, lz = heavy_errors("strang", 0.1, 2000.0, 4)
    assert lz < 4e-13  # measured 8e-14 after 20,000 steps
    assert max(energy) < 1.05 * energy[0]  # measured 1.001: 0.0211 in each quarter of the time
    half = heavy_errors("strang", 0.05, 500.0, 1)[0][0]
    assert abs(math.log2(max(energy) / half) - 2.0) < 0.15  # measured 2.001


@pytest.mark.parametrize("name", ["rk4", "rkmk4"])
def test_runge_kutta_loses_energy_and_lz_with_time(name):
    energy, lz = heavy_errors(name, 0.1, 2000.0, 4)
    assert energy[3] > 3.0 * energy[0]  # measured 4.0: 0.002 in each quarter of the time
    assert lz > 1e-4  # measured 7e-3 and 1e-3


def naive_error(name, problem, h, steps, damping=0.0, **twin):
    """Largest difference of attitude matrix and relative momentum from the naive NumPy integrator."""
    effects = (*problem.effects, ViscousDamping(damping)) if damping else None
    q, l = march(INTEGRATORS[name], [problem], h, steps, effects)
    a, momentum = NAIVE[name](problem, h, steps, damping, **twin)
    return max(np.abs(rotation(q[:, 0]) - a).max(), np.abs(l[:, 0] - momentum).max() / np.linalg.norm(momentum))


@EVERY
def test_agrees_with_naive_numpy_on_a_free_body(name):
    assert naive_error(name, FREE, 0.15, 20) < 5e-14  # measured 8e-15


@ANY_TORQUE
def test_agrees_with_naive_numpy_on_heavy_bodies(name):
    assert naive_error(name, HEAVY, 0.15, 20) < 1.5e-13  # measured 1.6e-14
    assert naive_error(name, HEAVY, 0.15, 20, DAMPING) < 1.5e-13  # measured 1.4e-14
    assert naive_error(name, PROBLEMS["simo_wong_top"], 0.004, 30) < 5e-14  # measured 9e-15


def test_a_wrong_sign_in_the_commutator_is_caught():
    assert naive_error("rkmk4", HEAVY, 0.15, 20, half=-0.5) > 1e-3  # measured 0.011


def test_a_damped_free_top_is_a_free_top_at_another_time():
    """L(t) = exp(-rate t) L_free((1 - exp(-rate t))/rate), and the attitude is the free one of that time."""
    time = 5.0
    other = (1.0 - math.exp(-DAMPING * time)) / DAMPING
    end = true_end(FREE, other)
    end = end[0], math.exp(-DAMPING * time) * end[1]
    errors = {
        n: end_error(n, replace(FREE, time=time), 400, (Gravity(0.0), ViscousDamping(DAMPING)), end)
        for n in ("rk4", "rkmk4", "strang")
    }
    assert errors["rk4"] < 2e-8  # measured 4e-9
    assert errors["rkmk4"] < 5e-9  # measured 1e-9
    assert errors["strang"] < 2e-6  # measured 4e-7
    assert attitude_error(end[0], true_end(FREE, time)[0]) > 0.1  # at its own time it is elsewhere


def test_every_integrator_has_its_facts_and_its_naive_twin():
    assert set(NAIVE) == set(INTEGRATORS)
    for kind in INTEGRATORS.values():
        assert kind.order > 0
        assert kind.evaluations >= 1
        assert isinstance(kind.reversible, bool)
        assert kind.accepts in ("any torque", "torques with an exact flow", "no torque")
        assert "Source:" in kind.__doc__
