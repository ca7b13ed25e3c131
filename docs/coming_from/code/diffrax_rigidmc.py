"""4,096 satellites with uncertain spin, tumbling freely for 60 s: rigidmc."""

import numpy as np

import rigidmc as rm

BODY = rm.Body.from_moments((0.061, 0.144, 0.149))  # kg m^2
T_END = 60.0  # s


def final(**settings):
    """Attitudes (members, 4) and angular velocities (members, 3) at T_END."""
    omega = np.random.default_rng(1).normal((0.02, 0.5, 0.0), (0.01, 0.01, 0.01), (4096, 3))
    scene = rm.Scene(BODY, start=rm.Start(omega=omega))
    settings = {"members": 4096, "t_end": T_END, "save": ("attitude", "omega"), **settings}
    end = rm.simulate(scene, **settings).isel(time=-1)
    return end.attitude.values.T, end.omega.values.T


def ensemble():
    return final(integrator="rk8", turn=0.5)


def exact():
    """The same by the closed form; free bodies only."""
    return final(integrator="closed", dt=T_END)


if __name__ == "__main__":
    attitude, omega = ensemble()
    print("ensemble", attitude.shape, omega.mean(axis=0))
