"""A member again at the times of a moving picture: the bits of the run where its steps suffice, and
finer steps, never chords, where they do not."""

import numpy as np
import pytest

import rigidmc as rm
from rigidmc.mechanics.free_top import solve_free_top
from rigidmc.runs.frames import frames

MOMENTS, L = (1.0, 2.0, 3.0), (0.3, 2.0, 0.4)


@pytest.fixture(scope="module")
def scene():
    start = rm.Start(momentum=(*L[:2], rm.normal(L[2], 0.1)), attitude=(1.0, 0.0, 0.0, 0.0))
    return rm.Scene(rm.Body.from_moments(MOMENTS), start=start)


def truth(ds, one):
    l, q = ds.start_momentum.values[:, 0], (1.0, 0.0, 0.0, 0.0)
    return solve_free_top(MOMENTS, l, q, one.time.values)


def test_steps_of_the_run_give_its_bits(scene):
    ds = rm.simulate(scene, dt=0.01, t_end=2.0, every=0.5, save=("momentum",), members=3)
    shown = frames(ds, 1, 40)
    assert shown.attrs["frames"] == "steps as in the run" and "to the bit" in shown.attrs["rerun"]
    assert shown.time.values == pytest.approx(np.linspace(0.0, 2.0, 41))
    part = frames(ds, 1, 20, until=1.0)
    assert part.time.values == pytest.approx(np.linspace(0.0, 1.0, 21))
    assert part.momentum.values == pytest.approx(shown.momentum.values[:21], abs=1e-13)


def test_a_run_of_long_steps_is_filled_by_shorter_ones(scene):
    ds = rm.simulate(scene, dt=0.2, t_end=2.0, every=1.0, save=("momentum",), members=1)
    shown = frames(ds, 0, 100)
    assert shown.sizes["time"] == 101
    assert shown.attrs["frames"] == "steps of 0.02 s instead of 0.2 s"
    # measured 2.2e-7; the chord between two steps of the run is off by 6e-3
    assert np.abs(shown.momentum.values[..., 0] - truth(ds, shown).momentum).max() < 1e-6


@pytest.mark.parametrize("settings", [{"integrator": "closed"}, {"turn": 0.5}])
def test_members_with_free_times_and_with_steps_of_their_own(scene, settings):
    ds = rm.simulate(scene, t_end=2.0, every=1.0, save=("momentum",), members=2, **settings)
    shown = frames(ds, 0, 50)
    assert shown.sizes["time"] == 51
    assert np.abs(shown.momentum.values[..., 0] - truth(ds, shown).momentum).max() < 1e-5


def test_what_noise_pushes_shows_its_own_steps_alone():
    body = rm.Body.from_moments(MOMENTS)
    bath = rm.Bath(kT=0.1, gamma=1.0)
    scene = rm.Scene(body, (bath,), rm.Start(omega=(0.1, 0.2, 0.3)))
    ds = rm.simulate(scene, "strang", dt=0.01, t_end=0.1, members=2, save=("momentum",))
    shown = frames(ds, 1, 500)
    assert shown.sizes["time"] == 11
    assert np.array_equal(shown.momentum.values[-1], ds.momentum.values[-1][:, [1]])
