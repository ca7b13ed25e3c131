"""One loop over INTEGRATORS, compiled: reversibility and conservation.

A new integrator is tested according to its facts. Its order is tested in plain Python
(test_steps.py), which is the compiled code (tests/engine/kernel/test_kernel.py).
"""

import math

import numpy as np
import pytest

from bench.problems.published import PROBLEMS
from rigidmc.engine.kernel import layout as K
from rigidmc.physics.dynamics.euler import kinetic_energy
from rigidmc.physics.integrators import INTEGRATORS
from rigidmc.physics.observables import Attitude, Energy, Momentum
from tests.tools.kernels import block_of, prepare, run, stepping, turn
from tests.tools.reference import rotation

FREE, HEAVY = PROBLEMS["hairer_free"], PROBLEMS["hairer_heavy"]
# it makes no steps: see tests/planning/test_closed_form.py
EVERY = pytest.mark.parametrize("name", stepping())


@EVERY
def test_there_and_back(name):
    kind = INTEGRATORS[name]
    problem = FREE if kind.accepts == "no torque" else HEAVY
    h, steps = (0.5, 20) if kind.order > 8 else (0.2, 50)
    made = prepare(kind, turn(problem, h), problem.effects)
    block = block_of([problem])
    start = block[: K.EXTRA].copy()
    for way in (h, -h):
        run(block, made, problem.effects, way, steps)
    error = np.abs(block[: K.EXTRA] - start).max()
    if kind.is_reversible:
        assert error < 3e-13
    else:
        assert error > 1e-8


def drifts(name, problem, h, steps):
    """Relative drift of what a free body keeps, and of |q|."""
    block = block_of([problem])
    q0, l0 = block[:4, 0].copy(), block[4:7, 0].copy()
    run(block, prepare(INTEGRATORS[name], turn(problem, h)), (), h, steps)
    q, l = block[:4, 0], block[4:7, 0]
    return {
        "|q|": abs(q @ q - 1.0),
        "|L|^2": abs(l @ l / (l0 @ l0) - 1.0),
        "T": abs(kinetic_energy(problem.body, l) / kinetic_energy(problem.body, l0) - 1.0),
        "L in space": np.linalg.norm(rotation(q) @ l - rotation(q0) @ l0) / np.linalg.norm(l0),
    }


@EVERY
def test_conserves_what_it_says_and_nothing_else(name):
    h = 0.5 if 8 < INTEGRATORS[name].order < math.inf else 0.15
    for keep, drift in drifts(name, FREE, h, 2000).items():
        if keep in INTEGRATORS[name].conserves:
            assert drift < 8e-14  # measured 8e-15
        elif keep != "|q|":  # rk4 does not conserve |q| but restores it
            assert drift > 1e-12
    assert set(INTEGRATORS[name].conserves) <= set(drifts(name, FREE, 0.15, 1))


@EVERY
def test_the_attitude_stays_on_the_sphere(name):
    assert drifts(name, FREE, 0.15, 2000)["|q|"] < 2e-15  # measured 2e-16


def heavy_errors(name, h, seconds, saves):
    """Largest |E - E0| in each of `saves` equal spans, and of L_z over all, of the heavy body."""
    made = prepare(INTEGRATORS[name], turn(HEAVY, h), HEAVY.effects)
    saved, block, steps = (Energy(), Attitude(), Momentum()), block_of([HEAVY]), round(seconds / h)
    rows = run(block, made, HEAVY.effects, h, steps, saved, 4)[:, :, 0]
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
