"""Public robots, drawings and spacecraft: their numbers, retyped, against sums by hand.

Sources: Universal Robots UR5, ROS package ur_description; Franka Panda, franka_description and
MuJoCo Menagerie; Unitree Go1, unitree_ros and MuJoCo Menagerie; a wing drawn in SolidWorks, its
mass properties as students published them; Hubble Space Telescope, Nurre & Dougherty 1984.
"""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import rigidmc as rm
from tests.tools.reference import moved

UR5 = """<?xml version="1.0"?>
<robot name="ur5">
  <link name="upper_arm_link"> <inertial>
    <mass value="8.393"/> <origin rpy="0 0 0" xyz="0.0 0.0 0.28"/>
    <inertia ixx="0.226890675911" ixy="0.0" ixz="0.0" iyy="0.226890675911" iyz="0.0"
             izz="0.0151074"/> </inertial> </link>
  <link name="forearm_link"> <inertial>
    <mass value="2.275"/> <origin rpy="0 0 0" xyz="0.0 0.0 0.25"/>
    <inertia ixx="0.0494433313556" ixy="0.0" ixz="0.0" iyy="0.0494433313556" iyz="0.0"
             izz="0.004095"/> </inertial> </link>
  <joint name="elbow_joint" type="revolute">
    <parent link="upper_arm_link"/> <child link="forearm_link"/>
    <origin rpy="0.0 0.0 0.0" xyz="0.0 -0.1197 0.425"/> <axis xyz="0 1 0"/> </joint>
</robot>
"""

PANDA_7 = {
    "mass": 0.735522,
    "centre": (0.010517, -0.004252, 0.061597),
    "tensor": [
        [0.012516, -0.000428, -0.001196],
        [-0.000428, 0.010027, -0.000741],
        [-0.001196, -0.000741, 0.004815],
    ],
}
PANDA_HAND = {"mass": 0.73, "centre": (-0.01, 0.0, 0.03), "tensor": np.diag([1e-3, 2.5e-3, 1.7e-3])}

PANDA_URDF = """<robot name="panda">
  <link name="panda_link7"> <inertial>
    <origin xyz="0.010517 -0.004252 0.061597" rpy="0 0 0"/> <mass value="0.735522"/>
    <inertia ixx="0.012516" ixy="-0.000428" ixz="-0.001196" iyy="0.010027" iyz="-0.000741"
             izz="0.004815"/> </inertial> </link>
  <link name="panda_link8"/>
  <link name="panda_hand"> <inertial>
    <origin xyz="-0.01 0 0.03" rpy="0 0 0"/> <mass value="0.73"/>
    <inertia ixx="0.001" ixy="0" ixz="0" iyy="0.0025" iyz="0" izz="0.0017"/> </inertial> </link>
  <link name="panda_leftfinger"> <inertial> <mass value="0.1"/>
    <inertia ixx="1e-4" ixy="0" ixz="0" iyy="1e-4" iyz="0" izz="1e-4"/> </inertial> </link>
  <joint name="panda_joint8" type="fixed"> <origin rpy="0 0 0" xyz="0 0 0.107"/>
    <parent link="panda_link7"/> <child link="panda_link8"/> </joint>
  <joint name="panda_hand_joint" type="fixed"> <parent link="panda_link8"/>
    <child link="panda_hand"/> <origin rpy="0 0 -0.785398163397" xyz="0 0 0"/> </joint>
  <joint name="panda_finger_joint1" type="prismatic"> <parent link="panda_hand"/>
    <child link="panda_leftfinger"/> <origin xyz="0 0 0.0584"/> </joint>
</robot>
"""

PANDA_MJCF = """<mujoco model="panda"> <compiler angle="radian" autolimits="true"/>
  <worldbody> <light pos="0 0 1"/>
    <body name="link7" pos="0.088 0 0" quat="1 1 0 0"> <joint name="joint7" range="-2.9 2.9"/>
      <inertial mass="0.735522" pos="0.010517 -0.004252 0.061597"
        fullinertia="0.012516 0.010027 0.0048150 -0.00042800 -0.0011960 -0.00074100"/>
      <body name="hand" pos="0 0 0.107" quat="0.9238795 0 0 -0.3826834">
        <inertial mass="0.73" pos="-0.01 0 0.03" diaginertia="0.001 0.0025 0.0017"/>
        <body name="left_finger" pos="0 0 0.0584"> <joint name="finger_joint1" type="slide"/>
          <inertial mass="0.015" pos="0 0 0" diaginertia="2.375e-6 2.375e-6 7.5e-7"/> </body>
      </body>
    </body> </worldbody> </mujoco>
"""

GO1_URDF = """<robot name="go1"> <link name="trunk"> <inertial>
  <origin rpy="0 0 0" xyz="0.0223 0.002 -0.0005"/> <mass value="5.204"/>
  <inertia ixx="0.0168128557" ixy="-0.0002296769" ixz="-0.0002945293" iyy="0.063009565"
           iyz="-4.18731e-05" izz="0.0716547275"/> </inertial> </link> </robot>
"""

GO1_MJCF = """<mujoco model="go1"> <worldbody> <body name="trunk" pos="0 0 0.445"> <freejoint/>
  <inertial mass="5.204" pos="0.0223 0.002 -0.0005"
    quat="-0.00342088 0.705204 0.000106698 0.708996"
    diaginertia="0.0716565 0.0630105 0.0168101"/> </body> </worldbody> </mujoco>
"""

WING = """Mass properties of shellwing
     Configuration: Default
     Coordinate system: -- default --

Density = 16.08699420 pounds per cubic foot
Mass = 1.51653435 pounds
Volume = 0.09427083 cubic feet
Surface area = 14.68557315  square feet

Center of mass: ( feet )
\tX = -0.45582142
\tY = 0.92780847
\tZ = 0.00000000

Principal axes of inertia and principal moments of inertia: ( pounds * square feet )
Taken at the center of mass.
\t Ix = (-0.17069455,  0.98532399,  0.00000000)   \tPx = 0.16112601
\t Iy = (-0.98532399, -0.17069455,  0.00000000)   \tPy = 0.51386477
\t Iz = ( 0.00000000,  0.00000000,  1.00000000)   \tPz = 0.66303218

Moments of inertia: ( pounds * square feet )
Taken at the center of mass and aligned with the output coordinate system. (Using positive tensor notation.)
\tLxx = 0.50358715\tLxy = -0.05932693\tLxz = 0.00000000
\tLyx = -0.05932693\tLyy = 0.17140362\tLyz = 0.00000000
\tLzx = 0.00000000\tLzy = 0.00000000\tLzz = 0.66303218

Moments of inertia: ( pounds * square feet )
Taken at the output coordinate system. (Using positive tensor notation.)
\tIxx = 1.80906323\tIxy = -0.70069202\tIxz = 0.00000000
\tIyx = -0.70069202\tIyy = 0.48649877\tIyz = 0.00000000
\tIzx = 0.00000000\tIzy = 0.00000000\tIzz = 2.28360341
"""  # noqa: E501

HUBBLE = [[36046.0, -706.0, 1491.0], [-706.0, 86868.0, 449.0], [1491.0, 449.0, 93848.0]]


def panda_by_hand():
    """Mass, centre and tensor about the origin of link 7 with the hand, turned by -45 degrees."""
    turn = Rotation.from_euler("z", -45.0, degrees=True).as_matrix()
    hand = turn @ PANDA_HAND["centre"] + [0.0, 0.0, 0.107]
    mass = PANDA_7["mass"] + PANDA_HAND["mass"]
    centre = (PANDA_7["mass"] * np.array(PANDA_7["centre"]) + PANDA_HAND["mass"] * hand) / mass
    tensor = moved(PANDA_7["tensor"], PANDA_7["mass"], PANDA_7["centre"]) + moved(
        turn @ PANDA_HAND["tensor"] @ turn.T, PANDA_HAND["mass"], hand
    )
    return mass, centre, tensor


def read(tmp_path, name, text, **options):
    (tmp_path / name).write_text(text)
    return rm.Body.read(tmp_path / name, **options)


def test_ur5(tmp_path):
    forearm = read(tmp_path, "ur5.urdf", UR5, link="forearm_link")
    expected = moved(np.diag([0.0494433313556] * 2 + [0.004095]), 2.275, (0, 0, 0.25))
    assert np.abs(forearm.tensor - expected).max() < 1e-15  # measured 0
    assert (forearm.mass, forearm.centre) == (2.275, (0.0, 0.0, 0.25))
    upper = read(tmp_path, "ur5.urdf", UR5, link="upper_arm_link", pivot="centre")
    expected = np.diag([0.226890675911] * 2 + [0.0151074])
    assert np.abs(upper.tensor - expected).max() < 1e-15  # measured 2.8e-17


@pytest.mark.filterwarnings("ignore:.*includes")
@pytest.mark.parametrize(
    ("name", "text", "link", "limit"),
    # the quaternion of the MJCF file has 7 digits; measured 7.1e-16 and 5.5e-11
    [("p.urdf", PANDA_URDF, "panda_link7", 1e-14), ("p.xml", PANDA_MJCF, "link7", 4e-10)],
)
def test_panda_with_its_hand(tmp_path, name, text, link, limit):
    body = read(tmp_path, name, text, link=link)
    mass, centre, tensor = panda_by_hand()
    assert body.mass == pytest.approx(mass, rel=1e-15)
    assert np.abs(np.array(body.centre) - centre).max() < 10 * limit
    assert np.abs(body.tensor - tensor).max() < limit
    alone = moved(PANDA_7["tensor"], PANDA_7["mass"], PANDA_7["centre"])
    assert np.abs(body.tensor - alone).max() > 1e-3  # the hand counts


def test_panda_includes_the_hand_and_says_so(tmp_path):
    with pytest.warns(rm.SceneWarning, match="link panda_link7: includes panda_hand, by fixed"):
        read(tmp_path, "p.urdf", PANDA_URDF, link="panda_link7")
    with pytest.warns(rm.SceneWarning, match="panda_hand is fixed to panda_link8, which is left"):
        read(tmp_path, "p.urdf", PANDA_URDF, link="panda_hand")
    with pytest.warns(rm.SceneWarning, match="body link7: includes hand, welded to it"):
        read(tmp_path, "p.xml", PANDA_MJCF, link="link7")


def test_go1_is_the_same_trunk_in_both_formats(tmp_path):
    """The tensor of the URDF, and the principal moments and axes that MuJoCo made of it."""
    one = read(tmp_path, "go1.urdf", GO1_URDF)
    other = read(tmp_path, "go1.xml", GO1_MJCF)
    assert one.mass == other.mass and one.centre == other.centre
    # six digits of MJCF: measured 3.0e-8 of 0.07
    assert np.abs(one.tensor - other.tensor).max() < 2e-7
    swapped = read(tmp_path, "go1.xml", GO1_MJCF.replace("-0.00342088 0.705204", "0.705204 0.1"))
    assert np.abs(one.tensor - swapped.tensor).max() > 1e-3


def test_a_wing_of_solidworks(tmp_path):
    with pytest.warns(rm.SceneWarning, match=r"Lxy is read as \+int x y dm, as its numbers show"):
        body = read(tmp_path, "wing.txt", WING)
    pound, foot = 0.45359237, 0.3048
    assert body.mass == pytest.approx(1.51653435 * pound, rel=1e-15)
    assert body.centre == pytest.approx((-0.45582142 * foot, 0.92780847 * foot, 0.0), rel=1e-15)
    # the last tensor of the text, about the origin, which the reader does not take
    about_origin = np.array([[1.80906323, 0.70069202, 0], [0.70069202, 0.48649877, 0], [0, 0, 0]])
    about_origin[2, 2] = 2.28360341
    off = body.tensor / (pound * foot**2) - about_origin
    assert np.abs(off).max() < 5e-8  # nine digits; measured 9.2e-9
    moments = np.linalg.eigvalsh(body.with_pivot_at_centre().tensor) / (pound * foot**2)
    assert np.abs(moments - [0.16112601, 0.51386477, 0.66303218]).max() < 5e-8  # measured 7.3e-9


def test_the_hubble_space_telescope_from_its_data_sheet():
    """The tensor about the centre of mass; the structural origin of this test is 4 m behind it."""
    body = rm.Body.from_tensor(HUBBLE, 11110.0, (4.0, 0.0, 0.0), about="centre")
    assert np.abs(body.tensor - moved(HUBBLE, 11110.0, (4.0, 0.0, 0.0))).max() < 1e-9  # 5.8e-11
    back = body.with_pivot_at_centre().tensor
    assert np.abs(back - HUBBLE).max() < 1e-9  # of 93,848; measured 7.3e-11
