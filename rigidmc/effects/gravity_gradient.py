"""The torque of a central body on one that goes round it."""

import math
from typing import NamedTuple

from rigidmc.dynamics.so3 import cross, into_body, sincos

_TURN, _ROUND = 6.283185307179586, 6755399441055744.0  # 1.5 * 2^52: adding and subtracting it rounds to the nearest integer
SINGLE = {"_ROUND": 12582912.0}


class GravityGradient(NamedTuple):
    """Gravity gradient on a circular or Keplerian orbit, in the plane z = 0 of space, about the body's centre of mass.

        tau = 3 mu/r^3 u x I u,   u = A^T r/r

    r = distance (1 - eccentricity cos E), E - eccentricity sin E = sqrt(mu/distance^3) t + anomaly; the pericentre lies along x.
    A body whose long axis points to the centre librates in the plane with n sqrt(3 (I2 - I1)/I3) on a circular orbit.
    Source: Hughes, Spacecraft Attitude Dynamics (1986), 8.1; Goldreich & Peale, Astron. J. 71 (1966) 425.

    mu : G M of the central body [m^3/s^2]
    distance : semi-major axis [m]
    eccentricity : of the orbit, to 0.9
    anomaly : mean anomaly at t = 0 [rad]
    """

    mu: float
    distance: float
    eccentricity: float = 0.0
    anomaly: float = 0.0

    units = {"mu": "m3 s-2", "distance": "m", "eccentricity": "1", "anomaly": "rad"}
    limits = {"mu": (0.0, math.inf), "distance": (1e-300, math.inf), "eccentricity": (0.0, 0.9), "anomaly": (-math.inf, math.inf)}

    def torque(self, body, t, q):
        size, x, y = _pull(self.mu, self.distance, self.eccentricity, self.anomaly, t)
        u, c = into_body(q, (x, y, 0.0)), _differences(body, size)
        return c[0] * u[1] * u[2], c[1] * u[2] * u[0], c[2] * u[0] * u[1]

    def torque_rate(self, body, t, q, w):
        size, x, y = _pull(self.mu, self.distance, self.eccentricity, self.anomaly, t)
        u, c = into_body(q, (x, y, 0.0)), _differences(body, size)
        d = cross(u, w)
        return c[0] * (d[1] * u[2] + u[1] * d[2]), c[1] * (d[2] * u[0] + u[2] * d[0]), c[2] * (d[0] * u[1] + u[0] * d[1])

    def energy_scale(self, body):
        nearest = self.distance * (1.0 - self.eccentricity)
        c = _differences(body, 3.0 * self.mu / (nearest * nearest * nearest))
        return 0.25 * (abs(c[0]) + abs(c[1]) + abs(c[2]))


def _differences(body, size):
    """size (I3 - I2), cyclic, from the reciprocal moments and the coefficients of Euler's equations, where nothing cancels."""
    d = -size / (body.i1 * body.i2 * body.i3)
    return d * body.i1 * body.a1, d * body.i2 * body.a2, d * body.i3 * body.a3


def _pull(mu, distance, e, anomaly, t):
    """(3 mu/r^3, cosine, sine of the true anomaly): Kepler's equation by Halley's method, from Danby's start E = M + 0.85 e sign(sin M)."""
    m = math.sqrt(mu / (distance * distance * distance)) * t + anomaly
    m = m - _TURN * ((m * (1.0 / _TURN) + _ROUND) - _ROUND)
    at = m + 0.85 * e * (1.0 if m >= 0.0 else -1.0)
    at = _nearer(at, m, e)
    at = _nearer(at, m, e)
    at = _nearer(at, m, e)
    at = _nearer(at, m, e)  # 4e-16 is left up to e = 0.9, 4e-8 without this one
    s, c = sincos(at)
    share = 1.0 - e * c
    r = distance * share
    return 3.0 * mu / (r * r * r), (c - e) / share, math.sqrt(1.0 - e * e) * s / share


def _nearer(at, m, e):
    """One step of Halley's method for E - e sin E = M."""
    s, c = sincos(at)
    f, slope = at - e * s - m, 1.0 - e * c
    return at - f / (slope - 0.5 * f * e * s / slope)
