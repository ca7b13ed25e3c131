"""The laws of all effects a second time, in space and with NumPy, without code of the package.

REFERENCE[name](effect, t, A, omega in space, Known(moments, static moment)) is a torque in space.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from tests.tools.reference import rotation


class Known(NamedTuple):
    """Facts of a body: principal moments (3) and mass times centre of mass (3)."""

    moments: Any
    static: Any


def symmetric(m):
    return np.array([[m[0], m[5], m[4]], [m[5], m[1], m[3]], [m[4], m[3], m[2]]])


def pull(e, t):
    """mu/r^3 and the direction to the body on its orbit; scipy solves Kepler's equation."""
    mean = math.sqrt(e.mu / e.distance**3) * t + e.anomaly
    at = brentq(
        lambda x: x - e.eccentricity * math.sin(x) - mean, mean - 1.0, mean + 1.0, xtol=1e-15
    )
    x, y = (
        e.distance * (math.cos(at) - e.eccentricity),
        e.distance * math.sqrt(1.0 - e.eccentricity**2) * math.sin(at),
    )
    return e.mu / math.hypot(x, y) ** 3, np.array([x, y, 0.0]) / math.hypot(x, y)


def turn_about_z(a):
    return np.array(
        [[math.cos(a), -math.sin(a), 0.0], [math.sin(a), math.cos(a), 0.0], [0.0, 0.0, 1.0]]
    )


def gradient_torque(e, t, a, moments):
    size, r = pull(e, t)
    tensor = a @ np.diag(moments) @ a.T
    return 3.0 * size * np.cross(r, tensor @ r)


def spring_torque(e, a):
    arm = a @ e.at
    d = arm - e.to
    return np.cross(arm, -e.stiffness * (1.0 - e.length / np.linalg.norm(d)) * d)


def potential_torque(e, a):
    u, h = a[2], 0.1  # by differences of the energy along u, exact up to degree 4

    def value(u):
        return np.dot(e.linear, u) + 0.5 * u @ symmetric(e.quadratic) @ u + np.dot(e.quartic, u**4)

    slope = [
        (
            8.0 * (value(u + h * x) - value(u - h * x))
            - value(u + 2.0 * h * x)
            + value(u - 2.0 * h * x)
        )
        / (12.0 * h)
        for x in np.eye(3)
    ]
    return a @ np.cross(u, slope)


SPACE = np.array([0.0, 0.0, 1.0])
REFERENCE = {  # torque in space components: functions of effect, t, A, omega in space
    "gravity": lambda e, t, a, w, b: np.cross(a @ b.static, -e.g * SPACE),
    "gravity_gradient": lambda e, t, a, w, b: gradient_torque(e, t, a, b.moments),
    "spring": lambda e, t, a, w, b: spring_torque(e, a),
    "uniform_field": lambda e, t, a, w, b: np.cross(a @ e.dipole, e.field),
    "rotating_field": lambda e, t, a, w, b: np.cross(
        a @ e.dipole, turn_about_z(e.rate * t) @ e.field
    ),
    "potential": lambda e, t, a, w, b: potential_torque(e, a),
    "moving_pivot": lambda e, t, a, w, b: np.cross(
        a @ b.static, np.multiply(e.swing, e.frequency**2 * math.cos(e.frequency * t + e.phase))
    ),
    "body_torque": lambda e, t, a, w, b: a @ e.size,
    "space_torque": lambda e, t, a, w, b: np.array(e.size),
    "periodic_torque": lambda e, t, a, w, b: a @ e.size * math.cos(e.frequency * t + e.phase),
    # the total momentum is constant: in space, that of the wheel changes by what the body gets back
    "rotor": lambda e, t, a, w, b: (
        -np.cross(w, a @ (np.array(e.momentum) + t * np.array(e.motor))) - a @ e.motor
    ),
    "viscous_damping": lambda e, t, a, w, b: -e.rate * a @ np.diag(b.moments) @ a.T @ w,
    "axial_damping": lambda e, t, a, w, b: -a @ np.diag(np.multiply(e.rates, b.moments)) @ a.T @ w,
    "matrix_damping": lambda e, t, a, w, b: -a @ symmetric(e.matrix) @ a.T @ w,
    "quadratic_drag": lambda e, t, a, w, b: -e.drag * np.linalg.norm(w) * w,
    "dry_friction": lambda e, t, a, w, b: -e.friction * w / math.hypot(np.linalg.norm(w), e.rest),
    "energy_dissipation": lambda e, t, a, w, b: dissipated(e, t, a, w, b),
    "internal_dissipation": lambda e, t, a, w, b: dissipated(e, t, a, w, b),
}


def dissipated(e, t, a, w, b):
    """Minus loss times the component of omega across the momentum of the whole, times its size."""
    wheel = np.array(e.wheel) + t * np.array(e.motor)
    g = a @ (np.diag(b.moments) @ a.T @ w + wheel)
    n = g / np.linalg.norm(g)
    return -e.loss * np.linalg.norm(g) * (w - n * (n @ w))


# What effects add in space to the angular velocity I^-1 L. A torque in the body that goes with it
# is one in space less the change of axes, which turn faster.
SLIPS = {
    "internal_dissipation": lambda e, t, a, w, b: np.cross(unit_of_whole(e, t, a, w, b), w) * e.loss
}


def unit_of_whole(e, t, a, w, b):
    """The direction of the momentum of the whole in space."""
    g = a @ (np.diag(b.moments) @ a.T @ w + np.array(e.wheel) + t * np.array(e.motor))
    return g / np.linalg.norm(g)


def moved(effects, body, q, l, end):
    """(A, L in the body) at the end, from matrix A and momentum in space, by DOP853.

    effects : [(name, effect with plain numbers)]
    """
    moments = np.asarray(body.moments, float)

    def rates(t, y):
        a, spin = y[:9].reshape(3, 3), y[9:]
        w = a @ ((a.T @ spin) / moments)
        torque = sum((REFERENCE[name](e, t, a, w, body) for name, e in effects), np.zeros(3))
        more = [SLIPS[name](e, t, a, w, body) for name, e in effects if name in SLIPS]
        slip = sum(more, np.zeros(3))
        torque, w = torque + np.cross(slip, spin), w + slip
        turn = np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])
        return np.concatenate([(turn @ a).ravel(), torque])

    a = np.array(rotation(q))
    y = solve_ivp(
        rates,
        (0.0, end),
        np.concatenate([a.ravel(), a @ l]),
        method="DOP853",
        rtol=1e-11,
        atol=1e-12,
    ).y[:, -1]
    return y[:9].reshape(3, 3), y[:9].reshape(3, 3).T @ y[9:]
