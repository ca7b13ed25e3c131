"""Interface of vector distributions, common checks of their parameters, and the trial of custom
distributions: shapes, and that no draw depends on the members drawn with it.
"""

from collections.abc import Callable, Sequence
from dataclasses import MISSING, dataclass, fields, replace
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np

from rigidmc.errors import PartError, RigidmcError, SceneError
from rigidmc.inputs.arrays import Array, as_plain_arrays, floats
from rigidmc.inputs.labelled import Wanted
from rigidmc.physics.dynamics.methods import implements, word_of
from rigidmc.scene.distributions import Distribution
from rigidmc.scene.quantities import Source, quantity

Density = Callable[[Array], Array]  # of attitudes (4, n)


class MemberFacts(NamedTuple):
    """Facts about members on which a distribution may depend.

    moments : principal moments (3, n) [kg m^2]
    potential : function of attitudes (4, n) that returns potential energies (n,) [J]
    bound : bounds on the size of the potential energies (n,) [J]
    attitude : attitudes (4, n) of the members
    turn : the principal axes (3, 3, n) in the axes of the scene; None if these are the same
    """

    moments: Array
    potential: Callable[[Array], Array]
    bound: Array
    attitude: Any = None
    turn: Array | None = None


@dataclass(frozen=True)
class VectorDistribution:
    """A distribution of a vector. Its fields are numbers, distributions and grids.

    Class attributes::

        name : name in a scene file, by default the class name in snake_case, as in
            omega = { cone = { axis = 2, size = 1.0, angle = 0.01 } }
        variables : keys of a scene that accept it, from omega, momentum, moments and attitude
        scaling : {field: power}, how a field scales with the vector; "energy" for a field in joules
        units : {field: SI units} of fields whose units do not follow from `scaling`
        uses_scipy : whether it uses scipy, whose versions may round differently
    """

    name: ClassVar[str]
    variables: ClassVar[tuple[str, ...]]
    scaling: ClassVar[dict[str, Any]] = {}
    units: ClassVar[dict[str, str]] = {}
    uses_scipy: ClassVar[bool] = False

    def __init_subclass__(cls, **more: Any) -> None:
        super().__init_subclass__(**more)
        if "name" not in vars(cls):
            cls.name = word_of(cls)

    def check(self, at: str) -> Self:
        """Return the distribution with checked parameters; SceneError below the path `at`.

        By default each parameter is a number, a distribution or a grid, or several of them.
        """
        parts = {
            name: numbers(value, f"{at}.{name}", len(value))
            if isinstance(value, (list, tuple))
            else number(value, f"{at}.{name}")
            for name, value in self.as_dict().items()
        }
        return replace(self, **parts)

    def sample(
        self, sampler: Source, name: str, first: int, count: int, facts: MemberFacts | None
    ) -> Array:
        """Draw vectors (3, count) or quaternions (4, count), members first ... first + count - 1.

        sampler : source of numbers, a seed or points
        name : name of the random stream
        facts : MemberFacts of the members; None for distributions of moments and attitudes
        """
        raise NotImplementedError

    def log_density(self, x: Array, moments: Array) -> Array:
        """Return the logarithms of the density (n,) at vectors (3, n), or at attitudes (4, n)
        relative to uniform ones; optional, for `reweight`.

        moments : principal moments (3, n) of the members
        """
        raise NotImplementedError

    @classmethod
    def names(cls) -> tuple[str, ...]:
        """Return the names of the fields."""
        return tuple(field.name for field in fields(cls))

    @classmethod
    def required(cls) -> tuple[str, ...]:
        """Return the names of the fields without a default."""
        return tuple(field.name for field in fields(cls) if field.default is MISSING)

    def as_dict(self) -> dict[str, Any]:
        """Return {field: value}."""
        return {name: getattr(self, name) for name in self.names()}


class EquilibriumEnsemble(VectorDistribution):
    """A distribution of the momentum that is part of a statistical ensemble, and also determines
    the attitudes."""

    direction: Any = None

    def acceptance(self, seed: int, first: int, count: int, facts: MemberFacts) -> Density:
        """Return the density of attitudes, divided by its bound."""
        raise NotImplementedError


def flat_parameters(distribution: VectorDistribution) -> tuple[Any, ...]:
    """Return all parameters of a distribution, including distributions and grids, as a flat
    tuple."""
    flat: list[Any] = []
    for value in distribution.as_dict().values():
        several = isinstance(value, (tuple, list))
        if several and not any(isinstance(x, np.ndarray) for x in value):
            flat += list(np.ravel(np.array(value, object)))
        else:
            flat += value if several else [value]
    return tuple(x for x in flat if x is not None)


def number(value: Any, at: str, least: float = -np.inf) -> Any:
    """Check a number, a distribution or a grid with values of at least `least`; SceneError.

    The smallest value of a distribution is its 1e-9 quantile; for a normal distribution it counts
    as 0.
    """
    value = quantity(value, at)
    if isinstance(value, np.ndarray):
        raise SceneError("expected a number, a distribution or a grid", at=at)
    if isinstance(value, Distribution):
        low = 0.0 if value.name == "normal" else value.least()
    else:
        low = value if isinstance(value, float) else value.low
    if low < least:
        raise SceneError(f"must be {least:g} or more", at=at, value=low)
    return value


def numbers(values: Any, at: str, size: int) -> tuple[Any, ...]:
    """Check `size` numbers, distributions or grids; SceneError."""
    values = as_plain_arrays(values, at, wanted=Wanted((size,)))
    if isinstance(values, str) or not hasattr(values, "__len__") or len(values) != size:
        raise SceneError(f"expected {size} numbers", at=at, value=values)
    return tuple(number(x, at) for x in values)


def check_semidefinite(value: Any, at: str, sizes: Sequence[int]) -> tuple[Any, ...]:
    """Return a symmetric matrix without negative eigenvalues, with one of these sizes, as a tuple
    of rows; SceneError."""
    wanted = " or ".join(f"{size}x{size}" for size in sizes)
    rule = f"expected a symmetric matrix of {wanted} finite numbers without negative eigenvalues"
    array = floats(value, at, rule=rule, wanted=Wanted(tuple(sizes), is_matrix=True))
    if array.shape not in {(size, size) for size in sizes} or not np.isfinite(array).all():
        raise SceneError(rule, at=at, value=array.tolist())
    scale = np.sqrt(np.abs(array.diagonal()))
    scale = np.outer(scale, scale)
    if (np.abs(array - array.T) > 1e-9 * scale).any():
        raise SceneError(rule, at=at, value=array.tolist())
    # where a variance is 0 the quotient is unused; the divisor 1 keeps it finite
    ones = np.where(scale > 0.0, array / np.where(scale > 0.0, scale, 1.0), 0.0)
    if np.linalg.eigvalsh(ones).min() < -1e-9 or (array[scale == 0.0] != 0.0).any():
        raise SceneError(rule, at=at, value=array.tolist())
    return tuple(map(tuple, (0.5 * (array + array.T)).tolist()))


def fixed_vector(values: Any, at: str, size: int) -> tuple[float, ...]:
    """Return a nonzero vector of `size` plain numbers; SceneError."""
    vector = numbers(values, at, size)
    if not all(isinstance(x, float) for x in vector):
        raise SceneError("expected plain numbers", at=at)
    if not any(vector):
        raise SceneError("a vector of length 0 has no direction", at=at, value=list(vector))
    return vector


def concentration(value: Any, at: str) -> float:
    """Return the concentration kappa of a distribution of directions; SceneError."""
    kappa = number(value, at)
    if not isinstance(kappa, float) or not 0.0 <= kappa <= 1e12:
        shown = value if isinstance(value, (int, float)) else None
        raise SceneError("expected a number between 0 and 1e12", at=at, value=shown)
    return kappa


KEYS = ("omega", "momentum", "moments", "attitude")
OLD_WORDS = {  # {earlier name: current name} of properties and methods, until 1.0
    "by_scipy": "uses_scipy",
    "checked": "check",
    "of": "variables",
    "share": "acceptance",
    "sized": "scaling",
    "word": "name",
}
TRIED, LATER = 5, 2  # number of members drawn, and the first one drawn a second time


def check_user_distribution(distribution: VectorDistribution, at: str) -> VectorDistribution:
    """Return a custom distribution with checked parameters; PartError with class, method and
    rule."""
    kind, key = type(distribution), at.rpartition(".")[2]

    def wrong(name: str, rule: str) -> PartError:
        return PartError.of(kind, rule, at, name)

    if implements(kind, "stand_in"):  # its code is not run
        return distribution
    if "__dataclass_fields__" not in vars(kind):
        raise wrong("", "expected a frozen dataclass: @dataclass(frozen=True) before its class")
    of_user = {name for base in kind.__mro__ if base.__module__ != __name__ for name in vars(base)}
    for old in (of_user - {*kind.names()}) & OLD_WORDS.keys():
        raise wrong(old, f"is now called {OLD_WORDS[old]}")
    of = getattr(kind, "variables", ())
    if not isinstance(of, tuple) or not of or not set(of) <= set(KEYS):
        raise wrong("variables", f"is {of!r}, expected a tuple of some of {', '.join(KEYS)}")
    if key not in of:
        raise wrong("variables", f"is a distribution of {' and '.join(of)}, not of {key}")
    try:
        checked = distribution.check(f"{at}.{distribution.name}")
    except RigidmcError:
        raise
    except Exception as error:  # the user's code may raise anything
        raise wrong("check", f"raises {type(error).__name__}: {error}") from None
    if type(checked) is not kind:
        raise wrong("check", f"returns {type(checked).__name__}, expected {kind.__name__}")
    _check_draws(checked, key, wrong)
    return checked


def _check_draws(distribution: VectorDistribution, key: str, wrong: Any) -> None:
    size = 4 if key == "attitude" else 3

    def draw(first: int, count: int) -> Any:
        facts = MemberFacts(
            np.ones((3, count)), lambda q: np.zeros(q.shape[1]), np.ones(count), np.ones((4, count))
        )
        try:
            return distribution.sample(1, f"start.{key}", first, count, facts)
        except RigidmcError:
            raise
        except Exception as error:  # the user's code may raise anything
            raise wrong("sample", f"raises {type(error).__name__}: {error}") from None

    drawn = draw(0, TRIED)
    if not isinstance(drawn, np.ndarray) or drawn.shape != (size, TRIED):
        what = f"shape {drawn.shape}" if isinstance(drawn, np.ndarray) else type(drawn).__name__
        raise wrong("sample", f"returns {what}, expected an array ({size}, {TRIED})")
    if drawn.dtype.kind != "f" or not np.isfinite(drawn).all():
        raise wrong("sample", "returns numbers that are not finite floats")
    if size == 4 and np.abs((drawn**2).sum(0) - 1.0).max() > 1e-9:
        raise wrong("sample", "returns quaternions whose norm is not 1")
    later = draw(LATER, TRIED - LATER)
    if not np.array_equal(later, drawn[:, LATER:]) or not np.array_equal(draw(0, TRIED), drawn):
        rule = (
            "returns other numbers for a member if other members are drawn with it: draw random"
            " numbers only with sample(quantities, source, name, first, count)"
        )
        raise wrong("sample", rule)
