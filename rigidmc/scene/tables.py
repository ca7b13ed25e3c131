"""The tables of a scene file as the parts of a scene: body, effects, observables, start."""

import inspect
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any

from rigidmc.dynamics.methods import implements
from rigidmc.effects import EFFECTS
from rigidmc.effects.parameters import given
from rigidmc.effects.protocol import Effect
from rigidmc.errors import SceneError, unknown
from rigidmc.integrators import INTEGRATORS
from rigidmc.mechanics.solids import SOLIDS
from rigidmc.observables import WATCHED, WITH_TABLE
from rigidmc.scene.body import Body
from rigidmc.scene.own import Code, own_class, stand_in
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
        elif isinstance(table[key], dict):
            body = Body.from_tensor(parse(table[key], "body", key, stored), **more)
        else:
            body = Body.from_tensor(numbers(table[key], "body", key), **more)
    if "axes" in table:
        axes = numbers(table["axes"], "body", "axes")
        body = replace(body, axes=tuple(map(tuple, axes)))
    if "shape" in table:
        body = replace(body, shape=shape_of(table["shape"]))
    if "pivot" not in table:
        return body
    pivot = table["pivot"]
    return body.about_centre() if pivot == "centre" else body.pivoted_at(pivot)


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


def effects_of(tables: dict[str, Any], stored: Columns) -> tuple[Effect, ...]:
    """The effects of the tables [effects.NAME]."""
    effects = []
    for name, table in _each(tables, "effects"):
        kind, where = _kind("effects", name, table, EFFECTS, stored.code), f"effects.{name}"
        fields = given(kind)
        required = [field for field in fields if field not in kind._field_defaults]
        more = () if name in EFFECTS else ("module",)
        only(table, (*fields, *more), where, required)
        values = {k: parse(v, where, k, stored) for k, v in table.items() if k not in more}
        effects.append(kind(**values))
    return tuple(effects)


def observables_of(tables: dict[str, Any], code: Code) -> tuple[Any, ...]:
    """The observables of the tables [observables.NAME]; code : see `rigidmc.scene.own`."""
    return tuple(
        _built("observables", name, table, {**WITH_TABLE, **WATCHED}, code)
        for name, table in _each(tables, "observables")
    )


def integrators_of(tables: dict[str, Any], code: Code) -> tuple[Any, ...]:
    """The integrators of the user's own, of the tables [integrators.NAME]."""
    return tuple(
        _built("integrators", name, table, {}, code) for name, table in _each(tables, "integrators")
    )


def _built(kind: str, name: str, table: Any, shipped: dict[str, Any], code: Code) -> Any:
    """What a table [kind.NAME] of plain numbers makes."""
    made = _kind(kind, name, table, shipped, code)
    more = () if name in shipped else ("module",)
    required = [field for field in made._fields if field not in made._field_defaults]
    only(table, (*made._fields, *more), f"{kind}.{name}", required)
    # compiled code takes tuples
    return made(**{key: _tuple(value) for key, value in table.items() if key not in more})


def _tuple(value: Any) -> Any:
    """A value with tuples in the place of lists."""
    return tuple(map(_tuple, value)) if isinstance(value, list) else value


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


def _kind(kind: str, name: str, table: Any, shipped: dict[str, Any], code: Code) -> Any:
    """The class of a table [kind.NAME], by its word or from the Python file that defines it."""
    if name in shipped:
        return shipped[name]
    one = {"effects": "effect", "observables": "observable over all steps"}.get(kind, "integrator")
    if not isinstance(table, dict) or "module" not in table:
        error = unknown(kind, name, None, one, shipped or INTEGRATORS)
        error.rule += f'; an {one.split()[0]} of your own needs module = "file.py"'
        raise error
    where = f"{kind}.{name}"
    found = own_class(name, table["module"], where, code)
    if found is None:
        return stand_in(kind, name, table)
    if not implements(found, "_fields"):
        rule = f"{found.__name__} is no NamedTuple, as an {one.split()[0]} has to be"
        raise SceneError(where, "module", table["module"], rule)
    return found
