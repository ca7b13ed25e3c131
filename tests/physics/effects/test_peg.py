"""A peg that rubs in a socket: what docs/theory/heavy_top.md says of it."""

import math
from typing import NamedTuple

import numpy as np
import pytest

import rigidmc as rm
from rigidmc.mechanics.rotation import matrix
from rigidmc.protocols import dot, effect, scale, vertical

I1, I3, K, SPIN = 3.25e-4, 0.8e-4, 0.07, 200.0


@effect(units={"friction": "N m", "rest": "rad s-1"}, in_body=())
class RubbingPeg(NamedTuple):
    """tau = -friction omega_h/|omega_h| with the horizontal part of omega, smooth below `rest`."""

    friction: float
    rest: float

    def torque(self, body, q, l):
        w, up = (body.i1 * l[0], body.i2 * l[1], body.i3 * l[2]), vertical(q)
        about = dot(w, up)
        level = (w[0] - about * up[0], w[1] - about * up[1], w[2] - about * up[2])
        return scale(-self.friction / math.sqrt(dot(level, level) + self.rest**2), level)


def simulated(peg, angles, omega, t_end):
    """Return times, the axis of the top (n, 3), L_z and energy."""
    body = rm.Body.from_moments((I1, I1, I3), mass=0.18, centre=(0.0, 0.0, K / (0.18 * 9.81)))
    start = rm.Start(omega=omega, attitude=angles)
    scene = rm.Scene(body, (rm.Gravity(9.81), peg), start)
    save = ("attitude", "omega", "energy")
    run = {"dt": 1e-3, "t_end": t_end, "every": 4e-3, "save": save}
    ds = rm.simulate(scene, "rk8", members=1, **run).isel(member=0)
    axes = matrix(ds.attitude.transpose("time", "quat").values)
    momentum = np.array([I1, I1, I3]) * ds.omega.transpose("time", "axis").values
    return ds.time.values, axes[..., 2], (axes[:, 2] * momentum).sum(-1), ds.energy.values


@pytest.mark.slow
def test_a_peg_in_a_socket_raises_a_top_and_feeds_its_nutation():
    slow = float(rm.steady_precession((I1, I1, I3), K, SPIN, 0.4).slow)
    rates = (slow, 0.0, SPIN - slow * math.cos(0.4))
    omega = rm.omega_from_euler_rates((0.0, 0.4, 0.0), rates)
    peg, angles = RubbingPeg(1e-3, 1.0), (0.0, 0.4, 0.0)
    _, axis, vertical_momentum, energy = simulated(peg, angles, omega, 10.0)
    theta = np.arccos(axis[:, 2])
    # kept by a torque without a vertical part; measured 1.6e-13
    assert np.ptp(vertical_momentum) < 1e-12 * vertical_momentum[0]
    assert (np.diff(energy) < 0.0).all()
    assert theta.min() < 0.02  # measured 0.007, after 5 s: it rises ...
    assert theta[-1] > 0.4  # measured 0.44: ... and falls again, by its nutation


@pytest.mark.slow
def test_small_tilts_grow_and_decay_as_the_linear_theory_says():
    """I1 n'' - i I3 w3 n' - k n = -c (n' - i w3 n), for the complex horizontal part n of the axis.

    The slow precession decays and, for I_1 > I_3, the fast one grows.
    """
    c = 2e-5
    slow, fast = np.roots([I1, -(I3 * SPIN + 1j * c), K + 1j * c * SPIN])[::-1]
    assert slow.imag > 0.0 > fast.imag  # of exp(i lambda t)
    tilt = 1e-4
    t, axis, *_ = simulated(RubbingPeg(1e-4, 1e-4 / c), (0.0, tilt, 0.0), (0.0, 0.0, SPIN), 4.0)
    n = axis[:, 0] + 1j * axis[:, 1]
    # the start fixes both amplitudes: n(0), and n'(0) = 0 of an axis at rest
    a = n[0] * fast / (fast - slow)
    linear = a * np.exp(1j * slow * t) + (n[0] - a) * np.exp(1j * fast * t)
    assert abs(n - linear).max() < 2e-5 * abs(n[0])  # measured 4e-6
