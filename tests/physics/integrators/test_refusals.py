"""An integrator refuses what it cannot do before the first step, with reason and alternatives."""

from typing import NamedTuple

import pytest

import rigidmc as rm
from rigidmc.physics.integrators import INTEGRATORS, integrators_for, refusal


class Wind(NamedTuple):
    """A torque that depends on L and has no flow of its own."""

    strength: float

    def torque(self, l):
        return self.strength * l[1], -self.strength * l[0], 0.0


class Field(NamedTuple):
    """A torque of the attitude that does not say how it changes."""

    strength: float

    def torque(self, q):
        return self.strength * q[1], 0.0, 0.0


G, D = rm.Gravity(9.81), rm.ViscousDamping(0.1)
PLAIN = "are for torques of attitude and time, but viscous_damping depends on L"
REFUSED = [
    ("exact", (G,), "is the motion of a free body and takes no torque, but the scene has gravity"),
    ("closed", (Field(1.0),), "no closed form covers Field"),
    ("strang", (Wind(1.0),), "kicks, but the torque of Wind depends on L and has no flow"),
    ("rotations", (G, Wind(1.0)), "the torque of Wind depends on L"),
    ("chin4", (G, D), f"force gradients {PLAIN}"),
    ("srkn6", (D,), f"its backward steps and its order {PLAIN}"),
    ("aba1064", (G, D), "viscous_damping depends on L"),
    ("chin4", (Field(1.0),), "it needs the rate of change of torques (torque_rate), which Field"),
]


@pytest.mark.parametrize(("name", "effects", "why"), REFUSED)
def test_refused_with_the_reason_and_the_nearest(name, effects, why):
    found = refusal(name, effects)
    assert why in found
    able = found.split("; use ")[1].split(" or ")
    assert set(able) <= set(integrators_for(effects))
    assert name not in able


def test_the_nearest_is_of_the_same_order_and_family():
    assert refusal("chin4", (Field(1.0),)).endswith("use suzuki4 or srkn6")
    assert refusal("srkn6", (D,)).endswith("use rk4 or rkmk4")
    assert refusal("strang", (Wind(1.0),)).endswith("use midpoint or rk4")


def test_refused_at_the_check_of_the_scene():
    body = rm.Body.from_moments((1.0, 1.4, 2.0), mass=1.0, centre=(0.0, 0.0, 0.1))
    scene = rm.Scene(body, (G, D), rm.Start(omega=(0.1, 1.0, 0.2)))
    free = rm.Scene(body, (), scene.start)
    for one, name, compensated, words in (
        (scene, "aba864", False, r"integrator = 'aba864': .*viscous_damping depends on L; use "),
        (scene, "strang", True, "cannot be compensated with viscous_damping"),
        (free, "closed", True, "no sums to compensate"),
    ):
        with pytest.raises(rm.SceneError, match=words):
            rm.prepare(one.with_run(integrator=name, compensated=compensated))


@pytest.mark.parametrize("effects", [(), (G,), (D,), (G, D), (Wind(1.0),), (Field(1.0),)])
def test_effects_that_are_not_refused_run(effects):
    """rk4 and the Lie group integrators take everything; no effect is both refused and accepted."""
    able = integrators_for(effects)
    assert {"rk4", "rk8", "rkmk4", "cf4", "ck45", "midpoint"} <= set(able)
    for name in INTEGRATORS:
        assert (refusal(name, effects) is None) == (name in able)
