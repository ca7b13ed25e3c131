"""Distribution of an observable over the ensemble at every save time, with no stored trajectory."""

import re
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigidmc.physics.observables.protocol import Array, ensemble, is_finite, require

TABLE = "observables.histogram"


@ensemble()
class Histogram(NamedTuple):
    """The number of members in equal bins of an observable at every save time, from low to high.

    Two further bins count values below and above the range. Flagged members are left out. The
    observable itself is stored only if `save` names it.

    Parameters
    ----------
    of : str
        the name of an observable, with its component if it has several: "energy", "omega[3]"
    low : float
        the lower end of the first bin, in units of the observable
    high : float
        the upper end of the last bin, in units of the observable
    bins : int, optional
        number of bins

    Examples
    --------
    >>> spins = rm.Histogram("omega[3]", low=-1.0, high=1.0, bins=4)
    >>> spins.edges().tolist()
    [-1.0, -0.5, 0.0, 0.5, 1.0]
    """

    of: str
    low: float
    high: float
    bins: int = 100

    def check(self) -> None:
        """Raise SceneError for an invalid name or number."""
        is_name = isinstance(self.of, str) and re.fullmatch(r"[a-z0-9_]+(\[[1-4]\])?", self.of)
        rule = 'expected the name of an observable, as in "energy" or "omega[3]"'
        require(bool(is_name), rule, f"{TABLE}.of", self.of)
        for key, end in ("low", self.low), ("high", self.high):
            require(is_finite(end), "expected a finite number", f"{TABLE}.{key}", end)
        rule = f"expected more than low = {self.low:g}"
        require(self.low < self.high, rule, f"{TABLE}.high", self.high)
        is_whole = isinstance(self.bins, int) and not isinstance(self.bins, bool)
        rule = "expected a whole number between 1 and 100000"
        require(is_whole and 1 <= self.bins <= 100_000, rule, f"{TABLE}.bins", self.bins)

    @property
    def name(self) -> str:
        """The name of the observable."""
        return self.of.split("[")[0]

    @property
    def component(self) -> int:
        """The component of the observable, from 0."""
        return int(self.of[-2]) - 1 if self.of.endswith("]") else 0

    def edges(self) -> Array:
        """Return the edges of the bins (bins + 1)."""
        return np.linspace(self.low, self.high, self.bins + 1)

    def counts(self, values: Array) -> NDArray[np.intp]:
        """Count values (times, members) into (times, bins + 2): below, in each bin, above."""
        counts = np.empty((len(values), self.bins + 2), np.intp)
        for row, found in zip(values, counts, strict=True):
            place = (row - self.low) * (self.bins / (self.high - self.low))
            np.floor(place, out=place)
            np.clip(place, -1, self.bins, out=place)
            place += 1.0
            # nan counts as below all bins: its conversion would depend on the machine
            if (unknown := np.isnan(place)).any():
                place[unknown] = 0.0
            found[:] = np.bincount(place.astype(np.intp), minlength=self.bins + 2)
        return counts
