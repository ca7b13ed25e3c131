"""Passages about directions in space: against counts from saved attitudes, by other formulas."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import rigidmc as rm
from rigidmc.errors import SceneError
from rigidmc.physics.observables.directions import direction_in_body, make_direction

ECCENTRICITY, ANOMALY, ANGLE = 0.3, 0.4, math.radians(60.0)
ORBIT = rm.GravityGradient(3.986e14, 1.2e7, ECCENTRICITY, ANOMALY)
RATE = math.sqrt(ORBIT.mu / ORBIT.distance**3)
DIRECTIONS = "local_vertical", "along_track", (0.0, 2.0, 0.0)
WATCHED = (
    *(rm.Passage(1, ANGLE, about=about) for about in DIRECTIONS),
    rm.Passage(-1, ANGLE, "reaches", "local_vertical", at_start="ignore"),
)
SCENE = rm.Scene(
    rm.Body.from_moments((1.0, 1.4, 1.2)),
    (rm.ViscousDamping(1e-9), ORBIT),  # the orbit is not the first effect
    rm.Start(
        omega=(rm.normal(0.0, 1e-4), rm.normal(0.0, 1e-4), rm.normal(RATE, 2e-3)),
        attitude="uniform",
    ),
    observables=WATCHED,
)


@pytest.fixture(scope="module")
def result():
    save = ("passage", "attitude")
    return rm.simulate(SCENE, "rk4", dt=20.0, t_end=26000.0, every=20.0, members=64, save=save)


def directions(t):
    """{name: unit vectors (times, 3)}; Kepler's equation by 50 fixed-point steps."""
    mean = RATE * t + ANOMALY
    anomaly = mean.copy()
    for _ in range(50):
        anomaly = mean + ECCENTRICITY * np.sin(anomaly)
    x = np.cos(anomaly) - ECCENTRICITY
    y = math.sqrt(1.0 - ECCENTRICITY**2) * np.sin(anomaly)
    radial = np.stack([x, y, 0.0 * t], -1) / np.hypot(x, y)[:, None]
    normal = np.tile([0.0, 0.0, 1.0], (t.size, 1))
    return {
        "local_vertical": radial,
        "along_track": np.cross(normal, radial),
        (0.0, 2.0, 0.0): np.tile([0.0, 1.0, 0.0], (t.size, 1)),
    }


def turned(result, axis):
    """An axis of the body in space, (times, members, 3)."""
    q = result.attitude.transpose("time", "member", "quat").values
    axes = Rotation.from_quat(q.reshape(-1, 4), scalar_first=True).apply(axis)
    return axes.reshape(*q.shape[:2], 3)


def cosines(result, about):
    """Of axis 1 and a direction, (times, members)."""
    return (turned(result, [1.0, 0, 0]) * directions(result.time.values)[about][:, None]).sum(2)


def counted(beyond):
    """(passages, those without the start) of a condition (times, members)."""
    later = (beyond[1:] & ~beyond[:-1]).sum(0)
    return later + beyond[0], later


@pytest.mark.parametrize(("i", "about"), list(enumerate(DIRECTIONS)))
def test_passages_are_those_of_the_saved_attitudes(result, i, about):
    found = result[f"passages_{i + 1}" if i else "passages"].values
    expected, _ = counted(cosines(result, about) < math.cos(ANGLE))
    assert np.array_equal(found, expected) and expected.sum() > 100
    for other in set(DIRECTIONS) - {about}:  # any other direction gives other numbers
        assert np.mean(found != counted(cosines(result, other) < math.cos(ANGLE))[0]) > 0.4


def test_a_start_beyond_may_be_left_out(result):
    cosine = cosines(result, "local_vertical")
    count, expected = counted(-cosine > math.cos(ANGLE))
    assert np.array_equal(result.passages_4.values, expected)
    assert np.sum(count != expected) > 5  # measured 16
    assert not (result.passage_first_4.values == 0.0).any()
    assert "about the local vertical, starts beyond it ignored" in result.passages_4.long_name
    began = cosine[0] < math.cos(ANGLE)
    assert (result.passage_first.values[began] == 0.0).all()


def test_the_normal_of_an_orbit_is_the_vertical():
    one, other = (
        rm.Passage(2, ANGLE, about=about).bind(np.empty((3, 0)), True, (ORBIT,))
        for about in ("orbit_normal", "vertical")
    )
    assert one == other and type(one) is type(other)


def test_scene_files_take_them():
    loaded = rm.Scene.loads(SCENE.dumps())
    assert [tuple(one.about) for one in loaded.observables] == [tuple(o.about) for o in WATCHED]
    assert [one.at_start for one in loaded.observables] == [one.at_start for one in WATCHED]


FIELD = rm.UniformField((0.0, 0.0, 1.0), (0.3, 0.4, 1.2))
NO_DIRECTION = r"observables\.passage.*about.*local_vertical"


@pytest.mark.parametrize(
    ("event", "effects", "words"),
    [
        *(({"about": about}, None, NO_DIRECTION)
          for about in ("sideways", (1.0, 2.0), (0.0, 0.0, 0.0), ("a", 1, 2), math.nan)),
        ({"at_start": "skip"}, None, r"at_start.*count, ignore"),
        ({"about": "local_vertical"}, (), r"add \[effects.gravity_gradient\]"),
        ({"about": "field"}, ORBIT, r"add \[effects\.uniform_field\]"),
        ({"about": "field"}, (FIELD, FIELD), "expected one field"),
    ],
)  # fmt: skip
def test_what_is_no_direction_is_told(event, effects, words):
    """By the scene, or where effects count by its run."""
    with pytest.raises(SceneError, match=words):
        scene = rm.Scene(SCENE.body, effects or (), observables=(rm.Passage(1, 1.0, **event),))
        assert effects is not None
        rm.simulate(scene, dt=1.0, t_end=2.0, members=2, save=("passage",))


B = (0.3, 0.4, 1.2)
TURNS = 1.7  # [rad/s]


def test_the_direction_of_a_field_in_the_body():
    """Of a field that turns and of one that does not, not compiled."""
    turned = Rotation.from_rotvec((0.0, 0.0, 2.0 * TURNS)).apply(B)
    q = (0.1, 0.7, -0.5, 0.5)
    for one, known in (
        (rm.UniformField((1.0, 0.0, 0.0), B), B),
        (rm.RotatingField((1.0, 0.0, 0.0), B, TURNS), turned),
    ):
        effects = rm.Gravity(1.0), one
        found = direction_in_body(make_direction("field", effects, ""), effects, 2.0, q, None)
        expected = Rotation.from_quat(q, scalar_first=True).inv().apply(known)
        assert np.abs(np.array(found) - expected).max() < 1e-15  # measured 2e-16


@pytest.mark.parametrize("rate", [pytest.param(0.0, marks=pytest.mark.slow), TURNS])
def test_a_passage_about_a_field_follows_it(rate):
    dipole = (0.1, 0.0, 0.2)
    field = rm.RotatingField(dipole, B, rate) if rate else rm.UniformField(dipole, B)
    body = rm.Body.from_moments((1.0, 1.4, 1.2))
    start = rm.Start(omega=(rm.normal(0.0, 1.0),) * 3, attitude="uniform")
    seen = rm.Passage(-2, ANGLE, "reaches", "field")
    scene = rm.Scene(body, (rm.BodyTorque((0.0, 0.0, 0.01)), field), start, observables=(seen,))
    ways = {"dt": 0.01, "t_end": 20.0, "every": 0.01, "members": 64}
    run = rm.simulate(scene, "rk4", **ways, save=("passage", "attitude"))
    axes, count = turned(run, [0.0, -1.0, 0.0]), {}
    for turn in (0.0, TURNS):
        about = Rotation.from_rotvec(np.outer(turn * run.time.values, (0.0, 0.0, 1.0)))
        cosine = (axes * about.apply(np.array(B) / 1.3)[:, None]).sum(2)
        count[turn] = counted(cosine > math.cos(ANGLE))[0]
    # a passage that comes and goes within 10 ms is in the result alone: none is, or few are
    assert np.abs(run.passages.values - count[rate]).sum() <= 2 and count[rate].sum() > 100
    assert np.mean(run.passages.values != count[TURNS - rate]) > 0.4  # the other field
    assert "about the field" in run.passages.long_name


def test_two_passages_are_saved_by_their_labels():
    two = rm.Passage(1, 0.5), rm.Passage(2, 0.5)
    scene = rm.Scene(rm.Body((1.0, 2.0, 2.5)), observables=two)
    for save in (("passage", "passage_2"), ("passage_2",)):
        monitored = scene.with_run(save=save).recording.monitored
        assert [label for label, _ in monitored] == ["passage", "passage_2"]
    with pytest.raises(rm.SceneError, match="no such observable"):
        scene.with_run(save=("passage_3",))
