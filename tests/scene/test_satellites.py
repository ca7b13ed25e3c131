"""Bodies on an orbit turn about their centre of mass, each uncertain one about its own."""

import warnings
from typing import NamedTuple

import numpy as np
import pytest
import xarray as xr

import rigidmc as rm
from rigidmc.engine.kernel import layout
from rigidmc.errors import SceneError, SceneWarning
from rigidmc.mechanics.inertia import symmetric
from rigidmc.planning.unit_scale import scale_scene
from rigidmc.protocols import Vector, effect
from rigidmc.results.principal_axes import in_principal_axes
from tests.physics.effects.laws import Motion, Properties
from tests.tools.plans import starts

# a slender satellite with products of inertia, its centre known to 1 cm along its length
MEAN = np.array([[10.0, 0.2, 0.0], [0.2, 56.0, 0.3], [0.0, 0.3, 60.0]])
DEVIATIONS = np.array([0.3, 1.2, 1.3, 0.4, 0.3, 0.3, 0.01, 0.003, 0.003])
CENTRE, MASS, MU, DISTANCE = (0.3, 0.02, -0.05), 80.0, 3.986004418e14, 6.878137e6
RATE = np.sqrt(MU / DISTANCE**3)
PULL = rm.GravityGradient(MU, DISTANCE)
END = 1400.0  # s, a quarter of an orbit


def given():
    """The body about the origin of its tensor, of which the centre of mass is off."""
    return rm.Body.from_tensor(rm.UncertainInertia(MEAN, np.diag(DEVIATIONS**2)), MASS, CENTRE)


SPIN = rm.Start(omega=(0.0, 0.0, RATE), attitude=(1.0, 0.0, 0.0, 0.0))  # along the orbit normal


def described(tensor):
    """Attitude at the end by Euler's equations with a full tensor, in the described axes."""
    pull, start = [("gravity_gradient", PULL)], (1.0, 0.0, 0.0, 0.0)
    motion = Motion(Properties(tensor), pull, (0.0, 0.0, RATE), start, END, 2, np.inf)
    return motion.attitude(motion.states[:, -1])


def apart(one, other):
    """The angle between two attitudes [rad]."""
    return 2.0 * min(np.linalg.norm(one - other), np.linalg.norm(one + other))


def test_each_draw_turns_about_its_own_centre_of_mass():
    body = given().with_pivot_at_centre()
    scene = rm.Scene(body, PULL, SPIN)
    run = {"dt": 5.0, "t_end": END, "every": END, "members": 3, "seed": 7}
    ds = rm.simulate(scene, "rk8", save=("attitude",), **run)
    assert not ds.centre.values.any()
    ends = ds.rigid.described("attitude").isel(time=-1).values.T
    drawn = given().moments.bodies(7, "body.tensor", 0, 3, MASS, CENTRE)
    errors, wrong = [], []
    for end, (*six, x, y, z, mass) in zip(ends, drawn.T, strict=True):
        tensor, c = symmetric(np.array(six)[:, None])[0], np.array([x, y, z])
        errors.append(apart(end, described(tensor - mass * (c @ c * np.eye(3) - np.outer(c, c)))))
        wrong.append(apart(end, described(tensor)))
    assert max(errors) < 1e-11  # measured 1.4e-12
    assert min(wrong) > 0.02  # measured 0.057, by the tensor about the origin


def test_a_mean_centre_and_each_centre_are_not_the_same():
    """The reduced bodies exist, and have the moments of numpy's own reduction."""
    moments, _, centre = given().with_pivot_at_centre().sample(7, 0, 1000)
    drawn = given().moments.bodies(7, "body.tensor", 0, 1000, MASS, CENTRE)
    c, mass = drawn[6:9].T, drawn[9]
    square = (c * c).sum(1)[:, None, None] * np.eye(3) - c[:, :, None] * c[:, None, :]
    true = np.linalg.eigvalsh(symmetric(drawn[:6]) - mass[:, None, None] * square).T
    assert np.abs(np.sort(moments, 0) / true - 1.0).max() < 1e-13  # measured 1.3e-15
    middle = (CENTRE @ np.array(CENTRE)) * np.eye(3) - np.outer(CENTRE, CENTRE)
    same = np.linalg.eigvalsh(symmetric(drawn[:6]) - MASS * middle).T
    assert np.abs(np.sort(moments, 0) / same - 1.0).max() > 1e-3  # measured 0.035
    assert not centre.any()


def test_files_and_other_units_keep_the_centre():
    scene = rm.Scene(given().with_pivot_at_centre(), PULL)
    start = starts(scene, 0, 16, True)[1]
    again = rm.Scene.loads(scene.dumps())
    assert again.dumps() == scene.dumps()
    pivot = rm.Scene(given(), PULL).dumps().replace("[body]", '[body]\npivot = "centre"')
    for same in (again, rm.Scene.loads(pivot)):
        assert np.array_equal(starts(same, 0, 16, True)[1]["moments"], start["moments"])
    other = starts(scale_scene(scene, 4.0, 2.0, 2.0), 0, 16, True)[1]
    assert np.allclose(other["moments"], 16.0 * start["moments"], rtol=1e-13, atol=0)


@pytest.mark.parametrize(
    ("body", "words"),
    [
        (given(), "with_pivot_at_centre"),
        (
            rm.Body.from_tensor(rm.UncertainInertia(MEAN, np.diag(DEVIATIONS**2)), MASS),
            "for each draw",
        ),
        (rm.Body.box(mass=1.0, size=(1.0, 2.0, 3.0)).with_pivot((0.1, 0.0, 0.0)), 'pivot = "centr'),
        (rm.Body((rm.normal(1.0, 0.01), 2.0, 2.5), 1.0, (0.1, 0, 0)), "give moments"),
    ],
    ids=["uncertain", "uncertain about 0", "solid", "moments"],
)
def test_an_orbit_refuses_a_centre_off_the_fixed_point(body, words):
    with pytest.raises(SceneError, match=rf"\[body\] centre = .*turns about.*{words}"):
        rm.prepare(rm.Scene(body, PULL).with_run(dt=1.0, t_end=10.0))
    rm.prepare(rm.Scene(body, rm.Gravity(9.81)).with_run(dt=1.0, t_end=10.0))


def test_a_plain_body_moves_to_its_centre():
    box = rm.Body.box(mass=1.0, size=(1.0, 2.0, 3.0))
    text = rm.Scene(box, PULL).dumps()
    moved = "[body]\nbox = { mass = 1.0, size = [1, 2, 3] }\npivot = 'centre'\n"
    loaded = rm.Scene.loads(moved + text[text.index("[effects") :])
    assert loaded.body.moments == box.moments
    with pytest.raises(SceneError, match=r"pivot = .*did you mean .centre"):
        rm.Scene.loads(moved.replace("'centre'", "'center'") + text[text.index("[effects") :])
    law = rm.UncertainInertia(MEAN, np.diag(DEVIATIONS**2), centre=CENTRE)
    with pytest.raises(SceneError, match="omit this"):
        rm.Body.from_tensor(law, MASS, CENTRE)
    with pytest.raises(SceneError, match=r"centre.*3 numbers"):
        rm.Body.from_tensor(rm.UncertainInertia(MEAN, np.diag(DEVIATIONS**2), centre=0.1))


WHEEL, MOTOR = (0.0, 0.0, 0.1), (0.0, 0.0, rm.normal(0.0, 1e-9))


def wheels(axes, tmp_path):
    """The result, from a file, of eight uncertain bodies with a wheel."""
    law = rm.UncertainInertia(MEAN, np.diag(DEVIATIONS[:6] ** 2))
    body = rm.Body.from_tensor(law, axes=axes)
    scene = rm.Scene(body, rm.Rotor(WHEEL, MOTOR), rm.Start(omega=(1e-3, -2e-3, 3e-3)))
    file = tmp_path / "wheel.nc"
    run = {"dt": 10.0, "t_end": 1000.0, "every": 10.0, "members": 8, "seed": 1}
    rm.simulate(scene, "rk8", output=file, **run).close()
    return body, rm.open(file)


def drift(ds, h):
    size = np.sqrt(((ds.rigid.momentum().transpose("time", "axis", "member") + h) ** 2).sum("axis"))
    return float(abs(size / size[0] - 1.0).max())


def test_results_have_fixed_vectors_in_the_axes_of_the_tensor(tmp_path):
    """|L + H| is constant with the H that was given, and not with H in principal axes."""
    _, result = wheels("described", tmp_path)
    with result as ds:
        assert "rotor_momentum" not in ds  # what all members share is in the scene
        assert ds.rotor_motor.dims == ("axis", "member")
        wheel = xr.DataArray(np.tile(np.array([WHEEL]).T, 8), dims=("axis", "member"))
        assert drift(ds, wheel) < 3e-5  # measured 7.7e-6, by the motor
        own = in_principal_axes(ds.assign(rotor_momentum=wheel)).rotor_momentum
        assert drift(ds, own) > 1e-3  # measured 0.10


def test_results_in_principal_axes_have_fixed_vectors_in_those_of_each_member(tmp_path):
    """|L + H| is constant with the H of the result, and not with the one that was given."""
    body, result = wheels("principal", tmp_path)
    with result as ds:
        given = ds.rotor_momentum.copy(data=np.tile(np.array([WHEEL]).T, 8))
        assert drift(ds, ds.rotor_momentum) < 3e-5  # measured 7.7e-6, by the motor
        assert drift(ds, given) > 1e-3  # measured 0.10
        found, own = ds.rigid.described("rotor_momentum"), body.to_reference(WHEEL)
        assert np.allclose(found.T, own, rtol=0, atol=1e-15)  # measured 4e-17
        assert "principal axes of the member" in ds.rotor_momentum.long_name
        assert "rotor_motor" in ds
    table = rm.Rotor((np.zeros(8), np.zeros(8), np.ones(8)))
    with pytest.raises(SceneError, match=r"\[effects.rotor\] momentum.*excludes body-fixed tables"):
        rm.prepare(rm.Scene(body, table).with_run(members=8, dt=0.1, t_end=1.0))


class Thrust(NamedTuple):
    size: Vector

    def torque(self):
        return self.size


class Wind(Thrust):
    """States that nothing is fixed in the body."""


class Thruster(Thrust):
    """States what is."""


@pytest.mark.parametrize(
    ("kind", "stated"), [(Thrust, None), (Wind, ()), (Thruster, ("size",))], ids=lambda x: str(x)
)
def test_an_own_vector_is_turned_if_it_says_so(kind, stated):
    more = {} if stated is None else {"in_body": stated}
    kind = effect(units={"size": "N m"}, shapes={"size": 3}, **more)(kind)
    body = rm.Body.from_tensor(rm.UncertainInertia(MEAN, np.diag(DEVIATIONS[:6] ** 2)))
    force = (1e-4, 0.0, 3e-4)
    scene = rm.Scene(body, kind(force)).with_run(members=4, dt=10.0, t_end=100.0)
    rows = slice(layout.EFFECTS, layout.EFFECTS + 3)
    acting = starts(scene, 0, 4, True)[0][rows]
    turned = starts(rm.Scene(body, rm.BodyTorque(force)).with_run(), 0, 4, True)[0][rows]
    assert np.abs(turned - np.array([force]).T).max() > 1e-6
    assert np.array_equal(acting, turned if stated else np.tile(np.array([force]).T, 4))
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always", SceneWarning)
        rm.simulate(scene, "rk4")
    words = "size is used along the principal axes"
    assert any(words in str(one.message) for one in told) == (stated is None)
