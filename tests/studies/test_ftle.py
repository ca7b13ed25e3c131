"""Finite-time Lyapunov exponents: pendulum and heavy top against the tangent maps of scipy."""

import dataclasses

import numpy as np
import pytest

import rigidmc as rm
from rigidmc.errors import OptionError, SceneError
from rigidmc.runs.directory.create import create
from rigidmc.runs.directory.resume import resume
from rigidmc.studies.ftle.picture import ftle_field
from rigidmc.studies.ftle.study import STATE, FtleOptions, exponents, ftle, table
from tests.studies.test_lyapunov import flow, in_metric, start_of

TIME = 6.0
MOMENTS, CENTRE, WEIGHT = np.array([1.0, 1.3, 0.7]), np.array([0.3, 0.1, 0.4]), 2.0
TOP = rm.Scene(
    rm.Body(tuple(MOMENTS), mass=0.5, centre=tuple(CENTRE)),
    rm.Gravity(4.0),
    rm.Start(
        omega=tuple(rm.uniform(-1.0 + k, 1.0 + k) for k in range(3)),
        attitude=(rm.uniform(0.0, 6.0), rm.uniform(0.3, 2.8), rm.uniform(0.0, 6.0)),
    ),
).with_run(integrator="rk8", dt=0.02, t_end=TIME)


def largest(scene, count, unit):
    """The exponents by scipy, of all changes of attitude and angular velocity."""
    y, (moments, centre), _ = start_of(scene.with_run(points="sobol"), count)
    end = flow(y, (moments, WEIGHT * centre), TIME)
    one, two = (in_metric(state, moments / unit) for state in (y, end))
    return np.log(np.linalg.svd(two @ np.linalg.inv(one), compute_uv=False)[:, 0]) / TIME


@pytest.mark.slow
def test_a_heavy_top_has_the_tangent_map_of_scipy():
    """All six numbers of a start change; neighbours were right to 6e-8, and in float32 to 0.04."""
    study = rm.ftle(TOP, 5, unit=0.7)
    assert study.attrs["left_out"] == 0
    true = largest(TOP, 5, 0.7)
    assert np.abs(study.ftle.values - true).max() < 3e-11  # measured 1.5e-12
    single = rm.ftle(TOP, 5, unit=0.7, dtype="float32").ftle.values
    assert np.abs(single - true).max() < 1e-5
    other = rm.ftle(TOP, 5, unit=2.0).ftle.values
    assert np.abs(other - true).max() > 1e-2  # another unit is another measure of growth


@pytest.mark.slow
def test_one_tangent_grows_nearly_as_much():
    """`lyapunov` follows one tangent: its difference falls as 1/T, but where its direction is at
    right angles to that of most growth it is large."""
    apart = []
    for time in (6.0, 24.0):
        run = {"t_end": time, "members": 500, "points": "sobol", "save": ("megno",)}
        exponent = rm.ftle(TOP, 500, t_end=time).ftle.values
        apart.append(rm.simulate(TOP, **run).lyapunov.values - exponent)
    first, last = (float(np.abs(one).mean()) for one in apart)
    assert 0.05 < first < 0.15  # measured 0.0985, where the exponents are about 0.4
    assert last < 0.5 * first  # measured 0.0362
    assert apart[0].min() < -0.3 and apart[1].min() < -0.15  # measured -0.45 and -0.25


ANGLE, RATE = rm.uniform(-3.14, 3.14), rm.uniform(-3.0, 3.0)
START = rm.Start(omega=(RATE, 0.0, 0.0), attitude=(0.0, ANGLE, 0.0))
PENDULUM = rm.Scene(
    rm.Body((1.0, 1.0, 0.5), mass=1.0, centre=(0.0, 0.0, -0.5)), rm.Gravity(2.0), START
).with_run(integrator="rk8", dt=0.1, t_end=6.0)


@pytest.mark.slow  # 9 s
def test_the_ridge_of_a_pendulum_is_the_way_to_the_upright(tmp_path):
    """theta'' = -sin theta: starts of omega = 2 cos(theta/2) go to the upright position, where a
    change grows as exp t; starts away from it grow slowly."""
    whole = rm.ftle(PENDULUM, 8000, unit=1.0, threads=1)
    speed, angle = whole.start.sel(number=["start.omega.1", "start.attitude.theta"]).values.T
    off = speed - 2.0 * np.cos(0.5 * angle)
    ridge, away = (np.abs(off) < 0.02) & (angle > 0.0), (np.abs(off) > 0.5) & (speed > 0.0)
    assert ridge.sum() > 10 and whole.ftle.values[ridge].min() > 0.6
    assert np.quantile(whole.ftle.values[away], 0.99) < 0.5
    at = np.argmax(whole.ftle.values)
    assert abs(abs(speed[at]) - 2.0 * np.cos(0.5 * angle[at])) < 0.05
    scene = ftle.work.design(PENDULUM, FtleOptions(families=8000, unit=None), {})
    create(scene, tmp_path / "run", size=4000)
    resume(tmp_path / "run", only=range(1))
    with pytest.warns(rm.SceneWarning, match="of 8,000 members"):
        part = rm.ftle.of(rm.open(tmp_path / "run"), unit=1.0)
    assert part.ftle.equals(whole.ftle[: part.sizes["family"]])
    assert 0 < part.sizes["family"] < 8000
    resume(tmp_path / "run")
    again = rm.ftle.of(rm.open(tmp_path / "run"), unit=1.0)
    assert again.ftle.equals(whole.ftle) and again.start.equals(whole.start)
    assert "8,000 starts, each changed by 2 parameters" in "\n".join(table(again))
    axes = ftle_field(again).axes[0]
    assert axes.get_xlabel() == "θ(0) [deg]"
    assert axes.get_ylabel() == "start.omega.1 [rad/s]"
    with pytest.raises(OptionError, match=r"did you mean 'start.omega.1'"):
        ftle_field(again, "start.omega.2")


def test_exponents_are_of_the_largest_growth():
    """Of a known matrix, in directions that are not at right angles, of any size; two directions
    that are alike count as one."""
    rng = np.random.default_rng(4)
    matrix, directions = rng.normal(size=(6, 6)), rng.normal(size=(6, 6))
    true = np.log(np.linalg.svd(matrix, compute_uv=False)[0]) / 5.0
    for size in (1.0, 1e-200, 1e150):
        found = exponents(size * directions[None], size * (directions @ matrix.T)[None], 5.0)
        assert abs(found[0] - true) < 1e-13
    alike = directions[[0, 0]][None]
    one = np.log(np.linalg.norm(matrix @ directions[0]) / np.linalg.norm(directions[0])) / 5.0
    assert abs(exponents(alike, alike @ matrix.T, 5.0)[0] - one) < 1e-13
    flagged = np.full((1, 6, 6), np.nan)
    assert np.isnan(exponents(directions[None], flagged, 5.0)).all()


@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_the_width_of_a_distribution_does_not_matter(dtype):
    """Neighbours of a width of 1e-7 (in float32 of 1e-3) differed by rounding alone."""
    for width in (1.0, 1e-7, 1e-14):
        start = rm.Start(omega=(0.0, 0.0, rm.normal(1.0, width)))
        scene = rm.Scene(rm.Body((1.0, 1.0, 2.0)), start=start)
        run = {"integrator": "exact", "dt": 0.1, "t_end": 10.0, "dtype": dtype}
        found = rm.ftle(scene, 8, unit=1.0, **run).ftle.values
        off = np.abs(found - np.log(101.0) / 20.0).max()
        assert off < {"float64": 1e-14, "float32": 1e-6}[dtype]


@pytest.mark.slow
def test_starts_may_be_drawn_as_a_whole_or_stand_in_a_grid():
    """An attitude and an angular velocity that are drawn as wholes change in all six directions,
    whatever their distributions; so do the numbers of a grid."""
    whole = rm.Start(omega=rm.Sphere(2.0), attitude="uniform")
    scene = dataclasses.replace(TOP, start=whole)
    study = rm.ftle(scene, 4, unit=0.7)
    assert np.abs(study.ftle.values - largest(scene, 4, 0.7)).max() < 3e-11
    grid = rm.Start(omega=(rm.grid(0.0, 1.0, 4), 0.3, 0.2), attitude=(0.1, 0.9, 0.3))
    found = rm.ftle(dataclasses.replace(TOP, start=grid), 4)
    assert list(found.number) == ["start.omega.1"] and found.ftle.notnull().all()
    assert found.start.values[:, 0].tolist() == [0.125, 0.375, 0.625, 0.875]


@pytest.mark.slow
def test_a_change_keeps_the_noise_of_its_member():
    """Against two runs with the same noise, whose starts are apart."""
    body = rm.Body((1.0, 1.5, 2.2), mass=1.0, centre=(0.0, 0.1, 0.3))
    effects = rm.Gravity(2.0), rm.Bath(0.5, 1.0)
    run = {"integrator": "strang", "dt": 0.01, "t_end": 3.0, "seed": 4}

    def moved(by):
        start = rm.Start(omega=(0.3 + by, -0.5, 2.0))
        ds = rm.simulate(rm.Scene(body, effects, start), members=1, save=STATE, **run)
        return np.concatenate([2.0 * ds.attitude.values[-1], ds.omega.values[-1]])

    apart = (moved(1e-5) - moved(-1e-5)) / 2e-5
    table_of_one = rm.Start(omega=(np.array([0.3]), -0.5, 2.0))
    found = rm.ftle(rm.Scene(body, effects, table_of_one), 1, unit=1.0, **run).ftle.item()
    assert abs(found - np.log(np.linalg.norm(apart)) / 3.0) < 1e-7


def test_what_has_no_tangents_is_refused():
    plain = rm.simulate(PENDULUM, members=4, save=("omega",))
    with pytest.raises(OptionError, match="--save attitude,omega --wrt"):
        rm.ftle.of(plain)
    with pytest.raises(OptionError, match="unit"):
        rm.ftle(PENDULUM, 4, unit=-1.0)
    with pytest.raises(SceneError, match="no distribution, table or grid"):
        rm.ftle(dataclasses.replace(PENDULUM, start=rm.Start(omega=(1.0, 0.0, 0.0))), 4)
    with pytest.raises(SceneError, match="run `rigidmc ftle` again"):
        PENDULUM.with_run(points="tangents")
    stops = PENDULUM.with_run(wrt=("start.omega.1",), save=(*STATE, rm.Passage(3, 0.5, stop=True)))
    with pytest.raises(SceneError, match="goes on"):
        rm.ftle.of(plain.assign_attrs(scene=stops.with_run(members=4).dumps()))
