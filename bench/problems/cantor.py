"""Basins whose boundary is a middle-thirds set of known dimension."""

import numpy as np

from rigidmc.scene.sampling import NeighbourFamilies
from rigidmc.studies.basins.study import exponent

CANTOR = 1.0 - np.log(2.0) / np.log(3.0)  # 1 - dimension of the middle-thirds set


def gap(x):
    """Return the generation in which a point leaves the middle-thirds set. Gaps of even and odd
    generations are two basins, and the set is their boundary."""
    left, y = np.zeros(x.shape, int), x.copy()
    for generation in range(1, 34):
        y = 3.0 * y
        third = np.floor(y)
        y -= third
        left = np.where((left == 0) & (third == 1.0), generation, left)
    return left


def ends_of(seed, families, basin):
    """Return (families, 13): the basin of each member of a study of one parameter."""
    words = NeighbourFamilies(seed, {("x", 0, 0): 0}).words("x", 0, 13 * families, 0, (0,))[0]
    return basin(words.reshape(families, 13))


def found(ends):
    """Return the exponent of a study with two basins."""
    share = ends[:, 0].mean()
    return exponent((ends[:, 1:] != ends[:, :1]).T, 2.0 * share * (1.0 - share))
