"""One loop over EFFECTS: torque against energy, kick against a fine integration, energy_scale against energy, facts against fields.

A new effect needs an example below, and is then tested by what it has.
"""

import math
from typing import NamedTuple

import numpy as np
import pytest

from rigidmc.dynamics.euler import MassProperties, angular_velocity
from rigidmc.dynamics.methods import names
from rigidmc.dynamics.so3 import cross, dot, exponential, multiply, up
from rigidmc.effects import EFFECTS, Gravity, ViscousDamping, canonical, name_of
from rigidmc.effects.verbs import energy, energy_scale, kick, kick_all, kick_all_back, push, torque, total_energy, total_torque
from tests.reference import rotation, unit

EXAMPLES = {"gravity": Gravity(9.81), "viscous_damping": ViscousDamping(0.3)}
BODY = MassProperties.of((0.6, 0.8, 1.0), (0.05, -0.02, 0.3))
EVERY = pytest.mark.parametrize("name", EFFECTS)


def some_states(count=50):
    some = np.random.default_rng(1)
    return [(unit(some.normal(size=4)), tuple(some.normal(size=3))) for _ in range(count)]


def gradient_error(effect, body=BODY, step=1e-5):
    """Largest |torque + dE/d(rotation)| by central differences along turns of the body about its axes."""
    worst = 0.0
    for q, l in some_states():
        for axis in range(3):
            turn = [step * (i == axis) for i in range(3)]
            ahead, behind = (multiply(q, exponential([sign * x for x in turn])) for sign in (1.0, -1.0))
            slope = (energy(effect, body, ahead) - energy(effect, body, behind)) / (2.0 * step)
            worst = max(worst, abs(torque(effect, body, 0.0, q, l)[axis] + slope))
    return worst


def kick_error(effect, h=0.7, steps=200):
    """Largest |kick - fine Runge-Kutta of dL/dt = torque at fixed attitude|."""
    worst = 0.0
    for q, start in some_states(10):
        l, d = np.array(start), h / steps
        for i in range(steps):

            def rate(t, l, q=q):
                return np.array(torque(effect, BODY, t, q, tuple(l)))

            t = i * d
            k1 = rate(t, l)
            k2 = rate(t + d / 2, l + d / 2 * k1)
            k3 = rate(t + d / 2, l + d / 2 * k2)
            k4 = rate(t + d, l + d * k3)
            l = l + d / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        worst = max(worst, np.abs(l - kick(effect, BODY, 0.0, h, q, start)).max())
    return worst


def test_every_effect_has_an_example_here():
    assert {name: type(effect) for name, effect in EXAMPLES.items()} == EFFECTS


@EVERY
def test_torque_is_minus_the_gradient_of_energy(name):
    effect = EXAMPLES[name]
    if hasattr(effect, "energy"):
        assert gradient_error(effect) < 1e-9  # measured 1.0e-10: differences of 1e-5
    else:  # no potential: it must take power away, or a test of its own is due
        assert all(dot(torque(effect, BODY, 0.0, q, l), angular_velocity(BODY, l)) < 0.0 for q, l in some_states())


@EVERY
def test_kick_is_the_flow_of_the_torque(name):
    assert kick_error(EXAMPLES[name]) < 2e-13  # measured 1.9e-14


@EVERY
def test_kicks_add_up_and_go_back(name):
    effect = EXAMPLES[name]
    for q, l in some_states(10):
        twice = kick(effect, BODY, 0.4, 0.3, q, kick(effect, BODY, 0.0, 0.4, q, l))
        assert np.allclose(twice, kick(effect, BODY, 0.0, 0.7, q, l), rtol=0, atol=4e-15)  # measured 9e-16
        assert np.allclose(kick(effect, BODY, 0.4, -0.4, q, kick(effect, BODY, 0.0, 0.4, q, l)), l, rtol=0, atol=4e-15)


@EVERY
def test_energy_scale_bounds_the_energy_closely(name):
    effect = EXAMPLES[name]
    largest = max(abs(energy(effect, BODY, q)) for q, _ in some_states(2000))
    scale = energy_scale(effect, BODY)
    assert largest <= scale * (1.0 + 1e-15)
    assert largest >= 0.57 * scale  # measured 0.82: the 1-norm is at most sqrt(3) times the 2-norm


@EVERY
def test_facts_name_the_fields(name):
    kind = EFFECTS[name]
    assert set(kind.units) == set(kind.limits) == set(kind._fields)
    assert all(low < high for low, high in kind.limits.values())
    assert names(kind, "torque", "energy", "kick") <= {"body", "t", "h", "q", "l"}
    assert kind.__doc__.count("[") >= len(kind._fields)  # every parameter has its unit in the docstring
    assert name_of(kind) == name_of(EXAMPLES[name]) == name


class Backwards(NamedTuple):
    """Gravity with the sign of its torque turned round."""

    g: float

    def torque(self, body, q):
        return cross((self.g * body.p1, self.g * body.p2, self.g * body.p3), up(q))

    def energy(self, body, q):
        return Gravity.energy(self, body, q)


class Speeding(NamedTuple):
    """Damping whose flow has the wrong sign."""

    rate: float

    def torque(self, l):
        return ViscousDamping.torque(self, l)

    def kick(self, h, l):
        return ViscousDamping.kick(self, -h, l)


def test_wrong_signs_are_caught():
    assert gradient_error(Backwards(9.81)) > 1.0  # measured 6
    assert kick_error(Speeding(0.3)) > 0.1  # measured 0.7
    assert energy(Gravity(9.81), BODY, (1.0, 0.0, 0.0, 0.0)) == pytest.approx(9.81 * 0.3)  # heavier above: more energy


def test_gravity_is_weight_times_arm_in_space():
    for q, l in some_states():
        a = rotation(q)
        arm, weight = a @ BODY[6:], np.array([0.0, 0.0, -9.81])
        assert np.allclose(a @ torque(Gravity(9.81), BODY, 0.0, q, l), np.cross(arm, weight), rtol=0, atol=1e-14)
        assert math.isclose(energy(Gravity(9.81), BODY, q), 9.81 * arm[2], abs_tol=1e-14)


def test_several_effects_act_together():
    effects = EXAMPLES["gravity"], EXAMPLES["viscous_damping"]
    q, l = some_states(1)[0]
    together = total_torque(effects, BODY, 0.0, q, l)
    assert np.allclose(together, np.sum([torque(e, BODY, 0.0, q, l) for e in effects], axis=0), rtol=0, atol=1e-15)
    assert total_torque((), BODY, 0.0, q, l) == (0.0, 0.0, 0.0)
    assert np.allclose(push(effects, BODY, 0.0, 0.2, q, l, l), np.add(l, np.multiply(0.2, together)), rtol=0, atol=1e-15)
    assert push((), BODY, 0.0, 0.2, q, l, l) is l
    assert total_energy(effects, BODY, q) == energy(effects[0], BODY, q)
    there = kick_all(effects, BODY, 0.0, 0.2, q, l)
    assert np.allclose(kick_all_back(effects, BODY, 0.2, -0.2, q, there), l, rtol=0, atol=1e-15)  # one is the mirror of the other
    assert not np.allclose(kick_all(effects, BODY, 0.2, -0.2, q, there), l, rtol=0, atol=1e-3)  # and no flow commutes with it
    assert kick_all((), BODY, 0.0, 0.2, q, l) == kick_all_back((), BODY, 0.0, 0.2, q, l) == l


def test_the_order_in_which_effects_are_listed_does_not_matter():
    class Own(NamedTuple):
        size: float

    gravity, damping, own = Gravity(9.81), ViscousDamping(0.1), Own(1.0)
    assert canonical((own, damping, gravity)) == canonical((gravity, own, damping)) == (gravity, damping, own)
    assert name_of(own) == "Own"
