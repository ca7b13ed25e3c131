"""A spinning top on a ball joint, and 64 of them: MuJoCo."""

from functools import cache
from os import cpu_count

import mujoco
import numpy as np
from mujoco import rollout

MODEL = """
<mujoco>
  <option timestep="0.001" integrator="RK4" gravity="0 0 -9.81"/>
  <worldbody>
    <body>
      <joint type="ball"/>
      <inertial pos="0 0 0.1" mass="1" diaginertia="0.01 0.01 0.01"/>
    </body>
  </worldbody>
</mujoco>
"""  # the inertia is about the centre of mass
T_END, TILT = 10.0, 0.5  # s, rad


@cache
def model():
    return mujoco.MjModel.from_xml_string(MODEL)


def start(top, data, spin):
    mujoco.mj_resetData(top, data)
    data.qpos[:] = np.cos(TILT / 2), np.sin(TILT / 2), 0.0, 0.0
    data.qvel[:] = 0.0, 0.0, spin  # body axes


def one():
    top, data = model(), mujoco.MjData(model())
    start(top, data, 30.0)
    mujoco.mj_step(top, data, round(T_END / top.opt.timestep))
    return data.qpos[None], data.qvel[None]


def ensemble():
    """Attitudes (members, 4) and angular velocities (members, 3) at T_END."""
    top, kind = model(), mujoco.mjtState.mjSTATE_FULLPHYSICS
    threads = [mujoco.MjData(top) for _ in range(cpu_count())]
    states = []
    for spin in np.random.default_rng(1).normal(30.0, 1.0, 64):
        start(top, threads[0], spin)
        states.append(np.empty(mujoco.mj_stateSize(top, kind)))
        mujoco.mj_getState(top, threads[0], states[-1], kind)
    states = np.array(states)
    steps, chunk = round(T_END / top.opt.timestep), 1000  # states are saved at every step
    for _ in range(steps // chunk):
        found, _ = rollout.rollout(top, threads, states, nstep=chunk)
        states = found[:, -1]
    return states[:, 1:5], states[:, 5:8]  # after the time


if __name__ == "__main__":
    attitude, omega = one()
    print("attitude", attitude[0], "omega", omega[0])
    attitude, omega = ensemble()
    print("ensemble", attitude.shape, omega.mean(axis=0))
