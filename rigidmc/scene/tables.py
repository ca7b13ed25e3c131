"""The tables of a scene file as the parts of a scene: body, effects, observables, start."""

import inspect
from collections import namedtuple
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any

from rigidmc.effects import EFFECTS
from rigidmc.effects.parameters import given
from rigidmc.effects.protocol import Effect
from rigidmc.errors import SceneError, unknown
from rigidmc.files.code import class_of
from rigidmc.mechanics.solids import SOLIDS
from rigidmc.observables import WATCHED
from rigidmc.scene.body import Body
from rigidmc.scene.shape import shape_of
from rigidmc.scene.start import Start
from rigidmc.scene.values import Columns, numbers, only, parse

# tables of effects, and of observables: one kernel is compiled for all of them, 100 springs take
# a minute
MOST = 100

# ways to give a body by plain numbers: {key: (keys of its own table, maker)}
SHAPES: dict[str, tuple[tuple[str, ...], Callable[..., Body]]] = {
    **{
        name: (tuple(inspect.signature(make).parameters), partial(Body.solid, name))
        for name, make in SOLIDS.items()
    },
    "particles": (("masses", "positions"), Body.from_particles),
}
BODIES = ("moments", "tensor", *SHAPES)  # a body has exactly one of these keys


def body_of(table: dict[str, Any], stored: Columns) -> Body:
    """The body of the table [body]."""
    only(table, (*BODIES, "mass", "centre", "axes", "pivot", "shape"), "body")
    keys = [key for key in BODIES if key in table]
    if len(keys) != 1:
        rule = f"give exactly one of these, not {len(keys)}"
        raise SceneError("body", " | ".join(BODIES), None, rule)
    key = keys[0]
    if key in SHAPES:
        body = _shaped(table, key)
    else:
        more = {k: parse(table[k], "body", k, stored) for k in ("mass", "centre") if k in table}
        if key == "moments":
            body = Body.from_moments(parse(table[key], "body", key, stored), **more)
        else:
            body = Body.from_tensor(numbers(table[key], "body", key), **more)
    if "axes" in table:
        axes = numbers(table["axes"], "body", "axes")
        body = replace(body, axes=tuple(map(tuple, axes)))
    if "shape" in table:
        body = replace(body, shape=shape_of(table["shape"]))
    return body.pivoted_at(table["pivot"]) if "pivot" in table else body


def _shaped(table: dict[str, Any], key: str) -> Body:
    """A solid, or a body of particles, from its own table within [body]."""
    keys, make = SHAPES[key]
    for extra in ("mass", "centre"):
        if extra in table:
            rule = f"a {key} has its mass and centre inside its own table: {', '.join(keys)}"
            raise SceneError("body", extra, table[extra], rule)
    only(table[key], keys, f"body.{key}", required=keys)
    return make(**{k: numbers(table[key][k], f"body.{key}", k) for k in keys})


def start_of(table: dict[str, Any], stored: Columns) -> Start:
    """The start of the table [start]."""
    only(table, ("omega", "momentum", "attitude"), "start")
    return Start(**{key: parse(value, "start", key, stored) for key, value in table.items()})


def effects_of(
    tables: dict[str, Any], stored: Columns, folder: str | bool | None
) -> tuple[Effect, ...]:
    """The effects of the tables [effects.NAME]; for `folder` see `_kind`."""
    effects = []
    for name, table in _each(tables, "effects"):
        kind, where = _kind(name, table, folder), f"effects.{name}"
        fields = given(kind)
        required = [field for field in fields if field not in kind._field_defaults]
        more = () if name in EFFECTS else ("module",)
        only(table, (*fields, *more), where, required)
        values = {k: parse(v, where, k, stored) for k, v in table.items() if k not in more}
        effects.append(kind(**values))
    return tuple(effects)


def observables_of(tables: dict[str, Any]) -> tuple[Any, ...]:
    """The observables over all steps of the tables [observables.NAME]."""
    observables = []
    for name, table in _each(tables, "observables"):
        if name not in WATCHED:
            raise unknown("observables", name, None, "observable over all steps", WATCHED)
        kind = WATCHED[name]
        required = [field for field in kind._fields if field not in kind._field_defaults]
        only(table, kind._fields, f"observables.{name}", required)
        observables.append(kind(**table))
    return tuple(observables)


def _each(tables: dict[str, Any], key: str) -> Iterator[tuple[str, Any]]:
    """(name, table) of [effects.spring], or of each [[effects.spring]]; SceneError for too many."""
    every = [
        (name, one)
        for name, table in tables.items()
        for one in (table if isinstance(table, list) else [table])
    ]
    if len(every) > MOST:
        rule = f"has more than {MOST} tables, the limit for one kernel"
        raise SceneError("", key, None, rule)
    return iter(every)


def _kind(name: str, table: Any, folder: str | bool | None) -> type[Effect]:
    """The class of an effect by its word, or from the Python file that defines it.

    folder : folder of the Python files that may be run; False if none may be run; None if classes
        without physics stand in for their classes
    """
    if name in EFFECTS:
        kind: type[Effect] = EFFECTS[name]
        return kind
    module = table.get("module") if isinstance(table, dict) else None
    if not isinstance(module, str):
        error = unknown("effects", name, None, "effect", EFFECTS)
        error.rule += '; an effect of your own needs module = "file.py"'
        raise error
    if folder is None:
        return _stand_in(name, table)
    if not isinstance(folder, str):
        rule = (
            "is code, and scene files execute nothing; look at it, then allow it with --allow-code"
            " (in Python allow_code=True)"
        )
        raise SceneError(f"effects.{name}", "module", module, rule)
    users: type[Effect] = class_of(folder, module, name, f"effects.{name}")
    return users


def _stand_in(name: str, table: dict[str, Any]) -> type[Effect]:
    """A class with the parameters of a table and without physics, in place of code that is not
    run."""
    fields = [key for key in table if key != "module"]
    try:
        made = namedtuple(name, fields)  # type: ignore[misc]  # fields are known at run time
    except ValueError as error:
        rule = f"cannot be a class with these parameters: {error}"
        raise SceneError("effects", name, None, rule) from None
    kind: Any = made
    kind.shapes = {key: len(value) for key, value in table.items() if isinstance(value, list)}
    kind.torque = kind.energy = kind.stand_in = lambda self: 0.0
    stand_in: type[Effect] = kind
    return stand_in
