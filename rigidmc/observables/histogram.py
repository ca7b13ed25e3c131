"""How a number is spread over the ensemble at every save, with no trajectory kept."""

import math
import re
from typing import NamedTuple

import numpy as np

from rigidmc.errors import SceneError


class Histogram(NamedTuple):
    """Counts of the members by an observable at every save time, of `bins` equal parts of low to high; what lies outside is counted at the ends.

    of : the name of an observable, with its component where it has several, e.g. "energy" or "omega[3]"

    Flagged members are left out. The observable itself is stored only where `save` names it.
    """

    of: str
    low: float
    high: float
    bins: int = 100
    ensemble = True
    outputs = {}

    def check(self):
        table = "observables.histogram"
        if not isinstance(self.of, str) or not re.fullmatch(r"[a-z0-9_]+(\[[1-4]\])?", self.of):
            raise SceneError(
                table,
                "of",
                self.of,
                'expected the name of an observable, as in "energy" or "omega[3]"',
            )
        for key, value in (("low", self.low), ("high", self.high)):
            if (
                isinstance(value, bool)
                or not isinstance(value, (int, float))
                or not math.isfinite(value)
            ):
                raise SceneError(table, key, value, "expected a finite number")
        if not self.low < self.high:
            raise SceneError(table, "high", self.high, f"expected more than low = {self.low:g}")
        if (
            isinstance(self.bins, bool)
            or not isinstance(self.bins, int)
            or not 1 <= self.bins <= 100_000
        ):
            raise SceneError(
                table, "bins", self.bins, "expected a whole number between 1 and 100000"
            )

    @property
    def name(self):
        """The observable's name."""
        return self.of.split("[")[0]

    @property
    def component(self):
        """Its component, from 0."""
        return int(self.of[-2]) - 1 if self.of.endswith("]") else 0

    def edges(self):
        """The ends of the bins (bins + 1)."""
        return np.linspace(self.low, self.high, self.bins + 1)

    def counts(self, values):
        """Counts (times, bins + 2) of values (times, members), those below and above first and last."""
        share = np.floor((values - self.low) * (self.bins / (self.high - self.low)))
        place = np.clip(np.nan_to_num(share, nan=-1.0), -1, self.bins).astype(np.intp) + 1
        return np.stack([np.bincount(row, minlength=self.bins + 2) for row in place])
