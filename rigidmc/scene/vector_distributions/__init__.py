"""Distributions of vectors. To add one, write a file with a subclass of
`protocol.VectorDistribution`, and add a line below."""

# one line for each distribution, in the order of messages
# isort: off
from rigidmc.scene.vector_distributions.vectors import Cone as Cone
from rigidmc.scene.vector_distributions.vectors import Sphere as Sphere
from rigidmc.scene.vector_distributions.bodies import SecondMoments as SecondMoments
from rigidmc.scene.vector_distributions.bodies import UncertainInertia as UncertainInertia
from rigidmc.scene.vector_distributions.tensors import TensorRows as TensorRows
from rigidmc.scene.vector_distributions.vectors import Correlated as Correlated
from rigidmc.scene.vector_distributions.ensembles import Shell as Shell
from rigidmc.scene.vector_distributions.ensembles import GibbsMomentum as GibbsMomentum
from rigidmc.scene.vector_distributions.attitudes import Fisher as Fisher
from rigidmc.scene.vector_distributions.attitudes import Pointing as Pointing
# isort: on

from collections.abc import Callable
from typing import Any

from rigidmc.errors import SceneError, unknown
from rigidmc.scene.units import parameters_in_si
from rigidmc.scene.vector_distributions.protocol import VectorDistribution, check_user_distribution

VECTOR_DISTRIBUTIONS: list[type[VectorDistribution]] = [
    kind
    for kind in list(globals().values())
    if isinstance(kind, type)
    and issubclass(kind, VectorDistribution)
    and kind is not VectorDistribution  # the lines above
]


def distributions_of(at: str) -> dict[str, type[VectorDistribution]]:
    """Return {name: distribution} for a key of a scene, such as "omega" or "start.omega"."""
    if at.startswith("effects."):  # a parameter that is a vector
        return {Correlated.name: Correlated}
    key = at.rpartition(".")[2]
    return {kind.name: kind for kind in VECTOR_DISTRIBUTIONS if key in kind.variables}


def check_distribution(distribution: VectorDistribution, at: str) -> VectorDistribution:
    """Return a distribution with checked parameters; SceneError."""
    kinds, distribution = distributions_of(at), parameters_in_si(distribution, at)
    if type(distribution) not in VECTOR_DISTRIBUTIONS:
        return check_user_distribution(distribution, at)
    if type(distribution) not in kinds.values():
        rule = f"expected one of {', '.join(kinds)}, or three components"
        raise SceneError(rule, at=at, value=distribution)
    return distribution.check(f"{at}.{distribution.name}")


def make_distribution(
    word: str,
    table: Any,
    at: str,
    parse: Callable[[Any], Any],
    own: type[VectorDistribution] | None = None,
) -> VectorDistribution | None:
    """Make the distribution of a table in a scene file; None if the key `at` has no distribution
    with the name `word`.

    parse : function that converts a value of the file to a quantity
    own : the class of a custom distribution
    """
    kind = own or distributions_of(at).get(word)
    if kind is None:
        return None
    at, fields = f"{at}.{word}", kind.names()
    is_alone = not isinstance(table, dict) or (table and not set(table) & set(fields))
    if is_alone and len(fields) == 1:  # { sphere = 2.0 } instead of { sphere = { size = 2.0 } }
        table = {fields[0]: table}
    if not isinstance(table, dict):
        rule = f"expected a table with the keys {', '.join(fields)}"
        raise SceneError(rule, at=at, value=table)
    for name in table:
        if name not in fields:
            raise unknown("key", fields, at=at, key=name)
    for name in kind.required():
        if name not in table:
            raise SceneError("is missing", at=f"{at}.{name}")
    return kind(**{name: parse(value) for name, value in table.items()})
