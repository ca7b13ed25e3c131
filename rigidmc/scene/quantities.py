"""Quantities, by which members differ: numbers, distributions, grids, or one row per member. Their
values depend only on (seed, name, member)."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Protocol, TypeGuard

import numpy as np
from numpy.typing import NDArray

from rigidmc.engine.streams import uniforms
from rigidmc.errors import SceneError
from rigidmc.inputs.amounts import parse_count
from rigidmc.inputs.arrays import Array, Ints, as_plain_arrays, is_number, split_components
from rigidmc.inputs.measured import Measured, common_unit
from rigidmc.physics.dynamics.dual_arrays import DualArray
from rigidmc.physics.dynamics.functions import power
from rigidmc.scene.distributions import Distribution


class PointSet(Protocol):
    """Points that replace independent random numbers, see `rigidmc.scene.sampling`."""

    def words(self, name: str, first: int, count: int, draw: int, used: Sequence[int]) -> Array: ...


Source = int | PointSet  # source of numbers: a seed, or points


@dataclass(frozen=True)
class Grid:
    """Evenly spaced numbers: the centres of `count` equal parts of (low, high), or with `log`
    log-spaced numbers. Member i has number i // stride % count.

    Two grids, one of count n and stride r and one of stride r n, make a map of n columns with r
    members in each pixel.
    """

    low: float
    high: float
    count: int
    stride: int = 1
    log: bool = False

    def values(self) -> Array:
        """Return all numbers of the grid."""
        return self._values(np.arange(self.count))

    def at(self, first: int, count: int) -> Array:
        """Return the numbers of members first ... first + count - 1."""
        return self.of(np.arange(first, first + count))

    def of(self, members: Ints) -> Array:
        """Return the numbers of members by their indices."""
        return self._values(members // self.stride % self.count)

    def shares(self, first: int, count: int) -> Array:
        """Return where in (0, 1) between `low` and `high` the numbers of members are."""
        return (np.arange(first, first + count) // self.stride % self.count + 0.5) / self.count

    def _values(self, index: Ints) -> Array:
        """Return the numbers with these indices; a whole grid may not fit into memory."""
        share = (index + 0.5) / self.count
        if self.log:
            steps: Array = power(self.high / self.low, share)
            return self.low * steps
        return self.low + (self.high - self.low) * share

    def times(self, by: float) -> "Grid":
        """Return the grid of the number times a positive factor."""
        return replace(self, low=by * self.low, high=by * self.high)

    def as_table(self) -> dict[str, Any]:
        """Return the grid as written in a scene file."""
        more = {"stride": self.stride} | ({"log": True} if self.log else {})
        return {"grid": [self.low, self.high, self.count], **more}


def grid(low: Any, high: Any, count: int, stride: int = 1, log: bool = False) -> Grid:
    """Make evenly spaced numbers: the centres of equal parts of (low, high).

    Member i has number i // stride % count. Two grids, one of count n and stride r and one of
    stride r n, make a map of n columns with r members in each pixel.

    Parameters
    ----------
    low : float, str or quantity
        lower end of the first part, in units of the quantity; or with its unit, as "10 deg/s"
    high : float, str or quantity
        upper end of the last part
    count : int
        number of parts
    stride : int, optional
        number of consecutive members with the same number
    log : bool, optional
        log-spaced instead of evenly spaced numbers

    Returns
    -------
    Grid
        the grid that gives each member its number

    Raises
    ------
    SceneError
        unless low < high (both above 0 with `log`) and counts are at least 1

    Examples
    --------
    >>> rm.grid(0.0, 1.0, 4).values().tolist()
    [0.125, 0.375, 0.625, 0.875]
    """
    numbers, unit = common_unit({"low": low, "high": high}, "grid")
    if unit:
        return Measured(grid(**numbers, count=count, stride=stride, log=log), unit)  # type: ignore[return-value]
    shown = {"grid": [low, high, count], "stride": stride, "log": log}
    if not (is_number(low) and is_number(high) and low < high) or (log and not low > 0):
        above = ", above 0 if log = true" if log else ""
        rule = f"expected grid = [low, high, count] with low < high{above}"
        raise SceneError(rule, at="grid", value=shown)
    for name, value in (("count", count), ("stride", stride)):
        try:
            parse_count(value)
        except ValueError as error:
            raise SceneError(f"{name}: {error}", at="grid", value=shown) from None
    return Grid(float(low), float(high), int(count), int(stride), bool(log))


@dataclass(frozen=True)
class Varied:
    """A nominal value, used to plan a run whose members have other values.

    All members of a plan share it, but it is not a constant: no closed form and no symmetry may
    rely on it.
    """

    value: float

    def times(self, by: float) -> "Varied":
        """Return the number times a factor."""
        return Varied(self.value * by)


class Drawn(NamedTuple):
    """The numbers of members first ... first + count - 1 that come from one quantity.

    values : (count,);  words : the uniform numbers (4, count) of their draw, of which this quantity
        has word `own`; None if nothing is drawn
    """

    values: Array
    words: Array | None
    own: int
    first: int


Rate = Callable[[Drawn], Any]  # derivatives (count,) of the numbers by a parameter


@dataclass(frozen=True, eq=False)
class Marked:
    """A quantity whose numbers have derivatives by `parameters` parameters.

    rates : {index of a parameter: Rate}; the derivatives by the others are 0
    """

    quantity: Any
    rates: Mapping[int, Rate]
    parameters: int


def quantity(value: Any, at: str) -> Any:
    """Check a quantity: a number, a Distribution, a Grid, or a 1-D array with one entry per member;
    SceneError for anything else."""
    if isinstance(value, (Distribution, Grid, Varied)):
        return value
    value = as_plain_arrays(value, at)
    if is_number(value):
        return float(value)
    if isinstance(value, np.ndarray) and value.ndim == 1 and value.dtype.kind in "fiu":
        if not value.size:
            raise SceneError("an array needs at least one row", at=at)
        column = value
        if not is_frozen(value):
            with np.errstate(over="ignore"):  # of long doubles
                column = np.array(value, dtype=float)
        if not np.isfinite(column).all():
            row = int(np.flatnonzero(~np.isfinite(column))[0])
            raise SceneError(f"row {row} is not finite", at=at, value=float(column[row]))
        column.flags.writeable = False
        return column
    rule = (
        "expected a finite number, a distribution, a grid, or a 1-D array with one entry per member"
    )
    raise SceneError(rule, at=at, value=value)


def is_frozen(array: NDArray[Any]) -> bool:
    """Return whether an array is float64 and neither it nor the memory that it views can change."""
    if array.dtype != np.float64:
        return False
    memory: Any = array
    while isinstance(memory, np.ndarray):
        if memory.flags.writeable:
            return False
        memory = memory.base
    return memory is None


def vector(values: Any, at: str, size: int = 3) -> tuple[Any, ...]:
    """Return a tuple of `size` quantities, from a sequence of them or an array (members, size); see
    `rigidmc.inputs.arrays.split_components`."""
    values = split_components(values, at, size)
    return tuple(quantity(v, at) for v in values)


def count_rows(*quantities: Any) -> int | None:
    """Return the number of rows of the arrays among the quantities; None without arrays."""
    sizes = {q.size for q in quantities if isinstance(q, np.ndarray)}
    if len(sizes) > 1:
        rule = "arrays with one row per member must all have the same number of rows"
        raise SceneError(rule, at="arrays", value=sorted(sizes))
    return sizes.pop() if sizes else None


def of_members(value: Any, members: Ints) -> Any:
    """Return a quantity for members by their indices: a grid or an array becomes the array of their
    numbers, anything else is unchanged."""
    if isinstance(value, Grid):
        return value.of(members)
    return value[members] if isinstance(value, np.ndarray) else value


def is_variable(*values: Any) -> bool:
    """Return whether the first members do not determine the range of all: whether a value is a
    distribution, a vector distribution, a grid, or a tuple with one of these."""
    return any(
        any(map(is_variable, v)) if type(v) is tuple else not isinstance(v, (float, np.ndarray))
        for v in values
    )


def is_shared(*values: Any) -> bool:
    """Return whether all members have the same values: plain numbers, or tuples of them. A vector
    distribution is never shared, even if its parameters are plain numbers."""
    return all(all(map(is_shared, v)) if type(v) is tuple else isinstance(v, float) for v in values)


def is_seed(sampler: Source) -> TypeGuard[int]:
    """Return whether numbers are drawn from a seed, independently for each member."""
    return isinstance(sampler, (int, np.integer))


def draw_uniforms(
    sampler: Source,
    name: str,
    first: int,
    count: int,
    draw: int = 0,
    used: Sequence[int] = (0, 1, 2, 3),
) -> Array:
    """Return (4, count) numbers in (0, 1) for members first ... first + count - 1. Only the rows
    `used` matter."""
    if is_seed(sampler):
        return uniforms(sampler, name, first, count, draw)
    # a TypeGuard does not narrow the other branch
    return sampler.words(name, first, count, draw, used)  # type: ignore[union-attr]


def draw(quantities: Sequence[Any], sampler: Source, name: str, first: int, count: int) -> Array:
    """Return (len(quantities), count) values for members first ... first + count - 1. Component i
    uses word i % 4 of draw i // 4 of the random stream `name`.

    Members beyond the end of an array get its last row: they only fill up vectors. If a quantity
    has derivatives, so has the result, a DualArray.
    """
    values = np.empty((len(quantities), count))
    words: dict[int, Array] = {}
    for i, q in enumerate(quantities):
        if isinstance(q, Distribution):
            group = -1 if q.stream else i // 4
            if group not in words or q.stream:
                words[group] = _words_of(quantities, i, sampler, name, first, count)
            values[i] = q.of_words(words[group], i % 4)
        elif isinstance(q, Grid):
            values[i] = q.at(first, count)
        elif isinstance(q, np.ndarray):
            part = q[first : first + count]
            values[i, : part.size], values[i, part.size :] = part, q[-1]
        elif isinstance(q, Varied):
            values[i] = q.value
        elif isinstance(q, (DualArray, Marked)):
            return _draw_with_tangents(quantities, sampler, name, first, count)  # type: ignore[return-value]
        else:
            values[i] = q
    return values


def _words_of(
    quantities: Sequence[Any], i: int, sampler: Source, name: str, first: int, count: int
) -> Array:
    """Return the words (4, count) of the draw of the group of quantity i; or all words that it has
    in common with others."""
    if stream := quantities[i].stream:
        by = quantities[i].parameters[1:]
        used = [[j for j, a in enumerate(by[k : k + 4]) if a] for k in range(0, len(by), 4)]
        draws = [draw_uniforms(sampler, stream, first, count, k, u) for k, u in enumerate(used)]
        return np.concatenate(draws)
    group = quantities[i // 4 * 4 : i // 4 * 4 + 4]
    own = [j for j, q in enumerate(group) if isinstance(q, Distribution) and not q.stream]
    return draw_uniforms(sampler, name, first, count, i // 4, own)


def _draw_with_tangents(
    quantities: Sequence[Any], sampler: Source, name: str, first: int, count: int
) -> DualArray:
    """Return `draw` with tangents; some quantities are Marked, or numbers with tangents."""
    plain = [
        q.quantity if isinstance(q, Marked) else float(q.value) if isinstance(q, DualArray) else q
        for q in quantities
    ]
    values = draw(plain, sampler, name, first, count)
    parameters = next(
        q.parameters if isinstance(q, Marked) else len(q.tangents)
        for q in quantities
        if isinstance(q, (DualArray, Marked))
    )
    tangents = np.zeros((parameters, *values.shape))
    for i, q in enumerate(quantities):
        if isinstance(q, DualArray):
            tangents[:, i] = q.tangents[:, None]
        elif isinstance(q, Marked):
            words = None
            if isinstance(q.quantity, Distribution):
                words = _words_of(plain, i, sampler, name, first, count)
            drawn = Drawn(values[i], words, i % 4, first)
            for j, rate in q.rates.items():
                tangents[j, i] = rate(drawn)
    return DualArray(values, tangents)
