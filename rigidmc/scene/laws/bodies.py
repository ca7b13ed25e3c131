"""Laws of the principal moments of inertia."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from rigidmc.scene.laws.protocol import Array, Facts, Law, numbers
from rigidmc.scene.quantities import Source, draw


@dataclass(frozen=True)
class SecondMoments(Law):
    """Principal moments of inertia from the second moments of mass, TdC (3.15).

    From the second moments a, b, c::

        I1 = b + c,  I2 = c + a,  I3 = a + b

    A body exists for any positive a, b, c.

    Parameters
    ----------
    values : quantities (3,) [kg m^2]
        (a, b, c)

    Examples
    --------
    >>> law = rm.SecondMoments((1.0, 2.0, rm.uniform(0.5, 1.5)))
    >>> moments, mass, centre = rm.Body.from_moments(law).sample(0, 0, 1000)
    >>> bool((moments.max(0) <= moments.sum(0) - moments.max(0)).all())
    True
    """

    values: Any

    word = "second_moments"
    of = ("moments",)
    sized = {"values": 1}

    def checked(self, where: str) -> "SecondMoments":
        return SecondMoments(numbers(self.values, where, "values", 3))

    def sample(
        self, source: Source, name: str, first: int, count: int, facts: Facts | None
    ) -> Array:
        a, b, c = draw(self.values, source, f"{name}.second", first, count)
        return np.stack([b + c, c + a, a + b])
