"""Lagrange and free tops that start upright or hanging, exactly or within 1e-8.

The reference is srkn11 in short steps with compensated sums.
"""

import numpy as np
import pytest

from rigidmc import Gravity, solve_free_top, solve_lagrange_top
from rigidmc.engine.kernel import layout as K
from rigidmc.mechanics.rotation import attitude_error
from rigidmc.physics.dynamics.euler import MassProperties
from rigidmc.physics.integrators import INTEGRATORS
from rigidmc.physics.observables import OBSERVABLES
from tests.tools.kernels import make_block, prepare, run

MEMBERS, END, SAVES = 2000, 6.0, 12
TIMES = np.linspace(0.0, END, SAVES + 1)[:, None]
OBSERVED = (OBSERVABLES["attitude"](), OBSERVABLES["momentum"]())


def starts(tilt, seed=0):
    """(moments, weight, momentum, attitude) of upright or hanging tops, degenerate ones included.

    tilt : 0 for exactly vertical, else tilts from 1e-17 to this
    """
    some = np.random.default_rng(seed)
    across, along = np.exp(some.uniform(-1, 1, MEMBERS)), some.uniform(0.2, 1.95, MEMBERS)
    moments = np.stack([across, across, across * along], -1)
    weight = np.exp(some.uniform(-2, 2, MEMBERS)) * some.choice([-1.0, 1.0], MEMBERS)
    weight[some.random(MEMBERS) < 0.1] = 0.0
    momentum = some.normal(size=(MEMBERS, 3)) * np.exp(some.uniform(-2, 2, (MEMBERS, 1)))
    momentum[some.random(MEMBERS) < 0.2, 2] = 0.0
    momentum[some.random(MEMBERS) < 0.2, :2] = 0.0
    momentum[some.random(MEMBERS) < 0.1, 0] = 0.0
    turn = np.where(
        some.random(MEMBERS) < 0.4, some.choice([0.0, 1.0], MEMBERS), some.uniform(0, 2, MEMBERS)
    )
    c, s, none = np.cos(0.5 * np.pi * turn), np.sin(0.5 * np.pi * turn), np.zeros(MEMBERS)
    c[turn == 1.0] = 0.0
    hangs = some.random((MEMBERS, 1)) < 0.5
    attitude = np.where(hangs, np.stack([none, c, s, none], -1), np.stack([c, none, none, s], -1))
    if tilt:
        size = 10.0 ** some.uniform(-17, np.log10(tilt), (MEMBERS, 1))
        attitude = attitude + size * some.normal(size=(MEMBERS, 4))
        attitude /= np.linalg.norm(attitude, axis=1)[:, None]
        small = some.random(MEMBERS) < 0.3
        momentum[small, :2] *= 10.0 ** some.uniform(-17, np.log10(tilt), (small.sum(), 1))
    smallest = moments.min(1)
    kinetic = 0.5 * (momentum**2 / moments).sum(1)
    rate = np.sqrt(2.0 * (kinetic + 2.0 * np.abs(weight)) / smallest)
    rate += np.sqrt(np.abs(weight) / smallest)
    rate[rate == 0.0] = 1.0
    return moments, weight / rate**2, momentum / rate[:, None], attitude


def free_starts(tilt, seed=0):
    """(moments, momentum, attitude) of free tops of rate 1.

    About an axis, across one, on the separatrix, with equal moments.

    tilt : 0 for exactly these, else off by 1e-17 to this
    """
    some = np.random.default_rng(seed)
    moments = some.uniform(0.6, 1.0, (MEMBERS, 3))
    alike = some.integers(0, 6, MEMBERS)  # 0, 1, 2: that axis is one of symmetry; 3: a sphere
    for axis in range(3):
        rows = alike == axis
        moments[rows, axis - 1] = moments[rows, axis - 2]
    moments[alike == 3] = moments[alike == 3, :1]
    momentum = some.normal(size=(MEMBERS, 3))
    momentum[some.random((MEMBERS, 3)) < 0.4] = 0.0
    order = np.argsort(moments, axis=1)
    rows = np.flatnonzero((alike > 3) & (some.random(MEMBERS) < 0.3))
    low, middle, high = (moments[rows, order[rows, i]] for i in range(3))
    # L_low/L_high = sqrt(I_low (I_high - I_mid)/(I_high (I_mid - I_low))): 2 T I_mid = L^2
    momentum[rows, order[rows, 0]] = np.sqrt(low * (high - middle))
    momentum[rows, order[rows, 2]] = np.sqrt(high * (middle - low))
    if tilt:
        size = 10.0 ** some.uniform(-17, np.log10(tilt), (MEMBERS, 1))
        momentum += size * some.normal(size=momentum.shape)
        moments *= 1.0 + size * some.normal(size=moments.shape)
    size = np.linalg.norm(momentum, axis=1, keepdims=True)
    momentum /= np.where(size > 0.0, size, 1.0)
    attitude = some.normal(size=(MEMBERS, 4))
    return moments, momentum, attitude / np.linalg.norm(attitude, axis=1)[:, None]


def integrated(name, effects, moments, static, momentum, attitude):
    """(attitude, momentum) at SAVES times up to END and at the start, (times, members, ...)."""
    body, h = MassProperties.of(tuple(moments.T), tuple(static)), 0.02
    block = make_block(body, effects, attitude.T, momentum.T)
    made, steps = prepare(INTEGRATORS[name], 2.0 * h, effects), round(END / h)
    values = run(block, made, effects, h, steps, OBSERVED, steps // SAVES, compensated=True)
    assert not block[K.STATUS].any()
    values = np.moveaxis(values, 1, -1)[:, :MEMBERS]
    return values[..., :4], values[..., 4:]


def assert_alike(solve, name, effects, moments, static, momentum, attitude, most):
    """Compare a closed form with an integrator, forwards and backwards: the motion to -t is that of
    -L to t, with the momentum reversed. The errors are of the momentum (relative to that of a top
    of rate 1) and of the attitude [rad]."""
    for sign in (1.0, -1.0):
        q, l = integrated(name, effects, moments, static, sign * momentum, attitude)
        motion = solve(sign * TIMES)
        assert np.linalg.norm(sign * motion.momentum - l, axis=-1).max() < most
        # 5.4e-15 exactly vertical, 7.0e-14 within 1e-8, 4.8e-14 of free tops
        assert attitude_error(motion.attitude, q).max() < 2e-13


@pytest.mark.parametrize("axis", [3, 1])
@pytest.mark.parametrize("tilt", [0.0, 1e-8])
def test_tops_that_stand_or_hang_move_as_they_do_by_srkn11(tilt, axis):
    moments, weight, momentum, attitude = starts(tilt)
    if axis == 1:  # axes relabelled 3, 1, 2 -> 1, 2, 3
        moments, momentum = np.roll(moments, 1, 1), np.roll(momentum, 1, 1)
    static = np.zeros((3, MEMBERS))
    static[axis - 1] = weight

    def solve(t):
        return solve_lagrange_top(moments, weight, momentum, attitude, t, axis=axis)

    given = moments, static, momentum, attitude
    assert_alike(solve, "srkn11", (Gravity(1.0),), *given, 2e-14)  # measured 4.6e-15


@pytest.mark.parametrize("tilt", [0.0, 1e-8])
def test_free_tops_about_axes_and_on_separatrices_move_as_they_do_by_rk8(tilt):
    moments, momentum, attitude = free_starts(tilt)

    def solve(t):
        return solve_free_top(moments, momentum, attitude, t)

    given = moments, np.zeros((3, MEMBERS)), momentum, attitude
    assert_alike(solve, "rk8", (), *given, 1e-14)  # measured 2.7e-15


@pytest.mark.parametrize("scale", [1e-40, 1e40])
@pytest.mark.parametrize("low", [-200.0, -70.0])
def test_the_start_is_the_start_at_any_tilt_and_any_rate(scale, low):
    """Tilts and swings down to 1e-200, rates of 1e-40 and 1e40 rad/s: underflow counts as 0."""
    moments, weight, momentum, attitude = starts(0.0)
    some = np.random.default_rng(1)
    size = 10.0 ** some.uniform(low, -8, (MEMBERS, 1))
    attitude = attitude + size * some.normal(size=(MEMBERS, 4))
    momentum[:, :2] *= 10.0 ** some.uniform(low, 0, (MEMBERS, 1))
    found = solve_lagrange_top(moments, scale**2 * weight, scale * momentum, attitude, 0.0)
    assert np.linalg.norm(found.momentum / scale - momentum, axis=1).max() < 3e-15  # 5.2e-16
    # 1.1e-12, of tilts below 1e-40: K = 139 there
    assert attitude_error(found.attitude, attitude).max() < 4e-12
