"""A moon such as Hyperion that tumbles on an eccentric orbit, for 3 orbits: REBOUND."""

import numpy as np
import rebound

# Units: G M of the planet 1, semi-major axis 1, so that the mean motion is 1
ECCENTRICITY, PERIOD = 0.1, 2 * np.pi
SEMIAXES = np.array([190.0, 145.0, 114.0])  # km; only the ratios of the moments matter
MOMENTS = ((SEMIAXES**2).sum() - SEMIAXES**2) / (SEMIAXES**2).sum()
SPIN, TILT = 1.3, 0.1  # about the short axis, in mean motions; rad


def rates(y, r):
    """Of attitude q (body to space, scalar first) and angular velocity w in body axes."""
    q, w = y[:4], y[4:]
    q0, q1, q2, q3 = q
    turn = np.array([
        [1 - 2 * (q2**2 + q3**2), 2 * (q1 * q2 - q0 * q3), 2 * (q1 * q3 + q0 * q2)],
        [2 * (q1 * q2 + q0 * q3), 1 - 2 * (q1**2 + q3**2), 2 * (q2 * q3 - q0 * q1)],
        [2 * (q1 * q3 - q0 * q2), 2 * (q2 * q3 + q0 * q1), 1 - 2 * (q1**2 + q2**2)],
    ])  # fmt: skip
    r = turn.T @ r  # in body axes
    torque = 3 / np.linalg.norm(r) ** 5 * np.cross(r, MOMENTS * r)
    dq = 0.5 * np.array([-q[1:] @ w, *(q0 * w + np.cross(q[1:], w))])
    return [*dq, *((torque - np.cross(w, MOMENTS * w)) / MOMENTS)]


def one():
    """Attitude (1, 4) and angular velocity (1, 3) after 3 orbits."""
    sim = rebound.Simulation()
    sim.add(m=1.0)
    sim.add(a=1.0, e=ECCENTRICITY, f=0.0)
    sim.integrator = "BS"
    sim.integrator.eps_rel, sim.integrator.eps_abs = 1e-12, 1e-12
    rotation = sim.create_ode(length=7, needs_nbody=True)

    def derivatives(ode, dy, y, t):
        moon, planet = sim.particles[1], sim.particles[0]
        found = rates(np.array(y[:7]), np.array(moon.xyz) - np.array(planet.xyz))
        for k in range(7):
            dy[k] = found[k]

    rotation.derivatives = derivatives
    for k, value in enumerate([np.cos(TILT / 2), np.sin(TILT / 2), 0.0, 0.0, 0.0, 0.0, SPIN]):
        rotation.y[k] = value
    sim.integrate(3 * PERIOD)
    end = np.array(rotation.y[:7])
    return end[None, :4], end[None, 4:]


if __name__ == "__main__":
    attitude, omega = one()
    print("attitude", attitude[0], "omega", omega[0])
