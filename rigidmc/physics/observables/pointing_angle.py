"""Where a direction of the body points: its angle from a direction in space, without a cone."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple, Self

from rigidmc.errors import SceneError
from rigidmc.physics.dynamics.so3 import arctan2, cross, dot, root, sincos
from rigidmc.physics.observables import directions
from rigidmc.physics.observables.directions import is_vector, seen
from rigidmc.physics.observables.protocol import observable

TABLE = "observables.pointing_angle"


@observable(units="rad", long_name="angle between {axis} and the {about}", dims=())
class PointingAngle(NamedTuple):
    """The angle between a direction of the body and a direction in space.

    With the direction of the body u, of length 1, and a vector d along that in space::

        angle = atan2(|u x d|, u . d)

    which is exact to rounding near 0 and pi too. It is 0 where d has no length. Its extremes over
    the steps, `pointing_angle_max` and `pointing_angle_min`, are sought by the cosine, which is
    smooth where the angle is not.

    Parameters
    ----------
    axis : int or sequence of 3 floats
        1, 2, 3, or -1, -2, -3 for its other end; or a direction in the principal axes
    about : str or sequence of 3 floats, optional
        the direction in space, as of `Passage`

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
        """Raise SceneError for what is no direction."""
        whole = type(self.axis) is int and abs(self.axis) in (1, 2, 3)
        if not whole and not is_vector(self.axis):
            rule = "expected 1, 2, 3, -1, -2 or -3, or a direction of three numbers"
            raise SceneError(rule, at=f"{TABLE}.axis", value=self.axis)
        directions.check(self.about, f"{TABLE}.about")

    def words(self) -> dict[str, Any]:
        """Both directions."""
        axis = f"axis {self.axis}" if isinstance(self.axis, int) else f"body {_shown(self.axis)}"
        return {"axis": axis, "about": directions.words(self.about)}

    def under(self, effects: Sequence[Any]) -> Self:
        """The same as it is compiled: the axis a unit vector, the direction a Direction."""
        axis: Any = self.axis
        if isinstance(axis, int):
            axis = directions.unit(axis)
        else:
            axis = tuple(x / math.hypot(*axis) for x in axis)
        about = directions.compiled(self.about, effects, f"{TABLE}.about")
        return self._replace(axis=axis, about=about)  # type: ignore[arg-type]

    def value(self, effects, t, q, l):
        d = seen(self.about, effects, t, q, l)
        # By both products: the arccosine of u . d has half its digits near 0 and pi.
        across = cross(self.axis, d)
        return (arctan2(root(dot(across, across)), dot(self.axis, d)),)

    def monotone(self, values):
        return (-sincos(values[0])[1],)


def _shown(vector: Sequence[float]) -> str:
    """A vector in a long_name."""
    return f"({', '.join(f'{x:g}' for x in vector)})"
