"""Points that fill a cube more evenly than independent ones: scrambled Sobol sequences and Latin hypercubes of scipy.stats.qmc, antithetic pairs.

They stand in the place of the seed where members are drawn: every number that a member draws is one dimension, in the order in which they are drawn.
Member i has point i, so that its numbers are a function of (seed, scene, i) alone; of a Latin hypercube also of how many strata it has.
"""

import inspect
import threading
import warnings
from functools import lru_cache

import numpy as np

from rigidmc.engine.streams import stream_of, uniforms

BITS = 30  # of a Sobol point, which makes 2^30 of them (scipy 1.17 cannot skip ahead with more than 32); half a step more, and none is 0


class Recorder:
    """Notes which numbers are drawn, instead of drawing them."""

    def __init__(self):
        self.found: list[tuple[str, int, int]] = []

    def words(self, name, first, count, draw, used):
        self.found += [(name, draw, i) for i in used if (name, draw, i) not in self.found]
        return np.full((4, count), 0.5)


class Antithetic:
    """Pairs of members: the second has 1 - u where the first has u, both of the seed's independent numbers of the pair."""

    def __init__(self, seed):
        self.seed = seed

    def words(self, name, first, count, draw, used):
        pairs = uniforms(self.seed, name, first // 2, (first + count + 1) // 2 - first // 2, draw)
        both = np.stack([pairs, 1.0 - pairs], axis=-1).reshape(4, -1)
        return np.ascontiguousarray(both[:, first % 2 : first % 2 + count])


class Points:
    """The points of an ensemble. dimensions : (name, draw, word) of each, as a Recorder has them;  strata : of a Latin hypercube"""

    def __init__(self, seed, kind, dimensions, strata=None):
        self.place = {dimension: i for i, dimension in enumerate(dimensions)}
        self._lock, self._at, self._last = threading.Lock(), 0, dict[tuple[int, int], np.ndarray]()
        some = np.random.default_rng([seed, stream_of(f"points.{kind}") >> 1])
        self._all = None
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            if kind == "sobol":
                self._engine = _made("Sobol", len(dimensions), some, scramble=True, bits=BITS)
            else:
                self._all = _made("LatinHypercube", len(dimensions), some).random(strata).T

    def words(self, name, first, count, draw, used):
        """(4, count) numbers in (0, 1), of which those are filled that are used."""
        points, found = self._points(first, count), np.full((4, count), 0.5)
        for i in used:
            found[i] = points[self.place[name, draw, i]]
        return found

    def _points(self, first, count):
        with self._lock:
            if (first, count) not in self._last:
                while len(self._last) > 8:
                    self._last.pop(next(iter(self._last)))
                self._last[first, count] = self._made(first, count)
            return self._last[first, count]

    def _made(self, first, count):
        if self._all is not None:
            return self._all[:, np.minimum(np.arange(first, first + count), self._all.shape[1] - 1)]
        if first < self._at:  # sequences only run forward
            self._engine.reset()
            self._at = 0
        with warnings.catch_warnings():
            warnings.simplefilter(
                "ignore"
            )  # that a block is no power of two: the sequence is what counts
            if first > self._at:
                self._engine.fast_forward(first - self._at)
            points = self._engine.random(count).T + 0.5**BITS / 2.0
        self._at = first + count
        return points


def _made(name, dimensions, some, **options):
    from scipy.stats import qmc

    kind = getattr(qmc, name)
    key = (
        "rng" if "rng" in inspect.signature(kind.__init__).parameters else "seed"
    )  # scipy before 1.15
    return kind(dimensions, **{key: some}, **options)


@lru_cache(maxsize=8)
def points(seed, kind, dimensions, strata=None):
    """The Points of these, made once."""
    return Points(seed, kind, dimensions, strata)
