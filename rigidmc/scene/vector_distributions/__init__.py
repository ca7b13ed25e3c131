"""Vectors drawn as a whole. A new law is one file with a subclass of `protocol.Law`, and one line
below."""

# One line for each law, in the order in which messages name them.
# isort: off
from rigidmc.scene.vector_distributions.vectors import Cone as Cone
from rigidmc.scene.vector_distributions.vectors import Sphere as Sphere
from rigidmc.scene.vector_distributions.bodies import SecondMoments as SecondMoments
from rigidmc.scene.vector_distributions.bodies import UncertainInertia as UncertainInertia
from rigidmc.scene.vector_distributions.vectors import Correlated as Correlated
from rigidmc.scene.vector_distributions.ensembles import Shell as Shell
from rigidmc.scene.vector_distributions.ensembles import GibbsMomentum as GibbsMomentum
from rigidmc.scene.vector_distributions.attitudes import Fisher as Fisher
from rigidmc.scene.vector_distributions.attitudes import Pointing as Pointing
# isort: on

from collections.abc import Callable
from typing import Any

from rigidmc.errors import SceneError, unknown
from rigidmc.scene.vector_distributions.protocol import Law, check_user_law

LAWS: list[type[Law]] = [
    kind
    for kind in list(globals().values())
    if isinstance(kind, type) and issubclass(kind, Law) and kind is not Law  # the lines above
]


def laws_of(at: str) -> dict[str, type[Law]]:
    """{word: law} of the laws that a key of a scene takes, such as "omega" or "start.omega"."""
    key = at.rpartition(".")[2]
    return {kind.word: kind for kind in LAWS if key in kind.of}


def checked(law: Law, at: str) -> Law:
    """A law with its parameters checked; SceneError."""
    kinds = laws_of(at)
    if type(law) not in LAWS:
        return check_user_law(law, at)
    if type(law) not in kinds.values():
        rule = f"expected one of {', '.join(kinds)}, or three components"
        raise SceneError(rule, at=at, value=law)
    return law.checked(f"{at}.{law.word}")


def law_of_table(
    word: str, table: Any, at: str, parse: Callable[[Any], Any], own: type[Law] | None = None
) -> Law | None:
    """The law of a table in a scene file; None if the word names no law of the key `at`.

    parse : function that turns a value of the file into a quantity
    own : the class, if it is one of the user's own
    """
    kind = own or laws_of(at).get(word)
    if kind is None:
        return None
    at, fields = f"{at}.{word}", kind.names()
    whole = not isinstance(table, dict) or (table and not set(table) & set(fields))
    if whole and len(fields) == 1:  # { sphere = 2.0 } instead of { sphere = { size = 2.0 } }
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
