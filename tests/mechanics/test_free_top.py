"""The exact free top against 26-digit Taylor series and 50-digit classical forms.

Also the facts that it states about a motion, and bad input.
"""

import itertools

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bench.problems.published import HARD, PROBLEMS
from rigidmc import SceneError, analyse_free_top, solve_free_top
from rigidmc.mechanics.rotation import attitude_error, matrix, rotation_vector
from tests.mechanics import oracles
from tests.tools import reference
from tests.tools.reference import apart, off

RNG = np.random.default_rng(42)
START = (1.0, 0.0, 0.0, 0.0)


def cases():
    """Yield (moments, momentum, attitude, time, truth, bounds of both errors)."""
    for moments, l in HARD.values():  # measured 5.9e-16, 2.2e-14
        yield moments, l, START, 5.0, reference.taylor, (2e-15, 5e-14)
    for moments in itertools.permutations((1.0, 1.3, 2.0)):  # measured 4.5e-16, 4.6e-15
        l, q = RNG.normal(size=3), tuple(Rotation.random(rng=RNG).as_quat(scalar_first=True))
        yield moments, l, q, -7.3, reference.taylor, (4e-15, 2e-14)
    for _ in range(8):  # measured 3.6e-13, 1.4e-12
        moments, l = np.sort(RNG.uniform(0.5, 1.0, 3)), RNG.normal(size=3)
        yield moments, l, START, 5000.0, oracles.free, (5e-12, 2e-11)


@pytest.mark.parametrize(("moments", "l", "q", "t", "truth", "bounds"), [*cases()])
def test_hard_bodies_any_order_and_far_times(moments, l, q, t, truth, bounds):
    assert (off(solve_free_top(moments, l, q, t), truth(moments, l, t, q)) < np.array(bounds)).all()


def test_oracles_agree_with_taylor_series():
    moments = (0.6, 0.8, 1.0)
    for l in ((1.8, 0.4, -0.9), (0.3, 0.4, 0.9)):
        (q, end), (p, other) = oracles.free(moments, l, 3.0), reference.taylor(moments, l, 3.0)
        assert max(off(solve_free_top(moments, l, START, 3.0), (q, end))) < 1e-14  # 6.4e-16
        assert apart(end, other) < 1e-30  # 7.3e-41
        assert attitude_error(np.array(q, float), np.array(p, float)) < 1e-16  # 0.0e+00


def test_invariants_and_the_broken_twin():
    moments, l = np.sort(RNG.uniform(0.5, 1.0, (2000, 1, 3)), -1), RNG.normal(size=(2000, 1, 3))
    motion = solve_free_top(moments, l, START, np.array([0.1, 3.0, 500.0]))
    for weight in (1.0, moments):
        before, after = (l**2 / weight).sum(-1), (motion.momentum**2 / weight).sum(-1)
        assert apart(after / before, 1.0) < 2e-15  # 1.0e-15
        assert np.abs(1.001**2 * after / before - 1.0).min() > 1e-3
    space = np.einsum("...ij,...j->...i", matrix(motion.attitude), motion.momentum)
    assert apart((space - l) / np.linalg.norm(l, axis=-1, keepdims=True)) < 3e-15  # 7.1e-16


def test_time_is_a_group():
    moments, l = (1.0, 1.7, 2.1), (0.4, 1.1, -0.3)
    first, one = (solve_free_top(moments, l, START, t) for t in (3.7, 9.8))
    two = solve_free_top(moments, first.momentum, first.attitude, 6.1)
    assert max(off(two, (one.attitude, one.momentum))) < 1e-14  # 4.4e-16, 2.9e-15
    back = solve_free_top(moments, one.momentum, one.attitude, -9.8)
    assert max(off(back, (START, l))) < 1e-14  # 8.3e-16, 3.2e-15
    assert apart(solve_free_top(moments, l, START, 0.0).momentum, l) < 1e-15  # 2.2e-16


@pytest.mark.parametrize("name", [n for n, p in PROBLEMS.items() if "flip" in p.more])
def test_flip_intervals(name):
    problem = PROBLEMS[name]
    found = analyse_free_top(problem.moments, problem.momentum).flip_interval
    assert found == pytest.approx(problem.more["flip"], rel=2e-15)


@pytest.mark.parametrize("name", ["hairer_free", "toms903_run", "hairer_lubich_wanner"])
def test_published_ends(name):
    p = PROBLEMS[name]
    motion = solve_free_top(p.moments, p.momentum, START, p.time)
    assert np.abs(motion.momentum - p.end_momentum).max() < 5e-15  # 3.4e-15


def test_a_period_turns_the_attitude_by_turn_and_the_momentum_sweeps_montgomerys_angle():
    for moments, l in (
        ((0.6, 0.8, 1.0), (1.8, 0.4, -0.9)),
        ((1.0, 2.0, 3.0), (0.2, 0.3, 1.0)),
        ((2.0, 1.0, 2.5), (0.9, 0.2, 0.3)),
    ):
        what = analyse_free_top(moments, l)
        end, u = solve_free_top(moments, l, START, what.period), np.array(l) / np.linalg.norm(l)
        assert np.abs(end.momentum - l).max() < 1e-14  # 2.2e-16
        angle = rotation_vector(end.attitude) @ u
        assert np.remainder(angle - what.turn + 1.0, 2 * np.pi) == pytest.approx(1.0, abs=1e-13)
        path = solve_free_top(moments, l, START, np.linspace(0.0, 1.0, 4001) * what.period).momentum
        a, b = (path / np.linalg.norm(l))[:-1], (path / np.linalg.norm(l))[1:]
        # spherical triangles from a fixed pole, with their sign
        pole = np.eye(3)[what.axis - 1] * np.sign(l[what.axis - 1])
        triple = (pole * np.cross(a, b)).sum(-1)
        swept = 2.0 * np.arctan2(triple, 1.0 + (a * b).sum(-1) + a @ pole + b @ pole).sum()
        assert abs(np.remainder(what.solid_angle - swept + 1.0, 4 * np.pi) - 1.0) < 1e-5
        # the wrong version that sweeps the other way
        assert abs(np.remainder(what.solid_angle + swept + 1.0, 4 * np.pi) - 1.0) > 0.1


def test_kinds_of_motion():
    cases = {
        "rest": ((1, 2, 3), (0, 0, 0)),
        "permanent rotation": ((1, 2, 3), (0, -1, 0)),
        "symmetric precession": ((1, 1, 1.5), (0.1, 0.2, 0.3)),
        "about the largest moment": ((1, 2, 3), (0.1, 0.2, 1.0)),
        "about the smallest moment": ((3, 2, 1), (0.1, 0.2, 1.0)),
        "separatrix": ((1.0, 2.0, 3.0), (1.0, 1.0, np.sqrt(3.0))),
    }
    for kind, (moments, l) in cases.items():
        assert analyse_free_top(moments, l).kind == kind
    assert analyse_free_top((1, 1, 1), (1, 2, 3)).kind == "permanent rotation"


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("t", [-1e4, 1e4])
def test_spins_about_principal_axes_stay_put(axis, t):
    l = -1.3 * np.eye(3)[axis]
    motion = solve_free_top((1.0, 2.0, 3.0), l, START, t)
    assert np.abs(motion.momentum - l).max() < 1e-15  # 2.2e-16
    half = 0.5 * l[axis] / (axis + 1.0) * t
    q = np.cos(half), *(np.sin(half) * np.eye(3)[axis])
    assert attitude_error(motion.attitude, q) < 1e-11  # 1.7e-16


def test_impossible_input_is_refused_in_a_sentence():
    with pytest.raises(SceneError, match="positive"):
        solve_free_top((1, 1, -3), (1, 0, 0), START, 1.0)
    with pytest.raises(SceneError, match=r"moments \(2,\), momentum \(3,\)"):
        solve_free_top(np.ones((2, 3)), np.ones((3, 3)), START, 1.0)
    with pytest.raises(SceneError, match=r"times \(5,\) do not broadcast against bodies \(4,\)"):
        solve_free_top(np.ones((4, 3)), np.ones((4, 3)), START, np.ones(5))
    with pytest.raises(SceneError, match="must have 3 components"):
        solve_free_top(np.ones(2), np.ones(3), START, 1.0)


def test_shapes_broadcast_and_scipys_rotations_are_taken():
    q = Rotation.random(5, rng=RNG)
    motion = solve_free_top(
        np.array([1.0, 2.0, 2.5]), RNG.normal(size=(5, 3)), q, np.linspace(0, 1, 4)[:, None]
    )
    assert motion.attitude.shape == (4, 5, 4)
    assert attitude_error(motion.attitude[0], q).max() < 2e-15  # 8.8e-16
