"""How members differ: numbers, distributions or one row per member, drawn as a function of (seed, name, member) alone."""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from rigidmc.engine.random import uniforms
from rigidmc.errors import SceneError, unknown
from rigidmc.rotation import quaternion_from_euler, quaternion_from_matrix


@dataclass(frozen=True)
class Distribution:
    """A probability distribution of one number; `name` is "normal", "uniform" or any continuous one of scipy.stats.

    Numbers are drawn by inverting the distribution function, so that any point set in (0, 1) can drive it.
    """

    name: str
    parameters: tuple

    def ppf(self, u):
        """Quantiles of u, an array in (0, 1)."""
        if self.name == "normal":
            from scipy.special import ndtri

            return self.parameters[0] + self.parameters[1] * ndtri(u)
        if self.name == "uniform":
            return self.parameters[0] + (self.parameters[1] - self.parameters[0]) * u
        return _scipy(self.name)(**dict(self.parameters)).ppf(u)

    def times(self, by):
        """The distribution of the number multiplied by a positive one."""
        if self.name in ("normal", "uniform"):
            return Distribution(self.name, tuple(by * p for p in self.parameters))
        scales = {"loc": 0.0, "scale": 1.0} | dict(self.parameters)
        return Distribution(self.name, tuple((k, v * by if k in ("loc", "scale") else v) for k, v in scales.items()))

    def as_table(self):
        """The distribution as it stands in a scene file."""
        plain = self.name in ("normal", "uniform")
        return {self.name: list(self.parameters) if plain else dict(self.parameters)}


def _scipy(name):
    import scipy.stats

    found = getattr(scipy.stats, name, None)
    return found if isinstance(found, scipy.stats.rv_continuous) else None


def normal(mean, standard_deviation):
    """Normal distribution N(mean, standard_deviation^2)."""
    return distribution("normal", mean, standard_deviation)


def uniform(low, high):
    """Uniform distribution on (low, high)."""
    return distribution("uniform", low, high)


def distribution(name, *values, **parameters):
    """A distribution by name: normal(mean, sd), uniform(low, high), or scipy.stats' with keyword parameters.

    Raises SceneError for an unknown name or parameters outside its domain.
    """
    given = {name: list(values) or parameters}
    if name in ("normal", "uniform"):
        ok = len(values) == 2 and not parameters and all(_is_number(v) for v in values)
        if not ok or (values[1] <= 0 if name == "normal" else values[1] <= values[0]):
            rule = "normal = [mean, standard deviation > 0]" if name == "normal" else "uniform = [low, high] with low < high"
            raise SceneError("", "distribution", given, f"expected {rule}, finite numbers")
        return Distribution(name, tuple(float(v) for v in values))
    family = _scipy(name)
    if family is None:
        import scipy.stats

        known = [n for n in dir(scipy.stats) if isinstance(getattr(scipy.stats, n), scipy.stats.rv_continuous)]
        error = unknown("", "distribution", name, "distribution", ["normal", "uniform", *known])
        error.rule = (
            "no such distribution; known: normal = [mean, sd], uniform = [low, high], and the continuous ones of scipy.stats"
        )
        raise error
    allowed = [s.strip() for s in (family.shapes or "").split(",") if s.strip()] + ["loc", "scale"]
    wrong = [p for p in parameters if p not in allowed]
    if values or wrong or not all(_is_number(v) for v in parameters.values()):
        raise SceneError("", "distribution", given, f"scipy's {name} takes a table of numbers with the keys {', '.join(allowed)}")
    missing = [s for s in allowed[:-2] if s not in parameters]
    made = None if missing else Distribution(name, tuple((k, float(v)) for k, v in parameters.items()))
    if made is None or not np.isfinite(made.ppf(np.array([0.25, 0.75]))).all():
        raise SceneError(
            "", "distribution", given, f"{', '.join(missing) or 'a parameter'} is missing or outside the distribution's domain"
        )
    return made


def _is_number(value):
    return isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool) and math.isfinite(value)


def quantity(value, table, key):
    """A number, a Distribution, or a 1-D array with one entry per member; SceneError for anything else."""
    if isinstance(value, Distribution):
        return value
    if _is_number(value):
        return float(value)
    if isinstance(value, np.ndarray) and value.ndim == 1 and np.issubdtype(value.dtype, np.number):
        if not np.isfinite(value).all():
            row = int(np.flatnonzero(~np.isfinite(value))[0])
            raise SceneError(table, key, float(value[row]), f"row {row} is not finite")
        column = np.array(value, dtype=float)
        column.flags.writeable = False
        return column
    raise SceneError(table, key, value, "expected a finite number, a distribution, or a 1-D array with one entry per member")


def vector(values, table, key, size=3):
    """A tuple of `size` quantities from a sequence of them or an array (members, size)."""
    if isinstance(values, np.ndarray) and values.ndim == 2 and values.shape[1] == size:
        values = [np.ascontiguousarray(values[:, i]) for i in range(size)]
    if isinstance(values, str) or not hasattr(values, "__len__") or len(values) != size:
        raise SceneError(table, key, values, f"expected {size} components, or an array of shape (members, {size})")
    return tuple(quantity(v, table, key) for v in values)


def rows(*quantities):
    """How many rows the arrays among the quantities have; None where there are none."""
    sizes = {q.size for q in quantities if isinstance(q, np.ndarray)}
    if len(sizes) > 1:
        raise SceneError("", "arrays", sorted(sizes), "arrays with one row per member must all have the same number of rows")
    return sizes.pop() if sizes else None


def is_shared(*quantities):
    """Whether all quantities are plain numbers, the same for every member."""
    return all(isinstance(q, float) for q in quantities)


def draw(quantities, seed, name, first, count):
    """(len(quantities), count) values for members first ... first + count - 1; word i % 4 of draw i // 4 of the stream `name` serves component i.

    Members past the end of an array get its last row: they only fill up lanes.
    """
    values = np.empty((len(quantities), count))
    words: dict[int, np.ndarray] = {}
    for i, q in enumerate(quantities):
        if isinstance(q, Distribution):
            if i // 4 not in words:
                words[i // 4] = uniforms(seed, name, first, count, i // 4)
            values[i] = q.ppf(words[i // 4][i % 4])
        elif isinstance(q, np.ndarray):
            part = q[first : first + count]
            values[i, : part.size], values[i, part.size :] = part, q[-1]
        else:
            values[i] = q
    return values


@dataclass(frozen=True, eq=False)
class Start:
    """How the tops start: each component a number, a distribution, or an array with one row per member.

    omega : angular velocity in the body's principal axes [rad/s], or
    momentum : angular momentum in the body's principal axes [kg m^2/s]
    attitude : quaternion (w, x, y, z), normalised here; 3x3 matrix; Euler angles z-x-z (phi, theta, psi) [rad], TdC (3.36);
        a scipy Rotation; or "uniform" on SO(3). Default: body axes along space axes.

    Raises SceneError for a wrong shape, a non-finite number, a quaternion of norm 0, a matrix that is no rotation, or both or
    neither of omega and momentum.
    """

    omega: tuple | None = None
    momentum: tuple | None = None
    attitude: tuple | str = field(default=(1.0, 0.0, 0.0, 0.0))

    def __post_init__(self):
        if (self.omega is None) == (self.momentum is None):
            raise SceneError("start", "omega", None, "give either omega or momentum, one of them")
        which = "omega" if self.momentum is None else "momentum"
        object.__setattr__(self, which, vector(getattr(self, which), "start", which))
        object.__setattr__(self, "attitude", _attitude(self.attitude))

    def quantities(self):
        """All quantities of the start, in one flat tuple."""
        spin: Any = self.omega if self.momentum is None else self.momentum
        return (*spin, *(() if isinstance(self.attitude, str) else self.attitude))

    def spin(self, seed, first, count):
        """("omega" or "momentum", its values (3, count))."""
        which = "omega" if self.momentum is None else "momentum"
        return which, draw(getattr(self, which), seed, f"start.{which}", first, count)

    def quaternions(self, seed, first, count):
        """Unit quaternions (4, count)."""
        if isinstance(self.attitude, str):
            u, v, w = uniforms(seed, "start.attitude", first, count)[:3]
            a, b = np.sqrt(1.0 - u), np.sqrt(u)  # Shoemake 1992
            v, w = 2.0 * np.pi * v, 2.0 * np.pi * w
            return np.stack([b * np.cos(w), a * np.sin(v), a * np.cos(v), b * np.sin(w)])
        values = draw(self.attitude, seed, "start.attitude", first, count)
        if len(values) == 3:
            return quaternion_from_euler(*values)
        square = values[0] ** 2 + values[1] ** 2 + values[2] ** 2 + values[3] ** 2
        # one that is normalised stays to the bit, so that stored starts run again to the same bits
        return np.where(np.abs(square - 1.0) < 1e-15, values, values / np.sqrt(square))


def _attitude(value):
    if isinstance(value, str):
        if value != "uniform":
            raise unknown("start", "attitude", value, "attitude", ["uniform"])
        return value
    if hasattr(value, "as_quat"):
        value = np.asarray(value.as_quat(scalar_first=True))
        value = value if value.ndim == 2 else tuple(value.tolist())
    if not hasattr(value, "__len__") or isinstance(value, dict):
        rule = 'expected "uniform", a quaternion (w, x, y, z), Euler angles (phi, theta, psi), or a 3x3 matrix'
        raise SceneError("start", "attitude", value, rule)
    shape = _shape(value)
    if shape in ((3, 3), (len(value), 3, 3)):
        q = quaternion_from_matrix(np.asarray(value, dtype=float), "start", "attitude")
        value = tuple(q.tolist()) if q.ndim == 1 else q
    size = 3 if (shape[1] if isinstance(value, np.ndarray) and len(shape) == 2 else len(value)) == 3 else 4
    parts = vector(value, "start", "attitude", size)
    if size == 4 and rows(*parts) is not None and any(isinstance(p, Distribution) for p in parts):
        raise SceneError("start", "attitude", None, "a quaternion has distributions or arrays as components, not both")
    if size == 4 and not any(isinstance(p, Distribution) for p in parts):
        square = sum(p * p for p in parts)
        if np.min(square) < 1e-200:
            raise SceneError("start", "attitude", value if is_shared(*parts) else None, "a quaternion of norm 0 is no attitude")
    return parts


def _shape(value):
    try:
        return np.shape(value)
    except ValueError:
        return (len(value),)
