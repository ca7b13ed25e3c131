"""Angles from directions in space, and roll, pitch and yaw on an orbit: against other formulas."""

import math
from dataclasses import replace

import mpmath
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import rigidmc as rm
from rigidmc.errors import SceneError
from rigidmc.physics.dynamics.euler import MassProperties
from rigidmc.physics.observables import bind
from rigidmc.physics.observables.compiled import value
from tests.physics.observables.test_directions import ORBIT, RATE, directions, turned
from tests.tools.reference import apart

FIELD = rm.UniformField((0.1, 0.0, 0.2), (0.3, 0.4, 1.2))
ANTENNA = (0.2, -0.3, 0.9)
POINTING = (
    rm.PointingAngle(3),
    rm.PointingAngle(-1, "local_vertical"),
    rm.PointingAngle(ANTENNA, "along_track"),
    rm.PointingAngle(2, "momentum"),
    rm.PointingAngle(ANTENNA, (0.0, 2.0, 0.0)),
)
SCENE = rm.Scene(
    rm.Body.from_moments((1.0, 1.4, 1.2)),
    (rm.ViscousDamping(1e-9), ORBIT),  # the orbit is not the first effect
    rm.Start(omega=(rm.normal(0.0, 1e-3), 0.0, rm.normal(RATE, 2e-3)), attitude="uniform"),
    observables=POINTING,
)
SAVE = "pointing_angle", "attitude", "momentum", "orbit_angles"
# about a direction that moves; those about a fixed one take 5 s more to compile
STATISTICS = tuple(f"pointing_angle_2_{s}" for s in ("min", "max", "mean"))


@pytest.fixture(scope="module")
def result():
    run = {"dt": 20.0, "t_end": 8000.0, "every": 20.0, "members": 32}
    return rm.simulate(SCENE, "rk4", **run, save=(*SAVE, *STATISTICS))


def test_angles_are_those_of_the_saved_attitudes(result):
    known = directions(result.time.values)
    for i, one in enumerate(POINTING):
        body = ANTENNA / np.linalg.norm(ANTENNA)
        if isinstance(one.axis, int):
            body = np.sign(one.axis) * np.eye(3)[abs(one.axis) - 1]
        u = turned(result, body)
        if one.about == "momentum":
            l = result.momentum.transpose("time", "member", "axis").values
            d = turned(result, l.reshape(-1, 3))
        else:
            d = np.broadcast_to(known.get(one.about, np.eye(3)[[2]])[:, None], u.shape)
        expected = np.arctan2(np.linalg.norm(np.cross(u, d), axis=2), (u * d).sum(2))
        found = result[f"pointing_angle_{i + 1}" if i else "pointing_angle"]
        assert np.abs(found.values - expected).max() < 2e-14  # measured 2.7e-15
        assert expected.std() > 0.2
    assert result.pointing_angle_2.long_name == "angle between axis -1 and the local vertical"
    assert "body (0.2, -0.3, 0.9)" in result.pointing_angle_3.long_name


@pytest.mark.parametrize("end", ["_2", pytest.param("", marks=pytest.mark.slow)])
def test_statistics_are_those_of_the_motion(result, end):
    """Against saves at steps of a 20th: extremes lie between the saves of the result."""
    run = {"t_end": 8000.0, "members": 32}
    fine = rm.simulate(SCENE, "rk4", dt=1.0, every=1.0, save=("pointing_angle",), **run)
    names = {s: f"pointing_angle{end}_{s}" for s in ("min", "max", "mean")}
    if not end:
        result = rm.simulate(SCENE, "rk4", dt=20.0, every=20.0, save=tuple(names.values()), **run)
    saved = fine[f"pointing_angle{end}"].values
    found = {s: result[name].values for s, name in names.items()}
    assert apart(found["min"], saved.min(0)) < 1e-4  # measured 1.5e-5
    assert apart(found["max"], saved.max(0)) < 1e-4  # measured 1.9e-5
    mean = np.trapezoid(saved, dx=1.0, axis=0) / 8000.0
    assert apart(found["mean"], mean) < 3e-5  # measured 5.8e-6
    assert apart(saved[::20].min(0), saved.min(0)) > 1e-3  # measured 3.7e-3 or more


ALONE = MassProperties.of((1.0, 1.4, 2.0), (0.0, 0.0, 0.0))


@pytest.mark.parametrize("tilt", [0.0, 1e-15, 1e-9, 1e-5, 1.0, math.pi - 1e-9, math.pi])
def test_an_angle_is_exact_near_its_ends(tilt):
    """By mpmath; arccos of the cosine has half of the digits or none."""
    q = (math.cos(0.5 * tilt), 0.6 * math.sin(0.5 * tilt), 0.8 * math.sin(0.5 * tilt), 0.0)
    one = bind(rm.PointingAngle(3), ())
    (found,) = value(one, ALONE, (), 0.0, q, None, None, None)
    with mpmath.workdps(50):
        w, x, y, z = map(mpmath.mpf, q)
        expected = 2 * mpmath.atan2(mpmath.hypot(x, y), mpmath.hypot(w, z))
        assert abs(found - expected) < 3e-16  # measured 1.4e-16
    if 0.0 < tilt < 1e-5:
        lost = math.acos(min(1.0, q[0] ** 2 - q[1] ** 2 - q[2] ** 2 + q[3] ** 2))
        assert abs(lost / tilt - 1.0) > 1e-3


@pytest.mark.filterwarnings("ignore:.*nothing moves")
def test_a_direction_without_length_gives_0():
    still = rm.Scene(SCENE.body, (), rm.Start(omega=(0.0, 0.0, 0.0)), observables=POINTING[3:4])
    run = rm.simulate(still, "rk4", dt=1.0, t_end=2.0, members=1, save=("pointing_angle",))
    assert not run.pointing_angle.values.any()


def frame(t):
    """Rotations whose axes are those of the frame of the orbit, (times)."""
    known = directions(t)
    down, ahead = -known["local_vertical"], known["along_track"]
    return np.stack([ahead, np.cross(down, ahead), down], -1)


def test_orbit_angles_are_those_of_scipy(result):
    q = result.attitude.transpose("time", "member", "quat").values
    shape, turns = q.shape[:2], Rotation.from_quat(q.reshape(-1, 4), scalar_first=True)
    orbit = np.repeat(frame(result.time.values), shape[1], 0)
    local = Rotation.from_matrix(np.swapaxes(orbit, 1, 2)) * turns
    expected = local.as_euler("ZYX")[:, ::-1].reshape(*shape, 3)
    found = result.orbit_angles.transpose("time", "member", "angle")
    assert found["angle"].values.tolist() == ["roll", "pitch", "yaw"]
    apart = (found.values - expected + np.pi) % (2.0 * np.pi) - np.pi
    assert (np.abs(apart) * np.cos(expected[..., 1:2])).max() < 1e-14  # measured 1.6e-15
    assert np.abs(expected[..., 1]).max() > 1.5  # near the ends of pitch too
    other = local.as_euler("XYZ").reshape(*shape, 3)  # another sequence
    assert np.abs(found.values - other).max() > 1.0


def test_orbit_angles_of_other_axes():
    """Axis 1 away from the centre, 2 along the track; then turned by yaw, pitch and roll."""
    angles = 0.3, -0.4, 0.9  # roll, pitch, yaw
    local = frame(np.zeros(1))[0] @ Rotation.from_euler("ZYX", angles[::-1]).as_matrix()
    columns = np.stack([-local[:, 2], local[:, 0], -local[:, 1]], -1)
    scene = rm.Scene(SCENE.body, ORBIT, rm.Start(omega=(0.0, 0.0, 0.0), attitude=columns))
    save = (rm.OrbitAngles((2, -3, -1)), "orbit_angles_max")
    run = rm.simulate(scene, "rk4", dt=1.0, t_end=1.0, members=1, save=save)
    found = run.orbit_angles.isel(time=0, member=0).values
    assert np.abs(found - angles).max() < 1e-15  # measured 3e-16
    assert run.orbit_angles_max.dims == ("angle", "member")
    assert "angle" not in rm.simulate(scene, "rk4", dt=1.0, t_end=1.0, members=1).coords


def test_scene_files_histograms_and_files_take_them(tmp_path):
    counts = rm.Histogram("pointing_angle_2", low=0.0, high=math.pi, bins=4)
    scene = replace(SCENE, observables=(*POINTING[:2], counts, rm.OrbitAngles((2, -3, -1))))
    loaded = rm.Scene.loads(scene.dumps())
    assert loaded.observables == scene.observables
    save = (*STATISTICS, "histogram", "orbit_angles")  # whose code is there
    run = rm.simulate(
        loaded, "rk4", dt=20.0, t_end=400.0, every=200.0, members=5, save=save,
        output=tmp_path / "run.nc",
    )  # fmt: skip
    assert run.histogram.values.sum(1).tolist() == [5, 5, 5]
    with rm.open(tmp_path / "run.nc") as ds:
        assert ds.orbit_angles.sel(angle="yaw").dims == ("time", "member")
        again = rm.rerun(ds.load(), 3)
    assert again.attrs["rerun"].startswith("equal to the bit")
    assert np.array_equal(again.orbit_angles.values[..., 0], run.orbit_angles.values[..., 3])


FREE = replace(SCENE, effects=(FIELD,), observables=())
SHORT = {"integrator": "rk4", "dt": 1.0, "t_end": 2.0, "members": 1}


@pytest.mark.parametrize(
    ("refused", "words"),
    [
        *((lambda one=one: replace(SCENE, observables=(one,)), words) for one, words in (
            (rm.PointingAngle(4), r"pointing_angle\] axis = 4"),
            (rm.PointingAngle((0.0, 0.0, 0.0)), "direction of three numbers"),
            (rm.PointingAngle(True), "direction of three numbers"),
            (rm.PointingAngle(1, "up"), "about"),
            (rm.OrbitAngles((1, 2, -3)), "right-handed"),
            (rm.OrbitAngles((1, 2)), "three different axes"),
        )),
        *((lambda save=save: rm.simulate(FREE, **SHORT, save=(save,)), words) for save, words in (
            ("pointing_angle", r"needs a table \[observables.pointing_angle\] with axis"),
            ("orbit_angles", r"there is no orbit: add \[effects.gravity_gradient\]"),
            (rm.PointingAngle(1, "along_track"), "there is no orbit"),
        )),
    ],
)  # fmt: skip
def test_what_is_no_direction_or_has_none_is_told(refused, words):
    with pytest.raises(SceneError, match=words):
        refused()
