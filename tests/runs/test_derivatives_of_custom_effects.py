"""Derivatives of a custom effect with branches, functions and a table, against its closed form."""

import math
from typing import NamedTuple

import mpmath as mp
import numpy as np
import pytest

import rigidmc as rm
from rigidmc.engine.compiler.kernels import config
from rigidmc.protocols import effect, select

pytestmark = pytest.mark.skipif(bool(config.DISABLE_JIT), reason="nothing is compiled")
TABLE = ((0.0, 1.0), (0.5, -0.3), (0.2, 0.4), (-0.4, 0.8), (0.1, 0.0))  # (value, slope) at 0, 1 ...
PARAMETERS = {"size": 0.8, "rate": 2.3, "decay": 1.7, "speed": 2.0, "drag": 0.3}
WRT = ("body.moments.3", "start.omega.3", *(f"effects.Winch.{name}" for name in PARAMETERS))
END = 2.0


def between(i, x):
    """The cubic polynomial with the values and slopes of the table at i and i + 1."""
    (y, s), (z, r), u = TABLE[i], TABLE[i + 1], x - i
    return y + u * (s + u * (3.0 * (z - y) - 2.0 * s - r + u * (2.0 * (y - z) + s + r)))


@effect(units={"size": "N m", "rate": "rad s-1", "decay": "s-1", "speed": "s-1", "drag": "N m s"})
class Winch(NamedTuple):
    """A torque about axis 3: a wave that decays after 1 s, a table, and drag, twice as much for
    spins below 0. Its changes with all parameters are continuous, so no step has a kink."""

    size: float
    rate: float
    decay: float
    speed: float
    drag: float

    def torque(self, body, t, l):
        wave = select(
            t < 1.0, math.sin(self.rate * t), math.sin(self.rate) * math.exp(self.decay * (1.0 - t))
        )
        x = self.speed * t
        low = select(x < 1.0, between(0, x), between(1, x))
        table = select(x < 2.0, low, select(x < 3.0, between(2, x), between(3, x)))
        drag = select(l[2] < 0.0, 2.0 * self.drag, self.drag)
        return 0.0, 0.0, self.size * wave + table - drag * body.i3 * l[2]


def closed_form(moment, omega, size, rate, decay, speed, drag):
    """(omega, angle) at the end, of dL/dt = f(t) - k L."""

    def torque(t):
        after = mp.sin(rate) * mp.exp(decay * (1 - t))
        wave = mp.sin(rate * t) if t < 1 else after
        return size * wave + between(min(3, int(speed * t)), speed * t)

    k = (2 if omega < 0 else 1) * drag / moment
    ends = sorted([0, 1, END, *(i / speed for i in (1, 2, 3))])
    given = {"method": "gauss-legendre", "maxdegree": 3}  # exact to 25 digits for each part
    whole = mp.quad(torque, ends, **given)
    weighted = mp.quad(lambda t: mp.exp(k * (t - END)) * torque(t), ends, **given)
    end = moment * omega * mp.exp(-k * END) + weighted
    return np.array([end / moment, (moment * omega + whole - end) / (k * moment)])


@pytest.mark.parametrize(
    ("integrator", "dt", "most"),
    [
        ("rk4", 2.0**-9, 1e-10),  # measured 1.8e-11
        pytest.param("rk8", 2.0**-5, 4e-14, marks=pytest.mark.slow),  # measured 9e-15
    ],
)
def test_derivatives_are_those_of_the_closed_form(integrator, dt, most):
    spins = np.array([5.0, 3.0, -4.0])
    start = rm.Start(omega=(0.0, 0.0, spins), attitude=(0.3, 0.7, 0.2))
    scene = rm.Scene(rm.Body.from_moments((1.0, 1.4, 2.0)), Winch(**PARAMETERS), start)
    ds = rm.simulate(
        scene, integrator, dt=dt, t_end=END, every=END, members=3, save=("omega", "attitude"),
        wrt=WRT,
    )  # fmt: skip
    assert not ds.status.values.any()
    with mp.workdps(30):
        h = mp.mpf("1e-10")
        for i, spin in enumerate(spins.tolist()):
            given = [mp.mpf(x) for x in (2.0, spin, *PARAMETERS.values())]
            assert abs(closed_form(*given)[0] - ds.omega.values[-1, 2, i]) < most
            for j, name in enumerate(WRT):
                ahead, back = (
                    closed_form(*given[:j], given[j] + s * h, *given[j + 1 :]) for s in (1, -1)
                )
                true = ((ahead - back) / (2 * h)).astype(float)
                found = [ds[d][j, -1, 2, i].item() for d in ("d_omega", "d_attitude")]
                assert np.abs(found - true).max() < most * np.abs(true).max(), name
