"""Rigid parts of a body file: mass, centre of mass and tensor, moved, turned and lumped.

A pose (A, t) takes points from a frame to its parent, x' = A x + t. A part in a turned and moved
frame has, TdC (3.26),

    c' = A c + t,   J' = A J A^T,   I = J' + m (c'^2 1 - c' c'^T)

with J about its centre of mass and I about the origin.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from rigidmc.errors import FileError, SceneError, nearest
from rigidmc.inputs.arrays import Array
from rigidmc.mechanics import inertia
from rigidmc.mechanics.impossible import causes_text

_NAMES = 20  # of names in a message, and of notes


class Pose(NamedTuple):
    """The pose of a frame in its parent: the matrix (3, 3) of its turn, and its origin (3,) [m]."""

    turn: Array
    origin: Array

    def of(self, inner: "Pose") -> "Pose":
        """Return in this frame's parent the pose of a frame within this frame."""
        return Pose(self.turn @ inner.turn, self.turn @ inner.origin + self.origin)


UNMOVED = Pose(np.eye(3), np.zeros(3))


class RigidPart(NamedTuple):
    """A part with its mass [kg], centre of mass (3,) [m] and tensor (3, 3) about this centre
    [kg m2], in one frame."""

    mass: float
    centre: Array
    tensor: Array

    def placed(self, pose: Pose) -> "RigidPart":
        """Return the part in the parent of its frame."""
        turn, origin = pose
        return RigidPart(self.mass, turn @ self.centre + origin, turn @ self.tensor @ turn.T)

    def about_origin(self) -> Array:
        """Return the tensor (3, 3) about the origin of the frame."""
        return inertia.about_point(self.tensor, self.mass, self.centre)


class FoundBody(NamedTuple):
    """The body of a file.

    part : in the axes of the link, body or drawing, whose origin is the fixed point
    notes : what was assumed, and what may be wrong
    """

    part: RigidPart
    notes: tuple[str, ...] = ()


def lump(parts: Iterable[RigidPart]) -> RigidPart:
    """Return one part of several in one frame, of positive total mass."""
    many = list(parts)
    if len(many) == 1:
        return many[0]
    mass = sum(part.mass for part in many)
    centre = sum((part.mass * part.centre for part in many), np.zeros(3)) / mass
    tensor = sum(
        (inertia.about_point(part.tensor, part.mass, part.centre - centre) for part in many),
        np.zeros((3, 3)),
    )
    return RigidPart(mass, centre, tensor)


class Fixed(NamedTuple):
    """How a link or body is fixed to another: the name of the joint, the other one, the pose
    there."""

    joint: str
    parent: str
    pose: Pose


class Tree(NamedTuple):
    """The links or bodies of a file, in the terms of its format.

    kind, plural, fixed : "link", "links" and "fixed";  how : "by fixed joints"
    none, massless : what a message says if none, or the one asked for, has mass
    names : of all;  joints : of those fixed to another
    is_ordered : whether masses are summed in the order of `names`, else from the one asked for
        outwards: sums round differently
    """

    kind: str
    plural: str
    fixed: str
    how: str
    none: str
    massless: str
    is_ordered: bool
    names: Sequence[str]
    joints: Mapping[str, Fixed]
    file: str

    def find(
        self, name: str | None, heavy: Iterable[str], part_of: Callable[[str], RigidPart | None]
    ) -> FoundBody:
        """Return one link or body with all that is fixed to it.

        name : None if all with mass are fixed to each other, or one alone has mass
        heavy : those with mass;  part_of : function that returns the part in its own frame
        """
        at, kind, heads = "body.link", self.kind, self._heads()
        name = self._only(heads[word] for word in heavy) if name is None else name
        if name not in self.names:
            rule = f"no such {kind}; known: {first_names(self.names)}"
            close = nearest(name, self.names)
            raise SceneError(rule, at=at, value=name, nearest=close, file=self.file)
        poses = self._attached(name)
        order = [word for word in self.names if word in poses] if self.is_ordered else poses
        parts = {word: part for word in order if (part := part_of(word)) is not None}
        if not parts:
            rule = f"this {kind}, with all that is {self.fixed} to it, has {self.massless}"
            raise SceneError(rule, at=at, value=name, file=self.file)
        notes = list[str]()
        if others := [word for word in parts if word != name]:
            notes.append(f"{kind} {name}: includes {first_names(others)}, {self.how}")
        if name in self.joints:
            parent = self.joints[name].parent
            notes.append(
                f"{kind} {name} is {self.fixed} to {parent}, which is left out:"
                f' link = "{parent}" has both'
            )
        placed = [part.placed(poses[word]) for word, part in parts.items()]
        return FoundBody(lump(placed), (*notes, *impossible_notes(parts, kind)))

    def _heads(self) -> dict[str, str]:
        """Return for each the free one that it is fixed to, directly or through others; FileError
        for a cycle. Each joint is followed once, however long the chains are."""
        heads: dict[str, str] = {}
        for name in self.names:
            path, end = dict[str, str](), name
            while end in self.joints and end not in heads and end not in path:
                path[end] = self.joints[end].joint
                end = self.joints[end].parent
            if end in path:
                joints = list(path.values())[list(path).index(end) :]
                rule = f"form a cycle: {first_names(joints)}"
                raise FileError(rule, at="fixed joints", file=self.file)
            heads |= dict.fromkeys(path, heads.get(end, end))
            heads.setdefault(name, name)
        return heads

    def _only(self, heavy: Iterable[str]) -> str:
        """Return the one that has mass, itself or by what is fixed to it; SceneError."""
        candidates = list(dict.fromkeys(heavy))
        if len(candidates) == 1:
            return candidates[0]
        words = f"choose one of {first_names(candidates)}" if candidates else self.none
        rule = f"there are {len(self.names):,} {self.plural}: {words}"
        raise SceneError(rule, at="body.link", file=self.file)

    def _attached(self, name: str) -> dict[str, Pose]:
        """Return the poses of a link or body and of all that is fixed to it, in its frame."""
        children: dict[str, list[str]] = {}
        for child, (_, parent, _) in self.joints.items():
            children.setdefault(parent, []).append(child)
        poses, waiting = {name: UNMOVED}, [name]
        for parent in waiting:  # grows meanwhile
            for child in children.get(parent, ()):
                poses[child] = poses[parent].of(self.joints[child].pose)
                waiting.append(child)
        return poses


def impossible_notes(parts: Mapping[str, RigidPart], kind: str) -> list[str]:
    """Return a note for each part whose tensor about its own centre no mass has, at most 20.

    kind : "link" or "body"
    """
    notes = list[str]()
    for name, part in parts.items():
        moments = np.linalg.eigvalsh(part.tensor)
        excess = moments[2] - moments[0] - moments[1]
        if moments[0] >= 0.0 and excess <= 1e-9 * moments[2]:
            continue
        if len(notes) == _NAMES:
            return [*notes, f"more of the {len(parts):,} parts cannot exist"]
        shown = ", ".join(f"{x:.4g}" for x in moments)
        causes = causes_text(part.tensor, part.mass, np.zeros(3))
        notes.append(
            f"{kind} {name} cannot exist: its principal moments about the centre of mass are"
            f" ({shown}) kg m2, but moments are positive and obey {inertia.TRIANGLE}{causes}"
        )
    return notes


def first_names(names: Sequence[str], most: int = _NAMES) -> str:
    """Write names as a list, with a count of those beyond `most`."""
    more = f" and {len(names) - most:,} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more
