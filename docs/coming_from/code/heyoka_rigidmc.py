"""A heavy top to 1e-12, and 4,096 of them: rigidmc."""

import numpy as np

import rigidmc as rm

MOMENTS, WEIGHT, T_END = (0.02, 0.02, 0.01), 0.981, 10.0  # kg m^2 about the tip, N m, s
TILT = 0.5  # rad
BODY = rm.Body.from_moments(MOMENTS, mass=1.0, centre=(0.0, 0.0, WEIGHT / 9.81))


def final(spins, turn):
    """Attitudes (members, 4) and angular velocities (members, 3) at T_END."""
    start = rm.Start(omega=(0.0, 0.0, spins), attitude=(0.0, TILT, 0.0))  # Euler angles z-x-z
    scene = rm.Scene(BODY, rm.Gravity(9.81), start)
    settings = {"integrator": "rk8", "turn": turn, "t_end": T_END, "save": ("attitude", "omega")}
    end = rm.simulate(scene, members=np.size(spins), **settings).isel(time=-1)
    return end.attitude.values.T, end.omega.values.T


def one():
    return final(30.0, turn=0.2)  # rad of the top's own motion a step


def ensemble():
    return final(np.random.default_rng(1).normal(30.0, 1.0, 4096), turn=0.4)


if __name__ == "__main__":
    attitude, omega = one()
    print("attitude", attitude[0], "omega", omega[0])
    attitude, omega = ensemble()
    print("ensemble", attitude.shape, omega.mean(axis=0))
