"""A heavy top: rigidmc."""

import rigidmc as rm

T_END = 10.0  # s


def one():
    """Attitude (1, 4) and angular velocity (1, 3) at T_END."""
    body = rm.Body.from_moments((0.02, 0.02, 0.01), mass=1.0, centre=(0.0, 0.0, 0.1))
    start = rm.Start(omega=(0.0, 0.0, 30.0), attitude=(0.0, 0.5, 0.0))  # Euler angles z-x-z
    scene = rm.Scene(body, rm.Gravity(9.81), start)
    settings = {"integrator": "rk8", "turn": 0.25, "t_end": T_END}
    end = rm.simulate(scene, members=1, save=("attitude", "omega"), **settings).isel(time=-1)
    return end.attitude.values.T, end.omega.values.T


if __name__ == "__main__":
    attitude, omega = one()
    print("attitude", attitude[0], "omega", omega[0])
