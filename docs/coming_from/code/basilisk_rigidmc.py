"""A spacecraft that tumbles freely for 10 minutes: rigidmc."""

import numpy as np

import rigidmc as rm

BODY = rm.Body.from_moments((900.0, 800.0, 600.0))  # kg m^2
OMEGA, T_END = (0.01, 0.05, 0.001), 600.0  # rad/s, s


def final(omega, members):
    """Attitudes (members, 4) and angular velocities (members, 3) at T_END."""
    scene = rm.Scene(BODY, start=rm.Start(omega=omega))
    settings = {"integrator": "rk4", "dt": 0.1, "t_end": T_END}
    ds = rm.simulate(scene, members=members, save=("attitude", "omega"), **settings)
    end = ds.isel(time=-1)
    return end.attitude.values.T, end.omega.values.T


def one():
    return final(OMEGA, 1)


def ensemble():
    """4,096 hubs whose spins are uncertain by 1e-3 rad/s."""
    return final(np.random.default_rng(1).normal(OMEGA, 1e-3, (4096, 3)), 4096)


if __name__ == "__main__":
    attitude, omega = one()
    print("attitude", attitude[0], "omega", omega[0])
    attitude, omega = ensemble()
    print("ensemble", attitude.shape, omega.mean(axis=0))
