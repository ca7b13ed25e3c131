"""Vectors drawn as a whole: cones, spheres, correlated normals, energy shells, the Gibbs ensemble, bodies by their second moments.

Each is a NamedTuple of numbers, distributions and grids, drawn as a function of (seed, name, member) alone. `omega` and `momentum` take cone, sphere
and correlated, `momentum` shell and gibbs, `moments` second_moments and correlated, `attitude` fisher and pointing. In scene files: omega = { cone = { axis = 2, size = 1.0, angle = 0.01 } }.
"""

import math
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from rigidmc.dynamics.functions import (
    arcsine,
    cosine,
    exponential_of,
    hyperbolic_sine,
    hypotenuse,
    logarithm_of,
    logarithm_of_one_and,
    sine,
)
from rigidmc.dynamics.so3 import arctan2, expm1, sincos
from rigidmc.engine.streams import uniforms
from rigidmc.errors import SceneError, unknown
from rigidmc.mechanics.rotation import product, quaternion, quaternion_from_euler
from rigidmc.scene.quantities import Distribution, draw, quantity, uniform


class Facts(NamedTuple):
    """What a vector may depend on: moments (3, n), potential energy of attitudes (4, n) -> (n,), a bound on its size (n,), attitudes (4, n)."""

    moments: np.ndarray
    potential: Any
    bound: np.ndarray
    attitude: Any = None


TRIES = 4096  # attitudes that a member is offered by `kept`: of those that keep one in a hundred none in 1e17 is left without


def turns(u, v, w):
    """Unit quaternions (4, n), uniform on SO(3), from numbers uniform in (0, 1).

    Source: Shoemake, Graphics Gems III (1992) 124.
    """
    a, b = np.sqrt(1.0 - u), np.sqrt(u)
    (sine_v, cosine_v), (sine_w, cosine_w) = sincos(2.0 * np.pi * v), sincos(2.0 * np.pi * w)
    return np.stack([b * cosine_w, a * sine_v, a * cosine_v, b * sine_w])


def kept(share, seed, first, count):
    """Unit quaternions (4, count) of density proportional to share(q), at most 1, by rejection: the first of a member's own uniform ones that is
    kept; nan where none of TRIES is."""
    if hasattr(seed, "words"):
        raise SceneError(
            "run",
            "points",
            None,
            "attitudes of an ensemble are drawn by rejection, which takes independent points",
        )
    q, left = np.full((4, count), np.nan), np.ones(count, bool)
    for i in range(TRIES):
        u, v, w, x = uniforms(seed, "start.attitude.ensemble", first, count, i)
        tried = turns(u, v, w)
        taken = left & (x < share(tried))
        q[:, taken] = tried[:, taken]
        left &= ~taken
        if not left.any():
            break
    return q


def directions(draws, name, first, count):
    """Unit vectors (3, n), uniform on the sphere: cosine of the polar angle and azimuth are."""
    z, phi = draw(
        (uniform(-1.0, 1.0), uniform(0.0, 2.0 * math.pi)), draws, f"{name}.direction", first, count
    )
    r, (y, x) = np.sqrt((1.0 - z) * (1.0 + z)), sincos(phi)
    return np.stack([r * x, r * y, z])


class Cone(NamedTuple):
    """A vector of some size that makes an angle with a principal axis.

    axis : 1, 2, 3, or -1, -2, -3 for the other end;  size, angle [rad] : quantities;  azimuth : about the axis, from the next one on [rad]
    """

    axis: int
    size: Any
    angle: Any
    azimuth: Any = Distribution("uniform", (0.0, 2.0 * math.pi))
    sized = {"size": 1}

    def sample(self, draws, name, first, count, facts):
        size, angle, azimuth = draw(
            (self.size, self.angle, self.azimuth), draws, f"{name}.cone", first, count
        )
        i = abs(self.axis) - 1
        v = np.empty((3, count))
        v[i] = math.copysign(1.0, self.axis) * size * cosine(angle)
        v[(i + 1) % 3], v[(i + 2) % 3] = (
            size * sine(angle) * cosine(azimuth),
            size * sine(angle) * sine(azimuth),
        )
        return v


class Sphere(NamedTuple):
    """A vector of some size in any direction: of `momentum`, the momentum sphere |L| = size."""

    size: Any
    sized = {"size": 1}

    def sample(self, draws, name, first, count, facts):
        return draw((self.size,), draws, f"{name}.size", first, count) * directions(
            draws, name, first, count
        )


class Correlated(NamedTuple):
    """A normal vector of mean (3) and covariance (3, 3): mean + C^1/2 z, C^1/2 the lower Cholesky factor.

    For moments: measured inertia. A member whose moments no body can have is flagged (invalid_input), a note counts them.
    """

    mean: tuple
    covariance: tuple
    sized = {"mean": 1, "covariance": 2}

    def sample(self, draws, name, first, count, facts):
        z = draw((Distribution("normal", (0.0, 1.0)),) * 3, draws, f"{name}.normal", first, count)
        root = lower_factor(self.covariance)
        return np.stack(
            [self.mean[i] + sum(root[i][j] * z[j] for j in range(i + 1)) for i in range(3)]
        )


def lower_factor(c):
    """The lower Cholesky factor of a symmetric matrix of 3x3, as rows."""
    a = math.sqrt(c[0][0])
    b, d = c[1][0] / a, c[2][0] / a
    e = math.sqrt(c[1][1] - b * b)
    f = (c[2][1] - d * b) / e
    return (a,), (b, e), (d, f, math.sqrt(c[2][2] - d * d - f * f))


class Shell(NamedTuple):
    """The angular momentum of a given energy E = 1/2 L . I^-1 L + V(q) [J]; where V(q) is more than E there is none, and the member is invalid.

    direction : of L in the body; without one it is uniform on the shell (microcanonical: L = sqrt(2 (E - V) I) n, n uniform on the sphere)
    """

    energy: Any
    direction: tuple | None = None
    sized = {"energy": "energy"}

    def share(self, seed, first, count, facts):
        """Of attitudes, to which momenta leave sqrt(E - V(q)) of the shell: q -> that, of its bound."""
        (energy,) = draw((self.energy,), seed, "start.momentum.energy", first, count)
        with np.errstate(all="ignore"):
            most = np.where(energy + facts.bound > 0.0, energy + facts.bound, np.nan)
        none = facts.bound == 0.0
        return lambda q: np.where(
            none, 1.0, np.sqrt(np.clip((energy - facts.potential(q)) / most, 0.0, 1.0))
        )

    def sample(self, draws, name, first, count, facts):
        (energy,) = draw((self.energy,), draws, f"{name}.energy", first, count)
        twice = 2.0 * (energy - facts.potential(facts.attitude))
        if self.direction is None:
            v = np.sqrt(facts.moments) * directions(draws, name, first, count)
        else:
            v = np.broadcast_to(np.array(self.direction, float)[:, None], (3, count))
            v = v / np.sqrt((v * v / facts.moments).sum(0))
        with np.errstate(invalid="ignore"):
            return np.sqrt(twice) * v  # nan where there is none


class GibbsMomentum(NamedTuple):
    """The angular momentum of thermal equilibrium, exp(-T/kT): L_i normal with variance I_i kT. kT : [J]"""

    kT: Any
    sized = {"kT": "energy"}

    def share(self, seed, first, count, facts):
        """Of attitudes: q -> exp(-V(q)/kT), of its bound."""
        (heat,) = draw((self.kT,), seed, "start.momentum.kT", first, count)
        return lambda q: exponential_of(-(facts.potential(q) + facts.bound) / heat)

    def sample(self, draws, name, first, count, facts):
        (heat,) = draw((self.kT,), draws, f"{name}.kT", first, count)
        heat = np.where(heat >= 0.0, heat, np.nan)
        z = draw((Distribution("normal", (0.0, 1.0)),) * 3, draws, f"{name}.normal", first, count)
        return np.sqrt(facts.moments * heat) * z


class SecondMoments(NamedTuple):
    """Principal moments from the second moments of mass (a, b, c) [kg m^2], I1 = b + c, I2 = c + a, I3 = a + b: whatever positive numbers these are,
    the body exists, TdC (3.15)."""

    values: tuple
    sized = {"values": 1}

    def sample(self, draws, name, first, count, facts):
        a, b, c = draw(self.values, draws, f"{name}.second", first, count)
        return np.stack([b + c, c + a, a + b])


class Fisher(NamedTuple):
    """Attitudes about a mean one, density proportional to exp(kappa tr(M^T R)) = exp(kappa (1 + 2 cos angle)), Fisher's law of matrices: for large
    kappa each of the three small angles is normal with variance 1/(2 kappa).

    attitude : the mean, a quaternion (w, x, y, z);  kappa : concentration, 0 (uniform) or more
    Source: Mardia & Jupp, Directional Statistics, 13.2.3.
    """

    attitude: tuple
    kappa: float
    by_scipy = True  # its distribution function is integrated by scipy

    def sample(self, draws, name, first, count, facts):
        u = draw((Distribution("uniform", (0.0, 1.0)),), draws, f"{name}.angle", first, count)[0]
        half = 0.5 * np.interp(u, *_turns(self.kappa))
        axis = directions(draws, name, first, count)
        turn = np.stack([cosine(half), *(sine(half) * axis)], axis=-1)
        return product(quaternion(self.attitude), turn).T


class Pointing(NamedTuple):
    """Attitudes whose axis 3 is about a direction of space, density proportional to exp(kappa cos angle), von Mises and Fisher's law, and which are turned
    about axis 3 by any angle.

    direction : (x, y, z) in space;  kappa : concentration, 0 (uniform) or more
    Source: Mardia & Jupp, Directional Statistics, 9.3.2: the distribution function of the cosine c is (e^(kappa c) - e^-kappa)/(e^kappa - e^-kappa).
    """

    direction: tuple
    kappa: float

    def sample(self, draws, name, first, count, facts):
        whole = Distribution("uniform", (0.0, 2.0 * math.pi))
        u, azimuth, psi = draw(
            (Distribution("uniform", (0.0, 1.0)), whole, whole),
            draws,
            f"{name}.pointing",
            first,
            count,
        )
        k = self.kappa
        less = (
            -logarithm_of_one_and((1.0 - u) * expm1(-2.0 * k)) / k if k > 0.0 else 2.0 * (1.0 - u)
        )  # 1 - cosine
        theta = 2.0 * arcsine(np.sqrt(np.clip(0.5 * less, 0.0, 1.0)))
        x, y, z = self.direction
        tip = quaternion_from_euler(arctan2(x, -y), arctan2(hypotenuse(x, y), z), 0.0)
        return product(tip, quaternion_from_euler(azimuth, theta, psi).T).T


@lru_cache(maxsize=64)
def _turns(kappa):
    """(distribution function, angle) of the turn of Fisher's law at 20,001 angles, dense where it is: density (1 - cos) exp(2 kappa cos)."""
    from scipy.integrate import cumulative_simpson

    width = min(1.0, 1.0 / math.sqrt(2.0 * kappa + 1.0))
    s = np.linspace(0.0, 1.0, 20_001)
    angle = (
        np.pi
        * hyperbolic_sine(s * logarithm_of(1.0 / width + math.sqrt(1.0 / (width * width) + 1.0)))
        * width
    )
    density = (1.0 - cosine(angle)) * exponential_of(2.0 * kappa * (cosine(angle) - 1.0))
    total = cumulative_simpson(density, x=angle, initial=0.0)
    return total / total[-1], angle


ATTITUDES: dict[str, Any] = {"fisher": Fisher, "pointing": Pointing}
VECTORS: dict[str, dict[str, Any]] = {
    "omega": {"cone": Cone, "sphere": Sphere, "correlated": Correlated},
    "momentum": {
        "cone": Cone,
        "sphere": Sphere,
        "correlated": Correlated,
        "shell": Shell,
        "gibbs": GibbsMomentum,
    },
    "moments": {"second_moments": SecondMoments, "correlated": Correlated},
    "attitude": ATTITUDES,
}


def word_of(one):
    """The word for a vector in a scene file."""
    return next(
        word for kinds in VECTORS.values() for word, kind in kinds.items() if type(one) is kind
    )


def numbers_of(one):
    """The numbers of a vector, distributions and grids among them, in one flat tuple."""
    found: list[Any] = []
    for value in one:
        found += (
            [x for x in np.ravel(np.array(value, object))]
            if isinstance(value, (tuple, list))
            else [value]
        )
    return tuple(x for x in found if x is not None)


def checked(one, table, key):
    """A vector with its numbers checked; SceneError."""
    kinds = VECTORS[key]
    if type(one) not in kinds.values():
        raise SceneError(
            table, key, one, f"expected one of {', '.join(kinds)}, or three components"
        )
    where, fields = f"{table}.{key}.{word_of(one)}", dict[str, Any]()
    for name, value in one._asdict().items():
        if name == "axis":
            if isinstance(value, bool) or value not in (1, 2, 3, -1, -2, -3):
                raise SceneError(
                    where,
                    name,
                    value,
                    "expected 1, 2 or 3, or -1, -2, -3 for the other end of the axis",
                )
            fields[name] = int(value)
        elif name == "covariance":
            fields[name] = _covariance(value, where)
        elif name in ("mean", "direction", "values", "attitude"):
            size = 4 if name == "attitude" else 3
            if value is not None and (
                isinstance(value, str) or not hasattr(value, "__len__") or len(value) != size
            ):
                raise SceneError(where, name, value, f"expected {size} numbers")
            fields[name] = None if value is None else tuple(_scalar(x, where, name) for x in value)
        else:
            fields[name] = _scalar(value, where, name)
    for name in ("direction", "attitude"):
        if (
            name in fields
            and fields[name] is not None
            and not all(isinstance(x, float) for x in fields[name])
        ):
            raise SceneError(where, name, None, "expected plain numbers")
        if fields.get(name) is not None and not any(fields[name]):
            raise SceneError(
                where, name, list(fields[name]), "a vector of length 0 has no direction"
            )
    if "kappa" in fields and not (
        isinstance(fields["kappa"], float) and 0.0 <= fields["kappa"] <= 1e12
    ):
        raise SceneError(
            where,
            "kappa",
            one.kappa if isinstance(one.kappa, (int, float)) else None,
            "expected a number between 0 and 1e12",
        )
    for name, least in (("kT", 0.0), ("size", 0.0)):
        low = _lowest(fields.get(name, least))
        if low < least:
            raise SceneError(where, name, low, f"has to be {least:g} or more")
    return type(one)(**fields)


def _lowest(value):
    """The smallest number that a quantity takes, of distributions the 1e-9 quantile."""
    if isinstance(value, Distribution):
        return (
            0.0 if value.name == "normal" else float(value.ppf(np.array([1e-9]))[0])
        )  # a normal law is taken as meant
    return value.low if hasattr(value, "low") else value


def _scalar(value, where, name):
    if isinstance(value, np.ndarray):
        raise SceneError(where, name, None, "expected a number, a distribution or a grid")
    return quantity(value, where, name)


def _covariance(value, where):
    try:
        found = np.asarray(value, float)
    except (TypeError, ValueError):
        raise SceneError(
            where, "covariance", value, "expected a symmetric matrix of 3x3 finite numbers"
        ) from None
    even = (
        found.shape == (3, 3)
        and np.isfinite(found).all()
        and np.abs(found - found.T).max() <= 1e-9 * np.abs(found).max()
    )
    if not even:
        raise SceneError(
            where,
            "covariance",
            np.asarray(value).tolist(),
            "expected a symmetric matrix of 3x3 finite numbers",
        )
    if np.linalg.eigvalsh(found).min() <= 0.0:
        raise SceneError(
            where,
            "covariance",
            found.tolist(),
            "expected a positive definite matrix: no variance is 0 or below",
        )
    return tuple(map(tuple, found.tolist()))


def of_table(word, table, key, parsed):
    """A vector from its table in a scene file; None where the word is that of none."""
    kinds = VECTORS.get(key, {})
    if word not in kinds:
        return None
    where = f"{key}.{word}"
    if not isinstance(table, dict) or (
        len(kinds[word]._fields) == 1 and table and not set(table) & set(kinds[word]._fields)
    ):
        if len(kinds[word]._fields) > 1:
            raise SceneError(
                "", where, table, f"expected a table with the keys {', '.join(kinds[word]._fields)}"
            )
        table = {kinds[word]._fields[0]: table}
    for name in table:
        if name not in kinds[word]._fields:
            raise unknown(where, name, None, "key", kinds[word]._fields)
    if missing := [
        f for f in kinds[word]._fields if f not in table and f not in kinds[word]._field_defaults
    ]:
        raise SceneError(where, missing[0], None, "is missing")
    return kinds[word](**{name: parsed(value) for name, value in table.items()})
