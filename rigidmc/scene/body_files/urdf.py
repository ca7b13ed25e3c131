"""URDF, the robot description of ROS: <inertial> of a link, with the links fixed to it.

    <inertial> <origin xyz rpy/> <mass value/> <inertia ixx ixy ixz iyy iyz izz/> </inertial>

The tensor is about the centre of mass `xyz`, in axes turned by rpy about the fixed axes of the
link: A = R_z(yaw) R_y(pitch) R_x(roll). ixy is the element of the tensor, -int x y dm. A link
without <inertial> has no mass. Source: wiki.ros.org/urdf/XML/link.
"""

from collections.abc import Iterable
from typing import NamedTuple
from xml.etree.ElementTree import Element

import numpy as np

from rigidmc.errors import FileError, SceneError, nearest
from rigidmc.scene.body_files.rigid_parts import (
    UNMOVED,
    Array,
    FoundBody,
    Pose,
    RigidPart,
    first_names,
    impossible_notes,
    lump,
)
from rigidmc.scene.body_files.xml_tree import numbers_of

_SIX = ("ixx", "iyy", "izz", "iyz", "ixz", "ixy")


class _Fixed(NamedTuple):
    """How a link is fixed to another: the name of the joint, the other link, the pose there."""

    joint: str
    parent: str
    pose: Pose


Fixed = dict[str, _Fixed]  # by the names of the fixed links


def read_urdf(root: Element, link: str | None, file: str) -> FoundBody:
    """Return the body of a link, in the axes of the link and about its origin.

    link : its name; None if all links with mass are fixed to each other, or one alone has mass
    """
    if any("xacro" in one.tag or "${" in str(one.attrib) for one in root.iter()):
        rule = "is a template: make the URDF first, xacro FILE.xacro > FILE.urdf"
        raise FileError(rule, at="xacro", file=file)
    links = _named(root.findall("link"), "link", file)
    if not links:
        raise FileError("has no <link>", at="robot", file=file)
    fixed = _fixed_joints(root, links, file)
    heads = _heads(links, fixed, file)
    parts = {name: _inertial(one, name, file) for name, one in links.items()}
    if link is None:
        link = _only_link(parts, heads, file)
    if link not in links:
        rule = f"no such link; known: {first_names(list(links))}"
        close = nearest(link, list(links))
        raise SceneError(rule, at="body.link", value=link, nearest=close, file=file)
    found = _fixed_to(link, fixed, parts)
    if not found:
        rule = "this link, with all that is fixed to it, has no <inertial> with mass"
        raise SceneError(rule, at="body.link", value=link, file=file)
    return FoundBody(lump(found.values()), _notes(link, list(found), fixed, parts))


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
    for one in elements:
        name = one.get("name")
        if not name or name in named:
            raise FileError("expected a name of its own", at=kind, value=name, file=file)
        named[name] = one
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


def _fixed_joints(root: Element, links: dict[str, Element], file: str) -> Fixed:
    """Return the fixed joints; FileError for a link that two of them fix."""
    fixed: Fixed = {}
    for name, joint in _named(root.findall("joint"), "joint", file).items():
        ends = [joint.find(tag) for tag in ("parent", "child")]
        pair = [None if end is None else end.get("link") for end in ends]
        for tag, one in zip(("parent", "child"), pair, strict=True):
            if one not in links:
                rule = "is not a link of the file"
                raise FileError(rule, at=f"joint {name}, {tag}", value=one, file=file)
        if joint.get("type") == "fixed":
            parent, child = str(pair[0]), str(pair[1])
            if child in fixed:
                rule = f"is fixed to two links, by the joints {fixed[child].joint} and {name}"
                raise FileError(rule, at=f"link {child}", file=file)
            fixed[child] = _Fixed(name, parent, _origin(joint, f"joint {name}", file))
    return fixed


def _heads(links: Iterable[str], fixed: Fixed, file: str) -> dict[str, str]:
    """Return for each link the free one that it is fixed to, directly or through others; FileError
    for a cycle. Each joint is followed once, however long the chains are."""
    heads: dict[str, str] = {}
    for link in links:
        path, end = dict[str, str](), link
        while end in fixed and end not in heads and end not in path:
            path[end] = fixed[end].joint
            end = fixed[end].parent
        if end in path:
            names = list(path.values())[list(path).index(end) :]
            rule = f"form a cycle: {first_names(names)}"
            raise FileError(rule, at="fixed joints", file=file)
        heads |= dict.fromkeys(path, heads.get(end, end))
        heads.setdefault(link, link)
    return heads


def _only_link(parts: dict[str, RigidPart | None], heads: dict[str, str], file: str) -> str:
    """Return the one link that has mass, itself or by what is fixed to it; SceneError."""
    heavy = list(dict.fromkeys(heads[name] for name, part in parts.items() if part is not None))
    if len(heavy) == 1:
        return heavy[0]
    words = f"choose one of {first_names(heavy)}" if heavy else "none of them has mass"
    raise SceneError(f"there are {len(parts):,} links: {words}", at="body.link", file=file)


def _fixed_to(link: str, fixed: Fixed, parts: dict[str, RigidPart | None]) -> dict[str, RigidPart]:
    """Return the parts with mass of a link and of all that is fixed to it, in its frame."""
    children: dict[str, list[str]] = {}
    for child, (_, parent, _) in fixed.items():
        children.setdefault(parent, []).append(child)
    found, poses = dict[str, RigidPart](), {link: UNMOVED}
    waiting = [link]
    for name in waiting:  # grows meanwhile
        part = parts[name]
        if part is not None:
            found[name] = part.placed(poses[name])
        for child in children.get(name, ()):
            poses[child] = poses[name].of(fixed[child].pose)
            waiting.append(child)
    return found


def _notes(
    link: str, names: list[str], fixed: Fixed, parts: dict[str, RigidPart | None]
) -> tuple[str, ...]:
    """Return the notes on a link: what is lumped, what is left out, and what cannot exist."""
    notes = list[str]()
    if others := [name for name in names if name != link]:
        notes.append(f"link {link}: includes {first_names(others)}, by fixed joints")
    if link in fixed:
        parent = fixed[link].parent
        notes.append(
            f'link {link} is fixed to {parent}, which is left out: link = "{parent}" has both'
        )
    heavy = {name: part for name in names if (part := parts[name]) is not None}
    return (*notes, *impossible_notes(heavy, "link"))
