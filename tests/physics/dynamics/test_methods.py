"""The calling convention: a method gets the arguments that it names, or is the default."""

from typing import NamedTuple

from rigidmc.physics.dynamics.methods import METHODS, argument_names, arguments, method
from rigidmc.physics.effects import Gravity, ViscousDamping
from rigidmc.physics.effects.protocol import torque


class Twice(NamedTuple):
    factor: float

    def shift(self, c, a):
        return self.factor * (c - a)


class Nothing(NamedTuple):
    factor: float


def test_a_method_gets_what_it_names_in_its_own_order():
    @method
    def shift(part, a, b, c):
        return part.factor + a + b + c

    METHODS.remove(shift)  # this one is not for kernels
    assert shift(Twice(2.0), 1.0, 10.0, 100.0) == 198.0
    assert shift(Nothing(2.0), 1.0, 10.0, 100.0) == 113.0


def test_names_are_what_an_effect_depends_on():
    assert argument_names(Gravity(9.81), "torque", "energy", "kick") == {"body", "q"}
    assert argument_names(ViscousDamping, "torque") == {"l"}
    assert argument_names(ViscousDamping, "torque", "kick") == {"h", "l"}
    assert argument_names(ViscousDamping, "energy") == set()
    assert arguments(Gravity.torque) == ("body", "q")


def test_an_effect_without_torque_has_none():
    assert torque(Nothing(1.0), None, 0.0, None, None) == (0.0, 0.0, 0.0)
