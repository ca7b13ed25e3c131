"""Angles of a body in space: from an axis to a direction; roll, pitch and yaw on an orbit."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple, Self

import numpy as np

from rigidmc.physics.dynamics.body_axes import described, described_attitude
from rigidmc.physics.dynamics.methods import static_count
from rigidmc.physics.dynamics.so3 import arctan2, cross, dot, into_body, root, sincos, vertical
from rigidmc.physics.observables import directions
from rigidmc.physics.observables.directions import (
    direction_in_body,
    is_vector,
    place_on,
    source,
    unit,
)
from rigidmc.physics.observables.protocol import observable, require

POINTING = "observables.pointing_angle"


@observable(units="rad", long_name="angle between {axis} and the {about}", dims=())
class PointingAngle(NamedTuple):
    """The angle between a direction of the body and a direction in space.

    For a unit vector u of the body and a vector d along the direction in space::

        angle = atan2(|u x d|, u . d)

    which is exact to rounding near 0 and pi, too. The angle is 0 where d vanishes. Its extremes
    over the steps, `pointing_angle_max` and `pointing_angle_min`, are found from the cosine, which
    is smooth where the angle is not.

    Parameters
    ----------
    axis : int or sequence of 3 floats
        1, 2 or 3, an axis of the body as described, or -1, -2, -3 for its other end; or a direction
        in these axes
    about : str or sequence of 3 floats, optional
        the direction in space, see `Passage`

    Examples
    --------
    >>> body, pull = rm.Body.from_moments((1.0, 1.4, 1.2)), rm.GravityGradient(3.986e14, 7e6)
    >>> scene = rm.Scene(body, pull, rm.Start(omega=(0.0, 0.0, 0.002)))
    >>> down = rm.PointingAngle(-1, about="local_vertical")
    >>> ds = rm.simulate(scene, dt=1.0, t_end=10.0, every=10.0, save=(down, "pointing_angle_max"))
    >>> float(ds.pointing_angle[0, 0]), ds.pointing_angle.long_name
    (3.141592653589793, 'angle between axis -1 and the local vertical')
    """

    axis: int | Sequence[float]
    about: str | Sequence[float] = "vertical"

    def check(self) -> None:
        """Raise SceneError unless both directions are valid."""
        is_axis = type(self.axis) is int and abs(self.axis) in (1, 2, 3)
        rule = "expected 1, 2, 3, -1, -2 or -3, or a direction of three numbers"
        require(is_axis or is_vector(self.axis), rule, f"{POINTING}.axis", self.axis)
        directions.check(self.about, f"{POINTING}.about")

    def label_fields(self) -> dict[str, Any]:
        """Return the two directions as words."""
        axis = f"axis {self.axis}" if isinstance(self.axis, int) else f"body {_shown(self.axis)}"
        return {"axis": axis, "about": directions.words(self.about)}

    def bind(self, effects: Sequence[Any]) -> Self:
        """Return the compiled form: the axis as a unit vector, the direction as a Direction."""
        axis: Any = self.axis
        if isinstance(axis, int):
            axis = directions.unit(axis)
        else:
            axis = tuple(x / math.hypot(*axis) for x in axis)
        about = directions.make_direction(self.about, effects, f"{POINTING}.about")
        return self._replace(axis=axis, about=about)  # type: ignore[arg-type]

    def value(self, body, effects, t, q, l):
        d = described(body, direction_in_body(self.about, effects, t, q, l))
        # Both products: the arccosine of u . d keeps only half its digits near 0 and pi.
        across = cross(self.axis, d)
        return (arctan2(root(dot(across, across)), dot(self.axis, d)),)

    def monotone(self, values):
        return (-sincos(values[0])[1],)


def _shown(vector: Sequence[float]) -> str:
    """Return a vector as text for a long_name."""
    return f"({', '.join(f'{x:g}' for x in vector)})"


ORBIT = "observables.orbit_angles"


@observable(
    units="rad", long_name="roll, pitch and yaw of the axes {axes} on the orbit", dims=("angle",)
)
class OrbitAngles(NamedTuple):
    """Roll, pitch and yaw of a body in the local frame of the orbit of a `GravityGradient`.

    The frame of the orbit has x along the track, y opposite to the orbit normal and z from the body
    to the centre. From this frame the body turns by yaw about z, by pitch about the new y and by
    roll about the new x: the sequence 3-2-1. With C_ij = (axis i of the body) . (axis j of the
    frame)::

        roll = atan2(C23, C33),   pitch = atan2(-C13, sqrt(C23^2 + C33^2)),   yaw = atan2(C12, C11)

    Roll and yaw lie between -pi and pi, pitch between -pi/2 and pi/2. At either end of the range of
    pitch, only the sum or the difference of roll and yaw is defined.
    Source: Wertz, Spacecraft Attitude Determination and Control (1978), appendix E.

    Parameters
    ----------
    axes : sequence of 3 ints, optional
        the axes of the body, as described, that lie along x, y and z when all angles are 0: 1, 2 or
        3, negative for the other end

    Examples
    --------
    Axis 1 points away from the centre, and axis 3 along the normal of the orbit:

    >>> body, pull = rm.Body.from_moments((1.0, 1.4, 1.2)), rm.GravityGradient(3.986e14, 7e6)
    >>> scene = rm.Scene(body, pull, rm.Start(omega=(0.0, 0.0, 0.002)))
    >>> angles = rm.OrbitAngles(axes=(2, -3, -1))
    >>> ds = rm.simulate(scene, dt=1.0, t_end=10.0, every=10.0, save=(angles,))
    >>> ds.orbit_angles.sel(angle="pitch").values[:, 0].round(4).tolist()
    [0.0, -0.0092]
    """

    axes: Sequence[Any] = (1, 2, 3)

    def check(self) -> None:
        """Raise SceneError unless the axes are right-handed."""
        three = isinstance(self.axes, Sequence) and len(self.axes) == 3
        are_axes = three and all(type(i) is int and abs(i) in (1, 2, 3) for i in self.axes)
        # A left-handed frame has the determinant -1.
        is_right = are_axes and np.linalg.det([unit(i) for i in self.axes]) > 0.5
        rule = "expected three different axes that are right-handed, such as [2, -3, -1]"
        require(bool(is_right), rule, f"{ORBIT}.axes", self.axes)

    def label_fields(self) -> dict[str, Any]:
        """Return the axes as words."""
        return {"axes": ", ".join(map(str, self.axes))}

    def bind(self, effects: Sequence[Any]) -> Self:
        """Return the compiled form: unit vectors, then the number of effects before the orbit's."""
        before = static_count(source("orbit", effects, f"{ORBIT}.axes"))
        return self._replace(axes=(*map(unit, self.axes), before))

    def value(self, body, effects, t, q):
        x, y, z, index = self.axes
        q = described_attitude(body, q)
        cosine, sine = place_on(effects, index, t)
        out = into_body(q, (cosine, sine, 0.0))
        ahead, normal = into_body(q, (-sine, cosine, 0.0)), vertical(q)
        c23, c33 = -dot(y, out), -dot(z, out)
        return (
            arctan2(c23, c33),
            arctan2(dot(x, out), root(c23 * c23 + c33 * c33)),
            arctan2(-dot(x, normal), dot(x, ahead)),
        )
