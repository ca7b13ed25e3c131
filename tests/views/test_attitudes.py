"""Saved attitudes as scipy's Rotation and as Euler angles, against scipy."""

import numpy as np
import pytest

import rigidmc as rm
from rigidmc.mechanics.euler_angles import SEQUENCES, angle_names

SPIN = 1.3


@pytest.fixture(scope="module")
def tumbling():
    start = rm.Start(omega=rm.Sphere(1.0), attitude="uniform")
    scene = rm.Scene(rm.Body((1.0, 2.0, 2.5)), start=start)
    run = {"dt": 0.05, "t_end": 5.0, "every": 0.5, "members": 7}
    return rm.simulate(scene, save=("attitude", "omega", "momentum"), **run)


def spinner(axis=3, attitude=(1.0, 0.0, 0.0, 0.0), every=0.5, save=("attitude", "omega")):
    omega = [0.0, 0.0, 0.0]
    omega[axis - 1] = SPIN
    scene = rm.Scene(rm.Body((1.0, 1.0, 1.0)), start=rm.Start(omega=omega, attitude=attitude))
    return rm.simulate(scene, dt=0.05, t_end=20.0, every=every, members=2, save=save)


def test_rotations_are_members_within_times(tumbling):
    found = tumbling.rigid.rotation()
    q = tumbling.attitude.transpose("time", "member", "quat").values
    assert len(found) == 11 * 7
    same = found.as_quat(scalar_first=True).reshape(11, 7, 4)
    assert np.abs(same - q).max() < 1e-15  # measured 2.2e-16
    last = tumbling.isel(time=-1).rigid.rotation()
    assert np.array_equal(last.as_quat(), found[-7:].as_quat())
    one = tumbling.isel(member=3).rigid.rotation()
    assert np.array_equal(one.as_quat(), found[3::7].as_quat())
    assert tumbling.isel(member=3, time=2).rigid.rotation().as_quat().shape == (4,)
    # from body to space: the momentum of a free body stays
    momentum = tumbling.momentum.transpose("time", "member", "axis").values
    space = found.apply(momentum.reshape(-1, 3)).reshape(11, 7, 3)
    assert np.abs(space - space[:1]).max() < 1e-6  # measured 2e-7, of rk4
    other = found.inv().apply(momentum.reshape(-1, 3)).reshape(11, 7, 3)
    assert np.abs(other - other[:1]).max() > 1.0


@pytest.mark.parametrize("sequence", SEQUENCES)
def test_euler_angles_are_scipys(tumbling, sequence):
    scipys = sequence.translate(str.maketrans("123", "XYZ"))
    found = tumbling.rigid.euler(sequence)
    true = tumbling.rigid.rotation().as_euler(scipys).reshape(11, 7, 3)
    names = angle_names(sequence)
    assert tuple(found) == names
    for i, name in enumerate(names):
        assert found[name].dims == ("time", "member")
        assert found[name].units == "rad"
        assert np.abs(np.sin(found[name].values - true[..., i])).max() < 1e-13  # measured 3e-15
        assert np.abs(np.cos(found[name].values - true[..., i]) - 1.0).max() < 1e-13
    assert found.equals(tumbling.rigid.euler(scipys))
    part = tumbling.isel(time=-1).rigid.euler(sequence)
    assert np.array_equal(part[names[0]], found[names[0]].isel(time=-1))


def test_attributes_name_the_axes(tumbling):
    found = tumbling.rigid.euler("321")
    assert found.attrs["sequence"] == "321"
    assert found.yaw.long_name == "yaw, first angle of 321: about the body axis 3"
    assert found.pitch.long_name == "pitch, second angle of 321: about the new body axis 2"
    assert found["roll"].long_name == "roll, third angle of 321: about the last body axis 1"
    assert "where pitch is -pi/2 and pi/2" in found["roll"].comment
    assert "comment" not in found.pitch.attrs
    assert tumbling.rigid.euler().psi.long_name == "angle of proper rotation"
    with pytest.raises(rm.SceneError, match="lower case"):
        tumbling.rigid.euler("zyx")
    with pytest.raises(ValueError, match="attitude was not saved"):
        tumbling.drop_vars("attitude").rigid.rotation()


@pytest.mark.parametrize(("sequence", "axis", "name"), [("321", 3, "yaw"), ("132", 2, "pitch")])
def test_unwrapped_angles_count_turns(sequence, axis, name):
    ds = spinner(axis)
    turns = ds.rigid.euler(sequence, unwrap=True)[name]
    true = SPIN * ds.time.values
    assert np.abs(turns.T - true).max() < 1e-6  # of 26; measured 2.4e-7, of rk4
    assert np.abs(ds.rigid.euler(sequence)[name]).max() <= np.pi
    bare = ds.drop_vars("omega").rigid.euler(sequence, unwrap=True)[name]
    assert np.array_equal(bare, turns)


def test_unwrapping_refuses_what_is_saved_too_seldom():
    with pytest.raises(ValueError, match=r"turn by up to 2\.6 rad between saves 2 s apart.*every"):
        spinner(every=2.0).rigid.euler("321", unwrap=True)
    assert "yaw" in spinner(every=2.0).rigid.euler("321")


def test_unwrapping_refuses_a_passage_of_gimbal_lock():
    ds = spinner(2)
    with pytest.raises(ValueError, match=r"2 of 2 members may pass gimbal lock.*such as 323"):
        ds.rigid.euler("321", unwrap=True)
    # the sequence that the message names: theta is SPIN t, folded, and so it passes its own lock
    with pytest.raises(ValueError, match="gimbal lock"):
        ds.rigid.euler("323", unwrap=True)
    # a tilt of the spin axis keeps its distance
    tilted = spinner(3, attitude={"euler": "321", "angles": (0.0, 0.5, 0.3)})
    found = tilted.rigid.euler("323", unwrap=True)
    assert abs(found.psi[-1, 0] - found.psi[0, 0] - 20.0 * SPIN) < 1e-6  # measured 2.4e-7
    with pytest.raises(ValueError, match="dimension member is missing"):
        ds.isel(member=0).rigid.euler("321", unwrap=True)


def test_the_textbooks_angles_unwrap_as_before():
    ds = rm.simulate(rm.Scene.load("heavy_top"), members=4, t_end=0.8)
    found = ds.rigid.euler(unwrap=True)
    assert np.array_equal(found.psi, ds.rigid.unwrapped("psi"))
    assert np.array_equal(found.phi, ds.rigid.unwrapped("phi"))


def test_attitudes_that_are_nan_are_named(tumbling):
    part = tumbling.copy()
    part["attitude"] = tumbling.attitude.where(tumbling.member != 2)
    with pytest.raises(ValueError, match="11 of 77 attitudes are not finite"):
        part.rigid.rotation()
    found = part.rigid.euler("321").yaw
    assert np.isnan(found.sel(member=2)).all()
    whole = tumbling.rigid.euler("321").yaw
    assert np.array_equal(found.drop_sel(member=2), whole.drop_sel(member=2))
