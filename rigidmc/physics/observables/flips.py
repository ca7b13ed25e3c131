"""Flips: how often and when a body turns over about its middle axis, and the waits between."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from rigidmc.errors import SceneError
from rigidmc.physics.dynamics.body_axes import described
from rigidmc.physics.dynamics.methods import Flag, flag
from rigidmc.physics.dynamics.so3 import dot, select
from rigidmc.physics.observables.directions import marked_component
from rigidmc.physics.observables.protocol import Array, EventRecord, event, is_finite, require

TABLE = "observables.flips"
ALIKE = 1e-12  # moments with a smaller relative difference count as equal
_OUTPUTS = {
    "flips": (
        "1",
        "number of flips about the {axis}, each after L came within {within:.4g} rad of it",
        (),
    ),
    "flip_first": ("s", "time of the first flip; nan if none", ()),
    "flip_last": ("s", "time of the last flip; nan if none", ()),
    "flip_wait": ("s", "mean time between flips; nan for fewer than two", ()),
    "flip_wait_deviation": (
        "s",
        "standard deviation of the times between flips, each interpolated linearly in its step; "
        "nan for fewer than two",
        (),
    ),
}


@event(outputs=_OUTPUTS, event_times=("flip_first",), parameter_units={"within": "rad"})
class Flips(NamedTuple):
    """The number of times a body turns over about an axis, by default its middle principal axis.

    A flip is a change of sign of the angular momentum about the axis after L has come within an
    angle of either end of the axis. A free top that starts there flips every 2 K(m)/lambda
    (flip_interval of `rigidmc exact`), TdC (3.35) in closed form; a free top that wobbles about
    another axis never flips. A body with two equal moments has no middle axis: unless `axis` names
    one, it never flips, however it precesses.

    A flip back and forth within one step counts, too. With noise, flips are detected only at the
    ends of steps.

    Parameters
    ----------
    axis : int, optional
        1, 2 or 3, an axis of the body as described; 0 for the principal axis of the middle moment
    within : float, optional [rad]
        L must come within this angle of either end of the axis before a flip

    Examples
    --------
    >>> start = rm.Start(omega=(rm.normal(0.0, 1e-3), 1.0, 0.0))
    >>> scene = rm.Scene(rm.Body.from_moments((1.0, 2.0, 3.0)), start=start)
    >>> ds = rm.simulate(scene, members=4, t_end=40.0, save=(rm.Flips(),))
    >>> ds.flips.values.tolist()
    [1.0, 2.0, 1.0, 1.0]
    """

    axis: int = 0
    within: float = math.pi / 3.0

    def check(self) -> None:
        """Raise SceneError for an axis or an angle that is not allowed."""
        is_axis = not isinstance(self.axis, bool) and self.axis in (0, 1, 2, 3)
        rule = "expected 1, 2, 3, or 0 for the axis of the middle moment"
        require(is_axis, rule, f"{TABLE}.axis", self.axis)
        is_angle = is_finite(self.within) and 0.0 < self.within <= 0.5 * math.pi
        rule = 'expected an angle between 0 and pi/2 [rad]; degrees are written "60 deg"'
        require(is_angle, rule, f"{TABLE}.within", self.within)

    def bind(self, moments: Array, complete: bool, effects: Sequence[Any]) -> "FlipLevel":
        """Return the event for bodies of these moments (3, n); complete : if these are all."""
        axes, some_alike = [self.axis - 1], False
        if self.axis == 0:
            # A stable sort: equal moments keep the order of their axes, on every machine.
            order = np.argsort(moments, axis=0, kind="stable")
            low, middle, high = np.take_along_axis(moments, order, axis=0)
            different = (middle - low > ALIKE * middle) & (high - middle > ALIKE * high)
            if not np.any(different):
                rule = (
                    "every body of the scene has two equal moments, and so no middle axis; give "
                    "axis = 1, 2 or 3"
                )
                raise SceneError(rule, at=f"{TABLE}.axis", value=self.axis)
            axes = sorted({int(i) for i in order[1]}) if complete else [0, 1, 2]
            some_alike = not complete or not different.all()
        marks = tuple(flag(i in axes) for i in range(3))
        square, is_principal = math.cos(self.within) ** 2, flag(self.axis == 0)
        return FlipLevel(marks, is_principal, square, flag(some_alike))

    def label_fields(self) -> dict[str, Any]:
        """Return the axis and the angle."""
        axis = f"axis {self.axis}" if self.axis else "axis of the middle moment"
        return {"axis": axis, "within": float(self.within)}

    def results(self, record: EventRecord) -> dict[str, Array]:
        """Return the outputs."""
        with np.errstate(all="ignore"):
            waits = record.count - 1.0
            mean = (record.last - record.first) / waits
            mean_tau = (record.tau - record.first_tau) / waits
            spread = np.sqrt(np.maximum(record.squares / waits - mean_tau**2, 0.0))
        several = record.count > 1.0
        return {
            "flips": record.count,
            "flip_first": record.first,
            "flip_last": record.last,
            "flip_wait": np.where(several, mean, np.nan),
            "flip_wait_deviation": np.where(several, spread, np.nan),
        }


class FlipLevel(NamedTuple):
    """A component of L, as an event.

    axes : ON for each axis of some body; if several are ON, the axis of the middle moment counts
    principal : ON for a principal axis, OFF for one of the axes in which the body is described
    square : squared cosine of the angle within which the event arms
    alike : ON if some bodies may have two equal moments; those never flip
    """

    axes: tuple[Flag, ...]
    principal: Flag
    square: float
    alike: Flag

    def level(self, body, l):
        if len(self.principal) == 0:
            return marked_component(self.axes, described(body, l))
        return component(self.axes, body, l)

    def armed(self, body, l, level, armed):
        near = armed | (level * level > self.square * dot(l, l))
        if len(self.alike) == 0:
            return near
        x, y, z = body.i1, body.i2, body.i3  # inverse moments: equal where the moments are
        return near & differ(x, y) & differ(y, z) & differ(z, x)

    def counts_at_start(self):
        return False


def differ(a, b):
    """Return whether two moments differ by more than rounding."""
    return abs(a - b) > ALIKE * select(a > b, a, b)


def component(marks, body, l):
    """Return the component of L about the one marked axis, or about the middle axis."""
    if len(marks[0]) + len(marks[1]) + len(marks[2]) > 1:
        # Compare inverse moments member by member: members of one vector may have different axes.
        second = ((body.i1 >= body.i2) & (body.i2 >= body.i3)) | (
            (body.i1 <= body.i2) & (body.i2 <= body.i3)
        )
        first = ((body.i2 >= body.i1) & (body.i1 >= body.i3)) | (
            (body.i2 <= body.i1) & (body.i1 <= body.i3)
        )
        return select(second, l[1], select(first, l[0], l[2]))
    return marked_component(marks, l)
