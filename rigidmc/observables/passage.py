"""First passage: when an axis of the body leaves, or reaches, a cone."""

import math
from typing import NamedTuple

from rigidmc.dynamics.so3 import dot, up
from rigidmc.errors import SceneError, unknown

ABOUT, WAY = ("vertical", "momentum"), ("leaves", "reaches")


class Passage(NamedTuple):
    """When a principal axis of the body leaves, or reaches, a cone about the vertical or about the angular momentum.

    axis : 1, 2, 3, or -1, -2, -3 for its other end;  angle : half the opening of the cone [rad]
    way : "leaves" or "reaches" it;  about : "vertical", the space z axis, or "momentum", the angular momentum
    stop : whether the member stays as it is at the end of the step in which that happened

    The axis is checked at the end of each step: if it leaves and comes back within a step, that is missed (43 of 801 passages of
    heavy tops with steps of 1.6 rad). A member that is there at the start has passed at t = 0. Its level is a difference of
    cosines: of cones under 1e-4 rad the time has 1e-16/angle^2 of its digits less.
    """

    axis: int
    angle: float
    way: str = "leaves"
    about: str = "vertical"
    stop: bool = False
    event = True
    outputs = {
        "passages": ("1", "how often {axis} {way} the cone of {angle:g} rad about the {about}", ()),
        "passage_first": (
            "s",
            "when {axis} first {way} the cone of {angle:g} rad about the {about}; nan where it does not",
            (),
        ),
        "passage_last": (
            "s",
            "when {axis} last {way} the cone of {angle:g} rad about the {about}; nan where it does not",
            (),
        ),
    }

    def check(self):
        table = "observables.passage"
        if isinstance(self.axis, bool) or self.axis not in (1, 2, 3, -1, -2, -3):
            raise SceneError(
                table,
                "axis",
                self.axis,
                "expected 1, 2 or 3, or -1, -2, -3 for the other end of the axis",
            )
        if (
            isinstance(self.angle, bool)
            or not isinstance(self.angle, (int, float))
            or not 0.0 < self.angle < math.pi
        ):
            raise SceneError(table, "angle", self.angle, "expected an angle between 0 and pi [rad]")
        for key, value, known in (("way", self.way, WAY), ("about", self.about, ABOUT)):
            if value not in known:
                raise unknown(table, key, value, "word", known)
        if not isinstance(self.stop, bool):
            raise SceneError(table, "stop", self.stop, "expected true or false")

    def compiled(self, moments, sure):
        """The event; any body has it."""
        marks = tuple((0.0,) if abs(self.axis) == i else () for i in (1, 2, 3))
        kind = Vertical if self.about == "vertical" else AlongMomentum
        outward = -1.0 if self.way == "leaves" else 1.0
        return kind(
            marks,
            outward * math.copysign(1.0, self.axis),
            outward * math.cos(self.angle),
            (0.0,) * self.stop,
        )

    def words(self):
        return {
            "axis": f"axis {self.axis}",
            "way": self.way,
            "angle": float(self.angle),
            "about": "vertical" if self.about == "vertical" else "angular momentum",
        }

    def results(self, record):
        """Outputs from what an event keeps, see `rigidmc.engine.events`."""
        return {
            "passages": record.count,
            "passage_first": record.first,
            "passage_last": record.last,
        }


class Vertical(NamedTuple):
    """An axis of the body against a cone about the vertical: sign (e . z) - cosine, which rises through 0 at the event."""

    axis: tuple
    sign: float
    cosine: float
    stop: tuple = ()

    def level(self, q):
        return self.sign * along(self.axis, up(q)) - self.cosine


class AlongMomentum(NamedTuple):
    """The same about the angular momentum: sign L_i - cosine |L|."""

    axis: tuple
    sign: float
    cosine: float
    stop: tuple = ()

    def level(self, l):
        return self.sign * along(self.axis, l) - self.cosine * math.sqrt(dot(l, l))


def along(marks, v):
    """The component of a vector that is marked."""
    if len(marks[0]) > 0:
        return v[0]
    if len(marks[1]) > 0:
        return v[1]
    return v[2]
