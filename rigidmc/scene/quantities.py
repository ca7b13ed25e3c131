"""How members differ: numbers, distributions, grids or one row per member, drawn as a function of (seed, name, member) alone."""

import math
from dataclasses import dataclass, replace

import numpy as np

from rigidmc.dynamics.functions import normal_quantile, power
from rigidmc.engine.streams import uniforms
from rigidmc.errors import RigidmcError, SceneError, unknown
from rigidmc.scene.amounts import counted


@dataclass(frozen=True)
class Distribution:
    """A probability distribution of one number; `name` is "normal", "uniform" or any continuous one of scipy.stats.

    Numbers are drawn by inverting the distribution function, so that any point set in (0, 1) can drive it.
    """

    name: str
    parameters: tuple

    @property
    def by_scipy(self):
        """Whether its quantiles are computed by scipy, of which another version may round them otherwise."""
        return self.name not in ("normal", "uniform")

    def ppf(self, u):
        """Quantiles of u, an array in (0, 1)."""
        if self.name == "normal":
            return self.parameters[0] + self.parameters[1] * normal_quantile(u)
        if self.name == "uniform":
            return self.parameters[0] + (self.parameters[1] - self.parameters[0]) * u
        return _scipy(self.name)(**dict(self.parameters)).ppf(u)

    def times(self, by):
        """The distribution of the number multiplied by a positive one."""
        if not self.by_scipy:
            return Distribution(self.name, tuple(by * p for p in self.parameters))
        scales = {"loc": 0.0, "scale": 1.0} | dict(self.parameters)
        return Distribution(
            self.name, tuple((k, v * by if k in ("loc", "scale") else v) for k, v in scales.items())
        )

    def as_table(self):
        """The distribution as it stands in a scene file."""
        return {self.name: dict(self.parameters) if self.by_scipy else list(self.parameters)}


@dataclass(frozen=True)
class Grid:
    """Evenly spaced numbers, the middles of `count` equal parts of (low, high), with `log` of equal ratios; member i has number i // stride % count.

    Two of them, one of stride r and one of stride r n, make a map of n columns with r members to a pixel.
    """

    low: float
    high: float
    count: int
    stride: int = 1
    log: bool = False

    def values(self):
        """All of them."""
        return self._values(np.arange(self.count))

    def _values(self, index):
        """The values of these indices; all values of a grid may not fit into memory."""
        share = (index + 0.5) / self.count
        return (
            self.low * power(self.high / self.low, share)
            if self.log
            else self.low + (self.high - self.low) * share
        )

    def at(self, first, count):
        """Those of members first ... first + count - 1."""
        return self._values(np.arange(first, first + count) // self.stride % self.count)

    def times(self, by):
        """The grid of the number multiplied by a positive one."""
        return replace(self, low=by * self.low, high=by * self.high)

    def as_table(self):
        """The grid as it stands in a scene file."""
        more = {"stride": self.stride} | ({"log": True} if self.log else {})
        return {"grid": [self.low, self.high, self.count], **more}


def grid(low, high, count, stride=1, log=False):
    """A Grid; SceneError for ends that are none, or counts below 1."""
    given = {"grid": [low, high, count], "stride": stride, "log": log}
    if not (_is_number(low) and _is_number(high) and low < high) or (log and not low > 0):
        rule = "expected grid = [low, high, count] with low < high" + (
            ", above 0 where log = true" if log else ""
        )
        raise SceneError("", "grid", given, rule)
    for name, value in (("count", count), ("stride", stride)):
        try:
            counted(value, name)
        except RigidmcError as error:
            raise SceneError("", "grid", given, f"{name}: {error.rule}") from None
    return Grid(float(low), float(high), int(count), int(stride), bool(log))


def _scipy(name):
    import scipy.stats

    found = getattr(scipy.stats, name, None)
    return found if isinstance(found, scipy.stats.rv_continuous) else None


def is_distribution(name):
    """Whether there is a distribution of that name."""
    return name in ("normal", "uniform") or _scipy(name) is not None


def normal(mean, standard_deviation):
    """Normal distribution N(mean, standard_deviation^2)."""
    return distribution("normal", mean, standard_deviation)


def uniform(low, high):
    """Uniform distribution on (low, high)."""
    return distribution("uniform", low, high)


def distribution(name, /, *values, **parameters):
    """A distribution by name: normal(mean, sd), uniform(low, high), or scipy.stats' with keyword parameters.

    Raises SceneError for an unknown name or parameters outside its domain.
    """
    given = {name: list(values) or parameters}
    if name in ("normal", "uniform"):
        ok = len(values) == 2 and not parameters and all(_is_number(v) for v in values)
        if not ok or (values[1] <= 0 if name == "normal" else values[1] <= values[0]):
            rule = (
                "normal = [mean, standard deviation > 0]"
                if name == "normal"
                else "uniform = [low, high] with low < high"
            )
            raise SceneError("", "distribution", given, f"expected {rule}, finite numbers")
        return Distribution(name, tuple(float(v) for v in values))
    family = _scipy(name)
    if family is None:
        import scipy.stats

        known = [
            n
            for n in dir(scipy.stats)
            if isinstance(getattr(scipy.stats, n), scipy.stats.rv_continuous)
        ]
        error = unknown("", "distribution", name, "distribution", ["normal", "uniform", *known])
        error.rule = "no such distribution; known: normal = [mean, sd], uniform = [low, high], and the continuous ones of scipy.stats"
        raise error
    allowed = [s.strip() for s in (family.shapes or "").split(",") if s.strip()] + ["loc", "scale"]
    wrong = [p for p in parameters if p not in allowed]
    if values or wrong or not all(_is_number(v) for v in parameters.values()):
        raise SceneError(
            "",
            "distribution",
            given,
            f"scipy's {name} takes a table of numbers with the keys {', '.join(allowed)}",
        )
    missing = [s for s in allowed[:-2] if s not in parameters]
    made = (
        None if missing else Distribution(name, tuple((k, float(v)) for k, v in parameters.items()))
    )
    if made is None or not np.isfinite(made.ppf(np.array([0.25, 0.75]))).all():
        raise SceneError(
            "",
            "distribution",
            given,
            f"{', '.join(missing) or 'a parameter'} is missing or outside the distribution's domain",
        )
    return made


def _is_number(value):
    return (
        isinstance(value, (int, float, np.integer, np.floating))
        and not isinstance(value, bool)
        and math.isfinite(value)
    )


def quantity(value, table, key):
    """A number, a Distribution, a Grid, or a 1-D array with one entry per member; SceneError for anything else."""
    if isinstance(value, (Distribution, Grid)):
        return value
    if _is_number(value):
        return float(value)
    if isinstance(value, np.ndarray) and value.ndim == 1 and np.issubdtype(value.dtype, np.number):
        if not value.size:
            raise SceneError(table, key, None, "an array needs at least one row")
        if not np.isfinite(value).all():
            row = int(np.flatnonzero(~np.isfinite(value))[0])
            raise SceneError(table, key, float(value[row]), f"row {row} is not finite")
        column = np.array(value, dtype=float)
        column.flags.writeable = False
        return column
    raise SceneError(
        table,
        key,
        value,
        "expected a finite number, a distribution, a grid, or a 1-D array with one entry per member",
    )


def vector(values, table, key, size=3):
    """A tuple of `size` quantities from a sequence of them or an array (members, size)."""
    if isinstance(values, np.ndarray) and values.ndim == 2 and values.shape[1] == size:
        values = [np.ascontiguousarray(values[:, i]) for i in range(size)]
    if isinstance(values, str) or not hasattr(values, "__len__") or len(values) != size:
        raise SceneError(
            table,
            key,
            values,
            f"expected {size} components, or an array of shape (members, {size})",
        )
    return tuple(quantity(v, table, key) for v in values)


def rows(*quantities):
    """How many rows the arrays among the quantities have; None where there are none."""
    sizes = {q.size for q in quantities if isinstance(q, np.ndarray)}
    if len(sizes) > 1:
        raise SceneError(
            "",
            "arrays",
            sorted(sizes),
            "arrays with one row per member must all have the same number of rows",
        )
    return sizes.pop() if sizes else None


def is_open(*values):
    """Whether the first members do not tell about the others: if any value is a distribution, a grid, a law of a whole vector, or a
    tuple with one."""
    return any(
        any(map(is_open, v)) if type(v) is tuple else not isinstance(v, (float, np.ndarray))
        for v in values
    )


def is_shared(*values):
    """Whether all values are plain numbers or tuples of them, the same for every member. A law of a whole vector never is, even one
    of plain numbers."""
    return all(all(map(is_shared, v)) if type(v) is tuple else isinstance(v, float) for v in values)


def numbers(seed, name, first, count, draw=0, used=(0, 1, 2, 3)):
    """(4, count) numbers in (0, 1), of which some are used: independent ones of a seed, or the points of `rigidmc.scene.points` that stand in its place."""
    return (
        seed.words(name, first, count, draw, used)
        if hasattr(seed, "words")
        else uniforms(seed, name, first, count, draw)
    )


def draw(quantities, seed, name, first, count):
    """(len(quantities), count) values for members first ... first + count - 1; word i % 4 of draw i // 4 of the stream `name` serves component i.

    Members past the end of an array get its last row: they only fill up lanes.
    """
    values = np.empty((len(quantities), count))
    words: dict[int, np.ndarray] = {}
    for i, q in enumerate(quantities):
        if isinstance(q, Distribution):
            if i // 4 not in words:
                used = tuple(
                    j % 4
                    for j in range(i, min(len(quantities), i // 4 * 4 + 4))
                    if isinstance(quantities[j], Distribution)
                )
                words[i // 4] = numbers(seed, name, first, count, i // 4, used)
            values[i] = q.ppf(words[i // 4][i % 4])
        elif isinstance(q, Grid):
            values[i] = q.at(first, count)
        elif isinstance(q, np.ndarray):
            part = q[first : first + count]
            values[i, : part.size], values[i, part.size :] = part, q[-1]
        else:
            values[i] = q
    return values
