"""Internal dissipation, alone and beside a wheel: what it keeps, and where it leads."""

import math

import numpy as np
import pytest

import rigidmc as rm
from rigidmc.physics.dynamics.euler import MassProperties, kinetic_energy
from rigidmc.physics.effects import EnergyDissipation, Rotor
from rigidmc.physics.effects.protocol import kick
from tests.physics.effects.test_effects import BODY, kick_error, reference_error, some_states
from tests.physics.effects.test_physics import ONE, moved
from tests.tools.reference import rotation

WHEEL = Rotor((0.5, -0.3, 0.8), (0.05, 0.02, -0.04))
BESIDE = EnergyDissipation(0.3, *WHEEL)


def followed(effects, start, h, steps, body, name):
    """The momentum after each step, (steps, 3)."""
    effects, seen = effects if type(effects) is tuple else (effects,), []
    moved(effects, ONE, start, h, steps, body, name, lambda t, q, l: seen.append(l))
    return np.array(seen)


def test_dissipation_keeps_the_momentum_and_ends_about_the_major_axis():
    body = MassProperties.of((1.0, 2.0, 3.0), (0.0, 0.0, 0.0))
    momenta = followed(EnergyDissipation(0.2), (1.0, 0.01, 0.01), 0.1, 3000, body, "strang")
    energies, sizes = [kinetic_energy(body, l) for l in momenta], np.linalg.norm(momenta, axis=1)
    assert np.abs(sizes / sizes[0] - 1.0).max() < 1e-13  # measured 1.5e-14
    assert (np.diff(energies) < 1e-15).all()  # measured 8.3e-17
    assert abs(momenta[-1, 2]) / sizes[0] > 1.0 - 1e-6  # measured 1.0 to rounding
    assert energies[0] > 2.9 * energies[-1]  # measured 2.9996: I3/I1


@pytest.mark.parametrize(("moments", "loss"), [((1.0, 1.0, 2.0), 0.1), ((1.0, 1.3, 2.0), 0.05)])
def test_a_wobble_dies_away_in_the_time_that_the_loss_tells(moments, loss):
    """exp(-t/T), 1/T = (loss |L|/2)(1/I1 + 1/I2 - 2/I3): measured 0.99999 T and 1.0018 T."""
    slow = 1.0 / np.array(moments[:2]) - 1.0 / moments[2]
    body, time = MassProperties.of(moments, (0.0, 0.0, 0.0)), 1.0 / (loss * slow.sum())
    l = followed(EnergyDissipation(loss), (0.01, 0.0, 2.0), 0.1, 300, body, "strang")
    wobbles = np.log(np.linalg.norm(np.sqrt(slow) * l[:, :2], axis=1))
    fade = np.polyfit(0.1 * np.arange(300), wobbles, 1)[0]
    assert abs(-1.0 / fade / time - 1.0) < 4e-3


def test_beside_a_wheel_the_torque_is_that_of_the_law():
    assert reference_error(BESIDE, "energy_dissipation") < 5e-14  # measured 7.8e-16


def test_beside_a_wheel_the_kick_is_a_rule_of_order_2():
    coarse, fine = kick_error(BESIDE, parts=10), kick_error(BESIDE, parts=20)
    assert abs(math.log2(coarse / fine) - 2.0) < 0.15  # measured 2.015


def test_a_kick_keeps_the_momentum_of_the_whole_and_takes_energy():
    t, drifts, gains = 0.4, [], []
    wheel = np.array(WHEEL.momentum) + t * np.array(WHEEL.motor)
    for q, l in some_states(20):
        after = kick(BESIDE, BODY, t, 0.7, q, l)
        drifts.append(np.linalg.norm(after + wheel) / np.linalg.norm(l + wheel) - 1.0)
        gains.append(kinetic_energy(BODY, after) - kinetic_energy(BODY, l))
    assert np.abs(drifts).max() < 2e-15  # measured 2.2e-16
    assert max(gains) < 0.0  # measured -0.015


DRUM, SPIN = (2.0, 2.5, 1.0), 0.8  # spins about its smallest moment
LIMIT = (2.5 - 1.0) * SPIN  # of the momentum of a wheel that holds it there


def drift_of_the_whole(known):
    """Relative change of |L + H| of the drum with a wheel of momentum 1.5 along axis 3.

    known : momentum of the wheel that the friction knows of
    """
    effects = Rotor((0.0, 0.0, 1.5)), EnergyDissipation(0.05, (0.0, 0.0, known))
    body = MassProperties.of(DRUM, (0.0, 0.0, 0.0))
    momenta = followed(effects, (0.002, 0.0, SPIN), 0.1, 2000, body, "rk8")
    sizes = np.linalg.norm(momenta + (0.0, 0.0, 1.5), axis=1)
    return np.ptp(sizes) / sizes[0]


def test_the_size_of_the_whole_momentum_is_kept_beside_a_wheel():
    """|I omega + H| stays; friction that does not know the wheel makes it drift."""
    assert drift_of_the_whole(1.5) < 1e-14  # measured 7.7e-16
    assert drift_of_the_whole(0.0) > 1e-3  # measured 8.6e-3


@pytest.mark.parametrize("share", [0.9, 1.1, 1.5])
def test_a_wobble_beside_a_wheel_grows_or_fades_as_theory_says(share):
    """exp(-t/T), 1/T = (loss/2)(|G|/I1 + |G|/I2 - 2 w), for moments I1 = I2."""
    wheel, loss = share * LIMIT, 0.02
    body = MassProperties.of((2.5, 2.5, 1.0), (0.0, 0.0, 0.0))
    effects = Rotor((0.0, 0.0, wheel)), EnergyDissipation(loss, (0.0, 0.0, wheel))
    l = followed(effects, (1e-4, 0.0, SPIN), 0.2, 400, body, "rk8")
    wobbles = np.log(np.hypot(*l.T[:2]))
    rate = loss * ((SPIN + wheel) / 2.5 - SPIN)
    growth = np.polyfit(0.2 * np.arange(400), wobbles, 1)[0]
    assert growth == pytest.approx(-rate, rel=1e-7)  # measured 4.2e-9


@pytest.mark.slow
def test_a_scene_tells_the_friction_of_its_rotors():
    """Two wheels, one of each member, one with a motor, in any order; by rk8 and a splitting."""
    own, steady, motor = rm.Rotor((0.0, 0.0, rm.uniform(0.5, 1.0))), (0.1, 0.0, 0.2), (0, 0, 0.004)
    wheels = own, rm.Rotor(steady, motor)
    start, friction = rm.Start(omega=(0.3, 0.1, 0.4)), rm.EnergyDissipation(0.05)
    for effects in ((friction, *wheels), (*wheels[::-1], friction)):
        scene = rm.Scene(rm.Body.from_moments(DRUM), effects, start).with_run(
            t_end=50.0, members=5, save=("momentum",)
        )
        for integrator, dt, bound in (("rk8", 0.1, 1e-14), ("strang", 0.01, 1e-6)):
            ds = rm.simulate(scene, integrator=integrator, dt=dt)
            drawn = ds.get("rotor_momentum", ds.get("rotor_2_momentum")).values
            told = steady + ds.time.values[:, None] * motor
            whole = ds.momentum.transpose("time", "axis", "member").values + drawn
            whole += told[..., None]
            size = np.linalg.norm(whole, axis=1)
            # measured 7.8e-16 and 5.1e-8
            assert np.abs(size / size[0] - 1.0).max() < bound


def test_a_scene_takes_no_wheel_from_its_friction():
    with pytest.raises(rm.SceneError, match=r"energy_dissipation\] wheel = 0.5: is set internally"):
        rm.Scene(rm.Body.from_moments(DRUM), BESIDE, rm.Start(omega=(0.3, 0.1, 0.4)))


def turned_in_space(effect, scene, **run):
    """The largest angle [rad] of the momentum of the whole in space from its start; the energies.

    The wheel of the scene holds what does not turn with the body's inertia.
    """
    effects = [e for e in scene.effects if isinstance(e, Rotor)]
    whole = rm.Scene(scene.body, (*effects, effect), scene.start, scene.run)
    save = ("attitude", "momentum", "energy")
    ds = rm.simulate(whole, save=save, members=2, **run)
    wheel = np.sum([e.momentum for e in effects], axis=0) if effects else np.zeros(3)
    angles = []
    for m in range(2):
        one = ds.isel(member=m)
        states = zip(one.attitude.values, one.momentum.values, strict=True)
        g = np.array([rotation(q) @ (l + wheel) for q, l in states])
        g /= np.linalg.norm(g, axis=1)[:, None]
        angles.append(2.0 * np.arcsin(0.5 * np.linalg.norm(g - g[0], axis=1)).max())
    return max(angles), ds.energy.values


# 1 s and 6 s, to compile
BOTH = [("cf4", 1), pytest.param("rk8", 0, marks=pytest.mark.slow)]


@pytest.mark.parametrize(("integrator", "place"), BOTH)
def test_internal_dissipation_keeps_the_momentum_in_space(integrator, place):
    """Explorer 1: the same energies, and L turns by 10 degrees only if the torque is external."""
    scene, dt = rm.Scene.load("damped_dzhanibekov"), (0.004, 0.001)[place]
    run = {"integrator": integrator, "dt": dt, "t_end": 20.0, "every": 0.02}
    kept, energies = turned_in_space(rm.InternalDissipation(0.003), scene, **run)
    off, others = turned_in_space(rm.EnergyDissipation(0.003), scene, **run)
    assert kept < (2e-9, 1e-4)[place] < 0.1 < off  # measured 1.6e-10, 1.1e-5 and 0.20
    assert np.abs(energies / others - 1.0).max() < 1e-12  # measured 2e-14
    assert energies[-1].max() < 0.5 * energies[0].min()


@pytest.mark.parametrize(("integrator", "place"), BOTH)
def test_internal_dissipation_beside_a_wheel_keeps_the_momentum_of_the_whole(integrator, place):
    scene = rm.Scene(
        rm.Body.from_moments(DRUM), Rotor((0.1, 0.2, 1.5)), rm.Start(omega=(0.3, 0.2, SPIN))
    )
    run = {"integrator": integrator, "dt": 0.05, "t_end": 100.0, "every": 1.0}
    # measured 4e-15 and 5.6e-10; 0.0135 by a torque from outside
    assert turned_in_space(rm.InternalDissipation(0.1), scene, **run)[0] < (1e-13, 5e-9)[place]


def test_internal_dissipation_needs_an_integrator_that_turns_the_body_so():
    scene = rm.Scene(
        rm.Body.from_moments(DRUM), rm.InternalDissipation(0.1), rm.Start(omega=(0.1, 0.0, 1.0))
    )
    for integrator in ("rk4", "strang", "rkmk4", "midpoint"):
        with pytest.raises(rm.SceneError, match=r"moving parts; use .*(rk8|cf4)"):
            rm.simulate(scene, integrator=integrator, dt=0.1, t_end=1.0, members=1)
