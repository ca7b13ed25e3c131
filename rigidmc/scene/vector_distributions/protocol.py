"""What the package asks of a distribution of vectors, the checks of parameters that they share, and
the trial of a user's own: shapes, and that no draw depends on which members are drawn with it.
"""

from collections.abc import Callable, Sequence
from dataclasses import MISSING, dataclass, fields, replace
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from rigidmc.arrays import floats, placed
from rigidmc.errors import PartError, RigidmcError, SceneError
from rigidmc.physics.dynamics.methods import implements, word_of
from rigidmc.scene.distributions import Distribution
from rigidmc.scene.quantities import Source, quantity

Array = NDArray[np.float64]
Density = Callable[[Array], Array]  # of attitudes (4, n)


class Facts(NamedTuple):
    """What a law may depend on.

    moments : principal moments (3, n) [kg m^2]
    potential : function of attitudes (4, n) that returns potential energies (n,) [J]
    bound : bounds on the size of the potential energies (n,) [J]
    attitude : attitudes (4, n) of the members
    """

    moments: Array
    potential: Callable[[Array], Array]
    bound: Array
    attitude: Any = None


@dataclass(frozen=True)
class Law:
    """A vector drawn as a whole. The fields of a law are numbers, distributions and grids.

    What its class states::

        word : its name in a scene file, by default that of the class in snake_case, as in
            omega = { cone = { axis = 2, size = 1.0, angle = 0.01 } }
        of : the keys of a scene that take it, of omega, momentum, moments and attitude
        sized : {field: power}, how a field scales with the vector; "energy" for a field in joules
        by_scipy : whether scipy computes it, whose versions may round differently
    """

    word: ClassVar[str]
    of: ClassVar[tuple[str, ...]]
    sized: ClassVar[dict[str, Any]] = {}
    by_scipy: ClassVar[bool] = False

    def __init_subclass__(cls, **more: Any) -> None:
        super().__init_subclass__(**more)
        if "word" not in vars(cls):
            cls.word = word_of(cls)

    def checked(self, at: str) -> Self:
        """The law with its parameters checked; SceneError below the path `at`.

        By default each is a number, a distribution or a grid, or several of them.
        """
        parts = {
            name: numbers(value, f"{at}.{name}", len(value))
            if isinstance(value, (list, tuple))
            else number(value, f"{at}.{name}")
            for name, value in self.as_dict().items()
        }
        return replace(self, **parts)

    def sample(
        self, source: Source, name: str, first: int, count: int, facts: Facts | None
    ) -> Array:
        """Vectors (3, count), or quaternions (4, count), of members first ... first + count - 1.

        source : what the numbers are drawn from, a seed or points
        name : of the random stream
        facts : Facts of the members; None for laws of moments and attitudes
        """
        raise NotImplementedError

    @classmethod
    def names(cls) -> tuple[str, ...]:
        """The names of the fields."""
        return tuple(field.name for field in fields(cls))

    @classmethod
    def required(cls) -> tuple[str, ...]:
        """The names of the fields that have no default."""
        return tuple(field.name for field in fields(cls) if field.default is MISSING)

    def as_dict(self) -> dict[str, Any]:
        """{field: value}."""
        return {name: getattr(self, name) for name in self.names()}


class Ensemble(Law):
    """A law of the momentum that is part of a statistical ensemble, and tells its attitudes too."""

    direction: Any = None

    def share(self, seed: int, first: int, count: int, facts: Facts) -> Density:
        """The density of attitudes, divided by its bound."""
        raise NotImplementedError


def numbers_of(law: Law) -> tuple[Any, ...]:
    """All parameters of a law, distributions and grids among them, in one flat tuple."""
    flat: list[Any] = []
    for value in law.as_dict().values():
        several = isinstance(value, (tuple, list))
        flat += list(np.ravel(np.array(value, object))) if several else [value]
    return tuple(x for x in flat if x is not None)


def number(value: Any, at: str, least: float = -np.inf) -> Any:
    """A number, a distribution or a grid whose values are at least `least`; SceneError.

    Of a distribution the 1e-9 quantile counts. A normal distribution is taken as meant.
    """
    value = quantity(value, at)
    if isinstance(value, np.ndarray):
        raise SceneError("expected a number, a distribution or a grid", at=at)
    if isinstance(value, Distribution):
        low = 0.0 if value.name == "normal" else value.least()
    else:
        low = value if isinstance(value, float) else value.low
    if low < least:
        raise SceneError(f"has to be {least:g} or more", at=at, value=low)
    return value


def numbers(values: Any, at: str, size: int) -> tuple[Any, ...]:
    """`size` numbers, distributions or grids; SceneError."""
    values = placed(values, at)
    if isinstance(values, str) or not hasattr(values, "__len__") or len(values) != size:
        raise SceneError(f"expected {size} numbers", at=at, value=values)
    return tuple(number(x, at) for x in values)


def matrix(value: Any, at: str, sizes: Sequence[int]) -> tuple[Any, ...]:
    """A symmetric matrix without negative eigenvalues, of one of these sizes, as a tuple of rows;
    SceneError."""
    wanted = " or ".join(f"{size}x{size}" for size in sizes)
    rule = f"expected a symmetric matrix of {wanted} finite numbers without negative eigenvalues"
    array = floats(value, at, rule=rule)
    if array.shape not in {(size, size) for size in sizes} or not np.isfinite(array).all():
        raise SceneError(rule, at=at, value=array.tolist())
    scale = np.sqrt(np.abs(array.diagonal()))
    scale = np.outer(scale, scale)
    if (np.abs(array - array.T) > 1e-9 * scale).any():
        raise SceneError(rule, at=at, value=array.tolist())
    # what is divided by 1 is not taken
    ones = np.where(scale > 0.0, array / np.where(scale > 0.0, scale, 1.0), 0.0)
    if np.linalg.eigvalsh(ones).min() < -1e-9 or (array[scale == 0.0] != 0.0).any():
        raise SceneError(rule, at=at, value=array.tolist())
    return tuple(map(tuple, (0.5 * (array + array.T)).tolist()))


def plain(values: Any, at: str, size: int) -> tuple[float, ...]:
    """A vector of `size` plain numbers that has a direction; SceneError."""
    vector = numbers(values, at, size)
    if not all(isinstance(x, float) for x in vector):
        raise SceneError("expected plain numbers", at=at)
    if not any(vector):
        raise SceneError("a vector of length 0 has no direction", at=at, value=list(vector))
    return vector


def concentration(value: Any, at: str) -> float:
    """The concentration kappa of a law of directions; SceneError."""
    kappa = number(value, at)
    if not isinstance(kappa, float) or not 0.0 <= kappa <= 1e12:
        shown = value if isinstance(value, (int, float)) else None
        raise SceneError("expected a number between 0 and 1e12", at=at, value=shown)
    return kappa


KEYS = ("omega", "momentum", "moments", "attitude")
TRIED, LATER = 5, 2  # members that are drawn, and the first of those that are drawn again


def check_user_law(law: Law, at: str) -> Law:
    """A user's law with its parameters checked; PartError with class, method and rule."""
    kind, key = type(law), at.rpartition(".")[2]

    def wrong(name: str, rule: str) -> PartError:
        return PartError.of(kind, rule, at, name)

    if implements(kind, "stand_in"):  # its code is not run
        return law
    if "__dataclass_fields__" not in vars(kind):
        raise wrong("", "expected a frozen dataclass: @dataclass(frozen=True) before its class")
    of = getattr(kind, "of", ())
    if not isinstance(of, tuple) or not of or not set(of) <= set(KEYS):
        raise wrong("of", f"is {of!r}, expected a tuple of some of {', '.join(KEYS)}")
    if key not in of:
        raise wrong("of", f"is a law of {' and '.join(of)}, not of {key}")
    try:
        checked = law.checked(f"{at}.{law.word}")
    except RigidmcError:
        raise
    except Exception as error:  # the user's code may raise anything
        raise wrong("checked", f"raises {type(error).__name__}: {error}") from None
    if type(checked) is not kind:
        raise wrong("checked", f"gives {type(checked).__name__}, expected {kind.__name__}")
    _check_draws(checked, key, wrong)
    return checked


def _check_draws(law: Law, key: str, wrong: Any) -> None:
    size = 4 if key == "attitude" else 3

    def draw(first: int, count: int) -> Any:
        facts = Facts(
            np.ones((3, count)), lambda q: np.zeros(q.shape[1]), np.ones(count), np.ones((4, count))
        )
        try:
            return law.sample(1, f"start.{key}", first, count, facts)
        except RigidmcError:
            raise
        except Exception as error:  # the user's code may raise anything
            raise wrong("sample", f"raises {type(error).__name__}: {error}") from None

    drawn = draw(0, TRIED)
    if not isinstance(drawn, np.ndarray) or drawn.shape != (size, TRIED):
        found = f"shape {drawn.shape}" if isinstance(drawn, np.ndarray) else type(drawn).__name__
        raise wrong("sample", f"gives {found}, expected an array ({size}, {TRIED})")
    if drawn.dtype.kind != "f" or not np.isfinite(drawn).all():
        raise wrong("sample", "gives numbers that are not finite floats")
    if size == 4 and np.abs((drawn**2).sum(0) - 1.0).max() > 1e-9:
        raise wrong("sample", "gives quaternions that are not of norm 1")
    later = draw(LATER, TRIED - LATER)
    if not np.array_equal(later, drawn[:, LATER:]) or not np.array_equal(draw(0, TRIED), drawn):
        rule = (
            "gives a member other numbers if others are drawn with it: take random numbers from"
            " sample(quantities, source, name, first, count) alone"
        )
        raise wrong("sample", rule)
