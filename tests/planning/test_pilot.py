"""Pilots: states at checks, truths, growth of disturbances, the quantile that 99 % stay below."""

from dataclasses import replace

import numpy as np
import pytest

import rigidmc as rm
from rigidmc.engine.kernel import layout as K
from rigidmc.planning.tolerance import deviation, pilot, truth
from rigidmc.planning.tolerance import deviation as growth
from tests.tools import scenes
from tests.tools.scenes import LAGRANGE, UNSYMMETRIC

HEAVY = scenes.HEAVY.with_run(t_end=3.0)
FREE = replace(HEAVY, effects=())
SCENE = LAGRANGE.with_run(t_end=3.0)


def test_states_are_those_of_a_run():
    """At the times that the scene saves, at most eight of them, the end included."""
    scene = HEAVY.with_run(every=0.2, integrator="rk4", dt=0.01)
    found = pilot.pilot(scene, 70)
    assert (found.base, found.stride, found.members, found.block.shape[1]) == (15, 2, 70, 96)
    assert np.allclose(found.times, [0.4, 0.8, 1.2, 1.6, 2.0, 2.4, 2.8, 3.0], rtol=1e-15)
    states = pilot.integrate_pilot(found, "rk4", 300)
    ds = rm.simulate(scene, members=70, save=("momentum", "attitude"))
    at = [2, 4, 6, 8, 10, 12, 14, 15]
    assert np.array_equal(states.l, ds.momentum.values[at])
    assert np.array_equal(states.q, ds.attitude.values[at])
    again = pilot.integrate_pilot(found, "rk4", 300)
    assert np.array_equal(states.q, again.q)  # later work does not move a pilot


def test_a_pilot_of_members_that_are_all_alike_is_one():
    scene = rm.Scene(UNSYMMETRIC, (), rm.Start(omega=(0.1, 1.0, 0.2))).with_run(t_end=1.0)
    assert pilot.pilot(scene, 256).members == 1
    rows = rm.Scene(
        UNSYMMETRIC, (), rm.Start(omega=np.random.default_rng(0).normal(size=(50, 3)))
    ).with_run(t_end=1.0, members=50)
    assert pilot.pilot(rows, 256).members == 50
    assert pilot.pilot(rows, 40, first=40).first == 10  # the last ones


@pytest.mark.parametrize(("scene", "name"), [(FREE, "free top"), (SCENE, "Lagrange top")])
def test_the_truth_is_the_closed_form_where_there_is_one(scene, name):
    found = pilot.pilot(scene.with_run(save=("omega", "attitude")), 64)
    true = truth.make_reference(found)
    assert true.source == f"closed form of the {name}, which rk8 confirms"
    assert deviation.upper_quantile(true.error) < 1e-13
    apart = deviation.errors(
        found, pilot.integrate_pilot(found, "rk8", 400, compensated=True), true.states
    )["state"]
    assert apart.max() < 1e-12


@pytest.mark.slow
def test_without_a_closed_form_two_methods_must_agree():
    found = pilot.pilot(HEAVY, 64)
    true = truth.make_reference(found)
    assert true.source.startswith("rk8 in")
    assert "srkn11 confirms" in true.source
    assert "lies on none of these axes" in true.source  # why there is no closed form
    assert true.error.max() < truth.AGREED
    apart = deviation.errors(
        found, pilot.integrate_pilot(found, "rkmk4", 6000, compensated=True), true.states
    )["state"]
    assert apart.max() < 1e-10  # a third method, of another family
    damped = scenes.DAMPED.with_run(t_end=3.0)
    true = truth.make_reference(pilot.pilot(damped, 32))
    assert "cf4 confirms" in true.source  # no splitting of high order takes damping
    assert true.error.max() < 1e-11


def test_errors_are_what_they_say():
    found = pilot.pilot(HEAVY, 40)
    true = pilot.integrate_pilot(found, "rk8", 200)
    turn = np.array([np.cos(5e-4), np.sin(5e-4), 0.0, 0.0])  # by 1e-3 rad
    from rigidmc.physics.dynamics.so3 import multiply

    q = np.stack([np.stack(multiply(tuple(a), tuple(turn))) for a in true.q])
    moved = deviation.errors(found, true._replace(q=q, l=1.0001 * true.l), true)
    assert np.allclose(moved["attitude"], 1e-3, rtol=1e-6)
    assert np.allclose(moved["momentum"], 1e-4, rtol=1e-10)
    assert np.allclose(moved["l2"], 2e-4, rtol=1e-3)
    assert np.array_equal(moved["state"], moved["attitude"])
    sick = true._replace(status=np.eye(1, 40)[0])
    assert np.isinf(deviation.errors(found, sick, true)["state"][0])


def test_growth_tells_chaos_from_order():
    chaotic = rm.Scene(
        rm.Body.from_moments((1.0, 1.7, 2.4), mass=1.0, centre=(0.6, 0.2, 0.6)),
        (rm.Gravity(9.81),),
        rm.Start(omega=(0.5, 0.5, 0.5), attitude="uniform"),
    ).with_run(t_end=16.0, save=("omega", "attitude"))
    _, rate = growth.measure_growth(pilot.pilot(chaotic, 64))
    assert np.mean(rate > 0.0) > 0.3  # 0.55
    factor, rate = growth.measure_growth(pilot.pilot(LAGRANGE.with_run(t_end=8.0), 64))
    assert np.mean(rate > 0.0) < 0.05
    assert np.median(factor) < 1e4
    # along the middle axis a disturbance grows as exp(sigma t), sigma = omega sqrt((I2 - I1)(I3 -
    # I2)/(I1 I3))
    spun = rm.Scene(UNSYMMETRIC, (), rm.Start(omega=(1e-9, 3.0, 0.0))).with_run(t_end=2.0)
    _, rate = growth.measure_growth(pilot.pilot(spun, 1))
    assert rate[0] == pytest.approx(3.0 * np.sqrt(0.4 * 0.6 / 2.0), rel=0.2)


def test_upper_quantile_covers():
    """In 95 % of 2000 samples the true 99 % quantile is below it; the plain one: in half."""
    some = np.random.default_rng(5)
    samples = some.exponential(size=(2000, 512))
    true = -np.log(0.01)
    covered = np.mean([deviation.upper_quantile(s) >= true for s in samples])
    assert 0.93 < covered < 0.995
    assert np.mean(np.quantile(samples, 0.99, axis=1) >= true) < 0.7


def test_the_disturbance_has_the_right_size():
    found = pilot.pilot(HEAVY, 64)
    block = found.block.copy()
    pilot.perturb(block, 1e-6, True, np.random.default_rng(0))
    l, l0 = block[K.MOMENTUM : K.EXTRA], found.block[K.MOMENTUM : K.EXTRA]
    assert np.allclose(np.linalg.norm(l - l0, axis=0) / np.linalg.norm(l0, axis=0), 1e-6, rtol=1e-6)
