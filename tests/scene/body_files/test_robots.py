"""URDF and MJCF: poses against scipy and sums by hand, and mistakes with their cures."""

import encodings.aliases
import os

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import rigidmc as rm
from rigidmc.scene.body_files.mjcf import _Angles, _turn
from rigidmc.scene.body_files.urdf import rpy
from rigidmc.scene.body_files.xml_tree import read_xml
from tests.tools.reference import moved

LINK = """<link name="{name}"> <inertial> <origin xyz="{xyz}" rpy="{rpy}"/> <mass value="{mass}"/>
 <inertia ixx="0.02" ixy="0.001" ixz="-0.002" iyy="0.03" iyz="0.003" izz="0.04"/>
 </inertial> </link>"""
JOINT = """<joint name="{parent}_{child}" type="{kind}"> <parent link="{parent}"/>
 <child link="{child}"/> <origin xyz="{xyz}" rpy="{rpy}"/> </joint>"""
TENSOR = np.array([[0.02, 0.001, -0.002], [0.001, 0.03, 0.003], [-0.002, 0.003, 0.04]])


def link(name, xyz="0 0 0", rpy="0 0 0", mass=1.0):
    return LINK.format(name=name, xyz=xyz, rpy=rpy, mass=mass)


def joint(parent, child, xyz="0 0 0", rpy="0 0 0", kind="fixed"):
    return JOINT.format(parent=parent, child=child, xyz=xyz, rpy=rpy, kind=kind)


def read(tmp_path, text, name="robot.urdf", **options):
    (tmp_path / name).write_text(text)
    return rm.Body.read(tmp_path / name, **options)


def robot(*parts):
    return f"<robot name='r'>{''.join(parts)}</robot>"


def mjcf(inside, compiler=""):
    return f"<mujoco>{compiler}<worldbody>{inside}</worldbody></mujoco>"


def pose(xyz, rpy):
    """A homogeneous matrix, as scipy turns about fixed axes."""
    whole = np.eye(4)
    whole[:3, :3] = Rotation.from_euler("xyz", rpy).as_matrix()
    whole[:3, 3] = xyz
    return whole


def about_origin(poses_and_masses):
    """Mass, centre and tensor of parts with TENSOR about their centres, by homogeneous matrices."""
    mass = sum(m for _, m in poses_and_masses)
    places = [p[:3, 3] for p, _ in poses_and_masses]
    centre = sum(m * x for x, (_, m) in zip(places, poses_and_masses, strict=True)) / mass
    each = zip(poses_and_masses, places, strict=True)
    return mass, centre, sum(moved(p[:3, :3] @ TENSOR @ p[:3, :3].T, m, x) for (p, m), x in each)


def test_rpy_are_angles_about_fixed_axes():
    rng = np.random.default_rng(1)
    for angles in rng.uniform(-7, 7, (50, 3)):
        assert np.abs(rpy(tuple(angles)) - pose((0, 0, 0), angles)[:3, :3]).max() < 1e-14


@pytest.mark.filterwarnings("ignore:.*includes")
def test_a_chain_of_fixed_links_against_homogeneous_matrices(tmp_path):
    rng = np.random.default_rng(2)
    numbers = rng.normal(size=(6, 2, 3)).round(6)
    words = [[" ".join(map(str, row)) for row in pair] for pair in numbers]
    names = ["a", "b", "c"]
    text = robot(
        *(link(n, *words[k], mass=k + 1.0) for k, n in enumerate(names)),
        joint("a", "b", *words[3]),
        joint("b", "c", *words[4]),
        link("moving"),
        joint("c", "moving", *words[5], kind="revolute"),
    )
    body = read(tmp_path, text, link="a")
    to_a = [np.eye(4), pose(*numbers[3]), pose(*numbers[3]) @ pose(*numbers[4])]
    mass, centre, tensor = about_origin([(to_a[k] @ pose(*numbers[k]), k + 1.0) for k in range(3)])
    assert body.mass == mass == 6.0
    assert np.abs(np.array(body.centre) - centre).max() < 1e-14  # measured 4.4e-16
    assert np.abs(body.tensor - tensor).max() < 4e-13  # of 29; measured 1.4e-14
    moved = read(tmp_path, text, link="a", pivot=(0.1, 0.2, 0.3))
    assert np.abs(np.array(moved.centre) - centre + (0.1, 0.2, 0.3)).max() < 1e-14


def test_links_without_mass_do_not_count(tmp_path):
    frames = "".join(f"<link name='f{k}'/>" for k in range(3))
    body = read(tmp_path, robot(link("base"), frames, joint("base", "f0"), joint("f0", "f1")))
    assert body.mass == 1.0 and np.abs(body.tensor - TENSOR).max() < 1e-16


ORIENTATIONS = [
    ('quat="0.5 0.1 -0.7 0.3"', Rotation.from_quat([0.1, -0.7, 0.3, 0.5])),
    ('axisangle="1 2 -2 70"', Rotation.from_rotvec(np.deg2rad(70) * np.array([1, 2, -2]) / 3)),
    ('euler="10 20 30"', Rotation.from_euler("XYZ", [10, 20, 30], degrees=True)),
    ('zaxis="1 -2 0.5"', Rotation.align_vectors([[1, -2, 0.5]], [[0, 0, 1]])[0]),
    ('zaxis="0 0 -3"', Rotation.from_rotvec([np.pi, 0, 0])),
    ('zaxis="0 0 3"', Rotation.identity()),
    ('xyaxes="0 2 0 -1 5 0"', Rotation.from_euler("z", 90, degrees=True)),
    ("", Rotation.identity()),
]


@pytest.mark.parametrize(("words", "rotation"), ORIENTATIONS)
def test_orientations_of_mjcf(tmp_path, words, rotation):
    inertial = f'<inertial pos="0 0 0" mass="1" diaginertia="0.02 0.03 0.04" {words}/>'
    body = read(tmp_path, mjcf(f"<body name='a'>{inertial}</body>"), "a.xml")
    turn = rotation.as_matrix()
    expected = turn @ np.diag([0.02, 0.03, 0.04]) @ turn.T
    assert np.abs(body.tensor - expected).max() < 4e-17  # measured 1.4e-17


@pytest.mark.parametrize("sequence", ["xyz", "XYZ", "zyx", "ZYX", "zxz"])
def test_euler_sequences_of_mjcf(sequence, tmp_path):
    """Small letters turn about turned axes, which scipy writes in capitals."""
    (tmp_path / "e.xml").write_text("<body euler='0.3 -0.5 1.1'/>")
    element = read_xml(tmp_path / "e.xml")
    made = _turn(element, "body", _Angles(1.0, sequence), "e.xml")
    expected = Rotation.from_euler(sequence.swapcase(), [0.3, -0.5, 1.1]).as_matrix()
    assert np.abs(made - expected).max() < 1e-15


@pytest.mark.filterwarnings("ignore:.*includes")
def test_welded_bodies_and_frames_of_mjcf(tmp_path):
    part = '<inertial pos="0 0 0" mass="{}" fullinertia="0.02 0.03 0.04 0.001 -0.002 0.003"/>'
    inside = f"""<body name="a" pos="9 9 9"> <joint/> {part.format(1)}
      <frame pos="1 0 0" euler="0 0 90"> <body name="b" pos="0 2 0"> {part.format(2)}
        <body name="marker"/>
        <body name="moving"> <freejoint/> {part.format(5)} </body> </body> </frame> </body>"""
    body = read(tmp_path, mjcf(inside), "a.xml", link="a")
    turned = pose((1, 0, 0), (0, 0, np.pi / 2)) @ pose((0, 2, 0), (0, 0, 0))
    mass, centre, tensor = about_origin([(np.eye(4), 1.0), (turned, 2.0)])
    assert body.mass == mass and np.abs(np.array(body.centre) - centre).max() < 1e-15
    assert np.abs(body.tensor - tensor).max() < 1e-14  # measured 8.9e-16


BODY = '<body name="a"> {} <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/> </body>'


@pytest.mark.parametrize(
    ("text", "options", "words"),
    [
        (robot(link("arm"), link("leg")), {}, "there are 2 links: choose one of arm, leg"),
        (
            robot(link("a"), link("b"), joint("a", "b"), joint("b", "a")),
            {},
            "fixed joints: form a cycle: b_a, a_b",
        ),
        (
            robot(*map(link, "abc"), joint("a", "c"), joint("b", "c")),
            {},
            "link c: is fixed to two links, by the joints a_c and b_c",
        ),
        (robot(link("arm")), {"link": "amr"}, "no such link; known: arm (did you mean 'arm'?)"),
        (robot("<link name='arm'/>"), {}, "none of them has mass"),
        (robot("<link name='arm'/>"), {"link": "arm"}, "has no <inertial> with mass"),
        (robot(link("arm"), link("arm")), {}, "expected a name of its own"),
        (robot(link("arm", mass="nan")), {}, "link arm, mass, value = 'nan': expected 1 finite"),
        (robot(link("arm", mass="1,5")), {}, "'1,5'"),
        (robot(link("arm", mass="1_5")), {}, "'1_5'"),
        (robot(link("arm", mass="-1")), {}, "a mass is not negative"),
        (robot(link("arm", xyz="1 2")), {}, "origin, xyz = '1 2': expected 3 finite numbers"),
        (robot(link("arm").replace('ixz="-0.002"', "")), {}, "inertia, ixz: is missing"),
        (robot(link("arm"), joint("arm", "x")), {}, "child = 'x': is not a link of the file"),
        (robot(link("arm"), joint("arm", "arm")), {"link": "arm"}, "form a cycle: arm_arm"),
        (robot(link("arm").replace("1.0", "${m}")), {}, "xacro FILE.xacro"),
        (robot(link("arm")), {"scale": 0.1}, "scale = 0.1: is for meshes only"),
        (robot(link("arm")), {"products": "positive"}, "is for texts of mass properties only"),
        ("<sdf/>", {}, "root element = 'sdf': is an SDF file, which rigidmc does not read"),
        ("<robot>", {}, "is not well-formed XML"),
        ("", {}, "is not well-formed XML"),
        (mjcf(BODY.format("<joint/>") * 2), {}, "expected a name of its own"),
        (mjcf(""), {}, "has no <body>"),
        (mjcf(BODY.format("")), {"link": "b"}, "no such body; known: a"),
        (mjcf("<include file='x.xml'/>"), {}, "(x.xml), and is not followed"),
        (mjcf(BODY.format(""), "<compiler settotalmass='3'/>"), {}, "changes the masses"),
        (mjcf(BODY.format(""), "<compiler inertiafromgeom='true'/>"), {}, "mj_saveLastXML"),
        (mjcf(BODY.format(""), "<compiler boundmass='0.1'/>"), {}, "raises small masses"),
        (mjcf(BODY.format(""), "<compiler angle='turns'/>"), {}, "expected degree or radian"),
        (mjcf(BODY.format(""), "<compiler eulerseq='abc'/>"), {}, "expected three letters"),
        (mjcf("<body name='a'><geom size='1'/></body>"), {"link": "a"}, "computes it from the"),
        (mjcf(BODY.format("").replace("diaginertia", "dia")), {}, "either diaginertia or"),
        (mjcf(BODY.format("").replace("pos=", "quat='0 0 0 0' pos=")), {}, "has no direction"),
        (
            mjcf(BODY.format("").replace("<body", "<body quat='1 0 0 0' euler='0 0 0'")),
            {},
            "one of",
        ),
    ],
)
def test_mistakes_are_named(tmp_path, text, options, words):
    with pytest.raises(rm.RigidmcError) as caught:
        read(tmp_path, text, **options)
    shown = str(caught.value)
    assert words in shown and "\n" not in shown and len(shown) < 700


@pytest.mark.parametrize(
    "text",
    [
        '<!DOCTYPE r [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;">]><robot>&b;</robot>',
        '<!DOCTYPE r [<!ENTITY x SYSTEM "file:///etc/passwd">]><robot>&x;</robot>',
        '<!DOCTYPE r SYSTEM "http://127.0.0.1:9/x.dtd"><robot/>',
        "<robot>" + "<link>" * 300 + "</link>" * 300 + "</robot>",
        "<robot>" + "<link/>" * 100_001 + "</robot>",
        "<robot>" + " " * (5 * 2**20) + "</robot>",
        "<robot>&undefined;</robot>",
        "\0\0\0",
    ],
)
def test_hostile_files_are_refused(tmp_path, text):
    with pytest.raises(rm.RigidmcError) as caught:
        read(tmp_path, text)
    assert len(str(caught.value)) < 400


def test_a_chain_with_many_roots_is_followed_once(tmp_path):
    """For each root, the chain was followed again: 160 s."""
    n = 3000
    empty = [f"<link name='{k}{i}'/>" for k in "cr" for i in range(n)]
    chain = [joint(f"c{i}", f"c{i + 1}") for i in range(n - 1)]
    roots = [joint(f"c{n - 1}", f"r{i}") for i in range(n)]
    with pytest.warns(rm.SceneWarning, match="link c0: includes end"):
        body = read(tmp_path, robot(*empty, link("end"), *chain, *roots, joint("r7", "end")))
    assert body.mass == 1.0
    with pytest.raises(rm.FileError, match="is fixed to two links"):
        read(tmp_path, robot(*empty, *chain, *[joint(f"r{i}", "c0") for i in range(n)]))


def test_every_encoding_is_read_or_refused(tmp_path):
    """Of all codecs of Python, ours and expat's errors are the only ones."""
    names = sorted({*encodings.aliases.aliases.values(), "undefined", "idna", "punycode", "foo"})
    count = 0
    for name in names:
        head = f'<?xml version="1.0" encoding="{name}"?>'
        (tmp_path / "robot.urdf").write_bytes((head + robot(link("arm"))).encode())
        try:
            count += rm.Body.read(tmp_path / "robot.urdf").mass == 1.0
        except rm.FileError as error:
            assert "XML" in str(error)
    assert 30 < count < len(names) - 10  # measured 59 of 102


def test_a_pipe_is_refused(tmp_path):
    os.mkfifo(tmp_path / "robot.urdf")
    with pytest.raises(rm.RigidmcError, match="is a pipe"):
        rm.Body.read(tmp_path / "robot.urdf")


def test_an_impossible_link_is_told(tmp_path):
    text = robot(link("arm", "1 1 1")).replace('izz="0.04"', 'izz="0.06"')
    with pytest.warns(rm.SceneWarning, match=r"link arm cannot exist: its principal moments"):
        read(tmp_path, text)
    with (
        pytest.warns(rm.SceneWarning, match="cannot exist"),
        pytest.raises(rm.SceneError, match=r"robot.urdf: \[body\] tensor.*no mass distribution"),
    ):
        read(tmp_path, text.replace("1 1 1", "0 0 0"))


def test_a_scene_names_a_file(tmp_path):
    (tmp_path / "robot.urdf").write_text(robot(link("arm", "0.1 0 0"), link("leg")))
    text = '[body]\nfile = "robot.urdf"\nlink = "LINK"\n[start]\nomega = [0.0, 0.0, 1.0]\n'
    (tmp_path / "scene.toml").write_text(text.replace("LINK", "arm"))
    scene = rm.Scene.load(tmp_path / "scene.toml")
    assert scene.body.mass == 1.0 and scene.body.centre == (0.1, 0.0, 0.0)
    # the text of a result has the numbers, and needs no file
    again = rm.Scene.loads(scene.dumps())
    assert np.array_equal(again.body.tensor, scene.body.tensor)
    (tmp_path / "scene.toml").write_text(text.replace("LINK", "amr"))
    with pytest.raises(rm.RigidmcError, match="did you mean 'arm'"):
        rm.Scene.load(tmp_path / "scene.toml")
    for more, words in (
        ("centre = [0, 0, 1]", "the file of the body defines this"),
        ("moments = [1, 1, 1]", "keep one of these keys"),
        ("densty = 3", "did you mean 'density'"),
    ):
        (tmp_path / "scene.toml").write_text(text.replace("[start]", f"{more}\n[start]"))
        with pytest.raises(rm.RigidmcError, match=words):
            rm.Scene.load(tmp_path / "scene.toml")
    (tmp_path / "scene.toml").write_text(text.replace("robot.urdf", "robto.urdf"))
    with pytest.raises(rm.RigidmcError, match=r"file = 'robto.urdf': no such file in"):
        rm.Scene.load(tmp_path / "scene.toml")
