"""Published numbers, reached by every integrator that can reach them."""

import math
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from bench.problems.published import PROBLEMS
from rigidmc.physics.dynamics.euler import kinetic_energy
from rigidmc.physics.effects.sums import total_energy
from rigidmc.physics.integrators import INTEGRATORS
from tests.tools.kernels import march, one_step, prepare, stepping, turn
from tests.tools.reference import attitude_error, rotation

NASA_DATA = Path(__file__).parents[3].parent / "shared" / "data"


def end(name, problem, steps):
    q, l = march(INTEGRATORS[name], [problem], problem.time / steps, steps)
    return q[:, 0], l[:, 0]


@pytest.mark.parametrize(
    ("name", "h"), [("rk4", 1e-3), ("rkmk4", 1e-3), ("strang", 0.5), ("exact", None)]
)
def test_nasa_tumbling_brick(name, h):
    brick = PROBLEMS["nasa_brick"]
    for time, rates in brick.more["rates"].items():
        q, l = march(INTEGRATORS[name], [brick], h or time, round(time / (h or time)))
        error = np.abs(np.degrees(l[:, 0] / brick.moments) - rates).max()
        # measured 2.8e-12 and 6e-14 deg/s, exact in one step
        assert error < (2e-11 if h == 1e-3 else 4e-13)
    assert attitude_error(q[:, 0], brick.end_attitude) < 1e-12  # measured 1.4e-13


@pytest.mark.parametrize("simulator", ["01", "04"])
def test_nasa_simulators_at_all_their_times(simulator):
    path = NASA_DATA / f"nasa_checkcase02_sim{simulator}.csv"
    if not path.exists():
        pytest.skip("the table of the check-case is not here")
    samples = np.loadtxt(path, delimiter=",", skiprows=1)
    brick, worst = PROBLEMS["nasa_brick"], 0.0
    q, l = brick.attitude, brick.momentum
    for before, sample in pairwise(samples):
        h = sample[0] - before[0]
        q, l = one_step(prepare(INTEGRATORS["exact"], turn(brick, h)), brick.body, (), 0.0, h, q, l)
        worst = max(worst, np.abs(np.degrees(np.divide(l, brick.moments)) - sample[1:]).max())
    assert worst < 1e-9  # measured 3.6e-10 deg/s: the simulators themselves are off by that much


def energy_of(top, q, l):
    return kinetic_energy(top.body, l) + total_energy(top.effects, top.body, q)


def test_cardona_top_has_its_published_energy():
    top = PROBLEMS["cardona_top"]
    lz = rotation(top.attitude)[2] @ top.momentum
    assert abs(energy_of(top, top.attitude, top.momentum) / top.more["energy"] - 1.0) < 1e-15  # 0
    assert abs(lz / top.more["spatial_lz"] - 1.0) < 1e-15  # measured 0


# measured 3.9e-10, 4.4e-10, 2.9e-8
@pytest.mark.parametrize(("name", "bound"), [("rk4", 2e-9), ("rkmk4", 2e-9), ("strang", 1.5e-7)])
def test_cardona_top_at_two_seconds(name, bound):
    top, errors = PROBLEMS["cardona_top"], []
    for steps in (100_000, 200_000):
        q, l = end(name, top, steps)
        a = rotation(q)
        errors.append(np.abs(a @ (l / top.moments) - top.more["omega_space"]).max())
    assert errors[-1] < bound
    # measured 3.99, 3.93, 2.00
    assert abs(math.log2(errors[0] / errors[1]) - INTEGRATORS[name].order) < 0.15
    assert attitude_error(q, top.end_attitude) < bound / 20
    assert np.abs(a @ (0.0, 1.0, 0.0) - top.more["centre"]).max() < bound / 20


@pytest.mark.parametrize("steps", [1000, 2000, 4000, 8000])
def test_cardona_top_errs_as_exudyn_errs(steps):
    """EXUDYN's method has more terms of dexp^-1: a difference of a thousandth of their error."""
    top = PROBLEMS["cardona_top"]
    q, l = end("rkmk4", top, steps)
    omega = (rotation(q) @ (l / top.moments))[1]
    true, theirs = top.more["omega_space"][1], top.more["exudyn"][steps]
    # measured 7e-4 at 2000 steps, 3e-5 at 8000
    assert abs(omega - theirs) < 2e-3 * abs(theirs - true)
    q, l = end("rk4", top, steps)
    # another method has another error
    assert abs((rotation(q) @ (l / top.moments))[1] - theirs) > 0.05 * abs(theirs - true)


ENDS = ("toms903_step", "toms903_run", "hairer_free", "hairer_heavy", "hairer_lubich_wanner")


@pytest.mark.parametrize("problem", ENDS)
@pytest.mark.parametrize("name", stepping())
def test_published_ends(name, problem):
    kind, problem = INTEGRATORS[name], PROBLEMS[problem]
    if problem.gravity and kind.accepts == "no torque":
        return
    # measured 4e-9 of order 2, 1.5e-13 of rk4, 1.1e-13 of rkmk4
    by_order = {2: (200_000, 2e-8), 4: (20_000, 1e-12), 6: (2000, 1e-12), 8: (400, 4e-13)}
    few, fewer = (8000, 1e-12), (1000, 1e-12)
    own = {"chin4": few, "suzuki4": few, "aba864": fewer, "aba1064": fewer, "gbs12": (80, 4e-13)}
    own |= {"srkn6": by_order[6], "srkn11": by_order[8]}
    steps, bound = own.get(name) or by_order.get(kind.order, (200_000, 1e-8))
    if not problem.gravity and {"T", "L in space"} <= set(kind.conserves):
        # the free motion itself, measured 2.6e-15, of a splitting 4e-15
        steps, bound = (1, 1.5e-14) if name == "exact" else (60, 4e-14)
    q, l = end(name, problem, steps)
    assert np.abs(l - problem.end_momentum).max() < bound
    assert problem.end_attitude is None or attitude_error(q, problem.end_attitude) < bound


# measured 2.9e-12, 2.8e-12, 7e-10
@pytest.mark.parametrize(("name", "bound"), [("rk4", 2e-11), ("rkmk4", 2e-11), ("strang", 4e-9)])
def test_simo_wong_top(name, bound):
    top = PROBLEMS["simo_wong_top"]
    q, l = end(name, top, 100_000)
    assert np.abs(rotation(q)[:, 2] - top.more["axis"]).max() < bound
    # measured 3e-13 with strang, 1e-16 with the others
    assert abs(energy_of(top, q, l) / top.more["energy"] - 1.0) < 2e-12


def test_one_step_of_rkmk4():
    problem = PROBLEMS["exudyn_step"]
    start = problem.attitude, problem.momentum
    q, l = one_step(prepare(INTEGRATORS["rkmk4"], 0.1), problem.body, (), 0.0, problem.time, *start)
    length = 2.0 * math.atan2(np.linalg.norm(q[1:]), q[0])
    vector = length / math.sin(length / 2.0) * np.array(q[1:])
    # measured 9e-16
    assert np.abs(np.array(l) / problem.moments - problem.more["omega"]).max() < 5e-15
    assert np.abs(vector - problem.more["rotation_vector"]).max() < 5e-15  # measured 9e-16
