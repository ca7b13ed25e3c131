"""URDF, the robot description of ROS: <inertial> of a link, with the links fixed to it.

    <inertial> <origin xyz rpy/> <mass value/> <inertia ixx ixy ixz iyy iyz izz/> </inertial>

The tensor is about the centre of mass `xyz`, in axes turned by rpy about the fixed axes of the
link: A = R_z(yaw) R_y(pitch) R_x(roll). ixy is the element of the tensor, -int x y dm. A link
without <inertial> has no mass. Source: wiki.ros.org/urdf/XML/link.
"""

from xml.etree.ElementTree import Element

import numpy as np

from rigidmc.errors import FileError
from rigidmc.inputs.arrays import Array
from rigidmc.scene.body_files.rigid_parts import UNMOVED, Fixed, FoundBody, Pose, RigidPart, Tree
from rigidmc.scene.body_files.xml_tree import numbers_of

_SIX = ("ixx", "iyy", "izz", "iyz", "ixz", "ixy")


def read_urdf(root: Element, link: str | None, file: str) -> FoundBody:
    """Return the body of a link, in the axes of the link and about its origin.

    link : its name; None if all links with mass are fixed to each other, or one alone has mass
    """
    if any("xacro" in x.tag or "${" in str(x.attrib) for x in root.iter()):
        rule = "is a template: make the URDF first, xacro FILE.xacro > FILE.urdf"
        raise FileError(rule, at="xacro", file=file)
    links = _named(root.findall("link"), "link", file)
    if not links:
        raise FileError("has no <link>", at="robot", file=file)
    joints = _fixed_joints(root, links, file)
    parts = {name: _inertial(x, name, file) for name, x in links.items()}
    words = ("link", "links", "fixed", "by fixed joints")
    none = ("none of them has mass", "no <inertial> with mass")
    tree = Tree(*words, *none, False, list(links), joints, file)
    return tree.find(link, [name for name, part in parts.items() if part is not None], parts.get)


def rpy(angles: tuple[float, ...]) -> Array:
    """Return R_z(yaw) R_y(pitch) R_x(roll) of the angles (roll, pitch, yaw) [rad]."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(angles), np.sin(angles)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def _named(elements: list[Element], kind: str, file: str) -> dict[str, Element]:
    """Return {name: element}; FileError for a missing name or one used twice."""
    named: dict[str, Element] = {}
    for x in elements:
        name = x.get("name")
        if not name or name in named:
            raise FileError("expected a name of its own", at=kind, value=name, file=file)
        named[name] = x
    return named


def _origin(element: Element | None, at: str, file: str) -> Pose:
    """Return the pose of the <origin> of an element."""
    origin = None if element is None else element.find("origin")
    if origin is None:
        return UNMOVED
    xyz = numbers_of(origin, "xyz", (3,), f"{at}, origin", file) or (0.0, 0.0, 0.0)
    angles = numbers_of(origin, "rpy", (3,), f"{at}, origin", file) or (0.0, 0.0, 0.0)
    return Pose(rpy(angles), np.array(xyz))


def _inertial(link: Element, name: str, file: str) -> RigidPart | None:
    """Return the <inertial> of a link in the frame of the link; None without mass."""
    inertial, at = link.find("inertial"), f"link {name}"
    if inertial is None:
        return None
    numbers: dict[str, float] = {}
    for tag, keys in (("mass", ("value",)), ("inertia", _SIX)):
        element = inertial.find(tag)
        if element is None:
            raise FileError(f"its <inertial> has no <{tag}>", at=at, file=file)
        for key in keys:
            value = numbers_of(element, key, (1,), f"{at}, {tag}", file)
            if value is None:
                raise FileError("is missing", at=f"{at}, {tag}, {key}", file=file)
            numbers[key] = value[0]
    if numbers["value"] < 0.0:
        rule = "a mass is not negative"
        raise FileError(rule, at=f"{at}, mass", value=numbers["value"], file=file)
    if numbers["value"] == 0.0:
        return None
    xx, yy, zz, yz, xz, xy = (numbers[key] for key in _SIX)
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    part = RigidPart(numbers["value"], np.zeros(3), tensor)
    return part.placed(_origin(inertial, f"{at}, inertial", file))


def _fixed_joints(root: Element, links: dict[str, Element], file: str) -> dict[str, Fixed]:
    """Return the fixed joints; FileError for a link that two of them fix."""
    fixed: dict[str, Fixed] = {}
    for name, joint in _named(root.findall("joint"), "joint", file).items():
        ends = [joint.find(tag) for tag in ("parent", "child")]
        pair = [None if end is None else end.get("link") for end in ends]
        for tag, end in zip(("parent", "child"), pair, strict=True):
            if end not in links:
                rule = "is not a link of the file"
                raise FileError(rule, at=f"joint {name}, {tag}", value=end, file=file)
        if joint.get("type") == "fixed":
            parent, child = str(pair[0]), str(pair[1])
            if child in fixed:
                rule = f"is fixed to two links, by the joints {fixed[child].joint} and {name}"
                raise FileError(rule, at=f"link {child}", file=file)
            fixed[child] = Fixed(name, parent, _origin(joint, f"joint {name}", file))
    return fixed
