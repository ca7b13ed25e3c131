"""A spacecraft hub that tumbles freely for 10 minutes: Basilisk."""

import numpy as np
from Basilisk.simulation import spacecraft
from Basilisk.utilities import RigidBodyKinematics, SimulationBaseClass, macros

MOMENTS = (900.0, 800.0, 600.0)  # kg m^2
OMEGA, T_END = (0.01, 0.05, 0.001), 600.0  # rad/s, s


def one():
    """Attitude (1, 4) and angular velocity (1, 3) at T_END."""
    sim = SimulationBaseClass.SimBaseClass()
    process = sim.CreateNewProcess("dynamics")
    process.addTask(sim.CreateNewTask("task", macros.sec2nano(0.1)))
    hub = spacecraft.Spacecraft()
    hub.ModelTag = "hub"
    hub.hub.mHub = 750.0  # kg
    hub.hub.IHubPntBc_B = np.diag(MOMENTS)
    hub.hub.sigma_BNInit = [[0.0], [0.0], [0.0]]
    hub.hub.omega_BN_BInit = [[component] for component in OMEGA]
    sim.AddModelToTask("task", hub)
    sim.InitializeSimulation()
    sim.ConfigureStopTime(macros.sec2nano(T_END))
    sim.ExecuteSimulation()
    state = hub.scStateOutMsg.read()
    attitude = RigidBodyKinematics.MRP2EP(state.sigma_BN)  # quaternion, scalar first
    return np.array([attitude]), np.array([state.omega_BN_B])


if __name__ == "__main__":
    attitude, omega = one()
    print("attitude", attitude[0], "omega", omega[0])
