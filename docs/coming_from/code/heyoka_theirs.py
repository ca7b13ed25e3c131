"""A heavy top to 1e-12, and 4,096 of them: heyoka."""

import os
from concurrent.futures import ThreadPoolExecutor
from copy import deepcopy
from functools import cache

import heyoka as hy
import numpy as np

MOMENTS, WEIGHT, T_END = (0.02, 0.02, 0.01), 0.981, 10.0  # kg m^2 about the tip, N m, s
TILT = 0.5  # rad


def equations():
    """Attitude q (body to space, scalar first) and angular velocity w in body axes."""
    q0, q1, q2, q3, w1, w2, w3 = hy.make_vars("q0", "q1", "q2", "q3", "w1", "w2", "w3")
    a, b, c = MOMENTS
    up1, up2 = 2.0 * (q1 * q3 - q0 * q2), 2.0 * (q2 * q3 + q0 * q1)  # vertical in body axes
    return [
        (q0, 0.5 * (-q1 * w1 - q2 * w2 - q3 * w3)),
        (q1, 0.5 * (q0 * w1 + q2 * w3 - q3 * w2)),
        (q2, 0.5 * (q0 * w2 + q3 * w1 - q1 * w3)),
        (q3, 0.5 * (q0 * w3 + q1 * w2 - q2 * w1)),
        (w1, ((b - c) * w2 * w3 + WEIGHT * up2) / a),
        (w2, ((c - a) * w3 * w1 - WEIGHT * up1) / b),
        (w3, (a - b) * w1 * w2 / c),
    ]


def starts(spins):
    """States (7, members): tilted about the x axis, spinning about axis 3."""
    state = np.zeros((7, len(spins)))
    state[0], state[1], state[6] = np.cos(TILT / 2), np.sin(TILT / 2), spins
    return state


def split(state):
    """Attitudes (members, 4) and angular velocities (members, 3)."""
    return state[:4].T, state[4:].T


@cache  # compiled once
def solver():
    return hy.taylor_adaptive(equations(), starts([30.0])[:, 0], tol=1e-16)


@cache
def batch_solvers():
    """One for each thread: compiled once, then copied."""
    width = hy.recommended_simd_size()
    first = hy.taylor_adaptive_batch(equations(), starts([30.0] * width), tol=1e-10)
    return [first, *(deepcopy(first) for _ in range(os.cpu_count() - 1))]


def one():
    top = solver()
    top.time, top.state[:] = 0.0, starts([30.0])[:, 0]
    top.propagate_until(T_END)
    return split(top.state[:, None])


def ensemble():
    state, solvers = starts(np.random.default_rng(1).normal(30.0, 1.0, 4096)), batch_solvers()
    width = solvers[0].batch_size

    def work(k):
        for low in range(k * width, state.shape[1], len(solvers) * width):
            solvers[k].set_time(0.0)
            solvers[k].state[:] = state[:, low : low + width]
            solvers[k].propagate_until(T_END)
            state[:, low : low + width] = solvers[k].state

    with ThreadPoolExecutor(len(solvers)) as pool:
        list(pool.map(work, range(len(solvers))))
    return split(state)


if __name__ == "__main__":
    attitude, omega = one()
    print("attitude", attitude[0], "omega", omega[0])
    attitude, omega = ensemble()
    print("ensemble", attitude.shape, omega.mean(axis=0))
