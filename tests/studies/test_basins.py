"""Basins of attraction: a Cantor set, a point, a driven pendulum; coverage of the interval."""

import numpy as np
import pytest

import rigidmc as rm
from bench.problems.cantor import CANTOR, ends_of, found, gap
from rigidmc.errors import OptionError, SceneError
from rigidmc.runs.directory.create import create
from rigidmc.runs.directory.resume import resume
from rigidmc.scene.sampling import DISTANCES, NeighbourFamilies
from rigidmc.studies.basins.picture import basins_and_shares
from rigidmc.studies.basins.study import is_resolved, table


def test_a_cantor_set_and_a_point():
    fractal = found(ends_of(1, 2**15, lambda x: gap(x) % 2))
    assert abs(fractal.value - CANTOR) < 0.02 and fractal.half < 0.015  # measured 0.004, 0.011
    smooth = found(ends_of(1, 2**15, lambda x: x > 0.4))
    assert abs(smooth.value - 1.0) < 0.05  # measured 0.004
    assert smooth.low < 1.0 < smooth.high
    unknown = ends_of(1, 2**15, lambda x: np.sin(1e12 * x) > 0.0)  # finer than all distances
    assert np.isnan(found(unknown).value) or abs(found(unknown).value) < 0.02


def test_neighbours_are_of_other_starts_if_the_design_is_broken():
    ends = ends_of(1, 2**13, lambda x: gap(x) % 2)
    ends[:, 1:] = np.roll(ends[:, 1:], 1, axis=0)  # those of the family before
    value = found(ends).value
    assert np.isnan(value) or abs(value) < 0.05  # no distance is nearer than another


def test_one_group_is_moved_by_the_distance():
    group = {("x", 0, i): i // 2 for i in range(3)}
    whole = NeighbourFamilies(5, group).words("x", 0, 78, 0, (0, 1, 2))[:3]
    part = NeighbourFamilies(5, group).words("x", 5, 60, 0, (0, 1, 2))[:3]
    assert np.array_equal(part, whole[:, 5:65])
    assert (whole > 0.0).all() and (whole < 1.0).all()
    families = whole.reshape(3, 6, 13)
    apart = np.abs(families - families[:, :, :1])
    moved = np.array([[0, 1] * 3, [0, 1] * 3, [1, 0] * 3]) == 0
    assert np.abs(apart[moved][:, 1:] - DISTANCES).max() < 3e-16  # measured 1.1e-16
    assert (apart[~moved] == 0.0).all()


START = rm.Start(omega=(rm.uniform(0.0, 1.0), 0.0, rm.uniform(-1.0, 2.0)))
RUN = {"integrator": "rk4", "t_end": 0.2, "dt": 0.1}
PLANE = rm.Scene(rm.Body((1.0, 1.0, 2.0)), start=START).with_run(**RUN)
UP, FAST = "p(omega_last[3] >= 0)", "p(omega_last[3] > 1.5)"


def test_a_run_directory_tells_the_same_also_in_part(tmp_path):
    whole = rm.basins(PLANE, UP, 20_000, threads=1)
    assert whole.number.values.tolist() == ["start.omega.1", "start.omega.3"]
    low, high = float(whole.dimension_low), float(whole.dimension_high)
    assert low < 1.0 < high and high - low < 0.2  # a line in a plane: 0.997 +- 0.07
    # half of the families move along the line, and no end changes
    assert float(whole.uncertain[1]) == pytest.approx(DISTANCES[1] / 2.0, abs=0.004)
    up = whole.start.sel(number="start.omega.3").values >= 0.0
    assert np.array_equal(whole.basin.values, up.astype(int))
    create(PLANE.with_run(points="neighbours", members=260_000, save=("omega_last",)),
           tmp_path / "run", size=100_000)  # fmt: skip
    resume(tmp_path / "run", only=range(2))
    with pytest.warns(rm.SceneWarning, match="of 260,000 members"):
        part = rm.basins.of(rm.open(tmp_path / "run"), UP)
    assert 0 < part.attrs["left_out"] < 20_000
    resume(tmp_path / "run")
    again = rm.basins.of(rm.open(tmp_path / "run"), UP)
    assert again.alpha.equals(whole.alpha) and again.basin.equals(whole.basin)
    three = rm.basins.of(rm.open(tmp_path / "run"), (UP, FAST))
    assert set(np.unique(three.basin)) == {0, 1, 3}
    assert float(three.uncertain[3]) == pytest.approx(DISTANCES[3], rel=0.3)  # two lines
    words = "\n".join(table(three))
    assert "end with omega_last[3] >= 0, not omega_last[3] > 1.5" in words
    left, right = basins_and_shares(three).axes
    assert left.get_ylabel() == "ω₃(0) [rad/s]" and len(left.collections) == 3
    assert right.get_xscale() == right.get_yscale() == "log"
    few = rm.basins(PLANE, UP, 100)
    assert np.isnan(float(few.alpha)) and "add families" in "\n".join(table(few))
    basins_and_shares(few)


def test_distances_are_compared_with_rounding():
    """The nearest neighbours in float32, and of a narrow law, have the start of their member."""
    single = rm.basins(PLANE, UP, 2000, dtype="float32")
    assert np.isfinite(single.uncertain.values).sum() == 9 == 12 - single.attrs["unresolved"]
    assert "perturbed starts differ by rounding alone: 3" in "\n".join(table(single))
    basins_and_shares(single)
    for width, many in ((1.0, 12), (1e-6, 12), (1e-9, 9), (1e-12, 4), (1e-16, 0)):
        start = rm.Start(omega=(0.0, 0.0, rm.uniform(1.0 - width, 1.0 + width)))
        scene = rm.Scene(PLANE.body, start=start).with_run(t_end=0.2, dt=0.1, points="neighbours")
        told = is_resolved(scene.model, scene.run)
        assert told.sum() == many and told[:many].all()  # the nearest ones are left out


def test_what_is_no_study_of_basins_is_refused():
    with pytest.raises(OptionError, match="use p"):
        rm.basins(PLANE, "mean(omega_last[3])", 10)
    with pytest.raises(OptionError, match="neighbours"):
        rm.basins.of(rm.simulate(PLANE, members=4, save=("omega_last",)), UP)
    noisy = rm.Scene(PLANE.body, rm.Bath(1.0, 0.1), START)
    with pytest.raises(SceneError, match="bath: noise separates any two motions"):
        rm.basins(noisy, UP, 10)
    fixed = rm.Scene(PLANE.body, start=rm.Start(omega=(0.0, 0.0, 1.0)))
    with pytest.raises(SceneError, match="nothing in the scene is drawn"):
        rm.basins(fixed, UP, 10, t_end=1.0)


@pytest.mark.slow
def test_a_driven_pendulum():
    """theta'' + 0.2 theta' + sin theta = 2 cos t has two attractors, and a fractal boundary.

    The two states at t = 2 pi n are also those of a Runge-Kutta step of the equation alone. A study
    with 65,536 families has shares whose slope is 0.29 between any two distances below 4e-3, and
    alpha = 0.312 +- 0.007 over all."""
    scene = rm.Scene.load("driven_pendulum")
    ds = rm.simulate(scene)
    turn = 2.0 * np.arctan2(ds.attitude.values[-1, 1], ds.attitude.values[-1, 0])
    angle, speed = (turn + np.pi) % (2.0 * np.pi) - np.pi, ds.omega.values[-1, 0]
    for there in (speed > 0.5, speed <= 0.5):
        x, v = np.median(angle[there]), np.median(speed[there])
        assert 0.4 < there.mean() < 0.6 and np.abs(speed[there] - v).max() < 1e-3  # 1.5e-4
        y, w = period(x, v)
        assert abs(y % (2.0 * np.pi) - x % (2.0 * np.pi)) < 1e-6 and abs(w - v) < 1e-6  # 4e-8
    study = rm.basins(scene, "p(omega_last[1] >= 0.5)", 8192)
    assert abs(float(study.alpha) - 0.312) < 0.04  # measured 0.324
    assert float(study.alpha_high - study.alpha_low) < 0.05  # measured 0.039


def period(x, v, steps=400):
    h = 2.0 * np.pi / steps

    def rate(t, x, v):
        return np.array([v, 2.0 * np.cos(t) - 0.2 * v - np.sin(x)])

    y = np.array([x, v])
    for i in range(steps):
        a = rate(i * h, *y)
        b = rate((i + 0.5) * h, *(y + 0.5 * h * a))
        c = rate((i + 0.5) * h, *(y + 0.5 * h * b))
        d = rate((i + 1.0) * h, *(y + h * c))
        y = y + h / 6.0 * (a + 2.0 * b + 2.0 * c + d)
    return y
