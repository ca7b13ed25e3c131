"""A moon such as Hyperion that tumbles on an eccentric orbit, for 3 orbits: rigidmc."""

import numpy as np

import rigidmc as rm

# Units: G M of the planet 1, semi-major axis 1, so that the mean motion is 1
ECCENTRICITY, PERIOD = 0.1, 2 * np.pi
SEMIAXES = np.array([190.0, 145.0, 114.0])  # km; only the ratios of the moments matter
MOMENTS = ((SEMIAXES**2).sum() - SEMIAXES**2) / (SEMIAXES**2).sum()
SPIN, TILT = 1.3, 0.1  # about the short axis, in mean motions; rad


def final(spins):
    """Attitudes (members, 4) and angular velocities (members, 3) after 3 orbits."""
    pull = rm.GravityGradient(mu=1.0, distance=1.0, eccentricity=ECCENTRICITY)
    start = rm.Start(omega=(0.0, 0.0, spins), attitude=(0.0, TILT, 0.0))  # Euler angles z-x-z
    scene = rm.Scene(rm.Body.from_moments(MOMENTS), pull, start)
    settings = {"integrator": "rk8", "dt": PERIOD / 100, "t_end": 3 * PERIOD}
    ds = rm.simulate(scene, members=np.size(spins), save=("attitude", "omega"), **settings)
    end = ds.isel(time=-1)
    return end.attitude.values.T, end.omega.values.T


def one():
    return final(SPIN)


def ensemble():
    """4,096 moons whose spins differ by a millionth."""
    return final(SPIN * np.random.default_rng(1).normal(1.0, 1e-6, 4096))


if __name__ == "__main__":
    attitude, omega = one()
    print("attitude", attitude[0], "omega", omega[0])
    attitude, omega = ensemble()
    print("ensemble", attitude.shape, omega.mean(axis=0))
