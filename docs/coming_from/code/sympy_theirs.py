"""A heavy top: Lagrange's equations derived by sympy, integrated by scipy."""

from functools import cache

import numpy as np
import sympy as sp
from scipy.integrate import solve_ivp
from sympy.physics.mechanics import (
    LagrangesMethod,
    Lagrangian,
    Point,
    ReferenceFrame,
    RigidBody,
    dynamicsymbols,
    inertia,
)

T_END = 10.0  # s
START = [0.0, 0.5, 0.0, 0.0, 0.0, 30.0]  # phi, theta, psi [rad] and their rates [rad/s]


@cache
def equations():
    """The derivatives of angles and rates as a function of both, from the Lagrangian."""
    angles = dynamicsymbols("phi theta psi")
    space, body = ReferenceFrame("S"), ReferenceFrame("B")
    body.orient_body_fixed(space, angles, "zxz")
    tip = Point("O")
    tip.set_vel(space, 0)
    centre = tip.locatenew("C", 0.1 * body.z)  # m
    centre.v2pt_theory(tip, space, body)
    about_centre = inertia(body, 0.01, 0.01, 0.01)  # kg m^2
    top = RigidBody("top", centre, body, 1.0, (about_centre, centre))
    top.potential_energy = 9.81 * centre.pos_from(tip).dot(space.z)
    method = LagrangesMethod(Lagrangian(space, top), angles)
    method.form_lagranges_equations()
    rates = [angle.diff() for angle in angles]
    return sp.lambdify([*angles, *rates], list(method.rhs()), cse=True)


def one():
    """Attitude (1, 4) and angular velocity (1, 3) at T_END."""
    rates = equations()
    found = solve_ivp(
        lambda t, y: rates(*y), (0, T_END), START, method="DOP853", rtol=1e-12, atol=1e-12
    )
    phi, theta, psi, dphi, dtheta, dpsi = found.y[:, -1]
    plus, minus, half = (phi + psi) / 2, (phi - psi) / 2, theta / 2
    attitude = [
        np.cos(half) * np.cos(plus),
        np.sin(half) * np.cos(minus),
        np.sin(half) * np.sin(minus),
        np.cos(half) * np.sin(plus),
    ]
    omega = [
        dphi * np.sin(theta) * np.sin(psi) + dtheta * np.cos(psi),
        dphi * np.sin(theta) * np.cos(psi) - dtheta * np.sin(psi),
        dphi * np.cos(theta) + dpsi,
    ]
    return np.array([attitude]), np.array([omega])


if __name__ == "__main__":
    attitude, omega = one()
    print("attitude", attitude[0], "omega", omega[0])
