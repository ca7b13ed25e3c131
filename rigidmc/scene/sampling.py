"""Point sets that give members their uniform numbers, in place of independent random numbers.

Some fill a cube more evenly than independent points: scrambled Sobol sequences and Latin hypercubes
of scipy.stats.qmc, and antithetic pairs. Others are the designs of studies, whose members come in
families.

Each number that a member draws is one dimension, in the order of drawing. Member i has point i, so
that its numbers depend only on (seed, scene, i), and in a Latin hypercube on the number of strata.
`is_drawn` returns whether a scene draws any numbers.
"""

import inspect
import threading
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import lru_cache
from importlib.metadata import version
from typing import Any

import numpy as np

from rigidmc.engine.streams import stream_of, uniforms
from rigidmc.errors import SceneError
from rigidmc.inputs.arrays import Array
from rigidmc.physics.effects import EFFECTS, label_effects
from rigidmc.physics.effects.protocol import is_random
from rigidmc.scene.distributions import Distribution
from rigidmc.scene.model import Model
from rigidmc.scene.quantities import Grid, count_rows
from rigidmc.scene.settings import Run
from rigidmc.scene.start_tables import KINDS
from rigidmc.scene.vector_distributions.protocol import VectorDistribution, flat_parameters

RandomDimension = tuple[str, int, int]  # name of the random stream, draw, word

# bits of a Sobol point, hence 2^30 points (scipy 1.17 cannot skip ahead with more than 32 bits);
# half a step is added, so that no number is 0
BITS = 30

# of neighbours, in probability: the last is 6e-8, which float64 resolves to eight digits
DISTANCES = tuple(0.25**k for k in range(1, 13))


class DimensionProbe:
    """A point set that records which numbers are drawn instead of drawing them."""

    def __init__(self) -> None:
        self.dimensions: list[RandomDimension] = []

    def words(self, name: str, first: int, count: int, draw: int, used: Sequence[int]) -> Array:
        drawn = [(name, draw, i) for i in used]
        self.dimensions += [dimension for dimension in drawn if dimension not in self.dimensions]
        # 0.5: the median, a number of every distribution
        return np.full((4, count), 0.5)


class AntitheticPairs:
    """Pairs of members: if the first draws u, the second has 1 - u. Different pairs draw
    independent u from a seed."""

    def __init__(self, seed: int) -> None:
        self.seed = seed

    def words(self, name: str, first: int, count: int, draw: int, used: Sequence[int]) -> Array:
        pairs = uniforms(self.seed, name, first // 2, (first + count + 1) // 2 - first // 2, draw)
        both = np.stack([pairs, 1.0 - pairs], axis=-1).reshape(4, -1)
        return np.ascontiguousarray(both[:, first % 2 : first % 2 + count])


class Saltelli:
    """Saltelli's design: families of d + 2 members, for d numbers or groups of numbers.

    The first two members of a family draw independent numbers a and b from a seed; member 2 + k has
    the numbers a, but group k from b.
    Source: Saltelli et al., Comput. Phys. Commun. 181 (2010) 259.

    group : {dimension: index of its group, from 0}
    """

    def __init__(self, seed: int, group: Mapping[RandomDimension, int]) -> None:
        self.seed, self.group = seed, group
        self.size = 2 + len(set(group.values()))

    def words(self, name: str, first: int, count: int, draw: int, used: Sequence[int]) -> Array:
        member = np.arange(first, first + count)
        family, place = member // self.size, member % self.size
        low, high = int(family[0]), int(family[-1]) + 1
        pairs = uniforms(self.seed, name, 2 * low, 2 * (high - low), draw)
        words = np.full((4, count), 0.5)
        for i in used:
            second = (place == 1) | (place == 2 + self.group[name, draw, i])
            words[i] = pairs[i, 2 * (family - low) + second]
        return words


class FixedPoints:
    """Numbers in (0, 1) chosen by a study: member i has column i of `numbers` (d, members), whose
    rows are the `dimensions` that a DimensionProbe recorded."""

    def __init__(self, dimensions: Sequence[RandomDimension], numbers: Array) -> None:
        self.place = {dimension: i for i, dimension in enumerate(dimensions)}
        self.numbers = numbers

    def words(self, name: str, first: int, count: int, draw: int, used: Sequence[int]) -> Array:
        words = np.full((4, count), 0.5)
        for i in used:
            words[i] = self.numbers[self.place[name, draw, i], first : first + count]
        return words


class NeighbourFamilies:
    """Families of a member and its neighbours at each of DISTANCES, for d numbers or groups.

    The first member of a family draws independent numbers u from a seed. The others have the same
    numbers, except in group `family % d`, where they have u + distance, or u - distance if the sum
    is not below 1. Distances are in probability: for a uniform distribution they are fractions of
    its range.

    group : {dimension: index of its group, from 0}
    """

    size = 1 + len(DISTANCES)

    def __init__(self, seed: int, group: Mapping[RandomDimension, int]) -> None:
        self.seed, self.group, self.groups = seed, group, len(set(group.values()))

    def words(self, name: str, first: int, count: int, draw: int, used: Sequence[int]) -> Array:
        member = np.arange(first, first + count)
        family, place = member // self.size, member % self.size
        low, high = int(family[0]), int(family[-1]) + 1
        u = uniforms(self.seed, name, low, high - low, draw)[:, family - low]
        distance, words = np.array((0.0, *DISTANCES))[place], np.full((4, count), 0.5)
        for i in used:
            moved = self.group[name, draw, i] == family % self.groups
            # downwards at the upper end: wrapped round, a neighbour would lie at the other end of
            # the range
            near = np.where(u[i] + distance < 1.0, u[i] + distance, u[i] - distance)
            words[i] = np.where(moved, near, u[i])
        return words


class PointSequence:
    """The points of an ensemble.

    kind : "sobol" or "latin_hypercube"
    dimensions : the purpose of each dimension, as recorded by a DimensionProbe
    strata : number of strata of a Latin hypercube
    """

    def __init__(
        self, seed: int, kind: str, dimensions: Sequence[RandomDimension], strata: int | None = None
    ) -> None:
        self.place = {dimension: i for i, dimension in enumerate(dimensions)}
        self._lock, self._at = threading.Lock(), 0
        self._recent: dict[tuple[int, int], Array] = {}
        rng = np.random.default_rng([seed, stream_of(f"points.{kind}") >> 1])
        self._all: Array | None = None
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            if kind == "sobol":
                self._engine = _engine("Sobol", len(dimensions), rng, scramble=True, bits=BITS)
            else:
                self._all = _engine("LatinHypercube", len(dimensions), rng).random(strata).T

    def words(self, name: str, first: int, count: int, draw: int, used: Sequence[int]) -> Array:
        """Return (4, count) numbers in (0, 1); the rows `used` are filled, the others are 0.5."""
        points, words = self._points(first, count), np.full((4, count), 0.5)
        for i in used:
            words[i] = points[self.place[name, draw, i]]
        return words

    def _points(self, first: int, count: int) -> Array:
        """Return the points of some members; the last few blocks are cached."""
        with self._lock:
            if (first, count) not in self._recent:
                while len(self._recent) > 8:
                    self._recent.pop(next(iter(self._recent)))
                self._recent[first, count] = self._computed(first, count)
            return self._recent[first, count]

    def _computed(self, first: int, count: int) -> Array:
        if self._all is not None:
            last = self._all.shape[1] - 1
            # members that only pad a block to whole lanes repeat the last stratum
            return self._all[:, np.minimum(np.arange(first, first + count), last)]
        if first < self._at:  # sequences only run forward
            self._engine.reset()
            self._at = 0
        with warnings.catch_warnings():
            # a block need not be a power of two: only the whole sequence matters
            warnings.simplefilter("ignore")
            if first > self._at:
                self._engine.fast_forward(first - self._at)
            points: Array = self._engine.random(count).T + 0.5**BITS / 2.0
        self._at = first + count
        return points


def _engine(name: str, dimensions: int, rng: np.random.Generator, **options: Any) -> Any:
    """Return an engine of scipy.stats.qmc."""
    from scipy.stats import qmc

    kind = getattr(qmc, name)
    # the argument is called `seed` before scipy 1.15
    key = "rng" if "rng" in inspect.signature(kind.__init__).parameters else "seed"
    return kind(dimensions, **{key: rng}, **options)


@lru_cache(maxsize=8)
def points(
    seed: int, kind: str, dimensions: tuple[RandomDimension, ...], strata: int | None = None
) -> PointSequence:
    """Return the PointSequence with these properties, computed once."""
    return PointSequence(seed, kind, dimensions, strata)


FamilyDesign = Saltelli | NeighbourFamilies
# functions of seed and groups
DESIGNS: dict[str, Callable[[int, Mapping[RandomDimension, int]], FamilyDesign]] = {
    "saltelli": Saltelli,
    "neighbours": NeighbourFamilies,
}


def is_drawn(model: Model) -> bool:
    """Return whether body, effects or start draw a number for each member."""
    words = isinstance(model.start.attitude, str)  # "uniform" or "ensemble"
    return words or any(
        isinstance(q, (Distribution, VectorDistribution)) for q in model.quantities()
    )


def rows_to_run(model: Model, run: Run) -> int | None:
    """Return the number of members that arrays with one row per member define; None without such
    arrays, or if the run sets its number of members."""
    count = count_rows(*model.quantities())
    return None if count is None or "members" in run.model_fields_set else count - run.first


def drawn_through(model: Model, run: Run) -> str:
    """Return a note on the library that draws members' numbers, if its version may change their
    bits; "" if rigidmc alone draws them."""
    kinds = Distribution, VectorDistribution
    through = any(isinstance(q, kinds) and q.uses_scipy for q in model.quantities())
    if not through and run.points not in ("sobol", "latin_hypercube"):
        return ""
    return f"through scipy {version('scipy')}: other versions may give other bits"


def is_sample(model: Model) -> bool:
    """Return whether members are a sample, whose spread gives the uncertainty of a mean.

    They are a sample if something is drawn, if an effect is random, or if they are the rows of a
    table, which count as a sample from their distribution. The members of a pure grid, and copies
    of one member, are the whole population: their mean has no interval.
    """
    tables = any(isinstance(q, np.ndarray) for q in model.quantities())
    return tables or is_drawn(model) or any(map(is_random, model.effects))


def is_sample_of(tables: Mapping[str, Any]) -> bool:
    """Return `is_sample` from the tables of the TOML text in a result: without its rows, and
    without the code of custom effects, which may be random."""
    effects = tables.get("effects", {})
    parts = [(name, table) for name, some in effects.items() for table in _several(some)]
    noisy = any(name not in EFFECTS or is_random(EFFECTS[name]) for name, _ in parts)
    body = {key: value for key, value in tables["body"].items() if key != "shape"}
    values = [*body.values(), *tables.get("start", {}).values()]
    values += [value for _, table in parts for value in table.values()]
    words = isinstance(tables.get("start", {}).get("attitude"), str)
    return noisy or words or any(map(_differs, values))


def _several(tables: Any) -> list[Any]:
    return tables if isinstance(tables, list) else [tables]


def _differs(value: Any) -> bool:
    """Return whether a value of a scene file contains a distribution or a table."""
    if isinstance(value, list):
        return any(map(_differs, value))
    if isinstance(value, dict) and not KINDS.isdisjoint(value):
        return any(map(_differs, value.values()))
    return isinstance(value, dict) and "grid" not in value


def is_indexed(model: Model) -> bool:
    """Return whether some values depend on the index of a member, as in grids and tables."""
    return any(isinstance(q, (Grid, np.ndarray)) for q in model.quantities())


def refuse_indexed(model: Model, study: str, tables: bool = True) -> None:
    """Raise SceneError for grids and tables, whose values depend on the index of a member.

    A study that moves, copies or pairs members would give a member the values of another.

    study : the reason, such as "members of a family differ only in drawn numbers"
    tables : False to allow tables
    """
    for at, value in _named(model):
        if isinstance(value, Grid) or (tables and isinstance(value, np.ndarray)):
            kind = "a grid" if isinstance(value, Grid) else "a table with one row per member"
            rule = (
                f"is {kind}: {study}; replace grids and tables by distributions, or run each row"
                " by itself"
            )
            raise SceneError(rule, at=at)


def named_values(model: Model) -> list[tuple[str, Any]]:
    """Return (path, value) of all quantities, and of the vectors that have several."""
    body, start = model.body, model.start
    named: list[tuple[str, Any]] = [
        (f"body.{body.inertia_key}", body.moments), ("body.mass", body.mass),
        ("body.centre", body.centre), (f"start.{start.spin_name}", getattr(start, start.spin_name)),
        ("start.attitude", start.attitude),
    ]  # fmt: skip
    for label, effect in label_effects(model.effects):
        named += [
            (f"effects.{label}.{key}", value)
            for key, value in zip(effect._fields, effect, strict=True)
        ]
    return named


def _named(model: Model) -> Iterator[tuple[str, Any]]:
    """Yield (path, quantity) for all quantities."""
    for at, value in named_values(model):
        parts = flat_parameters(value) if isinstance(value, VectorDistribution) else value
        yield from ((at, part) for part in (parts if type(parts) is tuple else (parts,)))
