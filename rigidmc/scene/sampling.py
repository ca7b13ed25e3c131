"""What members are a sample of: what a scene draws, and what goes by the index of a member."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from rigidmc.effects import EFFECTS, labelled
from rigidmc.effects.protocol import is_random
from rigidmc.errors import SceneError
from rigidmc.scene.distributions import Distribution
from rigidmc.scene.laws.protocol import Law, numbers_of
from rigidmc.scene.parts import Parts
from rigidmc.scene.quantities import Grid


def is_drawn(scene: Parts) -> bool:
    """Whether body, effects or start draw a number of each member."""
    words = isinstance(scene.start.attitude, str)  # "uniform" or "ensemble"
    return words or any(isinstance(q, (Distribution, Law)) for q in scene.quantities())


def is_sample(scene: Parts) -> bool:
    """Whether members are a sample, whose spread tells how well a mean of them is known.

    They are if something is drawn or an effect is random, and if they are the rows of a table,
    which are taken for a sample of what they were drawn from. The members of a pure grid, and
    copies of one member, are all that there is: a mean of them has no interval.
    """
    tables = any(isinstance(q, np.ndarray) for q in scene.quantities())
    return tables or is_drawn(scene) or any(map(is_random, scene.effects))


def is_sample_of(tables: Mapping[str, Any]) -> bool:
    """As `is_sample`, by the tables of the TOML text that a result carries: without its rows, and
    without the code of own parts, whose effects may be random."""
    effects = tables.get("effects", {})
    parts = [(name, one) for name, some in effects.items() for one in _several(some)]
    noisy = any(name not in EFFECTS or is_random(EFFECTS[name]) for name, _ in parts)
    body = {key: value for key, value in tables["body"].items() if key != "shape"}
    values = [*body.values(), *tables.get("start", {}).values()]
    values += [value for _, one in parts for value in one.values()]
    words = isinstance(tables.get("start", {}).get("attitude"), str)
    return noisy or words or any(map(_differs, values))


def _several(tables: Any) -> list[Any]:
    return tables if isinstance(tables, list) else [tables]


def _differs(value: Any) -> bool:
    """Whether a value of a scene file has a distribution, a law or a table in it."""
    if isinstance(value, list):
        return any(map(_differs, value))
    return isinstance(value, dict) and "grid" not in value


def is_indexed(scene: Parts) -> bool:
    """Whether some numbers belong to the index of a member: those of grids and tables."""
    return any(isinstance(q, (Grid, np.ndarray)) for q in scene.quantities())


def refuse_indexed(scene: Parts, study: str, tables: bool = True) -> None:
    """Raise SceneError for grids and tables, whose numbers belong to the index of a member.

    A study that moves, copies or pairs members would give one of them the numbers of another.

    study : what it does with members, such as "families of members differ by what is drawn"
    tables : False if these may stay
    """
    for table, key, value in _named(scene):
        if isinstance(value, Grid) or (tables and isinstance(value, np.ndarray)):
            kind = "a grid" if isinstance(value, Grid) else "a table with one row per member"
            rule = (
                f"is {kind}: {study}; give distributions in place of grids and tables, or ask for"
                " each row by itself"
            )
            raise SceneError(table, key, None, rule)


def _named(scene: Parts) -> Iterator[tuple[str, str, Any]]:
    """(table, key, quantity) of all quantities of a scene."""
    body, start = scene.body, scene.start
    given: list[tuple[str, str, Any]] = [
        ("body", body.given, body.moments), ("body", "mass", body.mass),
        ("body", "centre", body.centre), ("start", start.which, getattr(start, start.which)),
        ("start", "attitude", start.attitude),
    ]  # fmt: skip
    for label, effect in labelled(scene.effects):
        given += [
            (f"effects.{label}", key, value)
            for key, value in zip(effect._fields, effect, strict=True)
        ]
    for table, key, value in given:
        parts = numbers_of(value) if isinstance(value, Law) else value
        yield from ((table, key, one) for one in (parts if type(parts) is tuple else (parts,)))
