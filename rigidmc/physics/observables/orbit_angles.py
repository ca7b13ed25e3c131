"""Roll, pitch and yaw of a body on an orbit."""

from collections.abc import Sequence
from typing import Any, NamedTuple, Self

import numpy as np

from rigidmc.errors import SceneError
from rigidmc.physics.dynamics.methods import static_count
from rigidmc.physics.dynamics.so3 import arctan2, dot, into_body, root, up
from rigidmc.physics.observables.directions import place_on, source, unit
from rigidmc.physics.observables.protocol import observable

TABLE = "observables.orbit_angles"


@observable(
    units="rad", long_name="roll, pitch and yaw of the axes {axes} on the orbit", dims=("angle",)
)
class OrbitAngles(NamedTuple):
    """Roll, pitch and yaw of a body in the local frame of its orbit, that of a `GravityGradient`.

    The frame of the orbit has x along the track, y opposite to the normal of the orbit and z from
    the body to the centre. From there the body is turned by yaw about z, by pitch about the new y
    and by roll about the new x: the sequence 3-2-1. With C_ij = (axis i of the body) . (axis j of
    the frame)::

        roll = atan2(C23, C33),   pitch = atan2(-C13, sqrt(C23^2 + C33^2)),   yaw = atan2(C12, C11)

    Roll and yaw lie between -pi and pi, pitch between -pi/2 and pi/2; at the ends of pitch only the
    sum or the difference of the two others has a meaning.
    Source: Wertz, Spacecraft Attitude Determination and Control (1978), appendix E.

    Parameters
    ----------
    axes : sequence of 3 ints, optional
        the principal axes that lie along x, y and z where all angles are 0: 1, 2, 3, or with a sign
        for the other end

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
        """Raise SceneError for what are no right-handed axes."""
        three = isinstance(self.axes, Sequence) and len(self.axes) == 3
        whole = three and all(type(i) is int and abs(i) in (1, 2, 3) for i in self.axes)
        # A left-handed frame has the determinant -1.
        if not whole or np.linalg.det([unit(i) for i in self.axes]) < 0.5:
            rule = "expected three different axes that are right-handed, such as [2, -3, -1]"
            raise SceneError(rule, at=f"{TABLE}.axes", value=self.axes)

    def words(self) -> dict[str, Any]:
        """The axes."""
        return {"axes": ", ".join(map(str, self.axes))}

    def under(self, effects: Sequence[Any]) -> Self:
        """The same as it is compiled: unit vectors, then how many effects are before the orbit."""
        before = static_count(source("orbit", effects, f"{TABLE}.axes"))
        return self._replace(axes=(*map(unit, self.axes), before))

    def value(self, effects, t, q):
        x, y, z, index = self.axes
        cosine, sine = place_on(effects, index, t)
        out = into_body(q, (cosine, sine, 0.0))
        ahead, normal = into_body(q, (-sine, cosine, 0.0)), up(q)
        c23, c33 = -dot(y, out), -dot(z, out)
        return (
            arctan2(c23, c33),
            arctan2(dot(x, out), root(c23 * c23 + c33 * c33)),
            arctan2(-dot(x, normal), dot(x, ahead)),
        )
