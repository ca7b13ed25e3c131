"""What the data show of the parameters, in words.

A direction in which no residual changes is found from J^T J. A sentence names the parameters
that may change together, and what would fix them: to know any one of them.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigidmc.studies.fit.parameters import MOMENTS, FitParameters
from rigidmc.studies.fit.streams import Array

# A combination of parameters is not seen if it changes the residuals by less than 1e-7 of what its
# parts would: J^T J has 16 digits, its square root 8.
UNSEEN = 1e-14
TAKES_PART = 1e-3  # least share of a parameter in a direction


class Seen(NamedTuple):
    """What the data show of the coordinates.

    inverse : of J^T J, on what they show (size, size)
    unseen : directions that they do not show (number, size)
    unit : change of each coordinate that changes the residuals by 1 (size,)
    """

    inverse: Array
    unseen: Array
    unit: Array

    @property
    def shares(self) -> Array:
        """Share of each coordinate in each direction, that of the largest being 1."""
        size = np.abs(self.unseen) / self.unit
        return np.asarray(size / size.max(1, keepdims=True, initial=0.0))

    def hides(self, slopes: Array) -> NDArray[np.bool_]:
        """Return whether the data do not show what changes so with the coordinates (n, size)."""
        ways = np.where(self.shares > TAKES_PART, self.unseen, 0.0).T
        parts = np.abs(slopes) @ np.abs(ways)
        return np.asarray((np.abs(slopes @ ways) > TAKES_PART * parts).any(1))


def seen(matrix: Array, slopes: Array | None = None) -> Seen:
    """Split the coordinates by the eigenvalues of J^T J (size, size), scaled to a diagonal of 1.

    slopes : of the parameters by the coordinates; what changes no parameter is not missed
    """
    unit = np.sqrt(np.diag(matrix))
    # a column of zeros stays one, whatever divides it: as small as the others, in sums with them
    unit = 1.0 / np.where(unit == 0.0, unit.max() or 1.0, unit)
    scale = np.outer(unit, unit)
    values, vectors = np.linalg.eigh(matrix * scale)
    shown = values > UNSEEN * values[-1] * len(values)
    inverse = (vectors[:, shown] / values[shown]) @ vectors[:, shown].T * scale
    hidden = vectors[:, ~shown].T
    if slopes is not None and hidden.size:
        by_unit = slopes * unit
        by_unit /= np.abs(by_unit).sum(1, keepdims=True)
        _, change, ways = np.linalg.svd(by_unit @ hidden.T, full_matrices=False)
        hidden = ways[change > TAKES_PART] @ hidden
    return Seen(inverse, simplest(hidden) * unit, unit)


def in_words(parameters: FitParameters, x: Array, shown: Seen) -> list[str]:
    """Return a sentence for each direction that the data do not show."""
    value, slopes, lines = parameters.values(x), parameters.slopes(x), []
    scale = np.abs(slopes) @ shown.unit
    for share in simplest(shown.unseen @ slopes.T / scale):
        taking = np.flatnonzero(np.abs(share) > TAKES_PART * np.abs(share).max())
        names = [parameters.names[i] for i in taking]
        lines.append(_sentence(names, (share * scale)[taking], value[taking]))
    return lines


def _sentence(names: Sequence[str], change: Array, value: Array) -> str:
    """Return one direction in words, given the changes of parameters and their values."""
    if len(names) == 1:
        return f"the data do not show {names[0]}: give it, or measure what depends on it"
    with np.errstate(divide="ignore"):
        relative = change / value
    if all(name.startswith(MOMENTS) for name in names) and np.ptp(relative) < 1e-3 * relative.max():
        return (
            "the data show only ratios of the principal moments: one moment, the momentum of a"
            " rotor or a known torque would fix their size"
        )
    least = np.abs(relative).min()  # 1 % of the largest, beside what may be near 0, or all be 0
    by = 0.01 / (least if least < np.inf else np.abs(change).max())
    each = ", ".join(f"{name} {by * c:+.3g}" for name, c in zip(names, change, strict=True))
    return f"the data do not show this common change: {each}; any one of them, known, fixes it"


def simplest(directions: Array) -> Array:
    """Return combinations of directions in which as few parameters as possible take part: the
    reduced row echelon form, with the largest pivots."""
    rows = np.array(directions)
    for done in range(len(rows)):
        rest = np.abs(rows[done:])
        i, j = divmod(int(np.argmax(rest)), rest.shape[1])
        rows[[done, done + i]] = rows[[done + i, done]]
        rows[done] /= rows[done, j]
        others = np.arange(len(rows)) != done
        rows[others] -= rows[others, j][:, None] * rows[done]
    return rows
