"""Flips: how often, when first, and after what waits a body turns over about its middle axis."""

import math
from typing import NamedTuple

import numpy as np

from rigidmc.dynamics.so3 import dot, select
from rigidmc.errors import SceneError


class Flips(NamedTuple):
    """How often a body turns over about a principal axis: by default that of the middle moment, the theorem's own.

    A flip is a change of sign of the angular momentum about the axis after it has come within an angle of it, either end: free tops that start there
    flip every 2 K(m)/lambda (flip_interval of `rigidmc exact`), TdC (3.35) in closed form; those that wobble about another axis never do.

    The component is checked at the end of each step: a change that comes and goes within a step is missed.

    axis : 1, 2 or 3; 0 for that of the middle moment of each body;  within : that angle [rad]
    """

    axis: int = 0
    within: float = math.pi / 3.0
    event = True
    outputs = {
        "flips": (
            "1",
            "how often the body turned over about the {axis}, after it had come within {within:.4g} rad of it",
            (),
        ),
        "flip_first": ("s", "time of the first flip; nan where there is none", ()),
        "flip_last": ("s", "time of the last flip; nan where there is none", ()),
        "flip_wait": ("s", "mean time between flips; nan where there are fewer than two", ()),
        "flip_wait_deviation": (
            "s",
            "standard deviation of the times between flips, each by a straight line within its step; nan where there are fewer than two",
            (),
        ),
    }

    def check(self):
        if isinstance(self.axis, bool) or self.axis not in (0, 1, 2, 3):
            raise SceneError(
                "observables.flips",
                "axis",
                self.axis,
                "expected 1, 2, 3, or 0 for the axis of the middle moment",
            )
        if (
            isinstance(self.within, bool)
            or not isinstance(self.within, (int, float))
            or not 0.0 < self.within <= 0.5 * math.pi
        ):
            raise SceneError(
                "observables.flips",
                "within",
                self.within,
                "expected an angle between 0 and pi/2 [rad]",
            )

    def compiled(self, moments, sure):
        """The event for bodies of these moments (3, n), which are all there are where that is sure."""
        chosen = [self.axis - 1]
        if self.axis == 0:
            order = np.argsort(moments, axis=0, kind="stable")
            low, middle, high = np.take_along_axis(moments, order, axis=0)
            if not np.any((middle - low > 1e-12 * high) & (high - middle > 1e-12 * high)):
                rule = "no body of the scene has three different moments, so that none has a middle axis; give axis = 1, 2 or 3"
                raise SceneError("observables.flips", "axis", self.axis, rule)
            chosen = sorted({int(i) for i in order[1]}) if sure else [0, 1, 2]
        return Component(
            *((0.0,) if i in chosen else () for i in range(3)), math.cos(self.within) ** 2
        )

    def words(self):
        return {
            "axis": f"axis {self.axis}" if self.axis else "axis of the middle moment",
            "within": float(self.within),
        }

    def results(self, record):
        """Outputs from what an event keeps, see `rigidmc.engine.events`."""
        with np.errstate(all="ignore"):
            waits = record.count - 1.0
            mean = (record.last - record.first) / waits
            spread = np.sqrt(
                np.maximum(
                    record.squares / waits - ((record.tau - record.first_tau) / waits) ** 2, 0.0
                )
            )
        several = record.count > 1.0
        return {
            "flips": record.count,
            "flip_first": record.first,
            "flip_last": record.last,
            "flip_wait": np.where(several, mean, np.nan),
            "flip_wait_deviation": np.where(several, spread, np.nan),
        }


class Component(NamedTuple):
    """A component of L, as an event. one, two, three : (0.0,) for axes that may be the one, else (); where several may be, it is the
    middle one.  square : of the cosine of the angle within which it arms"""

    one: tuple
    two: tuple
    three: tuple
    square: float
    stop: tuple = ()

    def level(self, body, l):
        return component((self.one, self.two, self.three), body, l)

    def armed(self, l, level, armed):
        return armed | (level * level > self.square * dot(l, l))

    def past(self):
        return False


def component(marks, body, l):
    """The component of L about the axis that is marked, or about that of the middle moment."""
    if len(marks[0]) + len(marks[1]) + len(marks[2]) > 1:
        second = ((body.i1 >= body.i2) & (body.i2 >= body.i3)) | (
            (body.i1 <= body.i2) & (body.i2 <= body.i3)
        )
        first = ((body.i2 >= body.i1) & (body.i1 >= body.i3)) | (
            (body.i2 <= body.i1) & (body.i1 <= body.i3)
        )
        return select(second, l[1], select(first, l[0], l[2]))
    return only(marks[0], l[0], only(marks[1], l[1], l[2]))


def only(mark, this, other):
    """This where there is a mark, else the other."""
    if len(mark) == 0:
        return other
    return this
