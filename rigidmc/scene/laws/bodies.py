"""Laws of the principal moments of inertia."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from rigidmc.scene.laws.protocol import Array, Facts, Law, numbers
from rigidmc.scene.quantities import Source, draw


@dataclass(frozen=True)
class SecondMoments(Law):
    """Principal moments of inertia from the second moments of mass (a, b, c) [kg m^2], TdC (3.15).

        I1 = b + c,  I2 = c + a,  I3 = a + b

    A body exists for any positive a, b, c.
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
