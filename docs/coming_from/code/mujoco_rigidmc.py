"""A spinning top with a fixed tip, and 64 of them: rigidmc."""

import numpy as np

import rigidmc as rm

BODY = rm.Body.from_moments((0.02, 0.02, 0.01), mass=1.0, centre=(0.0, 0.0, 0.1))  # about the tip
T_END, TILT = 10.0, 0.5  # s, rad


def final(spins):
    """Attitudes (members, 4) and angular velocities (members, 3) at T_END."""
    start = rm.Start(omega=(0.0, 0.0, spins), attitude=(0.0, TILT, 0.0))  # Euler angles z-x-z
    scene = rm.Scene(BODY, rm.Gravity(9.81), start)
    settings = {"integrator": "rk4", "dt": 0.001, "t_end": T_END, "save": ("attitude", "omega")}
    end = rm.simulate(scene, members=np.size(spins), **settings).isel(time=-1)
    return end.attitude.values.T, end.omega.values.T


def one():
    return final(30.0)


def ensemble():
    return final(np.random.default_rng(1).normal(30.0, 1.0, 64))


if __name__ == "__main__":
    attitude, omega = one()
    print("attitude", attitude[0], "omega", omega[0])
    attitude, omega = ensemble()
    print("ensemble", attitude.shape, omega.mean(axis=0))
