"""All effects in one vectorised kernel, in float32 and with parameters per member.

The reference is plain Python in float64.
"""

import numpy as np
import pytest

import rigidmc as rm
from rigidmc.engine.kernel import layout as K
from rigidmc.physics.dynamics.euler import MassProperties
from rigidmc.physics.effects import canonical
from rigidmc.physics.effects.protocol import from_numbers, numbers
from rigidmc.physics.integrators import INTEGRATORS
from tests.physics.effects.test_effects import EXAMPLES, MOMENTS, STATIC
from tests.tools.kernels import make_block, one_step, prepare, run

STEPS, H, MEMBERS = 5, 0.02, 4


@pytest.mark.slow
def test_strang_with_the_flows_of_all_effects():
    some = np.random.default_rng(9)
    effects = canonical(tuple(EXAMPLES.values()))
    each = tuple(
        from_numbers(type(e), [v * some.uniform(0.8, 1.2, MEMBERS) for _, _, v in numbers(e)])
        for e in effects
    )
    body = MassProperties.of(MOMENTS, STATIC)
    q, l = some.normal(size=(4, MEMBERS)), some.normal(size=(3, MEMBERS))
    q /= np.linalg.norm(q, axis=0)
    block = make_block(body, each, q, l)
    made = prepare(INTEGRATORS["strang"], 0.2, effects)
    alone = block.copy()
    run(block, made, effects, H, STEPS, dtype=np.float32)
    run(alone, made, effects, H, STEPS, dtype=np.float32, lanes=1)
    assert np.array_equal(block, alone)  # the same bits side by side and one by one
    for m in range(MEMBERS):
        mine = tuple(from_numbers(type(e), [float(v[m]) for _, _, v in numbers(e)]) for e in each)
        at, now = tuple(q[:, m]), tuple(l[:, m])
        for i in range(STEPS):
            at, now = one_step(made, body, mine, i * H, H, at, now)
        assert np.abs(block[K.ATTITUDE : K.MOMENTUM, m] - at).max() < 5e-7  # measured 7e-8
        assert np.abs(block[K.MOMENTUM : K.EXTRA, m] - now).max() < 5e-6  # measured 1.6e-6
        assert np.abs(now - l[:, m]).max() > 0.05


def test_an_orbit_whose_cube_is_past_float32():
    body = rm.Body.from_moments((1.0, 1.1, 1.2))
    orbit, rest = rm.GravityGradient(1e20, 1e13, 0.3, -2.0), rm.Start(omega=(0.0, 0.0, 0.0))
    scene = rm.Scene(body, orbit, rest).with_run(dt=1.5e7, t_end=3e9, members=32)
    one, two = (rm.simulate(scene, dtype=d).omega.values[-1] for d in ("float64", "float32"))
    assert np.abs(one).max() > 1e-12
    assert np.abs(one - two).max() < 1e-4 * np.abs(one).max()


def test_vectors_of_each_members_own_go_to_a_file_and_back(tmp_path):
    matrix = (1.0, 1.0, 1.0, 0.0, rm.normal(0.0, 0.01), rm.uniform(0.1, 0.5))
    scene = rm.Scene(
        rm.Body.from_moments(MOMENTS), (rm.MatrixDamping(matrix),), rm.Start(omega=(0.1, 1.0, 0.2))
    )
    ds = rm.simulate(scene, members=100, t_end=1.0, output=str(tmp_path / "a.nc"))
    assert ds.matrix_damping_matrix.dims == ("component", "member")
    assert np.ptp(ds.matrix_damping_matrix.values[5]) > 0.3
    again = rm.simulate(rm.Scene.load(str(tmp_path / "a.nc")))
    assert np.array_equal(again.omega, ds.omega)
    assert np.array_equal(again.matrix_damping_matrix, ds.matrix_damping_matrix)
