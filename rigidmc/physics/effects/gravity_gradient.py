"""Gravity-gradient torque of a central body on an orbiting body."""

import math
from typing import NamedTuple

from rigidmc.physics.dynamics.so3 import cross, into_body, nearest_integer, root, sincos
from rigidmc.physics.effects.protocol import Number, effect

_TURN = 6.283185307179586


@effect(
    units={"mu": "m3 s-2", "distance": "m", "eccentricity": "1", "anomaly": "rad"},
    limits={
        "mu": (0.0, math.inf),
        "distance": (1e-300, math.inf),  # any above 0
        "eccentricity": (0.0, 0.9),
        "anomaly": (-math.inf, math.inf),
    },
    example=(2.0, 1.3, 0.4, 0.5),
)
class GravityGradient(NamedTuple):
    """Gravity gradient on a Kepler orbit in the plane z = 0, about the body's centre of mass.

    The fixed point must be the centre of mass: pivot = "centre" in [body], or
    `Body.with_pivot_at_centre`, moves it there.

    Torque::

        tau = 3 mu/r^3 u x I u,   u = A^T r/r
        r = distance (1 - eccentricity cos E)
        E - eccentricity sin E = sqrt(mu/distance^3) t + anomaly

    The pericentre lies along x. On a circular orbit of rate n, a body whose long axis points to the
    centre librates in the plane at n sqrt(3 (I2 - I1)/I3).
    Source: Hughes, Spacecraft Attitude Dynamics (1986), 8.1; Goldreich & Peale, Astron. J. 71
    (1966) 425.

    Parameters
    ----------
    mu : quantity [m^3/s^2]
        G M of the central body
    distance : quantity [m]
        semi-major axis
    eccentricity : quantity, optional
        of the orbit, up to 0.9
    anomaly : quantity, optional [rad]
        mean anomaly at t = 0

    Examples
    --------
    A satellite on a low orbit about the Earth:

    >>> pull = rm.GravityGradient(mu=3.986e14, distance=6.9e6)
    >>> pull.eccentricity, pull.anomaly
    (0.0, 0.0)
    >>> scene = rm.Scene(rm.Body.from_moments((1.0, 2.0, 2.5)), pull)
    """

    mu: Number
    distance: Number
    eccentricity: Number = 0.0
    anomaly: Number = 0.0

    def torque(self, body, t, q):
        size, x, y = _pull(self.mu, self.distance, self.eccentricity, self.anomaly, t)
        u, c = into_body(q, (x, y, 0.0)), _differences(body, size)
        return c[0] * u[1] * u[2], c[1] * u[2] * u[0], c[2] * u[0] * u[1]

    def torque_rate(self, body, t, q, w):
        size, x, y = _pull(self.mu, self.distance, self.eccentricity, self.anomaly, t)
        u, c = into_body(q, (x, y, 0.0)), _differences(body, size)
        d = cross(u, w)
        return (
            c[0] * (d[1] * u[2] + u[1] * d[2]),
            c[1] * (d[2] * u[0] + u[2] * d[0]),
            c[2] * (d[0] * u[1] + u[0] * d[1]),
        )

    def energy_scale(self, body):
        nearest = self.distance * (1.0 - self.eccentricity)
        # Three divisions: the cube of 1e13 m overflows in float32.
        c = _differences(body, 3.0 * self.mu / nearest / nearest / nearest)
        return 0.25 * (abs(c[0]) + abs(c[1]) + abs(c[2]))


def place(orbit, t):
    """Return (cosine, sine) of the true anomaly of a GravityGradient at t."""
    _, x, y = _pull(orbit.mu, orbit.distance, orbit.eccentricity, orbit.anomaly, t)
    return x, y


def anomaly_rate(orbit, cosine):
    """Return the rate [rad/s] of the true anomaly of a GravityGradient where it has this cosine.

    n (1 + e cosine)^2 / (1 - e^2)^(3/2), the rate at which the local vertical turns
    """
    e = orbit.eccentricity
    n = root(orbit.mu / orbit.distance / orbit.distance / orbit.distance)
    over, square = 1.0 + e * cosine, 1.0 - e * e
    return n * (over * over) / (square * root(square))


def _differences(body, size):
    """Return size (I3 - I2), cyclic, from the coefficients of Euler's equations.

    These avoid cancellation.
    """
    d = -size * (1.0 / (body.i1 * body.i2 * body.i3))
    return d * body.i1 * body.a1, d * body.i2 * body.a2, d * body.i3 * body.a3


def _pull(mu, distance, e, anomaly, t):
    """Return (3 mu/r^3, cosine, sine of the true anomaly).

    Solve Kepler's equation E - e sin E = M by two steps of order 5 from
    E = M + e sin M / sqrt(1 - 2 e cos M + e^2). The error is at most 1e-4 after the first step and
    6e-16 after the second up to e = 0.9, and 4.1e-13 at e = 0.95
    (tests/physics/effects/test_gravity_gradient.py).
    """
    square = mu / distance / distance / distance  # the cube of 1e13 m overflows in float32
    m = root(square) * t + anomaly
    # Within half a turn of 0, the sine keeps its digits.
    m = m - _TURN * nearest_integer(m * (1.0 / _TURN))
    s, c = sincos(m)
    at = m + e * s / root(1.0 + e * (e - 2.0 * c))
    s, c = sincos(at)
    at = at + _nearer(at - m, e * s, e * c)
    s, c = sincos(at)
    d = _nearer(at - m, e * s, e * c)
    sine, versine = d - d * d * d * (1.0 / 6.0), 0.5 * d * d  # of the second step d, by series
    s, c = s + (c * sine - s * versine), c - (s * sine + c * versine)
    nearness = 1.0 / (1.0 - e * c)
    return (
        3.0 * square * (nearness * nearness * nearness),
        (c - e) * nearness,
        root(1.0 - e * e) * (s * nearness),
    )


def _nearer(ahead, s, c):
    """Return the correction of E = M + ahead towards E - e sin E = M.

    s = e sin E, c = e cos E. The reversed series of order 5, with one division.
    """
    r = 1.0 / (1.0 - c)
    x, a, b, g = (ahead - s) * r, 0.5 * s * r, (1.0 / 6.0) * c * r, (-1.0 / 24.0) * s * r
    return -x * (1.0 + x * (a + x * (2.0 * a * a - b + x * (a * (5.0 * a * a - 5.0 * b) + g))))
