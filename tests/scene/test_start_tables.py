"""Tables of a start: Euler angles of 12 sequences, units, orders, and what they refuse."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import rigidmc as rm
from rigidmc.mechanics.euler_angles import SEQUENCES, angle_names
from rigidmc.mechanics.rotation import attitude_error
from rigidmc.scene.parameters import parameter_names, value_at, with_parameters
from rigidmc.scene.varied import nominal_of
from tests.tools.commands import invoke

BODY = rm.Body((1.0, 2.0, 2.5))
SCENE = "[body]\nmoments = [1.0, 2.0, 2.5]\n[start]\nomega = [0.0, 0.1, 1.0]\nattitude = "
ORBIT = "[effects.gravity_gradient]\nmu = 3.986e14\ndistance = 7e6\n"


def attitude_of(start, count=1):
    return start.sample_attitude(0, 0, count).T


def loaded(attitude):
    return rm.Scene.loads(ORBIT + SCENE + attitude)


@pytest.mark.parametrize("sequence", SEQUENCES)
def test_sequences_are_scipys_and_survive_a_file(sequence):
    scipys = sequence.translate(str.maketrans("123", "XYZ"))
    true = Rotation.from_euler(scipys, (10.0, 20.0, 30.0), degrees=True)
    table = f'{{ euler = "{sequence}", angles = [10, 20, 30], unit = "deg" }}'
    scene = loaded(table)
    assert attitude_error(attitude_of(scene.start)[0], true) < 1e-15  # measured 2.4e-16
    again = rm.Scene.loads(scene.dumps())
    assert again.start.attitude == scene.start.attitude
    assert again.start.sequence == sequence
    direct = rm.Start(omega=(0, 0, 1), attitude=scene.start.attitude, sequence=scipys)
    assert np.array_equal(attitude_of(direct), attitude_of(scene.start))
    other = rm.Start(omega=(0, 0, 1), attitude=scene.start.attitude[::-1], sequence=sequence)
    assert attitude_error(attitude_of(other)[0], true) > 0.1


def test_the_sequence_of_the_textbook_is_written_as_before():
    plain = rm.Start(omega=(0, 0, 1), attitude=(0.1, 0.2, 0.3))
    table = rm.Start(omega=(0, 0, 1), attitude={"euler": "313", "angles": (0.1, 0.2, 0.3)})
    assert attitude_of(plain).tobytes() == attitude_of(table).tobytes()
    assert rm.Scene(BODY, start=table).dumps() == rm.Scene(BODY, start=plain).dumps()


def test_each_member_draws_its_angles_in_degrees():
    table = """{ euler = "321", unit = "deg",
        angles = [{ grid = [0.0, 40.0, 4] }, { normal = [0.0, 2.0] }, { uniform = [-5, 5] }] }"""
    scene = loaded(table.replace("\n", ""))
    laws = rm.grid(0.0, 40.0, 4), rm.normal(0.0, 2.0), rm.uniform(-5.0, 5.0)
    angles = tuple(law.times(np.pi / 180.0) for law in laws)
    same = rm.Start(omega=(0, 0, 1), sequence="321", attitude=angles)
    q = attitude_of(scene.start, 200)
    assert attitude_error(q, attitude_of(same, 200)).max() < 1e-15  # measured 3.3e-16
    yaw, pitch, roll = Rotation.from_quat(q, scalar_first=True).as_euler("ZYX", degrees=True).T
    assert np.abs(yaw - np.tile([5.0, 15.0, 25.0, 35.0], 50)).max() < 1e-13  # measured 1.4e-14
    assert abs(pitch.std() - 2.0) < 0.3  # 3 standard errors
    assert 4.5 < np.abs(roll).max() <= 5.0
    assert rm.Scene.loads(scene.dumps()).start.attitude == scene.start.attitude


def test_one_row_per_member(tmp_path):
    angles = np.random.default_rng(1).uniform(-1.0, 1.0, (6, 3))
    names = ("yaw", "pitch", "roll")
    rows = "\n".join(",".join(map(repr, row)) for row in angles.tolist())
    (tmp_path / "a.csv").write_text(f"{','.join(names)}\n{rows}\n")
    table = '{ euler = "321", angles = { table = "a.csv", columns = ["yaw", "pitch", "roll"] } }'
    (tmp_path / "s.toml").write_text(SCENE + table)
    true = Rotation.from_euler("ZYX", angles)
    attitudes = {
        "array": {"euler": "ZYX", "angles": angles},
        "Rotation": true,
        "xyzw": {"quaternion": true.as_quat(), "order": "xyzw"},
        "matrices": {"matrix": true.as_matrix()},
    }
    scenes = {
        name: rm.Scene(BODY, start=rm.Start(omega=(0, 0.1, 1), attitude=attitude))
        for name, attitude in attitudes.items()
    }
    scenes["file"] = rm.Scene.load(str(tmp_path / "s.toml"))
    for name, scene in scenes.items():
        ds = rm.simulate(scene, dt=0.1, t_end=0.1, save=("attitude",))
        q = ds.start_attitude.transpose("member", "quat").values
        assert attitude_error(q, true).max() < 2e-15, name  # measured 5e-16
        again = rm.simulate(ds.rigid.scene())
        assert np.array_equal(again.attitude, ds.attitude), name
    ds = rm.simulate(scenes["file"], dt=0.1, t_end=0.1, save=("attitude",))
    assert ds.start_euler.attrs["sequence"] == "321"
    assert "(yaw, pitch, roll)" in ds.start_euler.long_name
    assert np.array_equal(ds.start_euler.T, angles)


def test_three_members_are_no_matrix():
    angles = np.eye(3)
    start = rm.Start(omega=(0, 0, 1), attitude={"euler": "321", "angles": tuple(angles.T)})
    with pytest.raises(rm.SceneError, match="two ways"):  # components first, or members first
        rm.Start(omega=(0, 0, 1), attitude={"euler": "321", "angles": angles})
    true = Rotation.from_euler("ZYX", angles)
    assert attitude_error(attitude_of(start, 3), true).max() < 1e-15  # measured 2.3e-16


def test_scalar_last_by_a_word():
    scene = loaded('{ quaternion = [0.1, 0.2, 0.3, 0.9], order = "xyzw" }')
    true = Rotation.from_quat([0.1, 0.2, 0.3, 0.9])
    assert attitude_error(attitude_of(scene.start)[0], true) < 1e-15  # measured 1.6e-16
    assert rm.Scene.loads(scene.dumps()).start.attitude == scene.start.attitude
    same = loaded('{ quaternion = [0.9, 0.1, 0.2, 0.3], order = "wxyz" }')
    assert same.start.attitude == scene.start.attitude
    assert loaded("{ matrix = [[0,-1,0],[1,0,0],[0,0,1]] }").start.attitude == pytest.approx(
        (np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5))
    )


def test_set_reaches_into_a_table(tmp_path):
    table = '{ euler = "321", angles = [10, 20, 30], unit = "deg" }'
    (tmp_path / "s.toml").write_text(SCENE + table)
    settings = [("start.attitude.angles.1", "90"), ("start.attitude.euler", "123")]
    scene = rm.Scene.load(str(tmp_path / "s.toml"), settings)
    true = Rotation.from_euler("XYZ", (90, 20, 30), degrees=True)
    assert attitude_error(attitude_of(scene.start)[0], true) < 1e-15  # measured 2.4e-16


@pytest.mark.parametrize("sequence", ["313", "321", "132"])
def test_parameters_have_the_names_of_the_angles(sequence):
    table = f'{{ euler = "{sequence}", angles = [0.1, 0.2, 0.3] }}'
    scene, names = loaded(table), angle_names(sequence)
    known = [name for name in parameter_names(scene.model) if name.startswith("start.attitude")]
    assert known == [f"start.attitude.{name}" for name in names]
    for place, name in enumerate(known):
        changed = scene.with_model(with_parameters(scene.model, {name: 0.7}))
        expected = [0.1, 0.2, 0.3]
        expected[place] = 0.7
        assert changed.start.attitude == tuple(expected)
        assert changed.start.sequence == sequence
        assert value_at(changed.model, name) == 0.7
    assert nominal_of(scene.model, ["start.attitude"]) == {"start.attitude": [0.1, 0.2, 0.3]}
    if sequence == "321":
        with pytest.raises(rm.SceneError, match="yaw"):
            with_parameters(scene.model, {"start.attitude.yav": 0.7})


def test_varied_angles_run_and_rerun():
    scene = loaded('{ euler = "321", angles = [0.1, 0.2, 0.3] }').with_run(dt=0.1, t_end=0.1)
    prepared = rm.prepare(scene, save=("attitude",), varied=("start.attitude", "start.omega.3"))
    angles = np.random.default_rng(2).uniform(-1.0, 1.0, (5, 3))
    ds = prepared.run(values={"start.attitude": angles, "start.omega.3": np.ones(5)})
    q = ds.attitude.isel(time=0).transpose("member", "quat").values
    assert attitude_error(q, Rotation.from_euler("ZYX", angles)).max() < 2e-15  # measured 4e-16
    again = ds.rigid.rerun(3)
    assert np.array_equal(again.attitude.isel(member=0), ds.attitude.isel(member=3))


def test_arrays_that_stand_on_their_side_are_refused():
    q = Rotation.random(5, rng=3).as_quat()
    for turned in (q.T, q[:4].T):
        with pytest.raises(rm.SceneError, match="transpose"):
            rm.Start(omega=(0, 0, 1), attitude={"quaternion": turned, "order": "xyzw"})
    with pytest.raises(rm.SceneError, match="transpose"):
        rm.Start(omega=(0, 0, 1), attitude={"euler": "321", "angles": np.ones((3, 5))})


def test_a_sequence_belongs_to_angles_alone():
    start = rm.Start(omega=(0, 0, 1), attitude=(0.1, 0.2, 0.3), sequence="321")
    assert replace(start, attitude=(0.0, 0.0, 0.0)).sequence == "321"
    assert replace(start, attitude="uniform").sequence == "313"
    with pytest.raises(rm.SceneError, match="one of 121"):
        rm.Start(omega=(0, 0, 1), attitude=(0.1, 0.2, 0.3), sequence="xyz1")


def test_show_names_the_angles():
    from rigidmc.views.descriptions import describe_scene

    scene = loaded('{ euler = "321", angles = [0.1, 0.2, 0.3], relative_to = "orbit" }')
    # with prices, also without effects
    text = describe_scene(scene.with_run(dt=0.1, t_end=1.0), 1, "cpu")
    assert "(321: yaw, pitch, roll) from the frame of the orbit" in text


def test_plain_numbers_in_a_table_are_no_sample():
    from rigidmc.files.reading import toml
    from rigidmc.scene.sampling import is_sample_of

    plain = '{ euler = "321", angles = [0.1, 0.2, { grid = [0.0, 1.0, 4] }], unit = "deg" }'
    drawn = '{ euler = "321", angles = [0.1, 0.2, { normal = [0.0, 1.0] }], unit = "deg" }'
    moved = SCENE.replace("[0.0, 0.1, 1.0]", '{ rate = [0, 0, 1], relative_to = "orbit" }')
    assert not is_sample_of(toml(ORBIT + moved + plain))
    assert is_sample_of(toml(ORBIT + moved + drawn))


def test_the_command_line_names_the_place(tmp_path):

    file = tmp_path / "s.toml"
    file.write_text(SCENE + '{ euler = "331", angles = [1, 2, 3] }')
    found = invoke("check", file)
    assert found.exit_code == 3
    assert "s.toml: [start.attitude] euler = '331': expected three axes" in found.output
    found = invoke("check", file, "--set", "start.attitude.euler=321")
    assert found.exit_code == 0


def test_rates_have_a_unit():
    rate = '{ rate = [{ normal = [0.0, 0.01] }, 0, 1], unit = "deg/s", relative_to = "orbit" }'
    start = rm.Scene.loads(ORBIT + SCENE.replace("[0.0, 0.1, 1.0]", rate) + "[1, 0, 0, 0]").start
    drawn, fixed, last = start.omega
    assert drawn.parameters == pytest.approx((0.0, 0.01 * np.pi / 180.0), rel=1e-15)
    assert (fixed, last) == (0.0, pytest.approx(np.pi / 180.0, rel=1e-15))
