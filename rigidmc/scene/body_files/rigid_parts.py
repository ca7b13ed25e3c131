"""Rigid parts of a body file: mass, centre of mass and tensor, moved, turned and lumped.

A pose (A, t) takes points from a frame to its parent, x' = A x + t. A part in a turned and moved
frame has, TdC (3.26),

    c' = A c + t,   J' = A J A^T,   I = J' + m (c'^2 1 - c' c'^T)

with J about its centre of mass and I about the origin.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigidmc.mechanics import inertia
from rigidmc.mechanics.impossible import causes_text

Array = NDArray[np.float64]
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
        (inertia.about_point(one.tensor, one.mass, one.centre - centre) for one in many),
        np.zeros((3, 3)),
    )
    return RigidPart(mass, centre, tensor)


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
