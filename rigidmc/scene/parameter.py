"""A parameter of a model: a number by its name, where it is, its units, limits and derivative.

A name is that of a map, `--set` or `wrt`, such as start.omega.2, effects.gravity.g or
body.box.size.1. If members draw that number, its derivative is by the member's own number; a
further word names a parameter of the distribution, as in start.omega.2.mean
(`rigidmc.scene.reparametrise`).
"""

import copy
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import combinations_with_replacement
from typing import Any, NamedTuple

import numpy as np

from rigidmc.physics.dynamics.dual_arrays import DualArray
from rigidmc.physics.dynamics.functions import normal_quantile
from rigidmc.scene.quantities import Drawn, Rate
from rigidmc.scene.reparametrise import own_number, rates_of
from rigidmc.scene.units import parameter_units, squared
from rigidmc.scene.vector_distributions.protocol import VectorDistribution
from rigidmc.scene.vector_distributions.vectors import Correlated, lower_factor, whole_of

_FIXED = ("axis", "covariance", "direction")  # fields of distributions that no map varies
Path = tuple[str | int, ...]  # of fields and indices, from a Model
Limits = tuple[float, float]
NO_LIMITS = -math.inf, math.inf


class Seed(NamedTuple):
    """A quantity of a model that depends on a parameter, and the derivative of its numbers."""

    path: Path
    rate: Rate


Refusal = str  # why there is no derivative, to follow "it"
Seeds = Callable[[], list[Seed] | Refusal] | Refusal


class Parameter(NamedTuple):
    """A number of a model, or a parameter of its distribution.

    unit : SI units
    path : where the model has it
    seeds : function that returns the Seeds, or the reason why there is no derivative; None if `wrt`
        does not know the name
    is_settable : whether a map may give it another number
    limits : least and largest value
    also : changes the rest of the model, given as (model, value), before the number is put
    """

    name: str
    unit: str
    path: Path
    seeds: Seeds | None
    is_settable: bool = False
    limits: Limits = NO_LIMITS
    also: Callable[[Any, Any], Any] | None = None

    @property
    def vector(self) -> str:
        """The name of the vector that contains it; "" for a scalar."""
        vector, _, last = self.name.rpartition(".")
        return vector if last.isdecimal() or isinstance(self.path[-1], int) else ""

    def get(self, model: Any) -> Any:
        """Return the value that a model has."""
        return get(model, self.path)

    def put(self, model: Any, value: Any) -> Any:
        """Return a model with another value, of which only distributions are checked."""
        return put(self.also(model, value) if self.also else model, self.path, value, CHECKED)


Parameters = dict[str, Parameter]  # by their names
CHECKED = (VectorDistribution,)


def get(part: Any, path: Sequence[str | int]) -> Any:
    """Return what a part of a model has at a path."""
    for key in path:
        part = part[key] if isinstance(key, int) else getattr(part, key)
    return part


def put(part: Any, path: Sequence[str | int], value: Any, checked: Any = ()) -> Any:
    """Return a model, a part of it or a tuple with one value replaced.

    checked : classes whose objects are checked again
    """
    if not path:
        return value
    key, *rest = path
    if isinstance(key, int):
        return (*part[:key], put(part[key], rest, value, checked), *part[key + 1 :])
    new = put(getattr(part, key), rest, value, checked)
    if hasattr(part, "_replace"):
        return part._replace(**{key: new})
    if isinstance(part, checked):
        return replace(part, **{key: new})
    changed = copy.copy(part)
    object.__setattr__(changed, key, new)
    return changed


def one_seed(path: Path, rate: Rate = own_number) -> Callable[[], list[Seed]]:
    """Return a function that returns one Seed."""
    return lambda: [Seed(path, rate)]


def of_quantity(
    name: str, path: Path, quantity: Any, unit: str, limits: Limits = NO_LIMITS
) -> Iterator[Parameter]:
    """Yield the member's own number, and each parameter of its distribution."""
    yield Parameter(name, unit, path, one_seed(path), True, limits)
    for word, rate in rates_of(quantity).items():
        seeds = rate if isinstance(rate, str) else one_seed(path, rate)
        unit_of_word = "1" if word.endswith(".weight") else unit
        yield Parameter(f"{name}.{word}", unit_of_word, (*path, word), seeds)


def of_quantities(
    name: str, path: Path, quantities: Any, unit: str, limits: Limits = NO_LIMITS
) -> Iterator[Parameter]:
    """Yield the parameters of several quantities, numbered from 1."""
    for i, quantity in enumerate(quantities):
        yield from of_quantity(f"{name}.{i + 1}", (*path, i), quantity, unit, limits)


def symmetric_parameters(
    name: str, path: Path, size: int, unit_of_element: Callable[[int, int], str]
) -> Iterator[Parameter]:
    """Yield the elements i <= j of a symmetric matrix; i.j changes j.i, too."""

    def seeds(i: int, j: int) -> Callable[[], list[Seed]]:
        return lambda: [Seed((*path, *place), own_number) for place in sorted({(i, j), (j, i)})]

    for i, j in combinations_with_replacement(range(size), 2):
        place = (*path, i, j)
        yield Parameter(f"{name}.{i + 1}.{j + 1}", unit_of_element(i, j), place, seeds(i, j))


def by_name(parameters: Iterable[Parameter]) -> Parameters:
    """Return {name: parameter}."""
    return {p.name: p for p in parameters}


def refused(
    others: Mapping[str, Parameter], names: Iterable[str], rule: Refusal, unit: str = "1"
) -> Parameters:
    """Return parameters without a derivative, for the reason `rule`.

    unit : of names that are not known, which are a body's
    """
    return {
        name: others.get(name, Parameter(name, unit, ("body", name), rule))._replace(seeds=rule)
        for name in names
    }


def of_vector(
    name: str, path: Path, value: Any, unit: str, limits: Limits = NO_LIMITS
) -> Iterator[Parameter]:
    """Yield the parameters of a vector of quantities, or of a distribution of vectors: the member's
    own components, then the parameters of the distribution."""
    if isinstance(value, VectorDistribution):
        for i in range(3):
            seeds = one_seed((*path, "sample"), _component(i))
            yield Parameter(f"{name}.{i + 1}", unit, (*path, i), seeds)
        units = parameter_units(value, unit)
        for field, part in value.as_dict().items():
            each = of_field(f"{name}.{field}", (*path, field), part, units.get(field, "1"))
            is_free = field not in _FIXED
            yield from (p._replace(is_settable=p.is_settable and is_free) for p in each)
    elif law := whole_of(value):
        for i in range(3):
            yield Parameter(f"{name}.{i + 1}", unit, (*path, i), one_seed((*path, i)))
        yield from _of_correlated(name, path, law, unit)
    else:
        yield from of_quantities(name, path, value, unit, limits)


def _component(i: int) -> Rate:
    """Return the derivatives (3, n) of drawn vectors by their own component i."""
    return lambda drawn: np.eye(3)[:, i : i + 1] + np.zeros_like(drawn.values)


def of_field(name: str, path: Path, part: Any, unit: str) -> Iterator[Parameter]:
    """Yield the parameters of a field of a distribution of vectors."""
    if isinstance(part, int):
        yield Parameter(name, unit, path, "is an integer", True)
    elif isinstance(part, tuple) and isinstance(part[0], tuple):
        yield from symmetric_parameters(name, path, len(part), lambda i, j: unit)
    elif isinstance(part, tuple):
        yield from of_quantities(name, path, part, unit)
    elif part is not None:
        yield from of_quantity(name, path, part, unit)


def _of_correlated(name: str, path: Path, law: Correlated, unit: str) -> Iterator[Parameter]:
    """Yield mean and covariance of a Correlated vector that is a parameter of an effect."""
    for i in range(3):
        yield Parameter(f"{name}.mean.{i + 1}", unit, (*path, i), one_seed((*path, i)))
    for i, j in combinations_with_replacement(range(3), 2):
        seeds = partial(_by_covariance, path, law, i, j)
        place = (*path, i, j)
        yield Parameter(f"{name}.covariance.{i + 1}.{j + 1}", squared(unit), place, seeds)


def _by_covariance(path: Path, law: Correlated, i: int, j: int) -> list[Seed]:
    """Return the Seeds of element (i, j) of a covariance."""
    unit = np.zeros((3, 3))
    unit[i, j] = unit[j, i] = 1.0
    marked: Any = [
        [DualArray(x, [by]) for x, by in zip(row, rates, strict=True)]
        for row, rates in zip(law.covariance, unit.tolist(), strict=True)
    ]
    factor: Any = lower_factor(marked)

    def rate_of(row: list[float]) -> Rate:
        def rate(drawn: Drawn) -> Any:
            assert drawn.words is not None
            return sum(by * normal_quantile(u) for by, u in zip(row, drawn.words, strict=False))

        return rate

    return [
        Seed((*path, k), rate_of([float(x.tangents[0]) for x in row]))
        for k, row in enumerate(factor)
    ]
