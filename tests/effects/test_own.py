"""A user's own effect: checked before it is compiled, with class, line and rule in the message; then it runs as the built-in ones do."""

import math
from typing import NamedTuple

import numpy as np
import pytest

import rigidmc as rm
from rigidmc.dynamics.so3 import up

BODY = rm.Body.from_moments((1.0, 1.4, 2.0), mass=1.0, centre=(0.1, 0.2, 0.3))
START = rm.Start(omega=(0.1, 1.0, 0.2), attitude="uniform")


def scene(effect):
    return rm.Scene(BODY, (effect,), START).with_run(dt=0.01, t_end=1.0, members=64, save=("momentum", "attitude"))


class Wind(NamedTuple):
    """A gust about a fixed axis of the body that fades as it spins away."""

    size: float

    def torque(self, t, l):
        return self.size * (1.0 + 0.5 * t) / (1.0 + l[0] * l[0]), 0.0, 0.0


class Weight(NamedTuple):
    """Gravity written anew."""

    g: float

    def torque(self, body, q):
        u, p = up(q), (self.g * body.p1, self.g * body.p2, self.g * body.p3)
        return u[1] * p[2] - u[2] * p[1], u[2] * p[0] - u[0] * p[2], u[0] * p[1] - u[1] * p[0]

    def energy(self, body, q):
        u = up(q)
        return self.g * (body.p1 * u[0] + body.p2 * u[1] + body.p3 * u[2])


class Upside(NamedTuple):
    g: float

    def torque(self, body, q):
        x, y, z = Weight(self.g).torque(body, q)
        return -x, -y, -z

    def energy(self, body, q):
        return Weight(self.g).energy(body, q)


class Raises(NamedTuple):
    size: float

    def torque(self, l):
        return math.sqrt(-1.0 - l[0] * l[0]), 0.0, 0.0


class Array(NamedTuple):
    size: float

    def torque(self, l):
        return np.array([self.size, 0.0, 0.0])


class Short(NamedTuple):
    size: float

    def torque(self, l):
        return self.size, 0.0


class Asks(NamedTuple):
    size: float

    def torque(self, speed):
        return speed, 0.0, 0.0


class Infinite(NamedTuple):
    size: float

    def torque(self, l):
        return 1e308 * 10.0 * self.size, 0.0, 0.0


class Lists(NamedTuple):
    size: float

    def torque(self, l):
        return float(sum([x > 0.0 for x in l])), 0.0, 0.0


class Words(NamedTuple):
    size: float

    def torque(self, l):
        return math.comb(3, 2) * l[0], 0.0, 0.0


class Sine(NamedTuple):
    size: float

    def torque(self, l):
        return self.size * math.sin(l[0]), 0.0, 0.0


@pytest.mark.parametrize(("effect", "words"), [
    (Upside(9.81), r"Upside.torque.*is not that of its energy"),
    (Raises(1.0), r"Raises.torque.*line \d+: return math.sqrt.*ValueError"),
    (Array(1.0), r"Array.torque.*gives ndarray, expected a tuple of 3 numbers.*no arrays"),
    (Short(1.0), r"Short.torque.*expected a tuple of 3 numbers"),
    (Asks(1.0), r"Asks.torque.*asks for 'speed'; it may name body, t, q, l"),
    (Infinite(1.0), r"Infinite.torque.*not finite"),
    (Lists(1.0), r"Lists.torque.*takes memory.*no lists"),
    (Words(1.0), r"Words.*cannot be compiled.*no calls but of math"),
])  # fmt: skip
def test_what_a_kernel_cannot_use_is_refused(effect, words):
    with pytest.raises(rm.SceneError, match=words):
        rm.simulate(scene(effect))


def test_an_own_effect_runs_as_a_built_in_one():
    own, known = rm.simulate(scene(Weight(9.81))), rm.simulate(scene(rm.Gravity(9.81)))
    assert np.abs(own.momentum - known.momentum).max() < 1e-12
    assert own.energy_drift_max.attrs["conserved"] == "yes"
    with pytest.warns(rm.SceneWarning, match="Sine calls sin of the library"):
        rm.simulate(scene(Sine(0.1)))
    blown = rm.simulate(scene(Wind(0.5)))
    assert float(blown.l2_drift_max.min()) > 0.01
