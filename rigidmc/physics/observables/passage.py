"""First passage: when an axis of the body leaves, or reaches, a cone."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from rigidmc.errors import unknown
from rigidmc.physics.dynamics.body_axes import described
from rigidmc.physics.dynamics.methods import Flag, flag
from rigidmc.physics.effects.protocol import is_random
from rigidmc.physics.observables import directions
from rigidmc.physics.observables.directions import (
    Direction,
    direction_in_body,
    length,
    marked_component,
)
from rigidmc.physics.observables.protocol import Array, EventRecord, event, is_finite, require

TABLE = "observables.passage"
WAYS, AT_START = ("leaves", "reaches"), ("count", "ignore")
_CONE = "the cone of {angle:g} rad about the {about}{start}"


@event(
    outputs={
        "passages": ("1", "number of times {axis} {way} " + _CONE, ()),
        "passage_first": ("s", "time when {axis} first {way} " + _CONE + "; nan if never", ()),
        "passage_last": ("s", "time when {axis} last {way} " + _CONE + "; nan if never", ()),
    },
    event_times=("passage_first",),
    parameter_units={"angle": "rad", "hold": "s"},
)
class Passage(NamedTuple):
    """The times at which an axis of the body leaves, or reaches, a cone about a direction.

    A passage there and back within one step counts, too: of 3,810 passages of heavy tops by rk8 in
    steps of 1.6 rad, none is missed (tests/physics/observables/test_monitoring.py). With noise,
    passages are detected only at the ends of steps. The level is a difference of cosines, so the
    time of passage of a narrow cone loses digits, as rounding/angle^2.

    Parameters
    ----------
    axis : int
        1, 2 or 3, an axis of the body as described, or -1, -2, -3 for its other end
    angle : float [rad]
        half the opening of the cone
    way : str, optional
        whether the axis "leaves" or "reaches" the cone
    about : str or sequence of 3 floats, optional
        axis of the cone: "vertical", the space z axis; "momentum", the angular momentum; a
        direction in space such as (1, 0, 0); on the orbit of a `GravityGradient`,
        "local_vertical", from the central body outward, "along_track", perpendicular to it in the
        plane of the orbit, or "orbit_normal"; or "field", the direction of the field of
        `UniformField` or `RotatingField` (a member whose field is 0 is beyond any cone)
    stop : bool, optional
        whether the member stops at the end of the step with the passage
    at_start : str, optional
        a member that has already passed at the start counts as passed at t = 0 ("count"), or only
        once it has come back and passes again ("ignore")
    hold : float, optional [s]
        shortest stay that counts: the axis must stay this long where it has passed to. `stop` acts
        at the end of the step in which this time is over. The time of a passage is the beginning of
        its stay

    Examples
    --------
    >>> fall = rm.Passage(axis=3, angle=0.5, stop=True)
    >>> start = rm.Start(omega=(1.0, 0.0, 0.0))
    >>> scene = rm.Scene(rm.Body((1.0, 1.0, 0.5)), start=start, observables=(fall,))
    >>> rm.simulate(scene, t_end=1.0, dt=0.1, members=1).passage_first.values.round(6)
    array([0.5])
    """

    axis: int
    angle: float
    way: str = "leaves"
    about: str | Sequence[float] = "vertical"
    stop: bool = False
    at_start: str = "count"
    hold: float = 0.0

    def check(self) -> None:
        """Raise SceneError for an invalid axis, angle or word."""
        is_axis = not isinstance(self.axis, bool) and self.axis in (1, 2, 3, -1, -2, -3)
        rule = "expected 1, 2 or 3, or -1, -2, -3 for the other end of the axis"
        require(is_axis, rule, f"{TABLE}.axis", self.axis)
        is_angle = is_finite(self.angle) and 0.0 < self.angle < math.pi
        rule = 'expected an angle between 0 and pi [rad]; degrees are written "30 deg"'
        require(is_angle, rule, f"{TABLE}.angle", self.angle)
        directions.check(self.about, f"{TABLE}.about")
        for key, word, words in ("way", self.way, WAYS), ("at_start", self.at_start, AT_START):
            if word not in words:
                raise unknown("word", words, at=f"{TABLE}.{key}", value=word)
        is_time, rule = (
            is_finite(self.hold) and self.hold >= 0.0,
            "expected a time of 0 or more [s]",
        )
        require(is_time, rule, f"{TABLE}.hold", self.hold)
        require(isinstance(self.stop, bool), "expected true or false", f"{TABLE}.stop", self.stop)

    def bind(self, moments: Array, complete: bool, effects: Sequence[Any]) -> "ConeLevel":
        """Return the event for all bodies; raise SceneError if its orbit or field is missing."""
        # With noise a path has no derivative, so there is no dense output.
        smooth = not any(map(is_random, effects))
        outward = -1.0 if self.way == "leaves" else 1.0
        return ConeLevel(
            tuple(flag(abs(self.axis) == i) for i in (1, 2, 3)),
            outward * math.copysign(1.0, self.axis),
            outward * math.cos(self.angle),
            flag(self.stop),
            flag(self.at_start == "ignore"),
            directions.make_direction(self.about, effects, f"{TABLE}.about"),
            (float(self.hold), *flag(smooth)) if self.hold else (),
        )

    def label_fields(self) -> dict[str, Any]:
        """Return the axis, the way and the cone."""
        return {
            "axis": f"axis {self.axis}",
            "way": self.way,
            "angle": float(self.angle),
            "about": directions.words(self.about),
            "start": ", starts beyond it ignored" * (self.at_start == "ignore")
            + f", and stays for {self.hold:g} s" * bool(self.hold),
        }

    def results(self, record: EventRecord) -> dict[str, Array]:
        """Return the outputs."""
        first, last = record.first, record.last
        if self.hold:
            some = record.count > 0.0
            first, last = (np.where(some, t, np.nan) for t in (record.first_tau, record.tau))
        return {"passages": record.count, "passage_first": first, "passage_last": last}


class ConeLevel(NamedTuple):
    """An axis e of the body against a cone about a vector d.

        level = sign (e . d) - cosine |d|, which rises through 0 at the event

    axis : ON for the axis, OFF for the others
    stop : see `rigidmc.physics.observables.compiled.is_terminal`
    ignored : ON if a start beyond the cone does not count
    hold : see `rigidmc.physics.observables.compiled.dwell`
    """

    axis: tuple[Flag, ...]
    sign: float
    cosine: float
    stop: Flag
    ignored: Flag
    direction: Direction
    hold: tuple[float, ...]

    def level(self, body, effects, t, q, l):
        d = described(body, direction_in_body(self.direction, effects, t, q, l))
        return self.sign * marked_component(self.axis, d) - self.cosine * length(self.direction, d)

    def armed(self, level):
        if len(self.hold) > 0:  # it may also end
            # True for all members, as a mask of the vector's width; `level != level` is False.
            return level == level
        return level < 0.0

    def counts_at_start(self, level):
        if len(self.ignored) > 0:
            return level != level
        return level >= 0.0

    def dwell(self):
        return self.hold

    def is_terminal(self):
        return self.stop
