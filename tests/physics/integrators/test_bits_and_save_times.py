"""The bits do not depend on what is saved when, although kicks are merged across steps."""

import numpy as np
import pytest

import rigidmc as rm
from rigidmc.physics.integrators import integrators_for

GRAVITY = (rm.Gravity(3.0),)
SCENE = rm.Scene(
    rm.Body.from_moments((1.0, 1.4, 2.0), mass=1.0, centre=(0.1, 0.05, 0.2)),
    GRAVITY,
    rm.Start(omega=(rm.normal(0.5, 0.1), 1.0, rm.normal(0.0, 0.3)), attitude="uniform"),
).with_run(t_end=1.2, dt=0.02, members=96, save=("omega", "attitude"))
MEMBER = ("energy_drift_max", "l2_drift_max", "status")


# one of each kind of stepping; the others with  pytest -m slow
SOME = ("rk4", "strang", "srkn11")


@pytest.mark.parametrize(
    "name",
    [
        n if n in SOME else pytest.param(n, marks=pytest.mark.slow)
        for n in integrators_for(GRAVITY)
        if n != "closed"
    ],
)
def test_saves_change_no_bit(name):
    often = rm.simulate(SCENE, integrator=name, every=0.02)
    now_and_then = rm.simulate(SCENE, integrator=name, every=0.3, block=32, threads=2)
    at_the_end = rm.simulate(SCENE, integrator=name, threads=1)
    for variable in ("omega", "attitude"):
        assert np.array_equal(often[variable][::15], now_and_then[variable])
        assert np.array_equal(often[variable][[0, -1]], at_the_end[variable])
    part = rm.simulate(SCENE, integrator=name, members=range(40, 50))
    assert np.array_equal(part.attitude, at_the_end.attitude.isel(member=slice(40, 50)))


@pytest.mark.parametrize("name", ["rk4", "srkn6", "aba864", "chin4"])
def test_saved_states_are_whole_steps(name):
    """A save at t is the end of a run to t, because saves close the kicks; equal to rounding,
    because the sum differs.
    """
    longer = rm.simulate(SCENE, integrator=name, every=0.3)
    shorter = rm.simulate(SCENE, integrator=name, t_end=0.3)
    assert np.array_equal(longer.omega[1], shorter.omega[-1])
    assert np.array_equal(longer.attitude[1], shorter.attitude[-1])
