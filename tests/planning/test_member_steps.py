"""Steps of their own: each member makes as many equal steps as its own motion asks for.

Nothing else changes.
"""

import numpy as np
import pytest

import rigidmc as rm
from bench.problems.published import PROBLEMS
from rigidmc.engine.kernel import layout as K
from rigidmc.physics.effects import Gravity
from rigidmc.physics.integrators import INTEGRATORS
from rigidmc.planning.steps import MOST_OWN_STEPS, count_member_steps, rate_bounds
from rigidmc.runs import blocks
from tests.tools.kernels import block_of, prepare, run
from tests.tools.plans import starts

BODY = rm.Body.from_moments((rm.uniform(0.9, 1.4), 1.5, 2.0), mass=1.0, centre=(0.1, 0.05, 0.2))
START = rm.Start(
    omega=(rm.normal(0.0, 1.0), rm.normal(0.0, 1.0), rm.normal(0.0, 1.0)), attitude="uniform"
)
SCENE = rm.Scene(BODY, (Gravity(3.0),), START).with_run(
    t_end=10.0, every=2.5, members=300, save=("omega", "attitude", "energy")
)


def test_a_member_is_what_it_would_be_with_its_dt():
    whole = rm.simulate(SCENE, integrator="rk4", turn=0.4)
    assert len(np.unique(whole.steps)) > 10  # 25 different ones, 48 to 156
    assert (whole.steps % 4 == 0).all()  # four rounds, one to each save
    for m in (0, 7, 123):
        alone = rm.simulate(
            SCENE, integrator="rk4", dt=10.0 / float(whole.steps[m]), members=range(m, m + 1)
        )
        assert np.array_equal(alone.omega.values[..., 0], whole.omega.values[..., m])
        assert np.array_equal(alone.attitude.values[..., 0], whole.attitude.values[..., m])


def test_the_order_stays():
    """Errors fall as turn^4."""
    true = rm.simulate(SCENE, integrator="rk8", dt=0.004).omega.values[-1]
    apart = [
        np.abs(rm.simulate(SCENE, integrator="rk4", turn=t).omega.values[-1] - true).max(0)
        for t in (0.1, 0.05)
    ]
    assert np.median(np.log2(apart[0] / apart[1])) == pytest.approx(4.0, abs=0.15)  # 3.99


def test_members_err_alike():
    """The purpose: the errors of the worst and of the median member are closer to each other than
    with one dt for all.
    """
    true = rm.simulate(SCENE, integrator="rk8", dt=0.004).omega.values[-1]
    own = rm.simulate(SCENE, integrator="rk4", turn=0.2)
    alike = rm.simulate(SCENE, integrator="rk4", dt=2.5 / round(float(own.steps.mean()) / 4))
    a, b = (np.abs(x.omega.values[-1] - true).max(0) for x in (own, alike))
    assert a.max() < 0.6 * b.max()  # 0.33
    assert a.max() / np.median(a) < 0.6 * b.max() / np.median(b)  # 0.29


def test_rates_bound_omega_for_all_times():
    block, _ = starts(SCENE, 0, 320, True)
    bound = rate_bounds(SCENE.effects, block)[:300]
    omega = np.linalg.norm(
        rm.simulate(SCENE, integrator="rk8", dt=0.02, every=0.1).omega.values, axis=1
    )
    assert (omega.max(0) <= bound).all()
    assert np.median(omega.max(0) / bound) > 0.4  # 0.56, at most 0.75
    free = rm.Scene(rm.Body.from_moments((1.0, 2.0, 2.5)), (), rm.Start(omega=(3.0, 0.0, 0.0)))
    assert rate_bounds((), starts(free, 0, 32, False)[0])[0] == pytest.approx(3.0, rel=1e-15)


def test_own_steps():
    assert count_member_steps(
        np.array([0.0, 1.0, 1.01, np.nan, np.inf, 1e300]), 10.0, 0.5
    ).tolist() == [1, 20, 21, 1, 1, MOST_OWN_STEPS]


def test_a_kernel_with_rounds_in_several_calls_is_the_same():
    problems = [PROBLEMS[name] for name in list(PROBLEMS)[:40] if PROBLEMS[name].effects]
    made = prepare(INTEGRATORS["rk4"], 0.1, problems[0].effects)
    ends = []
    for cuts in ((), (1, 17, 40, 63, 64, 65, 200)):
        block = block_of(problems)
        block[K.STEPS] = 1 + np.arange(block.shape[1]) % 60
        run(block, made, problems[0].effects, 0.02, 4 * 64, stride=64, cuts=cuts, slots_each=64)
        assert np.array_equal(block[K.GOOD_STEP], 4 * block[K.STEPS])
        ends.append(block)
    assert ends[0].tobytes() == ends[1].tobytes()


def test_dt_or_turn():
    assert rm.simulate(SCENE, turn=0.3, members=32).attrs["turn"] == 0.3
    # the later one applies
    assert "turn" not in rm.simulate(SCENE.with_run(turn=0.3), dt=0.05, members=32).attrs
    with pytest.raises(rm.SceneError, match="give dt or turn, not both"):
        rm.simulate(SCENE, dt=0.1, turn=0.3)
    with pytest.raises(rm.SceneError, match="give dt or turn, not both"):
        rm.Scene.loads(SCENE.dumps() + "turn = 0.2\n")
    with pytest.warns(rm.SceneWarning, match="use turn <= 1"):
        rm.simulate(SCENE, turn=1.5, members=32, integrator="rk4")
    with pytest.raises(rm.SceneError, match=r"use turn <= 0\.5"):
        rm.simulate(SCENE, turn=1.5, members=32, integrator="midpoint")


def test_axes_are_sorted_with_their_members():
    """Members in order of their steps once had the axes of other members."""
    tensors = np.diag([1.5, 2.0, 2.5]) + 0.01 * np.arange(1.0, 33.0)[:, None, None]
    start = rm.Start(omega=(rm.uniform(0.1, 20.0), 1.0, 0.0))
    scene = rm.Scene(rm.Body.from_tensor(tensors), start=start).with_run(turn=0.1, every=1.0)
    made = rm.prepare(scene, save=("omega",), t_end=1.0)
    given = made.initial(0, 32)[1]
    job = blocks.make_job(made, object(), 0, 32, (np.empty(0), 0, 0))
    axes = slice(made.plan.places.axes, made.plan.places.end)
    assert (job.order != np.arange(32)).any()
    assert np.array_equal(job.block[axes], given["principal_axes"][:, job.order])
