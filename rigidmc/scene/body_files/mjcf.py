"""MJCF, the model description of MuJoCo: <inertial> of a body, with the bodies welded to it.

    <inertial pos mass diaginertia | fullinertia quat | axisangle | xyaxes | zaxis | euler/>

The tensor is about the centre of mass `pos`, in axes turned by the orientation. fullinertia has the
elements xx, yy, zz, xy, xz, yz of the tensor, -int x y dm. A body without joint is welded to its
parent. Where <inertial> is missing, MuJoCo computes it from geoms; this reader does not.
Source: MuJoCo documentation, XML reference.
"""

from collections.abc import Iterator
from typing import NamedTuple
from xml.etree.ElementTree import Element

import numpy as np

from rigidmc.errors import FileError
from rigidmc.inputs.arrays import Array
from rigidmc.mechanics import rotation
from rigidmc.scene.body_files.rigid_parts import UNMOVED, Fixed, FoundBody, Pose, RigidPart, Tree
from rigidmc.scene.body_files.xml_tree import numbers_of

_ORIENTATIONS = {"quat": 4, "axisangle": 4, "xyaxes": 6, "zaxis": 3, "euler": 3}
# settings of <compiler> that change masses or inertias: {name: value without effect}
_CHANGES = {"inertiafromgeom": ("auto", "false"), "settotalmass": ("-1",)}
_COMPILED = "save the compiled model, mujoco.mj_saveLastXML(FILE, model), and give that file"


class _Angles(NamedTuple):
    """How <compiler> reads angles: radians per unit, and the sequence of Euler angles."""

    unit: float
    sequence: str


class _Body(NamedTuple):
    """A <body> in the tree, and its pose in the frame of the parent.

    moves : relative to its parent, as all bodies in the world, whose parent is ""
    """

    element: Element
    pose: Pose
    parent: str
    moves: bool


def read_mjcf(root: Element, name: str | None, file: str) -> FoundBody:
    """Return a body of the model, in the axes of the <body> and about its origin.

    name : of the body; None if all bodies with mass are welded to each other, or one alone has mass
    """
    angles = _compiler(root, file)
    for tag in ("include", "replicate", "attach"):
        element = root.find(f".//{tag}")
        if element is not None:
            named = f" ({element.get('file')})" if element.get("file") else ""
            rule = f"adds to the model{named}, and is not followed: give that file, or {_COMPILED}"
            raise FileError(rule, at=f"<{tag}>", file=file)
    bodies = _bodies(root, angles, file)
    if not bodies:
        raise FileError("has no <body>", at="worldbody", file=file)
    joints = {k: Fixed("", body.parent, body.pose) for k, body in bodies.items() if not body.moves}
    words = ("body", "bodies", "welded", "welded to it")
    none = (f"none of them has <inertial>: {_COMPILED}", "no mass")
    tree = Tree(*words, *none, True, list(bodies), joints, file)
    heavy = (k for k, body in bodies.items() if body.element.find("inertial") is not None)
    return tree.find(name, heavy, lambda k: _inertial(bodies[k].element, k, angles, file))


def _compiler(root: Element, file: str) -> _Angles:
    """Return how angles are read; FileError for a setting that changes masses."""
    settings: dict[str, str] = {}
    for element in root.findall("compiler"):
        settings |= element.attrib
    for key, same in _CHANGES.items():
        if settings.get(key, same[0]) not in same:
            rule = f"changes the masses of the model: {_COMPILED}"
            raise FileError(rule, at=f"compiler, {key}", value=settings[key], file=file)
    for key in ("boundmass", "boundinertia"):
        if settings.get(key, "0").strip("0."):
            rule = f"raises small masses of the model: {_COMPILED}"
            raise FileError(rule, at=f"compiler, {key}", value=settings[key], file=file)
    if settings.get("coordinate", "local") != "local":
        rule = f"MuJoCo no longer has these: {_COMPILED}"
        raise FileError(rule, at="compiler, coordinate", value=settings["coordinate"], file=file)
    unit, sequence = settings.get("angle", "degree"), settings.get("eulerseq", "xyz")
    if unit not in ("degree", "radian"):
        raise FileError("expected degree or radian", at="compiler, angle", value=unit, file=file)
    if len(sequence) != 3 or not set(sequence.lower()) <= set("xyz"):
        rule = "expected three letters of xyz and XYZ"
        raise FileError(rule, at="compiler, eulerseq", value=sequence, file=file)
    return _Angles(np.pi / 180.0 if unit == "degree" else 1.0, sequence)


def _bodies(root: Element, angles: _Angles, file: str) -> dict[str, _Body]:
    """Return all bodies by name, parents first; FileError for a name used twice."""
    bodies = dict[str, _Body]()
    waiting = [(world, "") for world in root.findall("worldbody")]
    while waiting:
        element, parent = waiting.pop()
        for inner, frame in _through_frames(element, UNMOVED, angles, file):
            name = inner.get("name") or f"body {len(bodies) + 1}, without name"
            if name in bodies:
                raise FileError("expected a name of its own", at="body", value=name, file=file)
            pose = frame.of(_pose(inner, f"body {name}", angles, file))
            joints = any(part.tag in ("joint", "freejoint") for part in _inside(inner))
            moves = not parent or inner.get("mocap") == "true" or joints
            bodies[name] = _Body(inner, pose, parent, moves)
            waiting.append((inner, name))
    return bodies


def _through_frames(
    element: Element, pose: Pose, angles: _Angles, file: str
) -> Iterator[tuple[Element, Pose]]:
    """Yield (body, pose of the frame around it) of the bodies directly within an element."""
    for inner in element:
        if inner.tag == "body":
            yield inner, pose
        elif inner.tag == "frame":
            yield from _through_frames(
                inner, pose.of(_pose(inner, "frame", angles, file)), angles, file
            )


def _inside(body: Element) -> Iterator[Element]:
    """Yield the elements directly within a body, also through frames."""
    for inner in body:
        if inner.tag == "frame":
            yield from _inside(inner)
        else:
            yield inner


def _pose(element: Element, at: str, angles: _Angles, file: str) -> Pose:
    """Return the pose of a body, a frame or an <inertial> in the frame around it."""
    pos = numbers_of(element, "pos", (3,), at, file) or (0.0, 0.0, 0.0)
    return Pose(_turn(element, at, angles, file), np.array(pos))


def _turn(element: Element, at: str, angles: _Angles, file: str) -> Array:
    """Return the matrix (3, 3) of an orientation; FileError for several, or without a direction."""
    keys = [key for key in _ORIENTATIONS if element.get(key) is not None]
    if len(keys) > 1:
        rule = f"expected one of {', '.join(_ORIENTATIONS)}"
        raise FileError(rule, at=f"{at}, {' and '.join(keys)}", file=file)
    if not keys:
        return np.eye(3)
    key = keys[0]
    values = np.array(numbers_of(element, key, (_ORIENTATIONS[key],), at, file))
    if key == "euler":
        return _euler(values * angles.unit, angles.sequence)
    try:
        if key == "quat":
            return rotation.matrix(_unit(values))
        if key == "axisangle":
            return _about(_unit(values[:3]), values[3] * angles.unit)
        if key == "zaxis":
            return _to_z(_unit(values))
        x = _unit(values[:3])
        y = _unit(values[3:] - (values[3:] @ x) * x)
        return np.stack([x, y, np.cross(x, y)], -1)
    except ZeroDivisionError:
        rule = "has no direction: its length is 0, or its axes are parallel"
        raise FileError(rule, at=f"{at}, {key}", value=element.get(key), file=file) from None


def _unit(vector: Array) -> Array:
    """Return a vector of length 1; ZeroDivisionError for a vector without direction."""
    length = float(np.linalg.norm(vector))
    if length < 1e-14:
        raise ZeroDivisionError
    return np.asarray(vector / length)


def _about(axis: Array, angle: float) -> Array:
    """Return the turn about a unit axis."""
    half = 0.5 * angle
    return rotation.matrix([np.cos(half), *(np.sin(half) * axis)])


def _to_z(axis: Array) -> Array:
    """Return the smallest turn that takes (0, 0, 1) to a unit axis."""
    across = np.array([-axis[1], axis[0], 0.0])  # (0, 0, 1) x axis
    size = float(np.linalg.norm(across))
    if size < 1e-14:
        return np.eye(3) if axis[2] > 0.0 else np.diag([1.0, -1.0, -1.0])
    return _about(across / size, float(np.arctan2(size, axis[2])))


def _euler(values: Array, sequence: str) -> Array:
    """Return the turn of Euler angles [rad]: about the turned axis for a small letter, about the
    fixed axis for a capital."""
    turn = np.eye(3)
    for letter, angle in zip(sequence, values.tolist(), strict=True):
        about_axis = _about(np.eye(3)["xyz".index(letter.lower())], angle)
        turn = turn @ about_axis if letter.islower() else about_axis @ turn
    return turn


def _inertial(body: Element, name: str, angles: _Angles, file: str) -> RigidPart | None:
    """Return the <inertial> of a body in its frame; None for a body without geoms and mass."""
    inertial, at = body.find("inertial"), f"body {name}, inertial"
    if inertial is None:
        if any(inner.tag == "geom" for inner in _inside(body)):
            rule = f"is missing, and MuJoCo computes it from the geoms: {_COMPILED}"
            raise FileError(rule, at=at, file=file)
        return None
    mass = numbers_of(inertial, "mass", (1,), at, file)
    diagonal = numbers_of(inertial, "diaginertia", (3,), at, file)
    full = numbers_of(inertial, "fullinertia", (6,), at, file)
    if mass is None or mass[0] < 0.0 or inertial.get("pos") is None:
        raise FileError("expected pos, and a mass that is not negative", at=at, file=file)
    if (diagonal is None) == (full is None):
        raise FileError("expected either diaginertia or fullinertia", at=at, file=file)
    if full is not None and any(inertial.get(key) for key in _ORIENTATIONS):
        raise FileError("fullinertia has no orientation, as in MuJoCo", at=at, file=file)
    if mass[0] == 0.0:
        return None
    if full is not None:
        xx, yy, zz, xy, xz, yz = full
        tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    else:
        tensor = np.diag(np.array(diagonal))
    part = RigidPart(mass[0], np.zeros(3), tensor)
    return part.placed(_pose(inertial, at, angles, file))
